//! The page of an operating envelope.

use super::super::envelope::{error, promised, summary};
use super::super::numbers::{count, seconds};
use super::super::{EnvelopeDocument, plain};
use super::svg::escape;
use super::table::{Cell, table};
use super::{HEAD, SCRIPT, STYLE};
use crate::studies::Row;

/// Every setting is a cell: right, wrong, or wrong where nothing is promised.
const TRIALS: &str = ".trials { display: flex; flex-wrap: wrap; gap: 0.35rem; margin: 0.6rem 0 0.3rem; padding: 0; list-style: none; font-size: 0.85rem; }
.trials li { padding: 0.25rem 0.55rem; border: 1px solid var(--hair); border-left: 4px solid var(--k3); border-radius: 4px; background: var(--panel); }
.trials li.beyond { border-style: dashed; border-left-style: solid; }
.trials li.limit { border-left-color: var(--slower); }
.trials li.broken { border-left-color: var(--bad); font-weight: 600; }
.row p { margin: 0.2rem 0; color: var(--soft); font-size: 0.9rem; max-width: 56rem; }
";

pub fn page(document: &EnvelopeDocument<'_>) -> String {
    let EnvelopeDocument { provenance, envelope } = document;
    let columns = ["row", "driven", "promised", "worst", "allowed", "holds to", "fails at", "looked at", "time"];
    let columns: Vec<(String, &str)> = columns.iter().map(|name| ((*name).to_owned(), "")).collect();
    let rows: Vec<(String, Vec<Cell>)> = envelope.rows.iter().map(cells).collect();
    let details: String = envelope.rows.iter().map(details).collect();
    let place: Vec<String> = [&provenance.device, &provenance.driver, &provenance.date]
        .into_iter()
        .filter(|text| !text.is_empty())
        .map(|text| escape(text))
        .collect();
    let mut entries = vec![
        ("command", provenance.command_line.clone()),
        ("raywave", provenance.raywave_version.clone()),
        ("built by", provenance.rustc_version.clone()),
        ("level", envelope.level.clone()),
        ("processor", provenance.cpu.as_ref().map_or_else(String::new, ToString::to_string)),
    ];
    entries.extend(provenance.settings.iter().map(|(key, value)| (key.as_str(), plain(value))));
    let entries: String = entries
        .into_iter()
        .filter(|(_, text)| !text.is_empty())
        .map(|(name, text)| format!("<dt>{}</dt><dd>{}</dd>\n", escape(name), escape(&text)))
        .collect();
    format!(
        "{HEAD}<title>raywave stability</title>\n<style>\n{STYLE}{TRIALS}</style>\n</head>\n<body>\n\
         <header>\n<div class=\"bar\"><p class=\"eyebrow\">raywave stability</p>\
         <button type=\"button\" id=\"theme\" aria-label=\"Switch between light and dark\">◐</button></div>\n\
         <h1>Operating envelope</h1>\n<p class=\"place\">{}</p>\n<ul class=\"findings\"><li>{}</li></ul>\n</header>\n<main>\n\
         <section id=\"rows\"><h2>Limits</h2>\n{}</section>\n\
         <section id=\"settings\"><h2>Every setting</h2>\n<p>Solid frames are promised, dashed ones look for the place where \
         it fails.</p>\n{details}</section>\n\
         <section id=\"provenance\"><h2>Provenance</h2>\n<dl>\n{entries}</dl></section>\n</main>\n\
         <script type=\"application/json\" id=\"pictures\">[]</script>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n",
        place.join("<span> · </span>"),
        escape(&summary(envelope)),
        table("Limits of all rows", &columns, &rows),
    )
}

fn cells(row: &Row) -> (String, Vec<Cell>) {
    let worst = row.worst();
    let shown = worst.map_or_else(String::new, error);
    let cells = vec![
        Cell::text(row.name).linked(&format!("#{}", row.name)),
        Cell::text(row.driven),
        Cell::text(&promised(row)),
        Cell::number(worst.map(|trial| trial.measured), |_| shown),
        Cell::number(Some(row.allowed), |allowed| format!("{allowed:e}")),
        Cell::text(row.last_good().map_or("–", |trial| &trial.setting)),
        Cell::text(row.threshold().map_or("not reached", |trial| &trial.setting)),
        Cell::number(Some(row.checked() as f64), count),
        Cell::number(Some(row.seconds), seconds),
    ];
    (if row.holds() { "" } else { "wrong" }.to_owned(), cells)
}

fn details(row: &Row) -> String {
    let item = |trial: &crate::studies::Trial| {
        let class = match (trial.holds(row.allowed), trial.required) {
            (true, true) => "good",
            (true, false) => "good beyond",
            (false, true) => "broken",
            (false, false) => "limit beyond",
        };
        format!("<li class=\"{class}\">{} <small>{}</small></li>", escape(&trial.setting), escape(&error(trial)))
    };
    let trials: String = row.trials.iter().map(item).collect();
    let notes: Vec<String> =
        [row.measure, row.remark, row.reduced].into_iter().filter(|note| !note.is_empty()).map(escape).collect();
    format!(
        "<div class=\"row\" id=\"{0}\"><h3>{0} <small>{1}</small></h3>\n<ul class=\"trials\">{trials}</ul>\n<p>{2}</p></div>\n",
        escape(row.name),
        escape(row.driven),
        notes.join("; ")
    )
}
