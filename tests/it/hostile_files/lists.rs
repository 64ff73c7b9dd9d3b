//! Lists of scenes that are taken down: a line that cannot name a scene is refused; one that names
//! no known scene is reported.

use super::run;
use crate::support::workspace::{TINY, Workspace};
use std::fs;

fn place() -> Workspace {
    let place = Workspace::new();
    place.write("recipes/a.yaml", TINY.replace("scene: tiny", "scene: t/tiny"));
    place
}

#[test]
fn a_line_that_can_name_no_scene_is_refused_with_its_place() {
    for id in ["t/tiny/", "/t/tiny", "\"t/tiny\"", "'t/tiny'", "t\\tiny", "t/*", "t/tin?"] {
        let place = place();
        place.write("recipes/takedown.txt", format!("# by mail\n{id} 2025-06-01\n"));
        for args in ["plan recipes", "plan recipes/a.yaml", "release --to out recipes"] {
            let ended = run(&place.path(""), args);
            assert_eq!(ended.code, 2, "{id}, {args}: {}", ended.stderr);
            assert!(ended.stderr.contains("recipes/takedown.txt:2:1"), "{id}: {}", ended.stderr);
        }
        assert!(!place.path("out").exists(), "{id}");
    }
}

#[test]
fn a_list_of_another_name_is_refused() {
    for name in ["Takedown.txt", "takedown.TXT", "TAKEDOWN.txt"] {
        let place = place();
        place.write(&format!("recipes/{name}"), "t/tiny 2025-06-01\n");
        for args in ["plan recipes", "plan recipes/a.yaml", "release --to out recipes"] {
            let ended = run(&place.path(""), args);
            assert_eq!(ended.code, 2, "{name}, {args}: {}", ended.stderr);
            assert!(ended.stderr.contains(name) && ended.stderr.contains("takedown.txt"), "{}", ended.stderr);
        }
    }
}

#[test]
fn ids_that_name_no_scene_are_reported_by_their_number() {
    let place = place();
    place.write("recipes/b.yaml", TINY.replace("scene: tiny", "scene: kept"));
    place.write("recipes/takedown.txt", "T/Tiny 2025-06-01\nother 2025-06-01\nt 2025-06-01\n");
    for args in ["plan recipes", "build recipes", "build recipes", "gc recipes"] {
        let message = place.ok(args).stderr;
        assert!(message.contains("2 ids in takedown.txt match none of these scenes"), "{args}: {message}");
    }
    place.write("recipes/takedown.txt", "t/tiny 2025-06-01\n");
    assert!(!place.ok("plan recipes").stderr.contains("none of these scenes"));
}

#[test]
fn a_list_without_permission_is_an_error() {
    use std::os::unix::fs::PermissionsExt as _;
    let place = place();
    place.write("locked/list.txt", "t/tiny 2025-06-01\n");
    std::os::unix::fs::symlink("../locked/list.txt", place.path("recipes/takedown.txt")).unwrap();
    fs::set_permissions(place.path("locked"), fs::Permissions::from_mode(0o000)).unwrap();
    // root may read a locked file.
    let is_locked = fs::read(place.path("locked/list.txt")).is_err();
    let ended = run(&place.path(""), "plan recipes/a.yaml");
    fs::set_permissions(place.path("locked"), fs::Permissions::from_mode(0o700)).unwrap();
    assert_eq!(ended.code, if is_locked { 2 } else { 0 }, "{}", ended.stderr);
}
