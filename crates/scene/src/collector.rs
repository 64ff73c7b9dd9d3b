//! Collects Gaussians into a scene: those that are not finite are dropped and counted.
//!
//! # Examples
//!
//! ```
//! use glam::DVec3;
//! use gs2e_scene::collector::{Gaussian, GaussianCollector};
//!
//! let mut collector = GaussianCollector::new(0, 2)?;
//! let (rotation, sh) = ([1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! let good = Gaussian { position: [0.0; 3], log_scale: [-1.0; 3], rotation, opacity_logit: 0.0, sh };
//! assert!(collector.push(&good));
//! assert!(!collector.push(&Gaussian { opacity_logit: f32::NAN, ..good }));
//! let scene = collector.finish(DVec3::ZERO, None)?;
//! // One of the two is left.
//! assert_eq!((scene.len(), scene.screening.read, scene.screening.non_finite), (1, 2, 1));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::{Gaussians, SceneError, SceneScreening, sh};
use glam::DVec3;
use gs2e_files::budget::try_with_room;

/// One Gaussian, its fields as in [`Gaussians`].
#[derive(Debug, Clone, Copy)]
pub struct Gaussian<'a> {
    /// Centre.
    pub position: [f32; 3],
    /// Logarithms of the standard deviations.
    pub log_scale: [f32; 3],
    /// Quaternion `w x y z`, of any length.
    pub rotation: [f32; 4],
    /// Logit of the opacity.
    pub opacity_logit: f32,
    /// One entry per function of the collector's degree.
    pub sh: &'a [[f32; 3]],
}

impl Gaussian<'_> {
    fn is_finite(&self) -> bool {
        let finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
        finite(&self.position)
            && finite(&self.log_scale)
            && finite(&self.rotation)
            && self.opacity_logit.is_finite()
            && finite(self.sh.as_flattened())
    }
}

/// Gaussians that are being read.
#[derive(Debug)]
pub struct GaussianCollector {
    scene: Gaussians,
}

impl GaussianCollector {
    /// An empty scene with room for `capacity` Gaussians, which the caller has bounded by the
    /// file's size.
    ///
    /// # Errors
    /// There is no memory for them.
    pub fn new(sh_degree: u8, capacity: usize) -> Result<Self, SceneError> {
        let scene = Gaussians {
            origin: DVec3::ZERO,
            positions: try_with_room(capacity)?,
            log_scales: try_with_room(capacity)?,
            rotations: try_with_room(capacity)?,
            opacity_logits: try_with_room(capacity)?,
            sh: try_with_room(capacity.saturating_mul(sh::function_count(sh_degree)))?,
            sh_degree,
            antialiased: None,
            screening: SceneScreening::default(),
            motion: None,
        };
        Ok(Self { scene })
    }

    /// Takes the next Gaussian of the file. Returns true if it is kept.
    pub fn push(&mut self, gaussian: &Gaussian) -> bool {
        debug_assert_eq!(gaussian.sh.len(), self.scene.sh_len());
        let scene = &mut self.scene;
        scene.screening.read += 1;
        if !gaussian.is_finite() {
            scene.screening.non_finite += 1;
            return false;
        }
        // Kept: the renderer takes a zero quaternion for no rotation.
        if is_zero(gaussian.rotation) {
            scene.screening.zero_quaternions += 1;
        }
        scene.positions.push(gaussian.position);
        scene.log_scales.push(gaussian.log_scale);
        scene.rotations.push(gaussian.rotation);
        scene.opacity_logits.push(gaussian.opacity_logit);
        scene.sh.extend_from_slice(gaussian.sh);
        true
    }

    /// The scene.
    ///
    /// # Errors
    /// No Gaussian remains.
    pub fn finish(self, origin: DVec3, antialiased: Option<bool>) -> Result<Gaussians, SceneError> {
        let SceneScreening { read, non_finite, .. } = self.scene.screening;
        if self.scene.is_empty() {
            return Err(SceneError::Empty { read, non_finite });
        }
        Ok(Gaussians { origin, antialiased, ..self.scene })
    }
}

fn is_zero(rotation: [f32; 4]) -> bool {
    rotation.iter().all(|v| v.abs().to_bits() == 0)
}
