//! A release that cannot be made is refused before any step runs.

use super::{POSES, named, neighbours, place, released, text};
use crate::support::workspace::Workspace;
use std::fs;
use std::os::unix::fs::symlink;

/// Checks that no step ran: nothing was recorded.
fn nothing_ran(place: &Workspace) {
    let records = walkdir::WalkDir::new(place.path(".gs2e/ac")).into_iter().flatten();
    assert_eq!(records.filter(|entry| entry.file_type().is_file()).count(), 0, "a step ran");
}

fn refused(place: &Workspace, args: &str, words: &str) {
    let said = place.refused(args);
    assert!(said.contains(words), "{args}: `{words}` is not in {said}");
}

#[test]
fn a_foreign_folder_is_refused_before_anything_runs() {
    let place = Workspace::new();
    place.write("r.yaml", POSES);
    place.write("out/thesis.txt", "mine");
    place.write("file", "mine");
    symlink("out", place.path("link")).unwrap();
    refused(&place, "release --to out r.yaml", "is not empty and not a release: it has no manifest.json");
    refused(&place, "release --to file r.yaml", "file is not a folder");
    refused(&place, "release --replace --to file r.yaml", "file is not a folder");
    refused(&place, "release --to link r.yaml", "link is a link");
    refused(&place, "release --to .. r.yaml", "is not a name for a release folder");
    refused(&place, "release --to / r.yaml", "is not a name for a release folder");
    nothing_ran(&place);
    assert_eq!(neighbours(&place), ["file", "link", "out"]);
}

#[test]
fn inputs_of_a_release_are_never_replaced() {
    let place = Workspace::new();
    place.write("work/recipes/r.yaml", POSES);
    place.write("work/given/points.ply", "mine");
    let given = "{ \"version\": 1, \"scene\": \"g\", \"source\": \"none\", \"camera\": { \"width\": 48, \"height\": 32, \
                 \"fx\": 50, \"fy\": 50, \"cx\": 24, \"cy\": 16 }, \"reconstruct\": { \"given\": { \"path\": \"../given/points.ply\" } }, \
                 \"trajectories\": [{ \"name\": \"base\", \"orbit\": { \"arc\": 10, \"frames\": 5, \
                 \"centre\": [0, 0, 0], \"from\": [0, 0, -2], \"up\": [0, -1, 0] } }] }";
    place.write("work/recipes/g.yaml", given);
    let t = |to: &str, words: &str| {
        for replace in ["", " --replace"] {
            refused(&place, &format!("release{replace} --store work/store --to {to} work/recipes"), words);
        }
    };
    t("work", "work holds ");
    t("work/recipes", "work/recipes holds a recipe");
    t("work/given", "work/given holds the Gaussians of a scene");
    t("work/store", "work/store is the store");
    t("work/store/release", "work/store/release lies in the store");
    let above = place.path(".");
    t(above.to_str().unwrap(), " holds ");
    t("work/recipes/r.yaml", "is a recipe");
    place.write("house/me/thesis.txt", "mine");
    let mut command = place.command("release --replace --to house work/recipes");
    let ended = command.env("HOME", place.path("house/me")).output().unwrap();
    assert_eq!(ended.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&ended.stderr).contains("house holds your home folder"));
    assert_eq!(text(&place.path("work/recipes/r.yaml")), POSES);
    assert_eq!(text(&place.path("work/given/points.ply")), "mine");
}

#[test]
fn photos_are_never_replaced() {
    let place = Workspace::new();
    let transforms = serde_json::json!({
        "fl_x": 50.0, "fl_y": 50.0, "cx": 24.0, "cy": 16.0, "w": 48, "h": 32,
        "frames": [{ "file_path": "../photos/a.png", "transform_matrix":
            [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] }],
    });
    place.write("capture/transforms.json", transforms.to_string());
    place.write("photos/a.png", "mine");
    place.write(
        "r.yaml",
        "version: 1\nscene: s\nsource: { nerfstudio: { path: capture } }\n\
         trajectories: [{ name: base, refine: { factor: 2 } }]\noutputs: []\n",
    );
    refused(&place, "release --replace --to photos r.yaml", "photos is files of a scene's source");
    refused(&place, "release --replace --to capture r.yaml", "capture is the source of a scene");
    refused(&place, "release --to capture/out r.yaml", "lies in the source of a scene");
    assert_eq!(text(&place.path("photos/a.png")), "mine");
    assert_eq!(neighbours(&place), ["capture", "photos"]);
}

#[test]
fn licences_without_a_text_are_refused_in_the_recipe() {
    let place = Workspace::new();
    let long = format!("LicenseRef-{}", "x".repeat(300));
    let cases = [
        (long.as_str(), "311 bytes"),
        ("NOASSERTION", "NOASSERTION states no terms"),
        ("MIT OR NOASSERTION", "NOASSERTION states no terms"),
        ("NONE", "is not an SPDX expression"),
        ("DocumentRef-x:LicenseRef-y", "defined in another document"),
    ];
    for (expression, words) in cases {
        place.write("r.yaml", format!("{POSES}licence: {{ expression: \"{expression}\", holder: me }}\n"));
        refused(&place, "release --to out r.yaml", words);
        refused(&place, "plan r.yaml", words);
    }
    assert!(!place.path(".gs2e").exists());
}

/// A formula that is accepted can be released: `scene.json` holds it as text, at any depth of its
/// syntax tree.
#[test]
fn a_speed_of_many_terms_is_released_or_refused_at_once() {
    let place = place();
    let sum = |terms: usize| vec!["t"; terms - 1].join("+") + "+1";
    let nested = |depth: usize| format!("1.1 + {}t{}", "sin(".repeat(depth), ")".repeat(depth));
    let write = |formula: &str| {
        let refine = "refine: { factor: 2 }";
        place.write(
            "r.yaml",
            POSES.replace(refine, &format!("{refine}, speed: {{ function: \"{formula}\" }}")),
        );
    };
    for formula in [sum(45), sum(200), sum(250), nested(60), nested(90)] {
        write(&formula);
        place.ok("release --to out r.yaml");
        place.ok("audit out");
        place.ok("why tiny/base/trajectory --recipes r.yaml");
        let scene: serde_json::Value =
            serde_json::from_str(&text(&place.path("out/tiny/scene.json"))).unwrap();
        let speed = &scene["trajectories"][0]["parameters"]["speed"];
        assert_eq!(*speed, serde_json::json!({ "function": formula }));
    }
    for (formula, words) in
        [(sum(251), "more than 250 levels deep"), (nested(101), "more than 100 levels deep")]
    {
        write(&formula);
        refused(&place, "release --to other r.yaml", words);
    }
    assert_eq!(neighbours(&place), ["out"]);
}

/// `--replace` of the recipes' own folder, which is also the only argument.
#[test]
fn the_recipes_own_folder_is_never_replaced() {
    let place = released();
    fs::create_dir(place.path("r")).unwrap();
    fs::rename(place.path("r.yaml"), place.path("r/r.yaml")).unwrap();
    refused(&place, "release --replace --to r r", "r holds a recipe");
    assert_eq!(text(&place.path("r/r.yaml")), POSES);
    // The same through a link to a folder above it.
    symlink(".", place.path("here")).unwrap();
    refused(&place, "release --replace --to here/r r", "holds a recipe");
    assert!(place.path(&named(&place, "here")).is_symlink());
}
