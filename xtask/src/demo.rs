//! The demo release: the README's first command, and its committed manifest.

use crate::command::{Outcome, Task, cargo, root, say};
use crate::folder::Folder;
use std::path::{Path, PathBuf};

/// The README's first command, verbatim.
const README_COMMAND: &str = "cargo run --release -- release --to out recipes/demo.yaml";

/// The part of [`README_COMMAND`] that starts the program.
const README_PROGRAM: &str = "cargo run --release -- ";

/// Runs the README's first command twice, into a temporary folder. The second run must find nothing
/// to do.
pub(crate) fn first_command_twice() -> Outcome {
    let readme = std::fs::read_to_string(root().join("README.md")).map_err(|e| format!("README.md: {e}"))?;
    if !readme.lines().any(|line| line == README_COMMAND) {
        return Err(format!("README.md has no line `{README_COMMAND}`"));
    }
    let folder = Folder::new("first-command")?;
    release(&folder).run()?;
    let second = release(&folder).capture()?;
    let message = String::from_utf8_lossy(&second.stderr);
    if !message.lines().any(|line| line.starts_with("0 steps built,")) {
        return Err(format!("the second run should have said `0 steps built, …`; it said:\n{message}"));
    }
    say("the second run made nothing");
    Ok(())
}

/// Makes the demo release and copies its `manifest.json` to `manifests/demo.json`.
pub(crate) fn rewrite_manifest() -> Outcome {
    let folder = Folder::new("manifest")?;
    // The CPU back end gives the same bits on every machine.
    release(&folder).args(["--backend", "cpu"]).run()?;
    let (from, to) = (folder.path().join("out/manifest.json"), root().join("manifests/demo.json"));
    let fresh = std::fs::read(&from).map_err(|e| format!("{}: {e}", from.display()))?;
    let unchanged = std::fs::read(&to).is_ok_and(|committed| committed == fresh);
    std::fs::write(&to, fresh).map_err(|e| format!("{}: {e}", to.display()))?;
    say(if unchanged { "manifests/demo.json: unchanged" } else { "manifests/demo.json: rewritten" });
    Ok(())
}

/// The README's first command with its `out` and its store in `folder`, as in a fresh clone without
/// earlier builds.
fn release(folder: &Folder) -> Task {
    let (out, store) = (folder.path().join("out"), folder.path().join("store"));
    let args = README_COMMAND.trim_start_matches(README_PROGRAM).split(' ').map(PathBuf::from);
    let args: Vec<PathBuf> =
        args.map(|arg| if arg == Path::new("out") { out.clone() } else { arg }).collect();
    let started = cargo(&README_PROGRAM.split_whitespace().skip(1).collect::<Vec<_>>());
    started.args(&args).args([Path::new("--store"), &store])
}
