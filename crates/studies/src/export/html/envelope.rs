//! The page of an operating envelope.

use super::page::{Frame, Page};
use super::svg::escape;
use super::table::{Cell, table};
use crate::export::envelope::{error, promised, summary};
use crate::export::numbers::{count, seconds};
use crate::studies::{Envelope, Limit, Provenance, Trial};

/// Every setting is a cell: right, wrong, or wrong where nothing is promised.
const TRIALS: &str = ".trials { display: flex; flex-wrap: wrap; gap: 0.35rem; margin: 0.6rem 0 0.3rem; padding: 0; list-style: none; font-size: 0.85rem; }
.trials li { padding: 0.25rem 0.55rem; border: 1px solid var(--hair); border-left: 4px solid var(--k3); border-radius: 4px; background: var(--panel); }
.trials li.beyond { border-style: dashed; border-left-style: solid; }
.trials li.limit { border-left-color: var(--slower); }
.trials li.broken { border-left-color: var(--bad); font-weight: 600; }
.row p { margin: 0.2rem 0; color: var(--soft); font-size: 0.9rem; max-width: 56rem; }
";

/// The page of an envelope.
pub fn page(envelope: &Envelope, provenance: &Provenance, page: &mut Page) -> String {
    let columns = ["row", "driven", "promised", "worst", "allowed", "holds to", "fails at", "looked at", "time"];
    let columns: Vec<(String, &str)> = columns.iter().map(|name| ((*name).to_owned(), "")).collect();
    let rows: Vec<(String, Vec<Cell>)> = envelope.limits.iter().map(cells).collect();
    let details: String = envelope.limits.iter().map(details).collect();
    let main = format!(
        "<section id=\"rows\"><h2>Limits</h2>\n{}</section>\n\
         <section id=\"settings\"><h2>Every setting</h2>\n<p>Solid frames are promised, dashed ones look for the place where \
         it fails.</p>\n{details}</section>\n",
        table("Limits of all rows", &columns, &rows),
    );
    let frame = Frame {
        command: "stability",
        title: "",
        heading: "Operating envelope",
        unfinished: None,
        findings: vec![escape(&summary(envelope))],
        style: TRIALS,
        main,
        provenance: vec![("level".to_owned(), envelope.level.clone())],
    };
    frame.html(provenance, page.images().into_uris())
}

fn cells(limit: &Limit) -> (String, Vec<Cell>) {
    let worst = limit.worst();
    let shown = worst.map_or_else(String::new, error);
    let cells = vec![
        Cell::text(limit.name).linked(&format!("#{}", limit.name)),
        Cell::text(limit.driven),
        Cell::text(&promised(limit)),
        Cell::number(worst.map(|trial| trial.measured), |_| shown),
        Cell::number(Some(limit.allowed), |allowed| format!("{allowed:e}")),
        Cell::text(limit.last_good().map_or("–", |trial| &trial.setting)),
        Cell::text(limit.threshold().map_or("not reached", |trial| &trial.setting)),
        Cell::number(Some(limit.checked() as f64), count),
        Cell::number(Some(limit.seconds), seconds),
    ];
    (if limit.holds() { "" } else { "wrong" }.to_owned(), cells)
}

fn details(limit: &Limit) -> String {
    let item = |trial: &Trial| {
        let class = match (trial.holds(limit.allowed), trial.required) {
            (true, true) => "good",
            (true, false) => "good beyond",
            (false, true) => "broken",
            (false, false) => "limit beyond",
        };
        format!("<li class=\"{class}\">{} <small>{}</small></li>", escape(&trial.setting), escape(&error(trial)))
    };
    let trials: String = limit.trials.iter().map(item).collect();
    let notes: Vec<String> =
        [limit.measure, limit.remark, limit.reduced].into_iter().filter(|note| !note.is_empty()).map(escape).collect();
    format!(
        "<div class=\"row\" id=\"{0}\"><h3>{0} <small>{1}</small></h3>\n<ul class=\"trials\">{trials}</ul>\n<p>{2}</p></div>\n",
        escape(limit.name),
        escape(limit.driven),
        notes.join("; ")
    )
}
