//! Mutated command lines, each run in this process in a folder of its own. No word may panic a
//! verb. The output of a verb is inert, its exit code obeys the contract, and it is JSON where JSON
//! was requested.

use crate::corpus::{Corpus, files};
use crate::inert;
use gs2e::cli::{ConsoleStreams, Environment, ExitKind, run_on};
use std::cell::Cell;
use std::ffi::OsString;
use std::fs;
use std::io::{self, Write};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Lines that succeed in the folder that [`furnish`] makes.
const SOUND: [&str; 42] = [
    "--help",
    "--version",
    "build --help",
    "build -k -q tiny.yaml",
    "build --json --verify --recheck 1% --sync always --memory 500MB tiny.yaml",
    "build --backend reference --no-omit --no-wait --allow-commands --store other tiny.yaml",
    "plan -C . tiny.yaml",
    "plan --json --estimate --verify tiny.yaml",
    "plan --json -- tiny.yaml",
    "why --json tiny --recipes tiny.yaml",
    "why tiny/base/trajectory --recipes tiny.yaml",
    "check --recipes tiny.yaml",
    "check --json --recipes tiny.yaml tiny",
    "check --tree out tiny",
    "release --to out --copy --replace tiny.yaml",
    "release --json --to out --no-build --sync batch tiny.yaml",
    "audit --json out",
    "audit out --takedown takedown.txt",
    "check --events few.csv --size 346x260 --report page.html",
    "check --json --events out/tiny/base --as release --require event_rate --strict",
    "train --help --capture data/one/transforms.json --out trained.ply --gaussians 10 --iterations 2 --checkpoint kept.bin",
    "diff --json out out",
    "convert --json --lossy --size 346x260 few.csv few.h5",
    "convert --lossy --size 346x260 --codec evt3 few.csv few.raw",
    "convert --lossy --size 346x260 few.csv few.png",
    "convert --lossy scene.ply scene.splat",
    "info scene.ply",
    "info --json data/one/transforms.json",
    "info --size 346x260 few.csv",
    "info --json out",
    "info .gs2e",
    "init nerfstudio data --to recipes --min-views 1 --min-side 1 --limit 3 --seed 7 --prefix ours",
    "init --json nerfstudio data --to others --min-views 1 --min-side 1 --views 2 --exclude *.jpg --pace mild",
    "gc --dry-run --min-age 1d tiny.yaml",
    "gc --json --min-age 0 tiny.yaml",
    "render --scene scene.ply --view view.json --out seen.png --background 0.5,0,1",
    "render --json --scene scene.ply --view view.json --out a.npy --channel depth --rules gsplat --order depth",
    "simulate --frames bytes.npy --fps 100 --sensor dvs346 --out e.h5 --seed 3 --origin 1,2 --full-scale 255",
    "simulate --json --frames bytes.npy --fps 1e3 --sensor dvs346 --out e.csv --law exact --gain log --between linear",
    "trajectory --capture data/one/transforms.json --recipe tiny.yaml --name base --out poses.txt --report speed.json --svg path.svg",
    "stress --help --area sensor",
    "study thresholds --help",
];

/// Odd words that are not in any sound line.
const ODD: [&[u8]; 14] = [
    b"\x1b[31mX\x1b]0;T\x07",
    b"a\nerror: FAKE",
    b"\xe2\x80\xaegnp",
    b"\xc2\x9b2J",
    b"x\xff\xfe",
    b"",
    b"--",
    b"-",
    b"-1",
    b"1e300",
    b"99999999999999999999",
    b"NaN",
    b"--json=",
    b"-qqkk",
];

/// The lines, words separated by NUL.
pub(crate) fn corpus() -> Corpus {
    let sound = |line: &&str| ((*line).to_owned(), line.replace(' ', "\0").into_bytes());
    SOUND.iter().map(sound).collect()
}

thread_local! {
    /// Runs since the folder was furnished.
    static RUNS: Cell<u32> = const { Cell::new(0) };
}

/// Number of runs after which the folder is emptied: names are mutated, so outputs pile up.
const CLEAN_AFTER: u32 = 2000;

/// Runs a line and judges its effects. Returns true if it succeeded.
pub(crate) fn read(line: &[u8]) -> bool {
    let home = home();
    std::env::set_current_dir(&home).unwrap();
    if RUNS.replace(RUNS.get() + 1).is_multiple_of(CLEAN_AFTER) {
        furnish(&home);
    }
    let mut words = words(line);
    if !is_harmless(&words) {
        return false;
    }
    if takes_long(&words) {
        // An unknown option makes the parser read all words without running anything.
        words.retain(|word| word != "--");
        words.push("--no-such-option".into());
    }
    let (results, notes) = (SharedBuffer::default(), SharedBuffer::default());
    let name = OsString::from("gs2e");
    let exit = run_on(
        ConsoleStreams::of(results.clone(), notes.clone()),
        environment(line),
        std::iter::once(name).chain(words.clone()),
    );
    judge(&words, exit, &results.text(), &notes.text());
    exit == ExitKind::Done
}

fn judge(words: &[OsString], exit: ExitKind, stdout: &str, stderr: &str) {
    inert::judge(stdout);
    inert::judge(stderr);
    let asks = |what: &str| words.iter().take_while(|word| *word != "--").any(|word| word == what);
    // Short options may be combined: `-qh`.
    let helps = stdout.contains("Usage: gs2e") || stdout.starts_with("gs2e ");
    if asks("--json") && !helps {
        let objects: Vec<serde_json::Value> = stdout
            .lines()
            .map(|line| {
                serde_json::from_str(line).unwrap_or_else(|e| panic!("{e} in {stdout:?} of {words:?}"))
            })
            .collect();
        let is_told = objects.iter().any(|object| object["exit"] == exit.code());
        assert!(
            exit != ExitKind::Usage || is_told,
            "no object says that the command line is wrong: {stdout}"
        );
    }
    assert!(exit != ExitKind::Usage || stderr.contains("error: ") || stderr.contains("Usage: "), "{stderr}");
}

/// An environment for a line: each variable is not set, odd, a part of the line, or a sound folder.
fn environment(line: &[u8]) -> Environment {
    let sum = sum(line);
    let value = |k: usize| match sum / (11 + 2 * k) % 4 {
        0 => None,
        1 => Some(OsString::from_vec(ODD[sum / (5 + k) % ODD.len()].to_vec())),
        2 => Some(OsString::from_vec(line[..sum % (line.len() + 1)].to_vec())),
        _ => Some("/nonexistent:.:".into()),
    };
    Environment { path: value(0), home: value(1), cache: value(2), ..Environment::default() }
}

/// A sum that mutations change.
fn sum(line: &[u8]) -> usize {
    line.iter().fold(0, |sum: usize, byte| sum.wrapping_mul(31).wrapping_add(usize::from(*byte)))
}

/// The words of a line; sometimes one of them is odd.
fn words(line: &[u8]) -> Vec<OsString> {
    let mut words: Vec<Vec<u8>> = line.split(|byte| *byte == 0).map(<[u8]>::to_vec).collect();
    // Lines of the corpus stay as they are.
    let sum = sum(line);
    if sum.is_multiple_of(3) && !SOUND.iter().any(|sound| sound.replace(' ', "\0").as_bytes() == line) {
        let at = sum / 3 % words.len();
        words[at] = ODD[sum / 7 % ODD.len()].to_vec();
    }
    words.into_iter().map(OsString::from_vec).collect()
}

/// Returns true if a line can change only the folder: verbs write wherever their arguments lead.
fn is_harmless(words: &[OsString]) -> bool {
    words.iter().all(|word| {
        let word = word.as_bytes();
        let leaves = word.windows(2).any(|pair| pair == b"..") || word.starts_with(b"/");
        let attached = word.starts_with(b"-") && word.contains(&b'/');
        // `-` is this process's own stdout.
        !leaves && !attached && word != b"-" && !word.ends_with(b"=-")
    })
}

/// Returns true if a line may run for seconds by design: measurements, and thread pools, which a
/// process makes only once.
fn takes_long(words: &[OsString]) -> bool {
    let helps = words.iter().any(|word| word == "--help");
    words.iter().any(|word| {
        let word = word.as_bytes();
        !helps && (word == b"stress" || word == b"study")
            || word.starts_with(b"-j")
            || word.starts_with(b"--job")
    })
}

fn home() -> PathBuf {
    thread_local! {
        static HOME: PathBuf = std::env::current_dir().unwrap().join("lines");
    }
    HOME.with(|home| {
        fs::create_dir_all(home).unwrap();
        home.clone()
    })
}

/// A small recipe without files.
pub(crate) const TINY: &str = "\
version: 1
scene: tiny
source: { procedural: { kind: still-life, gaussians: 100, views: 4, arc: 6, seed: 1 } }
camera: { width: 16, height: 12 }
trajectories: [{ name: base, refine: { window: 2, factor: 1, curve: cubic }, speed: { function: \"1\" } }]
sensor: { voltmeter: { preset: dvs346 } }
outputs: [events]
licence: { expression: CC0-1.0, holder: Example Lab }
";

const VIEW: &str = r#"{"W":8,"H":8,"fx":8,"fy":8,"cx":4,"cy":4,"R":[[1,0,0],[0,1,0],[0,0,1]],"t":[0,0,4]}"#;

/// Empties the folder and writes the files that sound lines read.
fn furnish(home: &Path) {
    for entry in fs::read_dir(home).unwrap() {
        let path = entry.unwrap().path();
        let is_folder = fs::symlink_metadata(&path).unwrap().is_dir();
        if is_folder { fs::remove_dir_all(&path) } else { fs::remove_file(&path) }.unwrap();
    }
    fs::create_dir_all(home.join("data/one")).unwrap();
    let write = |name: &str, content: &[u8]| fs::write(home.join(name), content).unwrap();
    write("tiny.yaml", TINY.as_bytes());
    write("view.json", VIEW.as_bytes());
    write("takedown.txt", b"another 2025-06-01\n");
    for (from, to) in [
        ("tests/fuzz/corpus/few.csv", "few.csv"),
        ("tests/fuzz/corpus/ascii.ply", "scene.ply"),
        ("tests/fuzz/corpus/bytes.npy", "bytes.npy"),
        ("tests/fuzz/corpus/transforms.json", "data/one/transforms.json"),
    ] {
        write(to, &files(&[from])[0].1);
    }
    for line in ["build -q tiny.yaml", "release -q --to out --copy tiny.yaml"] {
        let words = std::iter::once("gs2e").chain(line.split(' ')).map(OsString::from);
        let notes = SharedBuffer::default();
        let exit = run_on(ConsoleStreams::of(io::sink(), notes.clone()), Environment::of_process(), words);
        assert_eq!(exit, ExitKind::Done, "{line}: {}", notes.text());
    }
}

/// A stream whose contents can be read afterwards.
#[derive(Clone, Default)]
struct SharedBuffer(Arc<Mutex<Vec<u8>>>);

impl SharedBuffer {
    fn text(&self) -> String {
        String::from_utf8(self.0.lock().unwrap().clone()).expect("it speaks UTF-8")
    }
}

impl Write for SharedBuffer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
