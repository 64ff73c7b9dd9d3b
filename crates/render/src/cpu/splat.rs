//! A projected Gaussian, as the later passes use it.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "pixel coordinates are clamped to the image before they become integers"
)]

/// Maximum number of feature values of a splat: colour, luminance, depth, doubt.
pub(super) const MAX_FEATURES: usize = 6;

/// A Gaussian on the image plane. Its opacity at a pixel is `opacity * 2^-q` with `q = (w1 dx + w2
/// dy)^2 + (w3 dy)^2`, where `(dx, dy)` is the pixel's centre minus the mean. This is the Cholesky
/// form of the exponent, with `w` scaled by `sqrt(log2(e) / 2)`: a sum of squares, so rounding
/// cannot make it negative.
// 64 bytes, one cache line: the later passes read splats in no order of memory.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(super) struct Splat {
    /// Mean, px.
    pub(super) mean: [f32; 2],
    /// `w1, w2, w3`, 1/px.
    pub(super) w: [f32; 3],
    /// Opacity at the mean.
    pub(super) opacity: f32,
    /// Largest `q` at which a pixel can reach the smallest blended opacity, with a margin for
    /// rounding.
    pub(super) reach: f32,
    /// First and end column and row of the pixels that it may touch. Never empty.
    pub(super) columns: [u16; 2],
    /// As `columns`.
    pub(super) rows: [u16; 2],
    /// Feature values, in the order of the requested channels.
    pub(super) features: [f32; MAX_FEATURES],
    /// Depth along the optical axis, scene units.
    pub(super) depth: f32,
}

/// Rates of a splat's values while the camera moves, per second.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SplatRates {
    /// Rate of the mean, px.
    pub(super) mean: [f32; 2],
    /// Rates of `w1, w2, w3`.
    pub(super) w: [f32; 3],
    /// Rate of the opacity at the mean, divided by the opacity.
    pub(super) opacity: f32,
    /// Rate of the depth, scene units.
    pub(super) depth: f32,
    /// The luminance.
    pub(super) grey: f32,
    /// Rate of the luminance.
    pub(super) grey_rate: f32,
}

/// Bound on the error that rounding adds to an edge of an extent, px, where the edge is `distance`
/// px from the mean. The raster computes `w1 dx + w2 dy` from terms of that size, each rounded
/// twice at 2^-24 of it; pixel coordinates below 65,536 are rounded at 2^-8.
#[inline(always)]
pub(super) fn edge_margin(distance: f32) -> f32 {
    MARGIN[0] + MARGIN[1] * distance
}

/// The margin at distance 0, px, and its growth per px.
pub(super) const MARGIN: [f32; 2] = [0.02, 1e-6];

/// First and end of the pixels with centres between `low` and `high`, within `0..end`.
#[inline(always)]
pub(super) fn pixels_within(low: f32, high: f32, end: f32) -> [u16; 2] {
    // floor(low + 1/2). After the clamp, truncation equals floor.
    [clamp_pixel(low + 0.5, end) as u16, clamp_pixel(high + 0.5, end) as u16]
}

/// The value clamped to `0..=end`; NaN becomes 0. Two selections, where `f32::clamp` also checks
/// its bounds.
#[inline(always)]
pub(super) fn clamp_pixel(value: f32, end: f32) -> f32 {
    let value = if value > 0.0 { value } else { 0.0 };
    if value < end { value } else { end }
}

impl Splat {
    /// The interval in x that the ellipse `q <= reach` covers on the line `dy` px below the mean,
    /// or `None` if the line misses it.
    #[inline(always)]
    pub(super) fn chord(&self, dy: f32) -> Option<[f32; 2]> {
        let [w1, w2, w3] = self.w;
        let e2 = w3 * dy;
        let room = self.reach - e2 * e2;
        if room < 0.0 {
            return None;
        }
        let half = room.sqrt() / w1;
        let shift = -w2 / w1 * dy;
        let middle = self.mean[0] + shift;
        let wide = half + edge_margin(half + shift.abs());
        Some([middle - wide, middle + wide])
    }

    /// The outline of the splat.
    #[inline(always)]
    pub(super) fn outline(&self) -> SplatEllipse<'_> {
        let [w1, w2, w3] = self.w;
        let (skew, root) = ((w2 * w2 + w3 * w3).sqrt(), self.reach.sqrt());
        let half = root * skew / (w1 * w3);
        let turn = -w2 * root / (w3 * skew);
        SplatEllipse { splat: self, wide: half + edge_margin(half), turn, slack: edge_margin(turn.abs()) }
    }
}

/// The ellipse `q <= reach` of a splat.
#[derive(Debug, Clone, Copy)]
pub(super) struct SplatEllipse<'a> {
    splat: &'a Splat,
    /// Half its width, with the margin for rounding, px.
    wide: f32,
    /// The ellipse is widest to the right at `dy = turn`, to the left at `dy = -turn`.
    turn: f32,
    /// Bound on the rounding of these values, px.
    slack: f32,
}

impl SplatEllipse<'_> {
    /// The columns that may be touched in rows `first..end`, which lie within the splat's rows.
    #[inline(always)]
    pub(super) fn columns_in(&self, first: u16, end: u16) -> [u16; 2] {
        let Self { splat, wide, turn, slack } = *self;
        let top = f32::from(first) + 0.5 - splat.mean[1];
        let bottom = f32::from(end) - 0.5 - splat.mean[1];
        let chord = |dy: f32| {
            // Away from its widest point an edge only recedes, so the nearest row of the range
            // decides.
            let widest = dy >= top - slack && dy <= bottom + slack;
            if widest { None } else { splat.chord(dy.clamp(top, bottom)) }
        };
        let low = chord(-turn).map_or(splat.mean[0] - wide, |[low, _]| low);
        let high = chord(turn).map_or(splat.mean[0] + wide, |[_, high]| high);
        let [x0, x1] = pixels_within(low, high, f32::from(splat.columns[1]));
        [x0.max(splat.columns[0]), x1]
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::eye::SplatCovariance;
    use super::super::{exp2, extent};
    use super::*;
    use crate::RenderRules;
    use crate::shared::{DILATION, MIN_ALPHA, TILE};
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    pub(in crate::cpu) const EDGE: u16 = 96;

    /// A splat with standard deviations `long` and `short`, px before dilation, and its long axis
    /// turned by `angle`.
    fn splat(mean: [f32; 2], long: f32, short: f32, angle: f32, opacity: f32) -> Option<Splat> {
        let (s, c) = angle.sin_cos();
        let [a0, a1] = [[long * c, -short * s], [long * s, short * c]];
        let det0 = (a0[0] * a1[1] - a0[1] * a1[0]).powi(2);
        let (aa, cc) = (a0[0] * a0[0] + a0[1] * a0[1], a1[0] * a1[0] + a1[1] * a1[1]);
        let shape = SplatCovariance {
            a: aa + DILATION,
            b: a0[0] * a1[0] + a0[1] * a1[1],
            c: cc + DILATION,
            det: det0 + DILATION * (aa + cc) + DILATION * DILATION,
            det0,
            depth_deviation: 0.0,
        };
        let reach = extent::opacity_reach(RenderRules::Exact, opacity);
        let size = [f32::from(EDGE); 2];
        let [columns, rows] =
            extent::touched_pixels(RenderRules::Exact, mean, [shape.a, shape.b, shape.c], reach, size);
        if columns[0] >= columns[1] || rows[0] >= rows[1] {
            return None;
        }
        let w = shape.weights();
        Some(Splat { mean, w, opacity, reach, columns, rows, ..Splat::default() })
    }

    /// The raster pass's own arithmetic at one pixel.
    pub(in crate::cpu) fn counts(splat: &Splat, x: u16, y: u16) -> bool {
        let [w1, w2, w3] = splat.w;
        let dy = f32::from(y) + 0.5 - splat.mean[1];
        let (e1, e2) = (w1 * (f32::from(x) + 0.5 - splat.mean[0]) + w2 * dy, w3 * dy);
        splat.opacity * exp2::of_one(e1 * e1 + e2 * e2) >= MIN_ALPHA
    }

    prop_compose! {
        /// From dots to needles of 100,000 px, on and off the image.
        pub(in crate::cpu) fn planted()(
            mean in prop::array::uniform2(prop_oneof![3 => -40.0..140.0_f32, 1 => -5e4..5e4_f32]),
            long in (-3.0..11.5_f32).prop_map(f32::exp),
            aspect in (0.0..14.0_f32).prop_map(f32::exp),
            angle in 0.0..std::f32::consts::PI,
            opacity in prop_oneof![0.004..0.05_f32, 0.05..1.0_f32],
        ) -> Option<Splat> {
            splat(mean, long, long / aspect, angle, opacity)
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            rng_seed: RngSeed::Fixed(7),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// Pixels outside the extents never count.
        #[test]
        fn no_pixel_that_counts_is_left_out(found in planted()) {
            for y in 0..EDGE {
                let band = [y / TILE as u16 * TILE as u16, (y / TILE as u16 + 1) * TILE as u16];
                for x in 0..EDGE {
                    let Some(splat) = found else { continue };
                    let dy = f32::from(y) + 0.5 - splat.mean[1];
                    if !counts(&splat, x, y) {
                        continue;
                    }
                    let inside = |[first, end]: [u16; 2], v: u16| first <= v && v < end;
                    prop_assert!(inside(splat.columns, x) && inside(splat.rows, y), "box of ({x}, {y})");
                    let [low, high] = splat.chord(dy).expect("the line of a pixel that counts");
                    let centre = f32::from(x) + 0.5;
                    prop_assert!(low <= centre && centre <= high, "chord {low}..{high} at ({x}, {y})");
                    let rows = [band[0].max(splat.rows[0]), band[1].min(splat.rows[1])];
                    let columns = splat.outline().columns_in(rows[0], rows[1]);
                    prop_assert!(inside(columns, x), "band {columns:?} of ({x}, {y})");
                }
            }
        }
    }

    #[test]
    fn a_diagonal_needle_covers_few_tiles() {
        let needle = splat([48.0, 48.0], 300.0, 0.1, std::f32::consts::FRAC_PI_4, 1.0).unwrap();
        assert_eq!((needle.columns, needle.rows), ([0, EDGE], [0, EDGE]));
        let tiles = |row: u16| {
            let [first, end] = needle.outline().columns_in(row * 16, row * 16 + 16);
            usize::from(end).div_ceil(TILE) - usize::from(first) / TILE
        };
        // It runs through the corners of tiles, so each row has its own tile and the two neighbours
        // of the corners.
        assert_eq!((0..6).map(tiles).collect::<Vec<_>>(), [2, 3, 3, 3, 3, 2]);
    }
}
