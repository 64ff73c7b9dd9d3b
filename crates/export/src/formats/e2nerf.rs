//! E2NeRF (Qi et al., ICCV 2023; GitHub iCVTEAM/E2NeRF at 487fec1), its branch for synthetic scenes, and E2GS
//! (Deguchi et al., ICIP 2024; GitHub deguchihiroyuki/E2GS at 2d768e3).
//!
//! | file | content |
//! |---|---|
//! | `events.pt` | float32 (views, 4, H W): signed counts between the five poses of each exposure |
//! | `transform_train.json` | two equal entries per view; `transform_matrix` is a list of 18 poses, OpenGL axes |
//! | `transform_test.json` | one entry per view, whose `transform_matrix[1]` is the pose |
//! | `train/r_0.png`, `r_2.png`, … | blurred pictures |
//! | `test/r_0.png`, `r_1.png`, … | sharp pictures |
//!
//! E2GS also reads `sparse/0/points3D.bin`, and its test views are two entries per view with lists of 18
//! poses. The size, the number of views and the bounds are not in its code.
//!
//! The poses are the entries 1, 5, 9, 13 and 17 of a list, from the opening of the shutter to its closing.
//! Traps: every second entry is read; an entry 0 is skipped; the size, the number of views, near, far and the
//! thresholds are in its code.

use super::camera_needs::{
    centred_camera, products, thresholds, unmet_events, unmet_exposures, unmet_frames,
};
use super::event_3dgs;
use super::marks::event_sign;
use crate::brightness::{BrightnessFormula, thresholds_in};
use crate::geometry::{SceneBox, Similarity};
use crate::tensor::TensorWriter;
use crate::{
    ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, Exposure, TestViews, UnmetNeed,
    geometry, poses,
};
use glam::DVec3;
use gs2e_image::{Size, srgb};
use gs2e_sensor::WHITE;
use gs2e_tree::PictureKind;
use serde_json::{Value, json};

/// The layout of E2NeRF.
pub(super) static E2NERF: ExportFormat = ExportFormat::new(
    "e2nerf",
    "github.com/iCVTEAM/E2NeRF at 487fec1",
    e2nerf_unmet,
    e2nerf_losses,
    write_e2nerf,
);

/// The layout of E2GS.
pub(super) static E2GS: ExportFormat = ExportFormat::new(
    "e2gs",
    "github.com/deguchihiroyuki/E2GS at 2d768e3",
    e2gs_unmet,
    e2gs_losses,
    write_e2gs,
);

const FORMULA: BrightnessFormula = BrightnessFormula::LinLog;
/// The size, the number of views and the bounds in the code of E2NeRF, and the thresholds in that of both.
const SIZE: Size = Size { width: 800, height: 800 };
const VIEWS: usize = 100;
const BOUNDS: [f64; 2] = [2.0, 6.0];
const THRESHOLDS: [f64; 2] = [0.3, 0.2];
/// Number of stretches of an exposure.
const STRETCHES: i64 = 4;
/// Steps from the opening of the shutter to its closing, in the list of poses.
const STEPS: u32 = 16;
/// Relative difference of thresholds below which they count as equal.
const SAME_THRESHOLD: f64 = 0.01;

fn e2nerf_unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![
        unmet_events(plan),
        unmet_exposures(plan, 1),
        // One between two exposures at least, or of another trajectory.
        unmet_frames(plan, 2),
        geometry::unmet_depth(plan),
    ]
}

fn e2nerf_losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = centred_camera(plan, 0.0, true);
    losses.extend(numbers_in_code(plan));
    losses.extend(losses_of_both(plan));
    losses
}

fn write_e2nerf(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let exposures = plan.exposures();
    let bounds = geometry::scene_box(plan)?;
    let similarity = scale_to_bounds(&bounds);
    let events = write_counts(plan, &exposures, out)?;
    write_train(plan, &exposures, similarity, out)?;
    let test = write_test(plan, &exposures, similarity, TestEntries::One, out)?;
    let fits = bounds.depth.map(|depth| depth * similarity.scale);
    Ok(json!({
        "events": events, "views": exposures.len(), "test_views": test,
        "thresholds_in_code": { "on": THRESHOLDS[0], "off": THRESHOLDS[1] },
        "similarity": similarity.facts(),
        "near": fits[0], "far": fits[1], "bounds_from": bounds.basis,
        "command": "python run_nerf_exp.py --dataset_type blender --datadir DIR",
    }))
}

fn e2gs_unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_events(plan), unmet_exposures(plan, 1), unmet_frames(plan, 2), event_3dgs::unmet_points(plan)]
}

fn e2gs_losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = centred_camera(plan, 0.5, true);
    losses.extend(losses_of_both(plan));
    losses.push(ExportLoss::derived("points", "lifted from depth"));
    losses
}

fn write_e2gs(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let exposures = plan.exposures();
    let events = write_counts(plan, &exposures, out)?;
    // Nothing in its code bounds the depths, so the points and the poses stay where they are.
    let similarity = Similarity { origin: DVec3::ZERO, scale: 1.0 };
    write_train(plan, &exposures, similarity, out)?;
    let test = write_test(plan, &exposures, similarity, TestEntries::TwoLists, out)?;
    let middles: Vec<usize> = exposures.iter().map(|exposure| exposure.pose).collect();
    let points = event_3dgs::write_model_files(plan, &middles, out)?;
    Ok(json!({
        "events": events, "views": exposures.len(), "test_views": test, "points": points,
        "thresholds_in_code": { "on": THRESHOLDS[0], "off": THRESHOLDS[1] },
        "command": "python train_BlurAndEvent.py -s DIR --eval",
    }))
}

/// Losses of both programs.
fn losses_of_both(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses: Vec<ExportLoss> = thresholds_in_code(plan).into_iter().collect();
    losses
        .extend(thresholds(plan, FORMULA, true).into_iter().filter(|loss| loss.field != "sensor.threshold"));
    losses.extend(plan.subject.blur_mean.is_linear().then(encoded_mean));
    losses
        .push(ExportLoss::lost("events", "times within a quarter of an exposure; events between exposures"));
    losses.push(ExportLoss::derived("poses", "17 poses of each exposure, between those of the release"));
    losses.push(products(&["depth", "flow", "labels of events"]));
    losses
}

/// Losses by the size, the number of views and the bounds in the code of E2NeRF.
fn numbers_in_code(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = Vec::new();
    let size = plan.subject.camera.size;
    if size != SIZE {
        let other = f64::from(size.width.abs_diff(SIZE.width) + size.height.abs_diff(SIZE.height));
        let what = format!("pictures of {size}: the program has {SIZE} in its code, two numbers to edit");
        losses.push(ExportLoss::approximate("camera.size", other, what));
    }
    let views = plan.exposures().len();
    if views != VIEWS {
        let what =
            format!("{views} blurred pictures: the program has {VIEWS} in its code, one number to edit");
        losses.push(ExportLoss::approximate("blur.count", views.abs_diff(VIEWS) as f64, what));
    }
    let ratio = BOUNDS[1] / BOUNDS[0];
    if let Some([near, far]) = plan.subject.depth_range.filter(|[near, far]| far / near > ratio) {
        let what = format!(
            "depths of {near} to {far} units: no scale moves them into the {} to {} of the program's code",
            BOUNDS[0], BOUNDS[1]
        );
        losses.push(ExportLoss::approximate("geometry", far / near / ratio, what));
    }
    losses
}

/// The loss by the thresholds in the code of both programs.
fn thresholds_in_code(plan: &ExportPlan<'_>) -> Option<ExportLoss> {
    let sensor = plan.subject.sensor.as_ref()?;
    let own = thresholds_in(sensor, FORMULA);
    let apart = own.iter().zip(THRESHOLDS).map(|(own, code)| (own / code - 1.0).abs()).fold(0.0, f64::max);
    let [on, off] = THRESHOLDS;
    let what = format!(
        "thresholds of {:.3} (ON) and {:.3} (OFF) in its formula: the program has {on} and {off} in its code",
        own[0], own[1]
    );
    (apart > SAME_THRESHOLD).then(|| ExportLoss::approximate("sensor.threshold", apart, what))
}

/// The loss of a mean in linear light: the program takes the mean of encoded pictures.
fn encoded_mean() -> ExportLoss {
    // The largest difference is at an edge between black and white that covers a pixel for some share.
    let apart = (0..=1000).map(|share| f64::from(share) / 1000.0).map(|share| srgb::encode(share) - share);
    let most = apart.fold(0.0, f64::max) * WHITE;
    let what = format!(
        "a blurred picture is a mean in linear light, and the program takes the mean of five encoded pictures: up to \
         {most:.0} greys apart at an edge between black and white, less at lower contrast; blur: {{ mean: encoded }} \
         is exact"
    );
    ExportLoss::approximate("blur.light", most, what)
}

/// Origin and factor that move the depths into the bounds of the program.
fn scale_to_bounds(bounds: &SceneBox) -> Similarity {
    // The geometric middle of the depths goes to that of the bounds.
    let middle = |[near, far]: [f64; 2]| (near * far).sqrt();
    Similarity { origin: bounds.centre, scale: middle(BOUNDS) / middle(bounds.depth) }
}

/// The signed counts of the exposures. Those of one exposure are in memory at a time.
struct Counts<'a> {
    tensor: TensorWriter,
    exposures: &'a [Exposure],
    /// The exposure that is counted.
    view: usize,
    counts: Vec<f32>,
}

impl Counts<'_> {
    /// Counts an event at `t_us`. It belongs to the stretch that starts before it and ends at it or later.
    fn add(&mut self, at: usize, t_us: i64, sign: f32) -> Result<bool, ExportError> {
        // Events and exposures are both sorted by time, so an exposure that has ended gets no further event.
        while self.exposures.get(self.view).is_some_and(|exposure| exposure.open_us[1] < t_us) {
            self.store()?;
        }
        let Some(exposure) = self.exposures.get(self.view) else { return Ok(false) };
        let [start, end] = exposure.open_us;
        if t_us <= start {
            return Ok(false);
        }
        // The ends of the stretches are fractions of a microsecond.
        let stretch = ((t_us - start) * STRETCHES - 1) / (end - start);
        let pixels = self.counts.len() / 4;
        self.counts[usize::try_from(stretch).unwrap_or(0) * pixels + at] += sign;
        Ok(true)
    }

    /// Writes the counts of an exposure, and starts with the next one.
    fn store(&mut self) -> Result<(), ExportError> {
        self.tensor.push(&self.counts)?;
        self.counts.fill(0.0);
        self.view += 1;
        Ok(())
    }
}

fn write_counts(
    plan: &ExportPlan<'_>,
    exposures: &[Exposure],
    out: &mut ExportFolder<'_>,
) -> Result<u64, ExportError> {
    let size = plan.subject.camera.size;
    let shape = [exposures.len() as u64, 4, size.pixels() as u64];
    let tensor = TensorWriter::create(&out.file("events.pt")?, shape)?;
    let mut counts = Counts { tensor, exposures, view: 0, counts: vec![0.0; 4 * size.pixels()] };
    let mut events = 0;
    plan.for_each_event(|event, t_us| {
        let at = usize::from(event.y) * size.width as usize + usize::from(event.x);
        let sign = event_sign(event);
        events += u64::from(counts.add(at, t_us, sign)?);
        out.count_event()
    })?;
    // The shape is written already, so exposures after the last event need their zeros.
    while counts.view < exposures.len() {
        counts.store()?;
    }
    counts.tensor.finish()?;
    Ok(events)
}

fn write_train(
    plan: &ExportPlan<'_>,
    exposures: &[Exposure],
    similarity: Similarity,
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let mut entries = Vec::new();
    for (view, exposure) in exposures.iter().enumerate() {
        let [start, end] = exposure.open_us.map(|t_us| t_us as f64);
        let pose = |step: u32| {
            let t_us = start + (end - start) * f64::from(step) / f64::from(STEPS);
            poses::opengl_matrix(&similarity.moved(&poses::pose_at(plan, t_us)))
        };
        // The entry before the first of the program is not read.
        let listed: Vec<_> = [0].into_iter().chain(0..=STEPS).map(pose).collect();
        for number in [2 * view, 2 * view + 1] {
            entries.push(json!({ "file_path": format!("./train/r_{number}"), "transform_matrix": listed }));
        }
        let file = plan.subject.tree.picture(PictureKind::Blur, exposure.pose)?;
        out.write_file(&format!("train/r_{}.png", 2 * view), &file)?;
        out.report()?;
    }
    write_transforms(plan, "transform_train.json", &entries, out)
}

/// Entries per test view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TestEntries {
    /// One, whose second pose is the view.
    One,
    /// Two, each with as many poses as a view for training, which are all equal.
    TwoLists,
}

/// The sharp frames outside of all exposures, or those of another trajectory; without any, the held-out ones.
fn write_test(
    plan: &ExportPlan<'_>,
    exposures: &[Exposure],
    similarity: Similarity,
    form: TestEntries,
    out: &mut ExportFolder<'_>,
) -> Result<usize, ExportError> {
    let exposed = |frame: &usize| exposures.iter().any(|exposure| exposure.pose == *frame);
    let (subject, mut frames) = plan.test_frames();
    if matches!(plan.test, TestViews::Every(_)) {
        let between: Vec<usize> = plan.frames.iter().copied().filter(|frame| !exposed(frame)).collect();
        frames = if between.is_empty() { frames } else { between };
    }
    let mut entries = Vec::new();
    for (view, frame) in frames.iter().enumerate() {
        let matrix = poses::opengl_matrix(&similarity.moved(&subject.poses.world_from_camera[*frame]));
        let (copies, poses) = match form {
            TestEntries::One => (1, 2),
            TestEntries::TwoLists => (2, STEPS as usize + 2),
        };
        let listed = vec![matrix; poses];
        let entry = json!({ "file_path": format!("./test/r_{view}"), "transform_matrix": listed });
        entries.extend(vec![entry; copies]);
        out.write_file(&format!("test/r_{view}.png"), &subject.sharp_file(*frame)?)?;
    }
    write_transforms(plan, "transform_test.json", &entries, out)?;
    Ok(frames.len())
}

fn write_transforms(
    plan: &ExportPlan<'_>,
    name: &str,
    entries: &[Value],
    out: &mut ExportFolder<'_>,
) -> Result<(), ExportError> {
    let camera = &plan.subject.camera;
    let angle = 2.0 * libm::atan(f64::from(camera.size.width) / 2.0 / camera.fx);
    let text = json!({ "camera_angle_x": angle, "frames": entries }).to_string();
    out.write_file(name, text.as_bytes())
}
