//! Remedies for findings, one per pass: the first thing to try.

/// Returns what to do about a finding of this pass that is not a pass; empty for an unknown name.
#[must_use]
pub fn advice(check: &str) -> &'static str {
    match check {
        "schema" | "refractory" | "drift_identity" | "stamps" => {
            "rebuild the trajectory: `gs2e build --verify`; if the finding stays, it is a defect of gs2e: report it"
        }
        "duplicates" => "raise the sensor's thresholds or its dead time",
        "coverage" => {
            "look at the views of the path in report.html; move its centre, its distance or its arc towards the scene"
        }
        "event_rate" => {
            "compare the thresholds with the contrast of the frames (`gs2e study thresholds`), and look at the views of the path"
        }
        "polarity" => {
            "look for a change of brightness along the path, or for thresholds that differ by mistake"
        }
        "batching" => "ask for more frames: `sampling: { tolerance: 0.1 }`, or a higher `sampling.rate`",
        "hot_pixels" => "lower the share of hot pixels of the sensor, or its noise",
        "structure" => "the events look like noise: lower the sensor's noise, or its thresholds",
        "event_frame" => {
            "ask for more frames: `sampling: { tolerance: 0.1 }`; then compare sharp/ with the events in report.html"
        }
        "motion" => {
            "slow the path down or ask for more frames, so that events follow the motion of the picture"
        }
        "time_offset" => "compare the stamps of the frames with those of the events",
        "noise_floor" => "set the noise of the sensor that the camera has: docs/sensors.md",
        "sampling" => {
            "let the path decide the number of frames: `sampling: { tolerance: 0.1 }`, or a slower `speed: { flow: { px_s: 400 } }`"
        }
        "affine" => {
            "keep the path away from large Gaussians near the camera: a larger distance, or another arc"
        }
        "readback" => "look at the named reader's report; the files may be damaged",
        "pose_continuity" => "smooth the path: a larger `refine.window`, or fewer keyframes",
        "pose_colmap" | "pose_opencv" => {
            "compare the poses and the camera of the source with those of the photos"
        }
        "speed" => {
            "look at speed.json; a longer `refine.window` or fewer poses make the path easier to follow"
        }
        "recon_psnr" => "train the scene longer, or leave out photos that it cannot explain",
        "capture" => "look at the photos and poses that are named; `gs2e init --exclude` leaves photos out",
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
