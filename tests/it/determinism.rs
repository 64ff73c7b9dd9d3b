//! The same recipe gives the same bytes, whatever the machine does meanwhile.

use crate::support::workspace::{TINY, Workspace, same_tree};

#[test]
fn one_and_two_threads_write_the_same_tree() {
    let [one, two] = [Workspace::with_tiny(), Workspace::with_tiny()];
    one.ok("release -j 1 --to out tiny.yaml");
    two.ok("release -j 2 --to out tiny.yaml");
    same_tree(&one.path("out"), &two.path("out"));
}

/// Two scenes, written and named in either order, in folders of different names, with the stores elsewhere.
#[test]
fn folders_and_the_order_of_files_do_not_show() {
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

/// Comments, the order of fields and the spelling of numbers are not what a recipe says.
#[test]
fn the_recipes_spelling_enters_no_key() {
    let place = Workspace::with_tiny();
    place.ok("build tiny.yaml");
    let respelled = TINY
        .replace("seed: 7\n", "")
        .replace("rate: 2400", "rate: 2.4e3")
        .replace("on: 1.0, off: 1.0", "off: 1, on: 1.00")
        .replace("0.25*sin(t) + 1.1", "0.25 * sin( t )+1.1")
        + "# seeds may stand anywhere\nseed: 7\n";
    place.write("tiny.yaml", respelled);
    assert_eq!(place.stale("tiny.yaml"), [""; 0]);
}
