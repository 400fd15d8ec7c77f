//! NaN, infinities and zeros of both signs.

use super::bench::kernels;
use super::cases::pairs;
use super::{Check, Faults, Finding, Verdict};

pub const CHECKS: &[Check] = &[
    Check {
        name: "nan-and-zeros",
        checked: "comparisons, isnan, isinf, signs, and zeros of both signs",
        spoils: "samples that are NaN are not found, and degenerate triangles are hit",
        run: |bench| {
            let cases = pairs();
            Ok(judge(&cases, &bench.ask(kernels::SPECIALS, 0, &cases)?))
        },
    },
    Check {
        name: "min-max",
        checked: "min and max of numbers",
        spoils: "bounding boxes are missed, and paths with them",
        run: |bench| {
            let cases = pairs();
            Ok(judge_min_max(&cases, &bench.ask(kernels::SPECIALS, 0, &cases)?))
        },
    },
];

/// Answers of the kernel `specials`: relations, min, max, the larger by a comparison; -a, |a|, a b, and a.
type Answer = [u32; 8];
const RELATIONS: usize = 0;
const MIN: usize = 1;
const MAX: usize = 2;
const LARGER: usize = 3;
const NEGATED: usize = 4;
const ABSOLUTE: usize = 5;
const PRODUCT: usize = 6;
const LOADED: usize = 7;

/// Relations, in the kernel's order of bits.
fn relations(a: f32, b: f32) -> u32 {
    [a < b, a <= b, a > b, a >= b, a == b, a != b, a.is_nan(), a.is_infinite()]
        .iter()
        .zip(0..)
        .fold(0, |bits, (holds, place)| bits | u32::from(*holds) << place)
}

fn judge(cases: &[[u32; 2]], answers: &[Answer]) -> Finding {
    let mut faults = Faults::default();
    let mut flushed = 0_u64;
    for (&[a_bits, b_bits], answer) in cases.iter().zip(answers) {
        let (a, b) = (f32::from_bits(a_bits), f32::from_bits(b_bits));
        let tell = |what: &str| format!("{what} of {a:e} and {b:e}: {answer:x?}");
        // Comparisons may treat denormals as zeros.
        let flush = |x: f32| if x.is_subnormal() { 0.0 } else { x };
        let holds = answer[RELATIONS] == relations(a, b);
        let holds_flushed = answer[RELATIONS] == relations(flush(a), flush(b));
        faults.see(holds || holds_flushed, || tell("relations"));
        flushed += u64::from(!holds);
        // Neither NaN nor a denormal is sure to keep its bits.
        if !a.is_nan() && !a.is_subnormal() {
            faults.see(answer[NEGATED] == a_bits ^ 0x8000_0000, || tell("the negative"));
            faults.see(answer[ABSOLUTE] == a_bits & 0x7fff_ffff, || tell("the absolute value"));
        }
        if (a == 0.0 || b == 0.0) && a.is_finite() && b.is_finite() && !a.is_subnormal() && !b.is_subnormal() {
            faults.see(answer[PRODUCT] == (a * b).to_bits(), || tell("the product"));
        }
        if !a.is_subnormal() && !b.is_subnormal() {
            let larger = if a > b { a_bits } else { b_bits };
            let is_nan = f32::from_bits(larger).is_nan() && f32::from_bits(answer[LARGER]).is_nan();
            faults.see(answer[LARGER] == larger || is_nan, || tell("the larger"));
        }
        faults.see(answer[LOADED] == a_bits, || tell("the bits"));
    }
    let all = match flushed {
        0 => "all as on the CPU",
        _ => "all as on the CPU, but that comparisons take denormals for zeros",
    };
    let verdict = if faults.wrong == 0 && flushed > 0 { Verdict::Property } else { Verdict::Off };
    match (faults.wrong, flushed) {
        (0, 1..) => Finding::new(faults.cases, verdict, all),
        _ => faults.finding(all, verdict),
    }
    .with("comparisons_flushed", flushed)
}

/// What min and max return for a number and NaN, or for two zeros.
#[derive(Default)]
struct Choice {
    /// The number, or the smaller zero of min and the larger of max.
    first: bool,
    /// The other.
    second: bool,
}

impl Choice {
    fn see(&mut self, first: bool) {
        self.first |= first;
        self.second |= !first;
    }

    fn name(&self, first: &'static str, second: &'static str) -> &'static str {
        match (self.first, self.second) {
            (true, false) => first,
            (false, true) => second,
            _ => "either",
        }
    }
}

fn judge_min_max(cases: &[[u32; 2]], answers: &[Answer]) -> Finding {
    let mut faults = Faults::default();
    let (mut with_nan, mut with_zeros) = (Choice::default(), Choice::default());
    for (&[a_bits, b_bits], answer) in cases.iter().zip(answers) {
        let (a, b) = (f32::from_bits(a_bits), f32::from_bits(b_bits));
        if a.is_subnormal() || b.is_subnormal() {
            continue;
        }
        for (found, right) in [(answer[MIN], if b < a { b } else { a }), (answer[MAX], if a < b { b } else { a })] {
            let number = f32::from_bits(found);
            let is_one = found == a_bits || found == b_bits || number.is_nan();
            if a.is_nan() && b.is_nan() {
                faults.see(number.is_nan(), || format!("{number:e} of two NaN"));
            } else if a.is_nan() || b.is_nan() {
                faults.see(is_one, || format!("{number:e} of {a:e} and {b:e}"));
                with_nan.see(!number.is_nan());
            } else {
                faults.see(is_one && number == right, || format!("{number:e} of {a:e} and {b:e}"));
            }
        }
        if a == 0.0 && b == 0.0 && a_bits != b_bits {
            with_zeros.see(answer[MIN] == 0x8000_0000);
            with_zeros.see(answer[MAX] == 0);
        }
    }
    let nan = with_nan.name("the number", "NaN");
    let zeros = with_zeros.name("the one in order", "the other");
    let found = format!("all are right; of a number and NaN they take {nan}, of zeros of both signs {zeros}");
    // Vulkan promises neither, and raywave relies on neither.
    faults.finding(&found, Verdict::Off).with("with_nan", nan).with("with_zeros", zeros)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answers(cases: &[[u32; 2]]) -> Vec<Answer> {
        let answer = |&[a_bits, b_bits]: &[u32; 2]| {
            let (a, b) = (f32::from_bits(a_bits), f32::from_bits(b_bits));
            let larger = if a > b { a } else { b };
            let of = [a.min(b), a.max(b), larger, -a, a.abs(), a * b, a].map(f32::to_bits);
            [relations(a, b), of[0], of[1], of[2], of[3], of[4], of[5], of[6]]
        };
        cases.iter().map(answer).collect()
    }

    #[test]
    fn what_the_cpu_does_passes() {
        let cases = pairs();
        let right = answers(&cases);
        assert_eq!(judge(&cases, &right).verdict, Verdict::Ok);
        let finding = judge_min_max(&cases, &right);
        assert_eq!((finding.verdict, &finding.numbers["with_nan"]), (Verdict::Ok, &"the number".into()));
    }

    #[test]
    fn every_bit_that_is_wrong_is_found() {
        let cases = [[0x8000_0000, 0x3f80_0000], [0x4000_0000, 0x3f80_0000], [0x7fc0_0000, 0x7f80_0000]];
        let right = answers(&cases);
        for place in 0..8 {
            let mut wrong = right.clone();
            wrong[1][place] ^= 1;
            let min_max = [MIN, MAX].contains(&place);
            let finding = if min_max { judge_min_max(&cases, &wrong) } else { judge(&cases, &wrong) };
            // The product is checked if there is a zero.
            assert_eq!(finding.verdict == Verdict::Off, place != PRODUCT, "place {place}");
        }
        let mut wrong = right.clone();
        wrong[0][PRODUCT] = 0;
        assert_eq!(judge(&cases, &wrong).verdict, Verdict::Off, "a zero that has lost its sign");
        let mut wrong = right;
        wrong[2][RELATIONS] ^= 1 << 6;
        assert_eq!(judge(&cases, &wrong).verdict, Verdict::Off, "NaN that is not found");
    }

    #[test]
    fn flushed_comparisons_are_a_property() {
        let cases = [[0x0000_0001, 0], [0x3f80_0000, 0]];
        let mut flushed = answers(&cases);
        flushed[0][RELATIONS] = relations(0.0, 0.0);
        let finding = judge(&cases, &flushed);
        assert_eq!((finding.verdict, &finding.numbers["comparisons_flushed"]), (Verdict::Property, &1.into()));
    }
}
