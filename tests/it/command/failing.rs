//! Programs that fail, that have the wrong version, or whose output is no scene.

use super::{COPY, edit, runs, trained_by, with_tiny, write_script};
use crate::fidelity::photographed;
use crate::messages::check;
use crate::support::given::ply;
use crate::support::workspace::{RunOutcome, Workspace};
use rustix::process::{Pid, Signal, kill_process};
use std::fs;
use std::io::Read as _;

/// The log of the only step that ran a program.
fn log(place: &Workspace) -> String {
    let logs: Vec<_> = fs::read_dir(place.path(".gs2e/logs")).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(logs.len(), 1, "{logs:?}");
    fs::read_to_string(&logs[0]).unwrap()
}

/// Builds with `--allow-commands`, which must fail at the training and record nothing.
fn fails(place: &Workspace) -> RunOutcome {
    let ended = place.gs2e("build -j 1 --allow-commands --json recipe.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let reconstruct = ("trained/reconstruct".to_owned(), "run".to_owned());
    assert!(place.plan("recipe.yaml").contains(&reconstruct), "nothing is recorded");
    let left = fs::read_dir(place.path(".gs2e/gs2e-tmp")).unwrap().count();
    assert_eq!(left, 0, "nothing is left of its folder");
    ended
}

#[test]
fn a_failed_program_is_reported_with_its_last_output() {
    let place = trained_by("seq 100; echo 'out of memory' >&2; exit 7");
    check(&place, "command-failed", &fails(&place));
    let log = log(&place);
    assert!(log.contains("\n1\n2\n") && log.ends_with("100\nout of memory\n"), "{log}");
    write_script(&place, "kill -9 $$");
    let ended = fails(&place);
    assert!(ended.stderr.contains("sh failed: signal 9 ended it"), "{}", ended.stderr);
    with_tiny(&place);
    let ended = place.gs2e("build -k --allow-commands recipe.yaml tiny.yaml");
    assert_eq!(ended.code, 1);
    assert_eq!(place.stale("tiny.yaml"), [""; 0], "the other scene is built");
    write_script(&place, COPY);
    place.ok("build --allow-commands recipe.yaml");
}

#[test]
fn a_program_of_another_version_does_not_train() {
    let place = trained_by(COPY);
    edit(&place, "version: \"1.2\"", "version: \"1.20\"");
    let ended = fails(&place);
    let wanted = "trained/reconstruct: sh failed: it does not report version 1.20";
    assert!(
        ended.stderr.contains(wanted) && ended.stderr.contains("trainer 1.2, as 1.3"),
        "{}",
        ended.stderr
    );
    assert_eq!(runs(&place), 0);
}

#[test]
fn a_missing_program_is_reported() {
    let place = trained_by(COPY);
    edit(&place, "program: sh", "program: no-such-trainer");
    let ended = fails(&place);
    assert!(ended.stderr.contains("no-such-trainer failed: it cannot be started: "), "{}", ended.stderr);
    fs::remove_file(place.path("train.sh")).unwrap();
    let ended = place.gs2e("build --allow-commands recipe.yaml");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("train.sh, named at recipe.yaml:6:3"), "{}", ended.stderr);
}

#[test]
fn an_invalid_scene_does_not_enter_the_store() {
    let t = |script: &str, planted: Vec<u8>, wanted: &str| {
        let place = trained_by(script);
        place.write("planted.ply", planted);
        let ended = fails(&place);
        assert!(ended.stderr.contains(wanted), "{script}: {}", ended.stderr);
        assert!(ended.stderr.contains("the file above has its full output"), "{}", ended.stderr);
    };
    let sound = || ply(|_, value| value);
    t(":", sound(), "it wrote no scene: scene.ply does not exist");
    t(": > \"$2/scene.ply\"", sound(), "its output is not a scene: ");
    t(COPY, b"no scene".to_vec(), "its output is not a scene: ");
    t(COPY, sound()[..500].to_vec(), "its output is not a scene: ");
    let all = ply(|column, value| if column == 0 { f32::NAN } else { value });
    t(COPY, all, "find a Gaussian to render: of 40 in the scene, 40 hold a NaN");
    // One of forty, which is more than a sound training has.
    let mut one = sound();
    let at = one.len() - 4;
    one[at..].copy_from_slice(&f32::INFINITY.to_le_bytes());
    t(COPY, one, "1 of 40 Gaussians hold a NaN or an infinity");
}

#[test]
fn too_few_and_too_many_gaussians_are_refused() {
    for (limits, wanted) in
        [("min: 41", "wanted at least 41"), ("min: 2, max: 39", "at least 2 and at most 39")]
    {
        let place = trained_by(COPY);
        edit(&place, "scene: scene.ply\n", &format!("scene: scene.ply\n    gaussians: {{ {limits} }}\n"));
        let ended = fails(&place);
        assert!(
            ended.stderr.contains("it made 40 Gaussians") && ended.stderr.contains(wanted),
            "{}",
            ended.stderr
        );
    }
}

#[test]
fn logs_are_deleted_with_their_products() {
    let place = trained_by(COPY);
    let logs = || fs::read_dir(place.path(".gs2e/logs")).unwrap().count();
    for (version, wanted) in [("1.2", 1), ("1.3", 2)] {
        edit(&place, "version: \"1.2\"", &format!("version: \"{version}\""));
        place.ok("build -q --allow-commands recipe.yaml");
        assert_eq!(logs(), wanted);
    }
    place.ok("gc -q recipe.yaml");
    assert_eq!(logs(), 2, "they are young");
    place.ok("gc -q --min-age 0 recipe.yaml");
    assert_eq!(logs(), 1, "that of the recipe stays");
}

/// The trainer and its child processes hold a pipe open; the test reads until all of them have
/// ended.
#[test]
fn an_interrupt_stops_the_program_and_its_children() {
    let place = trained_by("exec 9> \"$beside/held\"; sleep 600 & echo begun; : > \"$beside/at work\"; wait");
    let pipe = place.path("held");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| fs::read(&pipe).unwrap());
        let mut child = place.spawn("build -j 1 --allow-commands recipe.yaml");
        while !place.path("at work").exists() {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it was interrupted");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        kill_process(Pid::from_child(&child), Signal::INT).unwrap();
        reader.join().unwrap();
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{said}");
        assert!(said.contains("interrupted: "), "{said}");
    });
    assert!(log(&place).ends_with("begun\n"));
    assert_eq!(fs::read_dir(place.path(".gs2e/gs2e-tmp")).unwrap().count(), 0);
    write_script(&place, COPY);
    place.ok("build --allow-commands recipe.yaml");
}

#[test]
fn a_scene_that_contradicts_its_photos_does_not_enter_the_store() {
    let place = photographed(|_, v| v);
    let command = "reconstruct:\n  command:\n    program: sh\n    arguments: [\"{train}\", \"{capture}\", \"{out}\", \
                   \"{planted}\"]\n    version: \"1.2\"\n    licence: MIT\n    min_psnr: 40\n    scene: scene.ply\n    \
                   files: { train: train.sh, planted: planted.ply }\n";
    edit(&place, "reconstruct: { given: { path: scene.ply } }\n", command);
    write_script(&place, COPY);
    // The planted scene is shifted by a few pixels.
    place.write("planted.ply", ply(|column, value| if column == 0 { value + 0.3 } else { value }));
    let ended = place.gs2e("build -j 1 --allow-commands recipe.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    // Of six views the first is held out.
    for message in [
        "given/reconstruct: failed to compare the trained scene with its photos",
        "its mean PSNR over 1 views is ",
        "dB, wanted at least 40; configure the trainer not to move",
    ] {
        assert!(ended.stderr.contains(message), "{}", ended.stderr);
    }
    assert!(place.plan("recipe.yaml").contains(&("given/reconstruct".to_owned(), "run".to_owned())));
    place.write("planted.ply", ply(|_, value| value));
    place.ok("build --allow-commands recipe.yaml");
    // A stored scene is judged by a check, so that another limit does not start a training.
    edit(&place, "min_psnr: 40", "min_psnr: 100");
    assert_eq!(place.stale("recipe.yaml"), [""; 0]);
}
