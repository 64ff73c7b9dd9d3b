//! EvDeblurNeRF (Cannici and Scaramuzza, CVPR 2024; GitHub uzh-rpg/EvDeblurNeRF at 4111020), and the LLFF
//! layout alone, which the methods for blurred pictures read.
//!
//! | file | content |
//! |---|---|
//! | `images_1/NNNN.png` | blurred pictures; each N-th is sharp and held out, from the first on |
//! | `images_1/timestamps.npz` | `timestamps`, `timestamps_start`, `timestamps_end`, us |
//! | `poses_bounds.npy` | float64 (F, 17): LLFF rows, axes down, right and back |
//! | `all_poses_bounds.npy`, `all_timestamps.npy` | the same of all poses |
//! | `events.h5` | `x`, `y` uint16; `t` int64 us; `p` uint8, 1 for ON |
//! | `config.txt` | options of the program |
//!
//! Traps of its loader: a picture counts as sharp if its exposure starts when it ends; a blurred picture
//! needs a start above 0; held-out pictures have to be sharp.
//!
//! `llff` has the pictures and `poses_bounds.npy`, with sharp frames if the release has no blurred ones.

use super::camera_needs::{
    centred_camera, products, thresholds, unmet_events, unmet_exposures, unmet_frames, unmet_held_out_views,
};
use crate::brightness::{BrightnessFormula, thresholds_in};
use crate::hdf5::{GrowingColumn, Hdf5File};
use crate::npy::Entry;
use crate::{
    ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, Exposure, TestViews, UnmetNeed,
    geometry, npy, poses,
};
use glam::DVec3;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_tree::PictureKind;
use serde_json::{Value, json};

/// The layout of EvDeblurNeRF.
pub(super) static EVDEBLURNERF: ExportFormat = ExportFormat::new(
    "evdeblurnerf",
    "github.com/uzh-rpg/EvDeblurNeRF at 4111020",
    evdeblurnerf_unmet,
    evdeblurnerf_losses,
    write_evdeblurnerf,
);

/// The layout of LLFF.
pub(super) static LLFF: ExportFormat = ExportFormat::new(
    "llff",
    "github.com/uzh-rpg/EvDeblurNeRF at 4111020, without its events",
    llff_unmet,
    llff_losses,
    write_llff,
);

/// Its logarithm is that of linear light, and pictures have a gamma of 2.2.
const FORMULA: BrightnessFormula = BrightnessFormula::Gamma { offset: 1e-5 };
/// Added to all times, so that no exposure starts at 0, us.
const SHIFT_US: i64 = 1000;
/// One held-out picture, and two to learn from.
const MIN_PICTURES: usize = 3;
/// Largest angle of an optical axis to the mean of all for cameras that look one way: the projection of NDC
/// has no place for content beside the camera. The cosine of 45 degrees.
const ONE_WAY: f64 = std::f64::consts::FRAC_1_SQRT_2;

fn evdeblurnerf_unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![
        unmet_events(plan),
        unmet_exposures(plan, MIN_PICTURES),
        unmet_held_out_views(plan),
        geometry::unmet_depth(plan),
    ]
}

fn evdeblurnerf_losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = losses(plan);
    losses.extend(thresholds(plan, FORMULA, false));
    losses.push(products(&["sharp frames between the held-out ones", "depth", "flow", "labels of events"]));
    losses
}

fn write_evdeblurnerf(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let pictures = pictures(plan);
    write_pictures(plan, &pictures, out)?;
    write_stamps(&pictures, out)?;
    let bounds = geometry::scene_box(plan)?;
    let at = |picture: &Picture| plan.subject.poses.world_from_camera[picture.pose];
    let (camera, depth) = (&plan.subject.camera, bounds.depth);
    out.write_file("poses_bounds.npy", &llff_rows(camera, depth, pictures.iter().map(at)))?;
    let all = llff_rows(camera, depth, plan.poses().map(|(_, pose)| pose));
    out.write_file("all_poses_bounds.npy", &all)?;
    out.write_file("all_timestamps.npy", &npy::int64(plan.poses().map(|(t_us, _)| t_us + SHIFT_US)))?;
    let events = write_events(plan, out)?;
    let [on, off] = thresholds_in(plan.sensor()?, FORMULA);
    let text = format!(
        "datadir = DIR\nfactor = 1\nllffhold = {}\n{}events_threshold_pos = {on}\nevents_threshold_neg = {off}\n\
         events_tms_unit = us\nevents_tms_files_unit = us\n",
        held_out_every(plan),
        projection(plan)
    );
    out.write_file("config.txt", text.as_bytes())?;
    Ok(json!({
        "events": events, "pictures": pictures.len(), "thresholds": { "on": on, "off": off },
        "times_shifted_us": SHIFT_US, "near": bounds.depth[0], "far": bounds.depth[1], "bounds_from": bounds.basis,
        "command": "python train.py --config config.txt",
    }))
}

fn llff_unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    let few = if plan.exposures().is_empty() {
        unmet_frames(plan, MIN_PICTURES)
    } else {
        unmet_exposures(plan, MIN_PICTURES)
    };
    vec![few, unmet_held_out_views(plan), geometry::unmet_depth(plan)]
}

fn llff_losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = losses(plan);
    losses.push(products(&["events", "depth", "flow", "times"]));
    losses
}

fn write_llff(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let pictures = pictures(plan);
    write_pictures(plan, &pictures, out)?;
    for index in 0..pictures.len() {
        // Without a factor in its options, a loader reads this folder.
        out.repeat(&format!("images_1/{index:04}.png"), &format!("images/{index:04}.png"))?;
    }
    let bounds = geometry::scene_box(plan)?;
    let at = |picture: &Picture| plan.subject.poses.world_from_camera[picture.pose];
    let rows = llff_rows(&plan.subject.camera, bounds.depth, pictures.iter().map(at));
    out.write_file("poses_bounds.npy", &rows)?;
    Ok(json!({
        "pictures": pictures.len(), "blurred": pictures.iter().filter(|picture| picture.is_blurred()).count(),
        "llffhold": held_out_every(plan), "near": bounds.depth[0], "far": bounds.depth[1],
        "bounds_from": bounds.basis, "options": projection(plan).lines().collect::<Vec<_>>(),
    }))
}

/// A picture of the layout.
#[derive(Debug, Clone, Copy)]
struct Picture {
    /// The pose in the middle of its exposure.
    pose: usize,
    /// Stamp of that pose, us from the start of the interval.
    t_us: i64,
    /// The exposure; of no length if it is sharp.
    open_us: [i64; 2],
}

impl Picture {
    fn is_blurred(&self) -> bool {
        self.open_us[0] < self.open_us[1]
    }
}

/// The blurred pictures, with a sharp one in place of every N-th; without blurred ones, the sharp frames.
fn pictures(plan: &ExportPlan<'_>) -> Vec<Picture> {
    let sharp = |pose: usize| {
        let t_us = plan.stamp_us(pose);
        Picture { pose, t_us, open_us: [t_us; 2] }
    };
    let exposures = plan.exposures();
    if exposures.is_empty() {
        return plan.frames.iter().copied().map(sharp).collect();
    }
    let every = held_out_every(plan);
    let picture = |(index, exposure): (usize, &Exposure)| {
        if index % every == 0 {
            return sharp(exposure.pose);
        }
        Picture { pose: exposure.pose, t_us: plan.stamp_us(exposure.pose), open_us: exposure.open_us }
    };
    exposures.iter().enumerate().map(picture).collect()
}

/// Every how many pictures one is held out.
fn held_out_every(plan: &ExportPlan<'_>) -> usize {
    match plan.test {
        TestViews::Every(every) => (*every).max(1),
        // `unmet_held_out_views` has refused such a plan before anything is written.
        TestViews::From(_) => 1,
    }
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = centred_camera(plan, 0.5, true);
    let what = "near and far in poses_bounds.npy follow from the points seen, the same for all pictures";
    losses.push(ExportLoss::derived("geometry", what));
    losses
}

/// Options for cameras that look around; none for those that look one way.
fn projection(plan: &ExportPlan<'_>) -> &'static str {
    let axes = plan.poses().map(|(_, pose)| pose.rotation * DVec3::Z);
    let mean = axes.clone().sum::<DVec3>().normalize_or_zero();
    if axes.clone().all(|axis| axis.dot(mean) > ONE_WAY) { "" } else { "no_ndc = True\nspherify = True\n" }
}

fn write_pictures(
    plan: &ExportPlan<'_>,
    pictures: &[Picture],
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    for (index, picture) in pictures.iter().enumerate() {
        let kind = if picture.is_blurred() { PictureKind::Blur } else { PictureKind::Sharp };
        let file = plan.subject.tree.picture(kind, picture.pose)?;
        out.write_file(&format!("images_1/{index:04}.png"), &file)?;
        out.report()?;
    }
    Ok(())
}

fn write_stamps(pictures: &[Picture], out: &mut ExportFolder<'_>) -> Result<(), ExportError> {
    let stamps = |of: &dyn Fn(&Picture) -> i64| {
        Entry::Whole(npy::int64(pictures.iter().map(|picture| of(picture) + SHIFT_US)))
    };
    let entries = vec![
        ("timestamps", stamps(&|picture| picture.t_us)),
        ("timestamps_start", stamps(&|picture| picture.open_us[0])),
        ("timestamps_end", stamps(&|picture| picture.open_us[1])),
    ];
    npy::write_archive(&out.file("images_1/timestamps.npz")?, entries)
}

/// LLFF rows with these bounds, as a file.
fn llff_rows(camera: &Camera, depth: [f64; 2], poses: impl Iterator<Item = Se3>) -> Vec<u8> {
    let rows: Vec<[f64; 17]> = poses.map(|pose| poses::llff_row(camera, &pose, depth)).collect();
    npy::array("<f8", &[rows.len() as u64, 17], &npy::float64(rows.into_iter().flatten()))
}

fn write_events(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<u64, ExportError> {
    let file = Hdf5File::create(&out.file("events.h5")?)?;
    let root = file.root();
    let mut x = GrowingColumn::create::<u16>(&file, &root, "x")?;
    let mut y = GrowingColumn::create::<u16>(&file, &root, "y")?;
    let mut t = GrowingColumn::create::<i64>(&file, &root, "t")?;
    let mut p = GrowingColumn::create::<u8>(&file, &root, "p")?;
    let mut events = 0;
    plan.for_each_event(|event, t_us| {
        x.push(&event.x.to_le_bytes())?;
        y.push(&event.y.to_le_bytes())?;
        t.push(&(t_us + SHIFT_US).to_le_bytes())?;
        p.push(&[event.polarity as u8])?;
        events += 1;
        out.count_event()
    })?;
    [x, y, t, p].into_iter().try_for_each(GrowingColumn::finish)?;
    file.close()?;
    Ok(events)
}
