//! Code shared by the tests through the binary: a folder, a tiny recipe, and whole trees as values.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::SystemTime;

/// A small scene: 500 Gaussians, 6 views on an arc of 6 degrees, 12 poses, 64x48 pixels.
pub(crate) const TINY: &str = "\
version: 1
scene: tiny
seed: 7
source: { procedural: { kind: still-life, gaussians: 500, views: 6, arc: 6, seed: 1 } }
camera: { width: 64, height: 48 }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"0.25*sin(t) + 1.1\" }
sampling: { rate: 2400, between: linear }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }
outputs: [events, sharp]
";

/// [`TINY`] with these lines instead of its sensor.
pub(crate) fn tiny_with(sensors: &str) -> String {
    let own = "sensor:\n  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }\n";
    let (head, tail) = TINY.split_once(own).expect("it has a sensor");
    format!("{head}{sensors}{tail}")
}

/// A temporary folder in which the program is run.
pub(crate) struct Workspace {
    folder: tempfile::TempDir,
}

/// Outcome of a run of the program.
pub(crate) struct RunOutcome {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Workspace {
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder can be made") }
    }

    /// A workspace that holds [`TINY`] as `tiny.yaml`.
    pub(crate) fn with_tiny() -> Self {
        let place = Self::new();
        place.write("tiny.yaml", TINY);
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("it lies in the folder")).expect("folders can be made");
        fs::write(path, content).expect("files can be written");
    }

    /// A workspace with the release `tree` of a recipe, which lies in `tiny.yaml`. `options` are separated by
    /// spaces.
    pub(crate) fn released(recipe: &str, options: &str) -> Self {
        let place = Self::new();
        place.write("tiny.yaml", recipe);
        place.ok(&format!("release {options} --to tree tiny.yaml"));
        place
    }

    /// A JSON file of the folder.
    pub(crate) fn json(&self, name: &str) -> Value {
        let bytes = fs::read(self.path(name)).unwrap_or_else(|because| panic!("{name}: {because}"));
        serde_json::from_slice(&bytes).unwrap_or_else(|because| panic!("{name}: {because}"))
    }

    /// Runs `gs2e` in the folder, with `args` separated by spaces.
    pub(crate) fn gs2e(&self, args: &str) -> RunOutcome {
        let output = self.command(args).output().expect("the program starts");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("it speaks UTF-8");
        RunOutcome {
            code: output.status.code().expect("no signal ended it"),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }

    /// Starts the program with its stderr piped. The test must end it.
    pub(crate) fn spawn(&self, args: &str) -> Child {
        self.command(args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts")
    }

    /// The program with these arguments, to be started by the test. It finds no GPU, so that it
    /// does the same on every machine.
    pub(crate) fn command(&self, args: &str) -> Command {
        hidden_gpus(self.command_with_gpu(args))
    }

    /// Like [`Self::command`], with the machine's GPUs.
    pub(crate) fn command_with_gpu(&self, args: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
        command.args(args.split_whitespace()).current_dir(self.folder.path()).stdin(Stdio::null());
        command
    }

    /// Runs `gs2e`, which must succeed.
    pub(crate) fn ok(&self, args: &str) -> RunOutcome {
        let ended = self.gs2e(args);
        assert_eq!(ended.code, 0, "gs2e {args}\n{}{}", ended.stdout, ended.stderr);
        ended
    }

    /// Runs `gs2e`, which must refuse the command. Returns what it says.
    pub(crate) fn refused(&self, args: &str) -> String {
        let ended = self.gs2e(args);
        assert_eq!(ended.code, 2, "gs2e {args}\n{}", ended.stderr);
        ended.stderr
    }

    /// The actions of a run now: (scene/step, `run`, `may-run` or `keep`), in the plan's order.
    pub(crate) fn plan(&self, recipes: &str) -> Vec<(String, String)> {
        let ended = self.ok(&format!("plan --json {recipes}"));
        let steps: Vec<Value> = serde_json::from_str(&ended.stdout).expect("the plan is one JSON array");
        let text = |step: &Value, name: &str| step[name].as_str().expect("steps have it").to_owned();
        steps
            .iter()
            .map(|step| (format!("{}/{}", text(step, "scene"), text(step, "step")), text(step, "action")))
            .collect()
    }

    /// The steps that a run now would not keep.
    pub(crate) fn stale(&self, recipes: &str) -> Vec<String> {
        let steps = self.plan(recipes);
        steps.into_iter().filter(|(_, action)| action != "keep").map(|(step, _)| step).collect()
    }

    /// Builds, and returns the names of the steps that it made.
    pub(crate) fn build(&self, recipes: &str) -> Vec<String> {
        let ended = self.ok(&format!("build --json {recipes}"));
        let mut made = Vec::new();
        for line in ended.stdout.lines() {
            let step: Value = serde_json::from_str(line).expect("each line is one JSON object");
            if step["state"] == "made" {
                made.push(step["step"].as_str().expect("it has a step").to_owned());
            }
        }
        made
    }
}

/// The command, with the machine's GPUs hidden.
pub(crate) fn hidden_gpus(mut command: Command) -> Command {
    command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
    command
}

/// Writes other bytes of the same length into a file and restores its mode. The mtime is the
/// current time, or the old one if `keep_mtime`.
pub(crate) fn alter(path: &Path, keep_mtime: bool) {
    let before = fs::metadata(path).unwrap();
    let mut bytes = fs::read(path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::set_permissions(path, fs::Permissions::from_mode(0o644)).unwrap();
    fs::write(path, bytes).unwrap();
    let mtime = if keep_mtime { before.modified().unwrap() } else { SystemTime::now() };
    fs::File::options().write(true).open(path).unwrap().set_modified(mtime).unwrap();
    fs::set_permissions(path, before.permissions()).unwrap();
}

/// Every file below `folder` by its `/`-separated path.
pub(crate) fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = walkdir::WalkDir::new(folder).into_iter().map(|entry| entry.expect("the tree can be walked"));
    files
        .filter(|entry| entry.file_type().is_file())
        .map(|entry| {
            let name = entry
                .path()
                .strip_prefix(folder)
                .expect("it lies below")
                .to_string_lossy()
                .replace('\\', "/");
            (name, fs::read(entry.path()).expect("files can be read"))
        })
        .collect()
}

/// Checks that two trees hold the same files with the same bytes.
pub(crate) fn same_tree(left: &Path, right: &Path) {
    let (left, right) = (tree(left), tree(right));
    let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert!(!left.is_empty(), "an empty tree proves nothing");
    assert_eq!(names(&left), names(&right));
    let differing: Vec<&String> = left.keys().filter(|name| left[*name] != right[*name]).collect();
    assert!(differing.is_empty(), "other bytes in {differing:?}");
}
