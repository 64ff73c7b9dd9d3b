//! Visible forms of text from outside: names, paths and messages that strangers chose must not act
//! on the program that shows them.
//!
//! A terminal obeys control characters, a page reorders text at a bidi control, and an invisible
//! character makes two names look alike. Each function here replaces these characters by a visible
//! form, and nothing else. Backslashes stay single: the visible form is for reading, and cannot be
//! parsed back.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;

/// Returns true if a character acts on its reader instead of being seen: control characters (C0,
/// DEL, C1), bidi controls, line and paragraph separators, tags, other characters without width,
/// and noncharacters.
///
/// The zero-width joiner and non-joiner (U+200C, U+200D) are not hidden: Persian, Hindi and emoji
/// need them.
#[must_use]
pub fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{ad}'
                | '\u{61c}'
                | '\u{180e}'
                | '\u{200b}'
                | '\u{200e}'
                | '\u{200f}'
                | '\u{2028}'..='\u{202e}'
                | '\u{2060}'..='\u{206f}'
                | '\u{feff}'
                | '\u{fff9}'..='\u{fffb}'
                | '\u{e0000}'..='\u{e007f}'
        )
        || is_noncharacter(c)
}

/// Returns true for a noncharacter: the last two code points of a plane (U+FFFE, U+FFFF, U+1FFFE, …),
/// and U+FDD0 to U+FDEF. Unicode will never assign them, and many parsers refuse them.
#[must_use]
pub(crate) fn is_noncharacter(c: char) -> bool {
    u32::from(c) & 0xfffe == 0xfffe || matches!(c, '\u{fdd0}'..='\u{fdef}')
}

/// The text on one line: `\n`, `\r`, `\t`, and `\u{1b}` in place of other hidden characters.
#[must_use]
pub fn line(text: &str) -> Cow<'_, str> {
    replaced(text, is_hidden, |c, out| match c {
        '\n' => out.push_str("\\n"),
        '\r' => out.push_str("\\r"),
        '\t' => out.push_str("\\t"),
        c => out.extend(c.escape_unicode()),
    })
}

/// A path as text, with `\xff` in place of each byte that is not UTF-8. Hidden characters stay.
#[must_use]
pub fn path(path: &Path) -> String {
    let bytes = path.as_os_str().as_bytes();
    bytes.utf8_chunks().fold(String::with_capacity(bytes.len()), |mut text, chunk| {
        text.push_str(chunk.valid());
        // U+FFFD would give different names the same text.
        for byte in chunk.invalid() {
            put(&mut text, format_args!("\\x{byte:02x}"));
        }
        text
    })
}

/// Serialised JSON that shows every hidden character. Strings contain `\u009b` in place of the
/// character itself, which is the same value. Line breaks between values stay.
#[must_use]
pub fn json(serialised: &str) -> Cow<'_, str> {
    let shown = |c| is_hidden(c) && c != '\n';
    replaced(serialised, shown, |c, out| {
        // JSON escapes name UTF-16 units; a character above U+FFFF needs a surrogate pair.
        for unit in c.encode_utf16(&mut [0; 2]) {
            put(out, format_args!("\\u{unit:04x}"));
        }
    })
}

/// The text between double quotes, in a form that both YAML and TOML parse to the same text.
#[must_use]
pub fn quoted(text: &str) -> String {
    let special = |c| is_hidden(c) || c == '"' || c == '\\';
    let inside = replaced(text, special, |c, out| match c {
        '"' | '\\' => out.extend(['\\', c]),
        '\n' => out.push_str("\\n"),
        '\r' => out.push_str("\\r"),
        '\t' => out.push_str("\\t"),
        // Unlike JSON, neither language joins surrogates.
        c if u32::from(c) > 0xffff => put(out, format_args!("\\U{:08x}", u32::from(c))),
        c => put(out, format_args!("\\u{:04x}", u32::from(c))),
    });
    format!("\"{inside}\"")
}

/// The text with `instead` of each character that `is_special`.
fn replaced(
    text: &str,
    is_special: impl Fn(char) -> bool,
    instead: impl Fn(char, &mut String),
) -> Cow<'_, str> {
    // Most text has nothing to replace, and is not copied.
    if !text.contains(&is_special) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_special(c) { instead(c, &mut out) } else { out.push(c) }
    }
    Cow::Owned(out)
}

fn put(out: &mut String, what: std::fmt::Arguments<'_>) {
    out.write_fmt(what).expect("a String takes any text");
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;

    #[test]
    fn a_line_shows_all_that_would_act() {
        let t = |text: &str, wanted: &str| assert_eq!(line(text), wanted);
        t("räume/a b (1).ply", "räume/a b (1).ply");
        t("\u{1b}[31mX\nerror: FAKE\r\u{9b}2J\u{7f}", r"\u{1b}[31mX\nerror: FAKE\r\u{9b}2J\u{7f}");
        t("\u{202e}gnp.\u{2066}\u{200f}\u{61c}", r"\u{202e}gnp.\u{2066}\u{200f}\u{61c}");
        t("a\u{2028}b\u{2029}c\u{200b}d\u{feff}\u{e0041}", r"a\u{2028}b\u{2029}c\u{200b}d\u{feff}\u{e0041}");
        t("می\u{200c}خواهم 👩\u{200d}🔬", "می\u{200c}خواهم 👩\u{200d}🔬");
        assert!(matches!(line("plain"), Cow::Borrowed(_)));
    }

    #[test]
    fn paths_name_bytes_that_are_no_text() {
        let of = |bytes: &[u8]| path(Path::new(OsStr::from_bytes(bytes)));
        assert_eq!(of(b"x\xff/.gs2e"), r"x\xff/.gs2e");
        assert_eq!(of("é\u{1b}".as_bytes()), "é\u{1b}");
        assert_eq!(of(b"\xe2\x82"), r"\xe2\x82");
    }

    #[test]
    fn json_keeps_its_value() {
        let value = serde_json::json!({ "a\u{7f}": ["\u{9b}31m \u{202e}", "\u{e0041} \u{1b} \" \\ é"] });
        let text = value.to_string();
        let shown = json(&text);
        assert!(!shown.contains(is_hidden), "{shown}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).unwrap(), value);
    }

    /// YAML is read by the recipes' own parser. TOML has no reader here, and the same escapes (TOML
    /// 1.0, strings).
    #[test]
    fn quoted_text_is_read_back() {
        for text in ["", "a \"lab\" \\ 1", "x\u{7f}\u{9b}\n\r\t\u{85}\u{2028}\u{feff}", "\u{e0041}\u{ffff}"] {
            let quoted = quoted(text);
            assert!(!quoted.contains(is_hidden), "{quoted}");
            assert_eq!(serde_saphyr::from_str::<String>(&quoted).unwrap(), text, "{quoted}");
        }
    }
}
