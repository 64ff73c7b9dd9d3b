//! Small scenes of a few plain Gaussians, and views of them, for stress cases and tests.
//!
//! ```
//! use gs2e_scene::blobs::{ColourBlob, blob_scene};
//!
//! let far = ColourBlob { position: [0.0, 0.0, 40.0], ..ColourBlob::default() };
//! let scene = blob_scene(&[ColourBlob::default(), far]);
//! assert_eq!(scene.positions, [[0.0, 0.0, 4.0], [0.0, 0.0, 40.0]]);
//! ```

use crate::camera::Camera;
use crate::camera::view::CameraView;
use crate::{Gaussians, SceneScreening, sh};
use glam::{DQuat, DVec3};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_num::seed::split_mix::{STEP, finalise_bits};

/// One Gaussian of constant colour.
#[derive(Debug, Clone, Copy)]
pub struct ColourBlob {
    /// Mean.
    pub position: [f32; 3],
    /// Standard deviations along its own axes.
    pub deviations: [f32; 3],
    /// Quaternion w, x, y, z, of any length.
    pub rotation: [f32; 4],
    /// Opacity, between 0 and 1.
    pub opacity: f64,
    /// Red, green and blue.
    pub colour: [f64; 3],
}

impl Default for ColourBlob {
    fn default() -> Self {
        Self {
            position: [0.0, 0.0, 4.0],
            deviations: [0.1; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity: 0.5,
            colour: [1.0; 3],
        }
    }
}

/// A scene of these blobs.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "scenes hold 32-bit values")]
pub fn blob_scene(blobs: &[ColourBlob]) -> Gaussians {
    let logit = |opacity: f64| libm::log(opacity / (1.0 - opacity)) as f32;
    Gaussians {
        origin: DVec3::ZERO,
        positions: blobs.iter().map(|b| b.position).collect(),
        log_scales: blobs.iter().map(|b| b.deviations.map(libm::logf)).collect(),
        rotations: blobs.iter().map(|b| b.rotation).collect(),
        opacity_logits: blobs.iter().map(|b| logit(b.opacity)).collect(),
        sh: blobs.iter().map(|b| b.colour.map(|c| ((c - 0.5) / sh::C0) as f32)).collect(),
        sh_degree: 0,
        antialiased: None,
        screening: SceneScreening::default(),
        motion: None,
    }
}

/// A view along z from the origin, with the principal point in the middle.
#[must_use]
pub fn view_ahead(width: u32, height: u32, focal: f64) -> CameraView {
    let [cx, cy] = [width, height].map(|edge| f64::from(edge) / 2.0);
    let camera = Camera { size: Size { width, height }, fx: focal, fy: focal, cx, cy, lens: None };
    CameraView::at_rest(camera, Se3 { rotation: DQuat::IDENTITY, translation: DVec3::ZERO })
}

/// Pseudo-random numbers in 0..1 that place the blobs, equal in every run (Steele, Lea and Flood
/// 2014: SplitMix64).
#[derive(Debug, Clone)]
pub struct ScatterDraws(pub u64);

impl ScatterDraws {
    /// The next number.
    #[expect(clippy::should_implement_trait, reason = "draws never end")]
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(STEP);
        // 24 bits, which 32-bit floats hold exactly.
        (finalise_bits(self.0) >> 40) as f32 / (1 << 24) as f32
    }

    /// The next number in a range.
    pub fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next()
    }
}

/// Blobs of all shapes in front of the camera, to its sides and behind it, with colours below zero
/// and above one.
#[must_use]
pub fn blob_crowd(n: usize, seed: u64) -> Vec<ColourBlob> {
    let mut d = ScatterDraws(seed);
    let blob = |d: &mut ScatterDraws| ColourBlob {
        position: [d.within(-3.0, 3.0), d.within(-2.0, 2.0), d.within(-1.0, 6.0)],
        deviations: [(); 3].map(|()| libm::expf(d.within(-6.0, -0.5))),
        rotation: [(); 4].map(|()| d.within(-1.0, 1.0)),
        opacity: f64::from(d.within(0.002, 0.999)),
        colour: [(); 3].map(|()| f64::from(d.within(-0.3, 1.6))),
    };
    (0..n).map(|_| blob(&mut d)).collect()
}
