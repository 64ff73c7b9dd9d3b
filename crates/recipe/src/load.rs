//! Loading of one recipe from its file and the defaults file under it.

use super::drawn::{SensorDraws, expand_contrast, for_each_sensor, take_preset};
use super::fault::{RecipeFault, displayed_path};
use super::field::Field;
use super::find::{RecipeFile, parent_folder};
use super::merge::merge_nodes;
use super::problem::FieldProblem;
use super::reader::{Problems, TreeReader};
use super::resolve::Resolver;
use super::text::{SourceText, TextSpan, Texts};
use super::tree::{self, MAX_BYTES, MappingEntry, NodeKind, TreeNode};
use super::{NamedAt, Recipe, RecipeMeta, RecipePosition, canonical, output, preset, schema};
use gs2e_files as files;
use gs2e_files::stat::{FileStat, StatSighting};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The version of the schema.
const VERSION: u64 = 1;

/// A recipe, with the data for later messages about its scene id.
pub(super) struct ReadRecipe {
    pub recipe: Recipe,
    pub texts: Texts,
    /// Place of the scene id.
    pub scene: TextSpan,
}

/// A file that was read and parsed.
#[derive(Clone)]
struct ParsedFile {
    text: Arc<SourceText>,
    /// The tree; absent if the file is empty.
    tree: Option<TreeNode>,
    /// State of the file before it was read.
    sighting: StatSighting,
}

/// The defaults files of some recipes. Many recipes can share one file.
pub(super) struct DefaultsLibrary {
    defaults: BTreeMap<PathBuf, Result<ParsedFile, Vec<RecipeFault>>>,
}

impl DefaultsLibrary {
    /// Reads the defaults of `files`.
    pub(super) fn read_defaults(files: &[RecipeFile]) -> Self {
        let mut defaults = BTreeMap::new();
        for path in files.iter().filter_map(|file| file.defaults.as_ref()) {
            // One defaults file can apply to many recipes; it is read once.
            defaults.entry(path.clone()).or_insert_with(|| parse_file(path, 1));
        }
        Self { defaults }
    }

    /// Reads a recipe.
    pub(super) fn recipe(&self, file: &RecipeFile) -> Result<ReadRecipe, Vec<RecipeFault>> {
        self.parts(file)?.recipe(file)
    }

    /// Reads a recipe and merges it over its defaults, without resolving it.
    pub(super) fn parts(&self, file: &RecipeFile) -> Result<RecipeParts, Vec<RecipeFault>> {
        let RecipeFile { path, defaults } = file;
        let own = parse_file(path, 0)?;
        let tree = own.tree.ok_or_else(|| {
            let help = "a recipe has at least version, scene, source and trajectories";
            vec![RecipeFault::of_file(path, "the file is empty", Some(help))]
        })?;
        let sightings = vec![(path.clone(), own.sighting)];
        let mut parts =
            RecipeParts { texts: vec![own.text], folders: vec![parent_folder(path)], tree, sightings };
        // Asked before the merge: a preset that the defaults name is one of them, and does not remove their
        // keys.
        let has_preset = preset::names_paper(&parts.tree);
        if let Some(path) = defaults {
            // Each recipe has the faults of its defaults; repeated faults are dropped when they are
            // listed.
            let under = self.defaults[path].clone()?;
            parts.sightings.push((path.clone(), under.sighting));
            parts.texts.push(under.text);
            parts.folders.push(parent_folder(path));
            if let Some(mut under) = under.tree {
                if has_preset {
                    preset::remove_keys(&mut under);
                }
                parts.tree = merge_nodes(parts.tree, &under);
            }
        }
        Ok(parts.with_presets())
    }
}

/// The files of a recipe and their merged tree.
pub(super) struct RecipeParts {
    texts: Texts,
    folders: Vec<PathBuf>,
    tree: TreeNode,
    /// State of the files before they were read.
    sightings: Vec<(PathBuf, StatSighting)>,
}

impl RecipeParts {
    /// Reads one file without merging.
    pub(super) fn without_defaults(file: &Path) -> Result<Self, Vec<RecipeFault>> {
        let ParsedFile { text, tree, sighting } = parse_file(file, 0)?;
        let sightings = vec![(file.to_owned(), sighting)];
        let tree = tree.unwrap_or_else(empty_tree);
        Ok(Self { texts: vec![text], folders: vec![parent_folder(file)], tree, sightings })
    }

    /// Parses a text that is in no file. Faults name it as `name`.
    pub(super) fn of_text(name: &Path, body: String) -> Result<Self, Vec<RecipeFault>> {
        if body.len() > MAX_BYTES {
            let message = format!("the text has {} bytes, wanted at most {MAX_BYTES}", body.len());
            return Err(vec![RecipeFault::of_file(name, &message, None)]);
        }
        let text = Arc::new(SourceText { path: name.to_owned(), body });
        let tree = parse_text(&text, 0)?.unwrap_or_else(empty_tree);
        Ok(Self { texts: vec![text], folders: vec![PathBuf::new()], tree, sightings: Vec::new() })
    }

    /// Returns true if the tree is a mapping with this key.
    pub(super) fn has(&self, key: &str) -> bool {
        matches!(&self.tree.kind, NodeKind::Map(entries) if entries.iter().any(|entry| entry.key == key))
    }

    /// The text of a key at the top of the tree, if it has one.
    pub(super) fn text(&self, key: &str) -> Option<&str> {
        let NodeKind::Map(entries) = &self.tree.kind else { return None };
        entries.iter().find(|entry| entry.key == key).and_then(|entry| match &entry.value.kind {
            NodeKind::Scalar { text, .. } => Some(text.as_str()),
            _ => None,
        })
    }

    /// Returns the parts with the whole tree as the value of one key.
    pub(super) fn under(mut self, key: &str) -> Self {
        let place = self.tree.place;
        let entry = MappingEntry { key: key.to_owned(), place, value: self.tree };
        self.tree = TreeNode { place, kind: NodeKind::Map(vec![entry]) };
        self
    }

    /// Removes some keys and merges the result over a constant text of this program.
    ///
    /// # Panics
    /// The text is no mapping.
    pub(super) fn standing_in(mut self, without: &[&str], text: &str) -> Self {
        // The keys go first, so that faults in them are never reported.
        if let NodeKind::Map(entries) = &mut self.tree.kind {
            entries.retain(|entry| !without.contains(&entry.key.as_str()));
        }
        let under = self.add_text(text);
        self.tree = merge_nodes(self.tree, &under);
        self
    }

    /// Parses a constant text of this program.
    fn add_text(&mut self, text: &str) -> TreeNode {
        let text = Arc::new(SourceText { path: PathBuf::new(), body: text.to_owned() });
        let index = u32::try_from(self.texts.len()).expect("recipes are made from few files");
        let tree = tree::parse_tree(&text, index).ok().flatten().expect("the text is sound");
        self.texts.push(text);
        self.folders.push(PathBuf::new());
        tree
    }

    /// Merges the recipe over the preset that it names, and replaces the presets of its sensors.
    pub(super) fn with_presets(self) -> Self {
        let paper = preset::names_paper(&self.tree);
        let parts = if paper { self.standing_in(&[], preset::PAPER) } else { self };
        parts.with_ranges()
    }

    /// Writes short forms of sensors in full, and replaces their preset `randomised` by its ranges, which
    /// their other keys override.
    pub(super) fn with_ranges(mut self) -> Self {
        let mut tree = std::mem::replace(&mut self.tree, empty_tree());
        for_each_sensor(&mut tree, &mut |_, sensor| {
            expand_contrast(sensor);
            if let Some(ranges) = take_preset(sensor) {
                // A text for each sensor: a law is known by its place.
                let ranges = self.add_text(&ranges);
                *sensor = merge_nodes(std::mem::replace(sensor, empty_tree()), &ranges);
            }
        });
        self.tree = tree;
        self
    }

    /// Resolves the recipe, and leaves its meta data empty.
    pub(super) fn resolved(&self) -> Result<Recipe, Vec<RecipeFault>> {
        Ok(self.read()?.1)
    }

    /// Reads and resolves the recipe, and draws its numbers.
    fn read(&self) -> Result<(schema::RecipeSchema, Recipe, SensorDraws), Vec<RecipeFault>> {
        if let Some(fault) = self.other_version() {
            return Err(vec![fault]);
        }
        let problems = Problems::default();
        let draws = SensorDraws::find(&self.tree, &problems);
        let resolve = |raw: &schema::RecipeSchema, resolver: &Resolver<'_>| {
            // The ends come first: of several messages on one law, the first is kept.
            draws.check_ends(&self.tree, resolver);
            let recipe = resolver.recipe(raw);
            draws.keep_first(resolver.problems);
            draws.draw(&self.tree, recipe?, resolver)
        };
        let (raw, recipe) = self.resolve_tree(draws.middle(), problems, resolve)?;
        Ok((raw, recipe, draws))
    }

    /// Reads the tree as `T`, then resolves it. All faults of both steps are returned in file
    /// order.
    pub(super) fn resolve<T: DeserializeOwned + Default, R>(
        &self,
        resolve: impl FnOnce(&T, &Resolver<'_>) -> Option<R>,
    ) -> Result<(T, R), Vec<RecipeFault>> {
        self.resolve_tree(&self.tree, Problems::default(), resolve)
    }

    /// [`Self::resolve`] for another tree with the same places. Some problems may be known.
    fn resolve_tree<T: DeserializeOwned + Default, R>(
        &self,
        tree: &TreeNode,
        problems: Problems,
        resolve: impl FnOnce(&T, &Resolver<'_>) -> Option<R>,
    ) -> Result<(T, R), Vec<RecipeFault>> {
        let raw = T::deserialize(TreeReader::new(tree, &problems));
        let raw = raw.map_err(|problem| problems.borrow_mut().push(problem)).unwrap_or_default();
        let resolver = Resolver { problems: &problems, folders: &self.folders, root: self.tree.place };
        let resolved = resolve(&raw, &resolver);
        let mut problems = problems.into_inner();
        // Reading and resolving report in different orders; the user reads the file from the top.
        problems.sort_by_key(FieldProblem::order);
        match resolved {
            Some(resolved) if problems.is_empty() => Ok((raw, resolved)),
            _ => Err(problems.into_iter().map(|p| p.fault(&self.texts, Some(&self.tree))).collect()),
        }
    }

    /// Resolves the recipe with its meta data.
    pub(super) fn recipe(self, file: &RecipeFile) -> Result<ReadRecipe, Vec<RecipeFault>> {
        let (raw, mut recipe, draws) = self.read()?;
        let at = |field: Option<TextSpan>| field.map(|place| self.position(place));
        let named_at = NamedAt {
            scene: at(raw.scene.place()),
            source: at(raw.source.place()),
            reconstruct: at(raw.reconstruct.place()),
        };
        let scene = raw.scene.place().expect("a recipe that was resolved has a scene id");
        let mut merged = canonical::canonical_recipe(&raw, &recipe);
        draws.write_laws(&mut merged);
        let unused = unused_sections(&raw, &recipe);
        recipe.meta = RecipeMeta { file: file.clone(), sightings: self.sightings, named_at, unused, merged };
        Ok(ReadRecipe { recipe, texts: self.texts, scene })
    }

    /// In a recipe of another version, only the version is reported.
    fn other_version(&self) -> Option<RecipeFault> {
        #[derive(Default, serde::Deserialize)]
        #[serde(default)]
        struct VersionedFile {
            version: Field<u64>,
        }

        let ignored = Problems::default();
        let raw =
            <VersionedFile as serde::Deserialize>::deserialize(TreeReader::new(&self.tree, &ignored)).ok()?;
        let (version, place) = raw.version.given().filter(|(version, _)| **version != VERSION)?;
        let problem = FieldProblem::of_field(format!("is {version}, but this gs2e reads {VERSION}"));
        Some(
            problem
                .help("use another gs2e, or write version: 1")
                .at(place)
                .fault(&self.texts, Some(&self.tree)),
        )
    }

    fn position(&self, place: TextSpan) -> RecipePosition {
        let text = &self.texts[place.file as usize];
        let (line, column) = text.position(place.start as usize);
        RecipePosition { file: displayed_path(&text.path), line, column }
    }
}

/// The sections for outputs that a recipe does not ask for. Those of a defaults file serve other recipes.
fn unused_sections(raw: &schema::RecipeSchema, recipe: &Recipe) -> Vec<String> {
    let own =
        output::sections(raw).into_iter().filter(|(_, place)| place.is_some_and(|place| place.file == 0));
    own.filter(|(output, _)| !recipe.asks_for(*output)).map(|(output, _)| output.name().to_owned()).collect()
}

/// A mapping without keys: the content of an empty file.
fn empty_tree() -> TreeNode {
    TreeNode { place: TextSpan { file: 0, start: 0, end: 0 }, kind: NodeKind::Map(Vec::new()) }
}

/// Reads and parses a file. Its places carry the number `index`.
fn parse_file(file: &Path, index: u32) -> Result<ParsedFile, Vec<RecipeFault>> {
    let (body, sighting) = read_file(file).map_err(|fault| vec![fault])?;
    let text = Arc::new(SourceText { path: file.to_owned(), body });
    let tree = parse_text(&text, index)?;
    Ok(ParsedFile { text, tree, sighting })
}

/// Parses a text. Its places carry the number `index`.
fn parse_text(text: &Arc<SourceText>, index: u32) -> Result<Option<TreeNode>, Vec<RecipeFault>> {
    tree::parse_tree(text, index).map_err(|problems| {
        // Places in this text have the number `index`, so the list must reach that far.
        let texts = vec![Arc::clone(text); index as usize + 1];
        problems.into_iter().map(|problem| problem.fault(&texts, None)).collect()
    })
}

fn read_file(file: &Path) -> Result<(String, StatSighting), RecipeFault> {
    let unreadable =
        |error| RecipeFault::of_file(file, &format!("cannot be read: {}", system_words(&error)), None);
    let opened = files::open(file).map_err(unreadable)?;
    let about = opened.metadata().map_err(unreadable)?;
    // Taken before the bytes are read, so that a change in between leaves another state.
    let sighting = StatSighting::observed_now(FileStat::from(&about));
    if about.len() > MAX_BYTES as u64 {
        let message = format!("the file has {} bytes, wanted at most {MAX_BYTES}", about.len());
        return Err(RecipeFault::of_file(file, &message, Some("is it a recipe?")));
    }
    let bytes = files::read_open(opened, MAX_BYTES as u64).map_err(unreadable)?;
    let text = String::from_utf8(bytes).map_err(|error| {
        // The lossy text equals the file up to the first wrong byte, so the place is right in it.
        let valid = error.utf8_error().valid_up_to();
        let start = u32::try_from(valid).unwrap_or(u32::MAX);
        let text = SourceText {
            path: file.to_owned(),
            body: String::from_utf8_lossy(error.as_bytes()).into_owned(),
        };
        let problem = FieldProblem::new("a byte that is not UTF-8").help("save the file as UTF-8");
        problem.at(TextSpan { file: 0, start, end: start + 1 }).fault(&vec![Arc::new(text)], None)
    })?;
    Ok((text, sighting))
}

/// Reads the text of a file next to the recipes that is not YAML.
pub(super) fn read_text(file: &Path) -> Result<String, RecipeFault> {
    read_file(file).map(|(body, _)| body)
}

/// Returns the message of the operating system without its error number.
pub(super) fn system_words(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split_once(" (os error").map_or_else(|| text.clone(), |(text, _)| text.to_lowercase())
}
