//! A limit on the size of Gaussians near the cameras.
//!
//! No camera stands inside a Gaussian: its largest standard deviation is at most a share of its distance to
//! the nearest camera that is trained on. The affine projection divides the size by the depth. So a Gaussian
//! of a distant background that is as wide as a third of its distance covers the whole picture when its mean,
//! far to the side, passes the near plane. B. Kerbl et al. 2023 remove Gaussians larger than a tenth of the
//! extent (GitHub graphdeco-inria/gaussian-splatting, `scene/gaussian_model.py`, `densify_and_prune`), and
//! all of a distant background with them.

#![expect(clippy::cast_possible_truncation, reason = "parameters are stored in 32 bits")]

use glam::DVec3;
use gs2e_scene::Gaussians;
use rayon::prelude::*;

/// Largest standard deviation, in distances to the nearest camera. At the camera, the opacity of the Gaussian
/// is at most `exp(-4^2 / 2)`, 3e-4, which is less than any renderer draws.
const MAX_SPREAD: f64 = 0.25;

/// Shrinks the Gaussians that reach a camera.
pub(super) fn limit_sizes(scene: &mut Gaussians, centres: &[DVec3]) {
    let origin = scene.origin;
    let sizes = scene.log_scales.par_iter_mut().zip(&scene.positions);
    sizes.for_each(|(log_scales, position)| {
        let mean = origin + DVec3::from_array(position.map(f64::from));
        let nearest =
            centres.iter().map(|centre| centre.distance_squared(mean)).fold(f64::INFINITY, f64::min);
        let most = (libm::log(MAX_SPREAD * MAX_SPREAD * nearest) / 2.0) as f32;
        // A Gaussian at a camera's place would have no size: it keeps its own.
        if most.is_finite() {
            log_scales.iter_mut().for_each(|log| *log = log.min(most));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_scene::SceneScreening;

    #[test]
    fn only_gaussians_that_reach_a_camera_shrink() {
        let centres = [DVec3::new(10.0, 0.0, 0.0), DVec3::new(0.0, 0.0, 3.0)];
        let mut scene = Gaussians {
            origin: DVec3::new(0.0, 0.0, 1.0),
            positions: vec![[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 2.0]],
            log_scales: [0.7_f32, 2.0, 2.0].map(|scale| [scale.ln(), -3.0, scale.ln()]).to_vec(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            opacity_logits: vec![0.0; 3],
            sh: vec![[0.0; 3]; 3],
            sh_degree: 0,
            antialiased: None,
            screening: SceneScreening::default(),
            motion: None,
        };
        limit_sizes(&mut scene, &centres);
        // The first two are 3 units from the second camera, and the last one is at its place.
        let wanted = [0.7_f32, 0.75, 2.0].map(|scale| [scale.ln(), -3.0, scale.ln()]);
        for (found, wanted) in scene.log_scales.as_flattened().iter().zip(wanted.as_flattened()) {
            assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
        }
    }
}
