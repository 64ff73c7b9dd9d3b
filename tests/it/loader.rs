//! The loader in every release, `gs2e.py`, as users run it. Its results are compared with h5py's
//! own columns, with `poses.txt`, with pictures from another decoder, and with planted files of
//! known content.

use crate::release::small::release;
use crate::support::absent::absent;
use crate::support::workspace::{TINY, Workspace, tiny_with};
use gs2e_image::png;
use std::fs;
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, Output};

/// A script of questions to the loader, one command each.
const QUESTIONS: &str = include_str!("loader/questions.py");

/// Runs Python with the loader of a release; `None` if Python cannot be started.
fn python(release: &Path, args: &[&str]) -> Option<Output> {
    let mut command = Command::new("python3");
    // Python would write bytecode into the release.
    command.env("PYTHONDONTWRITEBYTECODE", "1").env("PYTHONPATH", release).args(args);
    command.output().ok()
}

/// Asks one question of a release's loader; the script asserts the answer.
pub(crate) fn ask(release: &Path, question: &[&str]) {
    if !python(release, &["-c", "import numpy, h5py"]).is_some_and(|output| output.status.success()) {
        return absent("REQUIRE_READERS", "python3 with numpy and h5py is absent");
    }
    let args = [&["-c", QUESTIONS], question].concat();
    let output = python(release, &args).unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{question:?}: {said}");
}

#[test]
fn windows_poses_and_grids_are_those_of_the_files() {
    for trajectory in ["base", "slow"] {
        let folder = release().join("small/one");
        for question in ["windows", "poses", "grids", "cuts", "targets", "processes"] {
            ask(release(), &[question, folder.to_str().unwrap(), trajectory]);
        }
    }
}

#[test]
fn planted_answers_are_found() {
    let place = Workspace::new();
    place.write("empty", "");
    let folder = place.path("planted");
    for question in ["planted_poses", "planted_events", "planted_pictures", "planted_split"] {
        ask(release(), &[question, folder.to_str().unwrap()]);
    }
}

/// Compares pictures with those of the program's own decoder.
#[test]
fn pictures_equal_those_of_another_decoder() {
    let place = Workspace::new();
    let base = release().join("small/one/base");
    for j in (0..24).step_by(4) {
        let file = fs::File::open(base.join(format!("sharp/{j:06}.png"))).unwrap();
        let image = png::read_rgb(BufReader::new(file)).unwrap();
        place.write(&format!("{j:06}.raw"), raw(&image));
    }
    ask(release(), &["pictures", base.to_str().unwrap(), place.path("").to_str().unwrap()]);
}

#[test]
fn exposures_and_geometry_are_read() {
    ask(release(), &["exposures", release().join("small/one/base").to_str().unwrap()]);
}

fn raw(image: &gs2e_image::Image<[u8; 3]>) -> Vec<u8> {
    image.pixels().as_flattened().to_vec()
}

#[test]
fn one_of_several_sensors_is_asked_for_by_name() {
    let place = Workspace::new();
    let sensors = "sensors:\n  fine: { voltmeter: { preset: dvs346-paper, threshold: { on: 0.5, off: 0.5 } } }\n  \
                   usual: { voltmeter: { preset: dvs346, labels: true } }\n";
    place.write("tiny.yaml", tiny_with(sensors));
    place.ok("release --to tree tiny.yaml");
    let tree = place.path("tree");
    ask(&tree, &["sensors", tree.join("tiny").to_str().unwrap()]);
    place.ok("audit tree");
}

#[test]
fn inertial_data_are_the_columns_of_their_file() {
    let place = Workspace::new();
    let outputs = "outputs: [events, imu]\nscale: { metres_per_unit: 0.2 }\n";
    place.write("tiny.yaml", TINY.replace("outputs: [events, sharp]\n", outputs));
    place.ok("release --to tree tiny.yaml");
    ask(&place.path("tree"), &["inertial", place.path("tree/tiny/base").to_str().unwrap()]);
}

#[test]
fn light_is_that_of_the_recipe() {
    let place = Workspace::new();
    let lights = "lights:\n  flicker: { hz: 250, depth: 0.3, waveform: square, phase: 0.5 }\n  level: \
                  [{ t: 0.001, stops: 0 }, { t: 0.003, stops: 1 }]\noutputs: [events, sharp]\n";
    place.write("tiny.yaml", TINY.replace("outputs: [events, sharp]\n", lights));
    place.ok("release --to tree tiny.yaml");
    ask(&place.path("tree"), &["light", place.path("tree/tiny/base").to_str().unwrap()]);
}

#[test]
fn masks_are_numbers_of_objects() {
    let place = Workspace::new();
    let objects = "outputs: [events, segmentation]\nobjects:\n  - name: bowl\n    \
                   select: { box: { low: [-0.3, -0.7, -0.7], high: [1, 0, 0.7] } }\n    \
                   path: { orbit: { centre: [0.34, 0, 0], axis: [0, -1, 0], degrees_per_second: 90 } }\n";
    place.write("tiny.yaml", TINY.replace("outputs: [events, sharp]\n", objects));
    place.ok("release --to tree tiny.yaml");
    ask(&place.path("tree"), &["masks", place.path("tree/tiny/base").to_str().unwrap()]);
}

/// Two scenes that the salt deals to different splits.
#[test]
fn a_dataset_has_the_scenes_of_a_split() {
    let place = Workspace::new();
    for (id, seed) in [("a", "2"), ("b", "3")] {
        let recipe = TINY.replace("scene: tiny", &format!("scene: {id}"));
        let recipe = recipe.replace("arc: 6, seed: 1", &format!("arc: 6, seed: {seed}"));
        place.write(&format!("recipes/{id}.yaml"), recipe);
    }
    let tree = place.path("tree");
    for salt in 0..32 {
        let splits = format!("{{ by: object, shares: {{ train: 0.5, test: 0.5 }}, salt: \"{salt}\" }}");
        place.write("recipes/release.yaml", format!("splits: {splits}\n"));
        place.ok("release --to tree recipes");
        let split = |id: &str| {
            let scene = fs::read(tree.join(id).join("scene.json")).unwrap();
            serde_json::from_slice::<serde_json::Value>(&scene).unwrap()["split"]["name"].clone()
        };
        if split("a") != split("b") {
            return ask(&tree, &["dataset", tree.to_str().unwrap()]);
        }
        fs::remove_dir_all(&tree).unwrap();
    }
    panic!("one of 32 salts separates two scenes, but for a chance of 2 to the power of -32");
}

#[test]
fn a_file_of_events_alone_is_read() {
    let place = Workspace::released(&TINY.replace("preset: dvs346,", "preset: dvs346, labels: true,"), "");
    fs::copy(place.path("tree/tiny/base/events.h5"), place.path("events.h5")).unwrap();
    ask(&place.path("tree"), &["bare", place.path("events.h5").to_str().unwrap()]);
}
