//! `gs2e convert`: scenes between file formats, and the reported losses.

use crate::support::workspace::Workspace;
use gs2e_scene as scene;
use gs2e_testing::ply;
use serde_json::Value;
use std::path::{Path, PathBuf};

fn golden(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/scenes").join(name).display().to_string()
}

/// Names in the workspace's own folder.
fn names(place: &Workspace) -> Vec<String> {
    let entries = std::fs::read_dir(place.path("")).unwrap().map(|e| e.unwrap().file_name());
    let mut names: Vec<String> = entries.map(|name| name.into_string().unwrap()).collect();
    names.sort();
    names
}

/// A compressed file becomes a `.ply` with the values that an independent reader of plain floats
/// finds.
#[test]
fn compressed_scenes_become_ply_without_loss() {
    let place = Workspace::new();
    for name in ["packed-coloured.ply", "packed-third-degree.ply", "palette.sog", "flat.sog"] {
        let input = PathBuf::from(golden(name));
        place.ok(&format!("convert {} out.ply", input.display()));
        let (written, read) = (ply::read(&place.path("out.ply")), scene::read_file(&input).unwrap());
        assert_eq!(written.positions, read.positions, "{name}");
        assert_eq!((&written.rotations, &written.log_scales), (&read.rotations, &read.log_scales), "{name}");
        assert_eq!((&written.sh, written.sh_degree), (&read.sh, read.sh_degree), "{name}");
        let first = std::fs::read(place.path("out.ply")).unwrap();
        place.ok("convert out.ply again.ply");
        assert_eq!(std::fs::read(place.path("again.ply")).unwrap(), first, "{name}");
    }
    assert_eq!(names(&place), ["again.ply", "out.ply"], "nothing else is left");
}

#[test]
fn losses_need_permission() {
    let place = Workspace::new();
    let t = |input: &str, output: &str, message: &[&str]| {
        let command = format!("convert {} {output}", golden(input));
        let refused = place.gs2e(&command);
        assert_eq!((refused.code, refused.stdout.as_str()), (2, ""), "{}", refused.stderr);
        assert!(refused.stderr.starts_with(&format!("error: {output} cannot store all of the input\n")));
        assert!(refused.stderr.ends_with("help: pass --lossy to write it anyway\n"), "{}", refused.stderr);
        assert!(names(&place).is_empty(), "nothing is written");
        let written = place.ok(&format!("{command} --lossy"));
        for line in message {
            assert!(refused.stderr.contains(line) && written.stderr.contains(line), "{}", refused.stderr);
        }
        std::fs::remove_file(place.path(output)).unwrap();
    };
    let rounded = ["positions: rounded to steps of 2^-", "log scales: rounded to steps of 1/16"];
    t("packed-coloured.ply", "a.spz", &rounded);
    t(
        "palette.sog",
        "a.splat",
        &["harmonics: dropped above degree 0; the input has degree 2", "antialiased: dropped"],
    );
}

#[test]
fn programs_get_counts_and_losses() {
    let place = Workspace::new();
    let ended = place.ok(&format!("convert --json --lossy {} a.spz", golden("palette.sog")));
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!([&found["read"], &found["dropped"], &found["written"]], [90, 0, 90]);
    assert_eq!(found["bytes"], std::fs::metadata(place.path("a.spz")).unwrap().len());
    let fields: Vec<&str> =
        found["lost"].as_array().unwrap().iter().map(|l| l["field"].as_str().unwrap()).collect();
    assert!(fields.contains(&"rotations"), "{found}");
    // Values that have been rounded once are not rounded again.
    let again = place.ok("convert --json a.spz b.spz");
    let found: Value = serde_json::from_str(&again.stdout).unwrap();
    assert_eq!(found["lost"].as_array().unwrap().len(), 0, "{found}");
}

#[test]
fn gaussians_that_are_not_finite_are_dropped_and_counted() {
    let place = Workspace::new();
    let mut bytes = std::fs::read(golden("packed-plain.expected.ply")).unwrap();
    let row = 14 * 4;
    let last = bytes.len() - row;
    bytes[last..last + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    place.write("nan.ply", bytes);
    let ended = place.ok("convert --json nan.ply out.ply");
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!([&found["read"], &found["dropped"], &found["written"]], [7, 1, 6]);
    assert!(ended.stderr.contains("dropped 1 with a NaN or an infinity"), "{}", ended.stderr);
}

#[test]
fn unknown_properties_are_reported() {
    let place = Workspace::new();
    let names = "x y z nx f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 label";
    let properties: String = names.split(' ').map(|name| format!("property float {name}\n")).collect();
    let body = "0 ".repeat(11) + "1 0 0 0 7\n";
    place.write("a.ply", format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n{body}"));
    let refused = place.gs2e("convert a.ply b.ply");
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("other properties: dropped: label\n"), "{}", refused.stderr);
    place.ok("convert --lossy a.ply b.ply");
    place.ok("convert b.ply c.ply");
}

#[test]
fn a_command_that_is_wrong_writes_nothing() {
    let place = Workspace::new();
    place.write("bad.ply", "ply\nformat ascii 1.0\nelement vertex 1\n");
    place.write("events.h5", "");
    place.write("folder.ply/x", "");
    std::fs::copy(golden("flat.sog"), place.path("a.sog")).unwrap();
    let before = names(&place);
    let t = |args: &str, code: i32, message: &str| {
        let ended = place.gs2e(&format!("convert {args}"));
        assert_eq!(ended.code, code, "{args}: {}", ended.stderr);
        assert!(ended.stderr.contains(message), "{args}: {}", ended.stderr);
        assert_eq!(names(&place), before, "{args}");
    };
    t("a.sog", 2, "<OUT>");
    t("absent.ply out.ply", 2, "absent.ply cannot be read");
    t("a.sog out.h5", 2, "out.h5 is an event file, but a.sog is not\nhelp: scenes read: .ply,");
    t("events.h5 out.ply", 2, "events.h5 is an event file, but out.ply is not");
    t("a.sog out.sog", 2, "out.sog: not a format that gs2e writes");
    t("a.sog out", 2, "written: .ply, .spz, .splat");
    t("a.sog folder.ply", 2, "folder.ply is a folder");
    t("bad.ply out.ply", 1, "bad.ply: failed to read .ply at byte 38: found the end of the data");
    t("a.sog no/such/out.ply", 2, "no/such/out.ply is in a folder that does not exist");
    t("folder.ply out.ply", 1, "meta.json");
}

/// A SOG folder gives the same result as its archive.
#[test]
fn folders_are_read() {
    let place = Workspace::new();
    let archive = std::fs::File::open(golden("palette.sog")).unwrap();
    zip::ZipArchive::new(archive).unwrap().extract(place.path("sog")).unwrap();
    place.ok("convert sog a.ply");
    place.ok("convert sog/meta.json b.ply");
    place.ok(&format!("convert {} c.ply", golden("palette.sog")));
    let read = |name: &str| std::fs::read(place.path(name)).unwrap();
    assert!(read("a.ply") == read("c.ply") && read("b.ply") == read("c.ply"));
}
