//! Distances to the nearest other points, by a k-d tree.

use std::ops::Range;

/// Points of a leaf.
const LEAF: usize = 8;
/// Number of neighbours.
const NEIGHBOURS: usize = 3;

/// A balanced tree: the middle of each range of `order` splits it along the longest edge of the box around
/// it, so that needles of points are cut.
struct PointTree<'a> {
    points: &'a [[f32; 3]],
    order: Vec<u32>,
    /// The axis of each split, at the place of its middle in `order`.
    axes: Vec<u8>,
}

/// For each point, the mean of the squared distances to its three nearest others. With fewer others
/// it is the mean over these, and NaN without any.
pub(super) fn neighbour_distances(points: &[[f32; 3]]) -> Vec<f64> {
    use rayon::prelude::*;
    let tree = PointTree::new(points);
    (0..points.len()).into_par_iter().map(|i| tree.mean_square(i)).collect()
}

impl<'a> PointTree<'a> {
    fn new(points: &'a [[f32; 3]]) -> Self {
        let order = (0u32..).take(points.len()).collect();
        let mut tree = Self { points, order, axes: vec![0; points.len()] };
        tree.split(0, points.len());
        tree
    }

    fn split(&mut self, first: usize, end: usize) {
        if end - first <= LEAF {
            return;
        }
        let points = self.points;
        let range = &mut self.order[first..end];
        let edge = |axis: usize| {
            let values = range.iter().map(|&i| points[i as usize][axis]);
            let [low, high] =
                values.fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
            high - low
        };
        let edges = [edge(0), edge(1), edge(2)];
        let axis = (0..3u8).fold(0, |a, b| if edges[usize::from(b)] > edges[usize::from(a)] { b } else { a });
        let middle = range.len() / 2;
        let value = |i: &u32| points[*i as usize][usize::from(axis)];
        // Ties are broken by the index, so that the tree is the same on every machine.
        range.select_nth_unstable_by(middle, |a, b| value(a).total_cmp(&value(b)).then(a.cmp(b)));
        self.axes[first + middle] = axis;
        self.split(first, first + middle);
        self.split(first + middle + 1, end);
    }

    fn mean_square(&self, i: usize) -> f64 {
        let mut nearest = [f64::INFINITY; NEIGHBOURS];
        self.search(i, 0..self.points.len(), &mut nearest);
        let (sum, count) =
            nearest.iter().filter(|d| d.is_finite()).fold((0.0, 0.0), |(s, n), d| (s + d, n + 1.0));
        sum / count
    }

    /// Takes the nearest of a range into `nearest`, which ascends.
    fn search(&self, of: usize, range: Range<usize>, nearest: &mut [f64; NEIGHBOURS]) {
        if range.len() <= LEAF {
            self.order[range].iter().for_each(|&i| self.take(of, i as usize, nearest));
            return;
        }
        let middle = range.start + range.len() / 2;
        let (at, axis) = (self.order[middle] as usize, usize::from(self.axes[middle]));
        self.take(of, at, nearest);
        let beyond = f64::from(self.points[of][axis]) - f64::from(self.points[at][axis]);
        let (low, high) = (range.start..middle, middle + 1..range.end);
        let (near, far) = if beyond < 0.0 { (low, high) } else { (high, low) };
        self.search(of, near, nearest);
        // Points beyond the split are at least this far away, so most far halves are never entered.
        if beyond * beyond < nearest[NEIGHBOURS - 1] {
            self.search(of, far, nearest);
        }
    }

    fn take(&self, of: usize, i: usize, nearest: &mut [f64; NEIGHBOURS]) {
        if i == of {
            return;
        }
        let pairs = self.points[of].iter().zip(self.points[i]);
        let mut d: f64 = pairs.map(|(a, b)| (f64::from(*a) - f64::from(b)).powi(2)).sum();
        for place in nearest {
            if d < *place {
                std::mem::swap(place, &mut d);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::seed::{DrawSpace, Seed, SeedCell};

    /// Every pair, sorted.
    #[test]
    #[expect(clippy::cast_possible_truncation, reason = "points hold 32 bits")]
    fn distances_are_those_of_all_pairs() {
        let mut draws = Seed(4).draws(SeedCell { x: 0, y: 0, level: 0, index: 0 }, DrawSpace::Choice);
        for count in [1, 2, 4, 9, 300] {
            // Steps of 1/16 along one axis, so that many coordinates are equal.
            let points: Vec<[f32; 3]> = (0..count)
                .map(|_| {
                    [draws.index(16) as f32 / 16.0, draws.uniform() as f32, draws.uniform() as f32 * 0.01]
                })
                .collect();
            let found = neighbour_distances(&points);
            for (i, p) in points.iter().enumerate() {
                let square = |q: &[f32; 3]| -> f64 {
                    p.iter().zip(q).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum()
                };
                let mut all: Vec<f64> =
                    points.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, q)| square(q)).collect();
                all.sort_by(f64::total_cmp);
                all.truncate(3);
                let wanted = all.iter().sum::<f64>() / all.len() as f64;
                assert!(
                    found[i].to_bits() == wanted.to_bits() || (found[i].is_nan() && wanted.is_nan()),
                    "{count}, {i}"
                );
            }
        }
    }
}
