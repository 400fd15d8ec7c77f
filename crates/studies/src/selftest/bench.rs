//! Where the self-test's kernels run.

use bytemuck::Pod;

use raywave::gpu::{BufferRole, BufferUse, Device, Executor, ExecutorDescription, GpuError};
use raywave::layout::Batch;
use raywave::recording::Recording;
use raywave::render::Defaults;
use raywave::settings::Fetch;
use raywave::shaders::{Access, Arithmetic, Edition, Kernel};

pub use raywave::shaders::selftest::{buffers, kernels};

/// Kernels of functions that renders call, in the arithmetic of renders.
const OWN_FUNCTIONS: [&Kernel; 3] = [kernels::CONVERSIONS, kernels::EDGES, kernels::ELEMENTARY];

/// A device, ready to be tested.
pub struct Bench<'a> {
    /// What is tested.
    pub(super) device: &'a Device,
    /// Of millions of cases, one in this many is tried.
    thinned: u32,
    /// Changes a kernel's answers.
    fault: fn(&str, &mut [u8]),
}

/// A launch over `count` invocations, as [`Batch`] describes it to the kernels of `shaders/selftest`.
pub fn launch(count: u32) -> Batch {
    Batch {
        first_pixel: 0,
        pixel_count: count,
        first_sample: 0,
        sample_count: 1,
        bounce: 0,
        film_pixel: 0,
        first_slot: 0,
    }
}

/// A buffer that kernels read and write.
pub fn state<'a>(name: &'static str, size: usize, contents: Option<&'a [u8]>) -> BufferRole<'a> {
    BufferRole { name, usage: BufferUse::State, size: size.max(16) as u64, contents }
}

impl<'a> Bench<'a> {
    /// A bench on that device.
    pub fn new(device: &'a Device) -> Self {
        Self { device, thinned: 1, fault: |_, _| () }
    }

    /// Tries one in `by` cases if there are millions: for tests on a slow device.
    pub fn thinned(self, by: u32) -> Self {
        Self { thinned: by, ..self }
    }

    /// Changes answers before they are judged, by the name of their kernel: a simulated broken device that tests the
    /// checks.
    pub fn with_fault(self, fault: fn(&str, &mut [u8])) -> Self {
        Self { fault, ..self }
    }

    /// The number of cases that are tried, of millions.
    pub fn part_of(&self, cases: u32) -> u32 {
        cases / self.thinned
    }

    /// Invocations of a workgroup.
    pub fn workgroup_size(&self) -> u32 {
        self.device.description().max_workgroup_size.min(256)
    }

    /// Kernels and their buffers.
    pub fn open(&self, kernels: &[&'static Kernel], buffers: Vec<BufferRole<'_>>) -> Result<Executor, GpuError> {
        self.open_specialized(kernels, buffers, &[self.workgroup_size()])
    }

    /// As [`Bench::open`], with specialization constants by id.
    pub fn open_specialized(
        &self,
        kernels: &[&'static Kernel],
        buffers: Vec<BufferRole<'_>>,
        specialization: &[u32],
    ) -> Result<Executor, GpuError> {
        let defaults = Defaults::of(self.device)?;
        // All kernels test the driver itself, except those of the renderer's own functions.
        let is_own = kernels.iter().all(|kernel| OWN_FUNCTIONS.iter().any(|own| own.name == kernel.name));
        let description = ExecutorDescription {
            kernels,
            specialization,
            buffers,
            access: Access { texel_fetch: defaults.fetch == Fetch::Texel, subgroup_ballot: true },
            edition: Edition::Plain,
            arithmetic: if is_own { Arithmetic::Portable(defaults.forms) } else { Arithmetic::Native },
            driver: None,
        };
        Executor::new(self.device, description)
    }

    /// Runs a recording and returns its kernel's answers.
    pub fn run<A: Pod>(
        &self,
        executor: &mut Executor,
        kernel: &Kernel,
        work: &mut Recording,
    ) -> Result<Vec<A>, GpuError> {
        let mut found = executor.run(work.download(buffers::ANSWERS))?;
        (self.fault)(kernel.name, &mut found[0]);
        Ok(bytemuck::pod_collect_to_vec(&found[0]))
    }

    /// The answers of a kernel in one launch, in a buffer of `size` bytes that starts as zeros.
    pub fn launch<A: Pod>(&self, kernel: &'static Kernel, size: usize, batch: Batch) -> Result<Vec<A>, GpuError> {
        let mut executor = self.open(&[kernel], vec![state(buffers::ANSWERS, size, None)])?;
        let mut work = Recording::default();
        work.dispatch(kernel, batch.pixel_count.div_ceil(self.workgroup_size()), &batch);
        self.run(&mut executor, kernel, &mut work)
    }

    /// The answers to each case of a kernel that evaluates a function; `function` says which, if it has several.
    pub fn ask<C: Pod, A: Pod>(&self, kernel: &'static Kernel, function: u32, cases: &[C]) -> Result<Vec<A>, GpuError> {
        let bytes = bytemuck::cast_slice(cases);
        let roles = vec![
            state(buffers::CASES, bytes.len(), Some(bytes)),
            state(buffers::ANSWERS, size_of::<A>() * cases.len(), None),
        ];
        let mut executor = self.open(&[kernel], roles)?;
        let batch = Batch { bounce: function, ..launch(cases.len() as u32) };
        let mut work = Recording::default();
        work.dispatch(kernel, batch.pixel_count.div_ceil(self.workgroup_size()), &batch);
        let mut answers = self.run(&mut executor, kernel, &mut work)?;
        // A buffer has at least sixteen bytes.
        answers.truncate(cases.len());
        Ok(answers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raywave::shaders::{Build, Form, Forms, Promises, portable_library};

    #[test]
    fn own_functions_have_every_portable_form() {
        for kernel in OWN_FUNCTIONS {
            for form in [Form::Native, Form::ByFma, Form::ByIntegers] {
                let arithmetic = Arithmetic::Portable(Forms { division: form, reciprocal: form, root: form });
                let build = Build {
                    constants: &[64],
                    access: Access { texel_fetch: false, subgroup_ballot: true },
                    edition: Edition::Plain,
                    arithmetic,
                    driver: None,
                    promises: Promises::default(),
                };
                assert!(!kernel.specialize(&build, portable_library()).words.is_empty());
            }
        }
    }
}
