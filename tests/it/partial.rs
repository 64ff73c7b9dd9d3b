//! Releases of some scenes, where a check of others fails.

use crate::support::workspace::{RunOutcome, TINY, Workspace};
use serde_json::Value;
use std::fs;

/// A limit that no stream of [`TINY`] meets: it has thousands of events per second and pixel.
const UNSOUND: &str = "checks: { event_rate: { max: 0.001 } }\n";

/// Three scenes; a check of `lab/b` fails.
fn place() -> Workspace {
    let place = Workspace::new();
    let recipe = |id: &str| TINY.replace("scene: tiny", &format!("scene: lab/{id}"));
    place.write("recipes/a.yaml", recipe("a"));
    place.write("recipes/b.yaml", recipe("b") + UNSOUND);
    place.write("recipes/c.yaml", recipe("c"));
    place
}

fn text(place: &Workspace, path: &str) -> String {
    fs::read_to_string(place.path(path)).unwrap()
}

fn scenes(place: &Workspace, tree: &str) -> Vec<String> {
    let manifest = place.json(&format!("{tree}/manifest.json"));
    let scenes = manifest["scenes"].as_array().unwrap().iter();
    scenes.map(|scene| scene["id"].as_str().unwrap().to_owned()).collect()
}

/// Ends with 3.
fn faulty(place: &Workspace, args: &str) -> RunOutcome {
    let ended = place.gs2e(args);
    assert_eq!(ended.code, 3, "{args}: {}", ended.stderr);
    ended
}

#[test]
fn a_refusal_names_the_check_and_the_scene_and_the_ways_out() {
    let place = place();
    let said = faulty(&place, "release --to out recipes").stderr;
    assert!(!place.path("out").exists());
    let error = said.lines().find(|line| line.starts_with("error: not released")).expect(&said);
    assert_eq!(error, "error: not released: 1 check failed (event_rate of lab/b/base)");
    let help = said.lines().last().unwrap();
    assert!(help.contains("release the other 2 scenes with --partial"), "{help}");
    // The proposal is YAML that a recipe takes, but for the reason, which a program cannot know.
    let (_, waiver) = help.split_once("accept it in the recipe: ").expect(help);
    let recipe = text(&place, "recipes/b.yaml").replace(UNSOUND, "");
    let limit = "checks: { event_rate: { max: 0.001 }, ";
    let pasted = |waiver: &str| recipe.clone() + &waiver.replace("checks: { ", limit) + "\n";
    place.write("recipes/b.yaml", pasted(waiver));
    let refused = place.gs2e("release --to out recipes");
    assert!(refused.code == 2 && refused.stderr.contains("placeholder"), "{}", refused.stderr);
    place.write("recipes/b.yaml", pasted(&waiver.replace("your reason", "the lamp flickers")));
    place.ok("release --to out recipes");
    assert_eq!(scenes(&place, "out"), ["lab/a", "lab/b", "lab/c"]);
}

#[test]
fn a_partial_release_has_the_sound_scenes_and_names_the_others() {
    let place = place();
    let said = faulty(&place, "release --partial --to out recipes").stderr;
    assert!(said.contains("error: lab/b is held back\n because event_rate failed: lab/b/base"), "{said}");
    assert_eq!(scenes(&place, "out"), ["lab/a", "lab/c"]);
    assert!(!place.path("out/lab/b").exists());
    let held_back = &place.json("out/manifest.json")["held_back"];
    assert_eq!(
        (&held_back[0]["id"], &held_back[0]["checks"][0]["check"]),
        (&"lab/b".into(), &"event_rate".into())
    );
    // In Markdown, an underscore is escaped.
    for (path, words) in
        [("out/README.md", "lab/b: event\\_rate failed"), ("out/report.html", "event_rate failed")]
    {
        let page = text(&place, path);
        assert!(page.contains("lab/b") && page.contains(words), "{path}");
    }
    place.ok("audit out");
    place.ok("check --tree out");
    place.ok("info out");

    // The same again: the same tree, and the same code.
    let again = faulty(&place, "release --partial --json --to out recipes");
    let result = again.stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let result = result.into_iter().find(|value| value["release"] == "out").unwrap();
    assert_eq!((&result["written"], &result["held_back"]), (&false.into(), &serde_json::json!(["lab/b"])));

    // A sound scene joins the release, and the difference names it.
    place.write("recipes/b.yaml", text(&place, "recipes/b.yaml").replace(UNSOUND, ""));
    place.ok("release --partial --to whole recipes");
    let difference: Value = serde_json::from_str(&place.ok("diff --json out whole").stdout).unwrap();
    assert_eq!(difference["added"][0]["id"], "lab/b", "{difference}");
    assert_eq!(difference["unchanged"], 2);
    assert!(place.json("whole/manifest.json").get("held_back").is_none());
    // A release of sound scenes has the same bytes with and without the option.
    place.ok("release --to plain recipes");
    crate::support::workspace::same_tree(&place.path("whole"), &place.path("plain"));
}

#[test]
fn splits_of_a_partial_release_are_those_of_the_whole() {
    let place = place();
    place.write(
        "recipes/release.yaml",
        "splits: { by: capture, shares: { train: 0.5, test: 0.5 }, salt: a }\n",
    );
    faulty(&place, "release --partial --to out recipes");
    place.ok("audit out");
    place.write("recipes/b.yaml", text(&place, "recipes/b.yaml").replace(UNSOUND, ""));
    place.ok("release --to whole recipes");
    for scene in ["a", "c"] {
        let split = |tree: &str| place.json(&format!("{tree}/lab/{scene}/scene.json"))["split"].clone();
        assert_eq!(split("out"), split("whole"));
    }
}

#[test]
fn a_scene_that_cannot_be_built_is_held_back_too() {
    let place = place();
    // A scene file that cannot be read.
    let step = TINY.replace("scene: tiny", "scene: lab/d").replace(
        "source: { procedural: { kind: still-life, gaussians: 500, views: 6, arc: 6, seed: 1 } }",
        "source: none\nreconstruct: { given: { path: broken.ply } }",
    );
    let step = step.replace("    refine: { window: 2, factor: 2, curve: cubic }\n", "    orbit: {}\n");
    let step = step.replace("{ width: 64, height: 48 }", "{ width: 64, height: 48, fx: 60 }");
    place.write("recipes/d.yaml", step);
    place.write("recipes/broken.ply", "no scene");
    let ended = place.gs2e("release -k --partial --to out recipes");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert_eq!(scenes(&place, "out"), ["lab/a", "lab/c"]);
    let card = text(&place, "out/README.md");
    assert!(card.contains("- lab/d: the step ") && card.contains("was not built"), "{card}");
    place.ok("audit out");
    // Without -k the build stops at the first failure, and says nothing about the other scenes.
    let ended = place.gs2e("release --partial --to other recipes");
    assert!(ended.code != 0 && !place.path("other").exists(), "{}", ended.stderr);
}

#[test]
fn nothing_is_released_if_no_scene_is_sound() {
    let place = Workspace::new();
    place.write("r.yaml", TINY.to_owned() + UNSOUND);
    let said = faulty(&place, "release --partial --to out r.yaml").stderr;
    assert!(said.contains("not released: 1 check failed") && !said.contains("--partial"), "{said}");
    assert!(!place.path("out").exists());
    assert_eq!(place.gs2e("release --partial --strict --to out r.yaml").code, 2);
}
