//! Small files that ask for much memory, given to the program as users run it.
//!
//! `cargo xtask bombs [--program FILE] [NAME]...` makes the files, runs the program on each, and
//! prints a table: bytes of the input, exit code, and peak of resident memory. A bomb fails if a
//! signal or a panic ends the program, if the program accepts an input that it should refuse, if it
//! runs for too long, or if its peak is above 64 MB plus four times the input (96 MB plus four
//! times the input where the input is read). `--program` runs another build, for comparison; then
//! no bomb fails.
#![expect(clippy::unwrap_used, reason = "a harness that cannot go on panics")]

mod events;
mod inputs;
mod peak;
mod pictures;
mod recordings;
mod release;
mod scenes;

use peak::Run;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Bytes that a refused input may take: a fixed amount, plus an amount for each byte of the input.
const FREE: u64 = 64_000_000;
const PER_BYTE: u64 = 4;
/// The fixed amount of an input that is read: the output is written in batches.
const FREE_TO_READ: u64 = 96_000_000;

/// The required outcome of a bomb.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fate {
    /// An error: exit code 1, 2 or 3.
    Refused,
    /// The input is read in bounded memory.
    Read,
}

/// One bomb.
#[derive(Clone, Copy)]
struct Bomb {
    name: &'static str,
    /// The file's claim, as the table shows it.
    what: &'static str,
    /// Arguments of the program, separated by spaces. It runs in the bomb's folder.
    args: &'static str,
    fate: Fate,
    /// Makes the files in a folder, with a sound program's help.
    make: fn(&Place),
}

/// The folder of a bomb, and the program that makes its sound parts.
struct Place {
    folder: tempfile::TempDir,
    program: PathBuf,
}

impl Place {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }

    /// Runs the program, which must succeed.
    fn ok(&self, args: &str) {
        let run = Run::of(&self.program, args, self.folder.path());
        assert!(run.code == Some(0), "gs2e {args}: {}", run.stderr);
    }

    /// Total size of all files, bytes.
    fn size(&self) -> u64 {
        let entries = walkdir::WalkDir::new(self.folder.path()).into_iter().map(Result::unwrap);
        entries.filter(|entry| entry.file_type().is_file()).map(|entry| entry.metadata().unwrap().len()).sum()
    }
}

fn main() -> ExitCode {
    let own = PathBuf::from(env!("CARGO_BIN_EXE_gs2e"));
    let (mut program, mut names) = (own.clone(), Vec::new());
    let mut args = std::env::args().skip(1).peekable();
    if args.next_if(|arg| arg == peak::METER).is_some() {
        return peak::meter(args);
    }
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--program" => program = std::path::absolute(args.next().unwrap()).unwrap(),
            // `cargo test` passes these to every binary.
            flag if flag.starts_with('-') => {}
            name => names.push(name.to_owned()),
        }
    }
    let judged = program == own;
    let events = [events::BOMBS, recordings::BOMBS].concat();
    let bombs = [pictures::BOMBS, scenes::BOMBS, &events, inputs::BOMBS, release::BOMBS].concat();
    let chosen = bombs.iter().filter(|b| names.is_empty() || names.iter().any(|name| b.name.contains(name)));
    say("| bomb | what it claims | input | exit | peak | allowed |\n|---|---|---|---|---|---|");
    let mut failures = Vec::new();
    for bomb in chosen {
        let fault = detonate(bomb, &program, &own);
        failures.extend(fault.filter(|_| judged).map(|fault| format!("{}: {fault}", bomb.name)));
    }
    failures.iter().for_each(|failure| say(failure));
    if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs the program on a bomb and prints a line of the table. Returns the fault, if there is one.
fn detonate(bomb: &Bomb, program: &Path, own: &Path) -> Option<String> {
    let place = Place { folder: tempfile::tempdir().unwrap(), program: own.to_owned() };
    (bomb.make)(&place);
    let size = place.size();
    let run = Run::of(program, bomb.args, place.folder.path());
    let free = if bomb.fate == Fate::Refused { FREE } else { FREE_TO_READ };
    let allowed = free + PER_BYTE * size;
    let ended = match run.code {
        Some(code) => code.to_string(),
        None if run.stopped => "stopped".to_owned(),
        None => "killed".to_owned(),
    };
    let Bomb { name, what, .. } = bomb;
    say(&format!("| {name} | {what} | {} | {ended} | {} | {} |", bytes(size), mb(run.peak), mb(allowed)));
    let wanted: &[i32] = if bomb.fate == Fate::Refused { &[1, 2, 3] } else { &[0] };
    let message = run.stderr.trim();
    match run.code {
        Some(code) if wanted.contains(&code) && !message.contains("panicked") => {}
        _ => return Some(format!("it ended with {ended}, wanted one of {wanted:?}: {message}")),
    }
    (run.peak > allowed).then(|| format!("its peak is {}, wanted at most {}", mb(run.peak), mb(allowed)))
}

fn mb(bytes: u64) -> String {
    format!("{:.0} MB", bytes as f64 * 1e-6)
}

fn bytes(count: u64) -> String {
    match count {
        0..10_000 => format!("{count} B"),
        10_000..10_000_000 => format!("{:.0} kB", count as f64 * 1e-3),
        _ => mb(count),
    }
}

fn say(line: &str) {
    // A closed pipe (`| head`) is no failed bomb.
    let _ = writeln!(std::io::stdout(), "{line}");
}
