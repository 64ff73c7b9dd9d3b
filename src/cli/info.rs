//! `gs2e info`: the properties of one file or folder.

mod capture;
mod events;
mod scene;
mod tree;

use super::convert::events::EventInputOptions;
use super::{Console, ExitKind, VerbError, input, path};
use gs2e_event::evt::EvtVersion;
use gs2e_event::file::EventFormat;
use gs2e_files as files;
use gs2e_files::rename::parent_folder;
use gs2e_recipe::draft;
use gs2e_release as release;
use gs2e_scene::dynamic::file::frame_files;
use gs2e_scene::sog;
use gs2e_store::Store;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Arguments of `info`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Scenes: .ply, compressed .ply, .splat, .splatv, .spz, .sog, the folder of a SOG or of a \
    sequence of scenes. Events: .h5, .npz, \
    .raw, .aedat4, .txt, .csv, .mcap. Captures: a COLMAP model, a transforms.json, or a folder with a cameras.json. \
    Folders: a release, a store. For a scene, the up direction is a guess, and the recipe is a first try."
)]
pub(super) struct InfoArgs {
    /// Scene file, event file, capture, release or store
    #[arg(value_name = "PATH")]
    path: PathBuf,
    /// Write the first recipe for a scene to this file, with the path of the scene from its folder
    #[arg(long, value_name = "FILE")]
    recipe: Option<PathBuf>,
    #[command(flatten)]
    events: EventInputOptions,
}

/// The properties of a file or folder.
struct PathFacts {
    /// The kind of the path, for programs.
    kind: &'static str,
    /// The kind in words.
    title: &'static str,
    /// Label and text of each line for people.
    rows: Vec<(&'static str, String)>,
    /// Lines to paste into a recipe.
    recipe: Vec<String>,
    /// The values for programs, an object.
    value: Value,
}

impl InfoArgs {
    pub(super) fn run(self, console: &Console) -> Result<ExitKind, VerbError> {
        let facts = self.facts(console)?;
        if let Some(file) = &self.recipe {
            write_recipe(file, &facts.recipe)?;
            console.note(&format!("a first recipe is in {}", path(file)));
        }
        if console.json {
            let mut value = facts.value;
            (value["kind"], value["path"]) = (json!(facts.kind), json!(path(&self.path)));
            console.result(&value);
            return Ok(ExitKind::Done);
        }
        console.print(&format!("{}: {}", path(&self.path), facts.title));
        for (label, text) in &facts.rows {
            console.print(&format!("  {label:<13}{text}"));
        }
        if self.recipe.is_none() && !facts.recipe.is_empty() {
            facts.recipe.iter().for_each(|line| console.print(line));
            console.note("to save the recipe in another folder, with the path from there: --recipe FILE");
        }
        Ok(ExitKind::Done)
    }

    /// The path of the scene as the recipe has it.
    fn named(&self) -> Result<PathBuf, VerbError> {
        let Some(file) = &self.recipe else { return Ok(self.path.clone()) };
        let way = draft::relative_path(parent_folder(file), &self.path);
        way.map_err(|e| not_written(file, &e))
    }

    fn facts(&self, console: &Console) -> Result<PathFacts, VerbError> {
        let place = self.path.as_path();
        if !files::is_there(place) {
            return Err(input::missing_file("path", place));
        }
        if place.is_dir() { self.folder_facts(place, console) } else { self.file_facts(place, console) }
    }

    fn file_facts(&self, place: &Path, console: &Console) -> Result<PathFacts, VerbError> {
        // Opening gives the reason for a device, a dangling link or a missing permission.
        files::open(place).map_err(|e| input::unreadable_path(place, e))?;
        // The file itself states its version of EVT.
        if let Some(format) = EventFormat::for_path(place, EvtVersion::Evt2) {
            let opened = self.events.open(place, format)?;
            return events::event_facts(place, opened);
        }
        let is_json = place.extension().is_some_and(|extension| extension == "json");
        if is_json && place.file_name().is_some_and(|name| name != sog::META) {
            return capture::capture_facts(place, console);
        }
        scene::scene_facts(place, &self.named()?)
    }

    fn folder_facts(&self, place: &Path, console: &Console) -> Result<PathFacts, VerbError> {
        if release::summary::is_release(place) {
            return tree::release_facts(place);
        }
        if Store::is_store(place) {
            return tree::store_facts(place);
        }
        let holds = |name: &str| files::is_there(&place.join(name));
        // Captures may contain scene files too.
        let is_capture = holds("cameras.json") || holds("transforms.json");
        let is_sequence = !is_capture && frame_files(place).is_ok_and(|frames| frames.len() > 1);
        if holds(sog::META) || is_sequence {
            return scene::scene_facts(place, &self.named()?);
        }
        capture::capture_facts(place, console)
    }
}

/// Writes a first recipe. A file that exists may be a recipe that a person changed, so it stays.
fn write_recipe(file: &Path, recipe: &[String]) -> Result<(), VerbError> {
    if recipe.is_empty() {
        let what = "--recipe: only a scene has a first recipe";
        return Err(VerbError::usage("usage", what).help("gs2e init writes recipes for captures"));
    }
    let write = || File::create_new(file)?.write_all((recipe.join("\n") + "\n").as_bytes());
    write().map_err(|e| not_written(file, &e))
}

fn not_written(file: &Path, error: &io::Error) -> VerbError {
    VerbError::usage("output-unwritable", format!("cannot write {}: {error}", path(file)))
}

/// A number in five significant digits.
fn short(value: f64) -> String {
    let rounded = format!("{value:.4e}").parse().unwrap_or(value);
    gs2e_num::units::brief(rounded)
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn numbers_are_short() {
        for (value, wanted) in [(1.0 / 3.0, "0.33333"), (-0.0, "-0"), (123_456.0, "123460"), (2.0, "2")] {
            assert_eq!(short(value), wanted);
        }
    }
}
