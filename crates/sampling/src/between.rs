//! Brightness between frames, `V = ln(L + k2)` of one pixel at one moment: the sensor's
//! interpolation, written for single moments.

use gs2e_sensor::voltmeter::BetweenFrames;

/// The values of a pixel at a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BetweenKnot {
    /// Time, s.
    pub seconds: f64,
    /// `V` at the frame.
    pub v: f64,
    /// Slope of `V`, 1/s; used by [`BetweenFrames::Hermite`] only.
    pub slope: f64,
}

/// `V` of a pixel between two frames at time `at`, s. `outer` are the frames before and after them,
/// if there are any; [`BetweenFrames::Catmull`] computes its slopes from them.
#[must_use]
pub fn interpolated_value(
    between: BetweenFrames,
    outer: [Option<BetweenKnot>; 2],
    [from, to]: [BetweenKnot; 2],
    at: f64,
) -> f64 {
    let h = to.seconds - from.seconds;
    let s = (at - from.seconds) / h;
    let rise = to.v - from.v;
    let slopes = match between {
        BetweenFrames::Linear => return from.v + s * rise,
        BetweenFrames::Hermite => [from.slope, to.slope],
        BetweenFrames::Catmull => {
            [end_slope(outer[0], from, rise / h, h), end_slope(outer[1], to, rise / h, h)]
        }
    };
    // The Hermite cubic runs over `s` in [0, 1], so a slope per second becomes one per interval.
    let [a, b] = slopes.map(|m| m * h);
    from.v + s * (a + s * (3.0 * rise - 2.0 * a - b + s * (a + b - 2.0 * rise)))
}

/// The slope at an end of an interval of length `h`: the secants on both sides, each weighted by
/// the length of the other.
fn end_slope(beyond: Option<BetweenKnot>, end: BetweenKnot, own: f64, h: f64) -> f64 {
    // At an end of the sequence the slope is one-sided.
    let Some(beyond) = beyond else { return own };
    let secant = (beyond.v - end.v) / (beyond.seconds - end.seconds);
    let other = (beyond.seconds - end.seconds).abs();
    (secant * h + own * other) / (h + other)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [BetweenFrames; 3] = [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite];

    /// Error of each method for a signal, given as value and slope, at the middle of the second of
    /// three intervals.
    fn misses(times: [f64; 4], signal: impl Fn(f64) -> (f64, f64)) -> [f64; 3] {
        let knot = |seconds: f64| {
            let (v, slope) = signal(seconds);
            BetweenKnot { seconds, v, slope }
        };
        let middle = f64::midpoint(times[1], times[2]);
        let [before, from, to, after] = times.map(knot);
        ALL.map(|between| {
            interpolated_value(between, [Some(before), Some(after)], [from, to], middle) - signal(middle).0
        })
    }

    #[test]
    fn a_parabola_misses_a_line_by_h_squared_over_eight_of_its_bend() {
        let (q, h) = (2000.0, 2e-3);
        let parabola = |t: f64| (4.5 + q * t * t - 8.0 * t, 2.0 * q * t - 8.0);
        let [linear, catmull, hermite] = misses([0.0, h, 2.0 * h, 3.0 * h], parabola);
        assert!((linear - q * h * h / 4.0).abs() < 1e-12, "{linear}");
        assert!(catmull.abs() < 1e-12 && hermite.abs() < 1e-12, "{catmull} {hermite}");
        // Uneven steps are weighted so that a parabola is reproduced.
        let [_, catmull, _] = misses([0.0, h, 4.0 * h, 4.5 * h], parabola);
        assert!(catmull.abs() < 1e-12, "{catmull}");
    }

    #[test]
    fn at_an_end_the_slope_is_the_secant() {
        // For a parabola, the one-sided slope has an error of q h, the middle of q h^2/8.
        let (q, h) = (2000.0, 2e-3);
        let knot = |t: f64| BetweenKnot { seconds: t, v: q * t * t, slope: 0.0 };
        let found = interpolated_value(
            BetweenFrames::Catmull,
            [None, Some(knot(2.0 * h))],
            [knot(0.0), knot(h)],
            h / 2.0,
        );
        assert!((found - q * h * h / 4.0 - q * h * h / 8.0).abs() < 1e-12, "{found}");
    }

    #[test]
    fn a_cubic_is_a_hermite_curves_own_at_uneven_steps() {
        let cubic = |t: f64| (4.5 + 1e5 * t * t * t - 40.0 * t, 3e5 * t * t - 40.0);
        let [linear, catmull, hermite] = misses([0.0, 1e-3, 4e-3, 9e-3], cubic);
        assert!(hermite.abs() < 1e-12 && linear.abs() > 1e-3 && catmull.abs() > 1e-6, "{linear} {catmull}");
    }
}
