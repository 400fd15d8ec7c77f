//! Launches: indirect ones, long loops, passes that wait for each other, and their clock.

use std::mem::offset_of;
use std::time::Instant;

use rayon::prelude::*;

use super::bench::{Bench, buffers, kernels, launch, state};
use super::{Check, Faults, Finding, Verdict};
use raywave::layout::{Batch, Control};
use raywave::recording::Recording;
use raywave::render::RenderError;

pub const CHECKS: &[Check] = &[
    Check {
        name: "indirect",
        checked: "launches whose size a kernel wrote just before",
        spoils: "paths after the first bounce are lost",
        run: indirect,
    },
    Check {
        name: "loops",
        checked: "loops end when they should, up to 2^20 turns",
        spoils: "renders lose samples without a word",
        run: loops,
    },
    Check {
        name: "barriers",
        checked: "a pass reads what other workgroups wrote in the pass before, on a full device",
        spoils: "paths mix: images differ from run to run",
        run: barriers,
    },
    Check {
        name: "clock",
        checked: "timestamps run forward and agree with the host's clock",
        spoils: "times and speeds; images are right",
        run: clock,
    },
];

/// Workgroups of the successive launches.
const SIZES: [u32; 8] = [1, 0, 7, 1000, 2, 20_000, 0, 300];

fn indirect(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    let kernels = [kernels::INDIRECT_SIZE, kernels::INDIRECT_WORK];
    let control = Control { ray_groups: [0, 1, 1], ..bytemuck::Zeroable::zeroed() };
    let sizes = SIZES.map(|size| size.min(bench.device.description().max_workgroups));
    let roles = vec![
        state(buffers::CONTROL, size_of::<Control>(), Some(bytemuck::bytes_of(&control))),
        state(buffers::CASES, size_of_val(&sizes), Some(bytemuck::cast_slice(&sizes))),
        state(buffers::ANSWERS, 16 * sizes.len(), None),
    ];
    let mut executor = bench.open(&kernels, roles)?;
    let mut work = Recording::default();
    for step in 0..sizes.len() as u32 {
        let batch = Batch { bounce: step, ..launch(0) };
        work.dispatch(kernels[0], 1, &batch);
        work.dispatch_indirect(kernels[1], (buffers::CONTROL, offset_of!(Control, ray_groups)), &batch);
    }
    let answers = bench.run(&mut executor, kernels[1], &mut work)?;
    Ok(judge_indirect(&sizes, bench.workgroup_size(), &answers).finding("all are as large as written", Verdict::Off))
}

fn judge_indirect(sizes: &[u32], workgroup_size: u32, answers: &[[u32; 4]]) -> Faults {
    let mut faults = Faults::default();
    for (size, [invocations, met, told, _]) in sizes.iter().zip(answers) {
        let right = (*invocations, *met, *told) == (size * workgroup_size, *size, *size);
        faults.see(right, || {
            format!("{size} workgroups are {met}, {told} by their own word, of {invocations} invocations")
        });
    }
    faults
}

/// Loop iterations: about the limit of some drivers, and far beyond.
const TURNS: [u32; 8] = [0, 1, 1000, 65_534, 65_535, 65_536, 100_000, 1 << 20];
/// The most iterations that raywave's kernels run a loop for. With the check that ends it, its head is passed 65,535
/// times, after which some drivers leave it.
const NEEDED_TURNS: u32 = 65_534;

fn loops(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    let mut answers: Vec<[u32; 2]> = Vec::new();
    // One by one: some drivers count the iterations of all lanes together.
    for turns in TURNS {
        answers.extend(bench.ask::<_, [u32; 2]>(kernels::LOOPS, 0, &[turns])?);
    }
    Ok(judge_loops(&answers))
}

fn judge_loops(answers: &[[u32; 2]]) -> Finding {
    let made = |turns: u32, of: u32| {
        (0..turns).fold(of, |word, turn| (word ^ word >> 15).wrapping_mul(747_796_405).wrapping_add(turn))
    };
    let mut faults = Faults::default();
    let mut limit = None;
    for (turns, [taken, word]) in TURNS.into_iter().zip(answers) {
        let is_cut = *taken < turns && *taken >= NEEDED_TURNS;
        if is_cut {
            limit = limit.max(Some(*taken));
        }
        let right = (*taken == turns || is_cut) && *word == made(*taken, turns);
        faults.see(right, || format!("a loop of {turns} turns that has taken {taken}"));
    }
    match (faults.wrong, limit) {
        (0, Some(turns)) => {
            let found = format!("the driver leaves loops after {turns} turns; raywave's are shorter");
            Finding::new(faults.cases, Verdict::Property, found)
        }
        _ => faults.finding("all do", Verdict::Off),
    }
    .with("limit_turns", limit)
}

/// Words per pass, and passes of the chain.
const CHAIN: (u32, u32) = (1 << 19, 64);

fn barriers(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    let (count, passes) = CHAIN;
    let first: Vec<u32> = (0..2 * count).map(|i| if i < count { i } else { 0 }).collect();
    let bytes = bytemuck::cast_slice(&first);
    let mut executor = bench.open(&[kernels::PASSES], vec![state(buffers::ANSWERS, bytes.len(), Some(bytes))])?;
    let mut work = Recording::default();
    for pass in 0..passes {
        work.dispatch(kernels::PASSES, count / bench.workgroup_size(), &Batch { bounce: pass, ..launch(count) });
    }
    let words: Vec<u32> = bench.run(&mut executor, kernels::PASSES, &mut work)?;
    Ok(judge_chain(CHAIN, &words).finding("all do", Verdict::Off))
}

/// Compares the last two passes with the CPU's.
fn judge_chain((count, passes): (u32, u32), words: &[u32]) -> Faults {
    let mut faults = Faults::default();
    let mut halves: [Vec<u32>; 2] = [(0..count).collect(), Vec::new()];
    for pass in 0..passes {
        let read = &halves[pass as usize & 1];
        let made = |index: u32| {
            let word = read[((index * 5 + pass * 4099 + count / 2) & (count - 1)) as usize];
            (word ^ word >> 15).wrapping_mul(747_796_405).wrapping_add(index)
        };
        halves[(pass as usize + 1) & 1] = (0..count).into_par_iter().map(made).collect();
    }
    for (place, (found, right)) in words.iter().zip(halves.iter().flatten()).enumerate() {
        faults.see(found == right, || format!("word {place}"));
    }
    faults.cases = u64::from(count) * u64::from(passes);
    faults
}

/// Largest relative difference of the clocks in the best of several tries, since the host may be delayed.
const CLOCK_TOLERANCE: f64 = 0.05;
const TRIES: usize = 8;

fn clock(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    const INVOCATIONS: u32 = 1 << 14;
    /// Loops of more turns are cut by some drivers.
    const MOST_TURNS: u32 = 1 << 15;
    if bench.device.description().timestamp_period == 0.0 {
        return Ok(Finding::new(0, Verdict::Property, "the device has none; raywave takes the host's clock"));
    }
    let mut executor = bench.open(&[kernels::BUSY], vec![state(buffers::ANSWERS, 4 * INVOCATIONS as usize, None)])?;
    let (mut turns, mut passes) = (4096, 1);
    let mut tries = Vec::new();
    while tries.len() < TRIES {
        let mut work = Recording::default();
        for _ in 0..passes {
            let batch = Batch { sample_count: turns, ..launch(INVOCATIONS) };
            work.dispatch(kernels::BUSY, INVOCATIONS.div_ceil(bench.workgroup_size()), &batch);
        }
        executor.forget_times();
        let start = Instant::now();
        executor.submit(&work)?;
        executor.wait()?;
        let host = start.elapsed().as_secs_f64();
        let kernels = executor.kernel_times().values().map(|time| time.seconds).sum();
        // What is shorter is mostly the host's own time. So are many short passes: recording one takes microseconds.
        if host < 0.05 && turns < MOST_TURNS {
            turns *= 2;
            continue;
        }
        if host < 0.05 && passes < 2048 {
            passes *= 2;
            continue;
        }
        tries.push(Times { host, device: executor.device_seconds(), kernels });
        if tries.last().is_some_and(Times::agree) {
            break;
        }
    }
    Ok(judge_clock(&tries))
}

/// Seconds of one submission.
#[derive(Debug, Clone, Copy)]
struct Times {
    /// On the host's clock, around it.
    host: f64,
    /// On the device's, from start to end.
    device: f64,
    /// On the device's, the sum over its passes.
    kernels: f64,
}

impl Times {
    fn agree(&self) -> bool {
        (self.device / self.host - 1.0).abs() <= CLOCK_TOLERANCE && self.run_forward()
    }

    /// A step back would read as many years.
    fn run_forward(&self) -> bool {
        self.kernels > 0.0 && self.kernels <= 1.001 * self.device && self.device <= 1.01 * self.host
    }
}

fn judge_clock(tries: &[Times]) -> Finding {
    let off = |times: &Times| (times.device / times.host - 1.0).abs();
    let best = tries.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
    let Some(best) = best else { return Finding::new(0, Verdict::Off, "nothing was timed") };
    let apart = 100.0 * off(best);
    let cases = tries.len() as u64;
    let finding = if let Some(back) = tries.iter().find(|times| !times.run_forward()) {
        let Times { host, device, kernels } = back;
        let found = format!("{host:.3} s of the host are {device:.3} s of the device and {kernels:.3} s of its passes");
        Finding::new(cases, Verdict::Off, found)
    } else if best.agree() {
        Finding::ok(cases, format!("they are {apart:.2} % apart over {:.0} ms", 1e3 * best.host))
    } else {
        let found = format!("they are {apart:.1} % apart at least, over {:.0} ms", 1e3 * best.host);
        Finding::new(cases, Verdict::Off, found)
    };
    finding.with("device_seconds", best.device).with("host_seconds", best.host)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_launch_of_another_size_is_found() {
        let right = SIZES.map(|size| [64 * size, size, size, 0]);
        assert_eq!(judge_indirect(&SIZES, 64, &right).wrong, 0);
        for place in 0..3 {
            let mut wrong = right;
            wrong[4][place] += 1;
            assert_eq!(judge_indirect(&SIZES, 64, &wrong).wrong, 1);
        }
    }

    #[test]
    fn loops_that_are_cut_are_a_property_where_raywave_needs_no_more() {
        let after = |limit: u32| {
            TURNS.map(|turns| {
                let taken = turns.min(limit);
                [taken, (0..taken).fold(turns, |w, turn| (w ^ w >> 15).wrapping_mul(747_796_405).wrapping_add(turn))]
            })
        };
        assert_eq!(judge_loops(&after(u32::MAX)).verdict, Verdict::Ok);
        let cut = judge_loops(&after(65_534));
        assert_eq!((cut.verdict, &cut.numbers["limit_turns"]), (Verdict::Property, &65_534.into()));
        assert_eq!(judge_loops(&after(65_533)).verdict, Verdict::Off);
        let mut wrong = after(u32::MAX);
        wrong[3][1] ^= 1;
        assert_eq!(judge_loops(&wrong).verdict, Verdict::Off);
    }

    #[test]
    fn a_word_that_was_read_too_early_is_found() {
        let small = (1 << 10, 4);
        let mut halves: [Vec<u32>; 2] = [(0..small.0).collect(), vec![0; small.0 as usize]];
        for pass in 0..small.1 {
            let [even, odd] = &mut halves;
            let (read, written) = if pass & 1 == 0 { (even, odd) } else { (odd, even) };
            for index in 0..small.0 {
                let from = (index * 5 + pass * 4099 + small.0 / 2) & (small.0 - 1);
                let word = read[from as usize];
                written[index as usize] = (word ^ word >> 15).wrapping_mul(747_796_405).wrapping_add(index);
            }
        }
        let mut words = halves.concat();
        assert_eq!(judge_chain(small, &words).wrong, 0);
        words[77] ^= 1;
        assert_eq!(judge_chain(small, &words).wrong, 1);
    }

    #[test]
    fn clocks_that_disagree_or_step_back_are_found() {
        let good = Times { host: 0.1, device: 0.099, kernels: 0.098 };
        let late = Times { host: 0.2, ..good };
        assert_eq!(judge_clock(&[late, good]).verdict, Verdict::Ok);
        assert_eq!(judge_clock(&[late, late]).verdict, Verdict::Off);
        for wrong in [
            Times { device: 0.2, ..good },
            Times { device: 1.8e10, ..good },
            Times { kernels: 0.2, ..good },
            Times { kernels: 0.0, ..good },
        ] {
            assert_eq!(judge_clock(&[wrong, good]).verdict, Verdict::Off, "{wrong:?}");
        }
        assert_eq!(judge_clock(&[]).verdict, Verdict::Off);
    }
}
