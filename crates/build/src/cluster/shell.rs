//! Words of a shell script that stand for exactly their bytes, and that a person can read.

use gs2e_files::escape::is_hidden;
use std::fmt::Write as _;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;

/// A word that a POSIX shell reads as these bytes. Characters that cannot be seen, and bytes that are not
/// UTF-8, are written as octal numbers for `printf`: a script can be printed and copied without changing it.
#[must_use]
pub(super) fn shell_word(word: &Path) -> String {
    let bytes = word.as_os_str().as_bytes();
    let is_plain = |b: &u8| b.is_ascii_alphanumeric() || b"-_./:=,+@%".contains(b);
    if !bytes.is_empty() && bytes.iter().all(is_plain) {
        return word.to_string_lossy().into_owned();
    }
    let mut quoted = ShellQuotes::default();
    for chunk in bytes.utf8_chunks() {
        for c in chunk.valid().chars() {
            // `$(…)` drops line breaks at its end.
            if c != '\n' && is_hidden(c) {
                quoted.escape(c.encode_utf8(&mut [0; 4]).as_bytes());
            } else {
                quoted.quote(c);
            }
        }
        quoted.escape(chunk.invalid());
    }
    quoted.end()
}

/// A word of parts in single quotes and parts that `printf` writes.
#[derive(Default)]
struct ShellQuotes {
    text: String,
    open: OpenQuote,
}

#[derive(Default, Clone, Copy, PartialEq, Eq)]
enum OpenQuote {
    #[default]
    Neither,
    Single,
    Printf,
}

impl ShellQuotes {
    fn quote(&mut self, c: char) {
        self.turn_to(OpenQuote::Single);
        // Nothing can be escaped inside single quotes: close them, write the quote, open them again.
        if c == '\'' { self.text.push_str("'\\''") } else { self.text.push(c) }
    }

    fn escape(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.turn_to(OpenQuote::Printf);
            let _ = write!(self.text, "\\{byte:03o}");
        }
    }

    fn turn_to(&mut self, next: OpenQuote) {
        if self.open == next {
            return;
        }
        self.text.push_str(match self.open {
            OpenQuote::Neither => "",
            OpenQuote::Single => "'",
            OpenQuote::Printf => "')\"",
        });
        self.text.push_str(match next {
            OpenQuote::Neither => "",
            OpenQuote::Single => "'",
            OpenQuote::Printf => "\"$(printf '",
        });
        self.open = next;
    }

    fn end(mut self) -> String {
        self.turn_to(OpenQuote::Neither);
        if self.text.is_empty() { "''".to_owned() } else { self.text }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;
    use std::process::Command;

    #[test]
    fn a_shell_reads_every_word_as_its_bytes() {
        let words: [&[u8]; 12] = [
            b"/lab/shared-2.0",
            b"",
            b"a b",
            b"it's $(touch x) `y` \\z \"",
            "a\u{ad}b \u{202e}gnp".as_bytes(),
            b"\xff\xfe/x",
            b"x\n",
            b"\n\x07\n",
            b"~",
            b"{a,b}",
            b"%s\\041",
            b"-n",
        ];
        for bytes in words {
            let word = shell_word(Path::new(OsStr::from_bytes(bytes)));
            assert!(word.chars().all(|c| c == '\n' || !is_hidden(c)), "{word}");
            let said = Command::new("sh").args(["-c", &format!("printf %s {word}")]).output().unwrap();
            assert_eq!(said.stdout, bytes, "{word}");
            // As the value of a variable, too.
            let set = format!("x={word}; printf %s \"$x\"");
            assert_eq!(Command::new("sh").args(["-c", &set]).output().unwrap().stdout, bytes, "{word}");
        }
    }
}
