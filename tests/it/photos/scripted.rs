//! A script in the place of COLMAP: what a build does with its results and with its failures. With a
//! vocabulary tree, COLMAP itself matches, so the script needs no database.

use super::planted;
use crate::command;
use crate::support::workspace::{RunOutcome, Workspace};
use glam::{DQuat, DVec3};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_source::colmap::ColmapPoint;
use gs2e_source::colmap::write::{WrittenImage, write_model};
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt as _;

const SIZE: Size = Size { width: 64, height: 48 };

/// A recipe with these settings of the source.
pub(super) fn recipe(settings: &str) -> String {
    format!(
        "\
version: 1
scene: lab/corner
source: {{ photos: {{ path: photos, {settings} }} }}
reconstruct:
  builtin: {{ gaussians: 300, iterations: 6, resolution: 32 }}
camera: {{ width: 64, height: 48 }}
trajectories:
  - name: base
    refine: {{ window: 2, factor: 2, curve: cubic }}
    speed: {{ function: \"1\" }}
outputs: [sharp]
checks: {{ recon_psnr: {{ drop: 60 }} }}
licence: {{ expression: CC0-1.0, holder: Nobody }}
"
    )
}

/// A folder with `photos` photos and a recipe, and a `colmap` whose mapper copies the planted models.
/// `script` runs first.
fn scripted(photos: usize, script: &str) -> Workspace {
    let place = Workspace::new();
    place.write("recipe.yaml", recipe("vocabulary: tree.bin, registered: 0.6"));
    place.write("tree.bin", "a tree");
    fs::create_dir_all(place.path("models")).unwrap();
    (0..photos).for_each(|k| drop(planted::grey(&place, &format!("photos/photo {k}.png"), SIZE)));
    write_colmap(&place, script);
    place
}

fn write_colmap(place: &Workspace, script: &str) {
    let head = "#!/bin/sh\nif [ \"$1\" = help ]; then echo 'COLMAP 3.8 -- a script'; exit; fi\n\
                if [ \"$2\" = -h ]; then exit; fi\n\
                here=$(dirname \"$0\")\necho \"$1\" >> \"$here/../runs\"\n";
    let map = "\nif [ \"$1\" = mapper ]; then\n  while [ \"$1\" != --output_path ]; do shift; done\n  \
               cp -r \"$here/../models/.\" \"$2\"\nfi\n";
    place.write("bin/colmap", format!("{head}{script}{map}"));
    fs::set_permissions(place.path("bin/colmap"), Permissions::from_mode(0o755)).unwrap();
}

/// Plants a model of the photos with these indices.
fn plant(place: &Workspace, number: u32, photos: std::ops::Range<u32>, size: Size) {
    let camera = Camera { size, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, lens: None };
    let view = |k: u32| {
        let rotation = DQuat::from_rotation_y(-0.01 * f64::from(k));
        let translation = rotation * DVec3::new(0.0, 0.0, -4.0);
        WrittenImage { name: format!("{k:06}.png"), world_from_camera: Se3 { rotation, translation }, camera }
    };
    let points: Vec<ColmapPoint> = (0..20)
        .map(|k| ColmapPoint {
            xyz: DVec3::new(0.1 * f64::from(k) - 1.0, 0.05 * f64::from(k % 7), 0.1 * f64::from(k % 3)),
            rgb: [90; 3],
            error: 0.5,
        })
        .collect();
    let model = place.path(&format!("models/{number}"));
    fs::create_dir_all(&model).unwrap();
    write_model(&model, &photos.map(view).collect::<Vec<_>>(), &points).unwrap();
}

/// Runs `gs2e` with the script first in `PATH`.
fn gs2e(place: &Workspace, args: &str) -> RunOutcome {
    let path = std::env::var("PATH").unwrap();
    let path = format!("{}:{path}", place.path("bin").display());
    let output = place.command(args).env("PATH", path).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    RunOutcome {
        code: output.status.code().unwrap(),
        stdout: text(output.stdout),
        stderr: text(output.stderr),
    }
}

/// The steps that a build makes.
fn made(place: &Workspace) -> Vec<String> {
    let ended = gs2e(place, "build -j 1 --json recipe.yaml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let lines = ended.stdout.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let made = lines.filter(|line| line["state"] == "made");
    made.map(|line| line["step"].as_str().unwrap().to_owned()).collect()
}

/// COLMAP prints a line for each photo. The progress goes to a file too, not only to a terminal.
#[test]
fn a_search_for_poses_reports_its_progress() {
    let lines = "case $1 in\nfeature_extractor) for k in 1 2 3 4 5 6; do echo \"Processed file [$k/6]\"; done;;\n\
                 mapper) echo 'Initializing with image pair #1 and #2'\n\
                 for k in 3 4 5 6; do echo \"Registering image #$k ($k)\"; done;;\nesac";
    let place = scripted(6, lines);
    plant(&place, 0, 0..6, SIZE);
    let ended = gs2e(&place, "build -j 1 recipe.yaml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    for words in ["lab/corner/poses: photo 6/6", "lab/corner/poses: registered 6/6"] {
        assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
    }
}

#[test]
fn poses_are_found_once_and_the_model_decides_what_follows() {
    let place = scripted(7, "");
    plant(&place, 0, 0..6, SIZE);
    let ended = gs2e(&place, "release --to out recipe.yaml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert!(ended.stderr.contains("1 of 7 photos have no pose"), "{}", ended.stderr);
    let scene: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path("out/lab/corner/scene.json")).unwrap()).unwrap();
    let images = scene["images"].as_array().unwrap();
    let names: Vec<_> = images.iter().map(|image| image["name"].as_str().unwrap()).collect();
    assert_eq!(names, (0..7).map(|k| format!("photo {k}.png")).collect::<Vec<_>>());
    assert_eq!(images[6]["why_not"], "has no pose in the source");
    assert_eq!(images.iter().filter(|image| image["used"] == true).count(), 6);
    let runs = || fs::read_to_string(place.path("runs")).unwrap().lines().count();
    assert_eq!(runs(), 3, "key points, pairs and models");
    assert_eq!(made(&place), [""; 0]);
    // The same model comes out, so nothing after it is made.
    command::edit(&place, "registered: 0.6", "registered: 0.6, lens: radial");
    assert_eq!(made(&place), ["lab/corner/poses"]);
    // A limit refuses a result and changes none.
    command::edit(&place, "registered: 0.6", "registered: 0.7");
    assert_eq!(made(&place), [""; 0]);
    assert_eq!(runs(), 6);
    place.write("tree.bin", "another tree");
    assert_eq!(made(&place), ["lab/corner/poses"]);
    plant(&place, 0, 0..7, SIZE);
    command::edit(&place, "lens: radial", "lens: opencv");
    assert!(made(&place).contains(&"lab/corner/reconstruct".to_owned()), "another model");
}

/// Builds, which must fail at the poses, leave nothing, and say this.
fn fails(place: &Workspace, wanted: &[&str]) {
    let ended = gs2e(place, "build -j 1 recipe.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    for text in wanted {
        // Messages are wrapped to the width of the terminal.
        let message = ended.stderr.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(message.contains(text), "{text}\n{}", ended.stderr);
    }
    let left = fs::read_dir(place.path(".gs2e/gs2e-tmp")).map_or(0, Iterator::count);
    assert_eq!(left, 0, "nothing is left of its folder");
}

#[test]
fn failures_name_their_cause() {
    let place = scripted(6, "seq 100; echo 'no space for key points' >&2; exit 7");
    fails(&place, &["colmap", "exit code 7", "no space for key points"]);
    write_colmap(&place, "kill -9 $$");
    fails(&place, &["signal 9 ended it"]);
    write_colmap(&place, "if [ $1 = mapper ]; then echo 'ERROR: failed to create sparse model'; exit 1; fi");
    fails(&place, &["COLMAP made no model of 6 photos"]);
    write_colmap(&place, "");
    fails(&place, &["COLMAP made no model of 6 photos"]);
    plant(&place, 0, 0..2, SIZE);
    plant(&place, 1, 2..5, SIZE);
    fails(&place, &["the largest of COLMAP's 2 models has 3 of 6 photos, wanted at least 4"]);
    fs::remove_dir_all(place.path("models/1")).unwrap();
    plant(&place, 0, 0..6, Size { width: 48, height: 64 });
    fails(&place, &["COLMAP's camera of photo 0.png has other sides than the photo"]);
    fs::write(place.path("models/0/images.bin"), [1, 2, 3]).unwrap();
    fails(&place, &["its model", "images.bin"]);
    plant(&place, 0, 0..6, SIZE);
    assert!(made(&place).contains(&"lab/corner/poses".to_owned()), "the fault is gone");
}

#[test]
fn photos_that_cannot_be_used_are_named() {
    let place = scripted(2, "");
    fails(&place, &["there are 2 photos, wanted at least 3"]);
    place.write("photos/note.jpg", "no photo");
    fails(&place, &["note.jpg", "its size cannot be read"]);
    for (path, wanted) in [("nowhere", "nowhere"), ("tree.bin", "it is a file, wanted a folder of photos")] {
        place.write(
            "recipe.yaml",
            recipe("vocabulary: tree.bin").replace("path: photos", &format!("path: {path}")),
        );
        let ended = gs2e(&place, "build -j 1 recipe.yaml");
        let message = ended.stderr.split_whitespace().collect::<Vec<_>>().join(" ");
        // Nothing runs if a source cannot be listed.
        assert!(ended.code == 2 && message.contains(wanted), "{}", ended.stderr);
    }
}

#[test]
fn a_missing_colmap_is_named() {
    let place = scripted(6, "");
    let ended = place.command("build -j 1 recipe.yaml").env("PATH", place.path("empty")).output().unwrap();
    let message = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(1), "{message}");
    assert!(message.contains("colmap") && message.contains("PATH"), "{message}");
}

#[test]
fn two_sizes_are_two_cameras() {
    let place = scripted(5, "");
    let tall = Size { width: 48, height: 64 };
    planted::grey(&place, "photos/photo 5.png", tall);
    plant(&place, 0, 0..5, SIZE);
    let ended = gs2e(&place, "build -j 1 recipe.yaml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let runs = fs::read_to_string(place.path("runs")).unwrap();
    assert_eq!(runs.lines().filter(|run| *run == "feature_extractor").count(), 2);
}

#[test]
fn recipes_that_cannot_work_are_refused() {
    let place = scripted(6, "");
    let t = |from: &str, to: &str, wanted: &str| {
        let before = fs::read_to_string(place.path("recipe.yaml")).unwrap();
        command::edit(&place, from, to);
        let ended = gs2e(&place, "plan recipe.yaml");
        place.write("recipe.yaml", before);
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        let message = ended.stderr.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(message.contains(wanted), "{wanted}\n{}", ended.stderr);
    };
    t("registered: 0.6", "registered: 1.6", "a number from 0 to 1");
    t("registered: 0.6", "every: 5", "applies only to a video");
    t("photos: {", "colmap: {", "registered");
    t(
        "builtin: { gaussians: 300, iterations: 6, resolution: 32 }",
        "given: { path: scene.ply }",
        "names a scene in a world of its own",
    );
    t(
        "reconstruct:\n  builtin: { gaussians: 300, iterations: 6, resolution: 32 }\n",
        "",
        "reconstruct: { builtin: {} }",
    );
}

#[test]
fn a_folder_of_photos_gets_a_recipe() {
    let place = scripted(10, "");
    let ended = place.ok("init photos . --to recipes --prefix lab --min-side 40");
    assert!(ended.stderr.contains("1 recipes were written"), "{}", ended.stderr);
    let text = fs::read_to_string(place.path("recipes/photos.yaml")).unwrap();
    assert!(text.contains("photos: { path: \"../photos\" }") && text.contains("builtin: {}"), "{text}");
    place.ok("plan recipes");
    let ended = place.gs2e("train --capture photos --out scene.ply");
    assert_eq!(ended.code, 2);
    assert!(ended.stderr.contains("source: { photos:"), "{}", ended.stderr);
}
