//! The plots of the page. Every axis has a unit, and every mark shows its numbers when pointed at.

use super::svg::{Anchor, Axis, Spacing, Svg, logarithmic_ticks};
use crate::export::numbers::{Unit, count, estimate, grouped, ratio, seconds};
use crate::stats::{Estimate, Interval};
use crate::studies::{CombinationReport, CrossingDirection, Crossover, Measurement, Ratio, RatioVerdict, SceneReport};

const WIDTH: f64 = 960.0;
/// Height of a row of a plot with rows.
const ROW: f64 = 26.0;
/// Below a plot: tick labels and the axis's name.
const FOOT: f64 = 44.0;

/// Colours of kernels that are known by name; others take what is left, in their order.
const KERNELS: [&str; 8] =
    ["generate", "extend", "shade", "connect", "resolve", "prepare_dispatch", "megakernel", "bounce"];
/// Classes `k0` to `k9` of the page's style.
const KERNEL_COLOURS: usize = 10;

/// Kernels in the order in which they first appear, each with the class of its colour.
pub struct KernelColours(Vec<String>);

impl KernelColours {
    pub fn of(scenes: &[SceneReport]) -> Self {
        let mut names: Vec<String> = KERNELS.iter().map(|&name| name.to_owned()).collect();
        let typical = scenes.iter().flat_map(|scene| &scene.combinations).filter_map(|c| c.typical.as_ref());
        for kernel in typical.flat_map(|typical| &typical.kernels) {
            if !names.contains(&kernel.kernel) {
                names.push(kernel.kernel.clone());
            }
        }
        Self(names)
    }

    pub fn class(&self, kernel: &str) -> String {
        let position = self.0.iter().position(|name| name == kernel).unwrap_or(KERNEL_COLOURS - 1);
        format!("k{}", position % KERNEL_COLOURS)
    }
}

/// A row of the plot of ratios.
pub struct RatioRow<'a> {
    pub label: &'a str,
    pub ratio: Option<&'a Ratio>,
    /// What stands there when there is no ratio.
    pub otherwise: String,
}

/// Ratios with their intervals, in groups that have a heading, around a line at 1.
pub fn ratios(groups: &[(String, Vec<RatioRow<'_>>)]) -> String {
    let rows = || groups.iter().flat_map(|(_, rows)| rows);
    let left = label_width(rows().map(|row| row.label));
    let (start, end) = (left + 16.0, WIDTH - 190.0);
    let estimates = || rows().filter_map(|row| row.ratio).map(|ratio| ratio.estimate);
    let low = estimates().map(|e| e.lowest()).filter(|v| *v > 0.0).fold(1.0, f64::min);
    let high = estimates().map(|e| e.highest()).filter(|v| v.is_finite()).fold(1.0, f64::max);
    // At least 2 % to both sides, so that noise is not blown up to fill the plot.
    let margin = ((high / low).ln() * 0.06).max(0.02).exp();
    let axis = Axis { low: low / margin, high: high * margin, start, end, spacing: Spacing::Logarithmic };

    let headings = groups.iter().filter(|(heading, _)| !heading.is_empty()).count();
    let body = ROW * (rows().count() + headings) as f64;
    let mut svg = Svg::new(WIDTH, 22.0 + body + FOOT);
    let (top, bottom) = (22.0, 22.0 + body);
    for tick in ratio_ticks(axis.low, axis.high) {
        let x = axis.at(tick);
        svg.line("grid", (x, top), (x, bottom));
        svg.text("tick", (x, bottom + 16.0), Anchor::Middle, &format!("{}×", trimmed(tick)));
    }
    let one = axis.at(1.0);
    svg.line("one", (one, top - 4.0), (one, bottom));
    svg.text("hint", (one - 8.0, 12.0), Anchor::End, "← faster");
    svg.text("hint", (one + 8.0, 12.0), Anchor::Start, "slower →");
    svg.text("axis", ((start + end) / 2.0, bottom + 36.0), Anchor::Middle, "time over the baseline's (logarithmic)");

    let mut y = top + ROW / 2.0;
    for (heading, rows) in groups {
        if !heading.is_empty() {
            svg.text("group", (0.0, y + 4.0), Anchor::Start, heading);
            y += ROW;
        }
        for row in rows {
            svg.text("label", (left, y + 4.0), Anchor::End, row.label);
            match row.ratio {
                Some(found) => mark(&mut svg, &axis, y, row.label, found),
                None => svg.text("muted", (one + 8.0, y + 4.0), Anchor::Start, &row.otherwise),
            }
            y += ROW;
        }
    }
    svg.finish("Time of each combination over its baseline's, with intervals")
}

fn mark(svg: &mut Svg, axis: &Axis, y: f64, label: &str, found: &Ratio) {
    let class = match found.verdict() {
        RatioVerdict::Faster => "faster",
        RatioVerdict::Slower => "slower",
        RatioVerdict::WithinNoise => "noise",
        RatioVerdict::TooFewRounds => "unsure",
    };
    if let Some(Interval { low, high }) = found.estimate.interval {
        let (from, to) = (axis.at(low), axis.at(high));
        svg.line(&format!("whisker {class}"), (from, y), (to, y));
        svg.line(&format!("whisker {class}"), (from, y - 4.0), (from, y + 4.0));
        svg.line(&format!("whisker {class}"), (to, y - 4.0), (to, y + 4.0));
    }
    svg.circle(class, (axis.at(found.estimate.value), y), 4.5, &format!("{label}: {}", ratio(&found.estimate)));
    svg.text("value", (WIDTH - 178.0, y + 4.0), Anchor::Start, &ratio(&found.estimate));
}

/// Round ratios between the two, as many as are readable.
fn ratio_ticks(low: f64, high: f64) -> Vec<f64> {
    let span = (high / low).ln();
    let candidates: Vec<f64> = if span > 3.0 {
        (-10..=10).map(|power| 2_f64.powi(power)).collect()
    } else if span > 0.9 {
        vec![0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0]
    } else {
        let axis = Axis { low, high, start: 0.0, end: 1.0, spacing: Spacing::Linear };
        axis.ticks(8)
    };
    candidates.into_iter().filter(|tick| (low..=high).contains(tick)).collect()
}

/// Time of each kernel for each combination, and what of the host's time is outside of them.
pub fn kernel_times(combinations: &[&CombinationReport], colours: &KernelColours) -> String {
    let rows: Vec<(&str, &Measurement)> =
        combinations.iter().filter_map(|c| Some((c.label.as_str(), c.typical.as_ref()?))).collect();
    let left = label_width(rows.iter().map(|row| row.0));
    let kernels_of = |m: &Measurement| m.kernels.iter().map(|kernel| kernel.gpu_seconds).sum::<f64>();
    let longest = rows.iter().map(|(_, m)| m.wall_seconds.max(kernels_of(m))).fold(0.0, f64::max);
    let unit = Unit::of_time(longest);
    let axis = Axis::from_zero(unit.scale(longest), left + 16.0, WIDTH - 90.0);
    let bottom = 6.0 + ROW * rows.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + FOOT);
    vertical_grid(&mut svg, &axis, 6.0, bottom, &format!("time of the median run, {}", unit.symbol));
    for (i, (label, measurement)) in rows.iter().enumerate() {
        let top = 6.0 + ROW * i as f64;
        svg.text("label", (left, top + ROW / 2.0 + 4.0), Anchor::End, label);
        let mut from = axis.at(0.0);
        let mut segment = |class: &str, name: &str, time: f64, more: &str| {
            let width = axis.at(unit.scale(time)) - axis.at(0.0);
            let share = 100.0 * time / measurement.wall_seconds;
            let tip = format!("{name}: {}, {share:.1} % of the run{more}", seconds(time));
            // A gap of half a pixel keeps neighbours apart without a border.
            svg.rect(class, (from, top + 4.0), (width - 0.5, ROW - 8.0), &tip);
            from += width;
        };
        for kernel in &measurement.kernels {
            let launches = format!("; {} launches", grouped(kernel.launches));
            segment(&colours.class(&kernel.kernel), &kernel.kernel, kernel.gpu_seconds, &launches);
        }
        let outside = (measurement.wall_seconds - kernels_of(measurement)).max(0.0);
        segment("outside", "outside kernels", outside, "");
        svg.text("value", (from + 8.0, top + ROW / 2.0 + 4.0), Anchor::Start, &unit.number(measurement.wall_seconds));
    }
    svg.finish("Time of each kernel for each combination")
}

/// Items in each kernel's queue and time of each kernel over the bounces of one render.
pub fn bounces(measurement: &Measurement, colours: &KernelColours) -> String {
    let (top, bottom, gap) = (28.0, 232.0, 90.0);
    let panel = (WIDTH - 60.0 - gap - 10.0) / 2.0;
    let last = measurement.bounces.iter().map(|row| row.bounce).max().unwrap_or(0);
    let mut kernels: Vec<&str> = Vec::new();
    for row in &measurement.bounces {
        if !kernels.contains(&row.kernel.as_str()) {
            kernels.push(&row.kernel);
        }
    }
    let mut svg = Svg::new(WIDTH, bottom + FOOT);

    // Left: occupancy, a line for each kernel.
    let most = measurement.bounces.iter().map(|row| row.items).max().unwrap_or(0) as f64;
    let unit = Unit::of_count(most);
    let x = bounce_axis(last, 60.0, 60.0 + panel);
    let y = Axis::from_zero(unit.scale(most), bottom, top);
    let items = if unit.symbol.is_empty() { "items".to_owned() } else { format!("{} items", unit.symbol) };
    frame(&mut svg, &x, &y, &format!("Queue occupancy, {items}"));
    for kernel in &kernels {
        let class = colours.class(kernel);
        let rows: Vec<_> = measurement.bounces.iter().filter(|row| row.kernel == *kernel).collect();
        let point =
            |row: &&crate::studies::BounceRow| (x.at(f64::from(row.bounce) + 0.5), y.at(unit.scale(row.items as f64)));
        svg.polyline(&format!("series {class}"), &rows.iter().map(point).collect::<Vec<_>>());
        for row in &rows {
            let tip = format!("{kernel}, bounce {}: {}", row.bounce, count(row.items as f64));
            svg.circle(&class, point(row), 2.5, &tip);
        }
    }

    // Right: time, the kernels of a bounce on top of each other.
    let time_of = |bounce: u32| {
        measurement.bounces.iter().filter(move |row| row.bounce == bounce).map(|row| row.gpu_seconds).sum::<f64>()
    };
    let longest = (0..=last).map(time_of).fold(0.0, f64::max);
    let unit = Unit::of_time(longest);
    let x = bounce_axis(last, 60.0 + panel + gap, WIDTH - 10.0);
    let y = Axis::from_zero(unit.scale(longest), bottom, top);
    frame(&mut svg, &x, &y, &format!("Time, {}", unit.symbol));
    let column = x.at(1.0) - x.at(0.0);
    for bounce in 0..=last {
        let mut below = 0.0;
        for row in measurement.bounces.iter().filter(|row| row.bounce == bounce) {
            let above = below + row.gpu_seconds;
            let (low, high) = (y.at(unit.scale(below)), y.at(unit.scale(above)));
            let tip = format!("{}, bounce {bounce}: {}", row.kernel, seconds(row.gpu_seconds));
            let corner = (x.at(f64::from(bounce)) + 0.1 * column, high);
            svg.rect(&colours.class(&row.kernel), corner, (0.8 * column, low - high), &tip);
            below = above;
        }
    }
    svg.finish("Items in the queues and time of the kernels over the bounces")
}

/// Share of active lanes over the bounces, a line for each stage, a panel for each of two
/// combinations at most.
pub fn lanes(combinations: &[&CombinationReport], colours: &KernelColours) -> String {
    let (top, bottom, gap) = (22.0, 222.0, 70.0);
    let panel = (WIDTH - 60.0 - gap - 10.0) / 2.0;
    let mut svg = Svg::new(WIDTH, bottom + FOOT);
    for (combination, left) in combinations.iter().zip([60.0, 60.0 + panel + gap]) {
        let stages = combination.counters.iter().flat_map(|counters| &counters.stages);
        let last = stages.clone().map(|work| work.bounce).max().unwrap_or(0);
        let x = bounce_axis(last, left, left + panel);
        let y = Axis::from_zero(100.0, bottom, top);
        frame(&mut svg, &x, &y, &format!("Active lanes, %: {}", combination.label));
        for stage in ["extend", "shade", "connect"] {
            let class = colours.class(stage);
            let points: Vec<_> = stages
                .clone()
                .filter(|work| work.stage == stage)
                .filter_map(|work| Some((work, 100.0 * work.active_lane_share()?)))
                .map(|(work, share)| (work, share, (x.at(f64::from(work.bounce) + 0.5), y.at(share))))
                .collect();
            svg.polyline(&format!("series {class}"), &points.iter().map(|point| point.2).collect::<Vec<_>>());
            for (work, share, point) in points {
                let items = count(work.items as f64);
                svg.circle(&class, point, 2.5, &format!("{stage}, bounce {}: {share:.0} % of {items}", work.bounce));
            }
        }
    }
    svg.finish("Share of active lanes over the bounces")
}

fn bounce_axis(last: u32, start: f64, end: f64) -> Axis {
    Axis { low: 0.0, high: f64::from(last) + 1.0, start, end, spacing: Spacing::Linear }
}

/// Axes of a panel whose columns are bounces.
fn frame(svg: &mut Svg, x: &Axis, y: &Axis, title: &str) {
    svg.text("panel", (x.start, 12.0), Anchor::Start, title);
    for tick in y.ticks(4) {
        svg.line("grid", (x.start, y.at(tick)), (x.end, y.at(tick)));
        svg.text("tick", (x.start - 8.0, y.at(tick) + 4.0), Anchor::End, &trimmed(tick));
    }
    let step = (x.high / 12.0).ceil().max(1.0) as usize;
    for bounce in (0..x.high as u32).step_by(step) {
        svg.text("tick", (x.at(f64::from(bounce) + 0.5), y.start + 16.0), Anchor::Middle, &bounce.to_string());
    }
    svg.line("base", (x.start, y.start), (x.end, y.start));
    svg.text("axis", ((x.start + x.end) / 2.0, y.start + 36.0), Anchor::Middle, "bounce");
}

/// Two combinations' times over a swept cost, and where the faster one changes.
pub fn crossover(crossover: &Crossover) -> String {
    let (top, bottom, left, right) = (22.0, 262.0, 60.0, WIDTH - 200.0);
    let mut svg = Svg::new(WIDTH, bottom + FOOT);
    let costs: Vec<f64> = crossover.points.iter().map(|point| point.cost).collect();
    let (Some(&low), Some(&high)) = (costs.first(), costs.last()) else { return String::new() };
    // The lowest cost above 0 sets how much of the axis goes to what is below it.
    let unit = costs.iter().copied().find(|cost| *cost > 0.0).unwrap_or(1.0);
    let x = Axis { low, high, start: left, end: right, spacing: Spacing::LogarithmicAbove(unit) };
    let longest =
        crossover.points.iter().flat_map(|p| [p.a_seconds.highest(), p.b_seconds.highest()]).fold(0.0, f64::max);
    let unit = Unit::of_time(longest);
    let shortest = crossover
        .points
        .iter()
        .flat_map(|p| [p.a_seconds.lowest(), p.b_seconds.lowest()])
        .fold(f64::INFINITY, f64::min);
    let (lowest, highest) = (0.9 * unit.scale(shortest), 1.1 * unit.scale(longest));
    let y = Axis { low: lowest, high: highest, start: bottom, end: top, spacing: Spacing::Logarithmic };
    svg.text("panel", (left, 10.0), Anchor::Start, &format!("Time, {} (logarithmic)", unit.symbol));
    for tick in logarithmic_ticks(lowest, highest) {
        svg.line("grid", (left, y.at(tick)), (right, y.at(tick)));
        svg.text("tick", (left - 8.0, y.at(tick) + 4.0), Anchor::End, &trimmed(tick));
    }
    for &cost in &costs {
        svg.line("base", (x.at(cost), bottom), (x.at(cost), bottom + 4.0));
        svg.text("tick", (x.at(cost), bottom + 18.0), Anchor::Middle, &grouped(cost as u64));
    }
    svg.line("base", (left, bottom), (right, bottom));
    let name = format!("{} (logarithmic)", crossover.factor);
    svg.text("axis", ((left + right) / 2.0, bottom + 38.0), Anchor::Middle, &name);

    for crossing in &crossover.crossings {
        let at = |cost: f64| x.at(cost.clamp(low, high));
        let (from, to) = (at(crossing.cost.lowest()), at(crossing.cost.highest()));
        svg.rect("band", (from, top), ((to - from).max(1.0), bottom - top), &crossing_text(crossover, crossing));
        svg.line("cross", (at(crossing.cost.value), top), (at(crossing.cost.value), bottom));
        let label = format!("{:.0}", crossing.cost.value);
        svg.text("value", (at(crossing.cost.value), top - 6.0), Anchor::Middle, &label);
    }
    let ends: Vec<f64> =
        crossover.points.last().map(|p| vec![p.a_seconds.value, p.b_seconds.value]).unwrap_or_default();
    // Labels at the lines' ends, pushed apart where the lines end close together.
    let (a_y, b_y) = (y.at(unit.scale(ends[0])), y.at(unit.scale(ends[1])));
    let push = ((16.0 - (a_y - b_y).abs()) / 2.0).max(0.0) * if a_y < b_y { -1.0 } else { 1.0 };
    for (class, label, label_y, of) in [
        ("a", &crossover.a, a_y + push, (|p| p.a_seconds) as fn(&crate::studies::CrossoverPoint) -> Estimate),
        ("b", &crossover.b, b_y - push, |p| p.b_seconds),
    ] {
        let curve = |pick: fn(&Estimate) -> f64| {
            let values: Vec<f64> = crossover.points.iter().map(|p| unit.scale(pick(&of(p)))).collect();
            bent(&x, &y, &costs, &values)
        };
        let mut band = curve(Estimate::lowest);
        band.extend(curve(Estimate::highest).into_iter().rev());
        svg.polygon(&format!("interval {class}"), &band);
        svg.polyline(&format!("series {class}"), &curve(|e| e.value));
        for point in &crossover.points {
            let estimate = of(point);
            let place = (x.at(point.cost), y.at(unit.scale(estimate.value)));
            let tip = format!("{label} at {}: {}", grouped(point.cost as u64), seconds(estimate.value));
            svg.circle(class, place, 3.5, &tip);
        }
        svg.text(&format!("series-label {class}"), (right + 12.0, label_y + 4.0), Anchor::Start, label);
    }
    svg.finish(&format!("Time of {} and {} over {}", crossover.a, crossover.b, crossover.factor))
}

/// A crossing in words.
pub fn crossing_text(crossover: &Crossover, crossing: &crate::studies::Crossing) -> String {
    let beyond = match crossing.direction {
        CrossingDirection::AFasterBeyond => &crossover.a,
        CrossingDirection::BFasterBeyond => &crossover.b,
    };
    let doubt = if crossing.certain || crossing.cost.interval.is_none() { "" } else { "; it may not cross at all" };
    let cost = estimate(&crossing.cost, |cost| format!("{cost:.0}"));
    format!("{beyond} is faster beyond {} = {cost}{doubt}", crossover.factor)
}

/// Straight lines between values, drawn over a bent axis: the crossing of two such curves is where
/// their straight lines cross.
fn bent(x: &Axis, y: &Axis, costs: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    const STEPS: u32 = 24;
    let segment = |(costs, values): (&[f64], &[f64])| {
        let (costs, values) = ([costs[0], costs[1]], [values[0], values[1]]);
        (0..=STEPS).map(move |i| {
            let share = f64::from(i) / f64::from(STEPS);
            // Even steps on the bent axis would be better still; squares come close.
            let share = share * share;
            (costs[0] + share * (costs[1] - costs[0]), values[0] + share * (values[1] - values[0]))
        })
    };
    let all = costs.windows(2).zip(values.windows(2)).flat_map(segment);
    all.map(|(cost, value)| (x.at(cost), y.at(value))).collect()
}

fn vertical_grid(svg: &mut Svg, axis: &Axis, top: f64, bottom: f64, name: &str) {
    for tick in axis.ticks(7) {
        svg.line("grid", (axis.at(tick), top), (axis.at(tick), bottom));
        svg.text("tick", (axis.at(tick), bottom + 16.0), Anchor::Middle, &trimmed(tick));
    }
    svg.text("axis", ((axis.start + axis.end) / 2.0, bottom + 36.0), Anchor::Middle, name);
}

/// Room for labels of 13 pixels.
fn label_width<'a>(labels: impl Iterator<Item = &'a str>) -> f64 {
    let longest = labels.map(|label| label.chars().count()).max().unwrap_or(0);
    (longest as f64 * 7.6 + 6.0).clamp(60.0, 420.0)
}

/// A round number without trailing zeros.
fn trimmed(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
