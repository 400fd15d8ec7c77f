//! Lines, statements and numbers of the text formats, OBJ and MTL above all.

use std::{borrow::Cow, mem, path::PathBuf};

use memchr::{memchr, memchr_iter, memchr2, memrchr};

use crate::parallel;

/// Where the bytes of text that is no UTF-8 stand among characters: byte `b` is the character `ESCAPES + b`. They are in a
/// plane for private use.
const ESCAPES: u32 = 0x0010_f700;

/// Text in any encoding that extends ASCII. Bytes that are no UTF-8 become characters of their own, so that names in other
/// encodings stay apart and [`file_name`] finds them.
pub(super) fn decode(bytes: &[u8]) -> Cow<'_, str> {
    if let Ok(text) = std::str::from_utf8(bytes) {
        return Cow::Borrowed(text);
    }
    let mut text = String::with_capacity(bytes.len());
    for chunk in bytes.utf8_chunks() {
        text += chunk.valid();
        text.extend(chunk.invalid().iter().filter_map(|byte| char::from_u32(ESCAPES + u32::from(*byte))));
    }
    Cow::Owned(text)
}

/// The byte that a character of [`decode`] stands for.
fn escaped(c: char) -> Option<u8> {
    u32::from(c).checked_sub(ESCAPES).filter(|byte| (0x80..0x100).contains(byte)).map(|byte| byte as u8)
}

/// A relative path as text files hold it, with either kind of slash, in the bytes that stand there.
pub(super) fn file_name(text: &str) -> PathBuf {
    let text = text.replace('\\', "/");
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStringExt;
        let mut bytes = Vec::with_capacity(text.len());
        for c in text.chars() {
            match escaped(c) {
                Some(byte) => bytes.push(byte),
                None => bytes.extend_from_slice(c.encode_utf8(&mut [0; 4]).as_bytes()),
            }
        }
        std::ffi::OsString::from_vec(bytes).into()
    }
    #[cfg(not(unix))]
    PathBuf::from(text)
}

/// What a file is that is given for text and is none, and what to do about it.
pub(super) fn foreign(bytes: &[u8]) -> Option<&'static str> {
    let starts_with = |text: &str| {
        let start = bytes.get(..text.len()).unwrap_or_default();
        start.eq_ignore_ascii_case(text.as_bytes())
    };
    match bytes {
        _ if starts_with("version https://git-lfs") => Some("a Git LFS pointer; fetch the file with `git lfs pull`"),
        _ if starts_with("<!doctype") || starts_with("<html") => Some("a web page; download the file itself"),
        [0x1f, 0x8b, ..] => Some("compressed by gzip; unpack it"),
        [b'P', b'K', 3, 4, ..] => Some("a ZIP archive; unpack it"),
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Some("UTF-16 text; save it as UTF-8"),
        _ if bytes.iter().take(1 << 10).any(|byte| *byte == 0) => Some("no text; export it anew"),
        _ => None,
    }
}

/// The statements of an OBJ or MTL text with their line numbers, counted from 1: trimmed, without
/// comments and empty lines, lines that end in a backslash joined with the next.
///
/// A comment begins at a `#` that opens a line or follows white space, so that names may hold one. Lines end in a line feed,
/// with or without a carriage return, or all in a carriage return.
pub(super) fn statements(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    Part::whole(text).statements()
}

/// A text, or whole lines of it that begin and end with statements.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part<'a> {
    text: &'a str,
    /// What its lines end in.
    line_end: u8,
    /// The number of its first line.
    first_line: usize,
}

impl<'a> Part<'a> {
    fn whole(text: &'a str) -> Self {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let line_end = if memchr(b'\n', text.as_bytes()).is_some() { b'\n' } else { b'\r' };
        Self { text, line_end, first_line: 1 }
    }

    /// The parts of a text, of about so many bytes each.
    pub fn split(text: &'a str, size: usize) -> Vec<Self> {
        let mut rest = Self::whole(text);
        let mut parts = Vec::new();
        while let Some(end) = rest.statement_end(size) {
            let (text, after) = rest.text.split_at(end);
            parts.push(Self { text, ..rest });
            rest.text = after;
        }
        parts.push(rest);
        let lines_of = |part: &Self| memchr_iter(part.line_end, part.text.as_bytes()).count();
        let lines = parallel::map(parts.len(), &|part| lines_of(&parts[part]));
        let mut first_line = 1;
        for (part, lines) in parts.iter_mut().zip(lines) {
            part.first_line = first_line;
            first_line += lines;
        }
        parts
    }

    /// The end of a statement that is not its last, so many bytes from its start or behind that.
    fn statement_end(&self, from: usize) -> Option<usize> {
        let bytes = self.text.as_bytes();
        let mut at = from;
        while let Some(length) = memchr(self.line_end, bytes.get(at..)?) {
            let end = at + length;
            let start = memrchr(self.line_end, &bytes[..end]).map_or(0, |end| end + 1);
            at = end + 1;
            // Behind a backslash the next line may belong to the statement.
            if !bytes[start..end].contains(&b'\\') {
                return Some(at);
            }
        }
        None
    }

    /// Its statements, as [`statements`] says.
    pub fn statements(self) -> impl Iterator<Item = (usize, Cow<'a, str>)> {
        let mut start = 0;
        let ends = memchr_iter(self.line_end, self.text.as_bytes()).chain([self.text.len()]);
        let lines = ends.map(move |end| &self.text[mem::replace(&mut start, end + 1)..end]);
        let mut lines = (self.first_line..).zip(lines);
        // As nearly all of a large file is.
        let is_plain = memchr2(b'#', b'\\', self.text.as_bytes()).is_none();
        std::iter::from_fn(move || {
            while let Some((number, line)) = lines.next() {
                if is_plain {
                    match line.trim() {
                        "" => continue,
                        line => return Some((number, Cow::Borrowed(line))),
                    }
                }
                let mut statement = Cow::Borrowed(without_comment(line).trim());
                while let Some(head) = statement.strip_suffix('\\') {
                    let tail = lines.next().map_or("", |(_, line)| without_comment(line));
                    statement = Cow::Owned(format!("{head} {}", tail.trim()));
                }
                if !statement.is_empty() {
                    return Some((number, statement));
                }
            }
            None
        })
    }
}

fn without_comment(line: &str) -> &str {
    let is_start = |at: usize| at == 0 || line[..at].ends_with(char::is_whitespace);
    let comment = line.match_indices('#').find(|&(at, _)| is_start(at));
    comment.map_or(line, |(at, _)| &line[..at])
}

/// Splits a statement into its keyword and the rest, both trimmed.
pub(super) fn keyword(statement: &str) -> (&str, &str) {
    let (keyword, rest) = statement.split_at(find_space(statement, true).unwrap_or(statement.len()));
    (keyword, rest.trim())
}

/// The words of a text, as `str::split_whitespace` has them, and faster where they are short and in ASCII.
pub(super) fn words(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = text;
    std::iter::from_fn(move || {
        let from_word = &rest[find_space(rest, false)?..];
        let (word, after) = from_word.split_at(find_space(from_word, true).unwrap_or(from_word.len()));
        rest = after;
        Some(word)
    })
}

/// The place of the first character that is white space, or of the first one that is none.
fn find_space(text: &str, is_space: bool) -> Option<usize> {
    for (place, byte) in text.bytes().enumerate() {
        if !byte.is_ascii() {
            let rest = text[place..].find(|c: char| c.is_whitespace() == is_space)?;
            return Some(place + rest);
        }
        if char::from(byte).is_whitespace() == is_space {
            return Some(place);
        }
    }
    None
}

/// A name with every run of white space made one blank, as it is compared everywhere.
pub(super) fn name(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A number, finite or not; the error says what was found instead.
pub(super) fn number(word: &str) -> Result<f64, String> {
    word.parse().or_else(|_| not_finite(word).ok_or_else(|| format!("`{}` is not a number", excerpt(word))))
}

/// What C libraries write for what is not finite and Rust does not read, as Microsoft's `1.#IND` and `-nan(ind)`.
fn not_finite(word: &str) -> Option<f64> {
    let word = word.trim_start_matches(['-', '+']).to_ascii_lowercase();
    let after_point = word.split_once(".#").map(|(_, rest)| rest);
    match after_point.unwrap_or(&word) {
        text if after_point.is_some() && text.starts_with("inf") => Some(f64::INFINITY),
        text if ["nan", "ind", "qnan", "snan"].iter().any(|nan| text.starts_with(nan)) => Some(f64::NAN),
        _ => None,
    }
}

/// The start of a word that may be long, for a message of one line.
pub(super) fn excerpt(word: &str) -> String {
    const SHOWN: usize = 40;
    match word.char_indices().nth(SHOWN) {
        Some((end, _)) => one_line(&word[..end]) + "...",
        None => one_line(word),
    }
}

/// Text made safe for a one-line message: control characters become blanks, and bytes that are no UTF-8 are shown as such.
pub(super) fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.trim_end().chars() {
        match escaped(c) {
            Some(byte) => line += &format!("\\x{byte:02X}"),
            None if c.is_control() || matches!(c, '\u{2028}' | '\u{2029}') => line.push(' '),
            None => line.push(c),
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_any_encoding_stay_apart_and_are_shown() {
        let [red, green] = [b"\xba\xec.png".as_slice(), b"\xc2\xcc.png"];
        assert_ne!(decode(red), decode(green));
        assert_eq!(one_line(&decode(red)), "\\xBA\\xEC.png");
        #[cfg(unix)]
        {
            use std::os::unix::ffi::OsStrExt;
            assert_eq!(file_name(&decode(red)).as_os_str().as_bytes(), red);
            let mixed = [b"a\\".as_slice(), "ü".as_bytes(), red].concat();
            assert_eq!(file_name(&decode(&mixed)).as_os_str().as_bytes(), [b"a/", "ü".as_bytes(), red].concat());
        }
        assert!(matches!(decode("größer".as_bytes()), Cow::Borrowed("größer")));
    }

    #[test]
    fn numbers_that_are_none_are_read_in_every_spelling() {
        for word in ["nan", "-nan(ind)", "nan(snan)", "1.#IND", "-1.#IND0000", "1.#QNAN"] {
            assert!(number(word).expect("it is read").is_nan(), "{word}");
        }
        for word in ["inf", "-1.#INF", "1.#INF00", "infinity"] {
            assert!(number(word).expect("it is read").is_infinite(), "{word}");
        }
        for word in ["", "-", "x", "1.#", "info.", "1,5", "1.#2"] {
            assert!(number(word).is_err(), "{word}");
        }
    }

    #[test]
    fn lines_end_in_each_of_three_ways() {
        for text in ["a 1\n\nb 2 # c\n", "a 1\r\n\r\nb 2 # c\r\n", "a 1\r\rb 2 # c\r", "a 1\n\nb 2"] {
            let found: Vec<_> = statements(text).map(|(line, text)| (line, text.into_owned())).collect();
            assert_eq!(found, [(1, "a 1".to_owned()), (3, "b 2".to_owned())], "{text:?}");
        }
    }

    #[test]
    fn parts_have_the_statements_of_the_whole() {
        let lines =
            ["v 1 2 3", "", "# a \\", "f 1 \\", " 2 \\", "", "\\", "\\\\", "g \u{feff}\u{e9} # b", "\\ # c", "a\\b"];
        for end in ["\n", "\r\n", "\r"] {
            for rotation in 0..lines.len() {
                let mut lines = lines;
                lines.rotate_left(rotation);
                let text = "\u{feff}".to_owned() + &lines.join(end);
                let whole: Vec<_> = statements(&text).collect();
                for size in 0..text.len() {
                    let parts: Vec<_> = Part::split(&text, size).into_iter().flat_map(Part::statements).collect();
                    assert_eq!(parts, whole, "{text:?} {size}");
                }
            }
        }
    }

    #[test]
    fn words_are_those_of_the_standard_library() {
        for text in
            ["", " ", "a", " a  bc ", "\u{a0}a\u{3000}b c\u{85}", "é\tü\u{b}x\u{c}", "\u{200b} 1\u{2028}2", "1\u{1c}2"]
        {
            assert!(words(text).eq(text.split_whitespace()), "{text:?}");
        }
        assert_eq!(keyword("v\u{3000} 1 2 "), ("v", "1 2"));
    }

    #[test]
    fn what_is_no_text_is_named() {
        for (bytes, what) in [
            (b"version https://git-lfs.github.com/spec/v1\n".as_slice(), "LFS"),
            (b"<!DOCTYPE html>", "web page"),
            (b"\x1f\x8b\x08", "gzip"),
            (b"\xff\xfev\x00 \x00", "UTF-16"),
            (b"solid\x00\x01", "no text"),
        ] {
            assert!(foreign(bytes).is_some_and(|text| text.contains(what)), "{what}");
        }
        assert_eq!(foreign(b"v 0 0 0\n"), None);
        assert_eq!(foreign(b""), None);
    }
}
