//! The little of SVG that plots need.

use std::fmt::Write;

/// Text that HTML and SVG leave alone, in attributes too.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            _ => escaped.push(character),
        }
    }
    escaped
}

/// Where a text is held.
#[derive(Debug, Clone, Copy)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// A drawing in pixels, y downwards. Colours come from the page's style by class.
pub struct Svg {
    width: f64,
    height: f64,
    body: String,
}

impl Svg {
    pub fn new(width: f64, height: f64) -> Self {
        Self { width, height, body: String::new() }
    }

    pub fn line(&mut self, class: &str, (x1, y1): (f64, f64), (x2, y2): (f64, f64)) {
        self.push(format_args!(r#"<line class="{class}" x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}"/>"#));
    }

    /// A rectangle that shows `tip` when it is pointed at.
    pub fn rect(&mut self, class: &str, (x, y): (f64, f64), (width, height): (f64, f64), tip: &str) {
        let tip = if tip.is_empty() { String::new() } else { format!("<title>{}</title>", escape(tip)) };
        self.push(format_args!(
            r#"<rect class="{class}" x="{x:.1}" y="{y:.1}" width="{:.2}" height="{:.1}">{tip}</rect>"#,
            width.max(0.0),
            height.max(0.0)
        ));
    }

    pub fn circle(&mut self, class: &str, (x, y): (f64, f64), radius: f64, tip: &str) {
        let tip = escape(tip);
        self.push(format_args!(
            r#"<circle class="{class}" cx="{x:.1}" cy="{y:.1}" r="{radius}"><title>{tip}</title></circle>"#
        ));
    }

    pub fn text(&mut self, class: &str, (x, y): (f64, f64), anchor: Anchor, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let text = escape(text);
        self.push(format_args!(r#"<text class="{class}" x="{x:.1}" y="{y:.1}" text-anchor="{anchor}">{text}</text>"#));
    }

    pub fn polyline(&mut self, class: &str, points: &[(f64, f64)]) {
        self.push(format_args!(r#"<polyline class="{class}" points="{}"/>"#, coordinates(points)));
    }

    pub fn polygon(&mut self, class: &str, points: &[(f64, f64)]) {
        self.push(format_args!(r#"<polygon class="{class}" points="{}"/>"#, coordinates(points)));
    }

    /// The element. `label` says to those who cannot see it what it shows.
    pub fn finish(self, label: &str) -> String {
        let Self { width, height, body } = self;
        let label = escape(label);
        format!(
            r#"<svg class="plot" viewBox="0 0 {width:.0} {height:.0}" role="img" aria-label="{label}">{body}</svg>"#
        )
    }

    fn push(&mut self, element: std::fmt::Arguments<'_>) {
        self.body.write_fmt(element).expect("a string takes everything");
        self.body.push('\n');
    }
}

fn coordinates(points: &[(f64, f64)]) -> String {
    points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

/// How values become lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Spacing {
    Linear,
    Logarithmic,
    /// The logarithm of 1 + value / unit: logarithmic well above the unit, and 0 has a place.
    LogarithmicAbove(f64),
}

/// Values along a line of pixels.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    pub low: f64,
    pub high: f64,
    pub start: f64,
    pub end: f64,
    pub spacing: Spacing,
}

impl Axis {
    /// An axis from 0 to a little over `highest`.
    pub fn from_zero(highest: f64, start: f64, end: f64) -> Self {
        let high = if highest > 0.0 { highest } else { 1.0 };
        Self { low: 0.0, high: high * 1.02, start, end, spacing: Spacing::Linear }
    }

    /// The pixel of a value.
    pub fn at(&self, value: f64) -> f64 {
        let warp = |value: f64| match self.spacing {
            Spacing::Linear => value,
            Spacing::Logarithmic => value.ln(),
            Spacing::LogarithmicAbove(unit) => (value / unit).ln_1p(),
        };
        let share = (warp(value) - warp(self.low)) / (warp(self.high) - warp(self.low));
        self.start + share * (self.end - self.start)
    }

    /// About `wanted` round values of a linear axis.
    pub fn ticks(&self, wanted: usize) -> Vec<f64> {
        let step = round_step((self.high - self.low) / wanted as f64);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// Round values of a logarithmic axis: 1, 2 and 5 times powers of ten, or more where those are few.
pub fn logarithmic_ticks(low: f64, high: f64) -> Vec<f64> {
    let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let of = |mantissas: &[f64]| -> Vec<f64> {
        let all = powers.clone().flat_map(|power| mantissas.iter().map(move |m| m * 10_f64.powi(power)));
        all.filter(|tick| (low..=high).contains(tick)).collect()
    };
    let few = of(&[1.0, 2.0, 5.0]);
    if few.len() > 3 { few } else { of(&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]) }
}

/// The number among 1, 2 and 5 times a power of ten that is next above.
fn round_step(rough: f64) -> f64 {
    let power = 10_f64.powf(rough.log10().floor());
    let mantissa = rough / power;
    power * [1.0, 2.0, 5.0, 10.0].into_iter().find(|&round| mantissa <= round * (1.0 + 1e-9)).unwrap_or(10.0)
}
