//! A sweep as CSV, as Markdown and in sentences.

use super::csv::Row;
use super::markdown::{escape, head};
use super::numbers::{Unit, interval, ratio, seconds, small, small_interval};
use crate::stats::{Estimate, TOO_FEW_ROUNDS};
use crate::studies::Provenance;
use crate::studies::tradeoff::{Decomposition, KnobReport, PointReport, TradeoffReport, Worth};

/// What a knob at a level is called.
pub fn knob_label(knob: &KnobReport) -> String {
    match knob.level.as_str() {
        "on" => knob.factor.to_owned(),
        level => format!("{} {level}", knob.factor),
    }
}

/// What came of the sweep, in sentences without a full stop.
pub fn findings(report: &TradeoffReport) -> Vec<String> {
    let mut findings = Vec::new();
    let of = |worth: Worth| report.knobs.iter().filter(move |knob| knob.worth == worth);
    let list = |knobs: Vec<String>| knobs.join(", ");
    let base_error = report.points.first().and_then(|base| Some(base.rel_mse?.total.value));
    let best = report.knobs.first().filter(|knob| matches!(knob.worth, Worth::Free | Worth::Trade));
    if let (Some(best), Some(error)) = (best.and_then(|best| Some((best, best.equal_error_ratio?))), base_error) {
        findings.push(format!(
            "{} buys most: the error of the base with {} samples, relMSE {}, in {:.2} times its time",
            knob_label(best.0),
            report.base_samples,
            small(error),
            best.1
        ));
    } else if report.knobs.iter().any(|knob| knob.worth != Worth::TooFewRounds) {
        findings.push("no knob surely buys anything at the base's error: take more or fewer samples".to_owned());
    }
    let with_cost = |knob: &KnobReport| format!("{} ({:.2}×)", knob_label(knob), knob.cost_ratio.value);
    let free: Vec<String> = of(Worth::Free).map(with_cost).collect();
    if !free.is_empty() {
        findings.push(format!("free, less time to an equal error and no bias seen: {}", list(free)));
    }
    let traded: Vec<String> = of(Worth::Trade)
        .map(|knob| {
            format!(
                "{} ({:.2}×, above relMSE {})",
                knob_label(knob),
                knob.cost_ratio.value,
                small(knob.pays_above.unwrap_or(0.0))
            )
        })
        .collect();
    if !traded.is_empty() {
        findings.push(format!("biased, and worth it for larger errors: {}", list(traded)));
    }
    let even: Vec<String> = of(Worth::Even).map(knob_label).collect();
    if !even.is_empty() {
        findings.push(format!("makes no sure difference: {}", list(even)));
    }
    let unknown: Vec<String> = of(Worth::TooFewRounds).map(knob_label).collect();
    if !unknown.is_empty() {
        findings.push(format!("{TOO_FEW_ROUNDS} to judge: {}", list(unknown)));
    }
    let never: Vec<String> = of(Worth::Never).map(with_cost).collect();
    if !never.is_empty() {
        findings.push(format!("never worth it here, other samples do more: {}", list(never)));
    }
    if let Some(answer) = &report.target {
        let wanted = small(answer.rel_mse);
        findings.push(if answer.configuration.is_some() {
            let how = if answer.measured { "measured" } else { "inferred from the nearest points" };
            format!(
                "relMSE {wanted} is reached soonest by {} with {} samples, in {} ({how}): raywave render SCENE -o FILE {}",
                answer.label, answer.samples, seconds(answer.seconds), answer.flags
            )
        } else {
            format!("nothing that was tried reaches relMSE {wanted}")
        });
    }
    findings
}

/// Where the reference comes from and how well it is known.
pub fn reference_text(report: &TradeoffReport) -> String {
    let noise = report.reference_noise.map_or_else(
        || "its own noise is not known and counts as bias".to_owned(),
        |noise| {
            format!(
                "{} samples per pixel; relMSE {} by its own noise, standard error of its mean {}",
                noise.samples_per_pixel,
                small(noise.relative_variance),
                small(noise.mean_standard_error)
            )
        },
    );
    format!("{}; {noise}", report.reference)
}

/// A row for each point.
pub fn rows(report: &TradeoffReport, provenance: &Provenance) -> Vec<Row> {
    report.points.iter().map(|point| row(report, provenance, point)).collect()
}

fn row(report: &TradeoffReport, provenance: &Provenance, point: &PointReport) -> Row {
    let mut row = Row::of(provenance, &report.facts);
    row.text("point", &point.label);
    row.text("samples_per_pixel", point.samples);
    row.text("render_flags", &point.flags);
    row.text("renders", point.runs.len());
    row.text("failed", point.failed.as_deref().unwrap_or_default());
    row.text("on_front", point.on_front);
    row.estimate("seconds", point.seconds);
    for (name, error) in [("rel_mse", point.rel_mse), ("mse", point.mse)] {
        let part = |of: fn(Decomposition) -> Estimate| error.map(of);
        row.estimate(name, part(|error| error.total));
        row.estimate(&format!("{name}_bias_squared"), part(|error| error.bias_squared));
        row.estimate(&format!("{name}_variance"), part(|error| error.variance));
    }
    row.estimate("relative_mean_error", point.mean_error);
    row.estimate("efficiency_per_second", point.efficiency);
    let has_no_interval = point.seconds.is_some_and(|seconds| seconds.interval.is_none());
    row.text("interval_verdict", if has_no_interval { TOO_FEW_ROUNDS } else { "" });
    row.text("nonfinite_samples", point.nonfinite_samples);
    row
}

/// Tables of knobs and points.
pub fn markdown(report: &TradeoffReport, provenance: &Provenance) -> String {
    let facts = &report.facts;
    let mut text = head("tradeoff", provenance);
    if !report.complete {
        text += "**The sweep was not finished; this is what it has so far.**\n\n";
    }
    text += &format!(
        "## {}\n\n{} x {} pixels; knobs at {} samples per pixel. Reference: {}.\n\n",
        escape(&facts.scene),
        facts.width_pixels,
        facts.height_pixels,
        report.base_samples,
        escape(&reference_text(report)),
    );
    text += &findings(report).iter().map(|finding| format!("- {}\n", escape(finding))).collect::<String>();
    text += &format!(
        "\nMedians of the device's time; intervals of {:.0} %, those of errors by resampling the renders. Squared errors are relative to radiance² + 0.01.\n",
        100.0 * report.confidence
    );
    text += "\n| knob | time | time to equal variance | bias² | mean shift | worth | pays above relMSE |\n";
    text += "| :-- | --: | --: | --: | --: | :-- | --: |\n";
    for knob in &report.knobs {
        text += &format!(
            "| {} | {} | {} | {} | {} | {} | {} |\n",
            escape(&knob_label(knob)),
            ratio(&knob.time_ratio),
            ratio(&knob.cost_ratio),
            if knob.identical { "none, to the last bit".to_owned() } else { small_interval(&knob.bias_squared) },
            small(knob.mean_shift.value),
            knob.worth.words(),
            knob.pays_above.map_or_else(|| "–".to_owned(), small),
        );
    }
    text += &points("The front", report, report.front.iter().map(|i| &report.points[*i]));
    text += &points("All points", report, report.points.iter());
    text
}

fn points<'a>(heading: &str, report: &TradeoffReport, points: impl Iterator<Item = &'a PointReport>) -> String {
    let longest = report.points.iter().filter_map(|p| Some(p.seconds?.value)).fold(0.0, f64::max);
    let unit = Unit::of_time(longest);
    let mut text = format!(
        "\n### {heading}\n\n| point | samples | time, {} | relMSE | bias² | variance | mean error | efficiency |\n",
        unit.symbol
    );
    text += "| :-- | --: | --: | --: | --: | --: | --: | --: |\n";
    for point in points {
        let dash = || "–".to_owned();
        let part = |of: fn(&Decomposition) -> &Estimate| {
            point.rel_mse.as_ref().map_or_else(dash, |error| small_interval(of(error)))
        };
        text += &format!(
            "| {} | {} | {} | {} | {} | {} | {} | {} |\n",
            escape(&point.label),
            point.samples,
            match &point.failed {
                Some(reason) => escape(reason),
                None => point.seconds.map_or_else(dash, |seconds| interval(&seconds, unit)),
            },
            part(|error| &error.total),
            part(|error| &error.bias_squared),
            part(|error| &error.variance),
            point.mean_error.map_or_else(dash, |error| small_interval(&error)),
            point.efficiency.map_or_else(dash, |efficiency| small(efficiency.value)),
        );
    }
    text
}
