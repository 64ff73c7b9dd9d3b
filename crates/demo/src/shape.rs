//! Surfaces and strands, and the surfels that cover them: flattened Gaussians with a size that
//! depends on their number.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "counts come from rounding shares of counts, which are not negative"
)]

use super::draw::SceneDraws;
use glam::{DMat3, DQuat, DVec3};
use std::fmt;

/// A map from the unit square onto a surface; `u` cross `v` points outwards.
pub(super) type Sheet = Box<dyn Fn(f64, f64) -> DVec3>;
/// A map from the unit interval onto a curve.
pub(super) type Path = Box<dyn Fn(f64) -> DVec3>;

/// Shape of a primitive.
pub(super) enum PrimitiveShape {
    /// A surface and its coverage.
    Sheet(Sheet, SurfelCover),
    /// A thin tube along a curve, of this radius.
    Strand(Path, f64),
    /// Blobs in the air, with random centres and radii.
    Blobs { low: DVec3, high: DVec3, share: f64 },
}

impl fmt::Debug for PrimitiveShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sheet(..) => "Sheet",
            Self::Strand(..) => "Strand",
            Self::Blobs { .. } => "Blobs",
        })
    }
}

/// Place of a surfel.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfelSpot {
    pub(super) u: f64,
    pub(super) v: f64,
    pub(super) position: DVec3,
    /// Unit normal, outwards; for a strand, towards the viewer.
    pub(super) normal: DVec3,
    /// Distance to the next surfel along `u` and along `v`.
    pub(super) spacing: [f64; 2],
    /// Standard deviations along the axes of `rotation`.
    pub(super) deviations: DVec3,
    pub(super) rotation: DQuat,
}

/// Coverage of a surface by surfels.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfelCover {
    /// Standard deviation divided by the distance to the next surfel. 0.58 closes the surface;
    /// smaller values show a little of what lies behind, and keep patterns sharper.
    pub(super) overlap: f64,
    /// Distance along `u` divided by that along `v`: for patterns along `u`.
    pub(super) aspect: f64,
}

impl SurfelCover {
    pub(super) const CLOSED: Self = Self { overlap: 0.58, aspect: 1.0 };
    pub(super) const CRISP: Self = Self { overlap: 0.47, aspect: 1.0 };
}

/// Weight of a strand's length in addition to its area: even the thinnest strand needs pieces to
/// follow its bends.
const BENDS: f64 = 0.03;
/// Displacement of surfels from the middle of their cells, in cells.
const UNREST: f64 = 0.18;
/// Number of rows and columns at which areas and lengths are measured.
const MEASURED: u32 = 48;

impl PrimitiveShape {
    /// Area of the surface. For a strand, its visible area plus [`BENDS`] per unit of length.
    pub(super) fn area(&self) -> f64 {
        match self {
            Self::Sheet(sheet, _) => SurfaceRows::measure_sheet(sheet).area(),
            Self::Strand(path, radius) => piece_lengths(path).iter().sum::<f64>() * (2.0 * radius + BENDS),
            Self::Blobs { share, .. } => *share,
        }
    }

    /// Exactly `count` spots.
    pub(super) fn spots(&self, count: usize, draws: &mut SceneDraws, mut found: impl FnMut(&SurfelSpot)) {
        match self {
            Self::Sheet(sheet, how) => cover_sheet(sheet, *how, count, draws, &mut found),
            Self::Strand(path, radius) => follow_path(path, *radius, count, &mut found),
            Self::Blobs { low, high, .. } => {
                for _ in 0..count {
                    found(&random_blob(*low, *high, draws));
                }
            }
        }
    }
}

/// Lengths of the pieces of a curve between equidistant parameters.
fn piece_lengths(curve: impl Fn(f64) -> DVec3) -> Vec<f64> {
    let at = |k: u32| curve(f64::from(k) / f64::from(MEASURED));
    (0..MEASURED).map(|k| at(k).distance(at(k + 1))).collect()
}

/// The measure of a surface: at `MEASURED` values of `v`, the length of the line of constant `v`,
/// and the height of the strip around it.
struct SurfaceRows {
    widths: Vec<f64>,
    heights: Vec<f64>,
}

impl SurfaceRows {
    fn measure_sheet(sheet: &Sheet) -> Self {
        let middle = |k: u32| (f64::from(k) + 0.5) / f64::from(MEASURED);
        let widths = (0..MEASURED).map(|k| piece_lengths(|u| sheet(u, middle(k))).iter().sum()).collect();
        let columns: Vec<Vec<f64>> =
            (0..8).map(|c| piece_lengths(|v| sheet((f64::from(c) + 0.5) / 8.0, v))).collect();
        let heights =
            (0..MEASURED as usize).map(|k| columns.iter().map(|c| c[k]).sum::<f64>() / 8.0).collect();
        Self { widths, heights }
    }

    fn area(&self) -> f64 {
        self.widths.iter().zip(&self.heights).map(|(w, h)| w * h).sum()
    }

    /// The parameter below which the share `share` of the total height lies.
    fn v_at(&self, share: f64) -> f64 {
        let mut left = share * self.heights.iter().sum::<f64>();
        for (k, &h) in self.heights.iter().enumerate() {
            if left <= h {
                return (k as f64 + if h > 0.0 { left / h } else { 0.0 }) / f64::from(MEASURED);
            }
            left -= h;
        }
        1.0
    }

    fn width_at(&self, v: f64) -> f64 {
        // Widths are measured in the middle of the strips.
        let x = (v * f64::from(MEASURED) - 0.5).clamp(0.0, f64::from(MEASURED - 1));
        let k = (x.floor() as usize).min(self.widths.len() - 2);
        self.widths[k] + (self.widths[k + 1] - self.widths[k]) * (x - k as f64)
    }
}

/// Covers a surface with rows of surfels; the number in each row depends on its length.
fn cover_sheet(
    sheet: &Sheet,
    how: SurfelCover,
    count: usize,
    draws: &mut SceneDraws,
    found: &mut impl FnMut(&SurfelSpot),
) {
    let rows = SurfaceRows::measure_sheet(sheet);
    // The height of a cell. Its width is `aspect` times that.
    let spacing = (rows.area() / (count.max(1) as f64 * how.aspect)).sqrt();
    let height: f64 = rows.heights.iter().sum();
    let row_count = ((height / spacing).round() as usize).clamp(1, count.max(1));
    let edge = |r: f64| rows.v_at(r / row_count as f64);
    let widths: Vec<f64> = (0..row_count).map(|r| rows.width_at(edge(r as f64 + 0.5))).collect();
    for (r, in_row) in split_count(count, &widths).into_iter().enumerate() {
        // Neighbouring rows are shifted, so that their surfels do not line up.
        let phase = if r % 2 == 0 { 0.3 } else { 0.8 };
        let r = r as f64;
        let cell = [1.0 / in_row.max(1) as f64, edge(r + 1.0) - edge(r)];
        for i in 0..in_row {
            let along = (i as f64 + phase + draws.uniform(-UNREST, UNREST)) / in_row as f64;
            let v = edge(r + 0.5 + draws.uniform(-UNREST, UNREST));
            // A surfel displaced beyond one end of its row enters at the other.
            let mut spot = sheet_surfel(sheet, along - along.floor(), v, cell);
            spot.deviations *= how.overlap;
            found(&spot);
        }
    }
}

/// `count` divided by weights: exact in total, and each number within one of its share.
pub(super) fn split_count(count: usize, weights: &[f64]) -> Vec<usize> {
    let total: f64 = weights.iter().sum();
    let mut so_far = 0.0;
    let mut given = 0;
    weights
        .iter()
        .map(|w| {
            so_far += w;
            // Rounding the running sum, and not each share, makes the total exact.
            let upto = if total > 0.0 { (count as f64 * (so_far / total)).round() as usize } else { 0 };
            let share = upto.min(count) - given;
            given += share;
            share
        })
        .collect()
}

/// The surfel at `(u, v)` in a cell of this size in the unit square. Its standard deviations follow
/// the spacing.
fn sheet_surfel(sheet: &Sheet, u: f64, v: f64, cell: [f64; 2]) -> SurfelSpot {
    let d = 1e-4;
    let along = |du: f64, dv: f64| {
        // At a border the difference is one-sided, and its divisor is the remaining width.
        let (a, b) = ((u - du).max(0.0), (u + du).min(1.0));
        let (c, e) = ((v - dv).max(0.0), (v + dv).min(1.0));
        (sheet(b, e) - sheet(a, c)) / ((b - a) + (e - c))
    };
    let (du, dv) = (along(d, 0.0), along(0.0, d));
    let spacing = [du.length() * cell[0], dv.length() * cell[1]];
    let normal = du.cross(dv).normalize_or(DVec3::NEG_Y);
    let tangent = (du - normal * normal.dot(du)).normalize_or(normal.any_orthonormal_vector());
    SurfelSpot {
        u,
        v,
        position: sheet(u, v),
        normal,
        spacing,
        // Flat: thin along the normal.
        deviations: DVec3::new(spacing[0], spacing[1], 0.2 * spacing[0].min(spacing[1])),
        rotation: tangent_frame(tangent, normal),
    }
}

/// The rotation that takes x to `tangent` and z to `normal`.
fn tangent_frame(tangent: DVec3, normal: DVec3) -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols(tangent, normal.cross(tangent), normal))
}

/// Long Gaussians along the chords of a curve. Their normals lean towards the lamp and the viewer.
fn follow_path(path: &Path, radius: f64, count: usize, found: &mut impl FnMut(&SurfelSpot)) {
    let end = |i: usize| path(i as f64 / count as f64);
    for i in 0..count {
        let (from, to) = (end(i), end(i + 1));
        let spacing = from.distance(to);
        let tangent = (to - from).normalize_or(DVec3::X);
        let outwards = DVec3::new(-0.3, -0.6, -0.75);
        let normal = (outwards - tangent * tangent.dot(outwards)).normalize_or(DVec3::NEG_Z);
        let thick = 0.6 * radius;
        found(&SurfelSpot {
            u: (i as f64 + 0.5) / count as f64,
            v: 0.5,
            position: (from + to) * 0.5,
            normal,
            spacing: [spacing, 2.0 * radius],
            deviations: DVec3::new((SurfelCover::CLOSED.overlap * spacing).max(0.2 * thick), thick, thick),
            rotation: tangent_frame(tangent, normal),
        });
    }
}

/// A round blob at a random place in a box.
fn random_blob(low: DVec3, high: DVec3, draws: &mut SceneDraws) -> SurfelSpot {
    let position = DVec3::from_array([0, 1, 2].map(|k| draws.uniform(low[k], high[k])));
    let radius = draws.uniform(0.02, 0.07);
    let stretch = draws.uniform(0.6, 1.6);
    let normal = DVec3::new(draws.bell(1.0), draws.bell(1.0), draws.bell(1.0)).normalize_or(DVec3::Z);
    SurfelSpot {
        u: draws.uniform(0.0, 1.0),
        v: draws.uniform(0.0, 1.0),
        position,
        normal,
        spacing: [radius; 2],
        deviations: DVec3::new(radius * stretch, radius, radius / stretch),
        rotation: tangent_frame(normal.any_orthonormal_vector(), normal),
    }
}
