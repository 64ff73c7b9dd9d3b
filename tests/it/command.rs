//! Scenes that an external program trains. A shell script takes its place and copies a planted
//! scene.

mod failing;
mod given;
mod permission;
mod templates;

use crate::support::given::ply;
use crate::support::workspace::{TINY, Workspace};
use glam::{DQuat, DVec3};
use gs2e_image::{Image, Size, png};
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_source::colmap::ColmapPoint;
use gs2e_source::colmap::write::{WrittenImage, write_model};
use std::fs;

const SIZE: Size = Size { width: 64, height: 48 };

/// A recipe over the files that [`trained_by`] writes.
const RECIPE: &str = "\
version: 1
scene: trained
seed: 7
source: { colmap: { path: capture } }
reconstruct:
  command:
    program: sh
    arguments: [\"{train}\", \"{capture}\", \"{out}\", \"{planted}\"]
    version: \"1.2\"
    probe: [\"{train}\", --version]
    licence: MIT
    min_psnr: 0
    scene: scene.ply
    files: { train: train.sh, planted: planted.ply }
camera: { width: 64, height: 48 }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"1\" }
outputs: [sharp]
licence: { expression: CC0-1.0, holder: Nobody }
";

/// Command that copies the planted scene to the requested place.
pub(crate) const COPY: &str = "cp \"$3\" \"$2/scene.ply\"";

/// Six photos around the origin with their model, and a program that reports its version, counts
/// its runs and then runs `script`.
pub(crate) fn trained_by(script: &str) -> Workspace {
    let place = Workspace::new();
    place.write("recipe.yaml", RECIPE);
    place.write("planted.ply", ply(|_, value| value));
    write_script(&place, script);
    capture(&place);
    place
}

pub(crate) fn write_script(place: &Workspace, script: &str) {
    let head = "if [ \"$1\" = --version ]; then echo 'trainer 1.2, as 1.3'; exit; fi\n\
                beside=$(dirname \"$0\")\necho run >> \"$beside/runs\"\n";
    place.write("train.sh", format!("{head}{script}\n"));
}

fn views() -> Vec<WrittenImage> {
    let view = |i: u32| {
        let angle = 0.002 * f64::from(i);
        // A turn about y by 2 * 0.002 rad per number, seen from 4 units before the origin.
        let rotation = DQuat::from_xyzw(0.0, -angle, 0.0, 1.0).normalize();
        let world_from_camera = Se3 { rotation, translation: rotation * DVec3::new(0.0, 0.0, -4.0) };
        let camera = Camera { size: SIZE, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, lens: None };
        WrittenImage { name: format!("photo {i}.png"), world_from_camera, camera }
    };
    (8..14).map(view).collect()
}

fn points() -> [ColmapPoint; 2] {
    [
        ColmapPoint { xyz: DVec3::new(0.5, -0.25, 1e-3), rgb: [255, 128, 3], error: 0.5 },
        ColmapPoint { xyz: DVec3::new(-2.0, 0.125, 0.75), rgb: [0, 1, 2], error: 0.25 },
    ]
}

fn capture(place: &Workspace) {
    let model = place.path("capture/sparse/0");
    fs::create_dir_all(&model).unwrap();
    write_model(&model, &views(), &points()).unwrap();
    for (view, grey) in views().iter().zip(10..) {
        photo(place, &view.name, grey);
    }
}

fn photo(place: &Workspace, name: &str, grey: u8) {
    let mut bytes = Vec::new();
    png::write_image(&Image::filled(SIZE, [grey, 20, 30]), &mut bytes).unwrap();
    place.write(&format!("capture/images/{name}"), bytes);
}

/// Number of runs in which the program trained.
fn runs(place: &Workspace) -> usize {
    fs::read_to_string(place.path("runs")).unwrap_or_default().lines().count()
}

pub(crate) fn edit(place: &Workspace, from: &str, to: &str) {
    let recipe = fs::read_to_string(place.path("recipe.yaml")).unwrap();
    assert!(recipe.contains(from), "{from}");
    place.write("recipe.yaml", recipe.replace(from, to));
}

#[test]
fn the_program_runs_again_only_after_a_change() {
    let place = trained_by(COPY);
    let built = |wanted: usize, why: &str| {
        let made = place.build("--allow-commands recipe.yaml");
        assert_eq!(runs(&place), wanted, "{why}");
        assert_eq!(place.stale("recipe.yaml"), [""; 0], "{why}");
        made
    };
    assert!(built(1, "it never ran").contains(&"trained/reconstruct".to_owned()));
    assert_eq!(built(1, "nothing changed"), [""; 0]);
    place.ok("build recipe.yaml");
    for (from, to) in [
        ("version: \"1.2\"", "version: \"1.3\""),
        ("\"{planted}\"]", "\"{planted}\", -n, 7]"),
        ("licence: MIT\n", "licence: MIT\n    environment: { STEPS: \"8\" }\n"),
        ("scene: scene.ply\n", "scene: scene.ply\n    gaussians: { min: 30 }\n"),
    ] {
        let before = runs(&place);
        edit(&place, from, to);
        let made = built(before + 1, to);
        // The program makes the same scene, so no later step runs.
        assert_eq!(made, ["trained/reconstruct"], "{to}");
        edit(&place, to, from);
        assert_eq!(built(before + 1, "an edit undone"), [""; 0]);
    }
    let before = runs(&place);
    for (from, to) in [
        ("licence: MIT", "licence: Apache-2.0"),
        ("probe: [\"{train}\", --version]", "probe: [\"{train}\", --version, again]"),
        ("scene: scene.ply\n", "scene: scene.ply\n    iterations: 7000\n"),
    ] {
        edit(&place, from, to);
        assert_eq!(built(before, to), [""; 0]);
    }
    photo(&place, "photo 9.png", 99);
    built(before + 1, "another photo");
    write_script(&place, &format!("{COPY} # another"));
    built(before + 2, "another program");
}

/// A key depends neither on the folder nor on the store, and a program's output is not part of its
/// product.
#[test]
fn keys_and_products_are_the_same_elsewhere() {
    let talkative = format!("{COPY}; echo \"in $(pwd), by $$\"");
    let [here, there] = [(), ()].map(|()| trained_by(&talkative));
    for place in [&here, &there] {
        place.ok("build -q --allow-commands recipe.yaml");
    }
    let products = |place| {
        let keys = crate::support::steps::keys(place, "recipe.yaml");
        (keys, crate::support::steps::products(place, "recipe.yaml"))
    };
    assert_eq!(products(&here), products(&there));
    here.ok("build --allow-commands --recheck 100% recipe.yaml");
    assert_eq!(runs(&here), 2, "it was made again, and came out the same");
    here.ok("build --recheck 100% recipe.yaml");
    assert_eq!(runs(&here), 2, "without leave it is not made again");
}

#[test]
fn a_release_names_the_program_that_trained_its_scene() {
    let place = trained_by(COPY);
    edit(&place, "scene: scene.ply\n", "scene: scene.ply\n    iterations: 7000\n");
    edit(&place, "\"{planted}\"]", "\"{planted}\", \"--steps={iterations}\", \"--seed\", \"{seed}\"]");
    place.ok("release -q --allow-commands --to out recipe.yaml");
    place.ok("audit out");
    let scene = fs::read(place.path("out/trained/scene.json")).unwrap();
    let scene: serde_json::Value = serde_json::from_slice(&scene).unwrap();
    let made = &scene["reconstruction"];
    assert_eq!((&made["kind"], &made["iterations"]), (&"command".into(), &7000.into()));
    assert_eq!(made["command"], "sh {train} {capture} {out} {planted} --steps=7000 --seed 7");
    assert_eq!(made["gaussians"], 40);
    let tool = serde_json::json!({ "name": "sh", "version": "1.2", "licence": "MIT" });
    assert_eq!(scene["licence"]["tools"][1], tool);
    let text = scene.to_string();
    assert!(!text.contains(place.path("").to_str().unwrap()), "a path of this machine is in {text}");
}

/// Adds a scene that needs no program.
fn with_tiny(place: &Workspace) {
    place.write("tiny.yaml", TINY);
}
