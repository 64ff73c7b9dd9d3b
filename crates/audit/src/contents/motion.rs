//! Poses, stamps, speeds and transforms: they open, have the stated counts, and agree with each
//! other.

use super::{AuditFault, FaultCode, TrajectoryFolder};
use crate::claims;
use gs2e_num::units::Hertz;
use gs2e_release::layout::TRANSFORMS;
use gs2e_sampling::exposure;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::report::SpeedReport;
use gs2e_trajectory::sample::stamps_us;
use gs2e_trajectory::speed::SpeedMeaning;
use gs2e_trajectory::text::read_stamps;
use gs2e_trajectory::transforms::{PictureLinks, compose_transforms};
use gs2e_tree::Exposure;
use serde_json::Value;
use std::collections::BTreeMap;

const SPEED: &str = "speed.json";

pub(super) fn audit_motion(folder: &TrajectoryFolder<'_>) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    let stamps = read_stated_stamps(folder, &mut faults);
    match folder.files.poses() {
        Ok(trajectory) => {
            let report: Option<SpeedReport> =
                claims::parse_claims(folder.tree, &folder.path_of(SPEED), &mut faults);
            faults.extend(poses_agree(folder, &trajectory, stamps.as_deref()));
            faults.extend(pace_fault(folder, &trajectory, report.as_ref()));
            faults.extend(transforms_agree(folder, &trajectory));
            faults.extend(report.and_then(|report| speeds_agree(folder, &trajectory, &report)));
        }
        Err(e) => faults.push(folder.fault(FaultCode::Unreadable, "poses.txt", e.because)),
    }
    faults
}

/// Reads the time stamps, if their file is intact.
fn read_stated_stamps(folder: &TrajectoryFolder<'_>, faults: &mut Vec<AuditFault>) -> Option<Vec<i64>> {
    let name = "timestamps_us.txt";
    let bytes = folder.has(name).then(|| folder.files.read(name))?;
    let stamps = bytes.map_err(|e| e.because);
    let stamps = stamps.and_then(|bytes| read_stamps(bytes.as_slice()).map_err(|e| e.to_string()));
    stamps.map_err(|message| faults.push(folder.fault(FaultCode::Unreadable, name, message))).ok()
}

/// Compares poses with stamps and with the stated counts.
fn poses_agree(
    folder: &TrajectoryFolder<'_>,
    trajectory: &Trajectory,
    stamps: Option<&[i64]>,
) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    let mut disagree =
        |name: &str, message: String| faults.push(folder.fault(FaultCode::ClaimsDisagree, name, message));
    let found = &trajectory.stamps_us;
    if let Some(stamps) = stamps.filter(|stamps| stamps != found) {
        let message =
            format!("its {} time stamps differ from those of the {} poses", stamps.len(), found.len());
        disagree("timestamps_us.txt", message);
    }
    let part = folder.part;
    if found.len() != part.poses || found.last().copied().unwrap_or(0) != part.duration_us {
        let last = found.last().copied().unwrap_or(0);
        let message = format!(
            "it has {} poses until {last} us, scene.json says {} until {} us",
            found.len(),
            part.poses,
            part.duration_us
        );
        disagree("poses.txt", message);
    }
    faults
}

/// Compares stamps with the stated rate, or with the frame rates of a law that asks for those.
fn pace_fault(
    folder: &TrajectoryFolder<'_>,
    trajectory: &Trajectory,
    report: Option<&SpeedReport>,
) -> Option<AuditFault> {
    let (rate, found) = (&folder.part.rate, &trajectory.stamps_us);
    let disagree = |message: String| Some(folder.fault(FaultCode::ClaimsDisagree, "poses.txt", message));
    let Ok(hertz) = rate.parse().map(Hertz) else {
        return disagree(format!("scene.json states the rate `{rate}`, which is not a number"));
    };
    if let Some(report) = report.filter(|report| report.meaning == SpeedMeaning::FrameRate) {
        // Under a law of frame rates the stamps follow from the speeds, and no rate alone gives
        // them.
        let same = stamps_us(hertz, report.meaning, &report.u) == *found;
        let message = || format!("its time stamps differ from the frame rates in {SPEED}");
        return if same { None } else { disagree(message()) };
    }
    let (j, t) = (0..).zip(found).find(|(j, t)| hertz.stamp_us(*j) != **t)?;
    disagree(format!("pose {j} is at {t} us, not at {j} / ({rate}) s"))
}

/// Checks that `transforms.json` is what the poses and the camera give.
fn transforms_agree(folder: &TrajectoryFolder<'_>, trajectory: &Trajectory) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    let path = folder.path_of(TRANSFORMS);
    let Some(found) = claims::parse_claims::<Value>(folder.tree, &path, &mut faults) else { return faults };
    let blurred = &stated_exposures(folder, &trajectory.stamps_us);
    let all = PictureLinks { sharp: &[], readout_us: None, blurred };
    let wanted = compose_transforms(&folder.files.camera, trajectory, &all);
    let mut disagree =
        |message: String| faults.push(folder.fault(FaultCode::ClaimsDisagree, TRANSFORMS, message));
    let of_camera = wanted.as_object().into_iter().flatten();
    for (key, wanted) in of_camera.filter(|(key, _)| !["frames", "pixel_center"].contains(&key.as_str())) {
        let found = &found[key];
        if found != wanted && (found.as_f64().is_none() || found.as_f64() != wanted.as_f64()) {
            disagree(format!("its {key} is {found}, scene.json says {wanted}"));
        }
    }
    let [frames, all] =
        [&found, &wanted].map(|file| file["frames"].as_array().map_or(&[][..], Vec::as_slice));
    let mut poses = all.iter();
    let same = |frame: &Value, pose: &Value| {
        frame["t_us"] == pose["t_us"] && is_near(&frame["transform_matrix"], &pose["transform_matrix"])
    };
    // Poses without a picture may be left out, so the frames are some of the poses, in their order. `any`
    // takes each pose once, so a frame out of order finds no pose. No frames at all would be in order too.
    if frames.is_empty() || !frames.iter().all(|frame| poses.any(|pose| same(frame, pose))) {
        disagree("its frames are not the poses of poses.txt".to_owned());
    }
    exposures_fault(frames, all).into_iter().for_each(disagree);
    faults
}

/// The exposures that the stamps have room for, by the pose, with the number of frames that `scene.json`
/// states.
fn stated_exposures(folder: &TrajectoryFolder<'_>, stamps: &[i64]) -> BTreeMap<usize, [i64; 2]> {
    let stated = folder.part.blur.as_ref().and_then(|blur| blur["frames"].as_u64());
    let Some(frames) = stated.and_then(|frames| u32::try_from(frames).ok()).filter(|frames| *frames > 0)
    else {
        return BTreeMap::new();
    };
    let seconds: Vec<f64> = stamps.iter().map(|t_us| *t_us as f64 * 1e-6).collect();
    let centres = exposure::exposure_centres(stamps.len(), frames).into_iter();
    centres.map(|pose| (pose, exposure::open_us(&seconds, pose, frames))).collect()
}

/// Compares the blurred pictures of two lists of frames. Returns the first fault of those that were found.
fn exposures_fault(found: &[Value], wanted: &[Value]) -> Option<String> {
    let blurred = |frames: &[Value]| -> Vec<(Value, Option<Exposure>)> {
        let blurred = frames.iter().filter(|frame| frame.get("blur_file_path").is_some());
        blurred.map(|frame| (frame["t_us"].clone(), Exposure::read(frame))).collect()
    };
    let [found, wanted] = [found, wanted].map(blurred);
    let poses = |frames: &[(Value, Option<Exposure>)]| -> Vec<Option<usize>> {
        frames.iter().map(|(_, exposure)| exposure.map(|exposure| exposure.pose)).collect()
    };
    if poses(&found) != poses(&wanted) {
        return Some(format!("it lists {} blurred pictures, scene.json gives {}", found.len(), wanted.len()));
    }
    found.into_iter().zip(wanted).find_map(|((stamp, found), (pose_stamp, wanted))| {
        let (found, wanted) = (found?, wanted?);
        // Stamps and stated times are both rounded to a microsecond, and each is off by up to half
        // of one.
        let is_near = found.open_us.iter().zip(wanted.open_us).all(|(a, b)| a.abs_diff(b) <= 1);
        (!is_near || stamp != pose_stamp).then(|| {
            let (pose, [start, end]) = (wanted.pose, wanted.open_us);
            format!(
                "the exposure of blur/{pose:06}.png is not that around its pose, from {start} to {end} us"
            )
        })
    })
}

/// Returns true if the matrices agree but for rounding. Poses of `poses.txt` have canonical
/// quaternions, so rotations differ by a few units in the last place of numbers up to 1.
/// Translations do not differ.
fn is_near(found: &Value, wanted: &Value) -> bool {
    let rows = |matrix: &Value| serde_json::from_value::<[[f64; 4]; 4]>(matrix.clone());
    let (Ok(found), Ok(wanted)) = (rows(found), rows(wanted)) else { return false };
    found
        .iter()
        .flatten()
        .zip(wanted.iter().flatten())
        .all(|(a, b)| (a - b).abs() <= 1e-12 * b.abs().max(1.0))
}

fn speeds_agree(
    folder: &TrajectoryFolder<'_>,
    trajectory: &Trajectory,
    report: &SpeedReport,
) -> Option<AuditFault> {
    let (stated, found) = (report.poses, trajectory.stamps_us.len());
    let message = || format!("it covers {stated} poses, poses.txt has {found}");
    (stated != found).then(|| folder.fault(FaultCode::ClaimsDisagree, SPEED, message()))
}
