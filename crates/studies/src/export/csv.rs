//! Comma-separated values (RFC 4180).

use crate::stats::Estimate;
use crate::studies::{Provenance, SceneFacts};

/// A row: the name of each column and its cell, in one place, so that they cannot fall apart. What
/// does not apply is empty.
#[derive(Debug, Default)]
pub struct Row(Vec<(String, String)>);

impl Row {
    /// A row that begins with where a study comes from and what it rendered.
    pub fn of(provenance: &Provenance, facts: &SceneFacts) -> Self {
        let mut row = Self::default();
        row.text("device", &provenance.device);
        row.text("driver", &provenance.driver);
        row.text("raywave_version", &provenance.raywave_version);
        row.text("scene", &facts.scene);
        row.text("scene_hash", &facts.scene_hash);
        row.text("width_pixels", facts.width_pixels);
        row.text("height_pixels", facts.height_pixels);
        row
    }

    /// Adds anything that has a text.
    pub fn text(&mut self, name: &str, value: impl ToString) {
        self.0.push((name.to_owned(), value.to_string()));
    }

    /// Adds a number, where it is known and finite.
    pub fn number(&mut self, name: &str, value: Option<f64>) {
        self.text(name, value.filter(|value| value.is_finite()).map_or_else(String::new, |value| value.to_string()));
    }

    /// Adds a count, where it is known.
    pub fn count(&mut self, name: &str, value: Option<u64>) {
        self.text(name, value.map_or_else(String::new, |value| value.to_string()));
    }

    /// Adds a number and both ends of its interval.
    pub fn estimate(&mut self, name: &str, estimate: Option<Estimate>) {
        let interval = estimate.and_then(|estimate| estimate.interval);
        self.number(name, estimate.map(|estimate| estimate.value));
        self.number(&format!("{name}_low"), interval.map(|interval| interval.low));
        self.number(&format!("{name}_high"), interval.map(|interval| interval.high));
    }
}

/// The header and the rows, which all have the same columns.
pub fn table(rows: &[Row]) -> String {
    let header = rows.first().map(|row| line(row.0.iter().map(|(name, _)| name)));
    let lines = rows.iter().map(|row| line(row.0.iter().map(|(_, cell)| cell)));
    header.into_iter().chain(lines).collect()
}

fn line<'a>(cells: impl Iterator<Item = &'a String>) -> String {
    cells.map(|cell| quote(cell)).collect::<Vec<_>>().join(",") + "\r\n"
}

fn quote(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.to_owned() }
}
