//! Whether quotients, reciprocals and roots are the nearest numbers.
//!
//! Vulkan allows a quotient an error of 2.5 units in the last place (ulp), and raywave corrects quotients that are not
//! exact. Every significand is tried, and 10^8 pairs for quotients: kernels compute them, compare the results with
//! integer remainders, and count.

use bytemuck::{Pod, Zeroable};

use super::arithmetic::{QUOTIENT, RECIPROCAL, ROOT, Results, calculate, judge, settled};
use super::bench::{Bench, kernels, launch};
use super::{Check, Faults, Finding, Verdict};
use raywave::layout::Batch;
use raywave::render::RenderError;
use raywave::shaders::Kernel;

/// Cases per invocation.
const RUN: u32 = 1024;
/// Quotients that are tried.
const QUOTIENTS: u32 = 100_000_000;
const SPOILS: &str = "Vulkan allows 2.5 units, and raywave corrects no more: images are wrong";

pub const CHECKS: &[Check] = &[
    Check {
        name: "divide",
        checked: "quotients of random pairs and of edges are the nearest number",
        spoils: SPOILS,
        run: |bench| {
            exactness(
                bench,
                &Operation { kernel: kernels::QUOTIENTS, cases: QUOTIENTS, place: QUOTIENT, of: |a, b| a / b },
            )
        },
    },
    Check {
        name: "reciprocal",
        checked: "reciprocals of every significand and of edges are the nearest number",
        spoils: SPOILS,
        run: |bench| {
            exactness(
                bench,
                &Operation { kernel: kernels::RECIPROCALS, cases: 1 << 23, place: RECIPROCAL, of: |a, _| 1.0 / a },
            )
        },
    },
    Check {
        name: "root",
        checked: "roots of every significand and of edges are the nearest number",
        spoils: "raywave corrects no more than 2.5 units: images are wrong",
        run: |bench| {
            exactness(bench, &Operation { kernel: kernels::ROOTS, cases: 1 << 24, place: ROOT, of: |a, _| a.sqrt() })
        },
    },
];

/// An operation whose rounding Vulkan leaves to the device.
struct Operation {
    /// The kernel that counts.
    kernel: &'static Kernel,
    /// How many cases it tries.
    cases: u32,
    /// Index of its answer in the kernel `arithmetic`.
    place: usize,
    of: fn(f32, f32) -> f32,
}

/// Counts of the kernels; see `tally.glsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
struct Tally {
    wrong: u32,
    beyond_one: u32,
    beyond_two: u32,
    example: u32,
}

fn exactness(bench: &Bench<'_>, operation: &Operation) -> Result<Finding, RenderError> {
    let invocations = bench.part_of(operation.cases).div_ceil(RUN);
    let batch = Batch { sample_count: RUN, ..launch(invocations) };
    let tally: Vec<Tally> = bench.launch(operation.kernel, size_of::<Tally>(), batch)?;
    let (cases, answers) = calculate(bench)?;
    Ok(Edges::of(operation, &cases, &answers).finding(u64::from(invocations * RUN), tally[0]))
}

/// Results that the CPU computes too.
struct Edges {
    /// Of numbers.
    plain: Faults,
    /// Of zeros, infinities and NaN.
    special: Faults,
    /// From or to denormals.
    denormal: Faults,
}

impl Edges {
    fn of(operation: &Operation, cases: &[[f32; 3]], answers: &[Results]) -> Self {
        let is_binary = operation.place == QUOTIENT;
        // A reciprocal has one operand.
        let pair = |[a, b, _]: [f32; 3]| if is_binary { [a, b] } else { [a, 1.0] };
        let of = |case| (operation.of)(pair(case)[0], pair(case)[1]);
        let is_special = |case| of(case).is_nan() || pair(case).iter().any(|x| *x == 0.0 || !x.is_finite());
        let settled = |case| settled(pair(case), of(case));
        let among = |right: &dyn Fn([f32; 3]) -> Option<f32>| judge(cases, answers, operation.place, right);
        Self {
            plain: among(&|case| settled(case).filter(|_| !is_special(case))),
            special: among(&|case| settled(case).filter(|_| is_special(case))),
            denormal: among(&|case| settled(case).is_none().then(|| of(case))),
        }
    }

    fn finding(self, counted: u64, tally: Tally) -> Finding {
        let Self { plain, special, denormal } = self;
        let cases = counted + plain.cases + special.cases + denormal.cases;
        let wrong = u64::from(tally.wrong) + plain.wrong;
        let special_wrong = special.wrong;
        let finding = if special_wrong > 0 {
            special.finding("", Verdict::Off)
        } else if tally.beyond_two > 0 {
            let found = format!("{} are off by more than 2.5 units of the last place", tally.beyond_two);
            Finding::new(cases, Verdict::Off, format!("{found}, as case {}", !tally.example))
        } else if wrong > 0 {
            let worst = if tally.beyond_one > 0 { "two units" } else { "a unit" };
            let share = 100.0 * f64::from(tally.wrong) / counted as f64;
            let found = format!("{share:.3} % are off, by {worst} of the last place at most; of edges {}", plain.wrong);
            Finding::new(cases, Verdict::Property, format!("{found}; raywave corrects them"))
        } else if denormal.wrong > 0 {
            Finding::new(cases, Verdict::Property, "all are but for denormals")
        } else {
            Finding::ok(cases, "all are")
        };
        finding
            .with("counted", counted)
            .with("wrong", tally.wrong)
            .with("beyond_1_5_ulp", tally.beyond_one)
            .with("beyond_2_5_ulp", tally.beyond_two)
            .with("edges_wrong", plain.wrong)
            .with("special_wrong", special_wrong)
            .with("denormal_wrong", denormal.wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::selftest::cases::operands;

    const DIVIDE: Operation = Operation { kernel: kernels::QUOTIENTS, cases: 100, place: QUOTIENT, of: |a, b| a / b };

    fn quotients(divide: fn(f32, f32) -> f32) -> (Vec<[f32; 3]>, Vec<Results>) {
        let cases = operands();
        let answers = cases.iter().map(|[a, b, _]| [divide(*a, *b).to_bits(); 8]).collect();
        (cases, answers)
    }

    fn judged(divide: fn(f32, f32) -> f32, tally: Tally) -> Finding {
        let (cases, answers) = quotients(divide);
        Edges::of(&DIVIDE, &cases, &answers).finding(100, tally)
    }

    #[test]
    fn exact_division_is_told_from_others() {
        assert_eq!(judged(|a, b| a / b, Tally::default()).verdict, Verdict::Ok);
        let by_reciprocal = judged(|a, b| a * (1.0 / b), Tally { wrong: 27, ..Tally::default() });
        assert_eq!(by_reciprocal.verdict, Verdict::Property, "{}", by_reciprocal.found);
        let a_unit_off = |a: f32, b: f32| {
            let right = a / b;
            if right.is_normal() && a != b && a != 0.0 { f32::from_bits(right.to_bits() ^ 1) } else { right }
        };
        let finding = judged(a_unit_off, Tally { wrong: 27, ..Tally::default() });
        assert_eq!(finding.verdict, Verdict::Property, "{}", finding.found);
        assert!(finding.found.starts_with("27.000 % are off, by a unit"), "{}", finding.found);
        let far = judged(|a, b| a / b, Tally { wrong: 1, beyond_one: 1, beyond_two: 1, example: !7 });
        assert_eq!(far.verdict, Verdict::Off);
        assert!(far.found.ends_with("as case 7"), "{}", far.found);
        let nothing_by_zero = judged(|a, b| if b == 0.0 { 0.0 } else { a / b }, Tally::default());
        assert_eq!(nothing_by_zero.verdict, Verdict::Off);
        let flushed = judged(|a, b| if (a / b).is_subnormal() { 0.0 } else { a / b }, Tally::default());
        assert_eq!((flushed.verdict, flushed.found.as_str()), (Verdict::Property, "all are but for denormals"));
    }
}
