//! Equal recipes give equal bytes, whatever else the machine does.

use crate::support::workspace::{TINY, Workspace, same_tree};

#[test]
fn one_and_two_threads_write_the_same_tree() {
    let [one, two] = [Workspace::with_tiny(), Workspace::with_tiny()];
    one.ok("release -j 1 --to out tiny.yaml");
    two.ok("release -j 2 --to out tiny.yaml");
    same_tree(&one.path("out"), &two.path("out"));
}

/// Two scenes, written and named in either order, in folders of different names, with the stores
/// elsewhere.
#[test]
fn folders_and_the_order_of_files_do_not_matter() {
    let other = TINY.replace("scene: tiny", "scene: b/other").replace("seed: 7", "seed: 8");
    let here = Workspace::new();
    here.write("recipes/tiny.yaml", TINY);
    here.write("recipes/other.yaml", &other);
    here.ok("release --to out recipes");
    let there = Workspace::new();
    there.write("elsewhere/deep/z.yaml", &other);
    there.write("elsewhere/deep/a.yaml", TINY);
    there.ok("release --store kept --to elsewhere/out elsewhere/deep/z.yaml elsewhere/deep/a.yaml");
    same_tree(&here.path("out"), &there.path("elsewhere/out"));
}
