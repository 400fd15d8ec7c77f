//! The README's table of settings.

use super::{SETTINGS, Setting, Settings, Value, Values};

/// A row of Markdown for each setting: its flag, what it is with what its names mean, and what is taken without it.
pub fn markdown_rows() -> String {
    SETTINGS.iter().map(row).collect()
}

fn row(setting: &Setting) -> String {
    let otherwise = (setting.get)(&Settings::default());
    let flag = match otherwise {
        Value::Switch(false) => format!("--{}", setting.flag),
        Value::Switch(true) => format!("--{} off", setting.flag),
        _ => format!("--{} {}", setting.flag, setting.placeholder),
    };
    let mut meaning = uncapitalised(setting.help);
    if let Values::Names(names) = setting.values {
        let names: Vec<String> =
            names().iter().map(|name| format!("`{}`: {}", name.name, uncapitalised(&name.meaning))).collect();
        meaning += &format!("; {}", names.join("; "));
    }
    if !setting.more.is_empty() {
        meaning += &format!("; {}", setting.more);
    }
    let otherwise = match otherwise {
        _ if !setting.otherwise.is_empty() => setting.otherwise.to_owned(),
        value if setting.of_scene => format!("the scene's, which is {} where it says nothing", code(&value)),
        value => code(&value),
    };
    format!("| `{flag}` | {meaning} | {otherwise} |\n")
}

/// Names as code, numbers as they are.
fn code(value: &Value) -> String {
    match value {
        Value::Name(_) | Value::Switch(true) => format!("`{value}`"),
        _ => value.to_string(),
    }
}

/// The text as it stands in the middle of a sentence: only a word that is a name keeps its capitals.
fn uncapitalised(text: &str) -> String {
    let mut characters = text.chars();
    let first = characters.next().into_iter();
    let is_name = text.chars().nth(1).is_some_and(char::is_uppercase) || text.starts_with("Russian");
    if is_name { text.to_owned() } else { first.flat_map(char::to_lowercase).chain(characters).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEGIN: &str = "<!-- settings: written by `RAYWAVE_WRITE_README=1 cargo test --release settings` -->\n";
    const END: &str = "<!-- end of settings -->\n";

    #[test]
    fn the_readme_has_the_table_of_settings() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/README.md");
        let readme = std::fs::read_to_string(path).expect("there is a README");
        let begin = readme.find(BEGIN).expect("the README marks where the settings begin") + BEGIN.len();
        let end = begin + readme[begin..].find(END).expect("and where they end");
        let head = "| setting of `render` | meaning | without it |\n|---|---|---|\n";
        let table = format!("{head}{}", markdown_rows());
        if std::env::var_os("RAYWAVE_WRITE_README").is_some() {
            let written = format!("{}{table}{}", &readme[..begin], &readme[end..]);
            std::fs::write(path, written).expect("the README is written");
        } else {
            assert_eq!(readme[begin..end], table, "write it anew as its mark says");
        }
    }

    #[test]
    fn the_readme_names_what_can_be_varied() {
        let readme = include_str!("../../README.md");
        let row = readme.lines().find(|line| line.starts_with("| `--vary")).expect("a row of `compare`");
        for setting in Setting::factors() {
            assert!(
                row.contains(&format!("`{}`", setting.flag)),
                "`{}` can be varied, and the README is silent",
                setting.flag
            );
        }
    }
}
