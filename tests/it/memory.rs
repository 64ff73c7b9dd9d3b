//! Memory of a step: it agrees with the estimate and does not grow with the sequence. Memory of
//! rendering a view: at most 2.5 times the scene plus 200 MB.
//!
//! The kernel maps pages of the program around each fault: tens of MB, by the form of the build and by
//! what else runs. Upper bounds are therefore judged by anonymous memory, which has no mapped page and
//! is watched, so that it is never too high; lower bounds by the kernel's high-water mark of all
//! resident pages, which is never too low.

use crate::support::absent::is_thorough;
use crate::support::steps::{recipe, steps};
use crate::support::workspace::{Workspace, hidden_gpus};
use gs2e_scene::blobs::{blob_crowd, blob_scene};
use gs2e_scene::{Gaussians, ply};
use serde_json::{Value, json};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// The peak of a program's memory, bytes.
#[derive(Debug, Clone, Copy, Default)]
struct Peak {
    /// Highest value seen of anonymous memory: at most the peak.
    anonymous: f64,
    /// The kernel's mark of all resident memory, with mapped pages: at least the peak.
    resident: f64,
}

/// The peak of memory in a build that makes only `output` of one trajectory, and its estimate, bytes.
fn peak(output: &str, gaussians: u32, [width, height]: [u32; 2], factor: u32) -> (Peak, f64) {
    let place = Workspace::new();
    let mut value = recipe("tiny");
    value["source"] = json!({ "procedural": { "gaussians": gaussians, "views": 12, "arc": 0.5 } });
    value["camera"] = json!({ "width": width, "height": height });
    value["trajectories"][0]["refine"]["factor"] = json!(factor);
    // A first build removes the rest from the measurement: the scene, and every other step except
    // the checks.
    value["outputs"] = json!([]);
    place.write("tiny.yaml", value.to_string());
    place.ok("build tiny.yaml");
    value["outputs"] = json!([output]);
    value["blur"] = json!({ "frames": 3 });
    place.write("tiny.yaml", value.to_string());
    let mut command = hidden_gpus(Command::new(env!("CARGO_BIN_EXE_gs2e")));
    command.args(["build", "-q", "-j", "1", "tiny.yaml"]).current_dir(place.path("")).stdout(Stdio::null());
    let found = high_water(&mut command.spawn().unwrap());
    let key = steps(&place, "tiny.yaml")[&format!("tiny/base/{output}")].key.clone().unwrap();
    let record = std::fs::read(place.path(&format!(".gs2e/ac/{}/{key}.json", &key[..2]))).unwrap();
    let record: Value = serde_json::from_slice(&record).unwrap();
    (found, record["provenance"]["memory"].as_f64().unwrap())
}

/// The peak of a program's memory, watched until it succeeds. The figure of `wait` would include the
/// memory of the test program, from which the child was forked.
fn high_water(child: &mut Child) -> Peak {
    let status = format!("/proc/{}/status", child.id());
    let mut highest = Peak::default();
    loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let bytes = |name: &str| {
            let line = text.lines().find_map(|line| line.strip_prefix(name));
            let kib = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok());
            kib.unwrap_or(0.0) * 1024.0
        };
        highest.anonymous = highest.anonymous.max(bytes("RssAnon:"));
        highest.resident = highest.resident.max(bytes("VmHWM:"));
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success() && highest.anonymous > 0.0, "{status}, {highest:?} seen");
            return highest;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// The user's own frames are not held in memory: a longer clip of 36 MB takes no more.
#[test]
fn a_longer_clip_takes_no_more() {
    let place = Workspace::new();
    let peak = |frames: usize| {
        let (shape, pixels) = (format!("({frames}, 130, 173)"), vec![100u8; frames * 130 * 173]);
        let head = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}");
        let head = [b"\x93NUMPY\x01\x00\x76\x00", format!("{head:117}\n").as_bytes()].concat();
        place.write("frames.npy", [head, pixels].concat());
        let args = "simulate --frames frames.npy --fps 1000 --sensor dvs346 --out e.npz -q -j 1";
        high_water(&mut place.command(args).spawn().unwrap())
    };
    let (short, long) = (peak(100).resident, peak(1600).anonymous);
    assert!(long - short < 6e6, "{short} bytes for 100 frames, {long} for 1600");
    // All frames alone are 36 MB.
    assert!(long < 36e6, "{long}");
}

/// Frames are never all in memory, and the events never are.
#[test]
fn a_longer_sequence_takes_no_more() {
    let (short, _) = peak("events", 4096, [346, 260], 1);
    let (long, _) = peak("events", 4096, [346, 260], 16);
    let (short, long) = (short.resident, long.anonymous);
    eprintln!("{:.1} MB for N frames, {:.1} MB for 16 N", short * 1e-6, long * 1e-6);
    // Twelve views become 12 poses, or 177: all frames would take 59 MB more.
    assert!(long - short < 10e6, "{short} bytes for N frames, {long} for 16 N");
    assert!(long < 256e6, "{long}");
}

/// The budget of a run depends on the estimate, which must be within a quarter for several sizes of
/// scene and picture. Without slow tests, three of seven.
#[test]
fn the_memory_of_a_step_agrees_with_its_estimate() {
    let steps = [
        ("events", 4_096, [346, 260]),
        ("events", 100_000, [320, 180]),
        ("flow", 20_000, [1280, 720]),
        ("events", 20_000, [1280, 720]),
        ("sharp", 20_000, [1280, 720]),
        ("blur", 20_000, [1280, 720]),
        ("depth", 20_000, [1280, 720]),
    ];
    let count = if is_thorough() { steps.len() } else { 3 };
    for (output, gaussians, size) in steps.into_iter().take(count) {
        let (found, estimate) = peak(output, gaussians, size, 1);
        let [anonymous, resident] = [found.anonymous, found.resident].map(|bytes| bytes / estimate);
        eprintln!(
            "{output}, {gaussians} Gaussians, {size:?}: {anonymous:.2} to {resident:.2} of {:.1} MB",
            estimate * 1e-6
        );
        assert!(
            anonymous < 1.25 && resident > 0.75,
            "{output}, {gaussians}, {size:?}: {found:?}, {estimate}"
        );
    }
}

/// The peak of anonymous memory of `gs2e render` for a view of a scene, and its bound, bytes.
fn rendering(scene: &Gaussians, edge: u32) -> (f64, f64) {
    let place = Workspace::new();
    let mut file = std::io::BufWriter::new(std::fs::File::create(place.path("scene.ply")).unwrap());
    ply::write_ply(scene, &mut file).unwrap();
    drop(file);
    let camera = json!({ "W": edge, "H": edge, "fx": edge, "fy": edge, "cx": edge / 2, "cy": edge / 2,
        "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 1] });
    place.write("camera.json", camera.to_string());
    let mut command = hidden_gpus(Command::new(env!("CARGO_BIN_EXE_gs2e")));
    let args = "render -q --scene scene.ply --view camera.json --channel luminance --out picture.npy";
    let child = command.args(args.split(' ')).current_dir(place.path("")).stdout(Stdio::null()).spawn();
    let found = high_water(&mut child.unwrap()).anonymous;
    let floats = 3 + 3 + 4 + 1 + 3 * scene.sh_len();
    (found, 2.5 * (4 * floats * scene.len()) as f64 + 200e6)
}

#[test]
fn a_view_takes_two_and_a_half_times_its_scene() {
    for (gaussians, sh_degree) in [(500_000, 3), (1_000_000, 0)] {
        let mut scene = blob_scene(&blob_crowd(gaussians, 3));
        scene.sh_degree = sh_degree;
        scene.sh = scene.sh.iter().flat_map(|dc| std::iter::repeat_n(*dc, scene.sh_len())).collect();
        // small ones, as in a large scene
        scene.log_scales.iter_mut().flatten().for_each(|scale| *scale -= 2.0);
        let (found, bound) = rendering(&scene, 640);
        eprintln!("{gaussians} of degree {sh_degree}: {:.0} of {:.0} MB", found * 1e-6, bound * 1e-6);
        assert!(found <= bound, "{gaussians} of degree {sh_degree}: {found} bytes, bound {bound}");
    }
}

/// Each of 3,000 Gaussians covers all of 65,536 tiles: complete lists would take 2.4 GB. The bound
/// allows two planes and the picture, lists of up to 200 MB while they grow, the program, and the
/// allocator's reserve.
#[test]
fn giants_take_no_more_than_the_budget_of_the_lists() {
    let mut scene = blob_scene(&blob_crowd(3000, 3));
    scene.log_scales.iter_mut().flatten().for_each(|scale| *scale = 6.0);
    scene.opacity_logits.fill(3.0);
    scene.positions.iter_mut().for_each(|position| position[2] = position[2].abs() + 1.0);
    let edge = 4096;
    let (found, _) = rendering(&scene, edge);
    let planes = 3.0 * 4.0 * f64::from(edge).powi(2);
    eprintln!("giants: {:.0} MB, {:.0} of them planes", found * 1e-6, planes * 1e-6);
    assert!(found < planes + 300e6, "{found}");
}
