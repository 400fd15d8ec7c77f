//! What all pages have in common: head, heading, findings, provenance, style and script.

use serde_json::json;

use super::images::{EncodedImages, PageImages};
use super::svg::escape;
use crate::export::plain;
use crate::studies::Provenance;

const HEAD: &str = include_str!("head.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// Writes a page again and again; keeps encoded images from one time to the next.
#[derive(Debug, Default)]
pub struct Page {
    encoded: EncodedImages,
}

impl Page {
    /// A page whose images are multiplied by 2^`exposure_stops`.
    pub fn new(exposure_stops: f32) -> Self {
        Self { encoded: EncodedImages::new(exposure_stops) }
    }

    /// The images of the page, none yet.
    pub(super) fn images(&mut self) -> PageImages<'_> {
        PageImages::new(&mut self.encoded)
    }
}

/// A page without what all pages have.
pub struct Frame<'a> {
    /// The subcommand that makes it.
    pub command: &'a str,
    /// HTML of its title, behind the command; may be empty.
    pub title: &'a str,
    /// HTML of its heading.
    pub heading: &'a str,
    /// What to say of a study that was not finished.
    pub unfinished: Option<&'a str>,
    /// Sentences of HTML.
    pub findings: Vec<String>,
    /// CSS rules in addition to those of all pages.
    pub style: &'a str,
    /// The sections.
    pub main: String,
    /// Names and texts in addition to the provenance that all studies have.
    pub provenance: Vec<(String, String)>,
}

impl Frame<'_> {
    /// The page; its script shows the images of `uris`.
    pub fn html(self, provenance: &Provenance, uris: Vec<String>) -> String {
        let Self { command, title, heading, unfinished, findings, style, main, provenance: entries } = self;
        let title = if title.is_empty() { String::new() } else { format!(": {title}") };
        let place: Vec<String> = [&provenance.device, &provenance.driver, &provenance.date]
            .into_iter()
            .filter(|text| !text.is_empty())
            .map(|text| escape(text))
            .collect();
        let unfinished =
            unfinished.map_or_else(String::new, |text| format!("<p class=\"unfinished\" role=\"status\">{text}</p>\n"));
        let findings: String = findings.iter().map(|text| format!("<li>{text}</li>\n")).collect();
        // "</" would end the script element.
        let uris = json!(uris).to_string().replace("</", "<\\/");
        format!(
            "{HEAD}<title>raywave {command}{title}</title>\n<style>\n{STYLE}{style}</style>\n</head>\n<body>\n\
             <header>\n<div class=\"bar\"><p class=\"eyebrow\">raywave {command}</p>\
             <button type=\"button\" id=\"theme\" aria-label=\"Switch between light and dark\">◐</button></div>\n\
             <h1>{heading}</h1>\n<p class=\"place\">{place}</p>\n{unfinished}<ul class=\"findings\">\n{findings}</ul>\n</header>\n\
             <main>\n{main}{provenance}</main>\n\
             <script type=\"application/json\" id=\"image-uris\">{uris}</script>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n",
            place = place.join("<span> · </span>"),
            provenance = provenance_section(provenance, entries),
        )
    }
}

fn provenance_section(provenance: &Provenance, more: Vec<(String, String)>) -> String {
    let lanes = match provenance.subgroup_size_lanes {
        0 => String::new(),
        lanes => format!("{lanes} lanes"),
    };
    let common = [
        ("command", provenance.command_line.clone()),
        ("date", provenance.date.clone()),
        ("raywave", provenance.raywave_version.clone()),
        ("built by", provenance.rustc_version.clone()),
        ("device", format!("{} ({})", provenance.device, provenance.device_kind)),
        ("driver", provenance.driver.clone()),
        ("Vulkan", provenance.vulkan_version.clone()),
        ("subgroup", lanes),
        ("processor", provenance.cpu.as_ref().map_or_else(String::new, ToString::to_string)),
        ("clocks", provenance.clocks.clone().unwrap_or_else(|| "not reported".to_owned())),
    ]
    .map(|(name, text)| (name.to_owned(), text));
    let settings = provenance.settings.iter().map(|(key, value)| (key.clone(), plain(value)));
    let entry = |(name, text): (String, String)| {
        let text = if name == "command" { format!("<code>{}</code>", escape(&text)) } else { escape(&text) };
        format!("<dt>{}</dt><dd>{text}</dd>\n", escape(&name))
    };
    let entries = common.into_iter().chain(more).chain(settings);
    let entries: String = entries.filter(|(_, text)| !text.is_empty()).map(entry).collect();
    format!("<section id=\"provenance\"><h2>Provenance</h2>\n<dl>\n{entries}</dl></section>\n")
}

/// The entries of a plot's legend: the class of the colour and the name of each.
pub fn legend<'a>(entries: impl Iterator<Item = (String, &'a str)>) -> String {
    let entry = |(class, name): (String, &str)| format!("<li class=\"{class}\">{}</li>", escape(name));
    format!("<ul class=\"legend\">{}</ul>", entries.map(entry).collect::<String>())
}
