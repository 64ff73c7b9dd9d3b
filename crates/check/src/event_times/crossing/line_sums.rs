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
    /// Sums of the expected residual `l` by noise that returns, as those of the residual.
    l: f64,
    xl: f64,
    yl: f64,
    /// Sums of the expected covariances of both regressors with the residual.
    late: [f64; 2],
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

    /// Adds the expected residual of an event that [`Self::add`] has added.
    pub(super) fn add_expected(&mut self, [x, y]: [f64; 2], l: f64) {
        (self.l, self.xl, self.yl) = (self.l + l, self.xl + x * l, self.yl + y * l);
    }

    /// Adds the covariances of an event's regressors with its residual, as multiples of the regressors.
    pub(super) fn add_late(&mut self, [x, y]: [f64; 2], late: f64) {
        self.late = [self.late[0] + x * late, self.late[1] + y * late];
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
        let Self { n, x, y, r, l, .. } = self;
        if n < 2.0 {
            return Self::default();
        }
        Self { x: 0.0, y: 0.0, r: 0.0, l: 0.0, ..self.less(MeanSums { n, x, y, r, l }) }
    }

    /// The sums in which the events of a group count by their deviations from the means of the
    /// group.
    pub(super) fn less(self, MeanSums { n, x, y, r, l }: MeanSums) -> Self {
        Self {
            xx: self.xx - x * x / n,
            xy: self.xy - x * y / n,
            yy: self.yy - y * y / n,
            xr: self.xr - x * r / n,
            yr: self.yr - y * r / n,
            xl: self.xl - x * l / n,
            yl: self.yl - y * l / n,
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
            l: of(self.l, o.l),
            xl: of(self.xl, o.xl),
            yl: of(self.yl, o.yl),
            late: [0, 1].map(|i| of(self.late[i], o.late[i])),
            squares: [0, 1].map(|i| of(self.squares[i], o.squares[i])),
            near_bound: [0, 1].map(|i| of(self.near_bound[i], o.near_bound[i])),
        }
    }

    /// Coefficients of `x` and `y`; `None` if they cannot be separated.
    pub(super) fn solve(self) -> Option<[f64; 2]> {
        self.solve_for([self.xr, self.yr])
    }

    /// Sizes of the coefficients that the expected residuals and covariances would have. They may have
    /// opposite signs, and neither is exact for slow drifts, so their sizes add.
    pub(super) fn solve_expected(self) -> Option<[f64; 2]> {
        let [leaning, late] = [self.solve_for([self.xl, self.yl])?, self.solve_for(self.late)?];
        Some([0, 1].map(|i| leaning[i].abs() + late[i].abs()))
    }

    fn solve_for(self, [xr, yr]: [f64; 2]) -> Option<[f64; 2]> {
        let determinant = self.xx * self.yy - self.xy * self.xy;
        // Rounding leaves about 1e-16 of the product where both columns are parallel.
        (determinant > 1e-9 * self.xx * self.yy).then(|| {
            [(self.yy * xr - self.xy * yr) / determinant, (self.xx * yr - self.xy * xr) / determinant]
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
    l: f64,
}

impl MeanSums {
    /// Adds an event with its residual, and the expected one.
    pub(super) fn add(&mut self, [x, y]: [f64; 2], [r, l]: [f64; 2]) {
        *self = Self { n: self.n + 1.0, x: self.x + x, y: self.y + y, r: self.r + r, l: self.l + l };
    }
}
