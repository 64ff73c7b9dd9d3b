//! Materials, primitives and basic shapes of the still life's items.

use super::light::SphereOccluder;
use super::shape::{Path, PrimitiveShape, Sheet, SurfelCover, SurfelSpot};
use glam::DVec3;
use gs2e_image::srgb;
use std::fmt;

/// Appearance of a surfel before lighting.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfaceFinish {
    /// Reflected share of red, green and blue light, linear.
    pub(super) albedo: DVec3,
    /// Height of the lamp's reflection on the display scale.
    pub(super) gloss: f64,
    /// Opacity in the middle of the surfel.
    pub(super) opacity: f64,
}

impl SurfaceFinish {
    /// A matt, solid surface.
    pub(super) fn matt(albedo: DVec3) -> Self {
        Self { albedo, gloss: 0.0, opacity: 0.985 }
    }

    /// A glossy, solid surface.
    pub(super) fn glossy(albedo: DVec3, gloss: f64) -> Self {
        Self { gloss, ..Self::matt(albedo) }
    }
}

/// The appearance of a primitive at each of its spots.
pub(super) type Look = Box<dyn Fn(&SurfelSpot) -> SurfaceFinish>;

/// One surface, strand or cloud of an item.
pub(super) struct ScenePrimitive {
    pub(super) item: &'static str,
    pub(super) shape: PrimitiveShape,
    pub(super) look: Look,
    /// Surfel density relative to the other primitives.
    pub(super) detail: f64,
    /// True if its back is visible too; the back is then lit like the front.
    pub(super) thin: bool,
}

impl fmt::Debug for ScenePrimitive {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} of {}", self.shape, self.item)
    }
}

impl ScenePrimitive {
    pub(super) fn sheet(item: &'static str, sheet: Sheet, look: Look) -> Self {
        Self::covered(item, sheet, SurfelCover::CLOSED, look)
    }

    pub(super) fn covered(item: &'static str, sheet: Sheet, how: SurfelCover, look: Look) -> Self {
        Self { item, shape: PrimitiveShape::Sheet(sheet, how), look, detail: 1.0, thin: false }
    }

    pub(super) fn strand(item: &'static str, path: Path, radius: f64, look: Look) -> Self {
        Self { item, shape: PrimitiveShape::Strand(path, radius), look, detail: 1.0, thin: false }
    }

    pub(super) fn detail(self, detail: f64) -> Self {
        Self { detail, ..self }
    }

    pub(super) fn thin(self) -> Self {
        Self { thin: true, ..self }
    }
}

/// The primitives on the table, and the spheres that cast their shadows.
#[derive(Debug, Default)]
pub(super) struct TableArrangement {
    pub(super) primitives: Vec<ScenePrimitive>,
    pub(super) occluders: Vec<SphereOccluder>,
}

impl TableArrangement {
    pub(super) fn shadow(&mut self, item: &'static str, centre: DVec3, radius: f64) {
        self.occluders.push(SphereOccluder { item, centre, radius });
    }
}

/// The point `x` to the right, `height` above the table and `z` behind its middle. World axes are x
/// right, y down, z forward.
pub(super) fn table_point(x: f64, height: f64, z: f64) -> DVec3 {
    DVec3::new(x, -height, z)
}

/// Linear light of the display colour `0xRRGGBB`.
pub(super) fn display_colour(hex: u32) -> DVec3 {
    let [_, r, g, b] = hex.to_be_bytes();
    DVec3::from_array([r, g, b].map(|byte| srgb::decode(f64::from(byte) / 255.0)))
}

/// Sine and cosine of `turns` full turns.
pub(super) fn turn_sine(turns: f64) -> (f64, f64) {
    let angle = turns * std::f64::consts::TAU;
    (libm::sin(angle), libm::cos(angle))
}

/// The surface of revolution of a profile about the vertical through `foot`: radius and height at
/// `v` from 0 to 1.
pub(super) fn revolved_sheet(foot: DVec3, profile: impl Fn(f64) -> (f64, f64) + 'static) -> Sheet {
    Box::new(move |u, v| {
        let (sin, cos) = turn_sine(u);
        let (radius, height) = profile(v);
        foot + table_point(radius * cos, height, radius * sin)
    })
}

/// A ball whose radius is multiplied by `swell(u, v)`; `v` runs from the bottom to the top.
pub(super) fn ball_sheet(centre: DVec3, radius: f64, swell: impl Fn(f64, f64) -> f64 + 'static) -> Sheet {
    Box::new(move |u, v| {
        let (sin, cos) = turn_sine(u);
        let (up, out) = turn_sine((v - 0.5) / 2.0);
        centre + radius * swell(u, v) * table_point(out * cos, up, out * sin)
    })
}

/// A smooth curve through points that are equally far apart in the parameter (Catmull-Rom).
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the points' indices")]
pub(super) fn smooth_path(points: Vec<DVec3>) -> Path {
    Box::new(move |t| {
        let last = points.len() - 1;
        let x = t.clamp(0.0, 1.0) * last as f64;
        // The last point belongs to the last piece.
        let k = (x.floor() as usize).min(last - 1);
        let s = x - k as f64;
        let p = |i: usize| points[i.min(last)];
        let (a, b, c, d) = (points[k.saturating_sub(1)], p(k), p(k + 1), p(k + 2));
        b + 0.5 * s * ((c - a) + s * ((2.0 * a - 5.0 * b + 4.0 * c - d) + s * (3.0 * (b - c) + d - a)))
    })
}
