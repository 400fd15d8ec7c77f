//! Lines, statements and numbers of the text formats, OBJ and MTL above all.

use std::borrow::Cow;

/// The statements of an OBJ or MTL text with their line numbers, counted from 1: trimmed, without
/// comments and empty lines, lines that end in a backslash joined with the next.
///
/// A comment begins at a `#` that opens a line or follows white space, so that names may hold one.
pub(super) fn statements(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        while let Some((index, line)) = lines.next() {
            let mut statement = Cow::Borrowed(without_comment(line).trim());
            while let Some(head) = statement.strip_suffix('\\') {
                let tail = lines.next().map_or("", |(_, line)| without_comment(line));
                statement = Cow::Owned(format!("{head} {}", tail.trim()));
            }
            if !statement.is_empty() {
                return Some((index + 1, statement));
            }
        }
        None
    })
}

fn without_comment(line: &str) -> &str {
    let is_start = |at: usize| at == 0 || line[..at].ends_with(char::is_whitespace);
    let comment = line.match_indices('#').find(|&(at, _)| is_start(at));
    comment.map_or(line, |(at, _)| &line[..at])
}

/// Splits a statement into its keyword and the rest, both trimmed.
pub(super) fn keyword(statement: &str) -> (&str, &str) {
    let (keyword, rest) = statement.split_once(char::is_whitespace).unwrap_or((statement, ""));
    (keyword, rest.trim())
}

/// A name with every run of white space made one blank, as it is compared everywhere.
pub(super) fn name(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A number, finite or not; the error says what was found instead.
pub(super) fn number(word: &str) -> Result<f64, String> {
    word.parse().map_err(|_| format!("`{}` is not a number", excerpt(word)))
}

/// The start of a word that may be long, for a message.
pub(super) fn excerpt(word: &str) -> String {
    const SHOWN: usize = 40;
    match word.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}...", &word[..end]),
        None => word.to_owned(),
    }
}

/// Text made safe for a one-line message: control characters become blanks.
pub(super) fn one_line(text: &str) -> String {
    text.trim_end().replace(|c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}'), " ")
}
