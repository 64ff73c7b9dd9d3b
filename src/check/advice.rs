//! Remedies for findings, one per pass: the first thing to try.

/// Returns what to do about a finding of this pass that is not a pass; empty for an unknown name.
#[must_use]
pub fn advice(check: &str) -> &'static str {
    match check {
        "schema" | "refractory" | "drift_identity" | "stamps" => {
            "rebuild the trajectory: `gs2e build --verify`; if the finding remains, it is a bug in gs2e: report it"
        }
        "duplicates" => "raise the sensor's thresholds or its dead time",
        "coverage" => {
            "check the views along the path in report.html; change its centre, distance or arc so that it faces the scene"
        }
        "event_rate" => {
            "compare the thresholds with the contrast of the frames (`gs2e study thresholds`), and check the views along the path in report.html"
        }
        "polarity" => {
            "check for a brightness change along the path, and for ON and OFF thresholds that differ by mistake"
        }
        "batching" => "use more frames: `sampling: { tolerance: 0.1 }`, or a higher `sampling.rate`",
        "hot_pixels" => "lower the sensor's share of hot pixels, or its noise",
        "structure" => "the events look like noise: lower the sensor's noise, or its thresholds",
        "event_frame" => {
            "use more frames: `sampling: { tolerance: 0.1 }`; then compare sharp/ with the events in report.html"
        }
        "motion" => "slow the path down or use more frames, so that events follow the image motion",
        "event_times" => {
            "compare the clock of the events with that of the frames; write event times in microseconds"
        }
        "photometric" | "depth_consistency" | "flow_projection" => {
            "compare poses, depth and frames: their order, axes, direction and scale; `gs2e audit --rebuild` makes them again"
        }
        "time_offset" => "compare the time stamps of the frames with those of the events",
        "noise_floor" => "set the sensor's noise parameters to those of your camera: docs/sensors.md",
        "sampling" => {
            "let gs2e choose the number of frames: `sampling: { tolerance: 0.1 }`, or slow the path down: `speed: { flow: { px_s: 400 } }`"
        }
        "affine" => {
            "keep the path away from large Gaussians near the camera: use a larger distance, or another arc"
        }
        "readback" => "check the report of the named program; the files may be damaged",
        "pose_continuity" => "smooth the path: a larger `refine.window`, or fewer keyframes",
        "pose_colmap" | "pose_opencv" => {
            "compare the poses and the camera of the source with those of the photos"
        }
        "speed" => "check speed.json; a longer `refine.window` or fewer poses make the path easier to follow",
        "recon_psnr" => "train the scene longer, or exclude photos that it cannot reproduce",
        "capture" => "check the named photos and poses; `gs2e init --exclude` leaves photos out",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pass_has_a_remedy() {
        assert_eq!(crate::check::NAMES.into_iter().filter(|name| advice(name).is_empty()).count(), 0);
    }
}
