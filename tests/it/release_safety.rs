//! Releases and other files on the disk: the program deletes only files that it wrote, under any
//! name and after any interruption.

mod folders;
mod races;
mod refusals;
mod sharing;

use crate::support::workspace::{Workspace, tree};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

/// A scene without pictures and events, so that its release takes no time.
const POSES: &str = "\
version: 1
scene: tiny
seed: 7
source: { procedural: { kind: still-life, gaussians: 300, views: 6, arc: 6, seed: 1 } }
camera: { width: 48, height: 32 }
trajectories: [{ name: base, refine: { factor: 2 } }]
outputs: []
";

/// A folder with [`POSES`] as `r.yaml` and the store in which it is built.
fn place() -> Workspace {
    static BUILT: OnceLock<Workspace> = OnceLock::new();
    let built = BUILT.get_or_init(|| {
        let place = Workspace::new();
        place.write("r.yaml", POSES);
        place.ok("release -q --to first r.yaml");
        place
    });
    let place = Workspace::new();
    place.write("r.yaml", POSES);
    for (name, bytes) in tree(&built.path(".gs2e")) {
        // The store's knowledge about files by path does not apply to their copies.
        if !name.starts_with("state.db") && name != "lock" && !name.starts_with("roots") {
            place.write(&format!(".gs2e/{name}"), bytes);
        }
    }
    place
}

/// The folder of [`place`], with a release at `out`.
fn released() -> Workspace {
    let place = place();
    place.ok("release -q --to out r.yaml");
    place
}

/// The names in the place, except the store and its recipe.
fn neighbours(place: &Workspace) -> Vec<String> {
    let entries = fs::read_dir(place.path(".")).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| name != ".gs2e" && name != "r.yaml");
    names.sort();
    names
}

/// The only name with this prefix.
fn named(place: &Workspace, prefix: &str) -> String {
    let mut names = neighbours(place);
    names.retain(|name| name.starts_with(prefix));
    let [name] = <[String; 1]>::try_from(names).unwrap();
    name
}

fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All files in `out`.
fn out(place: &Workspace) -> BTreeMap<String, Vec<u8>> {
    tree(&place.path("out"))
}
