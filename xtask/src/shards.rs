//! Eight processes that build the same recipes with one shared store, and their releases.

use crate::command::{Outcome, program, say};
use crate::options::Options;
use std::ffi::OsStr;
use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

pub(crate) const PROCESSES: usize = 8;

/// Numbers of steps of all processes together.
#[derive(Default)]
pub(crate) struct Steps {
    pub(crate) made: usize,
    pub(crate) twice: usize,
    pub(crate) adopted: usize,
}

impl std::fmt::Display for Steps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { made, twice, adopted } = self;
        write!(f, "made {made}, of these at the same time as another {twice}, adopted {adopted}")
    }
}

/// A folder with recipes.
pub(crate) struct ShardPlace {
    folder: PathBuf,
    gs2e: PathBuf,
    /// Environment of the processes.
    pub(crate) env: Vec<(&'static str, String)>,
}

impl ShardPlace {
    /// Writes the recipes: `--scenes N` (80), `--program FILE` (built in release mode).
    pub(crate) fn new(folder: &Path, args: &[String]) -> Outcome<Self> {
        let options = Options(args);
        let scenes = options.number("--scenes", 80)?;
        let gs2e = options.program(&["--features", "s3"])?;
        let place = Self { folder: folder.to_owned(), gs2e, env: Vec::new() };
        place.write_recipes(scenes)?;
        Ok(place)
    }

    fn write_recipes(&self, scenes: usize) -> Outcome {
        fs::create_dir_all(self.folder.join("recipes")).map_err(|e| e.to_string())?;
        for i in 0..scenes {
            // The file of one scene is so large that a bucket takes it in parts.
            let gaussians = if i == 0 { 150_000 } else { 300 };
            let recipe = format!(
                "version: 1\nscene: s{i:04}\nseed: 7\n\
                 source: {{ procedural: {{ gaussians: {gaussians}, views: 6, arc: 0.5, seed: {i} }} }}\n\
                 camera: {{ width: 48, height: 32 }}\ntrajectories: [{{ name: base, refine: {{ factor: 2 }} }}]\n\
                 sensor: {{ voltmeter: {{ preset: dvs346-paper }} }}\n\
                 licence: {{ expression: CC0-1.0, holder: a test }}\n"
            );
            fs::write(self.folder.join(format!("recipes/s{i:04}.yaml")), recipe)
                .map_err(|e| e.to_string())?;
        }
        Ok(())
    }

    pub(crate) fn command(&self, args: &str) -> Command {
        let mut command = Command::new(&self.gs2e);
        command.args(args.split_whitespace()).current_dir(&self.folder).stdin(Stdio::null());
        command.envs(self.env.iter().map(|(name, value)| (name, value)));
        command
    }

    pub(crate) fn ok(&self, args: &str) -> Outcome<String> {
        let output = self.command(args).output().map_err(|e| format!("{}: {e}", self.gs2e.display()))?;
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.success() { Ok(text) } else { Err(format!("gs2e {args} failed:\n{text}")) }
    }

    /// Runs all processes at once, each with a new store. `of` gives the shared store and further options.
    pub(crate) fn all<S: Display>(&self, round: &str, of: impl Fn(usize) -> (S, String)) -> Outcome<Steps> {
        let start = |i: usize| -> Outcome<Child> {
            let (shared, options) = of(i);
            let args = format!(
                "build recipes --json --quiet -j 1 --store stores/{round}{i} --shared-store {shared} {options}"
            );
            let child = self.command(&args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
            child.map_err(|e| format!("{}: {e}", self.gs2e.display()))
        };
        let children: Vec<Child> = (0..PROCESSES).map(start).collect::<Outcome<_>>()?;
        // Their pipes are read at the same time, since a full one would stop its process.
        let waiting: Vec<_> =
            children.into_iter().map(|child| std::thread::spawn(|| child.wait_with_output())).collect();
        let mut steps = Steps::default();
        for thread in waiting {
            let output = thread.join().expect("waiting does not panic").map_err(|e| e.to_string())?;
            if !output.status.success() {
                return Err(format!("a process failed:\n{}", String::from_utf8_lossy(&output.stderr)));
            }
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            let count = |word: &str| text.lines().filter(|line| line.contains(word)).count();
            steps.made += count("\"state\":\"made\"");
            steps.twice += count("\"twice\":true");
            steps.adopted += count("\"state\":\"adopted\"");
        }
        Ok(steps)
    }

    /// Releases from the shared store, and compares with the release of one machine.
    pub(crate) fn release(&self, shared: &str, name: &str) -> Outcome {
        let args = format!("release recipes --store new-{name} --shared-store {shared} --to {name}");
        let ended = self.ok(&args)?;
        if !ended.lines().any(|line| line.starts_with("0 steps built,")) {
            return Err(format!("the release made steps that the shared store lacks:\n{ended}"));
        }
        let trees = ["one", name].map(|tree| self.folder.join(tree));
        let same = program(OsStr::new("diff"), &["-r".as_ref(), trees[0].as_os_str(), trees[1].as_os_str()]);
        if !same.succeeds() {
            return Err("the releases differ".to_owned());
        }
        say("the release from the shared store equals that of one machine");
        Ok(())
    }
}
