//! The Gaussians that a training starts from: the points of the capture's model, and points on the
//! surfaces that its photos show.

#![expect(clippy::cast_possible_truncation, reason = "parameters are stored in 32 bits")]

use super::TrainingError;
use super::draws::TrainingDraws;
use super::nearest::neighbour_distances;
use super::photos::TrainingView;
use super::sweep::PlaneSweep;
use glam::DVec3;
use gs2e_render::shared::NEAR;
use gs2e_scene::{Gaussians, SceneScreening, sh};
use gs2e_source::colmap::ColmapPoint;
use rayon::prelude::*;

/// Least and largest number of points that are drawn, and the Gaussians of the budget per point in
/// between: a small training has no time for a long sweep.
const DRAWN: [usize; 2] = [10_000, 30_000];
const GAUSSIANS_PER_DRAWN: usize = 4;
/// Sweeps per drawn point.
const SWEEPS: u64 = 3;
/// Share of the drawn points that is enough to grow from.
const ENOUGH: usize = 100;
/// Tries per scattered point.
const TRIES: u64 = 40;
/// Smallest share of the views that see a scattered point.
const COMMON: usize = 4;
/// Smallest distance between neighbours, relative to the extent: points may coincide.
const LEAST_SPACING: f64 = 1e-6;
/// Factor on the largest distance of a camera from the cameras' mean (GitHub
/// graphdeco-inria/gaussian-splatting, `scene/dataset_readers.py`, `getNerfppNorm`).
const EXTENT_FACTOR: f64 = 1.1;
/// Largest coordinate, in extents, that 32 bits keep well without an origin.
const FAR: f64 = 100.0;

/// Positions of the cameras.
#[derive(Debug, Clone, Copy)]
pub(super) struct CameraSpread {
    /// Mean of the centres.
    pub(super) mean: DVec3,
    /// 1.1 times the largest distance from it; 1 if all cameras have one centre.
    pub(super) extent: f64,
}

impl CameraSpread {
    pub(super) fn new(views: &[TrainingView]) -> Self {
        let centres = || views.iter().map(|view| view.world_from_camera.translation);
        let mean = centres().sum::<DVec3>() / views.len() as f64;
        let farthest = centres().map(|centre| (centre - mean).length()).fold(0.0, f64::max);
        let extent = if farthest > 0.0 { EXTENT_FACTOR * farthest } else { 1.0 };
        Self { mean, extent }
    }

    /// The origin of the scene: zero unless the cameras are far from it.
    fn origin(&self) -> DVec3 {
        if self.mean.abs().max_element() <= FAR * self.extent { DVec3::ZERO } else { self.mean.round() }
    }
}

/// The first Gaussians: at most `budget`.
pub(super) fn starting_scene(
    points: &[ColmapPoint],
    views: &[TrainingView],
    budget: usize,
    draws: &TrainingDraws,
) -> Result<Gaussians, TrainingError> {
    let spread = CameraSpread::new(views);
    let sound: Vec<&ColmapPoint> = points.iter().filter(|point| point.xyz.is_finite()).collect();
    if sound.is_empty() {
        return Ok(gaussians(&drawn_points(views, &spread, drawn_count(budget), draws)?, &spread));
    }
    let is_seen = |point: &&&ColmapPoint| views.iter().any(|view| pixel_of(view, point.xyz).is_some());
    if sound.iter().find(is_seen).is_none() {
        return Err(TrainingError::PointsUnseen { points: sound.len() });
    }
    let chosen = choose(sound.len(), budget, draws);
    let mut chosen: Vec<(DVec3, [u8; 3])> =
        chosen.into_iter().map(|i| (sound[i].xyz, sound[i].rgb)).collect();
    // A model has points at corners. The sweep finds surfaces between them, where Gaussians that were
    // split off at the corners would come to rest at wrong depths.
    let more = drawn_count(budget).min(budget - chosen.len());
    chosen.extend(swept_points(views, axes_meet(views, &spread), more, draws));
    Ok(gaussians(&chosen, &spread))
}

/// Number of points that are drawn for a budget of Gaussians.
fn drawn_count(budget: usize) -> usize {
    let [least, most] = DRAWN;
    (budget / GAUSSIANS_PER_DRAWN).clamp(least, most).min(budget)
}

/// `wanted` of `count` indices, each equally likely, ascending; all if there are no more.
fn choose(count: usize, wanted: usize, draws: &TrainingDraws) -> Vec<usize> {
    let mut all: Vec<usize> = (0..count).collect();
    if wanted < count {
        let mut draws = draws.start(0);
        for i in 0..wanted {
            all.swap(i, i + draws.index(count - i));
        }
        all.truncate(wanted);
        all.sort_unstable();
    }
    all
}

/// The pixel at which a view sees a point.
fn pixel_of(view: &TrainingView, point: DVec3) -> Option<[usize; 2]> {
    let (at, _) = view.at_level(0);
    let in_camera = at.world_from_camera.inverse();
    let seen = in_camera.rotation * point + in_camera.translation;
    if seen.z <= f64::from(NEAR) {
        return None;
    }
    let [x, y] = at.camera.project(seen)?;
    let size = at.camera.size;
    let inside = (0.0..f64::from(size.width)).contains(&x) && (0.0..f64::from(size.height)).contains(&y);
    #[expect(clippy::cast_sign_loss, reason = "inside the image")]
    inside.then_some([x as usize, y as usize])
}

/// Points on the surfaces that the photos show: `wanted` at most, where [`scattered_points`] help
/// out if a sweep finds too few.
fn drawn_points(
    views: &[TrainingView],
    spread: &CameraSpread,
    wanted: usize,
    draws: &TrainingDraws,
) -> Result<Vec<(DVec3, [u8; 3])>, TrainingError> {
    let middle = axes_meet(views, spread);
    let mut points = swept_points(views, middle, wanted, draws);
    if points.len() * ENOUGH < wanted {
        points.extend(scattered_points(views, middle, wanted, draws));
    }
    points.truncate(wanted);
    if points.len() * ENOUGH < wanted {
        Err(TrainingError::NoCommonView { views: views.len() })
    } else {
        Ok(points)
    }
}

/// Points on the surfaces that a [`PlaneSweep`] finds for random pixels, `wanted` at most.
fn swept_points(
    views: &[TrainingView],
    middle: DVec3,
    wanted: usize,
    draws: &TrainingDraws,
) -> Vec<(DVec3, [u8; 3])> {
    let sweep = PlaneSweep::new(views, middle);
    let surface_point = |index: u64| {
        // Index 0 belongs to the choice among given points.
        let mut draw = draws.start(1 + index);
        let view = draw.index(views.len());
        sweep.surface_point(view, [draw.uniform(), draw.uniform()])
    };
    let mut points: Vec<(DVec3, [u8; 3])> = Vec::with_capacity(2 * wanted);
    for round in 0..SWEEPS {
        // A round has a fixed set of draws, so the points are the same with any number of threads.
        let draws = (round * wanted as u64..(round + 1) * wanted as u64).into_par_iter();
        points.par_extend(draws.filter_map(surface_point));
        if points.len() >= wanted {
            break;
        }
    }
    points.truncate(wanted);
    points
}

/// Points drawn along the rays of random pixels, at depths around that at which the optical axes
/// meet. Those that too few views see are dropped; the others have the colour of their pixel.
fn scattered_points(
    views: &[TrainingView],
    middle: DVec3,
    wanted: usize,
    draws: &TrainingDraws,
) -> Vec<(DVec3, [u8; 3])> {
    let least = (views.len() / COMMON).clamp(2, views.len());
    // After the indices of the sweeps, so that no draw is used twice.
    let first = wanted as u64 * SWEEPS;
    let mut points = Vec::with_capacity(wanted);
    for index in first..first + wanted as u64 * TRIES {
        if points.len() == wanted {
            break;
        }
        let mut draw = draws.start(1 + index);
        let view = &views[draw.index(views.len())];
        let (at, photo) = view.at_level(0);
        let size = at.camera.size;
        let [x, y] = [draw.uniform() * f64::from(size.width), draw.uniform() * f64::from(size.height)];
        let pose = at.world_from_camera;
        let typical = (middle - pose.translation).length();
        // From a third to three times the typical depth, each ratio equally likely.
        let depth = typical * libm::pow(9.0, draw.uniform() - 0.5);
        let point = pose.rotation * at.camera.unproject([x, y], depth) + pose.translation;
        if views.iter().filter(|view| pixel_of(view, point).is_some()).count() >= least {
            #[expect(clippy::cast_sign_loss, reason = "inside the image")]
            let pixel = y as usize * size.width as usize + x as usize;
            points.push((point, photo.colours.pixels()[pixel]));
        }
    }
    points
}

/// The point nearest to all optical axes, by least squares; one extent in front of the first camera
/// if the axes are parallel or meet behind it.
fn axes_meet(views: &[TrainingView], spread: &CameraSpread) -> DVec3 {
    let (mut across, mut sum) = (glam::DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let pose = view.world_from_camera;
        let axis = pose.rotation * DVec3::Z;
        // Projection across the axis.
        let part =
            glam::DMat3::IDENTITY - glam::DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        across += part;
        // Relative to the cameras' mean: far from the world's origin, the solution would lose digits.
        sum += part * (pose.translation - spread.mean);
    }
    let first = views[0].world_from_camera;
    let ahead = first.rotation * DVec3::Z;
    // The determinant vanishes for parallel axes: relative to that of axes in all directions.
    let meets = across.determinant().abs() > 1e-6 * (views.len() as f64).powi(3);
    let found =
        if meets { spread.mean + across.inverse() * sum } else { first.translation + ahead * spread.extent };
    if (found - first.translation).dot(ahead) > 0.0 {
        found
    } else {
        first.translation + ahead * spread.extent
    }
}

/// Round Gaussians at these points: as wide as the distance to their neighbours, half transparent.
fn gaussians(points: &[(DVec3, [u8; 3])], spread: &CameraSpread) -> Gaussians {
    let origin = spread.origin();
    let positions: Vec<[f32; 3]> =
        points.iter().map(|(point, _)| (*point - origin).as_vec3().to_array()).collect();
    let least = LEAST_SPACING * spread.extent;
    let log_scale = |square: f64| {
        // A single point has no neighbour, and no distance.
        let distance = if square.is_nan() { 0.01 * spread.extent } else { square.sqrt() };
        [libm::log(distance.max(least)) as f32; 3]
    };
    let colour = |rgb: [u8; 3]| rgb.map(|v| ((f64::from(v) / 255.0 - 0.5) / sh::C0) as f32);
    let functions = sh::function_count(sh::MAX_DEGREE);
    let mut harmonics = vec![[0.0; 3]; points.len() * functions];
    for (own, (_, rgb)) in harmonics.chunks_exact_mut(functions).zip(points) {
        own[0] = colour(*rgb);
    }
    Gaussians {
        origin,
        log_scales: neighbour_distances(&positions).into_iter().map(log_scale).collect(),
        positions,
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; points.len()],
        opacity_logits: vec![0.0; points.len()],
        sh: harmonics,
        sh_degree: sh::MAX_DEGREE,
        antialiased: None,
        screening: SceneScreening { read: points.len() as u64, ..SceneScreening::default() },
        motion: None,
    }
}
