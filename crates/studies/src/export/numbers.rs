//! Numbers for people.

use crate::stats::{Estimate, Interval, TOO_FEW_ROUNDS};

/// A number with that many significant digits and no exponent.
pub fn significant(value: f64, digits: i32) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let magnitude = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    let decimals = (digits - 1 - magnitude).clamp(0, 12) as usize;
    format!("{value:.decimals$}")
}

/// A unit and how many of it make one of the base unit.
#[derive(Debug, Clone, Copy)]
pub struct Unit {
    /// Its symbol.
    pub symbol: &'static str,
    per_base: f64,
}

impl Unit {
    /// The unit of time in which `seconds` is at least 1.
    pub fn of_time(seconds: f64) -> Self {
        let units = [("s", 1.0), ("ms", 1e3), ("µs", 1e6)];
        let (symbol, per_base) = units.into_iter().find(|unit| seconds * unit.1 >= 1.0).unwrap_or(units[1]);
        Self { symbol, per_base }
    }

    /// The multiple of a count in which `count` is at least 1.
    pub fn of_count(count: f64) -> Self {
        let units = [("G", 1e-9), ("M", 1e-6), ("k", 1e-3)];
        let (symbol, per_base) = units.into_iter().find(|unit| count * unit.1 >= 1.0).unwrap_or(("", 1.0));
        Self { symbol, per_base }
    }

    /// The value in this unit.
    pub fn scale(&self, value: f64) -> f64 {
        value * self.per_base
    }

    /// The value in this unit, without the symbol.
    pub fn number(&self, value: f64) -> String {
        significant(self.scale(value), 3)
    }
}

/// A time with its unit.
pub fn seconds(value: f64) -> String {
    let unit = Unit::of_time(value);
    format!("{} {}", unit.number(value), unit.symbol)
}

/// Bytes in powers of two.
pub fn bytes(value: f64) -> String {
    let units = ["B", "KiB", "MiB", "GiB", "TiB"];
    let power = if value < 1.0 { 0 } else { ((value.log2() / 10.0) as usize).min(units.len() - 1) };
    format!("{} {}", significant(value / 1024_f64.powi(power as i32), 3), units[power])
}

/// A count with its multiple, such as 1.23 M.
pub fn count(value: f64) -> String {
    let unit = Unit::of_count(value);
    format!("{} {}", unit.number(value), unit.symbol).trim_end().to_owned()
}

/// A whole number in groups of three digits.
pub fn grouped(value: u64) -> String {
    let digits = value.to_string();
    let groups: Vec<&str> = digits.as_bytes().rchunks(3).rev().map(|g| std::str::from_utf8(g).unwrap_or("")).collect();
    groups.join(",")
}

/// A value and its interval, each shown in that way: `12.3 [12.1, 12.6]`, or `12.3, too few rounds`.
pub fn estimate(estimate: &Estimate, show: impl Fn(f64) -> String) -> String {
    let value = show(estimate.value);
    match estimate.interval {
        Some(Interval { low, high }) => format!("{value} [{}, {}]", show(low), show(high)),
        None => format!("{value}, {TOO_FEW_ROUNDS}"),
    }
}

/// Only the interval, to stand next to its value: `12.1–12.6`, or `too few rounds`.
pub fn bounds(estimate: &Estimate, show: impl Fn(f64) -> String) -> String {
    match estimate.interval {
        Some(Interval { low, high }) => format!("{}–{}", show(low), show(high)),
        None => TOO_FEW_ROUNDS.to_owned(),
    }
}

/// A time in a unit: `12.3 [12.1, 12.6]`.
pub fn interval(time: &Estimate, unit: Unit) -> String {
    estimate(time, |value| unit.number(value))
}

/// A ratio: `0.834 [0.829, 0.840]`.
pub fn ratio(ratio: &Estimate) -> String {
    estimate(ratio, |value| format!("{value:.3}"))
}

/// A number that may be small, with three digits.
pub fn small(value: f64) -> String {
    format!("{value:.2e}")
}

/// Such a number and its interval.
pub fn small_interval(number: &Estimate) -> String {
    estimate(number, small)
}

/// A power of ten: `10⁻⁶`.
pub fn power_of_ten(exponent: i32) -> String {
    let raised = |character| match character {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '0' | '4'..='9' => char::from_u32(0x2070 + (character as u32 - '0' as u32)).unwrap_or(character),
        _ => character,
    };
    format!("10{}", exponent.to_string().chars().map(raised).collect::<String>())
}
