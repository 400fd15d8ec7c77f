//! Conversions between integers, floats and halves.

use std::collections::BTreeSet;

use half::f16;

use super::bench::kernels;
use super::cases::words;
use super::{Check, Faults, Finding, Verdict};

pub const CHECKS: &[Check] = &[
    Check {
        name: "conversions",
        checked: "integers as floats, floats as integers, and floors",
        spoils: "random numbers, and every index that is made of one",
        run: |bench| {
            let cases = words();
            Ok(judge_integers(&cases, &bench.ask(kernels::CONVERSIONS, 0, &cases)?))
        },
    },
    Check {
        name: "halves",
        checked: "every half as a float, and floats as halves",
        spoils: "textures, and paths in flight of --path-state f16",
        run: |bench| {
            let cases = words();
            Ok(judge_halves(&cases, &bench.ask(kernels::CONVERSIONS, 0, &cases)?))
        },
    },
];

/// Answers of the kernel `conversions` for a word.
type Answer = [u32; 8];
const OF_UNSIGNED: usize = 0;
const OF_SIGNED: usize = 1;
const FLOOR: usize = 2;
const OF_HALF: usize = 3;
const TO_UNSIGNED: usize = 4;
const TO_SIGNED: usize = 5;
const TO_HALVES: [usize; 2] = [6, 7];

fn judge_integers(cases: &[u32], answers: &[Answer]) -> Finding {
    let mut faults = Faults::default();
    // If an integer has more bits than a float, the rounding is not defined.
    let mut rounded = Faults::default();
    for (&word, answer) in cases.iter().zip(answers) {
        let number = f32::from_bits(word);
        let floats =
            [(OF_UNSIGNED, f64::from(word), word as f32), (OF_SIGNED, f64::from(word as i32), word as i32 as f32)];
        for (place, exact, nearest) in floats {
            let found = f32::from_bits(answer[place]);
            let tell = || format!("{exact} becomes {found}");
            if f64::from(nearest) == exact {
                faults.see(found == nearest, tell);
            } else {
                let is_neighbour = [nearest, nearest.next_down(), nearest.next_up()].contains(&found);
                faults.see(is_neighbour && (f64::from(found) - exact).abs() < 257.0, tell);
                rounded.see(found == nearest, tell);
            }
        }
        if number.is_finite() && !number.is_subnormal() {
            let found = f32::from_bits(answer[FLOOR]);
            faults.see(found == number.floor(), || format!("the floor of {number:e} becomes {found}"));
        }
        // Out of range, Vulkan promises nothing.
        if (0.0..4_294_967_296.0).contains(&number) {
            let found = answer[TO_UNSIGNED];
            faults.see(found == number as u32, || format!("{number:e} becomes {found}"));
        }
        if (-2_147_483_648.0..2_147_483_648.0).contains(&number) {
            let found = answer[TO_SIGNED] as i32;
            faults.see(found == number as i32, || format!("{number:e} becomes {found}"));
        }
    }
    let cut = rounded.wrong;
    match (faults.wrong, cut) {
        (0, 1..) => {
            Finding::new(faults.cases, Verdict::Property, "all are right, long integers not to the nearest float")
        }
        _ => faults.finding("all are right, long integers to the nearest float", Verdict::Off),
    }
    .with("not_to_nearest", cut)
}

/// How a float that is not a half may be rounded to one.
#[derive(Default)]
struct Rounding {
    cases: u64,
    nearest: u64,
    towards_zero: u64,
}

impl Rounding {
    fn see(&mut self, found: f16, number: f32) {
        let nearest = f16::from_f32(number);
        let is_beyond = nearest.to_f32().abs() > number.abs();
        let towards_zero = if is_beyond { f16::from_bits(nearest.to_bits() - 1) } else { nearest };
        self.cases += 1;
        self.nearest += u64::from(found.to_bits() == nearest.to_bits());
        self.towards_zero += u64::from(found.to_bits() == towards_zero.to_bits());
    }

    fn name(&self) -> &'static str {
        match self.cases {
            all if self.nearest == all => "to the nearest",
            all if self.towards_zero == all => "towards zero",
            _ => "one way or the other",
        }
    }
}

fn judge_halves(cases: &[u32], answers: &[Answer]) -> Finding {
    let mut faults = Faults::default();
    let (mut normal, mut small) = (Rounding::default(), Rounding::default());
    let mut beyond = BTreeSet::new();
    for (&word, answer) in cases.iter().zip(answers) {
        let half = f16::from_bits(word as u16);
        let found = f32::from_bits(answer[OF_HALF]);
        let right = half.to_f32();
        let is_same = found.to_bits() == right.to_bits() || (found.is_nan() && right.is_nan());
        faults.see(is_same, || format!("the half {:#06x} becomes {found:e} for {right:e}", half.to_bits()));

        let number = f32::from_bits(word);
        // Denormal floats are far below the smallest half: flushed or not, they become zero.
        for found in TO_HALVES.map(|place| f16::from_bits(answer[place] as u16)) {
            let nearest = f16::from_f32(number);
            let bits = (found.to_bits(), nearest.to_bits());
            let tell = || format!("{number:e} becomes the half {found:e}");
            if number.is_nan() {
                faults.see(found.is_nan(), tell);
            } else if number.abs() > f16::MAX.to_f32() {
                // An infinity must not become finite, since then nothing would detect it.
                faults.see(number.is_finite() || !found.is_finite(), tell);
                if bits.0 != bits.1 {
                    beyond.insert(match found.to_f32() {
                        found if found.is_nan() => "NaN",
                        found if found.is_infinite() => "infinity",
                        _ => "the largest half or less",
                    });
                }
            } else if nearest.to_f32() == number && !number.is_subnormal() {
                faults.see(bits.0 == bits.1, tell);
            } else {
                // Halves of one sign are ordered like their bits.
                faults.see(bits.0.abs_diff(bits.1) <= 1, tell);
                if number.abs() >= f16::MIN_POSITIVE.to_f32() {
                    normal.see(found, number);
                } else if !number.is_subnormal() {
                    small.see(found, number);
                }
            }
        }
    }
    let has_own_way = !beyond.is_empty();
    let beyond: Vec<&str> = if has_own_way { beyond.into_iter().collect() } else { vec!["infinity"] };
    let found = format!(
        "all are right; what is no half is rounded {}, below 2^-14 {}; beyond the largest it becomes {}",
        normal.name(),
        small.name(),
        beyond.join(" or "),
    );
    // raywave rounds numbers before they are converted, and clamps those above the largest half.
    let is_nearest = [&normal, &small].iter().all(|rounding| rounding.nearest == rounding.cases);
    match faults.wrong {
        0 if !is_nearest || has_own_way => Finding::new(faults.cases, Verdict::Property, found),
        _ => faults.finding(&found, Verdict::Off),
    }
    .with("not_to_nearest", normal.cases + small.cases - normal.nearest - small.nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answers(cases: &[u32], to_half: fn(f32) -> f16) -> Vec<Answer> {
        let answer = |&word: &u32| {
            let number = f32::from_bits(word);
            let half = u32::from(to_half(number).to_bits());
            let floats = [word as f32, word as i32 as f32, number.floor(), f16::from_bits(word as u16).to_f32()];
            let [a, b, c, d] = floats.map(f32::to_bits);
            [a, b, c, d, number as u32, number as i32 as u32, half, half]
        };
        cases.iter().map(answer).collect()
    }

    fn towards_zero(number: f32) -> f16 {
        let nearest = f16::from_f32(number);
        if nearest.to_f32().abs() > number.abs() { f16::from_bits(nearest.to_bits() - 1) } else { nearest }
    }

    #[test]
    fn right_conversions_pass_and_wrong_ones_do_not() {
        let cases = words();
        let right = answers(&cases, f16::from_f32);
        for judge in [judge_integers, judge_halves] {
            let finding = judge(&cases, &right);
            assert_eq!(finding.verdict, Verdict::Ok, "{}", finding.found);
        }
        // A number that all conversions affect.
        let at = cases.iter().rposition(|word| (1.0..60_000.0).contains(&f32::from_bits(*word))).expect("there is one");
        for place in 0..8 {
            let mut wrong = right.clone();
            wrong[at][place] ^= 2;
            let judge = if [OF_HALF, 6, 7].contains(&place) { judge_halves } else { judge_integers };
            let finding = judge(&cases, &wrong);
            assert_eq!(finding.verdict, Verdict::Off, "place {place}");
            assert_eq!(finding.numbers["wrong"], 1, "place {place}: {}", finding.found);
        }
    }

    #[test]
    fn the_rounding_of_halves_is_told() {
        let cases = words();
        let finding = judge_halves(&cases, &answers(&cases, towards_zero));
        assert_eq!(finding.verdict, Verdict::Property);
        assert!(finding.found.contains("rounded towards zero, below 2^-14 towards zero"), "{}", finding.found);
        assert!(finding.found.ends_with("it becomes the largest half or less"), "{}", finding.found);
    }

    #[test]
    fn long_integers_may_be_cut() {
        let cases = words();
        let mut cut = answers(&cases, f16::from_f32);
        for (word, answer) in cases.iter().zip(&mut cut) {
            let nearest = *word as f32;
            if f64::from(nearest) > f64::from(*word) {
                answer[OF_UNSIGNED] = nearest.next_down().to_bits();
            }
        }
        let finding = judge_integers(&cases, &cut);
        assert_eq!(finding.verdict, Verdict::Property, "{}", finding.found);
    }
}
