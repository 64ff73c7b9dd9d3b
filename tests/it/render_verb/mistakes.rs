//! Every mistake ends with its exit code and its message, and leaves all files unchanged.

use super::{RIGHT, camera, ply_bytes, transforms, workspace};
use crate::support::workspace::{RunOutcome, Workspace, tree};
use gs2e_scene::blobs::blob_scene;
use serde_json::{Value, json};

/// The correct workspace, with faulty files of every kind added.
fn wrong() -> Workspace {
    let place = workspace();
    let whole = std::fs::read(place.path("one.ply")).unwrap();
    let spoilt = |key: &str, value: Value| {
        let mut camera = camera();
        camera[key] = value;
        camera.to_string()
    };
    place.write("new.npy", "as it was");
    place.write("cut.ply", &whole[..whole.len() - 3]);
    place.write("none.ply", ply_bytes(&blob_scene(&[])));
    place.write("text.ply", "no scene");
    place.write("empty/a.txt", "");
    place.write("both/transforms.json", "{}");
    place.write("both/cameras.json", "[]");
    place.write("broken.json", "{ \"W\": [");
    place.write("number.json", "7");
    place.write("bytes.json", b"\xff\xfe");
    place.write("part.json", "{ \"W\": 5 }");
    place.write("mirror.json", spoilt("R", json!([[1, 0, 0], [0, 1, 0], [0, 0, -1]])));
    place.write("sheared.json", spoilt("R", json!([[1, 0, 0], [0.1, 1, 0], [0, 0, 1]])));
    place.write("flat.json", spoilt("fx", json!(0)));
    // A turn of 120 degrees about the diagonal, along which the camera's centre is out of range.
    let turned = spoilt("R", json!([[0, 0, 1], [1, 0, 0], [0, 1, 0]]));
    assert!(turned.contains("[1,2,3]"));
    place.write("endless.json", turned.replace("[1,2,3]", "[1.7e308,1.7e308,1.7e308]"));
    place.write("infinite.json", camera().to_string().replace("50.5", "1e999"));
    place.write("huge.json", spoilt("W", json!(60_000)).replace("\"H\":81", "\"H\":60000"));
    place.write("wide.json", spoilt("W", json!(70_000)));
    place.write("nameless.json", transforms().to_string().replace("view 9.jpg", ""));
    place
}

/// Runs [`RIGHT`] with a change. Checks its exit code and parts of its message, and that no file is
/// changed.
fn check() -> impl Fn([&str; 2], i32, &[&str]) {
    let place = wrong();
    let before = tree(&place.path(""));
    move |change, code, parts| {
        assert!(RIGHT.contains(change[0]), "{}", change[0]);
        let args = RIGHT.replace(change[0], change[1]);
        let ended = place.gs2e(&args);
        assert_eq!((ended.code, ended.stdout.as_str()), (code, ""), "gs2e {args}\n{}", ended.stderr);
        assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
        for part in parts {
            assert!(ended.stderr.contains(part), "gs2e {args}: `{part}` is not in\n{}", ended.stderr);
        }
        assert!(tree(&place.path("")) == before, "gs2e {args}: files were changed");
    }
}

#[test]
fn a_command_line_that_is_wrong_renders_nothing() {
    let t = check();
    let more = |options: &str, parts: &[&str]| t(["render", &format!("render {options}")], 2, parts);
    let background = "--background 0.2,0.4,0.75";
    t(["--out new.npy", ""], 2, &["--out"]);
    t(["--scene one.ply", ""], 2, &["--scene"]);
    t(["--view camera.json", ""], 2, &["--view"]);
    t([background, "--background 1,2"], 2, &["--background", "2 numbers, wanted 3"]);
    t([background, "--background 255,0,0"], 2, &["255 is not between 0 and 1"]);
    t([background, "--background -1,0,0"], 2, &["-1 is not between 0 and 1"]);
    t([background, "--background red"], 2, &["`red` is not a finite number"]);
    more("--rules fancy", &["fancy", "official", "exact", "gsplat", "soft"]);
    more("--channel red", &["red", "luminance-rate"]);
    more("--index -1", &["'-1'"]);
    more("--velocity 1,2,3", &["3 numbers, wanted 6"]);
    more("--velocity 1,2,3,4,5,inf", &["`inf` is not a finite number"]);
    more(
        "--channel flow",
        &["flow needs the velocity of the camera", "help: pass --velocity vx,vy,vz,wx,wy,wz"],
    );
    more(
        "--channel luminance-rate",
        &["luminance-rate needs the velocity of the camera", "help: pass --velocity"],
    );
    t(["render", "render --backend gpu"], 2, &["error: no GPU is available: ", "help: use --backend cpu"]);
}

#[test]
fn an_unwritable_output_is_reported() {
    let t = check();
    for channel in ["depth", "flow", "luminance-rate"] {
        let out = format!("new.png --channel {channel} --velocity 0,0,0,0,0,0");
        t(["new.npy", &out], 2, &["new.png has 8 bits", channel, "help: write it to a .npy"]);
    }
    t(["new.npy", "new.tif"], 2, &["new.tif is neither .npy nor .png", "help: pass --out with a .npy"]);
    t(["new.npy", "new"], 2, &["new is neither .npy nor .png"]);
    t(["--out new.npy", "--out empty"], 2, &["empty is a folder, wanted a file"]);
    t(["new.npy", "no/new.npy"], 2, &["no/new.npy is in a folder that does not exist"]);
    t(["--out new.npy", "--out ./one.ply"], 2, &["./one.ply is an input and would be overwritten"]);
    t(["--out new.npy", "--out capture/../camera.json"], 2, &["is an input and would be overwritten"]);
}

#[test]
fn absent_and_damaged_scenes_and_views_are_reported() {
    let t = check();
    t(["one.ply", "gone.ply"], 2, &["scene: gone.ply does not exist"]);
    t(["one.ply", "cut.ply"], 1, &["failed to read the scene", "cut.ply", "at byte"]);
    t(["one.ply", "none.ply"], 1, &["failed to read the scene", "none.ply"]);
    t(["one.ply", "text.ply"], 1, &["failed to read the scene", "text.ply", "at byte 0"]);
    t(["one.ply", "empty"], 1, &["failed to read the scene", "empty"]);
    t(["camera.json", "gone.json"], 2, &["view: gone.json does not exist"]);
    t(["camera.json", "empty"], 2, &["cannot determine the layout of the view", "found no capture"]);
    t(
        ["camera.json", "both"],
        2,
        &["cannot determine the layout of the view", "a transforms.json and a cameras.json"],
    );
    t(
        ["camera.json", "capture --index 2"],
        2,
        &["capture has 2 views, but none with index 2", "from 0 to 1"],
    );
    t(["camera.json", "camera.json --index 1"], 2, &["camera.json has 1 view, but none with index 1"]);
    let view = "failed to read the view";
    t(["camera.json", "broken.json"], 1, &[view, "broken.json: line 1"]);
    t(["camera.json", "bytes.json"], 1, &[view, "bytes.json", "UTF-8"]);
    t(["camera.json", "one.ply"], 1, &[view, "one.ply"]);
    t(["camera.json", "number.json"], 1, &[view, "`W`: it is missing"]);
    t(["camera.json", "part.json"], 1, &[view, "part.json: `H`: it is missing"]);
    t(["camera.json", "mirror.json"], 1, &[view, "`R`: a rotation contains a reflection"]);
    t(["camera.json", "sheared.json"], 1, &[view, "`R`: a rotation is not orthonormal"]);
    t(["camera.json", "flat.json"], 1, &[view, "the focal length is 0"]);
    t(["camera.json", "infinite.json"], 1, &[view, "infinite.json: line 1", "out of range"]);
    t(["camera.json", "nameless.json"], 1, &[view, "`frames[1].file_path`"]);
    t(["camera.json", "endless.json"], 1, &["failed to render", "is not finite"]);
    t(["camera.json", "huge.json"], 1, &[view, "60000x60000, wanted at most 268435456 pixels"]);
    t(["camera.json", "wide.json"], 1, &["failed to render", "70000x81, wanted 1 to 65535 px"]);
}

#[test]
fn a_picture_is_not_written_to_a_device() {
    let place = workspace();
    std::os::unix::fs::symlink("/dev/full", place.path("full.npy")).unwrap();
    let before = tree(&place.path("")).into_keys().collect::<Vec<_>>();
    let ended = place.gs2e(&RIGHT.replace("new.npy", "full.npy"));
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    let found = "full.npy cannot be replaced: a device, not a regular file";
    assert!(ended.stderr.contains(found), "{}", ended.stderr);
    assert_eq!(tree(&place.path("")).into_keys().collect::<Vec<_>>(), before);
}

#[test]
fn mistakes_are_objects_for_programs() {
    let place = wrong();
    let t = |change: [&str; 2], code: &str| {
        let ended: RunOutcome = place.gs2e(&format!("{} --json", RIGHT.replace(change[0], change[1])));
        let seen: Value = serde_json::from_str(&ended.stdout).unwrap();
        let found = (seen["level"].as_str(), seen["code"].as_str());
        assert_eq!(found, (Some("error"), Some(code)), "{}", ended.stderr);
    };
    t(["one.ply", "gone.ply"], "input-missing");
    t(["one.ply", "cut.ply"], "input-unreadable");
    t(["camera.json", "camera.json --index 1"], "no-view");
    t(["camera.json", "wide.json"], "step-failed");
    t(["new.npy", "-"], "output-unwritable");
    t(["new.npy", "new.tif"], "output-format");
    t(["new.npy", "new.npy --channel flow"], "velocity-missing");
    t(["new.npy", "new.npy --backend gpu"], "no-adapter");
    t(["new.npy", "new.npy --backend cpu --gpu 0"], "no-adapter");
}

/// A product of another back end is not used, and the plan says so.
#[test]
fn back_ends_share_no_key() {
    let place = Workspace::with_tiny();
    place.ok("build --backend reference tiny.yaml");
    let plan = place.ok("plan tiny.yaml").stdout;
    assert!(plan.contains("numerical class reference/1 -> cpu/"), "{plan}");
    assert!(place.ok("plan --backend reference tiny.yaml").stdout.contains("up to date"), "{plan}");
}

#[test]
fn a_finished_file_replaces_another() {
    let place = workspace();
    place.write("new.npy", "as it was");
    place.ok(RIGHT);
    let whole = std::fs::read(place.path("new.npy")).unwrap();
    assert!(whole.starts_with(b"\x93NUMPY"));
    std::os::unix::fs::symlink("new.npy", place.path("link.npy")).unwrap();
    place.write("new.npy", "as it was");
    place.ok(&RIGHT.replace("new.npy", "link.npy"));
    assert!(place.path("link.npy").is_symlink(), "a link is followed");
    assert!(std::fs::read(place.path("new.npy")).unwrap() == whole);
    assert!(!tree(&place.path("")).keys().any(|name| name.contains(".part")));
}
