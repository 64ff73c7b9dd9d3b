//! The scene as it is seen along a path, without the Gaussians that `render.near` hides.

use super::StageContext;
use crate::artifact::TrajectoryProduct;
use gs2e_render::RenderChoice;
use gs2e_render::near::{NearPath, hide_near};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use std::sync::Arc;

/// Returns the scene, and the number of Gaussians that are hidden. All products of a trajectory hide the same
/// ones.
pub(super) fn hide_near_along(
    gaussians: &Arc<Gaussians>,
    motion: &TrajectoryProduct,
    camera: &Camera,
    render: &RenderChoice,
) -> (Arc<Gaussians>, usize) {
    let Some(near) = render.near else { return (gaussians.clone(), 0) };
    let path = NearPath {
        camera,
        rules: render.rules,
        poses: &motion.trajectory.world_from_camera,
        plane: near * motion.report.scale_distance,
    };
    let mut scene = Gaussians::clone(gaussians);
    let hidden = hide_near(&mut scene, &path);
    (Arc::new(scene), hidden.len())
}

/// Adds the number of hidden Gaussians to the remark of a step.
pub(super) fn add_remark(cx: &mut StageContext<'_>, hidden: usize) {
    if let Some(remark) = cx.remark.take_if(|_| hidden > 0) {
        cx.remark = Some(format!("{remark}, {hidden} Gaussians hidden near the path"));
    }
}
