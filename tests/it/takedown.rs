//! Scenes whose removal was requested: they are not made, not released, and found in existing
//! trees.

use crate::sources::datasets::Generator;
use crate::support::given;
use crate::support::workspace::{TINY, Workspace, tree};
use serde_json::Value;
use std::fs;

const LIST: &str = "# asked for by mail\nshown/face 2025-06-01 a face on a photo\n";

/// Two scenes. One is taken down later.
fn place() -> Workspace {
    let place = Workspace::new();
    let recipe = |id: &str| TINY.replace("scene: tiny", &format!("scene: {id}"));
    place.write("recipes/a.yaml", recipe("kept"));
    place.write("recipes/lab/b.yaml", recipe("shown/face"));
    place
}

fn scenes(place: &Workspace) -> Vec<String> {
    let mut scenes: Vec<String> = place
        .plan("recipes")
        .into_iter()
        .filter_map(|(step, _)| step.strip_suffix("/capture").map(str::to_owned))
        .collect();
    scenes.sort();
    scenes
}

/// The faults of an audit, as JSON.
fn faults(place: &Workspace, args: &str) -> (i32, Vec<Value>) {
    let ended = place.gs2e(&format!("audit --json {args}"));
    let lines = ended.stdout.lines().map(|line| serde_json::from_str::<Value>(line).expect("lines are JSON"));
    (ended.code, lines.filter(|line| line["code"].is_string()).collect())
}

#[test]
fn listed_scenes_are_neither_planned_nor_built() {
    let place = place();
    assert_eq!(scenes(&place), ["kept", "shown/face"]);
    // The list is next to the recipe; it is in capitals and names more than the recipe's scenes.
    place.write("recipes/lab/takedown.txt", "SHOWN/face 2025-06-01\nelsewhere 2025-06-01\n");
    assert_eq!(scenes(&place), ["kept"]);
    let message = place.ok("build recipes").stderr;
    assert_eq!(message.matches("1 scene is left out because of takedown.txt").count(), 1, "{message}");
    assert!(!message.contains("face"), "{message}");
    // Now from memory: nothing is read of a scene that is up to date.
    fs::remove_file(place.path("recipes/lab/takedown.txt")).expect("it is there");
    place.ok("build recipes");
    assert_eq!(scenes(&place), ["kept", "shown/face"]);
    place.write("recipes/takedown.txt", LIST);
    assert_eq!(scenes(&place), ["kept"]);
    assert!(place.build("recipes").is_empty());
    // A single recipe uses the list in its own folder.
    place.write("recipes/lab/takedown.txt", LIST);
    assert!(place.plan("recipes/lab/b.yaml").is_empty());
}

#[test]
fn a_release_drops_and_counts_listed_scenes() {
    let place = place();
    place.ok("release --to out --copy recipes");
    place.write("list.txt", LIST);
    let (code, found) = faults(&place, "out --takedown list.txt");
    assert_eq!(code, 3, "{found:?}");
    let named: Vec<_> = found.iter().map(|f| (f["code"].as_str(), f["scene"].as_str())).collect();
    assert_eq!(named, [(Some("takedown"), Some("shown/face"))]);
    assert_eq!(faults(&place, "out").0, 0);
    place.write("recipes/takedown.txt", LIST);
    place.ok("release --to out recipes");
    assert!(!place.path("out/shown").exists());
    assert_eq!(faults(&place, "out --takedown list.txt"), (0, Vec::new()));
    let manifest: Value =
        serde_json::from_slice(&fs::read(place.path("out/manifest.json")).expect("it is there"))
            .expect("JSON");
    assert_eq!(manifest["taken_down"], 1);
    let files = tree(&place.path("out"));
    let card = String::from_utf8_lossy(&files["README.md"]);
    assert!(card.contains("1 scene(s) were removed on request."), "{card}");
    for (path, bytes) in &files {
        assert!(!bytes.windows(5).any(|part| part == b"shown"), "{path} names what was taken down");
    }
}

#[test]
fn a_scene_is_known_by_its_upstream_name() {
    let place = Workspace::new();
    let scene = given::ply(|_, value| value);
    Generator::new().mvimgnet(&place.path("data"), 0, 1, &scene);
    place.write(
        "recipes/defaults.yaml",
        "trajectories: [{ name: base, refine: { factor: 2 } }]\noutputs: []\n",
    );
    place.ok("init mvimgnet data --to recipes --prefix lab");
    place.ok("release --to out recipes");
    for (list, code) in [
        ("0/00000000 2025-06-01\n", 3),
        ("mvimgnet/0/00000000 2025-06-01\n", 3),
        ("lab/0/00000000 2025-06-01\n", 3),
        ("lab/0 2025-06-01\ndl3dv/0/00000000 2025-06-01\n# lab/0/00000000 2025-06-01\n", 0),
    ] {
        place.write("list.txt", list);
        assert_eq!(faults(&place, "out --takedown list.txt").0, code, "{list}");
        place.write("recipes/takedown.txt", list);
        assert_eq!(place.plan("recipes").is_empty(), code == 3, "{list}");
    }
}

#[test]
fn nothing_is_released_if_everything_is_listed() {
    let place = place();
    place.ok("release --to out recipes/lab/b.yaml");
    place.write("recipes/lab/takedown.txt", LIST);
    let ended = place.gs2e("release --to out recipes/lab/b.yaml");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("there is no scene to release"), "{}", ended.stderr);
}

#[test]
fn a_list_that_cannot_be_understood_stops_everything() {
    let place = place();
    place.write("recipes/takedown.txt", "shown/face 2025-06-01\nkept\n");
    for verb in ["plan recipes", "build recipes", "release --to out recipes", "gc recipes"] {
        let ended = place.gs2e(verb);
        assert_eq!(ended.code, 2, "{verb}: {}", ended.stderr);
        assert!(ended.stderr.contains("recipes/takedown.txt:2:1"), "{verb}: {}", ended.stderr);
    }
    fs::remove_file(place.path("recipes/takedown.txt")).expect("it is there");
    place.ok("release --to out recipes");
    place.write("list.txt", "kept tomorrow\n");
    for list in ["list.txt", "absent.txt"] {
        assert_eq!(place.gs2e(&format!("audit out --takedown {list}")).code, 2);
    }
}
