//! How far functions are from the exact ones.
//!
//! The error of a driver's own function is reported but is not a failure, since Vulkan promises little. A function of
//! raywave's has a bound.

use std::f64::consts::TAU;

use super::bench::{Bench, kernels};
use super::{Check, Finding, Verdict};
use crate::stats::SplitMix64;
use raywave::render::RenderError;
use raywave::shaders::Kernel;

pub const CHECKS: &[Check] = &[
    Check {
        name: "sin",
        checked: "the driver's sine, of 0 to 2 pi",
        spoils: "",
        run: |bench| measure(bench, &of_driver(0, |x, _| x.sin(), |u| [TAU * u[0], 0.0])),
    },
    Check {
        name: "cos",
        checked: "the driver's cosine, of 0 to 2 pi",
        spoils: "",
        run: |bench| measure(bench, &of_driver(1, |x, _| x.cos(), |u| [TAU * u[0], 0.0])),
    },
    Check {
        name: "atan",
        checked: "the driver's angle of a point in the plane",
        spoils: "",
        run: |bench| measure(bench, &of_driver(2, f64::atan2, |u| [2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0])),
    },
    Check {
        name: "exp",
        checked: "the driver's exponential, of -20 to 0",
        spoils: "",
        run: |bench| measure(bench, &of_driver(3, |x, _| x.exp(), |u| [-20.0 * u[0], 0.0])),
    },
    Check {
        name: "log",
        checked: "the driver's logarithm, of 2^-24 to 1",
        spoils: "",
        run: |bench| measure(bench, &of_driver(4, |x, _| x.ln(), |u| [(-24.0 * u[0]).exp2(), 0.0])),
    },
    Check {
        name: "pow",
        checked: "the driver's power, of 0 to 1 to the 2^-8 to 2^8",
        spoils: "",
        run: |bench| measure(bench, &of_driver(5, f64::powf, |u| [u[0], (16.0 * u[1] - 8.0).exp2()])),
    },
    Check {
        name: "sine-of-turns",
        checked: "raywave's sine, of up to a hundredth of a turn",
        spoils: OWN,
        run: |bench| {
            let domain = |u: [f64; 2]| [0.01 * u[0], 0.0];
            measure(bench, &own(0, |x, _| (TAU * x).sin(), domain, 2.0))
        },
    },
    Check {
        name: "angle",
        checked: "raywave's angle of a point in the plane",
        spoils: OWN,
        run: |bench| measure(bench, &own(1, f64::atan2, |u| [2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0], 4.0)),
    },
    Check {
        name: "exponential",
        checked: "raywave's exponential, of -87 to 87",
        spoils: OWN,
        run: |bench| measure(bench, &own(2, |x, _| x.exp(), |u| [174.0 * u[0] - 87.0, 0.0], 2.0)),
    },
    Check {
        name: "logarithm",
        checked: "raywave's logarithm, of 2^-100 to 2^100",
        spoils: OWN,
        run: |bench| measure(bench, &own(3, |x, _| x.ln(), |u| [(200.0 * u[0] - 100.0).exp2(), 0.0], 2.0)),
    },
];

/// Arguments that are tried for each function.
const ARGUMENTS: usize = 1 << 18;

/// A function of one or two numbers.
struct Function {
    /// The kernel that contains it, and its case there.
    kernel: &'static Kernel,
    number: u32,
    /// The exact one.
    of: fn(f64, f64) -> f64,
    /// Arguments from uniform numbers in [0, 1).
    domain: fn([f64; 2]) -> [f64; 2],
    /// Largest allowed error in units of the last place; `None` for a function of the driver.
    bound: Option<f64>,
}

/// What an error of one of raywave's functions spoils.
const OWN: &str = "directions, lobes and skies are off, and the image is another one than elsewhere";

/// A function of the driver.
fn of_driver(number: u32, of: fn(f64, f64) -> f64, domain: fn([f64; 2]) -> [f64; 2]) -> Function {
    Function { kernel: kernels::FUNCTIONS, number, of, domain, bound: None }
}

/// A function of raywave's, which may be off by `bound` units in the last place.
fn own(number: u32, of: fn(f64, f64) -> f64, domain: fn([f64; 2]) -> [f64; 2], bound: f64) -> Function {
    Function { kernel: kernels::ELEMENTARY, number, of, domain, bound: Some(bound) }
}

fn measure(bench: &Bench<'_>, function: &Function) -> Result<Finding, RenderError> {
    let cases = arguments(function);
    let bits: Vec<[u32; 2]> = cases.iter().map(|case| case.map(f32::to_bits)).collect();
    Ok(judge(function, &cases, &bench.ask(function.kernel, function.number, &bits)?))
}

/// Arguments: half of them evenly over the domain, half at random.
fn arguments(function: &Function) -> Vec<[f32; 2]> {
    let mut random = SplitMix64::new(4);
    let argument = |i| {
        let [u, v] = [random.next_f64(), random.next_f64()];
        let u = if i % 2 == 0 { (i as f64 + 1.0) / (ARGUMENTS as f64 + 1.0) } else { u };
        (function.domain)([u, v]).map(|x| x as f32)
    };
    (0..ARGUMENTS).map(argument).collect()
}

/// The spacing of floats at a number.
fn unit_at(x: f64) -> f64 {
    let exponent = x.abs().log2().floor().max(-126.0);
    (exponent - 23.0).exp2()
}

fn judge(function: &Function, cases: &[[f32; 2]], answers: &[u32]) -> Finding {
    let (mut worst, mut at, mut worst_absolute) = (0.0, [0.0; 2], 0.0_f64);
    let mut nonfinite = 0_u64;
    let mut checked = 0;
    for (case, answer) in cases.iter().zip(answers) {
        let [x, y] = case.map(f64::from);
        let right = (function.of)(x, y);
        // Skips results that are not finite, or so small that they may be flushed.
        if !right.is_finite() || right.abs() < f64::from(2.0 * f32::MIN_POSITIVE) {
            continue;
        }
        checked += 1;
        let found = f64::from(f32::from_bits(*answer));
        if !found.is_finite() {
            nonfinite += 1;
            continue;
        }
        let off = (found - right).abs();
        worst_absolute = worst_absolute.max(off);
        if off / unit_at(right) > worst {
            (worst, at) = (off / unit_at(right), *case);
        }
    }
    let verdict = match function.bound {
        Some(bound) if worst <= bound && nonfinite == 0 => Verdict::Ok,
        Some(_) => Verdict::Off,
        None => Verdict::Property,
    };
    let lost = if nonfinite > 0 { format!("; {nonfinite} are NaN or infinite") } else { String::new() };
    let found = format!(
        "off by up to {worst:.1} units of the last place, as of {at:?}, and by up to {worst_absolute:.1e}{lost}"
    );
    Finding::new(checked, verdict, found)
        .with("worst_ulp", worst)
        .with("worst_absolute", worst_absolute)
        .with("not_finite", nonfinite)
        .with("bound_ulp", function.bound)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SINE: Function = Function {
        kernel: kernels::FUNCTIONS,
        number: 0,
        of: |x, _| x.sin(),
        domain: |u| [TAU * u[0], 0.0],
        bound: Some(0.501),
    };

    #[test]
    fn a_bound_holds_or_not() {
        let cases = arguments(&SINE);
        let mut answers: Vec<u32> = cases.iter().map(|[x, _]| (f64::from(*x).sin() as f32).to_bits()).collect();
        let finding = judge(&SINE, &cases, &answers);
        assert_eq!(finding.verdict, Verdict::Ok, "{}", finding.found);
        assert!(finding.numbers["worst_ulp"].as_f64().is_some_and(|worst| (0.4..0.501).contains(&worst)));
        let right = answers[1000];
        answers[1000] += 1;
        assert_eq!(judge(&SINE, &cases, &answers).verdict, Verdict::Off);
        assert_eq!(judge(&Function { bound: None, ..SINE }, &cases, &answers).verdict, Verdict::Property);
        assert_eq!(judge(&Function { bound: Some(1.6), ..SINE }, &cases, &answers).verdict, Verdict::Ok);
        answers[1000] = f32::NAN.to_bits();
        assert_eq!(judge(&Function { bound: Some(1.6), ..SINE }, &cases, &answers).verdict, Verdict::Off);
        answers[1000] = right;
        assert_eq!(judge(&SINE, &cases, &answers).verdict, Verdict::Ok);
    }

    #[test]
    fn units_are_those_of_floats() {
        for x in [1.0_f32, 1.5, 0.999_999_94, 3e-30, 1e30, f32::MIN_POSITIVE] {
            let unit = f64::from(x.next_up()) - f64::from(x);
            assert_eq!(unit_at(f64::from(x)), unit, "{x:e}");
        }
    }
}
