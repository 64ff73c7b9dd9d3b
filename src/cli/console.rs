//! Where text goes: people read stderr, programs read stdout.
//!
//! The one place that knows which text is ours: each call writes one line, in which everything hidden (see
//! [`crate::escape`]) is shown. So no name from outside moves the cursor, changes a title, or starts a line of its own.

use super::message::{MessageLevel, UserMessage};
use super::problem::{ExitKind, VerbError};
use crate::escape;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The two streams of a run.
pub struct ConsoleStreams {
    /// For programs.
    results: Box<dyn Write + Send>,
    /// For people.
    notes: Box<dyn Write + Send>,
    /// True if these are the streams of the process, which may be a terminal.
    are_process: bool,
}

impl ConsoleStreams {
    /// Those of the process.
    #[must_use]
    pub fn of_process() -> Self {
        let (results, notes) = (Box::new(io::stdout()), Box::new(io::stderr()));
        Self { results, notes, are_process: true }
    }

    /// Others: what is written to `results` is what a process writes to stdout, and `notes` its stderr.
    #[must_use]
    pub fn of(results: impl Write + Send + 'static, notes: impl Write + Send + 'static) -> Self {
        Self { results: Box::new(results), notes: Box::new(notes), are_process: false }
    }
}

impl std::fmt::Debug for ConsoleStreams {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Streams").field("are_process", &self.are_process).finish_non_exhaustive()
    }
}

/// The streams, and how the results fared.
#[derive(Debug)]
struct WriterState {
    streams: ConsoleStreams,
    /// The first error of the results, after which none is written.
    lost: Option<io::Error>,
}

impl WriterState {
    /// Writes results, unless an earlier write failed.
    fn results(&mut self, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) {
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

    /// A lock that a panic elsewhere does not take away: what went wrong must still be said.
    fn writing(&self) -> MutexGuard<'_, WriterState> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns true if a person watches.
    pub(super) fn is_live(&self) -> bool {
        !self.quiet && self.writing().streams.are_process && io::stderr().is_terminal()
    }

    /// The same for people only, where what programs get has its own form.
    pub(super) fn for_people(&self) -> Self {
        Self { json: false, ..self.clone() }
    }

    /// A line for people, unless they want none.
    pub(super) fn say(&self, line: &str) {
        if !self.quiet {
            self.insist(line);
        }
    }

    /// A line for people, whatever they want.
    pub(super) fn insist(&self, line: &str) {
        // Where stderr is gone, no other place is left to say so.
        let _ = writeln!(self.writing().streams.notes, "{}", escape::line(line));
    }

    /// A result for programs: one JSON value on a line of stdout.
    pub(super) fn result(&self, value: &serde_json::Value) {
        self.print(&escape::json(&value.to_string()));
    }

    /// A result of many parts, without a value of the whole.
    pub(super) fn large_result(&self, value: &impl serde::Serialize) {
        let text =
            serde_json::to_string(value).expect("results hold no paths, and all else has a form in JSON");
        self.print(&escape::json(&text));
    }

    /// A line of stdout.
    pub(super) fn print(&self, line: &str) {
        self.writing().results(|out| writeln!(out, "{}", escape::line(line)));
    }

    /// A message for people, whatever they want, and for programs.
    pub(super) fn tell(&self, message: &UserMessage) {
        if self.json {
            self.result(&message.to_json());
        }
        self.show(message);
    }

    /// A message for people, whatever they want.
    pub(super) fn show(&self, message: &UserMessage) {
        message.to_lines().iter().for_each(|line| self.insist(line));
    }

    /// Why the verb ends early.
    pub(super) fn problem(&self, problem: &VerbError) {
        if self.json {
            problem.to_json().iter().for_each(|fault| self.result(fault));
        }
        problem.to_lines().iter().for_each(|line| self.insist(line));
    }

    /// Help or version, in the parser's own form. Nothing in it comes from outside.
    pub(super) fn help(&self, help: &clap::Error) {
        let mut writing = self.writing();
        // The parser knows whether stdout is a terminal that shows styles.
        let own = writing.streams.are_process;
        writing.results(|out| if own { help.print() } else { write!(out, "{}", help.render()) });
    }

    /// Ends the results: how the program ends, where the verb would have it end with `exit`.
    ///
    /// A reader that closed the pipe has read all it wants. Results that were lost for any other reason are an error,
    /// whatever the verdict in them, since a program would take the part for the whole.
    pub(super) fn finish(&self, exit: ExitKind) -> ExitKind {
        let lost = {
            let mut writing = self.writing();
            writing.results(|out| out.flush());
            writing.lost.take()
        };
        match lost {
            Some(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                let message = UserMessage::new(
                    MessageLevel::Error,
                    "results-lost",
                    "failed to write results to stdout",
                );
                self.show(&message.because(error.to_string()));
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
    struct Kept(Sender<Vec<u8>>);

    impl Write for Kept {
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

    /// What `say` writes to stdout and stderr.
    fn written(json: bool, say: impl FnOnce(&Console)) -> [String; 2] {
        let ((results, stdout), (notes, stderr)) = (channel(), channel());
        let console = Console::new(ConsoleStreams::of(Kept(results), Kept(notes)), json, false);
        say(&console);
        assert_eq!(console.finish(ExitKind::Done), ExitKind::Done);
        drop(console);
        [stdout, stderr].map(|kept| String::from_utf8(kept.iter().flatten().collect()).unwrap())
    }

    const WICKED: &str = "a\u{1b}[2J\nerror: FAKE\u{202e}";
    const SHOWN: &str = r"a\u{1b}[2J\nerror: FAKE\u{202e}";

    #[test]
    fn no_text_leaves_its_line() {
        let message = UserMessage::new(MessageLevel::Error, "x", WICKED).because(WICKED).help(WICKED);
        let [stdout, stderr] = written(false, |console| {
            console.say(WICKED);
            console.print(WICKED);
            console.tell(&message);
        });
        assert_eq!(stdout, format!("{SHOWN}\n"));
        assert_eq!(stderr, format!("{SHOWN}\nerror: {SHOWN}\n because {SHOWN}\nhelp: {SHOWN}\n"));
    }

    #[test]
    fn programs_get_the_value_itself_in_visible_characters() {
        let value = json!({ "path": WICKED, "c1": "\u{9b}31m\u{7f}" });
        let [stdout, _] = written(true, |console| {
            console.result(&value);
            console.large_result(&value);
        });
        assert!(stdout.chars().all(|c| c == '\n' || !escape::is_hidden(c)), "{stdout}");
        let read: Vec<serde_json::Value> = stdout.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!(read, [value.clone(), value]);
    }

    #[test]
    fn lost_results_are_an_error_but_a_reader_may_leave() {
        let ended = |kind, exit| {
            let (notes, stderr) = channel();
            let console = Console::new(ConsoleStreams::of(Broken(kind), Kept(notes)), false, true);
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
