//! Output: people read stderr, and programs read stdout.
//!
//! Only this module knows which text belongs to gs2e. Each call writes one line with every hidden
//! character shown (see [`gs2e_files::escape`]). So a name from outside cannot move the cursor, change a
//! title, or start a line of its own.

use super::{ExitKind, UserMessage, VerbError};
use gs2e_files::escape;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The two streams of a run.
pub struct ConsoleStreams {
    /// Results for programs.
    results: Box<dyn Write + Send>,
    /// Messages for people.
    notes: Box<dyn Write + Send>,
    /// True if these are the streams of the process, which may be a terminal.
    are_process: bool,
}

impl ConsoleStreams {
    /// The streams of the process.
    #[must_use]
    pub fn of_process() -> Self {
        let (results, notes) = (Box::new(io::stdout()), Box::new(io::stderr()));
        Self { results, notes, are_process: true }
    }

    /// Other streams: `results` in place of stdout, and `notes` in place of stderr.
    #[must_use]
    pub fn of(results: impl Write + Send + 'static, notes: impl Write + Send + 'static) -> Self {
        Self { results: Box::new(results), notes: Box::new(notes), are_process: false }
    }
}

impl std::fmt::Debug for ConsoleStreams {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ConsoleStreams").field("are_process", &self.are_process).finish_non_exhaustive()
    }
}

/// The streams, and the state of the results.
#[derive(Debug)]
struct WriterState {
    streams: ConsoleStreams,
    /// The first error of a write to the results. No result is written after it.
    lost: Option<io::Error>,
}

impl WriterState {
    /// Writes results, unless an earlier write failed.
    fn results(&mut self, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) {
        // A later result would hide the gap from the reader.
        if self.lost.is_none() {
            self.lost = write(&mut *self.streams.results).err();
        }
    }
}

/// The two streams, and what the user wants on them.
#[derive(Debug, Clone)]
pub(super) struct Console {
    pub(super) json: bool,
    pub(super) quiet: bool,
    writing: Arc<Mutex<WriterState>>,
}

impl Console {
    pub(super) fn new(streams: ConsoleStreams, json: bool, quiet: bool) -> Self {
        Self { json, quiet, writing: Arc::new(Mutex::new(WriterState { streams, lost: None })) }
    }

    /// The lock, even after a panic elsewhere: the error must still be reported.
    fn writing(&self) -> MutexGuard<'_, WriterState> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns true if a person watches the output.
    pub(super) fn is_live(&self) -> bool {
        !self.quiet && self.writing().streams.are_process && io::stderr().is_terminal()
    }

    /// A console for people only, for verbs that give programs a result in another form.
    pub(super) fn for_people(&self) -> Self {
        Self { json: false, ..self.clone() }
    }

    /// Prints a line for people, unless the user asked for quiet.
    pub(super) fn note(&self, line: &str) {
        if !self.quiet {
            self.note_always(line);
        }
    }

    /// Prints a line for people, even if the user asked for quiet.
    pub(super) fn note_always(&self, line: &str) {
        // If stderr is gone, there is no other place to report it.
        let _ = writeln!(self.writing().streams.notes, "{}", escape::line(line));
    }

    /// Prints a result for programs if the user asked for them: one JSON value on a line of stdout.
    pub(super) fn result(&self, value: &impl serde::Serialize) {
        if self.json {
            let text = serde_json::to_string(value);
            let text = text.expect("results hold no paths, and all else has a form in JSON");
            self.print(&escape::json(&text));
        }
    }

    /// Prints a line on stdout.
    pub(super) fn print(&self, line: &str) {
        self.writing().results(|out| writeln!(out, "{}", escape::line(line)));
    }

    /// Prints the lines of a text on stdout.
    pub(super) fn print_lines(&self, text: &str) {
        text.lines().for_each(|line| self.print(line));
    }

    /// Prints a text of this program, which ends in a line break, on stdout.
    pub(super) fn text(&self, text: &str) {
        self.writing().results(|out| write!(out, "{text}"));
    }

    /// Prints a message for people, even if the user asked for quiet, and for programs.
    pub(super) fn report(&self, message: &UserMessage) {
        self.result(&message.to_json());
        self.report_to_people(message);
    }

    /// Prints a message for people, even if the user asked for quiet.
    pub(super) fn report_to_people(&self, message: &UserMessage) {
        message.to_lines().iter().for_each(|line| self.note_always(line));
    }

    /// Prints the reason for the early end of a verb.
    pub(super) fn problem(&self, problem: &VerbError) {
        problem.to_json().iter().for_each(|fault| self.result(fault));
        problem.to_lines().iter().for_each(|line| self.note_always(line));
    }

    /// Prints the help or the version in the parser's own form, which holds no text from outside.
    pub(super) fn help(&self, help: &clap::Error) {
        let mut writing = self.writing();
        // The parser knows whether stdout is a terminal that shows styles.
        let own = writing.streams.are_process;
        writing.results(|out| if own { help.print() } else { write!(out, "{}", help.render()) });
    }

    /// Ends the results. Returns the exit kind of the program; `exit` is the one that the verb asks
    /// for.
    ///
    /// A reader that closed the pipe has read all it wants. Results lost for any other reason are
    /// an error, whatever the verdict in them, because a program would take the part for the whole.
    pub(super) fn finish(&self, exit: ExitKind) -> ExitKind {
        let lost = {
            let mut writing = self.writing();
            // The error of a buffered write may only appear here.
            writing.results(|out| out.flush());
            writing.lost.take()
        };
        match lost {
            Some(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                let message = UserMessage::error("results-lost", "failed to write results to stdout");
                self.report_to_people(&message.because(error));
                // A lost result does not turn an interrupt into a failure.
                if exit == ExitKind::Interrupted { exit } else { ExitKind::Failed }
            }
            _ => exit,
        }
    }
}

/// A path in a result for programs: see [`escape::path`].
pub(super) fn path(path: impl AsRef<Path>) -> String {
    escape::path(path.as_ref())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::sync::mpsc::{Sender, channel};

    /// A stream that can be read afterwards.
    struct CapturedStream(Sender<Vec<u8>>);

    impl Write for CapturedStream {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.send(bytes.to_vec()).unwrap();
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// A stream that refuses everything.
    struct Broken(io::ErrorKind);

    impl Write for Broken {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(self.0.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// The text that `act` writes to stdout and stderr.
    fn written(json: bool, act: impl FnOnce(&Console)) -> [String; 2] {
        let ((results, stdout), (notes, stderr)) = (channel(), channel());
        let console =
            Console::new(ConsoleStreams::of(CapturedStream(results), CapturedStream(notes)), json, false);
        act(&console);
        assert_eq!(console.finish(ExitKind::Done), ExitKind::Done);
        drop(console);
        [stdout, stderr].map(|kept| String::from_utf8(kept.iter().flatten().collect()).unwrap())
    }

    const WICKED: &str = "a\u{1b}[2J\nerror: FAKE\u{202e}";
    const VISIBLE: &str = r"a\u{1b}[2J\nerror: FAKE\u{202e}";

    #[test]
    fn no_text_leaves_its_line() {
        let message = UserMessage::error("x", WICKED).because(WICKED).help(WICKED);
        let [stdout, stderr] = written(false, |console| {
            console.note(WICKED);
            console.print(WICKED);
            console.report(&message);
        });
        assert_eq!(stdout, format!("{VISIBLE}\n"));
        assert_eq!(stderr, format!("{VISIBLE}\nerror: {VISIBLE}\n because {VISIBLE}\nhelp: {VISIBLE}\n"));
    }

    #[test]
    fn programs_get_the_value_itself_in_visible_characters() {
        let value = json!({ "path": WICKED, "c1": "\u{9b}31m\u{7f}" });
        let [stdout, _] = written(true, |console| {
            console.result(&value);
            console.result(&value);
        });
        assert!(stdout.chars().all(|c| c == '\n' || !escape::is_hidden(c)), "{stdout}");
        let read: Vec<serde_json::Value> = stdout.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!(read, [value.clone(), value]);
    }

    #[test]
    fn lost_results_are_an_error_but_a_reader_may_leave() {
        let ended = |kind, exit| {
            let (notes, stderr) = channel();
            let console = Console::new(ConsoleStreams::of(Broken(kind), CapturedStream(notes)), false, true);
            console.print("a result");
            console.print("another");
            let exit = console.finish(exit);
            drop(console);
            (exit, String::from_utf8(stderr.iter().flatten().collect()).unwrap())
        };
        for exit in [ExitKind::Done, ExitKind::Fault] {
            assert_eq!(ended(io::ErrorKind::BrokenPipe, exit), (exit, String::new()));
            let (end, said) = ended(io::ErrorKind::StorageFull, exit);
            assert_eq!(
                (end, said.matches("error: failed to write results").count()),
                (ExitKind::Failed, 1),
                "{said}"
            );
        }
        assert_eq!(ended(io::ErrorKind::StorageFull, ExitKind::Interrupted).0, ExitKind::Interrupted);
    }
}
