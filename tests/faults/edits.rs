//! Random sequences of edits: after each edit, the incremental build's products equal those of a
//! clean build.

use crate::Size;
use crate::damage::Flip;
use crate::place::{Place, Products, same};
use crate::program::run_until;
use crate::random::Random;
use crate::scenes;
use crate::tally::Tally;
use crate::workers::spread_over;
use rustix::process::Signal;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

/// Names that scenes may have.
const NAMES: [&str; 4] = ["a", "b", "c", "d"];

/// Number of edits in one sequence.
const EDITS: usize = 12;

/// Edits before which the files rest until their stat fields are trusted.
const RESTS: [usize; 2] = [4, 8];

/// The settings of a scene. Sequences draw from few values, so that clean builds repeat and can be
/// kept.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct SceneSettings {
    name: &'static str,
    /// Number of the source files.
    number: u32,
    speed: &'static str,
    limit: u32,
    outputs: &'static [&'static str],
    seed: u32,
}

impl SceneSettings {
    fn any(name: &'static str, random: &mut Random) -> Self {
        Self {
            name,
            number: u32::try_from(random.below(3)).unwrap(),
            speed: *random.pick(&["1", "1 + 0.5*t"]),
            limit: *random.pick(&[5000, 4321]),
            outputs: *random.pick(&[&[] as &[_], &["events"], &["sharp"]]),
            seed: 7,
        }
    }

    /// A copy with one field drawn again.
    fn edited(&self, random: &mut Random) -> Self {
        let (mut wish, other) = (self.clone(), Self::any(self.name, random));
        match random.below(5) {
            0 => wish.number = other.number,
            1 => wish.speed = other.speed,
            2 => wish.limit = other.limit,
            3 => wish.outputs = other.outputs,
            _ => wish.seed = 15 - wish.seed,
        }
        wish
    }

    fn recipe(&self) -> Value {
        let mut recipe = scenes::recipe(self.name, self.number, self.outputs);
        recipe["seed"] = self.seed.into();
        recipe["trajectories"][0]["speed"] = json!({ "function": self.speed });
        recipe["checks"] = json!({ "event_rate": { "max": self.limit } });
        recipe
    }

    fn write(&self, place: &Place) {
        place.write(&format!("recipes/{}.yaml", self.name), self.recipe().to_string());
    }
}

/// Products of clean builds of single scenes, each built once.
#[derive(Debug, Default)]
struct Clean(BTreeMap<SceneSettings, Products>);

impl Clean {
    fn products(&mut self, wishes: &BTreeMap<&str, SceneSettings>) -> Result<Products, String> {
        let mut all = Products::new();
        for wish in wishes.values() {
            if !self.0.contains_key(wish) {
                let place = Place::in_memory();
                scenes::sources(&place, wish.number);
                wish.write(&place);
                self.0.insert(wish.clone(), place.build("")?);
            }
            all.extend(self.0[wish].clone());
        }
        Ok(all)
    }
}

pub(crate) fn run(size: Size) -> Tally {
    let mut tally = spread_over(size, 4, size.of(50, 500), Clean::default, |clean, number, tally| {
        sequence(clean, &mut Random::new(size.seed, number as u64), tally)
    });
    tally.count("sequences wrong", tally.wrong());
    tally
}

fn sequence(clean: &mut Clean, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let place = Place::in_memory();
    (0..3).for_each(|number| scenes::sources(&place, number));
    let mut wishes: BTreeMap<&str, SceneSettings> =
        NAMES[..2].iter().map(|name| (*name, SceneSettings::any(name, random))).collect();
    wishes.values().for_each(|wish| wish.write(&place));
    let mut found = Vec::new();
    for round in 0..EDITS {
        if RESTS.contains(&round) {
            // From here on, unchanged scenes are recognised by their stat fields alone.
            std::thread::sleep(Duration::from_millis(2100));
            place.build("")?;
        }
        // Some edits come before the first build, and some follow one another without a build
        // between.
        for _ in 0..=random.below(3) {
            found.push(edit(&place, &mut wishes, random)?);
            tally.count("edits", 1);
        }
        let after = || found.join("; ");
        let with = random.pick(&["", "-j 2", "-j 2", "--verify", "--recheck 50%"]);
        let built = place.build(with).map_err(|why| format!("after {}: {why}", after()))?;
        same(&built, &clean.products(&wishes)?).map_err(|why| format!("after {}: {why}", after()))?;
    }
    Ok(())
}

/// Changes the recipes or the store, and returns a description of the change.
fn edit(
    place: &Place,
    wishes: &mut BTreeMap<&str, SceneSettings>,
    random: &mut Random,
) -> Result<String, String> {
    let name = *random.pick(&NAMES);
    Ok(match random.below(13) {
        0..4 => change(place, wishes, name, random),
        4 if wishes.len() > 1 && wishes.remove(name).is_some() => {
            fs::remove_file(place.path(&format!("recipes/{name}.yaml"))).unwrap();
            format!("{name} removed")
        }
        5 => touch(place, wishes, random),
        6 | 7 => damage(&place.path(".gs2e/cas"), "blob", random),
        8 => damage(&place.path(".gs2e/ac"), "record", random),
        9 => {
            let gone = fs::remove_file(place.path(".gs2e/state.db")).is_ok();
            format!("the database removed: {gone}")
        }
        10 => {
            place.ok("gc --min-age 0s")?;
            "gc".to_owned()
        }
        11 => stopped(place, Signal::INT, random)?,
        _ => stopped(place, Signal::KILL, random)?,
    })
}

fn change(
    place: &Place,
    wishes: &mut BTreeMap<&str, SceneSettings>,
    name: &'static str,
    random: &mut Random,
) -> String {
    let wish = match wishes.get(name) {
        Some(wish) => wish.edited(random),
        None => SceneSettings::any(name, random),
    };
    wish.write(place);
    let text = format!("{wish:?}");
    wishes.insert(name, wish);
    text
}

/// Rewrites a recipe or a source with its own bytes.
fn touch(place: &Place, wishes: &BTreeMap<&str, SceneSettings>, random: &mut Random) -> String {
    if random.once_in(2) {
        wishes.values().for_each(|wish| wish.write(place));
        return "recipes touched".to_owned();
    }
    (0..3).for_each(|number| scenes::sources(place, number));
    "sources touched".to_owned()
}

/// Deletes, truncates or corrupts a file of the store, if there is one yet.
fn damage(folder: &std::path::Path, what: &str, random: &mut Random) -> String {
    let entries = walkdir::WalkDir::new(folder).sort_by_file_name().into_iter().filter_map(Result::ok);
    let files: Vec<PathBuf> =
        entries.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path).collect();
    if files.is_empty() {
        return format!("no {what} to damage");
    }
    let path = random.pick(&files);
    let size = fs::metadata(path).unwrap().len();
    match random.below(3) {
        0 => fs::remove_file(path).unwrap(),
        1 if size > 0 => Flip::any(size, random).in_file(path),
        _ => {
            let bytes = fs::read(path).unwrap();
            fs::remove_file(path).unwrap();
            fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
        }
    }
    format!("{what} {} damaged", path.file_name().unwrap().display())
}

/// A build that a signal stops at a random instant.
fn stopped(place: &Place, signal: Signal, random: &mut Random) -> Result<String, String> {
    let after = Duration::from_micros(random.below(40_000) as u64);
    let (ended, was_hit) = run_until(place.root(), "build -q -j 2", after, signal);
    let ended_well = was_hit || ended.code == Some(0);
    // A signal that arrives before its handler is installed ends the program as it ends any other.
    if signal == Signal::INT && ended.signal.is_none() && !ended_well || ended.stderr.contains("panicked") {
        return Err(format!("a build that was stopped: {ended}"));
    }
    Ok(format!("stopped by {signal:?} after {after:?}"))
}
