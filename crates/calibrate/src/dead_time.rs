//! The dead time from the shortest gaps between two events of a pixel.
//!
//! Just above a dead time, gaps lie evenly: hot pixels, noise and late events make them. Without one, they
//! thin out towards 0 as a power of their length. Where the light changes no faster than a bound, gaps have a
//! shortest length too, but thin out towards it.

use crate::estimate::Estimate;
use crate::recording::PixelTrains;

/// Lengths, in shortest gaps, up to which gaps are counted.
const LENGTHS: [f64; 3] = [1.25, 1.5, 2.0];
/// Largest growth of the counts from one to the next: evenly spread gaps grow by 2.
const GROWTH: f64 = 2.6;
/// Fewest gaps up to the first and up to the last length.
const FEWEST: [f64; 2] = [10.0, 30.0];
/// Stamps of whole microseconds know no shorter dead time, us.
const SHORTEST_US: f64 = 40.0;
/// Largest share by which the gaps next to the edge fall short of an even law, by the square root of their
/// number: an even law exceeds it once in 2000 (Smirnov, one-sided).
const SHORTFALL: f64 = 1.95;
/// Longest dead time of a camera, us.
const LONGEST_US: f64 = 2000.0;

/// The dead time, and the longest that is possible: a gap that is seen is a bound.
pub(crate) fn dead_time(trains: &PixelTrains) -> (Estimate, f64) {
    let pixels = (0..trains.pixels()).map(|pixel| trains.of(pixel).0);
    let gaps: Vec<i64> = pixels.flat_map(|us| us.windows(2).map(|pair| pair[1] - pair[0])).collect();
    let Some(shortest) = gaps.iter().min().map(|gap| *gap as f64) else {
        return (Estimate::unknown(0.0), 0.0);
    };
    let below = |length: f64| gaps.iter().filter(|gap| (**gap as f64) < length * shortest).count() as f64;
    let counts = LENGTHS.map(below);
    // Gaps that lie evenly above the edge are this far apart, and so is the first from it.
    let apart = shortest * (LENGTHS[2] - 1.0) / counts[2];
    let is_even = counts.windows(2).all(|pair| pair[1] <= GROWTH * pair[0]);
    let is_enough = counts[0] >= FEWEST[0] && counts[2] >= FEWEST[1];
    let is_edge = shortfall(&gaps, shortest, LENGTHS[0] * shortest) <= SHORTFALL;
    // Two stamps that are rounded down are up to a microsecond closer or farther.
    let found = Estimate::found((shortest - apart).max(0.0), apart.max(1.0));
    let found = found.only_if(shortest >= SHORTEST_US && is_even && is_enough && is_edge, 0.0);
    (found, shortest.min(LONGEST_US))
}

/// How far the gaps from `from` to `to` fall short of an even law, by the square root of their number.
fn shortfall(gaps: &[i64], from: f64, to: f64) -> f64 {
    let mut near: Vec<f64> = gaps.iter().map(|gap| *gap as f64).filter(|gap| *gap < to).collect();
    near.sort_by(f64::total_cmp);
    let n = near.len() as f64;
    let short = |(below, gap): (usize, &f64)| (gap - from) / (to - from) - below as f64 / n;
    near.iter().enumerate().map(short).fold(0.0, f64::max) * n.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaps above an edge of 1,000 us: evenly, and more and more with their length.
    #[test]
    fn an_edge_is_not_a_slope() {
        let even: Vec<i64> = (0..200).map(|i| 1000 + 5 * i / 4).collect();
        let slope: Vec<i64> = (0..200).map(|i: i64| 1000 + (1250 * i).isqrt() / 2).collect();
        assert!(shortfall(&even, 1000.0, 1250.0) < SHORTFALL);
        assert!(shortfall(&slope, 1000.0, 1250.0) > SHORTFALL);
    }
}
