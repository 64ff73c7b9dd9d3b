//! A terminal that knows only the sequences that the program writes: every other byte of an output
//! must be text.

use vte::{Params, Parser, Perform};

/// Fails if an output to a file or a pipe holds an active character: a control character except the
/// line end, or a bidi control (the list of UAX 9).
pub(crate) fn judge(text: &str) {
    if let Some(c) = text.chars().find(|c| acts(*c) && *c != '\n') {
        panic!("{c:?} in {text:?}");
    }
    assert!(
        !text.lines().any(|line| line.starts_with("error: FAKE")),
        "a line of somebody else's in {text:?}"
    );
}

fn acts(c: char) -> bool {
    let bidi =
        "\u{61c}\u{200e}\u{200f}\u{202a}\u{202b}\u{202c}\u{202d}\u{202e}\u{2066}\u{2067}\u{2068}\u{2069}";
    c.is_control() || bidi.contains(c) || "\u{2028}\u{2029}".contains(c)
}

/// Fails if an output to a terminal holds more than text and progress bars.
pub(crate) fn judge_terminal(bytes: &[u8]) {
    let mut terminal = Terminal::default();
    Parser::new().advance(&mut terminal, bytes);
    assert!(terminal.faults.is_empty(), "{:?} in {:?}", terminal.faults, String::from_utf8_lossy(bytes));
    judge(&terminal.text);
}

/// Sequences of the bars: up and down, column 1, clear the line or everything below, hide and show
/// the cursor.
const BARS: [&str; 10] = ["1A", "1B", "2K", "K", "J", "0J", "1G", "G", "?25l", "?25h"];

#[derive(Default)]
struct Terminal {
    text: String,
    faults: Vec<String>,
}

impl Perform for Terminal {
    fn print(&mut self, c: char) {
        self.text.push(c);
    }

    fn execute(&mut self, byte: u8) {
        match byte {
            b'\n' => self.text.push('\n'),
            // The terminal driver adds it to each line end, and bars begin their line with it.
            b'\r' => {}
            byte => self.faults.push(format!("control {byte:#04x}")),
        }
    }

    fn csi_dispatch(&mut self, params: &Params, intermediates: &[u8], _: bool, action: char) {
        let numbers: Vec<String> = params.iter().map(|part| part[0].to_string()).collect();
        let private = String::from_utf8_lossy(intermediates);
        let sequence = format!("{private}{}{action}", numbers.join(";"));
        let up =
            private.is_empty() && numbers.len() == 1 && action == 'A' && params.iter().all(|p| p[0] <= 20);
        let known = BARS.contains(&sequence.as_str()) || BARS.contains(&sequence.trim_start_matches('0'));
        if !up && !known {
            self.faults.push(format!("CSI {sequence}"));
        }
    }

    fn esc_dispatch(&mut self, _: &[u8], _: bool, byte: u8) {
        self.faults.push(format!("ESC {}", char::from(byte)));
    }

    fn osc_dispatch(&mut self, _: &[&[u8]], _: bool) {
        self.faults.push("OSC".to_owned());
    }

    fn hook(&mut self, _: &Params, _: &[u8], _: bool, _: char) {
        self.faults.push("DCS".to_owned());
    }
}
