//! Event files, read and written by this program and by others.

use crate::check_bench::watch;
use crate::command::{Outcome, Task, say};
use std::fs;
use std::path::Path;

/// Readers and writers in Python.
const PEERS: [&str; 2] = ["faery", "evutils"];

/// A format: its name in the table, the file, the version of EVT, and the file that it is written from.
const FORMATS: [[&str; 4]; 4] = [
    ["EVT 2.0", "evt2.raw", "evt2", "evt3.raw"],
    ["EVT 3.0", "evt3.raw", "evt3", "evt2.raw"],
    ["AEDAT 4.0", "lz4.aedat4", "evt3", "evt3.raw"],
    ["text", "text.csv", "evt3", "evt3.raw"],
];

/// Files made from one stream of events, and how they are read and written.
pub(super) struct FileBench<'a> {
    pub(super) gs2e: &'a Path,
    pub(super) folder: &'a Path,
    pub(super) runs: usize,
    /// Calls the script of the peers.
    pub(super) call: &'a dyn Fn(&[&str]) -> Task,
}

impl FileBench<'_> {
    /// Compares the formats. `source` is any file of events.
    pub(super) fn run(&self, source: &str) -> Outcome {
        for [_, file, codec, _] in FORMATS {
            self.cost(&["convert", "-q", "--codec", codec, source, &self.at(file)], 1)?;
        }
        let events = (self.call)(&["events", "evutils", &self.at("evt2.raw"), "none", "1"]).capture()?;
        let events = numbers(&events.stdout).map_or(0.0, |[count, _]| count);
        say(&format!("{events} events; the least CPU time of {} runs, s", self.runs));
        say(&format!("| file | gs2e | {} |\n|---|---|{}", PEERS.join(" | "), "---|".repeat(PEERS.len())));
        for [name, file, codec, from] in FORMATS {
            let (path, from) = (self.at(file), self.at(from));
            let own = self.cost(&["info", "-q", &path], self.runs)?;
            say(&format!("| {name}, read | {own:.2} | {} |", self.peers(&path, "none", codec)?));
            let out = self.at(&format!("out-{file}"));
            let own = self.cost(&["convert", "-q", "--codec", codec, &from, &out], self.runs)?;
            say(&format!("| {name}, written | {own:.2} | {} |", self.peers(&from, &out, codec)?));
            // The peers may refuse to write over a file.
            fs::remove_file(&out).map_err(|e| format!("{out}: {e}"))?;
        }
        Ok(())
    }

    fn at(&self, name: &str) -> String {
        self.folder.join(name).to_string_lossy().into_owned()
    }

    /// The least CPU time of the whole command.
    fn cost(&self, args: &[&str], runs: usize) -> Outcome<f64> {
        (0..runs).try_fold(f64::INFINITY, |least, _| Ok(least.min(watch(self.gs2e, args, &[0])?.cpu_seconds)))
    }

    /// The least CPU time of the calls of each peer, or the reason why it has none.
    fn peers(&self, from: &str, to: &str, codec: &str) -> Outcome<String> {
        let cell = |peer: &&str| {
            let found = (self.call)(&["events", peer, from, to, &self.runs.to_string(), codec]).capture()?;
            let reason = String::from_utf8_lossy(&found.stdout);
            Ok(numbers(&found.stdout)
                .map_or(reason.trim().to_owned(), |[_, seconds]| format!("{seconds:.2}")))
        };
        Ok(PEERS.iter().map(cell).collect::<Outcome<Vec<_>>>()?.join(" | "))
    }
}

/// Two numbers of a line.
fn numbers(line: &[u8]) -> Option<[f64; 2]> {
    let line = String::from_utf8_lossy(line);
    let (a, b) = line.trim().split_once(' ')?;
    Some([a.parse().ok()?, b.parse().ok()?])
}
