//! Two coordinators on one store, and eight writers to one shared store.

use crate::place::{Place, Products, same};
use crate::program::{RunOutcome, end, start};
use crate::random::Random;
use crate::tally::Tally;
use crate::{Size, is_over, scenes};
use gs2e_store::Digest;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

const SCENES: u32 = 12;
const WRITERS: usize = 8;

pub(crate) fn run(size: Size) -> Tally {
    let time = Duration::from_secs(size.of(30, 30 * 60));
    let truth = {
        let place = Place::in_memory();
        scenes::write(&place, SCENES, 4);
        place.build("").unwrap()
    };
    let mut tally = Tally::default();
    ["steps run twice", "corrupt entries", "waits named"].iter().for_each(|figure| tally.count(figure, 0));
    let (started, end) = (Instant::now(), size.end());
    for round in 0.. {
        let mut random = Random::new(size.seed, round);
        let ended = if round % 2 == 0 {
            two_coordinators(&truth, &mut random, &mut tally)
        } else {
            eight_writers(&truth, &mut random, &mut tally)
        };
        tally.trial(ended.map_err(|why| format!("round {round}: {why}")));
        if started.elapsed() > time || is_over(end) {
            break;
        }
    }
    tally
}

fn pause(random: &mut Random, most_ms: usize) {
    std::thread::sleep(Duration::from_millis(random.below(most_ms) as u64));
}

/// Checks that each step is made by one of the two, and that a waiting one names the other.
fn two_coordinators(truth: &Products, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let place = Place::in_memory();
    scenes::write(&place, SCENES, 4);
    let first = start(place.root(), "build --json -j 1");
    pause(random, 60);
    let second = start(place.root(), "build --json -j 1");
    let pids = [first.id(), second.id()];
    let ended = [end(first), end(second)];
    let mut made = BTreeSet::new();
    for (own, ended) in ended.iter().enumerate() {
        succeeded(ended)?;
        let twice = ended.made().into_iter().filter(|step| !made.insert(step.clone())).count();
        tally.count("steps run twice", twice as u64);
        if twice > 0 {
            return Err(format!("{twice} steps were made by both"));
        }
        if let Some(line) = ended.stderr.lines().find(|line| line.starts_with("waiting:")) {
            if !line.contains(&format!("pid {} ", pids[1 - own])) {
                return Err(format!("the other is pid {}, and it says: {line}", pids[1 - own]));
            }
            tally.count("waits named", 1);
        }
    }
    same(&place.finished()?, truth)
}

fn succeeded(ended: &RunOutcome) -> Result<(), String> {
    ended.is_orderly()?;
    if ended.code == Some(0) { Ok(()) } else { Err(ended.to_string()) }
}

/// Stores with their own locks and databases before a shared store, as tasks on several hosts have them.
fn eight_writers(truth: &Products, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let place = Place::in_memory();
    scenes::write(&place, SCENES, 4);
    let writers: Vec<_> = (0..WRITERS)
        .map(|number| {
            pause(random, 5);
            start(place.root(), &format!("build -q -j 1 --store stores/{number} --shared-store shared"))
        })
        .collect();
    for writer in writers {
        succeeded(&end(writer))?;
    }
    let corrupt = corrupt_blobs(&place.path("shared/cas"));
    tally.count("corrupt entries", corrupt.len() as u64);
    if let Some(path) = corrupt.first() {
        return Err(format!("{path} holds other bytes than its name says"));
    }
    // A store that begins with only the shared files takes every record, and runs no step.
    let ended = place.ok("build --json --recheck 0 --shared-store shared")?;
    if ended.stderr.contains("damaged") || !ended.made().is_empty() {
        tally.count("corrupt entries", 1);
        return Err(format!("the shared records do not all count: {ended}"));
    }
    same(&place.finished()?, truth)
}

/// Files whose bytes do not match their names.
fn corrupt_blobs(cas: &Path) -> Vec<String> {
    let entries = walkdir::WalkDir::new(cas).into_iter().map(Result::unwrap);
    let files = entries.filter(|entry| entry.file_type().is_file());
    let is_wrong = |path: &Path| !path.ends_with(Digest::of_bytes(&fs::read(path).unwrap()).to_string());
    files.filter(|file| is_wrong(file.path())).map(|file| file.path().display().to_string()).collect()
}
