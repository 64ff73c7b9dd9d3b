//! A temporary folder in which the program runs, and the contents of its store.

use crate::program::{self, RunOutcome};
use gs2e_store::Digest;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Digests of products by scene, step and role.
pub(crate) type Products = BTreeMap<String, Digest>;

/// Steps by `scene/step`.
pub(crate) type Plan = BTreeMap<String, Step>;

/// A temporary folder, removed on drop.
#[derive(Debug)]
pub(crate) struct Place {
    folder: tempfile::TempDir,
}

/// One step of `plan --json`.
#[derive(Debug)]
pub(crate) struct Step {
    pub(crate) keep: bool,
    /// Role, digest that the store states, and file.
    pub(crate) outputs: Vec<(String, String, PathBuf)>,
}

impl Place {
    /// A place on the disk with the temporary files.
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    /// A place in memory if the system has one. It is for tests of thousands of builds, in which
    /// syncing would take most of the time and prove nothing.
    pub(crate) fn in_memory() -> Self {
        tempfile::tempdir_in("/dev/shm").map_or_else(|_| Self::new(), |folder| Self { folder })
    }

    pub(crate) fn root(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.root().join(name)
    }

    pub(crate) fn store(&self) -> PathBuf {
        self.path(".gs2e")
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// Runs the program here to its end, with `args` separated by spaces.
    pub(crate) fn run(&self, args: &str) -> Result<RunOutcome, String> {
        program::run(self.root(), args)
    }

    /// Runs the program, which must end with 0.
    pub(crate) fn ok(&self, args: &str) -> Result<RunOutcome, String> {
        let ended = self.run(args)?;
        if ended.code == Some(0) { Ok(ended) } else { Err(format!("`gs2e {args}`: {ended}")) }
    }

    /// The plan that the program reports, by `scene/step`.
    pub(crate) fn plan(&self) -> Result<Plan, String> {
        self.read_plan(&self.ok("plan --json")?)
    }

    /// Parses the output of `plan --json`.
    pub(crate) fn read_plan(&self, ended: &RunOutcome) -> Result<Plan, String> {
        let list: Vec<Value> =
            serde_json::from_str(&ended.stdout).map_err(|e| format!("plan --json: {e}"))?;
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let step = |step: &Value| {
            let outputs = step["outputs"].as_array().into_iter().flatten();
            let output = |o: &Value| (text(&o["role"]), text(&o["digest"]), self.path(&text(&o["path"])));
            let name = format!("{}/{}", text(&step["scene"]), text(&step["step"]));
            (name, Step { keep: step["action"] == "keep", outputs: outputs.map(output).collect() })
        };
        Ok(list.iter().map(step).collect())
    }

    /// Builds, which must succeed, and returns the products. Everything must be up to date
    /// afterwards.
    pub(crate) fn build(&self, args: &str) -> Result<Products, String> {
        self.ok(&format!("build -q {args}"))?;
        self.finished()
    }

    /// The products of a plan in which everything must be up to date.
    pub(crate) fn finished(&self) -> Result<Products, String> {
        let plan = self.plan()?;
        match plan.iter().find(|(_, step)| !step.keep) {
            Some((name, _)) => Err(format!("{name} is not up to date after a build")),
            None => sound(&plan),
        }
    }
}

/// Reads the products of all steps that count as up to date. Each must have the bytes that the
/// store states.
pub(crate) fn sound(plan: &Plan) -> Result<Products, String> {
    let mut products = Products::new();
    for (name, step) in plan.iter().filter(|(_, step)| step.keep) {
        for (role, digest, path) in &step.outputs {
            let bytes = fs::read(path).map_err(|e| format!("{name}, {role} counts as up to date: {e}"))?;
            let found = Digest::of_bytes(&bytes);
            if found.to_string() != *digest {
                return Err(format!(
                    "{name}, {role} counts as up to date with other bytes: {digest} is {found}"
                ));
            }
            products.insert(format!("{name}/{role}"), found);
        }
    }
    Ok(products)
}

/// Checks that every product of `some` is in `whole` with the same digest.
pub(crate) fn within(some: &Products, whole: &Products) -> Result<(), String> {
    match some.iter().find(|(name, digest)| whole.get(*name) != Some(digest)) {
        None => Ok(()),
        Some((name, digest)) => {
            Err(format!("{name} is {digest}, and {:?} in a clean build", whole.get(name)))
        }
    }
}

/// Checks that the products are exactly those of a clean build.
pub(crate) fn same(some: &Products, whole: &Products) -> Result<(), String> {
    within(some, whole)?;
    within(whole, some).map_err(|why| format!("missing: {why}"))
}

/// Digests of all files below a folder, by relative path.
pub(crate) fn tree(folder: &Path) -> BTreeMap<PathBuf, Digest> {
    let entries = walkdir::WalkDir::new(folder).into_iter().map(Result::unwrap);
    let files = entries.filter(|entry| entry.file_type().is_file());
    let relative = |path: &Path| path.strip_prefix(folder).unwrap().to_owned();
    files.map(|file| (relative(file.path()), Digest::of_bytes(&fs::read(file.path()).unwrap()))).collect()
}
