//! The GPU through the command line, with a GPU and without one.

use super::{RIGHT, npy, workspace};
use crate::support::gpu;
use crate::support::workspace::{RunOutcome, Workspace};
use gs2e_event::{EventSource as _, h5};
use serde_json::Value;
use std::fs;

/// Runs with the machine's GPUs.
fn with_gpu(place: &Workspace, args: &str) -> RunOutcome {
    let output = place.command_with_gpu(&format!("{RIGHT} {args}")).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let code = output.status.code().unwrap();
    RunOutcome { code, stdout: text(output.stdout), stderr: text(output.stderr) }
}

#[test]
fn without_a_gpu_auto_renders_on_the_cpu_and_says_so_in_one_line() {
    let place = workspace();
    place.ok(&format!("{RIGHT} --backend cpu"));
    let by_cpu = fs::read(place.path("new.npy")).unwrap();
    fs::remove_file(place.path("new.npy")).unwrap();
    for args in ["", "--backend auto", "--gpu 0"] {
        let message = place.ok(&format!("{RIGHT} {args}")).stderr;
        let fallen: Vec<&str> =
            message.lines().filter(|line| line.starts_with("rendering on the CPU, because ")).collect();
        assert!(fallen.len() == 1 && fallen[0].contains("no GPU is available: "), "{args}: {message}");
        assert!(message.contains("by cpu/"), "{message}");
        assert!(fs::read(place.path("new.npy")).unwrap() == by_cpu, "{args}");
    }
    assert_eq!(place.ok(&format!("{RIGHT} -q")).stderr, "");
}

#[test]
fn without_a_gpu_asking_for_one_fails_and_names_the_missing_part() {
    let place = workspace();
    for args in ["", "--gpu 0", "--gpu Voodoo"] {
        let ended = place.gs2e(&format!("{RIGHT} --backend gpu {args}"));
        assert_eq!(ended.code, 2, "{args}");
        assert!(
            ended.stderr.contains("no GPU is available: vulkan drivers/libraries could not be loaded"),
            "{}",
            ended.stderr
        );
        assert!(!place.path("new.npy").exists());
    }
    let found: Value =
        serde_json::from_str(&place.gs2e(&format!("{RIGHT} --backend gpu --json")).stdout).unwrap();
    assert_eq!((found["level"].as_str(), found["code"].as_str()), (Some("error"), Some("no-adapter")));
}

#[test]
fn an_unused_gpu_option_is_refused() {
    let ended = workspace().gs2e(&format!("{RIGHT} --backend cpu --gpu 0"));
    assert_eq!(ended.code, 2);
    assert!(ended.stderr.contains("--gpu selects a GPU, but the backend is not a GPU"), "{}", ended.stderr);
}

#[test]
fn features_of_a_gpu_are_left_out_by_name() {
    let place = workspace();
    for (features, found) in [("f16", "f16"), ("subgroups,magic", "magic"), ("", "")] {
        let mut command = place.command(&format!("{RIGHT} --backend gpu"));
        let ended = command.arg(format!("--gpu-without={features}")).output().unwrap();
        let message = String::from_utf8(ended.stderr).unwrap();
        let wanted =
            format!("found `{found}`, wanted one or more of subgroups, timestamps, separated by commas");
        assert!(ended.status.code() == Some(2) && message.contains(&wanted), "{message}");
    }
    let ended = place.gs2e(&format!("{RIGHT} --backend cpu --gpu-without subgroups"));
    let wanted = "--gpu-without leaves out features of a GPU, but the backend is not a GPU";
    assert!(ended.code == 2 && ended.stderr.contains(wanted), "{}", ended.stderr);
    if gpu::device().is_none() {
        return;
    }
    let bytes = |args: &str| {
        let ended = with_gpu(&place, args);
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        let bytes = fs::read(place.path("new.npy")).unwrap();
        fs::remove_file(place.path("new.npy")).unwrap();
        bytes
    };
    let whole = bytes("--backend gpu");
    assert!(bytes("--backend gpu --gpu-without subgroups,timestamps") == whole);
    let output =
        place.command_with_gpu("doctor --no-trial --json --gpu-without timestamps").output().unwrap();
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    for gpu in value["gpus"].as_array().unwrap() {
        let used = gpu["used"].as_array().unwrap();
        assert!(!used.contains(&Value::from("timestamps")), "{gpu}");
        assert!(used.iter().all(|feature| gpu["features"].as_array().unwrap().contains(feature)), "{gpu}");
    }
}

/// Steps rendered by a GPU have its class in their keys, and their events agree with the CPU's.
#[test]
fn scenes_are_built_by_a_gpu() {
    let place = Workspace::with_tiny();
    let found = place.gs2e("build --backend gpu tiny.yaml");
    assert_eq!((found.code, place.path(".gs2e").exists()), (2, false), "{}", found.stderr);
    let Some(device) = gpu::device() else { return };
    let run = |args: &str| {
        let output = place.command_with_gpu(args).output().unwrap();
        assert!(output.status.success(), "{args}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    run("release --backend gpu --to by-gpu tiny.yaml");
    let plan = run("plan --backend cpu tiny.yaml");
    assert!(plan.contains(&format!("numerical class {} -> cpu/", device.fingerprint())), "{plan}");
    run("release --backend cpu --to by-cpu tiny.yaml");
    let [by_gpu, by_cpu] = ["by-gpu", "by-cpu"].map(|tree| {
        run(&format!("audit {tree}"));
        let mut reader = h5::Reader::open(&place.path(&format!("{tree}/tiny/base/events.h5"))).unwrap();
        let (mut events, mut chunk) = (Vec::new(), Vec::new());
        while reader.next_chunk(&mut chunk).unwrap() {
            events.append(&mut chunk);
        }
        events
    });
    // The same noise over frames that differ by some units of 2^-24.
    assert!(by_cpu.len() > 100);
    assert_eq!(by_gpu.len(), by_cpu.len());
    let mut apart: Vec<u64> = by_gpu.iter().zip(&by_cpu).map(|(a, b)| a.t.0.abs_diff(b.t.0)).collect();
    apart.sort_unstable();
    println!("{} events by the GPU, {} by the CPU", by_gpu.len(), by_cpu.len());
    assert!(apart[apart.len() / 2] < 1000, "median {} ns", apart[apart.len() / 2]);
}

/// By default a build renders a scene with the back end that rendered it before, and opens a GPU
/// only to render.
#[test]
fn builds_stay_with_the_back_end_of_a_scene() {
    let Some(device) = gpu::device() else { return };
    let place = Workspace::with_tiny();
    // A software GPU is used only if it is named.
    let by_gpu = |args: &str| {
        let output = place.command_with_gpu(&format!("{args} --gpu 0 tiny.yaml")).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        assert!(output.status.success(), "{args}: {}", text(output.stderr));
        text(output.stdout) + &text(output.stderr)
    };
    by_gpu("build");
    let class = |wanted: &str| {
        let why = place.ok("why tiny --recipes tiny.yaml").stdout;
        let classes = why.lines().filter(|line| line.trim().starts_with("class"));
        assert!(classes.clone().count() > 0 && classes.clone().all(|line| line.contains(wanted)), "{why}");
    };
    class(device.fingerprint());
    // If nothing is to be rendered, a missing GPU does not matter, nor does the memo.
    for args in ["build tiny.yaml", "build --recheck 0 tiny.yaml", "release --no-build --to tree tiny.yaml"] {
        let message = place.ok(args).stderr;
        assert!(!message.contains("on the CPU"), "{args}: {message}");
    }
    assert!(place.stale("tiny.yaml").is_empty());
    // If something is, it goes to the CPU together with everything else of the scene that is
    // rendered, and stays there.
    let recipe = fs::read_to_string(place.path("tiny.yaml")).unwrap();
    place.write("tiny.yaml", recipe.replace("seed: ", "seed: 1"));
    let message = place.ok("build tiny.yaml").stderr;
    assert_eq!(
        message.matches("rendering on the CPU, because no GPU is available: ").count(),
        1,
        "{message}"
    );
    class("cpu/");
    assert!(!by_gpu("build").contains("events"));
    class("cpu/");
}

#[test]
fn the_gpu_makes_the_same_picture() {
    let Some(device) = gpu::device() else { return };
    let place = workspace();
    place.ok(RIGHT);
    let by_cpu = npy(&fs::read(place.path("new.npy")).unwrap());
    for args in ["--backend gpu", "--backend gpu --gpu 0", "--gpu 0"] {
        let ended = with_gpu(&place, args);
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        assert!(ended.stderr.contains(&format!("by {}", device.fingerprint())), "{}", ended.stderr);
        let (shape, values) = npy(&fs::read(place.path("new.npy")).unwrap());
        assert_eq!(shape, by_cpu.0);
        // One layer, whose power the two back ends round differently: some units of 6e-8 of a
        // colour of 1.6.
        assert!(values.iter().zip(&by_cpu.1).all(|(a, b)| (a - b).abs() < 1e-6), "{args}");
    }
    let ended = with_gpu(&place, "--backend gpu --gpu 99");
    assert_eq!(ended.code, 2);
    let wanted = format!("no GPU is number 99; there is {}", device.name());
    assert!(ended.stderr.contains(&wanted), "{}", ended.stderr);
}
