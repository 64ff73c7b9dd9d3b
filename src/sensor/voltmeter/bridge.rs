//! First passages of a Brownian bridge: which barriers are within reach, and when the path first touches one.
//!
//! Between fixed ends the drift has dropped out: what is left is a bridge of variance `v` from `x` to `y`. It touches a
//! barrier at distances `a` and `g` from its ends with probability `exp(-2 a g / v)` (reflection), and the ratio of the
//! time before the touch to the time after it is inverse Gaussian of mean `a/g` and shape `a^2/v`.

/// A voltage may end a cell without a look at this barrier if the path touches it with probability below `e^-40`.
const NEGLIGIBLE: f64 = 40.0;

/// The two thresholds: an event happens where the voltage reaches `up` or `-down`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Barriers {
    pub(super) up: f64,
    pub(super) down: f64,
}

/// The barriers that a path may touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Live {
    Neither,
    Up,
    Down,
    Both,
}

impl Barriers {
    /// Barriers nearer by `distance`, for a path that may stray so far from the straight line.
    pub(super) fn shrunk(self, distance: f64) -> Self {
        Self { up: self.up - distance, down: self.down - distance }
    }

    /// The barriers that a path from `x` to `y` with variance `v` may touch.
    pub(super) fn live(self, x: f64, y: f64, v: f64) -> Live {
        match (within_reach(self.up - x, self.up - y, v), within_reach(self.down + x, self.down + y, v)) {
            (false, false) => Live::Neither,
            (true, false) => Live::Up,
            (false, true) => Live::Down,
            (true, true) => Live::Both,
        }
    }

    /// The one of the two that a path from `x` to `y` touches with the larger probability.
    pub(super) fn likelier(self, x: f64, y: f64) -> Side {
        if (self.up - x) * (self.up - y) <= (self.down + x) * (self.down + y) { Side::Up } else { Side::Down }
    }
}

/// Whether a barrier at distances `a` and `g` from the ends (beyond it: negative) counts.
fn within_reach(a: f64, g: f64, v: f64) -> bool {
    a <= 0.0 || g <= 0.0 || 2.0 * a * g < NEGLIGIBLE * v
}

/// One of the barriers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Up,
    Down,
}

impl Side {
    /// Distance of a voltage from the barrier; negative beyond it.
    pub(super) fn distance(self, barriers: Barriers, voltage: f64) -> f64 {
        match self {
            Self::Up => barriers.up - voltage,
            Self::Down => barriers.down + voltage,
        }
    }

    /// What an event takes from every voltage that follows.
    pub(super) fn step(self, barriers: Barriers) -> f64 {
        match self {
            Self::Up => barriers.up,
            Self::Down => -barriers.down,
        }
    }
}

/// Probability that the path touches a barrier at distances `a > 0` and `g` from its ends.
pub(super) fn touch_probability(a: f64, g: f64, v: f64) -> f64 {
    if g <= 0.0 { 1.0 } else { libm::exp(-2.0 * a * g / v) }
}

/// When the path first touches the barrier, given that it does: the time as a share of the path's length, in 0..=1.
/// `a > 0` and `g >= 0` are the distances of its ends from the barrier, on whichever side; `z` is a standard normal
/// deviate and `u` a uniform one.
///
/// Inverse Gaussian by Michael, Schucany, Haas (The American Statistician 30, 1976), in a form that adds only like
/// signs, so that it holds for every `phi = a g / v` (at `phi = 0` it is the Lévy law).
pub(super) fn touch_time(a: f64, g: f64, v: f64, z: f64, u: f64) -> f64 {
    const HUGE: f64 = 1e290;
    let (shape, phi) = (a * a / v, a * g / v);
    let noisy = v > 0.0 && shape < HUGE && phi < HUGE;
    if !noisy {
        return a / (a + g);
    }
    let z = z.abs();
    let q = phi + 0.5 * z * z + z * (0.25 * z * z + phi).sqrt();
    let ratio = if u * (q + phi) <= q { shape / q } else { a / g * (q / phi) };
    if ratio.is_finite() { ratio / (1.0 + ratio) } else { 1.0 }
}
