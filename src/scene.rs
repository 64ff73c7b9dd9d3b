//! A scene of 3D Gaussians in memory.
//!
//! Fields are stored as trained files store them (log scales, opacity logits, spherical-harmonic coefficients), so
//! that reading and writing lose nothing; the renderer applies the activations. Axes are those of the scene's
//! `.ply` form.

pub mod procedural;
pub mod sh;

use glam::DVec3;

/// Gaussians as a structure of arrays; all arrays have one entry a Gaussian, in file order.
#[derive(Debug, Clone, PartialEq)]
pub struct Gaussians {
    /// World position of the local origin. Zero for files that store 32-bit positions (which are then exact);
    /// files with 64-bit positions are recentred so that 32 bits are enough for the rest.
    pub origin: DVec3,
    /// Means relative to `origin`, in scene units.
    pub positions: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations along the Gaussian's own axes.
    pub log_scales: Vec<[f32; 3]>,
    /// Quaternions `w, x, y, z`, as stored: not necessarily of unit length.
    pub rotations: Vec<[f32; 4]>,
    /// Opacity before the sigmoid.
    pub opacity_logits: Vec<f32>,
    /// Spherical-harmonic coefficients: Gaussian `i` owns `sh[i * n .. (i + 1) * n]`, `n = (degree + 1)^2`, each
    /// entry the red, green and blue coefficient of one basis function.
    pub sh: Vec<[f32; 3]>,
    /// Degree of the harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Whether the scene was trained with the antialiased rule; `None` where the file format cannot say.
    pub antialiased: Option<bool>,
    /// What the reader left out or mended.
    pub screening: Screening,
}

/// Counts of what reading a scene file left out or mended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Screening {
    /// Gaussians in the file.
    pub read: u64,
    /// Dropped: a field was NaN or infinite.
    pub non_finite: u64,
    /// Kept with the identity rotation: the quaternion was zero.
    pub zero_quaternions: u64,
}

impl Gaussians {
    /// Number of Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Basis functions a Gaussian: `(sh_degree + 1)^2`.
    #[must_use]
    pub fn sh_len(&self) -> usize {
        (usize::from(self.sh_degree) + 1).pow(2)
    }

    /// The coefficients of Gaussian `i`.
    #[must_use]
    pub fn sh_of(&self, i: usize) -> &[[f32; 3]] {
        let n = self.sh_len();
        &self.sh[i * n..(i + 1) * n]
    }
}
