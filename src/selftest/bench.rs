//! Where the self-test's kernels run.

use bytemuck::Pod;

use crate::gpu::{BufferRole, BufferUse, Device, Executor, ExecutorDescription, GpuError};
use crate::layout::Batch;
use crate::recording::Recording;
use crate::render::Defaults;
use crate::settings::Fetch;
use crate::shaders::{Access, Arithmetic, Binding, BindingKind, Edition, Kernel, Variant};

include!(concat!(env!("OUT_DIR"), "/selftest.rs"));

/// Kernels of functions that renders call, in the arithmetic of renders.
const OWN_FUNCTIONS: [&Kernel; 3] = [kernels::CONVERSIONS, kernels::EDGES, kernels::ELEMENTARY];

/// A device, ready to be asked.
pub struct Bench<'a> {
    /// What is tested.
    pub(super) device: &'a Device,
    /// Of millions of cases one of so many is tried.
    thinned: u32,
    /// What becomes of a kernel's answers.
    fault: fn(&str, &mut [u8]),
}

/// A launch over `count` invocations: what [`Batch`] tells the kernels of `shaders/selftest`.
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

    /// Tries one of `by` cases where they are millions: for tests on a slow device.
    pub fn thinned(self, by: u32) -> Self {
        Self { thinned: by, ..self }
    }

    /// Has answers changed before they are judged, by the name of their kernel: a broken device, to test the checks by.
    pub fn with_fault(self, fault: fn(&str, &mut [u8])) -> Self {
        Self { fault, ..self }
    }

    /// Of millions of cases those that are tried.
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
        // What the driver itself does is asked of all but the renderer's own functions.
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

    /// Runs a recording and takes what its kernel answered.
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

    /// What a kernel answers, which has room for as many as `size` bytes of zeros, in one launch.
    pub fn launch<A: Pod>(&self, kernel: &'static Kernel, size: usize, batch: Batch) -> Result<Vec<A>, GpuError> {
        let mut executor = self.open(&[kernel], vec![state(buffers::ANSWERS, size, None)])?;
        let mut work = Recording::default();
        work.dispatch(kernel, batch.pixel_count.div_ceil(self.workgroup_size()), &batch);
        self.run(&mut executor, kernel, &mut work)
    }

    /// What a kernel that is a function answers to each case; `function` says which, where it has several.
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
        // A buffer has sixteen bytes at least.
        answers.truncate(cases.len());
        Ok(answers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shaders::{Build, Form, Forms, Promises};

    #[test]
    fn own_functions_have_every_portable_form() {
        for kernel in OWN_FUNCTIONS {
            for form in [Form::Native, Form::ByFma, Form::ByIntegers] {
                let arithmetic = Arithmetic::Portable(Forms { division: form, reciprocal: form, root: form });
                let build = Build { constants: &[64], arithmetic, driver: None, promises: Promises::default() };
                for variant in kernel.variants {
                    assert!(!variant.specialize(&build).words.is_empty());
                }
            }
        }
    }
}
