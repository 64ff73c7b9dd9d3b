//! The two graphs: ninja's graph comes from the scripts of `../shared`, ours from a recipe defined
//! here.

use crate::Outcome;
use crate::series::{RunCost, timed};
use serde::Deserialize;
use std::cell::Cell;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A silent command in a folder.
fn command(program: impl AsRef<std::ffi::OsStr>, dir: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(program);
    command.args(args).current_dir(dir).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Index of the scene that the `turn`th change falls on: far from the one before, as in
/// `change.sh`.
fn chosen(turn: usize, scenes: usize) -> usize {
    (turn * 37 + 11) % scenes
}

/// ninja's graph: N scenes of 4 steps, and one step after all of them.
pub(crate) struct Ninja {
    dir: PathBuf,
    scripts: PathBuf,
    turn: Cell<usize>,
}

impl Ninja {
    /// Writes the graph. Prints a message and returns `None` if a tool or a script is absent.
    pub(crate) fn prepare(root: &Path, scenes: usize) -> Outcome<Option<Self>> {
        let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/tools/build_bench");
        if !scripts.exists() {
            println!("not run: ../shared is absent, so there is no ninja to compare with");
            return Ok(None);
        }
        for tool in ["ninja", "python3", "cc"] {
            if command(tool, root, &["--version"]).status().is_err() {
                println!("not run: {tool} is absent, so there is no ninja to compare with");
                return Ok(None);
            }
        }
        let dir = root.join("ninja");
        let mut generate = command("python3", root, &[]);
        generate.arg(scripts.join("gen.py")).arg("ninja").arg(&dir).args(["--scenes", &scenes.to_string()]);
        timed(generate)?;
        Ok(Some(Self { dir, scripts, turn: Cell::new(0) }))
    }

    /// The first build.
    pub(crate) fn cold(&self, jobs: &str) -> Command {
        command("ninja", &self.dir, &[jobs])
    }

    pub(crate) fn build(&self) -> Command {
        command("ninja", &self.dir, &[])
    }

    /// Gives a recipe a new seed.
    pub(crate) fn change(&self) -> Outcome {
        let turn = self.turn.replace(self.turn.get() + 1);
        let mut change = command("sh", &self.dir, &[]);
        change.arg(self.scripts.join("change.sh")).arg(".").arg(turn.to_string());
        timed(change).map(drop)
    }
}

/// The outputs of a scene in our graph.
#[derive(Clone, Copy)]
pub(crate) enum Template {
    /// `capture`, `reconstruct`, `trajectory`, `checks`.
    FourSteps,
    /// The steps of [`Self::FourSteps`] and `events`.
    WithEvents,
}

impl Template {
    /// A minimal recipe. The scene's own seed is part of its source, so that no two scenes share a
    /// step.
    fn recipe(self, scene: &str, seed: usize) -> String {
        let outputs = match self {
            Self::FourSteps => "[]",
            Self::WithEvents => "[events]",
        };
        format!(
            "version: 1\nscene: {scene}\nseed: {seed}\n\
             source: {{ procedural: {{ gaussians: 100, views: 4, arc: 1, seed: {seed} }} }}\n\
             camera: {{ width: 16, height: 16 }}\n\
             trajectories: [{{ name: base, refine: {{ window: 1, factor: 1 }} }}]\n\
             outputs: {outputs}\n"
        )
    }
}

/// Our graph: N recipes in `recipes/`, and their store.
pub(crate) struct Ours {
    dir: PathBuf,
    pub(crate) scenes: usize,
    template: Template,
    turn: Cell<usize>,
}

/// The fields that are read from a line of `build --json`.
#[derive(Deserialize)]
struct BuildLine {
    #[serde(default)]
    state: String,
    seconds: Option<f64>,
}

/// The fields that are read from a step of `plan --json`.
#[derive(Deserialize)]
struct PlanLine {
    key: Option<String>,
}

impl Ours {
    /// Writes the recipes.
    pub(crate) fn prepare(dir: &Path, scenes: usize, template: Template) -> Outcome<Self> {
        fs::create_dir_all(dir.join("recipes")).map_err(|e| format!("{}: {e}", dir.display()))?;
        let ours = Self { dir: dir.to_owned(), scenes, template, turn: Cell::new(0) };
        (0..scenes).try_for_each(|index| ours.write(index, index))?;
        Ok(ours)
    }

    fn write(&self, index: usize, seed: usize) -> Outcome {
        let scene = format!("s{index:04}");
        let path = self.dir.join(format!("recipes/{scene}.yaml"));
        fs::write(&path, self.template.recipe(&scene, seed)).map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Gives a recipe an unused seed.
    pub(crate) fn change(&self) -> Outcome {
        let turn = self.turn.replace(self.turn.get() + 1);
        self.write(chosen(turn, self.scenes), self.scenes + turn)
    }

    pub(crate) fn gs2e(&self, args: &[&str]) -> Command {
        command(env!("CARGO_BIN_EXE_gs2e"), &self.dir, args)
    }

    /// Builds. Returns the run and the seconds of each step that it made.
    pub(crate) fn build_telling(&self, jobs: &str) -> Outcome<(RunCost, Vec<f64>)> {
        let ran = self.telling(&["build", "-q", "--json", jobs])?;
        let lines = self.listing()?;
        let steps = lines
            .lines()
            .map(|line| serde_json::from_str::<BuildLine>(line).map_err(|e| format!("{line}: {e}")));
        let steps: Vec<BuildLine> = steps.collect::<Outcome<_>>()?;
        let made = steps.into_iter().filter(|step| step.state == "made").filter_map(|step| step.seconds);
        Ok((ran, made.collect()))
    }

    /// Prints the number of steps and the number of distinct keys.
    pub(crate) fn tell_keys(&self) -> Outcome {
        self.telling(&["plan", "--json"])?;
        let steps: Vec<PlanLine> = serde_json::from_str(&self.listing()?)
            .map_err(|e| format!("the plan is not as it should be: {e}"))?;
        let keys: BTreeSet<&str> = steps.iter().filter_map(|step| step.key.as_deref()).collect();
        println!(
            "graphs   ninja {} steps; gs2e {} steps with {} distinct keys",
            4 * self.scenes + 1,
            steps.len(),
            keys.len()
        );
        Ok(())
    }

    /// Runs `gs2e` with its stdout in a file.
    fn telling(&self, args: &[&str]) -> Outcome<RunCost> {
        let file =
            File::create(self.dir.join("listing")).map_err(|e| format!("{}: {e}", self.dir.display()))?;
        let mut command = self.gs2e(args);
        command.stdout(file);
        timed(command)
    }

    fn listing(&self) -> Outcome<String> {
        fs::read_to_string(self.dir.join("listing")).map_err(|e| format!("{}: {e}", self.dir.display()))
    }
}
