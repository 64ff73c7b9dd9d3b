//! A projected Gaussian: what the passes after the projection know of it.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "pixel coordinates are clamped to the image before they become integers"
)]

/// Images that a splat can carry a value for, one after another: colour, luminance, depth.
pub(super) const MAX_FEATURES: usize = 5;

/// A Gaussian on the image plane. Its opacity at a pixel is `opacity * 2^-q`,
/// `q = (w1 dx + w2 dy)^2 + (w3 dy)^2` with `(dx, dy)` the pixel's centre minus the mean: the stable form of
/// `numerics.md` 7.2 with `w` scaled by `sqrt(log2(e) / 2)`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Splat {
    /// Mean, px.
    pub(super) mean: [f32; 2],
    /// `w1, w2, w3`, 1/px.
    pub(super) w: [f32; 3],
    /// Opacity at the mean.
    pub(super) opacity: f32,
    /// No pixel with `q` above this reaches the least opacity that is blended; includes a margin for rounding.
    pub(super) reach: f32,
    /// First and end column and row of the pixels that it may touch; never empty.
    pub(super) columns: [u16; 2],
    /// See `columns`.
    pub(super) rows: [u16; 2],
    /// What is blended, in the order of the layout that was asked for.
    pub(super) features: [f32; MAX_FEATURES],
    /// Depth along the optical axis, scene units.
    pub(super) depth: f32,
}

/// Bound on what rounding moves an edge of an extent by, px, where the edge lies `distance` px from the mean: the
/// raster forms `w1 dx + w2 dy` from terms of that size, each rounded twice at 2^-24 of it, and pixel coordinates
/// below 65,536 are rounded at 2^-8.
pub(super) fn edge_margin(distance: f32) -> f32 {
    0.02 + 1e-6 * distance
}

/// The pixels whose centres lie in `[low, high]`: first and end, within `0..end`.
pub(super) fn pixels_within(low: f32, high: f32, end: f32) -> [u16; 2] {
    // a float below 0 or NaN becomes 0
    [(low - 0.5).ceil().clamp(0.0, end) as u16, ((high - 0.5).floor() + 1.0).clamp(0.0, end) as u16]
}

impl Splat {
    /// Where the ellipse `q <= reach` begins and ends in x on the line `dy` px below the mean, or `None` where the
    /// line misses it.
    #[inline]
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

    /// The columns that may be touched in rows `first..end`, which lie within the splat's own.
    pub(super) fn columns_in(&self, first: u16, end: u16) -> [u16; 2] {
        let [w1, w2, w3] = self.w;
        let skew = (w2 * w2 + w3 * w3).sqrt();
        let half = self.reach.sqrt() * skew / (w1 * w3);
        let wide = half + edge_margin(half);
        // The ellipse is widest to the right where dy = turn, to the left where dy = -turn.
        let turn = -w2 * self.reach.sqrt() / (w3 * skew);
        let top = f32::from(first) + 0.5 - self.mean[1];
        let bottom = f32::from(end) - 0.5 - self.mean[1];
        let slack = edge_margin(turn.abs());
        let chord = |dy: f32| {
            let widest = dy >= top - slack && dy <= bottom + slack;
            if widest { None } else { self.chord(dy.clamp(top, bottom)) }
        };
        let low = chord(-turn).map_or(self.mean[0] - wide, |[low, _]| low);
        let high = chord(turn).map_or(self.mean[0] + wide, |[_, high]| high);
        let [x0, x1] = pixels_within(low, high, f32::from(self.columns[1]));
        [x0.max(self.columns[0]), x1]
    }
}
