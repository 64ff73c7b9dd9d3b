//! Devices, FIFOs, sockets, dangling links and folders in place of files, through the program. Each
//! is refused at once by a message that names the file, in every reader.

mod lists;
mod outputs;
mod release_tree;

use crate::command::{COPY, trained_by};
use crate::support::given::{GIVEN, ply, sound, transforms};
use crate::support::workspace::{RunOutcome, TINY, Workspace};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Time after which a child is considered hung: the runs here take seconds.
const PATIENCE: Duration = Duration::from_secs(240);

/// Address space of a child in KiB, so that an endless file ends the child and not the machine.
const MEMORY_KIB: u32 = 24 << 20;

/// Entries that no reader may treat as a file.
const KINDS: [&str; 6] = ["device", "FIFO", "socket", "dangling", "loop", "folder"];

/// Puts an entry of this kind at a path, replacing any other.
fn plant(kind: &str, path: &Path) {
    if path.is_dir() && !path.is_symlink() {
        fs::remove_dir_all(path).unwrap();
    } else if path.symlink_metadata().is_ok() {
        fs::remove_file(path).unwrap();
    }
    match kind {
        "device" => symlink("/dev/zero", path).unwrap(),
        "FIFO" => mknodat(CWD, path, FileType::Fifo, Mode::from_raw_mode(0o600), 0).unwrap(),
        // A listener would refuse the paths of a long temporary folder.
        "socket" => mknodat(CWD, path, FileType::Socket, Mode::from_raw_mode(0o600), 0).unwrap(),
        "dangling" => symlink("no such file", path).unwrap(),
        "loop" => symlink(path.file_name().unwrap(), path).unwrap(),
        "folder" => fs::create_dir(path).unwrap(),
        _ => unreachable!("{kind}"),
    }
}

/// Runs the program in `folder`. A hung program is killed, and fails the test.
fn run(folder: &Path, args: &str) -> RunOutcome {
    let outputs = tempfile::tempdir().unwrap();
    let file = |name: &str| File::create(outputs.path().join(name)).unwrap();
    let limited = format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &limited, env!("CARGO_BIN_EXE_gs2e")]).args(args.split_whitespace());
    command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
    command.current_dir(folder).stdin(std::process::Stdio::null()).stdout(file("out")).stderr(file("err"));
    let mut child = command.spawn().unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > PATIENCE {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("gs2e {args} hangs");
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let text =
        |name: &str| String::from_utf8_lossy(&fs::read(outputs.path().join(name)).unwrap()).into_owned();
    let code = status.code().unwrap_or_else(|| panic!("gs2e {args}: {status}: {}", text("err")));
    RunOutcome { code, stdout: text("out"), stderr: text("err") }
}

/// Puts each kind of entry at `file`, one after the other, and runs the program, which must end
/// with one of these codes and name the file.
#[track_caller]
fn refused(place: &Workspace, args: &str, file: &str, kinds: &[&str], codes: &[i32]) {
    fs::create_dir_all(place.path(file).parent().unwrap()).unwrap();
    for kind in kinds {
        let before = fs::read(place.path(file)).ok();
        plant(kind, &place.path(file));
        let RunOutcome { code, stdout, stderr } = run(&place.path(""), args);
        let message = format!("{stdout}{stderr}");
        let context = format!("{kind} at {file}, gs2e {args}: exit {code}\n{message}");
        assert!(codes.contains(&code), "{context}");
        let name = Path::new(file).file_name().unwrap().to_str().unwrap();
        assert!(message.contains(name), "{context}");
        assert!(!message.contains("panicked"), "{context}");
        plant("folder", &place.path(file));
        fs::remove_dir(place.path(file)).unwrap();
        if let Some(before) = before {
            fs::write(place.path(file), before).unwrap();
        }
    }
}

const FILES: &[&str] = &["device", "FIFO", "socket", "dangling", "loop"];

#[test]
fn special_files_next_to_recipes_are_errors_and_never_absent() {
    let place = Workspace::new();
    place.write("recipes/a.yaml", TINY);
    for (args, file) in [
        ("plan recipes", "recipes/takedown.txt"),
        ("plan recipes/a.yaml", "recipes/takedown.txt"),
        ("plan recipes/a.yaml", "recipes/defaults.yaml"),
        ("release --to out recipes/a.yaml", "recipes/takedown.txt"),
        ("release --to out recipes/a.yaml", "recipes/release.yaml"),
        ("release --to out recipes/a.yaml", "recipes/sources.yaml"),
    ] {
        refused(&place, args, file, &KINDS, &[2]);
    }
    refused(&place, "plan recipes", "recipes/defaults.yaml", FILES, &[2]);
    refused(&place, "plan recipes", "recipes/b.yaml", FILES, &[2]);
    refused(&place, "plan b.yaml", "b.yaml", FILES, &[2]);
    assert!(!place.path("out").exists() && !place.path(".gs2e").exists(), "nothing ran");
}

#[test]
fn sources_are_regular_files() {
    let place = sound();
    for file in ["transforms.json", "scene.ply"] {
        refused(&place, "plan recipe.yaml", file, &KINDS, &[1, 2]);
        refused(&place, "build recipe.yaml", file, &["FIFO", "device"], &[1, 2]);
    }
    place.write("images/000.png", "not read by a plan");
    refused(&place, "plan recipe.yaml", "images/000.png", FILES, &[1, 2]);
    for form in ["splat", "spz", "sog"] {
        place.write("recipe.yaml", GIVEN.replace("scene.ply", &format!("scene.{form}")));
        refused(&place, "plan recipe.yaml", &format!("scene.{form}"), &["FIFO", "device"], &[1, 2]);
    }
}

#[test]
fn files_of_a_colmap_model_are_regular_files() {
    let place = trained_by(COPY);
    let args = "build --allow-commands recipe.yaml";
    for file in fs::read_dir(place.path("capture/sparse/0")).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        refused(&place, args, &format!("capture/sparse/0/{name}"), &KINDS, &[1, 2]);
    }
    refused(&place, args, "capture/images/photo 8.png", FILES, &[1, 2]);
    refused(&place, args, "capture/images/another.png", FILES, &[1, 2]);
    refused(&place, args, "planted.ply", &KINDS, &[1, 2]);
}

#[test]
fn the_scene_of_a_trainer_is_a_regular_file() {
    for leaves in
        ["mkfifo \"$2/scene.ply\"", "ln -s /dev/zero \"$2/scene.ply\"", "ln -s gone \"$2/scene.ply\""]
    {
        let place = trained_by(leaves);
        let ended = run(&place.path(""), "build --allow-commands recipe.yaml");
        assert_eq!(ended.code, 1, "{leaves}: {}", ended.stderr);
        assert!(ended.stderr.contains("scene.ply"), "{leaves}: {}", ended.stderr);
    }
}

#[test]
fn inputs_of_single_step_verbs_are_regular_files() {
    let place = sound();
    for name in ["e.csv", "e.txt", "e.h5", "e.npz", "e.raw", "e.aedat4"] {
        refused(&place, &format!("convert --size 8x8 {name} new.npz"), name, &KINDS, &[1, 2]);
    }
    for name in ["s.ply", "s.splat", "s.spz", "s.sog"] {
        refused(&place, &format!("convert {name} new.ply"), name, FILES, &[1, 2]);
    }
    let render = "render --scene scene.ply --view transforms.json --out new.png";
    refused(&place, render, "scene.ply", &KINDS, &[1, 2]);
    refused(&place, render, "transforms.json", FILES, &[1, 2]);
    let trajectory = "trajectory --capture transforms.json --recipe recipe.yaml --name base --out new.txt";
    for name in ["transforms.json", "recipe.yaml"] {
        refused(&place, trajectory, name, FILES, &[1, 2]);
    }
    let simulate = "simulate --frames frames --fps 30 --sensor dvs346 --out new.h5";
    for name in ["frames/a.png", "frames/info.txt"] {
        place.write("frames/b.png", "never reached");
        refused(&place, simulate, name, FILES, &[1, 2]);
    }
    refused(&place, "simulate --frames f.npy --fps 30 --sensor dvs346 --out new.h5", "f.npy", FILES, &[1, 2]);
    refused(
        &place,
        "simulate --frames frames --fps 30 --sensor s.yaml --out new.h5",
        "s.yaml",
        &KINDS,
        &[1, 2],
    );
    refused(&place, "init nerfstudio . --to drafts", "drafts/defaults.yaml", &["FIFO", "dangling"], &[2]);
}

#[test]
fn a_blob_that_is_no_longer_a_file_is_made_again() {
    for kind in KINDS {
        let place = Workspace::with_tiny();
        place.ok("build tiny.yaml");
        let plan: serde_json::Value =
            serde_json::from_str(&place.ok("plan --json tiny.yaml").stdout).unwrap();
        let step = plan.as_array().unwrap().iter().find(|step| step["step"] == "reconstruct").unwrap();
        let blob = place.path(step["outputs"][0]["path"].as_str().unwrap());
        plant(kind, &blob);
        let ended = run(&place.path(""), "build tiny.yaml");
        assert_eq!(ended.code, 0, "{kind}: {}", ended.stderr);
        assert!(blob.symlink_metadata().unwrap().is_file(), "{kind}");
        if kind == "FIFO" {
            place.ok("release --to out tiny.yaml");
        }
    }
}

/// A walk ends: it follows no link out of the folder, and a path to the root of the machine is
/// refused.
#[test]
fn a_walk_of_recipes_and_sources_stays_within_its_folder() {
    let place = sound();
    place.write("recipes/a.yaml", TINY);
    for target in ["/", "/proc", ".."] {
        let link = place.path("recipes/p.yaml");
        symlink(target, &link).unwrap();
        let ended = run(&place.path(""), "plan recipes");
        assert_eq!(ended.code, 2, "{target}: {}", ended.stderr);
        assert!(ended.stderr.contains("recipes/p.yaml"), "{target}: {}", ended.stderr);
        assert!(ended.stderr.contains("a link lead"), "{target}: {}", ended.stderr);
        fs::remove_file(link).unwrap();
    }
    place.write("recipe.yaml", GIVEN.replace("nerfstudio: { path: transforms.json }", "colmap: { path: / }"));
    let ended = run(&place.path(""), "plan recipe.yaml");
    assert!([1, 2].contains(&ended.code), "{}", ended.stderr);
}

#[test]
fn names_of_photos_hold_no_control_characters() {
    for name in ["a\\u0000b.png", "a\\nerror: fake.png", "a\\u001b[31m.png"] {
        let place = sound();
        place.write("scene.ply", ply(|_, value| value));
        place.write("transforms.json", transforms(1.0).replacen("images/000.png", name, 1));
        let ended = run(&place.path(""), "build recipe.yaml");
        assert_eq!(ended.code, 1, "{name}: {}", ended.stderr);
        assert!(ended.stderr.contains("control character"), "{name}: {}", ended.stderr);
    }
}
