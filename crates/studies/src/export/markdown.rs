//! Markdown, for issues, notes and commits.

use serde_json::Value;

use super::plain;
use crate::studies::Provenance;

/// A title and where a study comes from.
pub fn head(command: &str, provenance: &Provenance) -> String {
    let mut text = format!(
        "# raywave {command}\n\n{}, {}; raywave {}, built by {}; {}\n\n",
        escape(&provenance.device),
        escape(&provenance.driver),
        provenance.raywave_version,
        escape(&provenance.rustc_version),
        provenance.date,
    );
    if let Some(cpu) = &provenance.cpu {
        text += &format!("Processor: {}\n\n", escape(&cpu.to_string()));
    }
    if let Some(clocks) = &provenance.clocks {
        text += &format!("Clocks: {}\n\n", escape(clocks));
    }
    if !provenance.command_line.is_empty() {
        text += &format!("    {}\n\n", provenance.command_line.replace('\n', " "));
    }
    if !provenance.settings.is_empty() {
        let setting = |(key, value): (&String, &Value)| format!("{} {}", escape(key), escape(&plain(value)));
        let settings: Vec<String> = provenance.settings.iter().map(setting).collect();
        text += &format!("In all of it: {}\n\n", settings.join(", "));
    }
    text
}

/// Text that Markdown leaves alone, in tables too.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '\n' | '\r' => escaped.push(' '),
            '\\' | '|' | '*' | '_' | '`' | '<' | '[' | ']' => escaped.extend(['\\', character]),
            _ => escaped.push(character),
        }
    }
    escaped
}
