//! The image motion along a trajectory at some instants: by `flow/`, or else by `depth/` and the poses.

use super::pictures::ReleasedPictures;
use gs2e_check::coverage::ViewCoverage;
use gs2e_check::geometry::watch::PosedPictures as _;
use gs2e_check::motion::warp::FlowAt;
use gs2e_image::Image;
use gs2e_recipe::OutputKind;
use gs2e_scene::camera::flow::{flow_displacement, flow_rates};
use gs2e_trajectory::flow::FlowQuantiles;
use gs2e_tree::{PictureKind, TreeError};

/// Largest number of instants at which the image motion is read.
const FLOWS: usize = 9;

/// The image motion along a trajectory.
#[derive(Debug, Default)]
pub(super) struct MeasuredMotion {
    pub(super) flows: Vec<FlowAt>,
    /// Between neighbouring poses.
    pub(super) steps_px: Option<FlowQuantiles>,
    pub(super) coverage: Option<ViewCoverage>,
}

impl MeasuredMotion {
    pub(super) fn of_pictures(pictures: &ReleasedPictures<'_>) -> Result<Self, TreeError> {
        let flows = pictures.kept_poses(PictureKind::Flow, OutputKind::Flow)?;
        let depths = pictures.kept_poses(PictureKind::Depth, OutputKind::Depth)?;
        let mut found = Self::default();
        let (mut moved_px, mut covered) = (Vec::new(), Vec::new());
        let (seconds, views) = (pictures.motion.seconds(), pictures.views());
        // The next pose, or the one before at the end.
        let neighbour =
            |pose: usize| if pose + 1 < views.len() { Some(pose + 1) } else { pose.checked_sub(1) };
        for pose in spread(&depths) {
            let depth = pictures.depth(pose)?;
            if flows.is_empty() {
                let view = &views[pose];
                moved_px.extend(
                    neighbour(pose)
                        .into_iter()
                        .flat_map(|other| flow_displacement(&depth, view, &views[other]).into_pixels()),
                );
                found.flows.push(FlowAt { t_us: pictures.stamp(pose), px_s: flow_rates(&depth, view) });
            }
            covered.push((pictures.stamp(pose), depth));
        }
        for pose in spread(&flows) {
            let px_s = pictures.files.flow(pose)?;
            let step = neighbour(pose).map_or(0.0, |other| (seconds[other] - seconds[pose]).abs());
            #[expect(clippy::cast_possible_truncation, reason = "a duration for 32-bit speeds")]
            let step = step as f32;
            moved_px.extend(px_s.pixels().iter().map(|[u, v]| (u * u + v * v).sqrt() * step));
            if depths.is_empty() {
                // Flow is NaN where depth is.
                let along_x = px_s.pixels().iter().map(|[u, _]| *u).collect();
                covered.push((pictures.stamp(pose), Image::from_vec(pictures.files.camera.size, along_x)));
            }
            found.flows.push(FlowAt { t_us: pictures.stamp(pose), px_s });
        }
        found.steps_px = FlowQuantiles::from_values(moved_px);
        found.coverage = ViewCoverage::from_depths(covered.iter().map(|(t_us, depth)| (*t_us, depth)));
        Ok(found)
    }
}

/// At most [`FLOWS`] of these poses, evenly spread, with both ends.
fn spread(poses: &[usize]) -> impl Iterator<Item = usize> {
    let count = FLOWS.min(poses.len());
    (0..count).map(move |i| poses[if count > 1 { i * (poses.len() - 1) / (count - 1) } else { 0 }])
}
