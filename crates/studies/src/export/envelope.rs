//! The operating envelope as CSV, as Markdown and in lines for a terminal.

use super::csv::Row;
use super::markdown::{escape, head};
use super::numbers::count;
use crate::studies::{Envelope, Limit, Provenance, Trial};

/// A row for each setting of each limit.
pub fn rows(envelope: &Envelope, provenance: &Provenance) -> Vec<Row> {
    let of_limit = |limit: &'_ Limit| -> Vec<Row> {
        limit.trials.iter().map(|trial| row(envelope, provenance, limit, trial)).collect()
    };
    envelope.limits.iter().flat_map(of_limit).collect()
}

fn row(envelope: &Envelope, provenance: &Provenance, limit: &Limit, trial: &Trial) -> Row {
    let mut row = Row::default();
    row.text("device", &provenance.device);
    row.text("driver", &provenance.driver);
    row.text("raywave_version", &provenance.raywave_version);
    row.text("level", &envelope.level);
    row.text("row", limit.name);
    row.text("driven", limit.driven);
    row.text("setting", &trial.setting);
    row.text("required", trial.required);
    row.text("holds", trial.holds(limit.allowed));
    row.number("measured", Some(trial.measured));
    row.number("standard_error", Some(trial.standard_error));
    row.number("allowed", Some(limit.allowed));
    row.count("checked", Some(trial.checked));
    row.count("nonfinite_samples", Some(trial.nonfinite_samples));
    row.text("failure", &trial.failure);
    row
}

/// A table, and what to know of each limit.
pub fn markdown(envelope: &Envelope, provenance: &Provenance) -> String {
    let mut text = head("stability", provenance);
    text += &format!("{}\n\n", summary(envelope));
    text += "| row | driven | promised | worst | allowed | holds to | fails at | looked at |\n";
    text += "| :-- | :-- | :-- | --: | --: | --: | --: | --: |\n";
    for limit in &envelope.limits {
        let cells = [
            limit.name.to_owned(),
            limit.driven.to_owned(),
            promised(limit),
            limit.worst().map_or_else(none, error),
            measured(limit.allowed),
            limit.last_good().map_or_else(none, |trial| trial.setting.clone()),
            limit.threshold().map_or_else(|| "not reached".to_owned(), |trial| trial.setting.clone()),
            count(limit.checked() as f64),
        ];
        text += &format!("| {} |\n", cells.map(|cell| escape(&cell)).join(" | "));
    }
    text += "\n";
    for limit in &envelope.limits {
        let notes: Vec<&str> = [limit.measure, limit.remark].into_iter().filter(|note| !note.is_empty()).collect();
        text += &format!("- **{}**: {}\n", limit.name, escape(&notes.join("; ")));
    }
    text
}

/// A line for each limit, and all of it in a sentence.
pub fn lines(envelope: &Envelope) -> String {
    let lines: String = envelope.limits.iter().map(line).collect();
    format!("{lines}{}\n", summary(envelope))
}

/// A limit for a terminal: whether it holds, the worst of what is promised, and where it fails.
fn line(limit: &Limit) -> String {
    let verdict = if limit.holds() { "holds" } else { "FAILS" };
    let worst = limit.worst().map_or_else(none, error);
    let threshold = match limit.threshold() {
        Some(trial) => format!("fails at {}: {}", trial.setting, error(trial)),
        None => "no failure reached".to_owned(),
    };
    let part = if limit.reduced.is_empty() { String::new() } else { format!(" ({})", limit.reduced) };
    format!(
        "{verdict}  {:<23} {}: {}\n       worst {worst}, {} allowed; {threshold}{part}\n",
        limit.name,
        limit.driven,
        promised(limit),
        measured(limit.allowed),
    )
}

/// What was promised: from the first to the last setting.
pub fn promised(limit: &Limit) -> String {
    let settings: Vec<&str> =
        limit.trials.iter().filter(|trial| trial.required).map(|trial| trial.setting.as_str()).collect();
    settings.join(", ")
}

/// All of it in a sentence.
pub fn summary(envelope: &Envelope) -> String {
    let failing: Vec<&str> = envelope.limits.iter().filter(|limit| !limit.holds()).map(|limit| limit.name).collect();
    let verdict = match failing.as_slice() {
        [] => "all that is promised holds".to_owned(),
        names => format!("not as promised: {}", names.join(", ")),
    };
    let trials: usize = envelope.limits.iter().map(|limit| limit.trials.len()).sum();
    let checked: u64 = envelope.limits.iter().map(Limit::checked).sum();
    format!(
        "{} rows, {trials} settings, {} samples and rays: {verdict}; {} samples were NaN or infinite{}",
        envelope.limits.len(),
        count(checked as f64),
        envelope.nonfinite_samples(),
        if envelope.complete { "" } else { "; broken off" },
    )
}

/// What a trial measured, with its standard error, or why it did not.
pub fn error(trial: &Trial) -> String {
    let nonfinite = match trial.nonfinite_samples {
        0 => String::new(),
        count => format!(", {count} NaN or infinite"),
    };
    match (trial.failure.as_str(), trial.standard_error) {
        ("", 0.0) => measured(trial.measured) + &nonfinite,
        ("", spread) => format!("{} ± {}{nonfinite}", measured(trial.measured), measured(spread)),
        (failure, _) => failure.to_owned(),
    }
}

fn measured(value: f64) -> String {
    match value {
        0.0 => "0".to_owned(),
        value if value.is_finite() => format!("{value:.1e}").replace(".0e", "e"),
        _ => none(),
    }
}

fn none() -> String {
    "–".to_owned()
}
