//! The extent of a scene: points that the trajectory sees, and a box around them.

use super::{ExportError, ExportPlan, UnmetNeed};
use glam::DVec3;
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_source::colmap::ColmapPoint;
use serde_json::{Value, json};

/// Number of frames whose depth is lifted.
const FRAMES: usize = 8;
/// Largest step between lifted pixels.
const STEP: u32 = 8;
/// Number of pixels of a frame that are lifted at least, if it has so many.
const PER_FRAME: u32 = 600;
/// Percentiles of the points that bound a box, per 1,000: a robust box of what is seen.
const BOUNDS: [usize; 2] = [1, 999];

/// The points and cameras of an export.
#[derive(Debug, Clone)]
pub(super) struct SceneBox {
    /// Middle of the points.
    pub(super) centre: DVec3,
    /// Corners of the box of points and cameras.
    pub(super) corners: [DVec3; 2],
    /// Percentiles 0.1 and 99.9 of the distances along the optical axes, units.
    pub(super) depth: [f64; 2],
    /// Basis of the box: `depth` or `statistics`.
    pub(super) basis: &'static str,
}

/// A similarity that moves a scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Similarity {
    /// The point that it moves to 0.
    pub(super) origin: DVec3,
    /// Lengths after it per length before.
    pub(super) scale: f64,
}

impl Similarity {
    pub(super) fn moved(&self, pose: &Se3) -> Se3 {
        Se3 { rotation: pose.rotation, translation: (pose.translation - self.origin) * self.scale }
    }

    /// Its numbers, for `export.json`.
    pub(super) fn facts(&self) -> Value {
        json!({ "origin": self.origin.to_array(), "scale": self.scale })
    }
}

/// The need for depth, if the release has neither depth nor statistics of it.
pub(super) fn unmet_depth(plan: &ExportPlan<'_>) -> Option<UnmetNeed> {
    let known = !plan.subject.depth.is_empty() || plan.subject.depth_range.is_some();
    (!known).then(|| UnmetNeed::new("the extent of the scene is unknown", "outputs: [events, sharp, depth]"))
}

/// Points of the scene, lifted from the depth of some frames through the pixel centres, with the
/// colours of their sharp pictures. Empty without depth.
pub(super) fn lifted_points(plan: &ExportPlan<'_>) -> Result<(Vec<ColmapPoint>, Vec<f64>), ExportError> {
    let subject = plan.subject;
    let (mut points, mut depths) = (Vec::new(), Vec::new());
    let spread = subject.depth.len().div_ceil(FRAMES).max(1);
    let step = lattice(subject.camera.size);
    for pose in subject.depth.iter().copied().step_by(spread) {
        let depth = subject.depth_picture(pose)?;
        // Grey points serve a trainer too; it learns their colours.
        let picture = subject.sharp.contains(&pose).then(|| subject.sharp_picture(pose)).transpose()?;
        let world_from_camera = subject.poses.world_from_camera[pose];
        let Size { width, height } = depth.size();
        for (y, x) in (0..height).step_by(step).flat_map(|y| (0..width).step_by(step).map(move |x| (y, x))) {
            let at = y as usize * width as usize + x as usize;
            let z = f64::from(depth.pixels()[at]);
            if z.is_nan() {
                continue;
            }
            // Depth belongs to the middle of a pixel.
            let own = subject.camera.unproject([f64::from(x) + 0.5, f64::from(y) + 0.5], z);
            let rgb = picture.as_ref().map_or([128; 3], |picture| picture.pixels()[at]);
            let xyz = world_from_camera.rotation * own + world_from_camera.translation;
            points.push(ColmapPoint { xyz, rgb, error: 0.0 });
            depths.push(z);
        }
    }
    Ok((points, depths))
}

/// Distance between lifted pixels: small pictures would have too few points with the largest.
fn lattice(size: Size) -> usize {
    (1..=STEP).rev().find(|s| (size.width / s) * (size.height / s) >= PER_FRAME).unwrap_or(1) as usize
}

/// The extent of the scene.
pub(super) fn scene_box(plan: &ExportPlan<'_>) -> Result<SceneBox, ExportError> {
    let (points, mut depth) = lifted_points(plan)?;
    let (places, basis): (Vec<DVec3>, _) = match plan.subject.depth_range {
        _ if !points.is_empty() => (points.iter().map(|point| point.xyz).collect(), "depth"),
        Some([near, far]) => {
            // Percentiles 5 and 95 leave out a tenth of what is seen.
            depth = vec![near / 2.0, far * 2.0];
            (frustum_corners(plan, &depth), "statistics")
        }
        None => return Err(ExportError::Data("the extent of the scene is unknown".to_owned())),
    };
    depth.sort_by(f64::total_cmp);
    let cameras: Vec<DVec3> = plan.poses().map(|(_, pose)| pose.translation).collect();
    let axes = [0, 1, 2].map(|axis| {
        let mut along: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        along.sort_by(f64::total_cmp);
        let reach = cameras.iter().map(|camera| camera[axis]);
        let (low, high) = reach.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        [quantile(&along, BOUNDS[0]).min(low), quantile(&along, 500), quantile(&along, BOUNDS[1]).max(high)]
    });
    let corner = |k: usize| DVec3::from_array(axes.map(|axis| axis[k]));
    Ok(SceneBox {
        centre: corner(1),
        corners: [corner(0), corner(2)],
        depth: [quantile(&depth, BOUNDS[0]), quantile(&depth, BOUNDS[1])],
        basis,
    })
}

/// A sorted list at a share of 1,000.
fn quantile(sorted: &[f64], share: usize) -> f64 {
    sorted[(sorted.len() - 1) * share / 1000]
}

/// Corners of the first and the last picture at these distances.
fn frustum_corners(plan: &ExportPlan<'_>, depths: &[f64]) -> Vec<DVec3> {
    let camera = &plan.subject.camera;
    let [w, h] = [camera.size.width, camera.size.height].map(f64::from);
    let ends: Vec<_> = plan.poses().map(|(_, pose)| pose).collect();
    let mut corners = Vec::new();
    for pose in [ends[0], ends[ends.len() - 1]] {
        for (pixel, z) in
            [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]].iter().flat_map(|p| depths.iter().map(move |z| (p, z)))
        {
            corners.push(pose.rotation * camera.unproject(*pixel, *z) + pose.translation);
        }
    }
    corners
}
