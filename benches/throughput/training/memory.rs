//! Peak memory of `gs2e train` next to the estimate by which a build reserves it.
//!
//! Each training is a process of its own. Its peak is `VmHWM`, read while it runs: the largest
//! resident set that the system counts for a child includes that of the process that started it.

use super::{Photos, photos};
use glam::DMat3;
use gs2e_build::stage::StepNeed;
use gs2e_image::Size;
use gs2e_num::se3::OPENCV_FROM_OPENGL;
use gs2e_train as training;
use gs2e_train::TrainingSettings;
use serde_json::{Value, json};
use std::fs;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Iterations of a training, enough to reach the number of Gaussians.
const ITERATIONS: u32 = 60;
/// Numbers of Gaussians and widths of 16:9 photos, px.
const POINTS: [(u32, u32); 6] =
    [(50_000, 480), (200_000, 480), (400_000, 240), (200_000, 960), (100_000, 1280), (1000, 1920)];

/// Memory of one training, bytes.
pub(crate) struct MemoryPoint {
    gaussians: u32,
    size: Size,
    peak: u64,
    estimate: u64,
}

/// Measures all points.
pub(crate) fn measure() -> Vec<MemoryPoint> {
    POINTS.map(|(gaussians, width)| measure_one(gaussians, &photos(super::wide(width)))).into()
}

fn measure_one(gaussians: u32, photos: &Photos) -> MemoryPoint {
    let folder = photos.folder.path();
    fs::write(folder.join("transforms.json"), transforms(photos).to_string()).expect("it is written");
    let settings = TrainingSettings {
        gaussians,
        iterations: ITERATIONS,
        resolution: photos.size.width,
        hold_out: 0,
        ..TrainingSettings::default()
    };
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
    command.args(["train", "--hold-out", "0", "--capture"]).arg(folder);
    command.arg("--out").arg(folder.join("scene.ply"));
    for (name, value) in
        [("--gaussians", gaussians), ("--iterations", ITERATIONS), ("--resolution", photos.size.width)]
    {
        command.args([name, &value.to_string()]);
    }
    let needed = training::memory_needed(&settings, &photos.capture.views);
    let estimate = StepNeed::for_memory([needed]).memory;
    MemoryPoint { gaussians, size: photos.size, peak: peak_of(command), estimate }
}

/// The capture in nerfstudio's form.
fn transforms(photos: &Photos) -> Value {
    let frame = |view: &gs2e_source::CapturedView| {
        let pose = view.world_from_camera;
        // A change of the camera's axes multiplies from the right.
        let axes = DMat3::from_quat(pose.rotation) * DMat3::from_diagonal(OPENCV_FROM_OPENGL);
        let row = |k: usize| [axes.row(k).x, axes.row(k).y, axes.row(k).z, pose.translation[k]];
        let camera = view.camera;
        json!({
            "file_path": view.name, "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            "w": camera.size.width, "h": camera.size.height,
            "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
        })
    };
    json!({ "frames": photos.capture.views.iter().map(frame).collect::<Vec<_>>() })
}

/// Runs a program to its end, which must be successful, and returns its peak memory in bytes.
fn peak_of(mut command: Command) -> u64 {
    let mut child =
        command.stdin(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program can be started");
    let status = format!("/proc/{}/status", child.id());
    let mut peak_kib = 0;
    loop {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse().ok());
        peak_kib = peak_kib.max(kib.unwrap_or(0));
        if let Some(ended) = child.try_wait().expect("the program can be waited for") {
            assert!(ended.success(), "the training ended with {ended}");
            return 1024 * peak_kib;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

impl MemoryPoint {
    /// Deviation of the estimate from the peak, relative to the peak.
    fn off(&self) -> f64 {
        self.estimate as f64 / self.peak as f64 - 1.0
    }

    /// The figures as JSON.
    pub(crate) fn json(&self) -> Value {
        json!({
            "gaussians": self.gaussians, "width": self.size.width, "height": self.size.height,
            "peak": self.peak, "estimate": self.estimate,
        })
    }
}

/// A Markdown table, one row per training.
pub(crate) fn table(points: &[MemoryPoint]) -> String {
    let mut text = "**memory** of `gs2e train`, 8 photos:\n\n\
        | Gaussians | photos | peak | estimate | off by |\n|---|---|---|---|---|"
        .to_owned();
    for point in points {
        let [peak, estimate] = [point.peak, point.estimate].map(|bytes| 1e-6 * bytes as f64);
        let (count, size, off) = (point.gaussians, point.size, 100.0 * point.off());
        text += &format!("\n| {count} | {size} px | {peak:.0} MB | {estimate:.0} MB | {off:+.0} % |");
    }
    text
}
