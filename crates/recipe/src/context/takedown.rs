//! `takedown.txt`: scenes that are no longer made or passed on. One line per scene,
//! `<scene id or upstream id> <day> [reason]`; lines that begin with `#` and empty lines are
//! comments.

use crate::fault::{RecipeFault, RecipeFaults};
use crate::find::TAKEDOWN;
use crate::load::read_text;
use crate::problem::{FieldProblem, quote_text};
use crate::text::{SourceText, TextSpan};
use crate::{Recipe, RecipeFile, find, forms, names};
use gs2e_files::is_there;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The listed ids in lower case, each with the earliest day of its lines. Ids are compared without
/// case, so a difference of case never keeps a listed scene in a release.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TakedownList(BTreeMap<String, String>);

impl TakedownList {
    /// Returns true if the list is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the day since which a scene is listed. A line names a scene by its own id, by its
    /// upstream id, or by the kind of its source followed by the upstream id.
    #[must_use]
    pub fn since(&self, scene: &str, kind: &str, upstream_id: Option<&str>) -> Option<&str> {
        ids(scene, kind, upstream_id).find_map(|id| self.0.get(&id)).map(String::as_str)
    }

    /// Number of listed ids that match none of these scenes, each given as in
    /// [`TakedownList::since`].
    #[must_use]
    pub fn unmatched<'a>(
        &self,
        scenes: impl IntoIterator<Item = (&'a str, &'a str, Option<&'a str>)>,
    ) -> usize {
        let named = scenes.into_iter().flat_map(|(scene, kind, upstream)| ids(scene, kind, upstream));
        // A set, because several scenes may match the same id.
        let matched: BTreeSet<String> = named.filter(|id| self.0.contains_key(id)).collect();
        self.0.len() - matched.len()
    }

    /// Returns true if the scene of this recipe is listed.
    #[must_use]
    pub fn lists(&self, recipe: &Recipe) -> bool {
        let (kind, upstream_id) = recipe.source.origin();
        self.since(&recipe.scene, kind, upstream_id).is_some()
    }

    /// Returns the recipes of scenes that are not listed, and the numbers of removed scenes and of
    /// unmatched ids.
    #[must_use]
    pub fn keep(&self, mut recipes: Vec<Recipe>) -> (Vec<Recipe>, TakedownEffect) {
        let origins = recipes.iter().map(|recipe| (recipe.scene.as_str(), recipe.source.origin()));
        let unmatched = self.unmatched(origins.map(|(scene, (kind, upstream))| (scene, kind, upstream)));
        let all = recipes.len();
        recipes.retain(|recipe| !self.lists(recipe));
        let scenes = all - recipes.len();
        (recipes, TakedownEffect { scenes, unmatched })
    }

    /// Reads the lists in these files.
    ///
    /// # Errors
    /// A line is malformed or a file cannot be read. All faults are returned.
    pub fn read(files: &[PathBuf]) -> Result<Self, RecipeFaults> {
        let (mut list, mut faults) = (Self::default(), Vec::new());
        for file in files {
            match read_text(file) {
                Ok(body) => faults.extend(list.add(file, body)),
                Err(fault) => faults.push(fault),
            }
        }
        RecipeFaults::value_or(list, faults)
    }

    /// Adds the lines of a file and returns their faults.
    fn add(&mut self, file: &Path, body: String) -> Vec<RecipeFault> {
        let texts = vec![Arc::new(SourceText { path: file.to_owned(), body })];
        let mut faults = Vec::new();
        for line in texts[0].body.lines() {
            // Some editors put a byte order mark before the first line, which is no part of an id.
            let line = line.trim_start_matches('\u{feff}').trim();
            let place = |from: &str| {
                // Lines and their words are slices of the text, so the distance of their starts is
                // their offset.
                let at = from.as_ptr() as usize - texts[0].body.as_ptr() as usize;
                TextSpan { file: 0, start: byte_place(at), end: byte_place(at + from.len()) }
            };
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            match parse_entry(line) {
                Ok((id, day)) => {
                    let known = self.0.entry(id.to_lowercase()).or_insert_with(|| day.to_owned());
                    // Days of this form compare as texts.
                    if day < known.as_str() {
                        day.clone_into(known);
                    }
                }
                Err((word, message)) => {
                    let problem = FieldProblem::new(message).help(HELP).at(place(word));
                    faults.push(problem.fault(&texts, None));
                }
            }
        }
        faults
    }
}

/// The effect of takedown lists on some scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TakedownEffect {
    /// Scenes that are left out.
    pub scenes: usize,
    /// Ids in the lists that name none of the scenes.
    pub unmatched: usize,
}

/// The ids by which a scene may be listed, in lower case: its own id, and its upstream id, alone
/// and below the kind of its source.
fn ids<'a>(scene: &'a str, kind: &'a str, upstream_id: Option<&'a str>) -> impl Iterator<Item = String> + 'a {
    let upstream = upstream_id.into_iter().flat_map(move |id| [id.to_owned(), format!("{kind}/{id}")]);
    std::iter::once(scene.to_owned()).chain(upstream).map(|id| id.to_lowercase())
}

/// Converts an offset. Offsets fit because the reader limits the size of a file.
fn byte_place(at: usize) -> u32 {
    u32::try_from(at).unwrap_or(u32::MAX)
}

const HELP: &str = "write an id, a day and optionally a reason: dl3dv/0a1b 2025-06-01 requested by the owner";

/// Splits a line into id and day. The error holds the wrong word and the message.
fn parse_entry(line: &str) -> Result<(&str, &str), (&str, String)> {
    let mut words = line.split_whitespace();
    let id = words.next().unwrap_or(line);
    if let Err(because) = names::id_parts(id) {
        return Err((id, format!("{} is not a scene id, {because}", quote_text(id))));
    }
    let Some(day) = words.next() else { return Err((line, "the line has no day".into())) };
    if !forms::DAY.holds(day) {
        return Err((day, format!("the day is {}, wanted one such as 2025-05-21", quote_text(day))));
    }
    Ok((id, day))
}

/// Reads every `takedown.txt` next to the recipes of these paths or in a folder between them and
/// the given path. A scene listed in one file is listed for all recipes.
///
/// # Errors
/// A line is malformed, a file cannot be read, or a file has the name of the list in other letters.
pub fn read_takedown(paths: &[PathBuf]) -> Result<TakedownList, RecipeFaults> {
    // Faults of the recipes are reported when the recipes are read.
    takedown_of(paths, &find::find_all(paths).unwrap_or_default())
}

/// Reads the `takedown.txt` files of recipes that were already found.
///
/// # Errors
/// A line is malformed, a file cannot be read, or a file has the name of the list in other letters.
pub fn takedown_of(paths: &[PathBuf], recipes: &[RecipeFile]) -> Result<TakedownList, RecipeFaults> {
    let root = |path: &PathBuf| if path.is_dir() { path.clone() } else { find::parent_folder(path) };
    let roots: BTreeSet<PathBuf> = paths.iter().map(root).collect();
    let homes: BTreeSet<PathBuf> = recipes.iter().map(|recipe| find::parent_folder(&recipe.path)).collect();
    let above = |home: &PathBuf| {
        let inside = |folder: &&Path| roots.iter().any(|root| folder.starts_with(root));
        home.ancestors().take_while(inside).map(Path::to_owned).collect::<Vec<_>>()
    };
    let folders: BTreeSet<PathBuf> = homes.iter().flat_map(above).chain(roots.iter().cloned()).collect();
    let misnamed: Vec<RecipeFault> = folders.iter().flat_map(|folder| misnamed_in(folder)).collect();
    let files = folders.into_iter().map(|folder| folder.join(TAKEDOWN)).filter(|file| is_there(file));
    let read = TakedownList::read(&files.collect::<Vec<_>>())?;
    RecipeFaults::value_or(read, misnamed)
}

/// Returns a fault for each file of a folder with the name `takedown.txt` in other letters.
fn misnamed_in(folder: &Path) -> Vec<RecipeFault> {
    // A folder that cannot be listed is found where its recipes are read.
    let entries = std::fs::read_dir(or_here(folder)).into_iter().flatten().flatten();
    entries.filter_map(|entry| find::misnamed(&folder.join(entry.file_name()))).collect()
}

/// Converts an empty path to the current folder, as the system expects.
fn or_here(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(body: &str) -> Result<TakedownList, String> {
        let mut list = TakedownList::default();
        let faults = list.add(Path::new("takedown.txt"), body.to_owned());
        let found: Vec<String> =
            faults.iter().map(|fault| format!("{} {}", fault.location(), fault.message())).collect();
        if found.is_empty() { Ok(list) } else { Err(found.join("\n")) }
    }

    #[test]
    fn a_scene_is_listed_by_any_of_its_names() {
        let list = read("\u{feff}# ids\r\na/b 2025-01-02 it shows a face\r\n\n  11/AB 2024-12-31\n").unwrap();
        let t = |scene, kind, upstream, wanted| {
            assert_eq!(list.since(scene, kind, upstream), wanted, "{scene} {kind} {upstream:?}");
        };
        t("a/b", "colmap", None, Some("2025-01-02"));
        t("A/B", "colmap", None, Some("2025-01-02"));
        t("a", "colmap", None, None);
        t("a/b/c", "colmap", None, None);
        t("mine", "mvimgnet", Some("11/ab"), Some("2024-12-31"));
        t("mine", "mvimgnet", Some("12/ab"), None);
        t("11/ab", "none", None, Some("2024-12-31"));
        let list = read("mvimgnet/11/ab 2025-01-02\n").unwrap();
        assert!(list.since("mine", "mvimgnet", Some("11/ab")).is_some());
        assert!(list.since("mine", "dl3dv", Some("11/ab")).is_none());
        assert!(read("").unwrap().is_empty() && read("# none\n").unwrap().is_empty());
    }

    #[test]
    fn a_line_that_can_name_no_scene_is_refused() {
        for id in [
            "t/tiny/",
            "/t/tiny",
            "\"t/tiny\"",
            "'t/tiny'",
            "t\\tiny",
            "t/*",
            "t/tin?",
            "t//tiny",
            "t/../tiny",
        ] {
            let message = read(&format!("# list\n{id} 2025-06-01\n")).unwrap_err();
            assert!(
                message.starts_with("takedown.txt:2:1 ") && message.contains("is not a scene id"),
                "{id}: {message}"
            );
        }
        assert!(read("t/tiny 2025-06-01\nmvimgnet/11/16009258 2025-06-01\n").is_ok());
    }

    #[test]
    fn ids_that_name_no_scene_are_counted() {
        let list = read("a 2025-01-02\nB/c 2025-01-02\n11/ab 2025-01-02\nelsewhere 2025-01-02\n").unwrap();
        let scenes = [("a", "none", None), ("b/C", "none", None), ("mine", "mvimgnet", Some("11/ab"))];
        assert_eq!(list.unmatched(scenes), 1);
        assert_eq!(list.unmatched(scenes[..1].iter().copied()), 3);
        assert_eq!(list.unmatched([]), 4);
    }

    #[test]
    fn the_earliest_day_counts() {
        let list = read("a 2025-01-02\na 2024-01-02\na 2025-06-01").unwrap();
        assert_eq!(list.since("a", "none", None), Some("2024-01-02"));
    }

    #[test]
    fn a_line_that_is_none_is_told_with_its_place() {
        let t = |body: &str, wanted: &str| assert_eq!(read(body).unwrap_err(), wanted, "{body}");
        t("# a\na/b\n", "takedown.txt:2:1 the line has no day");
        t(
            "a 2025-01-02\n\n b 2025-02-30 why\n",
            "takedown.txt:3:4 the day is \"2025-02-30\", wanted one such as 2025-05-21",
        );
        t("a b 2025-01-02", "takedown.txt:1:3 the day is \"b\", wanted one such as 2025-05-21");
    }
}
