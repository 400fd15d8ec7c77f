//! Names of objects and labels of regions, for tools that capture or check: VK_EXT_debug_utils.
//!
//! Whether there are any is decided once, in [`Labels::new`]. Where there are none nothing is formatted or called.

use std::ffi::CString;
use std::fmt;

use ash::{ext, vk};

use super::error::GpuError;
use super::instance::Instance;
use super::steps::Step;

/// The functions that name and label, where anyone is there to see it.
pub(super) struct Labels(Option<ext::debug_utils::Device>);

/// Whether an instance is to have the extension: it costs nothing as long as nobody calls it, and a tool that was loaded
/// beside raywave can be asked only once there is an instance.
pub(super) fn extension_wanted(asked: bool, validation: bool, listed: bool) -> Result<bool, GpuError> {
    match (listed || validation, asked) {
        (false, true) => Err(GpuError::NoLabels),
        (is_there, _) => Ok(is_there),
    }
}

impl Labels {
    /// Labels of a device: where the user asked for them, raywave validates, or a tool at work says that it shows them.
    pub fn new(instance: &Instance, physical_device: vk::PhysicalDevice, device: &ash::Device) -> Self {
        let wanted = instance.has_debug_utils
            && (instance.tools.labels || instance.tools.validation || instance.tool_shows_labels(physical_device));
        Self(wanted.then(|| ext::debug_utils::Device::new(&instance.raw, device)))
    }

    /// Whether there are any.
    pub fn are_set(&self) -> bool {
        self.0.is_some()
    }

    /// Names an object, which no other thread uses meanwhile.
    pub fn name<T: vk::Handle>(&self, object: T, name: fmt::Arguments<'_>) {
        let Some(functions) = &self.0 else { return };
        let name = text(&name.to_string());
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: the object is alive and of this device, and the name a local. It fails only for want of
        // memory, and then only the name is missing.
        let _ = unsafe { functions.set_debug_utils_object_name(&info) };
    }

    /// Opens and closes the regions that lie between two steps of a command buffer, or before the first or behind the
    /// last one.
    pub fn between(&self, commands: vk::CommandBuffer, before: Option<&Step<'_>>, after: Option<&Step<'_>>) {
        if self.are_set() {
            marks_between(before, after).iter().for_each(|mark| self.put(commands, mark));
        }
    }

    /// Makes what is recorded a region.
    pub fn region(&self, commands: vk::CommandBuffer, name: fmt::Arguments<'_>, record: impl FnOnce()) {
        if !self.are_set() {
            return record();
        }
        self.put(commands, &Mark::Open(name.to_string()));
        record();
        self.put(commands, &Mark::Close);
    }

    fn put(&self, commands: vk::CommandBuffer, mark: &Mark) {
        let Some(functions) = &self.0 else { return };
        match mark {
            Mark::Open(name) => {
                let name = text(name);
                let label = vk::DebugUtilsLabelEXT::default().label_name(&name);
                // SAFETY: the command buffer is being recorded, by this thread alone, and the name is a local.
                unsafe { functions.cmd_begin_debug_utils_label(commands, &label) };
            }
            // SAFETY: as above; a region is open, since each is closed once.
            Mark::Close => unsafe { functions.cmd_end_debug_utils_label(commands) },
        }
    }
}

/// A text of ours, which has no zero in it.
fn text(name: &str) -> CString {
    CString::new(name).unwrap_or_default()
}

/// An end of a region.
#[derive(Debug, PartialEq, Eq)]
enum Mark {
    Open(String),
    Close,
}

/// A bounce is a region, and in it, or outside of any, each step is one.
fn marks_between(before: Option<&Step<'_>>, after: Option<&Step<'_>>) -> Vec<Mark> {
    let mut marks = Vec::new();
    let [from, to] = [before, after].map(|step| step.and_then(Step::dispatch).and_then(|dispatch| dispatch.bounce));
    if before.is_some() {
        marks.push(Mark::Close);
    }
    if from != to {
        marks.extend(from.map(|_| Mark::Close));
        marks.extend(to.map(|bounce| Mark::Open(format!("bounce {bounce}"))));
    }
    marks.extend(after.map(|step| Mark::Open(step.label())));
    marks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::steps::{Room, submissions};
    use crate::recording::Recording;
    use crate::shaders::{buffers, kernels};

    /// The regions of the first steps of a recording, as a tool shows them: each step with what it lies in.
    fn regions(recording: &Recording, most: usize) -> Vec<String> {
        let (mut open, mut seen) = (Vec::new(), Vec::new());
        let cut = submissions(recording, Room { steps: 100, bytes: 1 << 10 }, |_| 64);
        let steps: Vec<_> = cut[0].iter().take(most).map(Some).collect();
        let mut before = None;
        for after in steps.into_iter().chain([None]) {
            for mark in marks_between(before, after) {
                match mark {
                    Mark::Open(name) => open.push(name),
                    Mark::Close => assert!(open.pop().is_some(), "what is closed was open"),
                }
            }
            seen.extend(after.map(|_| open.join(" > ")));
            before = after;
        }
        assert!(open.is_empty(), "{open:?} is left open");
        seen
    }

    #[test]
    fn bounces_hold_their_passes() {
        let mut recording = Recording::default();
        recording.clear(buffers::FILM).dispatch(kernels::GENERATE, 1, &0_u32);
        for bounce in 0..2 {
            recording.bounce(bounce, |recording| {
                recording.dispatch_indirect(kernels::EXTEND, (buffers::CONTROL, 16), &0_u32);
                recording.dispatch(kernels::PREPARE_DISPATCH, 1, &0_u32);
            });
        }
        recording.dispatch(kernels::RESOLVE, 1, &0_u32).download(buffers::CONTROL);
        let expected = [
            "clear film",
            "generate",
            "bounce 0 > extend",
            "bounce 0 > prepare_dispatch",
            "bounce 1 > extend",
            "bounce 1 > prepare_dispatch",
            "resolve",
            "download control",
        ];
        assert_eq!(regions(&recording, 100), expected);
        // A command buffer may end within a bounce, and the next one goes on in it.
        assert_eq!(regions(&recording, 3), expected[..3]);
        assert!(regions(&Recording::default(), 100).is_empty());
    }

    #[test]
    fn labels_that_nobody_can_see_are_refused() {
        assert!(matches!(extension_wanted(true, false, false), Err(GpuError::NoLabels)));
        for (asked, validation, listed, wanted) in [
            (false, false, false, false),
            (false, false, true, true),
            (true, false, true, true),
            // The layer brings the extension itself.
            (true, true, false, true),
            (false, true, false, true),
        ] {
            let found = extension_wanted(asked, validation, listed).expect("it can be had, or is not asked for");
            assert_eq!(found, wanted, "{asked} {validation} {listed}");
        }
    }
}
