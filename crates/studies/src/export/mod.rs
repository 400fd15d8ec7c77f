//! Reports of studies as files: JSON, CSV, Markdown and a page of HTML.
//!
//! This room turns a report and its [`Provenance`] into text and keeps the files. It measures
//! nothing, knows nothing of the GPU and never prints. JSON holds everything; CSV is a table for other
//! programs; Markdown and HTML are for people.

mod compare;
mod compiled;
mod csv;
pub mod envelope;
mod error;
pub mod heatmap;
mod html;
mod markdown;
pub mod numbers;
mod tradeoff;

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;
use serde_json::Value;

pub use csv::Row;
pub use error::ExportError;
pub use html::Page;

use crate::studies::tradeoff::TradeoffReport;
use crate::studies::{Envelope, Provenance, Report};
use raywave::whole_file;

/// What a study found, in every format.
pub trait Exported: Serialize {
    /// The rows of the CSV.
    fn rows(&self, provenance: &Provenance) -> Vec<Row>;
    /// Tables, as Markdown.
    fn markdown(&self, provenance: &Provenance) -> String;
    /// A page of HTML.
    fn html(&self, provenance: &Provenance, page: &mut Page) -> String;
}

/// A row of the CSV is a combination of settings on a scene.
impl Exported for Report {
    fn rows(&self, provenance: &Provenance) -> Vec<Row> {
        compare::rows(self, provenance)
    }

    fn markdown(&self, provenance: &Provenance) -> String {
        compare::markdown(self, provenance)
    }

    fn html(&self, provenance: &Provenance, page: &mut Page) -> String {
        html::compare::page(self, provenance, page)
    }
}

/// A row of the CSV is a point of the sweep.
impl Exported for TradeoffReport {
    fn rows(&self, provenance: &Provenance) -> Vec<Row> {
        tradeoff::rows(self, provenance)
    }

    fn markdown(&self, provenance: &Provenance) -> String {
        tradeoff::markdown(self, provenance)
    }

    fn html(&self, provenance: &Provenance, page: &mut Page) -> String {
        html::tradeoff::page(self, provenance, page)
    }
}

/// A row of the CSV is a setting of a limit.
impl Exported for Envelope {
    fn rows(&self, provenance: &Provenance) -> Vec<Row> {
        envelope::rows(self, provenance)
    }

    fn markdown(&self, provenance: &Provenance) -> String {
        envelope::markdown(self, provenance)
    }

    fn html(&self, provenance: &Provenance, page: &mut Page) -> String {
        html::envelope::page(self, provenance, page)
    }
}

/// A report and where it comes from.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Document<'a, R> {
    /// Where it comes from.
    pub provenance: &'a Provenance,
    /// What was found.
    #[serde(flatten)]
    pub report: &'a R,
}

impl<R: Exported> Document<'_, R> {
    /// Everything, as JSON: keys in snake_case with the unit in their name; what is not a finite
    /// number is null.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report has nothing that JSON has not") + "\n"
    }

    /// A table, as CSV (RFC 4180) with a header. What does not apply is empty.
    pub fn csv(&self) -> String {
        csv::table(&self.report.rows(self.provenance))
    }

    /// Tables, as Markdown.
    pub fn markdown(&self) -> String {
        self.report.markdown(self.provenance)
    }

    /// A page of HTML. `page` keeps images from one time to the next.
    pub fn html(&self, page: &mut Page) -> String {
        self.report.html(self.provenance, page)
    }
}

/// A setting for people: text without quotes.
pub fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// What a file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Format {
    Json,
    Csv,
    Markdown,
    Html,
}

/// The files of a study, written anew as there is more to say, each of them whole: a study that is
/// broken off leaves what it had.
#[derive(Debug, Default)]
pub struct Exports {
    files: Vec<(Format, PathBuf)>,
    page: Page,
    /// When they may be written again.
    next: Option<Instant>,
}

/// How many times as long as they took to be written files are left alone by [`Exports::update`].
const REST: u32 = 19;

impl Exports {
    /// Files to write. Checks, before any work is begun, that they can be written and differ. PNG
    /// images in the page are brightened by `exposure_stops`.
    ///
    /// # Errors
    /// A file that cannot be written, or that is named twice.
    pub fn open(files: Vec<(Format, PathBuf)>, exposure_stops: f32) -> Result<Self, ExportError> {
        for (i, (_, path)) in files.iter().enumerate() {
            whole_file::check(path).map_err(unwritable(path))?;
            for (_, before) in &files[..i] {
                if whole_file::is_same(before, path).map_err(unwritable(path))? {
                    return Err(ExportError::Twice { path: path.clone() });
                }
            }
        }
        Ok(Self { files, page: Page::new(exposure_stops), next: None })
    }

    /// Whether one of them goes to the standard output, which then has no room for anything else.
    pub fn take_stdout(&self) -> bool {
        self.files.iter().any(|(_, path)| whole_file::is_stdout(path))
    }

    /// As [`Exports::keep`], unless that has been done so lately that it would take more than a twentieth of the time: a
    /// device that is measured would wait for it.
    ///
    /// # Errors
    /// As [`Exports::write`].
    pub fn update(&mut self, document: &Document<'_, impl Exported>) -> Result<(), ExportError> {
        let start = Instant::now();
        if self.next.is_none_or(|next| start >= next) {
            self.keep(document)?;
            self.next = Some(Instant::now() + REST * start.elapsed());
        }
        Ok(())
    }

    /// Writes every file that can be written anew later: all but streams.
    ///
    /// # Errors
    /// As [`Exports::write`].
    pub fn keep(&mut self, document: &Document<'_, impl Exported>) -> Result<(), ExportError> {
        self.write_where(document, |path| !whole_file::is_stream(path))
    }

    /// Writes every file, streams too, for the last time.
    ///
    /// # Errors
    /// A file that cannot be written any more, such as on a full disk. Those before it are written.
    pub fn write(&mut self, document: &Document<'_, impl Exported>) -> Result<(), ExportError> {
        self.write_where(document, |_| true)
    }

    fn write_where(
        &mut self,
        document: &Document<'_, impl Exported>,
        is_wanted: impl Fn(&Path) -> bool,
    ) -> Result<(), ExportError> {
        for (format, path) in self.files.iter().filter(|(_, path)| is_wanted(path)) {
            let text = match format {
                Format::Json => document.json(),
                Format::Csv => document.csv(),
                Format::Markdown => document.markdown(),
                Format::Html => document.html(&mut self.page),
            };
            whole_file::write_text(path, &text).map_err(unwritable(path))?;
        }
        Ok(())
    }
}

fn unwritable(path: &Path) -> impl FnOnce(std::io::Error) -> ExportError {
    |cause| ExportError::Write { path: path.to_path_buf(), cause }
}
