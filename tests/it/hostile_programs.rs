//! Programs and modules in folders from which they must not run, and trainers that outlive their
//! builds.

mod leftovers;

use crate::support::absent::absent;
use crate::support::given;
use crate::support::steps::recipe;
use crate::support::workspace::Workspace;
use gs2e_store::{Store, StoreAccess};
use serde_json::json;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// Programs that this program, Python or a shell could look for.
const PROGRAMS: [&str; 24] = [
    "colmap",
    "python3",
    "python",
    "python3.exe",
    "pyenv",
    "git",
    "nvidia-smi",
    "vulkaninfo",
    "ffmpeg",
    "sh",
    "bash",
    "env",
    "uname",
    "hostname",
    "cp",
    "ls",
    "b3sum",
    "sha256sum",
    "ninja",
    "gs2e",
    "supervise-program",
    "unzip",
    "dirname",
    "setsid",
];
/// Modules that Python or the packages import.
const MODULES: [&str; 18] = [
    "json",
    "numpy",
    "h5py",
    "cv2",
    "sitecustomize",
    "usercustomize",
    "importlib",
    "os",
    "sys",
    "hashlib",
    "encodings",
    "site",
    "re",
    "typing",
    "collections",
    "ask",
    "_bootlocale",
    "__main__",
];

/// Puts traps into a folder. Each leaves a file in the folder `sprung` when it is run or imported.
fn plant(place: &Workspace, folder: &str) {
    let sprung = place.path("sprung");
    fs::create_dir_all(&sprung).unwrap();
    let mark = |name: &str| sprung.join(format!("{} {name}", folder.replace('/', "-")));
    for name in PROGRAMS {
        // `#!/bin/sh` names its interpreter; the rest of the script needs no look-up.
        executable(place, &format!("{folder}/{name}"), &format!(": > '{}'", mark(name).display()));
    }
    for name in MODULES {
        let code = format!("open({:?}, 'w').close()\n", mark(&format!("{name}.py")).to_str().unwrap());
        place.write(&format!("{folder}/{name}.py"), code);
    }
    place.write(&format!("{folder}/pyvenv.cfg"), "home = .\ninclude-system-site-packages = false\n");
    place.write(&format!("{folder}/.python-version"), "../../../../../..\n");
    place.write(&format!("{folder}/trap.pth"), "import sitecustomize\n");
}

fn executable(place: &Workspace, name: &str, script: &str) {
    place.write(name, format!("#!/bin/sh\n{script}\n"));
    fs::set_permissions(place.path(name), Permissions::from_mode(0o755)).unwrap();
}

/// The traps that were sprung.
fn sprung(place: &Workspace) -> Vec<String> {
    let entries = fs::read_dir(place.path("sprung")).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A scene in files, with checks by all external programs.
fn asking() -> Workspace {
    let place = Workspace::new();
    let mut asks = recipe("asks");
    asks["source"] = json!({ "nerfstudio": { "path": "../capture/transforms.json" } });
    asks["reconstruct"] = json!({ "given": { "path": "../capture/scene.ply" } });
    asks["outputs"] = json!(["events", "sharp"]);
    asks["checks"] = json!({ "pose_colmap": {}, "pose_opencv": {}, "readback": {} });
    place.write("recipes/asks.yaml", asks.to_string());
    place.write("capture/scene.ply", given::ply(|_, value| value));
    place.write("capture/transforms.json", given::transforms(1.0));
    place.write(
        "view.json",
        r#"{"W":8,"H":8,"fx":8,"fy":8,"cx":4,"cy":4,"R":[[1,0,0],[0,1,0],[0,0,1]],"t":[0,0,4]}"#,
    );
    place
}

/// Makes the store, which takes no folder with other content.
fn make_store(place: &Workspace) {
    drop(Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap());
}

/// The traps work. Otherwise a test without sprung traps would prove nothing.
#[test]
fn the_traps_can_be_sprung() {
    let place = Workspace::new();
    plant(&place, "x");
    assert!(Command::new(place.path("x/colmap")).status().unwrap().success());
    assert_eq!(sprung(&place), ["x colmap"]);
    let python = Command::new("python3").args(["-c", "import numpy"]).current_dir(place.path("x")).output();
    if python.is_err() {
        return absent("REQUIRE_READERS", "python3 is absent");
    }
    assert!(sprung(&place).iter().any(|name| name.ends_with(".py")), "{:?}", sprung(&place));
}

#[test]
fn no_verb_runs_programs_of_its_folders() {
    let place = asking();
    let path = std::env::var("PATH").unwrap_or_default();
    let path = format!(":.:recipes:../x:./capture::{path}:");
    let run = |arguments: &str| {
        let mut command = place.command(arguments);
        command.env("PATH", &path).env("PYTHONPATH", ".:recipes").env("PYTHONSTARTUP", "json.py");
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(matches!(output.status.code(), Some(0 | 3)), "gs2e {arguments}: {:?}\n{said}", output.status);
        assert_eq!(sprung(&place), [""; 0], "gs2e {arguments}");
    };
    make_store(&place);
    for folder in [".", "recipes", "capture", ".gs2e", ".gs2e/logs", "x"] {
        plant(&place, folder);
    }
    run("plan recipes");
    run("why asks --recipes recipes");
    run("build recipes");
    run("plan --estimate recipes");
    run("why asks/base/foreign --recipes recipes");
    run("check --recipes recipes");
    run("release --to out recipes");
    plant(&place, "out");
    plant(&place, "out/asks/base");
    for arguments in [
        "audit out",
        "check --tree out",
        "diff out out",
        "gc --min-age 0 recipes",
        "gc --dry-run recipes",
        "build --recheck 100% recipes",
        "release --replace --to out recipes",
        "audit out --rebuild 1 --recipes recipes",
        "render --scene capture/scene.ply --view view.json --out picture.png",
        "trajectory --capture capture/transforms.json --recipe recipes/asks.yaml --name base --out poses.txt",
        "simulate --frames out/asks/base/sharp --fps 1000 --sensor dvs346 --out events.h5",
        "convert events.h5 events.npz --lossy",
        "convert capture/scene.ply scene.splat --lossy",
        "stress counted",
        "study thresholds recipes/asks.yaml --span 0,5 --thresholds 1",
        "--version",
    ] {
        run(arguments);
    }
}

/// A scene with checks by Python alone, and a fake Python without packages in a folder that is the
/// whole PATH: it is only asked for its version.
fn with_python() -> Workspace {
    let place = asking();
    let mut value: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path("recipes/asks.yaml")).unwrap()).unwrap();
    value["outputs"] = json!(["events"]);
    value["checks"] = json!({ "pose_opencv": {}, "readback": {} });
    place.write("recipes/asks.yaml", value.to_string());
    let list = r#"{"numpy": null, "cv2": null, "h5py": null, "folders": []}"#;
    executable(&place, "bin/python3", &format!("echo asked >> ${{0%/*}}/asked; echo '{list}'"));
    place
}

/// Runs the program with this Python, and returns the number of times that Python was asked.
fn asked(place: &Workspace, arguments: &str) -> usize {
    fs::write(place.path("bin/asked"), "").unwrap();
    let output = place.command(arguments).env("PATH", place.path("bin")).output().unwrap();
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    fs::read_to_string(place.path("bin/asked")).unwrap().lines().count()
}

#[test]
fn verbs_that_run_nothing_ask_no_program_for_its_version() {
    let place = with_python();
    for look in ["plan recipes", "plan --json --estimate recipes", "why asks --recipes recipes"] {
        assert_eq!(asked(&place, look), 0, "{look}");
    }
    assert!(!place.path(".gs2e").exists());
    assert_eq!(asked(&place, "build recipes"), 1);
    for look in
        ["plan recipes", "why asks --recipes recipes", "check --recipes recipes", "gc --dry-run recipes"]
    {
        // A program as young as this one may change unseen. Its answer is not remembered, and these
        // verbs do not ask it again.
        let output = place.command(look).env("PATH", place.path("bin")).output().unwrap();
        assert_ne!(output.status.code(), None, "{look}");
        assert_eq!(fs::read_to_string(place.path("bin/asked")).unwrap().lines().count(), 1, "{look}");
    }
}

#[test]
fn a_version_is_remembered_until_the_program_moves() {
    let place = with_python();
    // Timestamps of files are coarse: a file younger than two seconds may still change without a
    // new timestamp.
    std::thread::sleep(std::time::Duration::from_millis(2100));
    let plan = || {
        let output = place.command("plan --json recipes").env("PATH", place.path("bin")).output().unwrap();
        let steps: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
        let step = steps.into_iter().find(|step| step["step"] == "base/foreign").unwrap();
        (step["action"].as_str().unwrap().to_owned(), step["reason"]["code"].as_str().unwrap().to_owned())
    };
    asked(&place, "build recipes");
    let known = ("keep".to_owned(), "up-to-date".to_owned());
    assert_eq!(plan(), known);
    assert_eq!(asked(&place, "check --recipes recipes"), 0);
    executable(&place, "bin/python3", "echo 'no list'");
    assert_eq!(plan(), ("may-run".to_owned(), "not-asked".to_owned()));
    // A missing program is detected without a run.
    fs::remove_file(place.path("bin/python3")).unwrap();
    assert_eq!(plan(), ("run".to_owned(), "class".to_owned()));
}

#[test]
fn more_jobs_than_cores_are_not_taken() {
    let place = Workspace::with_tiny();
    let ended = place.ok("build -j 65535 tiny.yaml");
    let notes: Vec<&str> = ended.stderr.lines().filter(|line| line.contains("-j 65535")).collect();
    assert_eq!(notes.len(), 1, "{}", ended.stderr);
    assert!(!place.ok("plan -j 1 tiny.yaml").stderr.contains("-j 1"));
}

/// Kills builds of new stores while they start. They leave a sound store or none, so nothing must
/// be repaired.
#[test]
fn a_build_that_is_killed_as_it_starts_leaves_no_broken_index() {
    for wait in 0..24 {
        let place = Workspace::with_tiny();
        let mut child = place.spawn("build -j 1 tiny.yaml");
        std::thread::sleep(std::time::Duration::from_millis(wait));
        child.kill().unwrap();
        child.wait().unwrap();
        for arguments in ["plan tiny.yaml", "gc tiny.yaml"] {
            let said = place.ok(arguments).stderr;
            assert!(!said.contains("state.db"), "after {wait} ms: {said}");
        }
    }
}

/// An index under construction has another name, so a killed process leaves no half index.
#[test]
fn half_an_index_is_no_index() {
    let place = Workspace::with_tiny();
    make_store(&place);
    // As if the process had been killed before its index had a name.
    fs::remove_file(place.path(".gs2e/state.db")).unwrap();
    for suffix in ["", "-wal", "-shm"] {
        place.write(&format!(".gs2e/state.db.new{suffix}"), "half");
    }
    let said = place.ok("build tiny.yaml").stderr;
    assert!(!said.contains("state.db"), "{said}");
    assert!(!place.path(".gs2e/state.db.new").exists());
    assert_eq!(place.stale("tiny.yaml"), [""; 0]);
}

#[test]
fn a_stream_without_events_is_reported() {
    let place = Workspace::new();
    let mut value = recipe("empty");
    value["source"]["procedural"]["arc"] = json!(6);
    value["sensor"] = json!({ "esim": { "threshold": { "on": 1000.0, "off": 1000.0 } } });
    value["outputs"] = json!(["events"]);
    place.write("recipe.yaml", value.to_string());
    place.ok("release --to out recipe.yaml");
    let found = place.ok("check --recipes recipe.yaml").stdout;
    let line =
        found.lines().find(|line| line.contains("empty/base#rate")).unwrap_or_else(|| panic!("{found}"));
    assert!(line.starts_with("warn") && line.contains("no events"), "{line}");
    let in_tree = place.ok("check --tree out").stdout;
    assert!(in_tree.lines().any(|line| line.starts_with("warn") && line.contains("no events")), "{in_tree}");
}

/// One event per eight microseconds on average. Three events of a pixel in one microsecond are no
/// fault of the stream.
#[test]
fn very_hot_pixels_are_accounted_for() {
    let place = Workspace::new();
    let mut value = recipe("hot");
    value["sensor"] = json!({ "esim": { "hot_pixels": { "share": 0.005, "rate": 1.2e5 } } });
    value["outputs"] = json!(["events"]);
    place.write("recipe.yaml", value.to_string());
    place.ok("build recipe.yaml");
    let found = place.ok("check --recipes recipe.yaml").stdout;
    for part in ["hot/base#share", "hot/base#account"] {
        let line = found.lines().find(|line| line.contains(part)).unwrap_or_else(|| panic!("{found}"));
        assert!(line.starts_with("pass"), "{line}");
    }
}

#[test]
fn a_file_that_is_no_program_is_reported() {
    let place = crate::command::trained_by(":");
    crate::command::edit(&place, "program: sh", "program: \"{train}\"");
    fs::set_permissions(place.path("train.sh"), Permissions::from_mode(0o644)).unwrap();
    let ended = place.gs2e("build -j 1 --allow-commands recipe.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("train.sh failed: it cannot be started: "), "{}", ended.stderr);
    assert!(ended.stderr.contains("ermission denied"), "{}", ended.stderr);
}

/// A trainer's own programs are not looked for in its folder either.
#[test]
fn programs_of_a_trainer_are_looked_for_in_absolute_folders() {
    let place = crate::command::trained_by(&format!("echo \"path $PATH\"; pwd; {}", crate::command::COPY));
    let path = std::env::var("PATH").unwrap_or_default();
    let mut command = place.command("build -q --allow-commands recipe.yaml");
    let ended = command.env("PATH", format!(".::x:{path}")).stdout(Stdio::null()).output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let log = fs::read_dir(place.path(".gs2e/logs")).unwrap().next().unwrap().unwrap().path();
    let log = fs::read_to_string(log).unwrap();
    let message = log.lines().find_map(|line| line.strip_prefix("path ")).unwrap();
    assert!(message.split(':').all(|folder| Path::new(folder).is_absolute()), "{message}");
}
