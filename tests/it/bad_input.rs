//! Bad input, through the program: each case ends with its exit code and one message with the
//! place, the value found and the value wanted. No file is left that looks complete, and once the
//! input is repaired the release succeeds.

use crate::support::given::{GIVEN, ply, sound, transforms};
use crate::support::workspace::{TINY, Workspace, tree};
use std::io::Write as _;

/// Checks that the release of `recipe` is refused with one of these codes and one message that
/// holds all of `said`, and that it leaves no file.
#[track_caller]
fn refused(place: &Workspace, recipe: &str, codes: &[i32], said: &[&str]) {
    let before = tree(&place.path("")).into_keys().filter(|name| !name.starts_with(".gs2e/"));
    let before: Vec<String> = before.collect();
    let ended = place.gs2e(&format!("release --to out {recipe}"));
    let message = &ended.stderr;
    assert!(
        codes.contains(&ended.code),
        "exit {} where one of {codes:?} is due, about {said:?}:\n{message}",
        ended.code
    );
    assert_eq!(message.matches("error:").count(), 1, "one message:\n{message}");
    assert!(!message.contains("panicked"), "{message}");
    for part in said {
        assert!(
            message.to_lowercase().contains(&part.to_lowercase()),
            "nothing about `{part}` in:\n{message}"
        );
    }
    let after = tree(&place.path("")).into_keys().filter(|name| !name.starts_with(".gs2e/"));
    assert_eq!(before, after.collect::<Vec<_>>(), "a refused release leaves no file");
}

#[test]
fn the_sound_twin_passes() {
    sound().ok("release --to out recipe.yaml");
}

/// Faults in the recipe's text: exit code 2, with the line of the fault.
#[test]
fn a_recipe_with_faulty_text_is_refused() {
    let t = |from: &str, to: &str, said: &[&str]| {
        assert!(TINY.contains(from), "{from}");
        let place = Workspace::new();
        let text = TINY.replacen(from, to, 1);
        place.write("tiny.yaml", &text);
        let line = TINY.lines().position(|line| line.contains(from.trim_end())).expect("it is a line") + 1;
        refused(&place, "tiny.yaml", &[2], said);
        // A duplicate is on the line after the first.
        let ended = place.gs2e("plan tiny.yaml");
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        let near = [line, line + 1].map(|line| format!("tiny.yaml:{line}:"));
        assert!(near.iter().any(|place| ended.stderr.contains(place)), "{near:?} not in:\n{}", ended.stderr);
    };
    t("threshold:", "treshold:", &["unknown", "treshold", "threshold"]);
    t("seed: 7", "seed: 7\nseed: 8", &["duplicate", "seed"]);
    t("  - name: base", "\t- name: base", &["tab"]);
    t("rate: 2400", "rate: .nan", &["rate", "nan"]);
    t("arc: 6", "arc: .nan", &["arc", "nan"]);
    t("arc: 6", "arc: 500", &["arc", "500", "360"]);
    t("rate: 2400", "rate: -1", &["rate", "-1"]);
    t("0.25*sin(t) + 1.1", "sin(t)", &["speed", "positive"]);
    t("0.25*sin(t) + 1.1", "0.25*sin(t", &["speed"]);
    t("outputs: [events, sharp]", "outputs: [events, blurr]", &["blurr"]);
    t("between: linear", "between: quintic", &["quintic"]);
    t("version: 1", "version: 2", &["version", "2"]);
}

/// Names that would leave the release folder, or collide with files at its top.
#[test]
fn a_name_that_leads_out_of_its_folder() {
    let t = |from: &str, to: &str| {
        let place = Workspace::new();
        assert!(TINY.contains(from), "{from}");
        place.write("tiny.yaml", TINY.replace(from, to));
        refused(
            &place,
            "tiny.yaml",
            &[2],
            &[from.split_once(':').map_or(from, |(key, _)| key), "tiny.yaml:"],
        );
    };
    for bad in [
        "../evil",
        "/evil",
        "a/../../evil",
        "a//b",
        "a/./b",
        "a/..",
        "..",
        ".",
        "a\\b",
        "C:/evil",
        "\"\"",
        "a/",
    ] {
        t("scene: tiny", &format!("scene: {bad}"));
        t("name: base", &format!("name: {bad}"));
    }
    for taken in ["LICENSES", "README.md", "manifest.json", "SHA256SUMS/a"] {
        t("scene: tiny", &format!("scene: {taken}"));
    }
    t("name: base", "name: scene.json");
}

/// Leaks and thresholds that no real sensor has: more than 50 events per pixel between two frames.
#[test]
fn a_sensor_that_would_fire_without_end() {
    let place = Workspace::new();
    let paper = "{ k: [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5], units: { time: us, brightness: 255 } }";
    place.write("tiny.yaml", TINY.replace("{ preset: dvs346, threshold: { on: 1.0, off: 1.0 } }", paper));
    refused(&place, "tiny.yaml", &[1, 2], &["events", "50"]);
}

#[test]
fn a_file_that_is_not_there() {
    refused(&Workspace::new(), "absent.yaml", &[2], &["absent.yaml"]);
    for name in ["scene.ply", "transforms.json"] {
        let place = sound();
        std::fs::remove_file(place.path(name)).expect("it was there");
        refused(&place, "recipe.yaml", &[2], &[name, "not"]);
    }
}

/// Faults that show only when the scene or the poses are read. A repaired file is enough for the
/// release to succeed.
#[test]
fn a_scene_or_a_pose_that_cannot_be_used() {
    let t = |name: &str, content: &[u8], said: &[&str]| {
        let place = sound();
        place.write(
            "recipe.yaml",
            GIVEN.replace("scene.ply", if name == "transforms.json" { "scene.ply" } else { name }),
        );
        place.write(name, content);
        refused(&place, "recipe.yaml", &[1, 2], said);
        let mended = sound();
        std::fs::copy(mended.path("scene.ply"), place.path("scene.ply")).expect("files can be copied");
        std::fs::copy(mended.path("transforms.json"), place.path("transforms.json"))
            .expect("files can be copied");
        place.write("recipe.yaml", GIVEN);
        place.ok("release --to out recipe.yaml");
    };
    let whole = ply(|_, value| value);
    t("scene.ply", &whole[..whole.len() - 10], &["scene.ply", "byte"]);
    t("scene.ply", &whole[..100], &["scene.ply"]);
    t("scene.ply", b"", &["scene.ply"]);
    t("scene.ply", &ply(|column, value| if column == 1 { f32::NAN } else { value }), &["scene.ply", "NaN"]);
    t("scene.splat", &[7; 33], &["scene.splat", "32"]);
    t("scene.spz", &spz(1000, 100), &["scene.spz"]);
    let packed = spz(1000, 19_000);
    t("scene.spz", &packed[..packed.len() / 2], &["scene.spz"]);
    t("transforms.json", transforms(1.1).as_bytes(), &["frames[0]", "rotation"]);
    t("transforms.json", b"{ \"frames\": [", &["transforms.json"]);
    t(
        "transforms.json",
        transforms(1.0).replace("60.0", "0.0").as_bytes(),
        &["transforms.json", "focal length"],
    );
}

/// An `.spz` of version 3 that announces `count` Gaussians and holds `body` bytes of them.
fn spz(count: u32, body: usize) -> Vec<u8> {
    let mut plain = b"NGSP".to_vec();
    plain.extend(3u32.to_le_bytes());
    plain.extend(count.to_le_bytes());
    plain.extend([0, 12, 0, 0]);
    plain.extend((0..=250).cycle().take(body));
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(&plain).expect("memory can be written");
    packed.finish().expect("memory can be written")
}
