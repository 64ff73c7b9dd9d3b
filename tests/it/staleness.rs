//! Steps that are made again and steps that are left alone, through the program: a table of edits
//! and their steps.

use crate::support::workspace::{TINY, Workspace, tree};

#[test]
fn a_second_release_makes_nothing_and_changes_nothing() {
    let place = Workspace::with_tiny();
    place.ok("release --to out tiny.yaml");
    let before = tree(&place.path("out"));
    let second = place.ok("release --to out tiny.yaml");
    assert!(second.stderr.lines().any(|line| line.starts_with("0 steps built,")), "{}", second.stderr);
    assert_eq!(place.stale("tiny.yaml"), [""; 0]);
    assert!(before == tree(&place.path("out")), "a release of what is there already changed the tree");
}

/// Each edit makes the steps that read the changed value, the steps that follow from them, and no
/// other.
#[test]
fn an_edit_remakes_only_affected_steps() {
    let t = |from: &str, to: &str, remade: &[&str]| {
        let place = Workspace::with_tiny();
        place.ok("build tiny.yaml");
        assert!(TINY.contains(from), "{from}");
        place.write("tiny.yaml", TINY.replace(from, to));
        let made = sorted(place.build("tiny.yaml"));
        assert_eq!(made, sorted(remade.iter().map(|step| (*step).to_owned()).collect()), "{from} -> {to}");
        assert_eq!(place.stale("tiny.yaml"), [""; 0], "{from} -> {to}");
    };
    let from_trajectory = ["tiny/base/trajectory", "tiny/base/events", "tiny/base/sharp", "tiny/base/checks"];
    t("0.25*sin(t) + 1.1", "0.5*sin(t) + 1.1", &from_trajectory);
    t("on: 1.0", "on: 1.2", &["tiny/base/events", "tiny/base/checks"]);
    t("seed: 7", "seed: 8", &["tiny/base/events", "tiny/base/checks"]);
    t("width: 64", "width: 66", &["tiny/base/events", "tiny/base/sharp", "tiny/base/checks"]);
    t("version: 1\n", "version: 1 # the first\n", &[]);
}

fn sorted(mut steps: Vec<String>) -> Vec<String> {
    steps.sort();
    steps
}
