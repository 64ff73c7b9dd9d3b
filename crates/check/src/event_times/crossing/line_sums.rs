//! Sums for a regression of residuals on two regressors, without a constant.

use super::BAND;

/// Sums over events: of `x = rate`, `y = rate (t - m)` and the residual `r`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LineSums {
    pub(super) n: f64,
    x: f64,
    y: f64,
    r: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    xr: f64,
    yr: f64,
    /// `x^2` and `y^2` of the same events, without a subtraction of means.
    squares: [f64; 2],
    /// `squares` of the events with a residual near the bound, on either side of it.
    near_bound: [f64; 2],
}

impl LineSums {
    pub(super) fn add(&mut self, [x, y]: [f64; 2], r: f64) {
        self.n += 1.0;
        (self.x, self.y, self.r) = (self.x + x, self.y + y, self.r + r);
        (self.xx, self.xy, self.yy) = (self.xx + x * x, self.xy + x * y, self.yy + y * y);
        (self.xr, self.yr) = (self.xr + x * r, self.yr + y * r);
        self.squares = [self.squares[0] + x * x, self.squares[1] + y * y];
    }

    /// Adds an event whose residual is near the bound.
    pub(super) fn add_near_bound(&mut self, [x, y]: [f64; 2]) {
        self.near_bound = [self.near_bound[0] + x * x, self.near_bound[1] + y * y];
    }

    /// Shares of a small fault that the coefficients show. The band has a width of twice [`BAND`].
    pub(super) fn responses(self) -> [f64; 2] {
        [0, 1].map(|i| 1.0 - self.near_bound[i] / (2.0 * BAND * self.squares[i]))
    }

    /// Degrees of freedom of the standard errors of both coefficients, from the shares of the
    /// blocks.
    pub(super) fn freedom(self, blocks: &[Self]) -> [f64; 2] {
        let of = |square: fn(&Self) -> f64| {
            let shares = blocks.iter().map(|block| square(block) / square(&self));
            // Equal parts give their number, and one part that outweighs all others gives 1.
            1.0 / shares.map(|share| share * share).sum::<f64>()
        };
        [of(|sums| sums.xx), of(|sums| sums.yy)]
    }

    /// The sums of the deviations from the means.
    pub(super) fn centred(self) -> Self {
        let Self { n, x, y, r, .. } = self;
        if n < 2.0 {
            return Self::default();
        }
        Self { x: 0.0, y: 0.0, r: 0.0, ..self.less(MeanSums { n, x, y, r }) }
    }

    /// The sums in which the events of a group count by their deviations from the means of the
    /// group.
    pub(super) fn less(self, MeanSums { n, x, y, r }: MeanSums) -> Self {
        Self {
            xx: self.xx - x * x / n,
            xy: self.xy - x * y / n,
            yy: self.yy - y * y / n,
            xr: self.xr - x * r / n,
            yr: self.yr - y * r / n,
            ..self
        }
    }

    pub(super) fn plus(self, o: Self, sign: f64) -> Self {
        let of = |a: f64, b: f64| a + sign * b;
        Self {
            n: of(self.n, o.n),
            x: of(self.x, o.x),
            y: of(self.y, o.y),
            r: of(self.r, o.r),
            xx: of(self.xx, o.xx),
            xy: of(self.xy, o.xy),
            yy: of(self.yy, o.yy),
            xr: of(self.xr, o.xr),
            yr: of(self.yr, o.yr),
            squares: [0, 1].map(|i| of(self.squares[i], o.squares[i])),
            near_bound: [0, 1].map(|i| of(self.near_bound[i], o.near_bound[i])),
        }
    }

    /// Coefficients of `x` and `y`; `None` if they cannot be separated.
    pub(super) fn solve(self) -> Option<[f64; 2]> {
        let determinant = self.xx * self.yy - self.xy * self.xy;
        // Rounding leaves about 1e-16 of the product where both columns are parallel.
        (determinant > 1e-9 * self.xx * self.yy).then(|| {
            [
                (self.yy * self.xr - self.xy * self.yr) / determinant,
                (self.xx * self.yr - self.xy * self.xr) / determinant,
            ]
        })
    }
}

/// Sums over a group of events.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MeanSums {
    pub(super) n: f64,
    x: f64,
    y: f64,
    r: f64,
}

impl MeanSums {
    pub(super) fn add(&mut self, [x, y]: [f64; 2], r: f64) {
        *self = Self { n: self.n + 1.0, x: self.x + x, y: self.y + y, r: self.r + r };
    }
}
