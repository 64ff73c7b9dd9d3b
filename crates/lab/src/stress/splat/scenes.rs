//! Scenes at the edges of the arithmetic, with their known properties.

use glam::{DQuat, DVec3};
use gs2e_render::RenderRules;
use gs2e_scene::blobs::{ColourBlob, blob_crowd, blob_scene, view_ahead};
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::{Gaussians, sh};

/// All rules.
pub const ALL_RULES: [RenderRules; 4] =
    [RenderRules::Official, RenderRules::Exact, RenderRules::Gsplat, RenderRules::Soft];

/// A needle across the optical axis, parallel to the image. Its projection is exact: a Gaussian
/// with these standard deviations in pixels, rotated by an angle, and dilated.
#[derive(Debug, Clone, Copy)]
pub struct NeedleGaussian {
    /// Standard deviation along it, px.
    pub long_px: f64,
    /// Ratio of the standard deviations along and across it.
    pub aspect: f64,
    /// Angle from the x axis of the picture, rad.
    pub angle: f64,
    /// Distance of its mean from the middle of the picture along it, px.
    pub offset: f64,
}

/// Pixels per unit at the depth of the needles.
const SCALE: f64 = 25.0;
const DEPTH: f32 = 4.0;
/// Dilation of every variance, px^2: a 32-bit constant for all renderers.
pub(super) const DILATION: f64 = 0.3_f32 as f64;
/// Width and height of a needle's picture, px.
const EDGE: u32 = 33;

impl NeedleGaussian {
    const OPACITY: f64 = 0.95;

    /// A scene with the needle only.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "scenes hold 32 bits")]
    pub fn scene(&self) -> Gaussians {
        let (sin, cos) = libm::sincos(self.angle / 2.0);
        let short = self.long_px / self.aspect;
        blob_scene(&[ColourBlob {
            position: [0.0, 0.0, DEPTH],
            deviations: [self.long_px, short, short].map(|px| (px / SCALE) as f32),
            rotation: [cos as f32, 0.0, 0.0, sin as f32],
            opacity: Self::OPACITY,
            colour: [1.0; 3],
        }])
    }

    /// Its opacity as stored.
    #[must_use]
    pub fn opacity(&self) -> f64 {
        1.0 / (1.0 + libm::exp(-f64::from(self.scene().opacity_logits[0])))
    }

    /// Its luminance at the mean, as stored.
    #[must_use]
    pub fn luminance(&self) -> f64 {
        self.opacity() * (0.5 + sh::C0 * f64::from(self.scene().sh[0][0]))
    }

    /// A view of it.
    #[must_use]
    pub fn view(&self) -> CameraView {
        let mut view = view_ahead(EDGE, EDGE, SCALE * f64::from(DEPTH));
        let (sin, cos) = libm::sincos(self.angle);
        view.camera.cx = 16.7 - self.offset * cos;
        view.camera.cy = 16.4 - self.offset * sin;
        view
    }

    /// Variances along and across it, px^2, as stored, before any dilation.
    #[must_use]
    pub fn variances(&self) -> [f64; 2] {
        let scales = self.scene().log_scales[0];
        [0, 1].map(|k| {
            let deviation = libm::exp(f64::from(scales[k])) * SCALE;
            deviation * deviation
        })
    }

    /// Distance of each pixel from the mean, px, and the power at the pixel, for the stored scene
    /// with a dilation of 0.3 px^2. The power is computed along eigenvectors, in which nothing
    /// cancels.
    #[must_use]
    pub fn powers(&self) -> Vec<[f64; 2]> {
        let stored = self.scene();
        let [w, _, _, z] = stored.rotations[0].map(f64::from);
        let (sin, cos) = libm::sincos(2.0 * libm::atan2(z, w));
        let variances = self.variances().map(|v| v + DILATION);
        let camera = self.view().camera;
        let power = |x: u32, y: u32| {
            // Pixels are sampled at their centres.
            let [dx, dy] = [f64::from(x) + 0.5 - camera.cx, f64::from(y) + 0.5 - camera.cy];
            let [along, across] = [cos * dx + sin * dy, cos * dy - sin * dx];
            [libm::hypot(dx, dy), 0.5 * (along * along / variances[0] + across * across / variances[1])]
        };
        (0..EDGE).flat_map(|y| (0..EDGE).map(move |x| power(x, y))).collect()
    }
}

/// Needles of each aspect and length, in five directions, with their means in the picture.
#[must_use]
pub fn all_needles() -> Vec<NeedleGaussian> {
    let mut all = Vec::new();
    for aspect in [10.0, 100.0, 1e3, 1e4, 1e5, 1e6] {
        for long_px in [10.0, 100.0, 1e3, 3e3, 3e4] {
            for angle in [0.0, 0.3, std::f64::consts::FRAC_PI_4, 1.2, std::f64::consts::FRAC_PI_2] {
                all.push(NeedleGaussian { long_px, aspect, angle, offset: 0.0 });
            }
        }
    }
    all
}

/// Equal layers behind one another that fill a picture of one pixel, with colours alternating
/// between red and green.
#[must_use]
pub(crate) fn layer_stack(layers: usize, opacity: f64) -> (Gaussians, CameraView) {
    let layer = |i: usize| ColourBlob {
        // Multiples of 1/64 are exact in 32 bits, so no two layers tie.
        position: [0.0, 0.0, 1.0 + i as f32 / 64.0],
        deviations: [1e4; 3],
        opacity,
        colour: if i.is_multiple_of(2) { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] },
        ..ColourBlob::default()
    };
    (blob_scene(&(0..layers).map(layer).collect::<Vec<_>>()), view_ahead(1, 1, 100.0))
}

/// A crowd with only eight distinct depths, in a file order that no sort by another quantity would
/// give.
#[must_use]
pub(crate) fn tied_crowd(n: usize) -> (Gaussians, CameraView) {
    let mut blobs = blob_crowd(n, 5);
    for (i, blob) in blobs.iter_mut().enumerate() {
        blob.position[2] = 2.0 + (i * 7 % 8) as f32 * 0.5;
    }
    (blob_scene(&blobs), view_ahead(101, 59, 75.0))
}

/// A change that makes one Gaussian of a scene invalid.
pub(crate) type Spoil = fn(&mut Gaussians, usize);

/// Changes after which the picture must be that without the Gaussian.
pub const UNSOUND: [(&str, Spoil); 9] = [
    ("NaN in a position", |s, i| s.positions[i][1] = f32::NAN),
    ("NaN in a depth", |s, i| s.positions[i][2] = f32::NAN),
    ("infinite position", |s, i| s.positions[i][2] = f32::INFINITY),
    ("NaN in a scale", |s, i| s.log_scales[i][0] = f32::NAN),
    ("infinite scale", |s, i| s.log_scales[i][2] = f32::INFINITY),
    ("scale that overflows", |s, i| s.log_scales[i] = [80.0; 3]),
    ("NaN in a rotation", |s, i| s.rotations[i][3] = f32::NAN),
    ("NaN in an opacity", |s, i| s.opacity_logits[i] = f32::NAN),
    ("infinite colour", |s, i| s.sh[i][2] = f32::NEG_INFINITY),
];

/// The scene without Gaussian `i`.
#[must_use]
pub(crate) fn without_gaussian(scene: &Gaussians, i: usize) -> Gaussians {
    let mut clean = scene.clone();
    clean.positions.remove(i);
    clean.log_scales.remove(i);
    clean.rotations.remove(i);
    clean.opacity_logits.remove(i);
    clean.sh.remove(i);
    clean
}

/// Gaussians that the rules count: two behind, one outside the picture, one too faint, one that
/// overflows; and among the drawn ones some with a standard deviation of depth of 0.09, 0.11, 0.29,
/// 0.31 and 0.5 of the depth, and a giant around the camera.
#[must_use]
pub(crate) fn counted_scene() -> (Gaussians, CameraView, GaussianCounts) {
    let here = ColourBlob { position: [0.0, 0.0, 4.0], ..ColourBlob::default() };
    let deep = |share: f32| ColourBlob { deviations: [0.1, 0.1, 4.0 * share], ..here };
    let blobs = [
        here,
        ColourBlob { position: [0.0, 0.0, -4.0], ..here },
        ColourBlob { position: [0.0, 0.0, 0.0], deviations: [1e3; 3], ..here },
        ColourBlob { position: [100.0, 0.0, 4.0], ..here },
        ColourBlob { opacity: 0.001, ..here },
        ColourBlob { deviations: [f32::MAX, 1.0, 1.0], ..here },
        deep(0.09),
        deep(0.11),
        deep(0.29),
        deep(0.31),
        deep(0.5),
        ColourBlob { position: [0.0, 0.0, 1.0], deviations: [1e4; 3], opacity: 0.1, ..here },
    ];
    let wanted =
        GaussianCounts { gaussians: 12, behind: 2, degenerate: 1, outside: 2, doubtful: 5, invalid: 3 };
    (blob_scene(&blobs), view_ahead(32, 32, 100.0), wanted)
}

/// The counts of [`gs2e_render::RenderWork`] that concern Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct GaussianCounts {
    /// All Gaussians.
    pub gaussians: u64,
    /// Not in front of the near plane.
    pub behind: u64,
    /// Not finite.
    pub degenerate: u64,
    /// In no tile, or too faint.
    pub outside: u64,
    /// Standard deviation above 0.1 of the depth.
    pub doubtful: u64,
    /// Standard deviation above 0.3 of the depth.
    pub invalid: u64,
}

/// One Gaussian at this depth.
#[must_use]
pub(crate) fn at_depth(z: f32) -> (Gaussians, CameraView) {
    (
        blob_scene(&[ColourBlob { position: [0.0, 0.0, z], deviations: [1e-3; 3], ..ColourBlob::default() }]),
        view_ahead(17, 17, 100.0),
    )
}

/// A crowd seen diagonally, in a picture with edges that are not multiples of a tile.
#[must_use]
pub fn askew_crowd(n: usize) -> (Gaussians, CameraView) {
    let mut view = view_ahead(203, 117, 150.0);
    view.world_from_camera.rotation = DQuat::from_xyzw(0.02, -0.05, 0.01, 1.0).normalize();
    view.world_from_camera.translation = DVec3::new(0.3, -0.2, -1.5);
    (blob_scene(&blob_crowd(n, 1)), view)
}

/// Giants that each cover the whole picture.
#[must_use]
pub fn giant_scene(n: usize, edge: u32) -> (Gaussians, CameraView) {
    let giant = |i: usize| ColourBlob {
        position: [0.0, 0.0, 2.0 + i as f32 / 64.0],
        deviations: [100.0; 3],
        opacity: 0.9,
        colour: [i as f64 / n as f64, 0.5, 1.0],
        ..ColourBlob::default()
    };
    (blob_scene(&(0..n).map(giant).collect::<Vec<_>>()), view_ahead(edge, edge, f64::from(edge)))
}
