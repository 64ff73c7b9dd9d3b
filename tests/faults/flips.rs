//! Flips of single bits in release files and in blobs, with size and mtime kept. The audit finds
//! each flip and names file, scene and repair. A build finds each flip and makes the blob again.

use crate::damage::Flip;
use crate::engine::{BuildOutcome, Engine};
use crate::frozen::Frozen;
use crate::place::{Place, Products, same};
use crate::random::Random;
use crate::tally::Tally;
use crate::workers::spread;
use crate::{Size, scenes};
use gs2e_store::fs::{Fs, SystemFs};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

struct Fixture {
    place: Place,
    truth: Products,
    /// Files of the release and of the products that its recipes ask for.
    released: Vec<PathBuf>,
    blobs: Vec<PathBuf>,
}

impl Fixture {
    fn new() -> Self {
        let place = Place::in_memory();
        scenes::write(&place, 3, 2);
        let truth = place.build("").unwrap();
        place.ok("release --copy --to out").unwrap();
        let released = files(&place.path("out"));
        let mut blobs: Vec<PathBuf> = place
            .plan()
            .unwrap()
            .into_values()
            .flat_map(|step| step.outputs)
            .map(|(_, _, path)| path)
            .collect();
        blobs.sort();
        blobs.dedup();
        Self { place, truth, released, blobs }
    }
}

/// Nonempty files, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = walkdir::WalkDir::new(folder).sort_by_file_name().into_iter().map(Result::unwrap);
    let files = entries.filter(|entry| entry.file_type().is_file() && entry.metadata().unwrap().len() > 0);
    files.map(walkdir::DirEntry::into_path).collect()
}

pub(crate) fn run(size: Size) -> Tally {
    let each = size.of(500, 5000);
    spread(size, 2 * each, Fixture::new, |fixture, number, tally| {
        let mut random = Random::new(size.seed, number as u64);
        // Every file has its turn.
        if number < each {
            let path = &fixture.released[number % fixture.released.len()];
            let flip = Flip::any(fs::metadata(path).unwrap().len(), &mut random);
            flip.in_file(path);
            let found = is_found(&fixture.place, path);
            tally.count("found by the audit", u64::from(found.is_ok()));
            flip.in_file(path);
            found.map_err(|why| format!("{flip:?} of {}: {why}", path.display()))
        } else {
            let path = &fixture.blobs[number % fixture.blobs.len()];
            let flip = Flip::any(fs::metadata(path).unwrap().len(), &mut random);
            let is_rot = random.once_in(2);
            let found = if is_rot { rotten(fixture, path, flip) } else { mended(fixture, path, flip) };
            let figure = if is_rot { "found by verifying" } else { "found by the build" };
            tally.count(figure, u64::from(found.is_ok()));
            found.map_err(|why| format!("{flip:?} of {}, {figure}: {why}", path.display()))
        }
    })
}

/// Checks that the audit ends with 3 and names the file, its scene and a repair.
fn is_found(place: &Place, path: &Path) -> Result<(), String> {
    let ended = place.run("audit --json out")?;
    if ended.code != Some(3) {
        return Err(format!("the audit: {ended}"));
    }
    let name = path.strip_prefix(place.path("out")).unwrap().to_string_lossy().into_owned();
    let faults: Vec<Value> =
        ended.stdout.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    // A digit that flips in a list of sums is a fault of the file that the sum belongs to; the
    // message names the list.
    let names = |fault: &&Value| {
        fault["file"] == *name || fault["message"].as_str().is_some_and(|text| text.contains(&name))
    };
    let fault = faults.iter().find(names);
    let fault = fault.ok_or_else(|| format!("no fault names {name}: {}", ended.stdout))?;
    let scene = name.split_once('/').map(|(scene, _)| scene).filter(|scene| scene.starts_with('s'));
    let has_scene = scene.is_none_or(|scene| fault["scene"] == scene);
    let has_repair = fault["help"].as_str().is_some_and(|text| !text.is_empty());
    if has_scene && has_repair {
        Ok(())
    } else {
        Err(format!("a fault without its scene or repair: {fault}"))
    }
}

/// Checks that a build makes a blob again if only its ctime shows the change.
fn mended(fixture: &Fixture, path: &Path, flip: Flip) -> Result<(), String> {
    flip.in_file(path);
    let ended = fixture.place.ok("build --json")?;
    if ended.made().is_empty() {
        return Err("the build made nothing".to_owned());
    }
    same(&fixture.place.finished()?, &fixture.truth)
}

/// Checks that a verifying build makes a blob again if no stat field shows the change.
fn rotten(fixture: &Fixture, path: &Path, flip: Flip) -> Result<(), String> {
    let then = SystemFs.stat(path).unwrap();
    flip.in_file(path);
    let frozen = Arc::new(Frozen::new(BTreeMap::from([(path.to_owned(), then)])));
    let engine = Engine { verify: true, ..Engine::new(&fixture.place, frozen) };
    let built = engine.build(&fixture.place);
    same(&built.products(&fixture.place)?, &fixture.truth)?;
    if let BuildOutcome::Done { made: 0, .. } = built {
        Err("the build made nothing".to_owned())
    } else {
        Ok(())
    }
}
