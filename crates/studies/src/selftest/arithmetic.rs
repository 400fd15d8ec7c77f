//! Sums, products and their rounding, and the arithmetic of integers.

use super::bench::{Bench, kernels};
use super::cases::{operands, pairs, same};
use super::{Check, Faults, Finding, Verdict};
use raywave::render::RenderError;

pub const CHECKS: &[Check] = &[
    Check {
        name: "add",
        checked: "sums and differences are the nearest number, ties to even",
        spoils: "every image differs from that of another device, and bounds of rounding errors do not hold",
        run: |bench| {
            let (cases, answers) = calculate(bench)?;
            let mut faults = judge(&cases, &answers, SUM, |[a, b, _]| settled([a, b], a + b));
            faults.join(judge(&cases, &answers, DIFFERENCE, |[a, b, _]| settled([a, b], a - b)));
            Ok(faults.finding("all are", Verdict::Off))
        },
    },
    Check {
        name: "multiply",
        checked: "products are the nearest number, ties to even",
        spoils: "every image differs from that of another device, and bounds of rounding errors do not hold",
        run: |bench| {
            let (cases, answers) = calculate(bench)?;
            let faults = judge(&cases, &answers, PRODUCT, |[a, b, _]| settled([a, b], a * b));
            Ok(faults.finding("all are", Verdict::Off))
        },
    },
    Check {
        name: "contraction",
        checked: "a product and a sum that may not be fused are rounded twice",
        spoils: "schedulers give different images, and rays slip through the edges of triangles",
        run: |bench| {
            let (cases, answers) = calculate(bench)?;
            let faults = judge(&cases, &answers, TWO_ROUNDINGS, |[a, b, c]| {
                settled([a, b], a * b)?;
                settled([a * b, c], a * b + c)
            });
            Ok(faults.finding("all are", Verdict::Off))
        },
    },
    Check {
        name: "fma",
        checked: "fma rounds once",
        spoils: "",
        run: |bench| {
            let (cases, answers) = calculate(bench)?;
            Ok(judge_fma(&cases, &answers))
        },
    },
    Check {
        name: "denormals",
        checked: "sums and products take and give denormals",
        spoils: "",
        run: |bench| {
            let (cases, answers) = calculate(bench)?;
            Ok(judge_denormals(&cases, &answers))
        },
    },
    Check {
        name: "integers",
        checked: "products, carries, shifts and the bits of 32-bit integers",
        spoils: "random numbers and traversal",
        run: |bench| {
            let cases = pairs();
            Ok(judge_integers(&cases, &bench.ask(kernels::INTEGERS, 0, &cases)?).finding("all are right", Verdict::Off))
        },
    },
];

/// Answers of the kernel `arithmetic`: bits of results.
pub type Results = [u32; 8];
const SUM: usize = 0;
const DIFFERENCE: usize = 1;
const PRODUCT: usize = 2;
/// Index of a / b.
pub const QUOTIENT: usize = 3;
/// Index of 1 / a.
pub const RECIPROCAL: usize = 4;
/// Index of the root of a.
pub const ROOT: usize = 5;
const TWO_ROUNDINGS: usize = 6;
const FMA: usize = 7;

/// All operations on all operands.
pub fn calculate(bench: &Bench<'_>) -> Result<(Vec<[f32; 3]>, Vec<Results>), RenderError> {
    let cases = operands();
    let bits: Vec<[u32; 4]> = cases.iter().map(|[a, b, c]| [a.to_bits(), b.to_bits(), c.to_bits(), 0]).collect();
    let answers = bench.ask(kernels::ARITHMETIC, 0, &bits)?;
    Ok((cases, answers))
}

/// The result, if it depends on no rule for denormals.
pub fn settled(operands: [f32; 2], result: f32) -> Option<f32> {
    // A result that rounds up to the smallest normal number may be flushed before it is rounded.
    let is_small = result.is_subnormal() || result.abs() == f32::MIN_POSITIVE;
    (!operands.iter().any(|x| x.is_subnormal()) && !is_small).then_some(result)
}

/// Compares the results at one index with the right ones, where these are defined.
pub fn judge(cases: &[[f32; 3]], answers: &[Results], place: usize, right: impl Fn([f32; 3]) -> Option<f32>) -> Faults {
    let mut faults = Faults::default();
    for (case, answer) in cases.iter().zip(answers) {
        if let Some(right) = right(*case) {
            let found = answer[place];
            faults.see(same(found, right), || format!("of {case:?}: {:e} for {right:e}", f32::from_bits(found)));
        }
    }
    faults
}

/// Distinguishes a fused product and sum from two roundings by the cases where they differ.
fn judge_fma(cases: &[[f32; 3]], answers: &[Results]) -> Finding {
    // Leaves out products so small that their low half is a denormal.
    let is_settled = |[a, b, c]: [f32; 3]| {
        let product = f64::from(a) * f64::from(b);
        (product == 0.0 || product.abs() > 1e-30) && settled([a, b], a * b).is_some() && !c.is_subnormal()
    };
    let (mut all, mut telling, mut fused, mut rounded_twice) = (0, 0, 0, 0);
    for (case, answer) in cases.iter().zip(answers).filter(|(case, _)| is_settled(**case)) {
        let [a, b, c] = *case;
        let (once, twice) = (a.mul_add(b, c), a * b + c);
        all += 1;
        fused += u64::from(same(answer[FMA], once));
        rounded_twice += u64::from(same(answer[FMA], twice));
        telling += u64::from(!same(once.to_bits(), twice));
    }
    let finding = match all {
        all if fused == all => Finding::ok(all, "it does"),
        all if rounded_twice == all => {
            Finding::new(all, Verdict::Property, "it does not: the product is rounded, then the sum")
        }
        all => Finding::new(all, Verdict::Property, "it is neither one rounding nor two; raywave does without it"),
    };
    finding.with("telling", telling).with("rounded_once", fused).with("rounded_twice", rounded_twice)
}

/// How a device may treat denormals: whether it flushes operands, and results.
const RULES: [([bool; 2], &str); 4] = [
    ([false, false], "all are kept"),
    ([true, true], "operands and results are flushed to zero"),
    ([true, false], "operands are flushed to zero, results kept"),
    ([false, true], "results are flushed to zero, operands kept"),
];

/// Finds the rule that explains all sums and products that depend on it.
fn judge_denormals(cases: &[[f32; 3]], answers: &[Results]) -> Finding {
    let flush = |x: f32| if x.is_subnormal() { 0.0 } else { x };
    let of = |place, a: f32, b: f32| match place {
        SUM => a + b,
        DIFFERENCE => a - b,
        _ => a * b,
    };
    let mut all = 0;
    let mut broken = [0_u64; RULES.len()];
    for (&[a, b, _], answer) in cases.iter().zip(answers) {
        for place in [SUM, DIFFERENCE, PRODUCT] {
            let found = f32::from_bits(answer[place]);
            if settled([a, b], of(place, a, b)).is_some() {
                continue;
            }
            all += 1;
            for (([operands, results], _), broken) in RULES.iter().zip(&mut broken) {
                let right = if *operands { of(place, flush(a), flush(b)) } else { of(place, a, b) };
                // The sign of a flushed number is not defined, nor whether it is flushed before it is rounded.
                let is_small = right.is_subnormal() || right.abs() == f32::MIN_POSITIVE;
                let flushed = *results && is_small && found == 0.0;
                let kept = !(*results && right.is_subnormal()) && (found == right || found.is_nan() && right.is_nan());
                *broken += u64::from(!flushed && !kept);
            }
        }
    }
    let rule = RULES.iter().zip(broken).find(|(_, broken)| *broken == 0);
    match rule {
        Some((([false, false], name), _)) => Finding::ok(all, *name),
        Some(((_, name), _)) => Finding::new(all, Verdict::Property, *name),
        None => Finding::new(all, Verdict::Property, "some are flushed to zero, some kept"),
    }
    .with("not_kept", broken[0])
}

/// Compares integers with the CPU's.
fn judge_integers(cases: &[[u32; 2]], answers: &[[u32; 8]]) -> Faults {
    let mut faults = Faults::default();
    for ([a, b], answer) in cases.iter().zip(answers) {
        let bit = |at: Option<u32>| at.unwrap_or(u32::MAX);
        let right = [
            a.wrapping_mul(*b),
            u32::from(a.checked_add(*b).is_none()),
            a << (b & 31),
            (*a as i32 >> (b & 31)) as u32,
            a.reverse_bits(),
            bit(a.checked_ilog2()),
            bit((*a != 0).then(|| a.trailing_zeros())),
            a.count_ones(),
        ];
        faults.see(*answer == right, || format!("of {a:#x} and {b:#x}: {answer:x?} for {right:x?}"));
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Answers of a device that rounds as the CPU does, with that fma.
    fn answers(cases: &[[f32; 3]], fma: fn(f32, f32, f32) -> f32) -> Vec<Results> {
        let all = cases.iter().map(|&[a, b, c]| {
            [a + b, a - b, a * b, a / b, 1.0 / a, a.sqrt(), a * b + c, fma(a, b, c)].map(f32::to_bits)
        });
        all.collect()
    }

    #[test]
    fn one_unit_of_one_sum_is_found() {
        let cases = operands();
        let mut answers = answers(&cases, f32::mul_add);
        let sums = |answers: &[Results]| judge(&cases, answers, SUM, |[a, b, _]| settled([a, b], a + b));
        assert_eq!(sums(&answers).wrong, 0);
        assert!(sums(&answers).cases > 200_000);
        let last = cases.len() - 1;
        answers[last][SUM] ^= 1;
        let faults = sums(&answers);
        assert_eq!(faults.wrong, 1);
        assert!(faults.example.starts_with(&format!("of {:?}", cases[last])), "{}", faults.example);
        assert_eq!(faults.finding("", Verdict::Off).verdict, Verdict::Off);
    }

    #[test]
    fn fma_is_told_by_its_roundings() {
        let cases = operands();
        let fused = answers(&cases, f32::mul_add);
        assert_eq!(judge_fma(&cases, &fused).verdict, Verdict::Ok);
        let twice = answers(&cases, |a, b, c| a * b + c);
        let finding = judge_fma(&cases, &twice);
        assert_eq!(finding.verdict, Verdict::Property);
        assert!(finding.found.contains("the product is rounded"), "{}", finding.found);
        assert!(finding.numbers["telling"].as_u64().is_some_and(|telling| telling > 5_000));
        let mut mixed = twice;
        mixed.iter_mut().zip(&fused).step_by(2).for_each(|(answer, fused)| *answer = *fused);
        assert!(judge_fma(&cases, &mixed).found.contains("neither"));
    }

    #[test]
    fn rules_for_denormals_are_told_apart() {
        let cases = operands();
        let flush = |x: f32| if x.is_subnormal() { 0.0_f32.copysign(x) } else { x };
        for ([operands, results], name) in RULES {
            let before = |x: f32| if operands { flush(x) } else { x };
            let after = |x: f32| if results { flush(x) } else { x };
            let flushed: Vec<_> = cases.iter().map(|case| case.map(before)).collect();
            let mut answers = answers(&flushed, f32::mul_add);
            answers.iter_mut().flatten().for_each(|bits| *bits = after(f32::from_bits(*bits)).to_bits());
            let finding = judge_denormals(&cases, &answers);
            assert_eq!(finding.found, name);
            assert_eq!(finding.verdict == Verdict::Ok, name == RULES[0].1);
            assert!(finding.cases > 1000);
        }
    }

    #[test]
    fn one_wrong_bit_of_an_integer_is_found() {
        let cases = [[0x8000_0001, 3], [0, 0], [u32::MAX, 1]];
        let right = [
            [0x8000_0003, 0, 8, 0xf000_0000, 0x8000_0001, 31, 0, 2],
            [0, 0, 0, 0, 0, u32::MAX, u32::MAX, 0],
            [u32::MAX, 1, 0xffff_fffe, u32::MAX, u32::MAX, 31, 0, 32],
        ];
        assert_eq!(judge_integers(&cases, &right), Faults { cases: 3, ..Faults::default() });
        for place in 0..8 {
            let mut wrong = right;
            wrong[2][place] ^= 1;
            assert_eq!(judge_integers(&cases, &wrong).wrong, 1);
        }
    }
}
