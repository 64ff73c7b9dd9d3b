//! Weighted means over the window of SSIM, first along rows and then across them.

/// Pixels of the window on each side of its centre.
pub(super) const REACH: usize = 5;
/// Rows of the window.
pub(super) const EDGE: usize = 2 * REACH + 1;
/// Values of a pixel.
pub(super) const CHANNELS: usize = 3;
/// Zeros before and after a row, for windows beyond the border.
pub(super) const PAD: usize = REACH * CHANNELS;

/// The weights of the window from its centre outwards; both sides together have the sum 1.
#[expect(clippy::cast_possible_truncation, reason = "rounded once, after the arithmetic")]
pub(super) fn window_weights() -> [f32; REACH + 1] {
    let weight = |k: usize| libm::exp(-0.5 * (k as f64 / 1.5) * (k as f64 / 1.5));
    let sum = 1.0 + 2.0 * (1..=REACH).map(weight).sum::<f64>();
    std::array::from_fn(|k| (weight(k) / sum) as f32)
}

/// The values of a row with zeros at both ends.
pub(super) struct PaddedRow(Vec<f32>);

impl PaddedRow {
    pub(super) fn new(len: usize) -> Self {
        Self(vec![0.0; len + 2 * PAD])
    }

    #[inline(always)]
    pub(super) fn inner(&self) -> &[f32] {
        &self.0[PAD..self.0.len() - PAD]
    }

    #[inline(always)]
    pub(super) fn inner_mut(&mut self) -> &mut [f32] {
        let end = self.0.len() - PAD;
        &mut self.0[PAD..end]
    }

    /// The weighted mean around each value, along the row.
    #[inline(always)]
    pub(super) fn mean_into(&self, w: &[f32; REACH + 1], out: &mut [f32]) {
        let n = out.len();
        let at = |k: usize| &self.0[k * CHANNELS..][..n];
        weighted_sum(w, std::array::from_fn(at), out);
    }
}

/// The horizontal means of `N` quantities over the rows of a window.
pub(super) struct RowRing<const N: usize> {
    rows: Vec<[Vec<f32>; N]>,
}

impl<const N: usize> RowRing<N> {
    pub(super) fn new(len: usize) -> Self {
        Self { rows: (0..EDGE).map(|_| std::array::from_fn(|_| vec![0.0; len])).collect() }
    }

    /// The place of a row. The ring begins with zeros, which are the rows above the image.
    #[inline(always)]
    pub(super) fn place(&mut self, row: usize) -> &mut [Vec<f32>; N] {
        &mut self.rows[row % EDGE]
    }

    /// The weighted mean of quantity `q` over the window around row `y`.
    #[inline(always)]
    pub(super) fn mean_into(&self, q: usize, y: usize, w: &[f32; REACH + 1], out: &mut [f32]) {
        let n = out.len();
        // `y + k` is `y + k - EDGE` in the ring, and below zero for no `k`.
        let at = |k: usize| &self.rows[(y + EDGE + k - REACH) % EDGE][q][..n];
        weighted_sum(w, std::array::from_fn(at), out);
    }
}

/// The weighted sum of the eleven `values`, place by place.
#[inline(always)]
fn weighted_sum(w: &[f32; REACH + 1], values: [&[f32]; EDGE], out: &mut [f32]) {
    let n = out.len();
    // Slices of one length, so that the loop has no check of bounds.
    let [a, b, c, d, e, f, g, h, i, j, k] = values.map(|of| &of[..n]);
    for x in 0..n {
        // The window is symmetric: equal weights share a multiplication, six instead of eleven.
        out[x] = w[0] * f[x]
            + w[1] * (e[x] + g[x])
            + w[2] * (d[x] + h[x])
            + w[3] * (c[x] + i[x])
            + w[4] * (b[x] + j[x])
            + w[5] * (a[x] + k[x]);
    }
}
