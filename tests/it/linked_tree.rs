//! `gs2e build --to`: a plain folder of links to what was built.

use crate::support::workspace::{TINY, Workspace};
use std::fs;

fn names(place: &Workspace, folder: &str) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(place.path(folder))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn outputs_have_links_under_their_names() {
    let place = Workspace::with_tiny();
    let said = place.ok("build tiny.yaml --to plain").stderr;
    assert!(said.contains("plain has links to "), "{said}");
    assert_eq!(names(&place, "plain/tiny/base"), ["checks", "events", "sharp", "trajectory"]);
    let events = fs::read(place.path("plain/tiny/base/events/events.h5")).unwrap();
    assert!(events.starts_with(b"\x89HDF"));
    let sharp = names(&place, "plain/tiny/base/sharp");
    // The same recipe is settled without a plan, and has the same links.
    place.ok("build tiny.yaml --to plain");
    place.ok("build tiny.yaml --to other");
    for folder in ["plain", "other"] {
        assert_eq!(names(&place, &format!("{folder}/tiny/base/sharp")), sharp);
    }
    // A file that is no link stays, and links to outputs that are gone do not.
    place.write("plain/tiny/base/sharp/notes.txt", "mine");
    place.write("tiny.yaml", TINY.replace("factor: 2", "frames: 3"));
    place.ok("build tiny.yaml --to plain");
    assert_eq!(
        names(&place, "plain/tiny/base/sharp"),
        ["000000.png", "000001.png", "000002.png", "notes.txt", "work.json"]
    );
    assert_ne!(fs::read(place.path("plain/tiny/base/events/events.h5")).unwrap(), events);
}

#[test]
fn files_that_are_no_links_are_never_replaced() {
    let place = Workspace::with_tiny();
    place.write("plain/tiny/base/events/events.h5", "mine");
    let ended = place.gs2e("build tiny.yaml --to plain");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("plain/tiny/base/events/events.h5: the name is taken"), "{}", ended.stderr);
    assert_eq!(fs::read_to_string(place.path("plain/tiny/base/events/events.h5")).unwrap(), "mine");
    // The build itself is done.
    assert!(place.stale("tiny.yaml").is_empty());
}
