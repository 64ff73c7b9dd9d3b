//! `kill -9` of the process group at random instants, until everything is done.
//!
//! After each kill, every step that counts as up to date is read and compared with an undisturbed
//! build. A step that was reported as made, or counted as up to date after a kill, is never made
//! again. The next run needs no manual repair.

use crate::place::{Place, Products, same, sound, tree, within};
use crate::program::{end, run_until, start};
use crate::random::Random;
use crate::tally::Tally;
use crate::{Size, is_over, scenes};
use gs2e_store::Digest;
use rustix::process::Signal;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Cores of a build.
const CORES: usize = 2;

/// Steps that can be at work when a build is killed: each core makes one step, or the outputs of one
/// trajectory in one pass of the renderer.
const MOST_AT_WORK: usize = CORES * scenes::EVENT_OUTPUTS.len();

/// The result of a build that was not killed.
struct ReferenceBuild {
    products: Products,
    release: BTreeMap<PathBuf, Digest>,
    /// The longest time before a kill.
    patience: Duration,
}

pub(crate) fn run(size: Size) -> Tally {
    // No kill comes later than this share of an undisturbed build: late enough to get past reading
    // a store that grows, early enough for several kills per build.
    let (kills, count, part) = size.of((120, 200, 0.2), (1000, 2000, 0.2));
    let undisturbed = undisturbed(count, part);
    let mut random = Random::new(size.seed, 0);
    let mut tally = Tally::default();
    for figure in ["finished steps redone", "partial accepted", "human acts", "steps lost", "builds finished"]
    {
        tally.count(figure, 0);
    }
    let end = size.end();
    while tally.trials() < kills && !is_over(end) {
        let place = Place::in_memory();
        scenes::write(&place, count, 10);
        let ended = until_done(&place, &undisturbed, &mut random, kills, &mut tally);
        if let Err(why) = ended {
            tally.trial(Err(why));
        }
    }
    tally
}

fn undisturbed(count: u32, part: f64) -> ReferenceBuild {
    let place = Place::in_memory();
    scenes::write(&place, count, 10);
    let started = Instant::now();
    let products = place.build("").unwrap();
    let patience = started.elapsed().mul_f64(part);
    place.ok("release --to out").unwrap();
    ReferenceBuild { products, release: tree(&place.path("out")), patience }
}

/// Builds with kills until the build and the release after it are done, or until the number of
/// kills is reached.
fn until_done(
    place: &Place,
    undisturbed: &ReferenceBuild,
    random: &mut Random,
    kills: u64,
    tally: &mut Tally,
) -> Result<(), String> {
    let mut finished = BTreeSet::new();
    let args = format!("build --json -j {CORES}");
    while tally.trials() < kills {
        let after = undisturbed.patience.mul_f64(random.unit());
        let (ended, was_hit) = run_until(place.root(), &args, after, Signal::KILL);
        note_made(&ended.made(), &mut finished, tally)?;
        if !was_hit {
            orderly(&ended, tally)?;
            break;
        }
        let state = after_kill(place, undisturbed, &mut finished, tally);
        tally.trial(state);
    }
    // The kills may be used up before the build is done: the rest runs undisturbed.
    let ended = end(start(place.root(), &args));
    orderly(&ended, tally)?;
    note_made(&ended.made(), &mut finished, tally)?;
    same(&place.finished()?, &undisturbed.products)?;
    if std::fs::read_dir(place.path(".gs2e/gs2e-tmp")).unwrap().next().is_some() {
        return Err("leftovers in tmp/ after a whole build".to_owned());
    }
    tally.count("builds finished", 1);
    released(place, undisturbed, random, kills, tally)
}

/// A release that is killed at most four times: its tree equals the undisturbed one, and the audit
/// finds no fault.
fn released(
    place: &Place,
    undisturbed: &ReferenceBuild,
    random: &mut Random,
    kills: u64,
    tally: &mut Tally,
) -> Result<(), String> {
    for _ in 0..4 {
        if tally.trials() >= kills {
            break;
        }
        let after = undisturbed.patience.mul_f64(random.unit());
        let (ended, was_hit) = run_until(place.root(), "release --to out", after, Signal::KILL);
        if !was_hit {
            orderly(&ended, tally)?;
            continue;
        }
        let state = place.finished().and_then(|products| same(&products, &undisturbed.products));
        tally.trial(state);
    }
    place.ok("release --to out").inspect_err(|_| tally.count("human acts", 1))?;
    place.ok("audit out")?;
    if tree(&place.path("out")) != undisturbed.release {
        return Err("the release is not that of an undisturbed build".to_owned());
    }
    let names = std::fs::read_dir(place.root()).unwrap().map(|entry| entry.unwrap().file_name());
    match names.into_iter().find(|name| name.to_string_lossy().starts_with(".out.")) {
        None => Ok(()),
        Some(left) => Err(format!("left next to the release: {}", left.display())),
    }
}

/// The run after a kill must succeed without help.
fn orderly(ended: &crate::program::RunOutcome, tally: &mut Tally) -> Result<(), String> {
    if ended.code == Some(0) {
        return Ok(());
    }
    tally.count("human acts", 1);
    Err(format!("a build after a kill: {ended}"))
}

fn note_made(made: &[String], finished: &mut BTreeSet<String>, tally: &mut Tally) -> Result<(), String> {
    let again: Vec<&String> = made.iter().filter(|step| finished.contains(*step)).collect();
    tally.count("finished steps redone", again.len() as u64);
    let answer = again.first().map_or(Ok(()), |step| Err(format!("{step} was finished and is made again")));
    finished.extend(made.iter().cloned());
    answer
}

/// Compares the store's state after a kill with an undisturbed build.
fn after_kill(
    place: &Place,
    undisturbed: &ReferenceBuild,
    finished: &mut BTreeSet<String>,
    tally: &mut Tally,
) -> Result<(), String> {
    let begun = std::fs::read_dir(place.path(".gs2e/gs2e-tmp")).into_iter().flatten();
    let at_work = begun.filter(|entry| entry.as_ref().is_ok_and(|entry| entry.path().is_dir())).count();
    tally.count("steps lost", at_work as u64);
    if at_work > MOST_AT_WORK {
        return Err(format!("{at_work} steps were at work on {CORES} cores"));
    }
    let plan = place.plan()?;
    let products = sound(&plan).inspect_err(|_| tally.count("partial accepted", 1))?;
    within(&products, &undisturbed.products).inspect_err(|_| tally.count("partial accepted", 1))?;
    let kept: BTreeSet<String> =
        plan.into_iter().filter(|(_, step)| step.keep).map(|(name, _)| name).collect();
    if let Some(step) = finished.iter().find(|step| !kept.contains(*step)) {
        return Err(format!("{step} was found as made and is lost"));
    }
    finished.extend(kept);
    Ok(())
}
