//! Recordings cut into submissions, which have room for a number of steps and of bytes to the device and back.
//! Arithmetic without a device.

use super::hazards::Accesses;
use crate::recording::{Command, Dispatch, Recording, Workgroups};
use crate::shaders::Binding;

/// Parts of what is carried begin at multiples of this, so that they can be seen as structs.
const ALIGNMENT: u64 = 64;

/// What fits one submission.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    /// Steps.
    pub steps: usize,
    /// Bytes that it carries in either direction; a multiple of [`ALIGNMENT`].
    pub bytes: u64,
}

/// A command, or a part of one that carries more bytes than a submission can.
#[derive(Debug, Clone, Copy)]
pub(super) enum Step<'a> {
    /// A launch.
    Dispatch(&'a Dispatch),
    /// Bytes of the host for a buffer.
    Upload {
        buffer: &'static str,
        /// Where they go in the buffer.
        offset: u64,
        /// Where they lie in the submission's staging memory.
        staged_at: u64,
        bytes: u64,
        /// What is to be put there; `None` where it lies there already.
        contents: Option<&'a [u8]>,
    },
    /// Zeros.
    Clear { buffer: &'static str },
    /// Bytes from buffer to buffer.
    Copy { from: &'static str, to: &'static str, bytes: u64 },
    /// Bytes of a buffer for the host.
    Download(Downloaded),
}

/// A part of a download.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Downloaded {
    /// Which of the recording's downloads it belongs to.
    pub number: usize,
    pub buffer: &'static str,
    /// Where it begins in the buffer.
    pub offset: u64,
    /// Where it goes in the submission's readback memory.
    pub at: u64,
    pub bytes: u64,
}

impl<'a> Step<'a> {
    /// The launch that it is, if it is one.
    pub fn dispatch(&self) -> Option<&'a Dispatch> {
        match self {
            Self::Dispatch(dispatch) => Some(dispatch),
            _ => None,
        }
    }

    /// What it is called where a tool shows it.
    pub fn label(&self) -> String {
        match self {
            Self::Dispatch(dispatch) => dispatch.kernel.name.to_owned(),
            Self::Upload { buffer, .. } => format!("upload {buffer}"),
            Self::Clear { buffer } => format!("clear {buffer}"),
            Self::Copy { from, to, .. } => format!("copy {from} to {to}"),
            Self::Download(Downloaded { buffer, .. }) => format!("download {buffer}"),
        }
    }

    /// Buffers that it touches; `bindings` are those of its kernel, if it is a launch.
    pub fn accesses(&self, bindings: &[Binding]) -> Accesses {
        let one = |name: &'static str| vec![name];
        match self {
            Self::Dispatch(Dispatch { workgroups, .. }) => {
                let arguments = match workgroups {
                    Workgroups::Indirect { buffer, .. } => Some(*buffer),
                    Workgroups::Direct(_) => None,
                };
                Accesses {
                    reads: bindings.iter().filter(|b| b.reads).map(|b| b.name).chain(arguments).collect(),
                    writes: bindings.iter().filter(|b| b.writes).map(|b| b.name).collect(),
                }
            }
            Self::Upload { buffer, .. } | Self::Clear { buffer } => {
                Accesses { writes: one(buffer), ..Accesses::default() }
            }
            Self::Copy { from, to, .. } => Accesses { reads: one(from), writes: one(to) },
            Self::Download(Downloaded { buffer, .. }) => Accesses { reads: one(buffer), ..Accesses::default() },
        }
    }
}

/// Cuts a recording into the steps of submissions. `size_of` is the size of a buffer.
pub(super) fn submissions<'a>(
    recording: &'a Recording,
    room: Room,
    size_of: impl Fn(&str) -> u64,
) -> Vec<Vec<Step<'a>>> {
    let mut cut = Cut { room, submissions: vec![Vec::new()], uploaded: 0, downloaded: 0 };
    let mut downloads = 0;
    for command in &recording.commands {
        match command {
            Command::Dispatch(dispatch) => cut.add(Step::Dispatch(dispatch)),
            Command::Clear { buffer } => cut.add(Step::Clear { buffer }),
            Command::Copy { from, to, bytes } => {
                assert!(*bytes <= size_of(from).min(size_of(to)), "what is copied from {from} fits {to}");
                cut.add(Step::Copy { from, to, bytes: *bytes });
            }
            Command::Upload { buffer, contents } => {
                assert!(contents.len() as u64 <= size_of(buffer), "what is uploaded fits {buffer}");
                let mut offset = 0;
                while offset < contents.len() as u64 {
                    let (staged_at, bytes) = cut.upload(contents.len() as u64 - offset);
                    let contents = Some(&contents[offset as usize..][..bytes as usize]);
                    cut.add(Step::Upload { buffer, offset, staged_at, bytes, contents });
                    offset += bytes;
                }
            }
            Command::Download { buffer, bytes } => {
                let size = bytes.unwrap_or_else(|| size_of(buffer));
                assert!(size <= size_of(buffer), "what is downloaded of {buffer} is in it");
                let mut offset = 0;
                while offset < size {
                    let (at, bytes) = cut.download(size - offset);
                    cut.add(Step::Download(Downloaded { number: downloads, buffer, offset, at, bytes }));
                    offset += bytes;
                }
                downloads += 1;
            }
        }
    }
    cut.submissions
}

/// Submissions so far, the last of them with the bytes that it carries.
struct Cut<'a> {
    room: Room,
    submissions: Vec<Vec<Step<'a>>>,
    uploaded: u64,
    downloaded: u64,
}

impl<'a> Cut<'a> {
    fn add(&mut self, step: Step<'a>) {
        if self.is_full() {
            self.next();
        }
        self.submissions.last_mut().expect("there is one").push(step);
    }

    fn is_full(&self) -> bool {
        self.submissions.last().is_some_and(|steps| steps.len() == self.room.steps)
    }

    fn next(&mut self) {
        self.submissions.push(Vec::new());
        (self.uploaded, self.downloaded) = (0, 0);
    }

    /// Takes room for up to that many bytes to the device: where they lie, and how many of them fit.
    fn upload(&mut self, bytes: u64) -> (u64, u64) {
        if self.is_full() || self.uploaded == self.room.bytes {
            self.next();
        }
        take(&mut self.uploaded, bytes, self.room.bytes)
    }

    /// The same, to the host.
    fn download(&mut self, bytes: u64) -> (u64, u64) {
        if self.is_full() || self.downloaded == self.room.bytes {
            self.next();
        }
        take(&mut self.downloaded, bytes, self.room.bytes)
    }
}

fn take(taken: &mut u64, bytes: u64, room: u64) -> (u64, u64) {
    let (at, bytes) = (*taken, bytes.min(room - *taken));
    *taken = (at + bytes).next_multiple_of(ALIGNMENT);
    (at, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::hazards::Hazards;
    use crate::shaders::{buffers, kernels};

    const ROOM: Room = Room { steps: 3, bytes: 128 };

    /// Each submission's steps as text, with offset, place and bytes of what they carry.
    fn cut(recording: &Recording, size: u64) -> Vec<Vec<String>> {
        let text = |step: &Step<'_>| match step {
            Step::Upload { offset, staged_at, bytes, contents, .. } => {
                assert_eq!(contents.map(<[u8]>::len), Some(*bytes as usize));
                format!("{} {offset} {staged_at} {bytes}", step.label())
            }
            Step::Download(Downloaded { number, offset, at, bytes, .. }) => {
                format!("{number}: {} {offset} {at} {bytes}", step.label())
            }
            _ => step.label(),
        };
        submissions(recording, ROOM, |_| size).iter().map(|steps| steps.iter().map(text).collect()).collect()
    }

    #[test]
    fn a_submission_has_no_more_steps_than_fit() {
        let mut recording = Recording::default();
        assert_eq!(cut(&recording, 16), [Vec::<String>::new()]);
        recording.clear("a").copy("a", "b", 16).dispatch(kernels::RESOLVE, 1, &0_u32).clear("c");
        assert_eq!(cut(&recording, 16), [vec!["clear a", "copy a to b", "resolve"], vec!["clear c"]]);
    }

    #[test]
    fn what_is_carried_is_cut_to_what_fits() {
        let mut recording = Recording::default();
        recording.upload("a", &[1; 70]).upload("b", &[2; 70]).download("a").download_first("b", 10).download("a");
        let expected = [
            // The next place is a multiple of 64, and there is none left after the 70 bytes.
            vec!["upload a 0 0 70"],
            vec!["upload b 0 0 70", "0: download a 0 0 128"],
            vec!["0: download a 128 0 2", "1: download b 0 64 10"],
            vec!["2: download a 0 0 128"],
            vec!["2: download a 128 0 2"],
        ];
        assert_eq!(cut(&recording, 130), expected);
        let contents: Vec<u8> = (0..=255).collect();
        recording = Recording::default();
        recording.upload("a", &contents);
        let uploaded = submissions(&recording, ROOM, |_| 256).into_iter().flatten().flat_map(|step| match step {
            Step::Upload { contents, .. } => contents.unwrap_or_default().to_vec(),
            _ => Vec::new(),
        });
        assert!(uploaded.eq(contents.iter().copied()));
    }

    #[test]
    #[should_panic(expected = "fits a")]
    fn what_does_not_fit_a_buffer_is_refused() {
        let mut recording = Recording::default();
        submissions(recording.upload("a", &[0; 17]), ROOM, |_| 16);
    }

    /// The labels of a recording's steps that wait for a barrier.
    fn waiting(recording: &Recording) -> Vec<String> {
        let mut hazards = Hazards::default();
        let room = Room { steps: 100, bytes: 1 << 20 };
        let steps: Vec<_> = submissions(recording, room, |_| 1 << 10).into_iter().flatten().collect();
        let waits = |step: &Step<'_>| {
            let bindings = step.dispatch().map(|d| d.kernel.bindings);
            hazards.needs_barrier(&step.accesses(bindings.unwrap_or_default()))
        };
        let mut waits = waits;
        steps.iter().filter(|step| waits(step)).map(Step::label).collect()
    }

    #[test]
    fn transfers_and_launches_wait_for_each_other() {
        let mut recording = Recording::default();
        recording.clear(buffers::FILM).upload(buffers::CONTROL, &[0; 16]).clear(buffers::RAY_COUNTS);
        assert!(waiting(&recording).is_empty(), "they touch other buffers");
        recording.dispatch(kernels::PREPARE_DISPATCH, 1, &0_u32);
        assert_eq!(waiting(&recording), ["prepare_dispatch"], "a launch waits for uploads and clears");
        recording.download(buffers::CONTROL).download(buffers::RAY_COUNTS).download(buffers::CONTROL);
        assert_eq!(waiting(&recording), ["prepare_dispatch", "download control"], "reads do not wait for reads");
        recording.upload(buffers::CONTROL, &[0; 16]);
        assert_eq!(waiting(&recording).last().map(String::as_str), Some("upload control"), "a write waits for a read");
    }

    #[test]
    fn a_copy_reads_one_buffer_and_writes_another() {
        let mut recording = Recording::default();
        recording.copy("a", "b", 16).copy("a", "c", 16);
        assert!(waiting(&recording).is_empty());
        recording.clear("a");
        assert_eq!(waiting(&recording), ["clear a"]);
        recording.copy("c", "a", 16);
        assert_eq!(waiting(&recording), ["clear a", "copy c to a"]);
    }

    #[test]
    fn an_indirect_launch_waits_for_its_size() {
        // The kernel does not bind the buffer that says how large the launch is.
        let mut recording = Recording::default();
        recording.clear("sizes").dispatch(kernels::RESOLVE, 1, &0_u32);
        assert!(waiting(&recording).is_empty());
        recording = Recording::default();
        recording.clear("sizes").dispatch_indirect(kernels::RESOLVE, ("sizes", 0), &0_u32);
        assert_eq!(waiting(&recording), ["resolve"]);
    }
}
