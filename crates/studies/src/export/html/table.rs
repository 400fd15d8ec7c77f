//! Tables that the reader can sort.

use super::svg::escape;

/// A cell: what is shown, and what it is sorted by.
pub struct Cell {
    html: String,
    key: String,
    class: &'static str,
}

impl Cell {
    /// Text, sorted as text.
    pub fn text(text: &str) -> Self {
        Self { html: escape(text), key: escape(text), class: "" }
    }

    /// A number, sorted by its value; without one, a dash that comes last.
    pub fn number(value: Option<f64>, show: impl FnOnce(f64) -> String) -> Self {
        match value.filter(|value| value.is_finite()) {
            Some(value) => Self { html: escape(&show(value)), key: value.to_string(), class: "n" },
            None => Self { html: "–".to_owned(), key: String::new(), class: "n" },
        }
    }

    /// HTML, sorted by `key`.
    pub fn html(html: String, key: &str) -> Self {
        Self { html, key: escape(key), class: "" }
    }

    /// The interval of the number, next to it and smaller. Without one its place stays empty, so that
    /// the numbers of a column stand below each other.
    pub fn with_interval(mut self, interval: Option<String>) -> Self {
        self.html += &match interval {
            Some(interval) => format!(" <small>{}</small>", escape(&interval)),
            None => " <small class=\"unseen\">0.000–0.000</small>".to_owned(),
        };
        self
    }

    /// A link to a place of the page, if there is a value.
    pub fn linked(mut self, place: &str) -> Self {
        if !self.key.is_empty() {
            self.html = format!("<a href=\"{place}\">{}</a>", self.html);
        }
        self
    }
}

/// A table. Columns have a heading and perhaps a unit.
pub fn table(caption: &str, columns: &[(String, &str)], rows: &[(String, Vec<Cell>)]) -> String {
    let heading = |(i, (name, unit)): (usize, &(String, &str))| {
        let unit = format!("<small>{}</small>", escape(unit));
        let class = if rows.first().is_some_and(|(_, cells)| cells[i].class == "n") { " class=\"n\"" } else { "" };
        format!("<th scope=\"col\"{class}><button type=\"button\">{}{unit}</button></th>", escape(name))
    };
    let head: String = columns.iter().enumerate().map(heading).collect();
    let cell = |cell: &Cell| format!("<td class=\"{}\" data-key=\"{}\">{}</td>", cell.class, cell.key, cell.html);
    let row = |(class, cells): &(String, Vec<Cell>)| {
        format!("<tr class=\"{class}\">{}</tr>\n", cells.iter().map(cell).collect::<String>())
    };
    let body: String = rows.iter().map(row).collect();
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{0}\"><table class=\"sortable\"><caption>{0}</caption>\
         <thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>\n",
        escape(caption)
    )
}
