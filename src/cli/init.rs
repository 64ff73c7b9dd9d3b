//! `gs2e init`: writes one recipe per scene of a dataset on disk. Existing recipes stay as they
//! are.

mod names;
mod sample;
mod write;

use super::words::{Word, one_of};
use super::{CommonArgs, Console, ExitKind, UserMessage, VerbError, input, path};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use gs2e_files::is_there;
use gs2e_recipe::draft::{self, CameraPace, RecipeDraft};
use gs2e_source::inventory::{AcceptanceRules, InventoryScene};
use gs2e_source::kind::CaptureKind;
use gs2e_source::{DiskCapture, SourceWarning, ViewSelection, check_pattern, inventory};
use names::FileName;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Arguments of `init`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Writes the recipes to the folder of --to, with one defaults.yaml for shared values. Running it again adds \
    new scenes and changes no existing recipe. Scenes that cannot be used are listed in rejected.tsv in that folder, each with \
    its reason."
)]
pub(super) struct InitArgs {
    /// Layout of the dataset
    #[arg(value_name = "FORMAT", value_parser = kind_parser())]
    format: CaptureKind,
    /// Folder of the dataset, or of a part of it
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Folder for the recipes
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    /// Scene file of each capture: {path} is the capture's folder, {name} the scene's id without
    /// the part before the first "/" [default: {path}/point_cloud.ply, unless defaults.yaml has
    /// `reconstruct`]
    #[arg(long, value_name = "PATTERN")]
    scene: Option<String>,
    /// Train each scene on its photos, instead of reading a scene file
    #[arg(long, conflicts_with = "scene")]
    train: bool,
    /// First part of the scene ids [default: the format]
    #[arg(long, value_name = "NAME")]
    prefix: Option<String>,
    /// Classes of MVImgNet to use [default: all]
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    classes: Vec<String>,
    /// Maximum number of recipes, existing ones included; the scenes with the smallest hash of seed
    /// and id are added first
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// Seed of the choice for --limit
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Number of views to use per scene, picked evenly [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    views: Option<u32>,
    /// Minimum number of registered views per scene
    #[arg(long, value_name = "N", default_value_t = 10)]
    min_views: usize,
    /// Minimum length of the shorter side of a view, in pixels
    #[arg(long, value_name = "PX", default_value_t = 256)]
    min_side: u32,
    /// Leave out photos whose names match; may be repeated [default: *_bg_removed.png for mvimgnet]
    #[arg(long, value_name = "GLOB", value_parser = parse_glob)]
    exclude: Vec<String>,
    /// Speed of the cameras: 200, 400 or 800 px/s; with --preset paper 10, 5 or 2.5 poses per view
    /// [default: medium]
    #[arg(long, value_parser = one_of(&PACES))]
    pace: Option<CameraPace>,
    /// Settings of the paper, with its frame rate, instead of a speed in pixels and as many frames as
    /// the sensor needs
    #[arg(long, value_parser = PossibleValuesParser::new(["paper"]))]
    preset: Option<String>,
}

const PACES: [Word<CameraPace>; 3] =
    [("mild", "", CameraPace::Mild), ("medium", "", CameraPace::Medium), ("strong", "", CameraPace::Strong)];

/// Parser of a kind of capture by its name.
fn kind_parser() -> impl TypedValueParser<Value = CaptureKind> {
    // A video is a file, and a tree of scenes has folders.
    let kinds = CaptureKind::ALL.into_iter().filter(|kind| !kind.is_video());
    let names = PossibleValuesParser::new(kinds.map(CaptureKind::name));
    names.map(|name| CaptureKind::by_name(&name).expect("the parser accepts these names only"))
}

fn parse_glob(text: &str) -> Result<String, String> {
    check_pattern(text).map(|()| text.to_owned())
}

/// Default place of scene files.
const NEXT_TO_VIEWS: &str = "{path}/point_cloud.ply";

/// The result of `init`, by scene.
#[derive(Debug, Default)]
struct InitOutcome {
    /// Scenes for which a recipe was written, and the recipes.
    written: Vec<(String, PathBuf)>,
    /// Number of scenes that had a recipe already.
    kept: usize,
    /// Number of usable scenes that `--limit` left out.
    left: usize,
    /// Rejected scenes, each with its folder and the code and text of the reason.
    rejected: Vec<(String, PathBuf, &'static str, String)>,
    /// Used scenes, and the oddities of each.
    notices: Vec<(String, String)>,
    /// Scene files that recipes name and that do not exist.
    without_scene: Vec<PathBuf>,
}

/// A usable scene.
struct SceneCandidate {
    scene: String,
    recipe: PathBuf,
    path: PathBuf,
    notices: Vec<String>,
}

impl InitArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        common.limit_cores();
        if !self.classes.is_empty() && !self.format.dataset().is_some_and(|dataset| dataset.has_classes) {
            return Err(VerbError::usage("usage", "--classes: only MVImgNet has classes"));
        }
        if self.scene.is_some() && self.format.needs_poses() {
            let what =
                "--scene: the poses of photos are found in a world of their own, which no scene file has";
            return Err(VerbError::usage("usage", what).help("leave it out: the scenes are trained"));
        }
        if self.train && self.format.has_gaussians() {
            let what = format!("--train: a {} folder has the Gaussians, and no photos", self.format.name());
            return Err(VerbError::usage("usage", what).help("leave it out: the scenes are read"));
        }
        let reconstructs = draft::defaults_reconstruct(&self.to)?;
        // Existing defaults are never rewritten, so the pace would have no effect.
        if reconstructs.is_some() && (self.pace.is_some() || self.preset.is_some()) {
            let file = draft::defaults_in(&self.to);
            let what = format!("--pace and --preset are written into {}, which exists", file.display());
            let help = "change the speed there, or leave the option out";
            return Err(VerbError::usage("usage", what).help(help));
        }
        let entries = inventory::take_inventory(self.format, &self.dir, &self.rules())
            .map_err(|e| input::no_source("dataset", &e, &self.dir))?;
        if entries.is_empty() {
            let what = format!("found no {} scene in {}", self.format.name(), self.dir.display());
            let help = "gs2e init --help describes each layout";
            return Err(VerbError::usage("input-missing", what).help(help));
        }
        let mut outcome = InitOutcome::default();
        let candidates = self.candidates(entries, &mut outcome);
        let chosen = self.choose(candidates, &mut outcome);
        // Nothing is written before this line, so wrong input leaves no folder behind.
        write::make_folder(&self.to)?;
        if reconstructs.is_none() {
            let text = if self.preset.is_some() { draft::paper_defaults_text } else { draft::defaults_text };
            let text = text(self.pace.unwrap_or(CameraPace::Medium));
            write::write_file(&draft::defaults_in(&self.to), &text)?;
        }
        let pattern = self.scene.as_deref();
        // A model folder contains Gaussians, and a reconstruction makes them.
        let reconstructs = reconstructs == Some(true);
        let own = self.format.has_gaussians() || self.format.needs_poses() || self.train || reconstructs;
        let pattern = pattern.or((!own).then_some(NEXT_TO_VIEWS));
        for candidate in chosen {
            self.write(candidate, pattern, reconstructs, &mut outcome)?;
        }
        write::write_rejected(&self.to, &outcome.rejected)?;
        outcome.report(&self, console);
        Ok(ExitKind::Done)
    }

    fn rules(&self) -> AcceptanceRules {
        AcceptanceRules {
            min_side: self.min_side,
            min_views: self.min_views,
            selection: self.selection(),
            classes: self.classes.iter().cloned().collect(),
        }
    }

    /// The selection of the views.
    fn selection(&self) -> ViewSelection {
        let exclude = self.format.leftovers().into_iter().chain(self.exclude.iter().cloned()).collect();
        ViewSelection { views: self.views, exclude, poses: None }
    }

    /// Returns the usable scenes, and rejects the others.
    fn candidates(&self, entries: Vec<InventoryScene>, outcome: &mut InitOutcome) -> Vec<SceneCandidate> {
        let prefix = self.prefix.as_deref().unwrap_or(self.format.name());
        let mut sound = Vec::new();
        for InventoryScene { name, path, verdict } in entries {
            let scene = format!("{prefix}/{name}");
            match (verdict, draft::screen_text(&scene, &[&path])) {
                (Ok(warnings), Ok(())) => {
                    let notices: Vec<String> =
                        warnings.iter().filter(|w| is_odd(w)).map(ToString::to_string).collect();
                    sound.push((scene, name, path, notices));
                }
                (Ok(_), Err(because)) => outcome.rejected.push((scene, path, "name", because)),
                (Err(rejection), _) => {
                    outcome.rejected.push((scene, path, rejection.code(), rejection.to_string()));
                }
            }
        }
        let scenes: Vec<(&str, &str)> =
            sound.iter().map(|(s, name, ..)| (s.as_str(), name.as_str())).collect();
        // Names are assigned to all usable scenes, also those with a recipe: a name depends on the
        // scenes that share it.
        let files = names::assign(&self.to, &scenes);
        let candidate = |((scene, _, path, mut notices), file): (_, FileName)| {
            let FileName { path: recipe, because } = file;
            let named = because.map(|why| format!("its recipe is {}, because {why}", recipe.display()));
            Vec::extend(&mut notices, named);
            SceneCandidate { scene, recipe, path, notices }
        };
        sound.into_iter().zip(files).map(candidate).collect()
    }

    /// Chooses the scenes that get a recipe now.
    fn choose(&self, candidates: Vec<SceneCandidate>, outcome: &mut InitOutcome) -> Vec<SceneCandidate> {
        let (kept, mut new): (Vec<SceneCandidate>, Vec<SceneCandidate>) =
            candidates.into_iter().partition(|candidate| is_there(&candidate.recipe));
        outcome.kept = kept.len();
        if let Some(limit) = self.limit {
            // Existing recipes count, so the same command again adds nothing.
            let room = limit.saturating_sub(kept.len());
            // Cached, because each key is a SHA-256.
            new.sort_by_cached_key(|candidate| sample::sample_rank(self.seed, &candidate.scene));
            outcome.left = new.len().saturating_sub(room);
            new.truncate(room);
            // Recipes are written in the order of their files, not in that of the draw.
            new.sort_by(|a, b| a.recipe.cmp(&b.recipe));
        }
        new
    }

    fn write(
        &self,
        candidate: SceneCandidate,
        pattern: Option<&str>,
        reconstructs: bool,
        outcome: &mut InitOutcome,
    ) -> Result<(), VerbError> {
        let SceneCandidate { scene, recipe, path, notices } = candidate;
        let folder = recipe.parent().unwrap_or(Path::new(""));
        write::make_folder(folder)?;
        let given = pattern.map(|pattern| filled_pattern(pattern, &path, &scene));
        outcome.without_scene.extend(given.iter().filter(|file| !is_there(file)).cloned());
        let way = |to: &Path| write::relative_path(folder, to);
        let kind = self.format;
        let mut selection = self.selection();
        if self.exclude.is_empty() {
            // A recipe without `exclude` already uses the dataset's own pattern. A written list
            // replaces that default, so it holds both.
            selection.exclude.clear();
        }
        let captured = DiskCapture { selection, ..DiskCapture::all_views(kind, way(&path)?) };
        let given = given.map(|file| way(&file)).transpose()?;
        let trained = self.train || (kind.needs_poses() && !reconstructs);
        let text =
            RecipeDraft { scene: &scene, captured: &captured, given: given.as_deref(), trained }.text();
        write::write_file(&recipe, &text)?;
        outcome.notices.extend(notices.into_iter().map(|notices| (scene.clone(), notices)));
        outcome.written.push((scene, recipe));
        Ok(())
    }
}

/// The scene file that a pattern names for a scene.
fn filled_pattern(pattern: &str, path: &Path, scene: &str) -> PathBuf {
    let name = scene.split_once('/').map_or(scene, |(_, name)| name);
    PathBuf::from(pattern.replace("{path}", &path.to_string_lossy()).replace("{name}", name))
}

/// Returns true if a warning is about this scene alone. Lenses concern the whole dataset, and are
/// reported when the scene is built.
fn is_odd(warning: &SourceWarning) -> bool {
    !matches!(warning, SourceWarning::DistortionIgnored { .. } | SourceWarning::FewViews { .. })
}

impl InitOutcome {
    fn report(&self, init: &InitArgs, console: &Console) {
        for (scene, notices) in &self.notices {
            console.note(&format!("{scene}: {notices}"));
        }
        let to = init.to.display();
        let (written, kept) = (self.written.len(), self.kept);
        console.note(&format!("{written} recipes were written to {to}, {kept} already existed"));
        if self.left > 0 {
            console.note(&format!("{} more scenes are usable; --limit leaves them out", self.left));
        }
        if let Some(first) = self.rejected.first() {
            let (count, list) = (self.rejected.len(), write::rejected_in(&init.to));
            let (list, (scene, _, _, because)) = (list.display(), first);
            console.note(&format!(
                "{count} scenes were rejected, listed in {list}; the first, {scene}: {because}"
            ));
        }
        if let Some(first) = self.without_scene.first() {
            let count = self.without_scene.len();
            let what = format!("{count} of the new recipes name a scene file that does not exist");
            let message = UserMessage::warning("scene-missing", what).path(first);
            let help = "train the scenes first; or delete these recipes, and run gs2e init again with --train or --scene";
            console.for_people().report(&message.help(help));
        }
        console.result(&self.to_json());
    }

    fn to_json(&self) -> Value {
        let rejected = self.rejected.iter().map(|(scene, folder, code, because)| {
            json!({ "scene": scene, "path": path(folder), "code": code, "because": because })
        });
        let written = self.written.iter();
        let written = written.map(|(scene, recipe)| json!({ "scene": scene, "recipe": path(recipe) }));
        let noticed = self.notices.iter();
        let noticed = noticed.map(|(scene, because)| json!({ "scene": scene, "because": because }));
        json!({
            "written": Value::from_iter(written), "kept": self.kept, "left": self.left,
            "rejected": Value::from_iter(rejected), "noticed": Value::from_iter(noticed),
            "without_scene": Value::from_iter(self.without_scene.iter().map(path)),
        })
    }
}
