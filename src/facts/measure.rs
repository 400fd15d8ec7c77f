//! The measurement: three kernels, and how the host interprets their answers and times.

use std::time::Instant;

use bytemuck::{Pod, Zeroable};

use super::{Facts, MOST_TURNS};
use crate::constants::{NODE_TEXELS, Specialization};
use crate::gpu::{BufferRole, BufferUse, Device, Executor, ExecutorDescription, GpuError};
use crate::layout::Batch;
use crate::recording::Recording;
use crate::shaders::{Access, Binding, BindingKind, Edition, Kernel};

include!(concat!(env!("OUT_DIR"), "/facts.rs"));

/// Nodes, a power of two, so that the exclusive-or of links is a link: 256 KiB, more than the first cache of a core
/// holds, and no more texels than any device allows.
const NODES: u32 = 1 << 12;
/// Invocations that follow links, and links that each follows: on two cores a launch of half a millisecond.
const WALKERS: u32 = 1 << 14;
const STEPS: u32 = 8;
/// Launches that are timed together.
const LAUNCHES: u32 = 16;
/// How often each time is measured: the least of them is the least disturbed.
const ROUNDS: usize = 10;
/// Pairs of operands.
const PAIRS: u32 = 1 << 18;

/// `Results` of `arithmetic.comp`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Results {
    quotient: f32,
    reciprocal: f32,
    root: f32,
    residual: f32,
    product: f32,
    sum: f32,
}

/// Measures a device.
pub fn measure(device: &Device) -> Result<Facts, GpuError> {
    let description = device.description();
    let mut random = Random(1);
    // The low bits of the generator repeat soon.
    let links: Vec<u32> = (0..4 * NODE_TEXELS * NODES).map(|_| (random.next() >> 8) % NODES).collect();
    let operands = operands(&mut random);

    let workgroup_size = 1 << description.max_workgroup_size.min(256).ilog2();
    let specialization = Specialization { workgroup_size, ..Specialization::DEFAULT }.words();
    let filled = |name, usage, contents| BufferRole {
        name,
        usage,
        size: size_of_val::<[u8]>(contents) as u64,
        contents: Some(contents),
    };
    let empty = |name, size: usize| BufferRole { name, usage: BufferUse::State, size: size as u64, contents: None };
    let mut executor = Executor::new(
        device,
        ExecutorDescription {
            kernels: &FACTS.iter().collect::<Vec<_>>(),
            specialization: &specialization,
            buffers: vec![
                filled(buffers::NODES, BufferUse::Scene { texel_bytes: 16 }, bytemuck::cast_slice(&links)),
                filled(buffers::LINKS, BufferUse::State, bytemuck::cast_slice(&links)),
                filled(buffers::OPERANDS, BufferUse::State, bytemuck::cast_slice(&operands)),
                empty(buffers::ENDS, size_of::<u32>() * WALKERS as usize),
                empty(buffers::RESULTS, size_of::<Results>() * PAIRS as usize),
                empty(buffers::LAST_STATE, 16),
            ],
            access: Access { texel_fetch: true, subgroup_ballot: false },
            edition: Edition::Plain,
            arithmetic: crate::shaders::Arithmetic::Native,
            driver: None,
        },
    )?;

    let groups = |invocations: u32| invocations / workgroup_size;
    let walk = |fetched, loaded| {
        let batch = Batch { first_pixel: NODES, first_sample: fetched, sample_count: loaded, ..Batch::zeroed() };
        let mut recording = Recording::default();
        recording.dispatch(kernels::GATHER, groups(WALKERS), &batch);
        recording
    };
    let turns = |turns, first_state, launches: u32| {
        let batch = Batch { first_pixel: first_state, sample_count: turns, ..Batch::zeroed() };
        let mut recording = Recording::default();
        for _ in 0..launches {
            recording.dispatch(kernels::LOOPS, 1, &batch);
        }
        recording
    };
    let timed = [walk(STEPS, 0), walk(0, STEPS), turns(0, 0, LAUNCHES)];
    let mut seconds = [f64::INFINITY; 3];
    // In turn, so that a disturbance affects all of them.
    for _ in 0..ROUNDS {
        for (least, recording) in seconds.iter_mut().zip(&timed) {
            *least = least.min(time(&mut executor, recording)?);
        }
    }
    let [fetched, loaded, launched] = seconds;
    let fetches = f64::from(WALKERS) * f64::from(STEPS) * f64::from(NODE_TEXELS);

    let found = executor.run(turns(MOST_TURNS, FIRST_STATE, 1).download_first(buffers::LAST_STATE, 4))?;
    let last: u32 = bytemuck::pod_read_unaligned(&found[0]);
    let mut recording = Recording::default();
    recording.dispatch(kernels::ARITHMETIC, groups(PAIRS), &Batch::zeroed()).download(buffers::RESULTS);
    let results: Vec<Results> = bytemuck::pod_collect_to_vec(&executor.run(&recording)?[0]);
    let arithmetic = Arithmetic::of(&operands, &results);
    Ok(Facts {
        texel_ns: 1e9 * fetched / fetches,
        storage_ns: 1e9 * loaded / fetches,
        launch_seconds: launched / f64::from(LAUNCHES),
        loop_turns: Some(turns_to(last)).filter(|turns| *turns < MOST_TURNS),
        division_exact: arithmetic.division_exact,
        reciprocal_exact: arithmetic.reciprocal_exact,
        root_exact: arithmetic.root_exact,
        fma_fused: arithmetic.fma_fused,
        flushes_operands: arithmetic.flushes_operands,
        flushes_results: arithmetic.flushes_results,
    })
}

/// Seconds of a recording, by the device's clock if it has one.
fn time(executor: &mut Executor, recording: &Recording) -> Result<f64, GpuError> {
    executor.forget_times();
    let start = Instant::now();
    executor.submit(recording)?;
    executor.wait()?;
    let by_host = start.elapsed().as_secs_f64();
    Ok(Some(executor.device_seconds()).filter(|seconds| *seconds > 0.0).unwrap_or(by_host))
}

/// Initial state of `loops.comp`.
const FIRST_STATE: u32 = 1;

/// Iterations of `loops.comp` that lead to a state, [`MOST_TURNS`] at most.
fn turns_to(last: u32) -> u32 {
    let states = std::iter::successors(Some(FIRST_STATE), |state| Some(Random(*state).next()));
    states.zip(0..MOST_TURNS).find(|(state, _)| *state == last).map_or(MOST_TURNS, |(_, turns)| turns)
}

/// The generator of `loops.comp`.
struct Random(u32);

impl Random {
    fn next(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        self.0
    }

    /// A number of either sign whose magnitude is in [2⁻²⁰, 2²⁰): no result of two of them is denormal or infinite.
    fn number(&mut self) -> f32 {
        let (mantissa, exponent) = (self.next() >> 9, 107 + (self.next() >> 16) % 40);
        f32::from_bits(self.next() & 1 << 31 | exponent << 23 | mantissa)
    }
}

/// Pairs of operands: with a denormal sum or product, and with a denormal operand, never both.
const TINY: f32 = f32::MIN_POSITIVE;
const DENORMAL_RESULTS: [[f32; 2]; 3] = [[TINY, 0.5], [1.5 * TINY, -TINY], [-1.25 * TINY, TINY]];
const DENORMAL_OPERANDS: [[f32; 2]; 3] = [[0.5 * TINY, 0.5 * TINY], [0.25 * TINY, 16.0], [-0.75 * TINY, 1e20]];

fn operands(random: &mut Random) -> Vec<[f32; 2]> {
    let mut operands = [DENORMAL_RESULTS, DENORMAL_OPERANDS].concat();
    operands.resize_with(PAIRS as usize, || [random.number(), random.number()]);
    operands
}

/// What the results say about a device.
#[derive(Debug, PartialEq)]
struct Arithmetic {
    division_exact: bool,
    reciprocal_exact: bool,
    root_exact: bool,
    fma_fused: bool,
    flushes_operands: bool,
    flushes_results: bool,
}

impl Arithmetic {
    /// Compares the results of the device with those of the processor, which rounds correctly.
    fn of(operands: &[[f32; 2]], results: &[Results]) -> Self {
        let is_same = |a: f32, b: f32| a.to_bits() == b.to_bits();
        let all = |test: &dyn Fn([f32; 2], &Results) -> bool| {
            let plain = DENORMAL_RESULTS.len() + DENORMAL_OPERANDS.len();
            operands.iter().zip(results).skip(plain).all(|(pair, result)| test(*pair, result))
        };
        let (of_results, of_operands) = results.split_at(DENORMAL_RESULTS.len());
        // A sum or product is right, or a denormal was replaced by zero.
        let flushes = |pairs: &[[f32; 2]], results: &[Results]| {
            pairs.iter().zip(results).any(|([a, b], result)| result.product != a * b || result.sum != a + b)
        };
        Self {
            division_exact: all(&|[a, b], result| is_same(result.quotient, a / b)),
            reciprocal_exact: all(&|[_, b], result| is_same(result.reciprocal, 1.0 / b)),
            root_exact: all(&|[a, _], result| is_same(result.root, a.abs().sqrt())),
            // In f64 the product is exact, and its rounding error is representable in f32.
            fma_fused: all(&|[a, b], result| {
                let taken = f64::from(a) * f64::from(b) - f64::from(a * b);
                result.residual == taken as f32
            }),
            flushes_results: flushes(&DENORMAL_RESULTS, of_results),
            flushes_operands: flushes(&DENORMAL_OPERANDS, of_operands),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a device with such arithmetic would answer.
    fn answers(operands: &[[f32; 2]], alter: impl Fn(usize, [f32; 2], &mut Results)) -> Vec<Results> {
        let answer = |(i, &[a, b]): (usize, &[f32; 2])| {
            let residual = (f64::from(a) * f64::from(b) - f64::from(a * b)) as f32;
            let mut results = Results {
                quotient: a / b,
                reciprocal: 1.0 / b,
                root: a.abs().sqrt(),
                residual,
                product: a * b,
                sum: a + b,
            };
            alter(i, [a, b], &mut results);
            results
        };
        operands.iter().enumerate().map(answer).collect()
    }

    const EXACT: Arithmetic = Arithmetic {
        division_exact: true,
        reciprocal_exact: true,
        root_exact: true,
        fma_fused: true,
        flushes_operands: false,
        flushes_results: false,
    };

    #[test]
    fn each_inexact_operation_is_told() {
        let operands = operands(&mut Random(1));
        let told =
            |alter: &dyn Fn(usize, [f32; 2], &mut Results)| Arithmetic::of(&operands, &answers(&operands, alter));
        let last = operands.len() - 1;
        let up = |value: &mut f32| *value = value.next_up();
        let flushed = |value: f32| if value.is_subnormal() { 0.0 } else { value };
        assert_eq!(told(&|_, _, _| {}), EXACT);
        let one = |i, alter: &dyn Fn(&mut Results)| {
            told(&|at, _, results| {
                if at == i {
                    alter(results)
                }
            })
        };
        assert_eq!(one(last, &|r| up(&mut r.quotient)), Arithmetic { division_exact: false, ..EXACT });
        assert_eq!(one(last, &|r| up(&mut r.reciprocal)), Arithmetic { reciprocal_exact: false, ..EXACT });
        assert_eq!(one(last, &|r| up(&mut r.root)), Arithmetic { root_exact: false, ..EXACT });
        assert_eq!(told(&|_, _, r| r.residual = 0.0), Arithmetic { fma_fused: false, ..EXACT });
        let of_results = |_, _, r: &mut Results| (r.product, r.sum) = (flushed(r.product), flushed(r.sum));
        assert_eq!(told(&of_results), Arithmetic { flushes_results: true, ..EXACT });
        let of_operands = |_, pair: [f32; 2], r: &mut Results| {
            let [a, b] = pair.map(flushed);
            (r.product, r.sum) = (a * b, a + b);
        };
        assert_eq!(told(&of_operands), Arithmetic { flushes_operands: true, ..EXACT });
    }

    #[test]
    fn turns_are_told_by_the_state_that_they_lead_to() {
        let state = |turns| (0..turns).fold(FIRST_STATE, |state, _| Random(state).next());
        for turns in [0, 1, 65_535, MOST_TURNS - 1, MOST_TURNS] {
            assert_eq!(turns_to(state(turns)), turns);
        }
    }
}
