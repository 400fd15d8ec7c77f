//! The operating envelope as JSON, Markdown, a page, and lines for a terminal.

use serde::Serialize;

use super::html::envelope::page;
use super::markdown::escape;
use super::numbers::count;
use crate::studies::{Envelope, Provenance, Row, Trial};

/// An envelope and where it comes from.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct EnvelopeDocument<'a> {
    /// Where it comes from.
    pub provenance: &'a Provenance,
    /// What was found.
    #[serde(flatten)]
    pub envelope: &'a Envelope,
}

impl EnvelopeDocument<'_> {
    /// Everything, as JSON: keys in snake_case; what is not a finite number is null.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("an envelope has nothing that JSON has not") + "\n"
    }

    /// A self-contained page.
    pub fn html(&self) -> String {
        page(self)
    }

    /// A table, and what to know of each row.
    pub fn markdown(&self) -> String {
        let Self { provenance, envelope } = self;
        let mut text = format!(
            "# raywave stability\n\n{}, {}; raywave {}, built by {}; {}\n\n    {}\n\n",
            escape(&provenance.device),
            escape(&provenance.driver),
            provenance.raywave_version,
            escape(&provenance.rustc_version),
            provenance.date,
            provenance.command_line.replace('\n', " "),
        );
        text += &format!("{}\n\n", summary(envelope));
        text += "| row | driven | promised | worst | allowed | holds to | fails at | looked at |\n";
        text += "| :-- | :-- | :-- | --: | --: | --: | --: | --: |\n";
        for row in &envelope.rows {
            let cells = [
                row.name.to_owned(),
                row.driven.to_owned(),
                promised(row),
                row.worst().map_or_else(none, error),
                measured(row.allowed),
                row.last_good().map_or_else(none, |trial| trial.setting.clone()),
                row.threshold().map_or_else(|| "not reached".to_owned(), |trial| trial.setting.clone()),
                count(row.checked() as f64),
            ];
            text += &format!("| {} |\n", cells.map(|cell| escape(&cell)).join(" | "));
        }
        text += "\n";
        for row in &envelope.rows {
            let notes: Vec<&str> = [row.measure, row.remark].into_iter().filter(|note| !note.is_empty()).collect();
            text += &format!("- **{}**: {}\n", row.name, escape(&notes.join("; ")));
        }
        text
    }

    /// A line a row.
    pub fn lines(&self) -> String {
        let lines: String = self.envelope.rows.iter().map(line).collect();
        format!("{lines}{}\n", summary(self.envelope))
    }
}

/// A row for a terminal: whether it holds, the worst of what is promised, and where it fails.
pub fn line(row: &Row) -> String {
    let verdict = if row.holds() { "holds" } else { "FAILS" };
    let worst = row.worst().map_or_else(none, error);
    let threshold = match row.threshold() {
        Some(trial) => format!("fails at {}: {}", trial.setting, error(trial)),
        None => "no failure reached".to_owned(),
    };
    let part = if row.reduced.is_empty() { String::new() } else { format!(" ({})", row.reduced) };
    format!(
        "{verdict}  {:<23} {}: {}\n       worst {worst}, {} allowed; {threshold}{part}\n",
        row.name,
        row.driven,
        promised(row),
        measured(row.allowed),
    )
}

/// What was promised: from the first to the last setting.
pub fn promised(row: &Row) -> String {
    let settings: Vec<&str> =
        row.trials.iter().filter(|trial| trial.required).map(|trial| trial.setting.as_str()).collect();
    settings.join(", ")
}

/// All of it in a sentence.
pub fn summary(envelope: &Envelope) -> String {
    let failing: Vec<&str> = envelope.rows.iter().filter(|row| !row.holds()).map(|row| row.name).collect();
    let verdict = match failing.as_slice() {
        [] => "all that is promised holds".to_owned(),
        names => format!("not as promised: {}", names.join(", ")),
    };
    let trials: usize = envelope.rows.iter().map(|row| row.trials.len()).sum();
    let checked: u64 = envelope.rows.iter().map(Row::checked).sum();
    format!(
        "{} rows, {trials} settings, {} samples and rays: {verdict}; {} samples were NaN or infinite{}",
        envelope.rows.len(),
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
