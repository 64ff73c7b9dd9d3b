//! Machines with a shared store: they are killed and lose their own stores, bits of shared files flip, the
//! disk of the shared store fills, and a member plants links, special files, altered records and plans.

mod member;

use crate::damage::Flip;
use crate::full::Disk;
use crate::place::{Place, Products, same};
use crate::program::{RunOutcome, run_until};
use crate::random::Random;
use crate::scenes;
use crate::tally::Tally;
use crate::{Size, is_over};
use rustix::process::Signal;
use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

const SCENES: u32 = 20;

/// Number of machines, each with its own store.
const MACHINES: usize = 3;

/// A build of one machine.
fn build(machine: usize) -> String {
    format!("build --json -j 2 --store machine-{machine} --shared-store shared")
}

pub(crate) fn run(size: Size) -> Tally {
    let mut tally = Tally::default();
    for figure in [
        "kills",
        "finished steps redone",
        "flips",
        "builds that met a full shared disk",
        "harms of a member",
        "harms that were refused",
    ] {
        tally.count(figure, 0);
    }
    let place = place();
    let started = Instant::now();
    let truth = place.build("").unwrap();
    let patience = started.elapsed().mul_f64(0.5);
    let mounts = Disk::mount(place.root(), 64).is_ok();
    if !mounts {
        tally.notes.push("no disk could be mounted, so none was full".to_owned());
    }
    let end = size.end();
    for round in (0..size.of(60, 2000)).take_while(|_| !is_over(end)) {
        let mut random = Random::new(size.seed, round);
        let (name, ended) = match round % 4 {
            0 => ("kills", killed(&truth, patience, &mut random, &mut tally)),
            1 => ("flips", flipped(&truth, &mut random, &mut tally)),
            2 => ("a hostile member", member::harmed(&truth, &mut random, &mut tally)),
            _ if mounts => ("a full disk", filled(&truth, &mut random, &mut tally)),
            _ => continue,
        };
        tally.trial(ended.map_err(|why| format!("round {round}, {name}: {why}")));
    }
    tally
}

fn place() -> Place {
    let place = Place::in_memory();
    scenes::write(&place, SCENES, 5);
    place
}

/// Any machine builds, and is killed. Half of them lose their stores.
fn killed(
    truth: &Products,
    patience: Duration,
    random: &mut Random,
    tally: &mut Tally,
) -> Result<(), String> {
    let place = place();
    let mut finished = BTreeSet::new();
    for _ in 0..10 {
        let machine = random.below(MACHINES);
        let after = patience.mul_f64(random.unit());
        let (ended, was_hit) = run_until(place.root(), &build(machine), after, Signal::KILL);
        note_made(&ended, &mut finished, tally)?;
        if !was_hit && ended.code != Some(0) {
            return Err(format!("a build after a kill: {ended}"));
        }
        tally.count("kills", u64::from(was_hit));
        if random.once_in(2) {
            let _ = fs::remove_dir_all(place.path(&format!("machine-{machine}")));
        }
    }
    let ended = place.ok(&build(0))?;
    note_made(&ended, &mut finished, tally)?;
    adopted(&place, truth)
}

/// Checks that no step is made that some machine had reported as made.
fn note_made(ended: &RunOutcome, finished: &mut BTreeSet<String>, tally: &mut Tally) -> Result<(), String> {
    for step in ended.made() {
        if !finished.insert(step.clone()) {
            tally.count("finished steps redone", 1);
            return Err(format!("{step} was finished, and another machine made it again"));
        }
    }
    Ok(())
}

/// Checks that a new machine copies everything, and has the products of a clean build.
fn adopted(place: &Place, truth: &Products) -> Result<(), String> {
    let ended = place.ok("build --json -j 2 --shared-store shared")?;
    match ended.made().first() {
        Some(step) => Err(format!("{step} is not in the shared store")),
        None => same(&place.finished()?, truth),
    }
}

/// Bits of files of the shared store flip. The next machine makes the damaged steps again, and replaces them.
fn flipped(truth: &Products, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let place = place();
    place.ok(&build(0))?;
    let files: Vec<PathBuf> = ["ac", "cas"]
        .iter()
        .flat_map(|folder| walkdir::WalkDir::new(place.path("shared").join(folder)).sort_by_file_name())
        .map(Result::unwrap)
        .filter(|entry| entry.file_type().is_file() && entry.metadata().unwrap().len() > 0)
        .map(walkdir::DirEntry::into_path)
        .collect();
    for _ in 0..=random.below(5) {
        let path = random.pick(&files);
        Flip::any(fs::metadata(path).unwrap().len(), random).in_file(path);
        tally.count("flips", 1);
    }
    place.ok(&build(1))?;
    adopted(&place, truth)
}

/// The disk of the shared store fills, and grows from one build to the next.
fn filled(truth: &Products, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let place = place();
    let shared = place.path("shared");
    fs::create_dir(&shared).unwrap();
    let mut kib = 4 + 4 * random.below(250);
    let disk = Disk::mount(&shared, kib)?;
    for _ in 0..100 {
        let ended = place.run(&build(random.below(MACHINES)))?;
        if ended.code == Some(0) {
            return adopted(&place, truth);
        }
        tally.count("builds that met a full shared disk", 1);
        let says_so = ended.stderr.to_lowercase().contains("no space") || ended.stderr.contains("is full");
        if ended.code != Some(1) || !says_so {
            return Err(format!("{kib} KiB: {ended}"));
        }
        kib += 4 + 4 * random.below(150);
        disk.grow(kib)?;
    }
    Err(format!("not finished with {kib} KiB"))
}
