//! Commands as text that a person can read and paste.

use crate::escape::is_hidden;
use std::path::Path;

/// Words in a form that can be pasted into a shell: quoted where a shell would read something else,
/// with control and invisible characters written as escapes.
#[must_use]
pub fn quoted<'a>(words: impl IntoIterator<Item = &'a Path>) -> String {
    words.into_iter().map(|word| quoted_word(&word.to_string_lossy())).collect::<Vec<_>>().join(" ")
}

fn quoted_word(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%{}".contains(c);
    // A shell expands braces that contain a comma or dots to several words.
    if !word.is_empty() && word.chars().all(is_plain) && !(word.contains('{') && word.contains([',', '.'])) {
        return word.to_owned();
    }
    let mut quoted = String::from("'");
    for c in word.chars() {
        match c {
            // Nothing can be escaped inside single quotes: close them, write the quote, open them
            // again.
            '\'' => quoted.push_str("'\\''"),
            c if is_hidden(c) => quoted.extend(c.escape_unicode()),
            c => quoted.push(c),
        }
    }
    quoted + "'"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_shown_as_a_shell_would_take_them_apart() {
        let t = |words: &[&str], wanted: &str| {
            assert_eq!(quoted(words.iter().map(Path::new)), wanted, "{words:?}");
        };
        t(&["opensplat", "-n", "30000", "{out}/scene"], "opensplat -n 30000 {out}/scene");
        t(&["a b", "", "$(touch x)", "it's"], r"'a b' '' '$(touch x)' 'it'\''s'");
        t(&["{a,b}", "{1..3}"], "'{a,b}' '{1..3}'");
        t(&["x\u{1b}[2Ky", "\u{202e}gnp"], r"'x\u{1b}[2Ky' '\u{202e}gnp'");
    }
}
