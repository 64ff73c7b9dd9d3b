//! Poses, stamps, speeds and transforms: they open, have the stated counts, and agree with each
//! other.

use super::{AuditFault, FaultCode, TrajectoryFolder};
use crate::claims;
use glam::DVec3;
use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_num::se3::{OPENCV_FROM_OPENGL, Se3};
use gs2e_num::units::Hertz;
use gs2e_sampling::exposure;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::report::SpeedReport;
use gs2e_trajectory::sample::stamps_us;
use gs2e_trajectory::speed::SpeedMeaning;
use gs2e_trajectory::text::{TextError, read_stamps};
use serde_json::Value;
use std::fs::File;
use std::io::BufReader;

const SPEED: &str = "speed.json";

pub(super) fn audit_motion(folder: &TrajectoryFolder<'_>) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    let stamps = read_text(folder, "timestamps_us.txt", read_stamps, &mut faults);
    if let Some(trajectory) = read_text(folder, "poses.txt", Trajectory::read_poses, &mut faults) {
        let report: Option<SpeedReport> =
            claims::parse_claims(folder.tree, &folder.path_of(SPEED), &mut faults);
        faults.extend(poses_agree(folder, &trajectory, stamps.as_deref()));
        faults.extend(pace_fault(folder, &trajectory, report.as_ref()));
        faults.extend(transforms_agree(folder, &trajectory));
        faults.extend(report.and_then(|report| speeds_agree(folder, &trajectory, &report)));
    }
    faults
}

/// Reads a text file, if it is intact.
fn read_text<T>(
    folder: &TrajectoryFolder<'_>,
    name: &str,
    parse: impl FnOnce(BufReader<File>) -> Result<T, TextError>,
    faults: &mut Vec<AuditFault>,
) -> Option<T> {
    if !folder.has(name) {
        return None;
    }
    let parsed = match files::open_with(&folder.on_disk(name), LinkRule::Refuse) {
        Ok(file) => parse(BufReader::new(file)).map_err(|e| e.to_string()),
        Err(e) => Err(e.to_string()),
    };
    parsed.map_err(|message| faults.push(folder.fault(FaultCode::Unreadable, name, message))).ok()
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
    const NAME: &str = "transforms.json";
    let mut faults = Vec::new();
    let Some(found) = claims::parse_claims::<Value>(folder.tree, &folder.path_of(NAME), &mut faults) else {
        return faults;
    };
    let camera = &folder.camera;
    let numbers = [("fl_x", camera.fx), ("fl_y", camera.fy), ("cx", camera.cx), ("cy", camera.cy)];
    let sides =
        [("w", camera.size.width), ("h", camera.size.height)].map(|(key, side)| (key, f64::from(side)));
    for (key, wanted) in numbers.into_iter().chain(sides) {
        if found[key].as_f64() != Some(wanted) {
            let message = format!("its {key} is {}, scene.json says {wanted}", found[key]);
            faults.push(folder.fault(FaultCode::ClaimsDisagree, NAME, message));
        }
    }
    let (model, coefficients) = camera.lens.map_or(("PINHOLE", Vec::new()), |lens| lens.nerfstudio());
    if found["camera_model"] != model
        || coefficients.iter().any(|(name, k)| found[*name].as_f64() != Some(*k))
    {
        let message = "its lens is not that of scene.json".to_owned();
        faults.push(folder.fault(FaultCode::ClaimsDisagree, NAME, message));
    }
    let frames = found["frames"].as_array().map_or(&[][..], Vec::as_slice);
    let stamped = trajectory.world_from_camera.iter().zip(&trajectory.stamps_us);
    let mut poses = stamped.map(|(pose, t_us)| (opengl_rows(pose), *t_us));
    let same = |(frame, (matrix, t_us)): (&Value, ([[f64; 4]; 3], i64))| {
        frame["t_us"].as_i64() == Some(t_us) && is_near(&frame["transform_matrix"], &matrix)
    };
    // Poses without a picture may be left out, so the frames are some of the poses, in their order.
    // `any` takes each pose once, so a frame out of order finds no pose.
    let in_order = frames.iter().all(|frame| poses.any(|pose| same((frame, pose))));
    // No frames at all would be in order too.
    if frames.is_empty() || !in_order {
        faults.push(folder.fault(
            FaultCode::ClaimsDisagree,
            NAME,
            "its frames are not the poses of poses.txt",
        ));
    }
    faults.extend(
        exposures_agree(folder, frames, &trajectory.stamps_us)
            .map(|message| folder.fault(FaultCode::ClaimsDisagree, NAME, message)),
    );
    faults
}

/// Checks the blurred pictures: one for each exposure that the stamps have room for, numbered by
/// its pose, with the times that `scene.json` gives. Returns the first fault.
fn exposures_agree(folder: &TrajectoryFolder<'_>, listed: &[Value], stamps: &[i64]) -> Option<String> {
    let number = |frame: &Value| -> Option<usize> {
        frame.get("blur_file_path")?.as_str()?.strip_prefix("blur/")?.strip_suffix(".png")?.parse().ok()
    };
    let blurred = listed.iter().filter(|frame| frame.get("blur_file_path").is_some());
    let found: Vec<Option<usize>> = blurred.clone().map(number).collect();
    let stated = folder.part.blur.as_ref().and_then(|blur| blur["frames"].as_u64());
    let frames = stated.and_then(|frames| u32::try_from(frames).ok()).filter(|frames| *frames > 0);
    let wanted = frames.map_or(Vec::new(), |frames| exposure::exposure_centres(stamps.len(), frames));
    if found != wanted.iter().copied().map(Some).collect::<Vec<_>>() {
        return Some(format!("it lists {} blurred pictures, scene.json gives {}", found.len(), wanted.len()));
    }
    let seconds: Vec<f64> = stamps.iter().map(|t_us| *t_us as f64 * 1e-6).collect();
    blurred.zip(wanted).find_map(|(frame, pose)| {
        let open = exposure::shutter_times(&seconds, pose, frames?);
        // Stamps and stated times are both rounded to a microsecond, and each is off by up to half
        // of one. The rest is for the arithmetic.
        let near =
            |key: &str, at: f64| frame[key].as_f64().is_some_and(|us| (us - at * 1e6).abs() <= 1.0 + 1e-6);
        let timed = near("exposure_start_us", open[0]) && near("exposure_end_us", open[1]);
        (!timed || frame["t_us"].as_i64() != Some(stamps[pose])).then(|| {
            format!(
                "the exposure of blur/{pose:06}.png does not span {} frames around its pose",
                frames.unwrap_or(0)
            )
        })
    })
}

/// Returns true if the matrices agree but for rounding. Poses of `poses.txt` have canonical
/// quaternions, so rotations differ by a few units in the last place of numbers up to 1.
/// Translations do not differ.
fn is_near(found: &Value, wanted: &[[f64; 4]; 3]) -> bool {
    let Ok(found) = serde_json::from_value::<[[f64; 4]; 4]>(found.clone()) else { return false };
    found
        .iter()
        .flatten()
        .zip(wanted.iter().flatten())
        .all(|(a, b)| (a - b).abs() <= 1e-12 * b.abs().max(1.0))
}

/// The top three rows of camera to world with OpenGL camera axes. A point on a camera axis goes
/// where the pose takes it; y and z point the other way.
fn opengl_rows(world_from_camera: &Se3) -> [[f64; 4]; 3] {
    let axes =
        [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| world_from_camera.rotation * (axis * OPENCV_FROM_OPENGL));
    let centre = world_from_camera.translation;
    [0, 1, 2].map(|row| [axes[0][row], axes[1][row], axes[2][row], centre[row]])
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
