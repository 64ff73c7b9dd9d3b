//! Robust e-NeRF (Low and Lee, ICCV 2023; GitHub wengflow/robust-e-nerf at 5bb9b46) and Deblur
//! e-NeRF (Low and Lee, ECCV 2024; GitHub wengflow/deblur-e-nerf at 0925cb1).
//!
//! | file | arrays |
//! |---|---|
//! | `raw_events.npz` | `position` uint16 (N, 2), `timestamp` int64 ns, `polarity` bool |
//! | `camera_poses.npz` | `T_wc_position` float32 (M, 3), `T_wc_orientation` xyzw, `T_wc_timestamp` ns |
//! | `camera_calibration.npz` | intrinsics with pixel centres at integers, thresholds, refractory period |
//! | `renderer_params.npz` | `interm_color_space`, `log_eps` |
//! | `views/transforms_{train,val,test}.json`, `views/{train,val,test}/*.png` | frames, OpenGL camera axes |
//! | `config.json` | options of the program |
//!
//! Deblur e-NeRF also reads the circuit of a pixel. The sensors of this program have none that it
//! could hold, so an ideal circuit is written: all time constants are short.

use super::camera_needs::{products, unmet_events, unmet_frames};
use crate::brightness::{BrightnessFactor, BrightnessFormula, log_offset, thresholds_in};
use crate::npy::{Entry, GrowingArray};
use crate::{
    ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, ExportSubject, UnmetNeed, geometry, npy,
    poses,
};
use serde_json::{Value, json};

/// The layout of Robust e-NeRF.
pub(super) static ROBUST_E_NERF: ExportFormat = ExportFormat::new(
    "robust-e-nerf",
    "github.com/wengflow/robust-e-nerf at 5bb9b46",
    unmet,
    losses,
    |plan, out| write(plan, Vec::new(), out),
);

/// The layout of Deblur e-NeRF.
pub(super) static DEBLUR_E_NERF: ExportFormat = ExportFormat::new(
    "deblur-e-nerf",
    "github.com/wengflow/deblur-e-nerf at 0925cb1",
    unmet,
    deblur_losses,
    |plan, out| write(plan, ideal_circuit(), out),
);

const NS_PER_US: i64 = 1000;
/// Largest coordinate that float32 holds to 1e-5 of a unit: its spacing at 100 is 8e-6.
const MAX_POSITION: f64 = 100.0;
/// One frame for training and one for each of validation and test.
const MIN_FRAMES: usize = 2;

fn deblur_losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let what = "an ideal circuit stands for the pixel: the release has no time constants in its terms";
    let mut losses = losses(plan);
    losses.push(ExportLoss::approximate("sensor.circuit", FAST_S, what));
    losses
}

/// Time constant of the ideal circuit, s: a hundredth of the resolution of the stamps.
const FAST_S: f64 = 1e-8;

/// Entries of the calibration for a circuit without effect on the events.
fn ideal_circuit() -> Vec<(&'static str, Entry)> {
    // A cutoff frequency `1 / (2 pi tau)` for the filters, and none for the low cutoff.
    let cutoff = 1.0 / (std::f64::consts::TAU * FAST_S);
    vec![
        ("input_time_const_eff_it_prod", npy::scalar(FAST_S)),
        ("miller_time_const_eff_it_prod", npy::scalar(FAST_S)),
        ("black_level", Entry::Whole(npy::array("<f4", &[1], &npy::float32([0.0])))),
        ("amplifier_gain", npy::scalar(1.0)),
        ("closed_loop_gain", npy::scalar(1.0 / 0.7)),
        ("output_time_const", npy::scalar(FAST_S)),
        ("lower_cutoff_freq", npy::scalar(0.0)),
        ("sf_cutoff_freq", npy::scalar(cutoff)),
        ("diff_amp_cutoff_freq", npy::scalar(cutoff)),
    ]
}

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    let far = plan.poses().map(|(_, pose)| pose.translation.abs().max_element()).fold(0.0, f64::max);
    let near = (far > MAX_POSITION).then(|| {
        let what =
            format!("a camera {far} units from the origin, wanted {MAX_POSITION} at most: poses are float32");
        UnmetNeed::new(what, "a source whose origin is near its scene")
    });
    vec![unmet_events(plan), unmet_frames(plan, MIN_FRAMES), geometry::unmet_depth(plan), near]
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = Vec::new();
    if let Some(sensor) = &plan.subject.sensor {
        let formula = BrightnessFormula::Log { offset: log_offset(sensor) };
        let factor = BrightnessFactor::between(sensor, formula);
        if !factor.is_exact() {
            let BrightnessFactor { median, p5, p95 } = factor;
            let what = format!(
                "its logarithm of encoded pictures is not the sensor's: the thresholds are {median:.3} times the sensor's, {p5:.3} to {p95:.3} by grey"
            );
            losses.push(ExportLoss::approximate("sensor.brightness", factor.spread(), what));
        }
    }
    losses.push(products(&["blur", "depth", "flow", "labels of events"]));
    losses
}

fn write(
    plan: &ExportPlan<'_>,
    circuit: Vec<(&'static str, Entry)>,
    out: &mut ExportFolder<'_>,
) -> Result<Value, ExportError> {
    let sensor = plan.sensor()?;
    let eps = log_offset(sensor);
    let [on, off] = thresholds_in(sensor, BrightnessFormula::Log { offset: eps });
    let refractory_ns = sensor.dead_us() * NS_PER_US;
    let events = write_events(plan, out)?;
    write_poses(plan, out)?;
    let own = [
        ("pos_contrast_threshold", npy::scalar(on)),
        ("neg_contrast_threshold", npy::scalar(off)),
        ("refractory_period", Entry::Whole(npy::array("<i8", &[], &refractory_ns.to_le_bytes()))),
        ("bayer_pattern", Entry::Whole(npy::text(""))),
    ];
    write_calibration(plan, own.into_iter().chain(circuit), out)?;
    let colour = [
        ("interm_color_space", Entry::Whole(npy::text("display"))),
        ("log_eps", Entry::Whole(npy::array("<f8", &[], &npy::float64([eps])))),
    ];
    npy::write_archive(&out.file("renderer_params.npz")?, colour.into())?;
    let (held_out, test) = plan.test_frames();
    // Its validation and its test read one set each; there is one set of held-out views for both.
    for (set, subject, frames) in [
        ("train", plan.subject, plan.train_frames()),
        ("val", held_out, test.clone()),
        ("test", held_out, test),
    ] {
        write_views(set, subject, &frames, out)?;
    }
    let bounds = geometry::scene_box(plan)?;
    let [low, high] = bounds.corners;
    // Keys of its YAML, because a whole configuration of the program would be its code.
    let config = json!({
        "nerf.aabb": [low.x, low.y, low.z, high.x, high.y, high.z],
        "model.min_modeled_intensity": eps,
        "contrast_threshold.freeze": true, "refractory_period.freeze": true,
        "data.alpha_over_white_bg": false,
    });
    out.write_file("config.json", format!("{config:#}").as_bytes())?;
    Ok(json!({
        "events": events, "thresholds": { "on": on, "off": off },
        "refractory_period_ns": refractory_ns, "min_modeled_intensity": eps, "box_from": bounds.basis,
        "command": "set the keys of config.json in the program's YAML, then python scripts/run.py",
    }))
}

fn write_events(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<u64, ExportError> {
    // An array of an archive is contiguous, so each column waits in a file of its own.
    let archive = out.file("raw_events.npz")?;
    let spool =
        |kind, columns, name: &str| GrowingArray::create(&archive.with_file_name(name), kind, columns);
    let mut position = spool("<u2", Some(2), "position.spool")?;
    let mut stamp = spool("<i8", None, "stamp.spool")?;
    let mut polarity = spool("|b1", None, "polarity.spool")?;
    plan.for_each_event(|event, t_us| {
        out.count_event()?;
        position.push([event.x, event.y].map(u16::to_le_bytes).as_flattened())?;
        stamp.push(&(t_us * NS_PER_US).to_le_bytes())?;
        // One byte per event: NumPy's bool.
        polarity.push(&[event.polarity as u8])
    })?;
    let events = stamp.rows();
    let entries = [("position", position), ("timestamp", stamp), ("polarity", polarity)];
    npy::write_archive(&archive, entries.map(|(name, array)| (name, Entry::Spooled(array))).into())?;
    Ok(events)
}

fn write_poses(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<(), ExportError> {
    let count = plan.pose_count() as u64;
    let positions = plan.poses().flat_map(|(_, pose)| pose.translation.to_array());
    let turns = plan.poses().flat_map(|(_, pose)| pose.rotation.to_array());
    let stamps = npy::int64(plan.poses().map(|(t_us, _)| t_us * NS_PER_US));
    let entries = vec![
        ("T_wc_position", Entry::Whole(npy::array("<f4", &[count, 3], &npy::float32(positions)))),
        ("T_wc_orientation", Entry::Whole(npy::array("<f4", &[count, 4], &npy::float32(turns)))),
        ("T_wc_timestamp", Entry::Whole(stamps)),
    ];
    npy::write_archive(&out.file("camera_poses.npz")?, entries)
}

/// Writes the calibration of the camera, and that of the sensor.
fn write_calibration(
    plan: &ExportPlan<'_>,
    sensor: impl Iterator<Item = (&'static str, Entry)>,
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let size = plan.subject.camera.size;
    let side = |side: u32| {
        // A sensor has at most 65,536 columns and rows; the loader's type holds one less.
        let side = u16::try_from(side)
            .map_err(|_| ExportError::Data(format!("pictures of {size} are too large")))?;
        Ok::<_, ExportError>(Entry::Whole(npy::array("<u2", &[], &side.to_le_bytes())))
    };
    // The loader's pixel centres are at integers.
    let rows = poses::intrinsics(plan, 0.5);
    let numbers = npy::float32(rows[..3].iter().flat_map(|row| row[..3].iter().copied()));
    let mut entries = vec![
        ("intrinsics", Entry::Whole(npy::array("<f4", &[3, 3], &numbers))),
        ("distortion_params", Entry::Whole(npy::array("<f4", &[0], &[]))),
        ("distortion_model", Entry::Whole(npy::text("plumb_bob"))),
        ("img_height", side(size.height)?),
        ("img_width", side(size.width)?),
    ];
    entries.extend(sensor);
    npy::write_archive(&out.file("camera_calibration.npz")?, entries)
}

/// The pictures of a set, and their poses with OpenGL camera axes.
fn write_views(
    set: &str,
    subject: &ExportSubject,
    frames: &[usize],
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let mut listed = Vec::new();
    for (index, pose) in frames.iter().enumerate() {
        let name = format!("{set}/{index:06}");
        out.write_file(&format!("views/{name}.png"), &subject.sharp_file(*pose)?)?;
        let rows = poses::opengl_matrix(&subject.poses.world_from_camera[*pose]);
        listed.push(json!({ "file_path": format!("./{name}"), "transform_matrix": rows }));
        out.report()?;
    }
    let camera = &subject.camera;
    let intrinsics = [[camera.fx, 0.0, camera.cx - 0.5], [0.0, camera.fy, camera.cy - 0.5], [0.0, 0.0, 1.0]];
    let text = json!({ "intrinsics": intrinsics, "bit_depth": 8, "frames": listed });
    out.write_file(&format!("views/transforms_{set}.json"), format!("{text:#}").as_bytes())
}
