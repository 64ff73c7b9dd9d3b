//! The report on a trajectory: its requested and achieved speed, and the motion in the picture.

use crate::cli::{Console, path};
use gs2e_render::centre::centre_px;
use gs2e_scene::camera::Camera;
use gs2e_source::kind::CaptureKind;
use gs2e_trajectory::TrajectoryBuild;
use gs2e_trajectory::flow::FlowQuantiles;
use gs2e_trajectory::report::{FollowError, SpeedReport};
use serde_json::{Value, json};
use std::path::Path;

/// Keys of the report with one number per pose or step. These lists are only in its file.
const LONG: [&str; 4] = ["u", "s", "linear_unit_s", "angular_rad_s"];

/// The report on a trajectory.
pub(super) struct TrajectoryAccount<'a> {
    name: &'a str,
    kind: Option<CaptureKind>,
    report: &'a SpeedReport,
    seconds: f64,
    camera: Option<Camera>,
    px: Option<FlowQuantiles>,
    /// Warnings about the capture, the bases and the trajectory itself.
    warnings: Vec<String>,
}

impl<'a> TrajectoryAccount<'a> {
    /// Creates the report. `warnings` are those that the speed report does not contain.
    pub(super) fn new(
        name: &'a str,
        kind: Option<CaptureKind>,
        made: &'a TrajectoryBuild,
        camera: Option<Camera>,
        mut warnings: Vec<String>,
    ) -> Self {
        let (poses, report) = (&made.trajectory.world_from_camera, &made.report);
        let px = camera.and_then(|camera| centre_px(poses, &camera, report.scale_distance));
        let seconds = made.trajectory.stamps_us.last().copied().unwrap_or(0) as f64 * 1e-6;
        warnings.extend(report.warnings.iter().cloned());
        Self { name, kind, report, seconds, camera, px, warnings }
    }

    /// Prints the report for people.
    pub(super) fn report(&self, console: &Console) {
        let SpeedReport { poses, rate, .. } = self.report;
        let rate = rate.strip_suffix("/1").unwrap_or(rate);
        let duration = match self.seconds {
            short if short < 1.0 => format!("{:.1} ms", short * 1e3),
            long => format!("{long:.3} s"),
        };
        let from = self.kind.map_or(String::new(), |kind| format!(", from a {} capture", kind.name()));
        console.note(&format!("{}: {poses} poses over {duration}, {rate} per second{from}", self.name));
        self.report_speed(console);
        if let Some(jumps) = self.report.knot_jumps {
            let [c0, c1, c2] = [jumps.c0, jumps.c1, jumps.c2].map(|jump| format!("{jump:.1e}"));
            console.note(&format!(
                "largest jump at a knot: pose {c0} (C0), rate {c1} (C1), acceleration {c2} (C2)"
            ));
        }
        self.report_picture(console);
        self.warnings.iter().for_each(|warning| console.note(&format!("warning: {warning}")));
    }

    fn report_speed(&self, console: &Console) {
        let parts = [
            ("mixed, along the curve", self.report.mixed_ratio),
            ("mixed, pose to pose", self.report.mixed_chord_ratio),
            ("linear", self.report.linear_ratio),
            ("angular", self.report.angular_ratio),
        ];
        console.note("achieved over requested share of the path, per step:");
        for (part, follow) in parts {
            console.note(&format!("  {part:22} {}", follow.map_or("does not move".to_owned(), follow_words)));
        }
    }

    fn report_picture(&self, console: &Console) {
        let (Some(px), Some(camera)) = (self.px, self.camera) else { return };
        let (fx, distance) = (camera.fx, self.report.scale_distance);
        let [median, p95, max] = [px.median, px.p95, px.max].map(|px| format!("{px:.2}"));
        console.note(&format!("px from frame to frame: median {median}, 95 % {p95}, largest {max}"));
        console.note(&format!(
            "  upper bound for a point in the picture's centre at the scale distance {distance:.4}: focal length \
             {fx:.1} px x (sideways motion / distance + turn across the optical axis)"
        ));
    }

    /// The report for programs, without its long lists, with `files` by option.
    pub(super) fn to_json<'f>(&self, files: impl Iterator<Item = (&'static str, &'f Path)>) -> Value {
        let mut value = serde_json::to_value(self.report).expect("reports are plain data");
        if let Value::Object(fields) = &mut value {
            fields.retain(|key, _| !LONG.contains(&key.as_str()));
        }
        let files: serde_json::Map<String, Value> =
            files.map(|(option, file)| (option.to_owned(), json!(path(file)))).collect();
        (value["trajectory"], value["capture"]) = (json!(self.name), json!(self.kind.map(CaptureKind::name)));
        (value["duration_s"], value["px_per_frame"]) = (json!(self.seconds), json!(self.px));
        (value["warnings"], value["files"]) = (json!(self.warnings), Value::Object(files));
        value
    }
}

fn follow_words(follow: FollowError) -> String {
    let FollowError { min, max, p95, .. } = follow;
    format!("{min:.4}..{max:.4}, 95 % within {:.2} %", p95 * 100.0)
}
