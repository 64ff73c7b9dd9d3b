//! From files and folders to recipes: all are read, and every fault is found, before anything runs.

use super::fault::{Fault, Faults, shown};
use super::merge::merge;
use super::reader::{Problems, Reader};
use super::resolve::Resolver;
use super::text::{Place, Text, Texts};
use super::tree::{MAX_BYTES, Node};
use super::{Position, Recipe, canonical, schema};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use walkdir::{DirEntry, WalkDir};

/// Files of a recipe folder that are no recipes.
const NOT_RECIPES: [&str; 3] = ["defaults.yaml", "sources.yaml", "release.yaml"];

/// Reads the recipes of files and folders, sorted by scene id.
///
/// A folder stands for every `.yaml` and `.yml` file below it but `defaults.yaml`, `sources.yaml`, `release.yaml` and
/// hidden ones. Under each recipe the nearest `defaults.yaml` is merged, upward to the folder that was given, or beside
/// the file that was given.
///
/// # Errors
/// Every fault of every recipe, the first [`super::LISTED`] of them in full: files that cannot be read or parsed,
/// fields that are unknown, missing, out of range or not built yet, and scenes that share an id or a folder.
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Recipe>, Faults> {
    let mut library = Library::default();
    let mut faults = Vec::new();
    let mut read = Vec::new();
    for (file, root) in find(paths, &mut faults) {
        match library.read(&file, &root) {
            Ok(recipe) => read.push(recipe),
            Err(more) => faults.extend(more),
        }
    }
    read.sort_by(|a, b| (&a.recipe.scene, &a.recipe.file).cmp(&(&b.recipe.scene, &b.recipe.file)));
    faults.extend(super::clash::clashes(&read));
    let mut seen = BTreeSet::new();
    faults.retain(|fault| seen.insert(fault.to_string()));
    if faults.is_empty() {
        Ok(read.into_iter().map(|r| r.recipe).collect())
    } else {
        Err(Faults::new(faults))
    }
}

/// A recipe with the files that it was read from.
pub(super) struct Read {
    pub recipe: Recipe,
    pub texts: Texts,
    /// Where the scene id stands.
    pub scene: Place,
}

/// The recipe files, each with the topmost folder in which its defaults are looked for.
fn find(paths: &[PathBuf], faults: &mut Vec<Fault>) -> Vec<(PathBuf, PathBuf)> {
    let mut found = Vec::new();
    for path in paths {
        if path.is_dir() {
            let before = found.len();
            walk(path, &mut found, faults);
            if found.len() == before {
                let help = "a recipe is a .yaml file other than defaults.yaml, sources.yaml and release.yaml";
                faults.push(whole(path, "no recipe is in this folder", Some(help)));
            }
        } else if path.file_name().is_some_and(|name| NOT_RECIPES.iter().any(|n| name == *n)) {
            faults.push(whole(path, "this file is no recipe", Some("name a recipe, or the folder")));
        } else {
            let folder = path.parent().unwrap_or(Path::new("")).to_owned();
            found.push((path.clone(), folder));
        }
    }
    let mut seen = BTreeSet::new();
    found.retain(|(file, _)| seen.insert(file.canonicalize().unwrap_or_else(|_| file.clone())));
    found
}

fn walk(root: &Path, found: &mut Vec<(PathBuf, PathBuf)>, faults: &mut Vec<Fault>) {
    let visible =
        |entry: &DirEntry| entry.depth() == 0 || !entry.file_name().as_encoded_bytes().starts_with(b".");
    for entry in WalkDir::new(root).follow_links(true).sort_by_file_name().into_iter().filter_entry(visible) {
        match entry {
            Ok(entry) if is_recipe(&entry) => found.push((entry.into_path(), root.to_owned())),
            Ok(_) => {}
            Err(error) => {
                let path = error.path().unwrap_or(root).to_owned();
                faults.push(whole(
                    &path,
                    &format!("cannot be searched: {}", io_words(error.io_error())),
                    None,
                ));
            }
        }
    }
}

fn is_recipe(entry: &DirEntry) -> bool {
    let path = entry.path();
    let yaml = path.extension().is_some_and(|e| e == "yaml" || e == "yml");
    yaml && entry.file_type().is_file() && !NOT_RECIPES.iter().any(|name| entry.file_name() == *name)
}

fn io_words(error: Option<&std::io::Error>) -> String {
    error.map_or_else(|| "a link leads back into its own folder".to_owned(), words)
}

/// What the system says, without its error number.
fn words(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_lowercase()
}

fn whole(path: &Path, message: &str, help: Option<&str>) -> Fault {
    let text = Text { path: path.to_owned(), body: String::new() };
    Fault::new(message.to_owned(), help.map(str::to_owned), Arc::new(text), None)
}

/// The files read so far: defaults are shared by many recipes.
#[derive(Default)]
struct Library {
    defaults: BTreeMap<PathBuf, Result<(Arc<Text>, Node), Vec<Fault>>>,
}

impl Library {
    fn read(&mut self, file: &Path, root: &Path) -> Result<Read, Vec<Fault>> {
        let (text, own) = load(file, 0)?;
        let mut texts = vec![text];
        let mut folders = vec![folder_of(file)];
        let tree = match defaults_of(file, root) {
            None => own,
            Some(path) => {
                let (text, under) = self.defaults(&path)?;
                texts.push(text);
                folders.push(folder_of(&path));
                merge(own, &under)
            }
        };
        resolve(file, tree, texts, &folders)
    }

    fn defaults(&mut self, path: &Path) -> Result<(Arc<Text>, Node), Vec<Fault>> {
        self.defaults.entry(path.to_owned()).or_insert_with(|| load(path, 1)).clone()
    }
}

fn folder_of(file: &Path) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).to_owned()
}

/// The nearest `defaults.yaml` from the file's folder up to `root`.
fn defaults_of(file: &Path, root: &Path) -> Option<PathBuf> {
    let folders = file.ancestors().skip(1).take_while(|folder| folder.starts_with(root));
    folders.map(|folder| folder.join("defaults.yaml")).find(|path| path.is_file())
}

/// Reads and parses a file whose places carry the index `index`.
pub(super) fn load(file: &Path, index: u32) -> Result<(Arc<Text>, Node), Vec<Fault>> {
    let text = Arc::new(Text { path: file.to_owned(), body: body(file).map_err(|fault| vec![fault])? });
    match Node::parse(&text, index) {
        Ok(node) => Ok((text, node)),
        Err(problems) => {
            let texts = vec![text; index as usize + 1];
            Err(problems.into_iter().map(|p| p.fault(&texts, None)).collect())
        }
    }
}

fn body(file: &Path) -> Result<String, Fault> {
    let bytes = match std::fs::metadata(file) {
        Ok(about) if about.len() > MAX_BYTES as u64 => {
            let message = format!("the file has {} bytes, wanted at most {MAX_BYTES}", about.len());
            return Err(whole(file, &message, Some("is it a recipe?")));
        }
        Ok(_) => std::fs::read(file),
        Err(error) => Err(error),
    };
    let bytes = bytes.map_err(|error| whole(file, &format!("cannot be read: {}", words(&error)), None))?;
    String::from_utf8(bytes).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        let text =
            Text { path: file.to_owned(), body: String::from_utf8_lossy(error.as_bytes()).into_owned() };
        let start = u32::try_from(valid).unwrap_or(u32::MAX);
        let place = Place { file: 0, start, end: start };
        Fault::new(
            "a byte that is not UTF-8".into(),
            Some("save the file as UTF-8".into()),
            Arc::new(text),
            Some(place),
        )
    })
}

fn resolve(file: &Path, tree: Node, texts: Texts, folders: &[PathBuf]) -> Result<Read, Vec<Fault>> {
    let problems = Problems::default();
    let raw = schema::Recipe::deserialize(Reader::new(&tree, &problems));
    let raw = raw.map_err(|problem| problems.borrow_mut().push(problem)).unwrap_or_default();
    let resolved = Resolver { problems: &problems, folders, root: tree.place }.recipe(&raw);
    let mut problems = problems.into_inner();
    problems.sort_by_key(super::problem::Problem::order);
    match resolved {
        Some(resolved) if problems.is_empty() => {
            let named_at = super::NamedAt {
                scene: position(&texts, raw.scene.given().map(|(_, place)| place)),
                source: position(&texts, raw.source.given().map(|(_, place)| place)),
                reconstruct: position(&texts, raw.reconstruct.given().map(|(_, place)| place)),
            };
            let scene = raw.scene.given().map_or(tree.place, |(_, place)| place);
            let merged = canonical::merged(&raw, &resolved);
            Ok(Read { recipe: assemble(file, named_at, resolved, merged), texts, scene })
        }
        _ => Err(problems.into_iter().map(|p| p.fault(&texts, Some(&tree))).collect()),
    }
}

fn position(texts: &Texts, place: Option<Place>) -> Option<Position> {
    let place = place?;
    let text = &texts[place.file as usize];
    let (line, column) = text.position(place.start as usize);
    Some(Position { file: shown(&text.path), line, column })
}

fn assemble(
    file: &Path,
    named_at: super::NamedAt,
    resolved: super::resolve::Resolved,
    merged: serde_json::Value,
) -> Recipe {
    Recipe {
        file: file.to_owned(),
        named_at,
        scene: resolved.scene,
        seed: resolved.seed,
        source: resolved.source,
        reconstruct: resolved.reconstruct,
        camera: resolved.camera,
        trajectories: resolved.trajectories,
        rate: resolved.rate,
        render: resolved.render,
        sensor: resolved.sensor,
        outputs: resolved.outputs,
        sharp_every: resolved.sharp_every,
        checks: resolved.checks,
        licence: resolved.licence,
        merged,
    }
}
