//! Noise of poses against the smoothness of their path.
//!
//! The differences of order `k` of white noise of variance `s^2` have the mean square `C(2k, k) s^2`
//! at any stride. Those of a path grow with the stride: the slope of a corner doubles, which makes
//! four times the square in twice as many places, and the content of smooth pieces grows by 4^k. So
//! the sums of squares at strides 2 and 1, over the same part of a path, have a ratio of at least
//! 4.4 at a corner (4.7, 4.4 and 6 for orders 4, 6 and 2, from the values of a kink at any place
//! between two samples), and more elsewhere. For noise, for one displaced pose, and for two swapped
//! poses the ratio is near 1. The path's own size cancels, so bursts and cusps of the speed are no
//! noise.
//!
//! The argument needs a path that is sampled several times between its knots. A corner at every
//! pose is noise to every measure.

/// Orders of differences. Low orders reach further to the ends of a path, and high orders suppress
/// more of it.
const ORDERS: [usize; 3] = [2, 4, 6];
/// Half-widths of the compared parts, in addition to the reach of one difference: a single pose, and
/// longer parts in which noise averages out.
const MORE: [usize; 3] = [0, 5, 10];
/// Ratio of the squares at strides 2 and 1 below which a part is noise: halfway, as a factor,
/// between 1 and the 4.4 of a corner.
const NOISE_RATIO: f64 = 2.1;
/// Smallest noise that is a fault, as a share of the median step. Rounding and interpolation of
/// other programs stay below it.
pub(super) const FLOOR: f64 = 1e-3;
/// Share of the poses at which a displacement must be seen for the stated power, in percent.
const POWER_PERCENT: usize = 95;

/// A point of a path in up to four dimensions: a position, or a unit quaternion.
pub(super) type PathPoint = [f64; 4];

/// Noise of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PathNoise {
    /// Standard deviation of the noise, or displacement of a single pose, in the unit of the
    /// points; 0 if the path explains all differences.
    pub(super) size: f64,
    /// The pose in the middle of the noisiest part.
    pub(super) pose: usize,
    /// Displacement of a single pose that would have been found at 95 % of the poses that were
    /// compared.
    pub(super) detects: f64,
    /// Poses at either end that no part is centred on.
    pub(super) ends: usize,
}

/// Measures the noise of a path; `floor` is the smallest that counts. `None` for a path that is too
/// short.
pub(super) fn path_noise(points: &[PathPoint], floor: f64) -> Option<PathNoise> {
    let orders: Vec<OrderSquares> = ORDERS.iter().filter_map(|k| OrderSquares::new(points, *k)).collect();
    let ends = orders.iter().map(|of| of.first_centre(0)).min()?;
    let mut found = PathNoise { size: 0.0, pose: 0, detects: f64::INFINITY, ends };
    for (of, more) in orders.iter().flat_map(|of| MORE.map(|more| (of, more))) {
        for pose in of.centres(more) {
            // The part itself must be above the floor: rounding has the ratio of noise everywhere.
            let is_noise = of.noise_at(pose, more) > floor;
            // A part above the floor is a fault, even if it is less in its neighbourhood.
            let size = if is_noise { of.size_at(pose).max(1.01 * floor) } else { 0.0 };
            if size > found.size {
                (found.size, found.pose) = (size, pose);
            }
        }
    }
    let mut needed: Vec<f64> = (ends..points.len() - ends)
        .map(|pose| {
            let of = orders.iter().filter(|of| of.centres(0).contains(&pose));
            of.map(|of| of.displacement_at(pose)).fold(f64::INFINITY, f64::min).max(floor)
        })
        .collect();
    needed.sort_unstable_by(f64::total_cmp);
    // The pose below which 95 % of the others lie.
    found.detects = needed[((needed.len() - 1) * POWER_PERCENT).div_ceil(100)];
    Some(found)
}

/// Squares of the differences of one order, at strides 1 and 2, as running sums.
struct OrderSquares {
    order: usize,
    poses: usize,
    /// `C(2k, k)`, the mean square of the differences of white noise of variance 1.
    gain: f64,
    sums: [Vec<f64>; 2],
}

impl OrderSquares {
    /// `None` if no part of the path is long enough.
    fn new(points: &[PathPoint], order: usize) -> Option<Self> {
        let signs = binomials(order);
        let gain = signs.iter().map(|c| c * c).sum();
        let sums = [1, 2].map(|stride| running_squares(points, &signs, stride));
        let of = Self { order, poses: points.len(), gain, sums };
        (!of.centres(0).is_empty()).then_some(of)
    }

    /// Number of differences on either side of the middle one, at stride 1.
    fn half(&self, more: usize) -> usize {
        self.order / 2 + more
    }

    /// Number of differences at stride 2, so that it holds every pose of a difference at stride 1.
    fn wide(&self, more: usize) -> usize {
        self.half(more) + self.order / 2 + 1
    }

    /// The first pose with a whole part around it.
    fn first_centre(&self, more: usize) -> usize {
        self.wide(more) + self.order
    }

    fn centres(&self, more: usize) -> std::ops::Range<usize> {
        let first = self.first_centre(more);
        first..self.poses.saturating_sub(first).max(first)
    }

    /// Sums of squares at both strides around a pose.
    fn squares_at(&self, pose: usize, more: usize) -> [f64; 2] {
        let of = |stride: usize, half: usize| {
            // A difference is centred half its length after its first point.
            let middle = pose - stride * self.order / 2;
            (self.sums[stride - 1][middle + half + 1] - self.sums[stride - 1][middle - half]).max(0.0)
        };
        [of(1, self.half(more)), of(2, self.wide(more))]
    }

    /// Noise of the part around a pose; 0 if it is not noise.
    fn noise_at(&self, pose: usize, more: usize) -> f64 {
        let [near, far] = self.squares_at(pose, more);
        // A single pose makes all squares of its own part; noise makes each.
        let count = if more == 0 { 1.0 } else { (2 * self.half(more) + 1) as f64 };
        if far < NOISE_RATIO * near { (near / (count * self.gain)).sqrt() } else { 0.0 }
    }

    /// Size of the noise around a pose: the displacement of this pose if it makes nearly all
    /// squares in its neighbourhood, or else the standard deviation of all.
    fn size_at(&self, pose: usize) -> f64 {
        let sums = &self.sums[0];
        let middle = pose - self.order / 2;
        let between = |half: usize| {
            let (first, end) = (middle.saturating_sub(half), (middle + half + 1).min(sums.len() - 1));
            ((sums[end] - sums[first]).max(0.0), (end - first) as f64)
        };
        let ((own, _), (all, count)) = (between(self.half(0)), between(self.half(MORE[2])));
        (if own > 0.8 * all { own } else { all / count } / self.gain).sqrt()
    }

    /// Displacement of this pose that would be found whatever its direction. It adds `f^2` to both
    /// squares, and at worst lowers the root of one and raises that of the other by the path's own.
    fn displacement_at(&self, pose: usize) -> f64 {
        let [near, far] = self.squares_at(pose, 0);
        let root = NOISE_RATIO.sqrt();
        (far.sqrt() + root * near.sqrt()) / (root - 1.0) / self.gain.sqrt()
    }
}

/// The coefficients of a difference, with alternating signs.
fn binomials(order: usize) -> Vec<f64> {
    (0..order).fold(vec![1.0], |row, _| {
        let next = |i: usize| row.get(i).copied().unwrap_or(0.0) - if i > 0 { row[i - 1] } else { 0.0 };
        (0..=row.len()).map(next).collect()
    })
}

/// Sums of the squared differences before each one.
fn running_squares(points: &[PathPoint], signs: &[f64], stride: usize) -> Vec<f64> {
    let count = points.len().saturating_sub(stride * (signs.len() - 1));
    let mut sums = vec![0.0];
    for first in 0..count {
        let part = |axis: usize| -> f64 {
            // Relative to the first point: far from the origin, the digits of the position would
            // hide the difference.
            let steps = signs.iter().enumerate();
            steps.map(|(i, c)| c * (points[first + i * stride][axis] - points[first][axis])).sum()
        };
        let square: f64 = (0..4).map(|axis| part(axis) * part(axis)).sum();
        sums.push(sums[first] + square);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::SplitMixDraws;

    /// Numbers from -1 to 1 whose variance is 1/3.
    fn draw(draws: &mut SplitMixDraws) -> f64 {
        draws.below(2_000_001) as f64 / 1e6 - 1.0
    }

    fn path(point: impl Fn(f64) -> [f64; 2]) -> Vec<PathPoint> {
        (0..60).map(|j| point(f64::from(j))).map(|[x, y]| [x, y, 0.0, 0.0]).collect()
    }

    /// Smooth, cornered and uneven paths with steps of about 1.
    fn sound_paths() -> Vec<(&'static str, Vec<PathPoint>)> {
        let zigzag = |t: f64| (t / 7.3).fract().min(1.0 - (t / 7.3).fract()) * 7.3;
        vec![
            ("line", path(|t| [t, 0.0])),
            ("circle", path(|t| [200.0 * (t / 200.0).cos(), 200.0 * (t / 200.0).sin()])),
            ("corners", path(|t| [t, zigzag(t)])),
            ("corner at a pose", path(|t| [t.min(30.0), (t - 30.0).max(0.0)])),
            ("cusp of the speed", path(|t| [(t - 30.3) * (t - 30.3).abs() / 30.0, 0.0])),
            ("jump of the speed", path(|t| [t + 9.0 * (t - 20.4).max(0.0), 0.0])),
            ("bursts", path(|t| [t - 1.59 * (t * 0.6).cos(), 0.0])),
            ("still", path(|_| [3.0, 4.0])),
        ]
    }

    #[test]
    fn sound_paths_have_no_noise() {
        for (name, points) in sound_paths() {
            let found = path_noise(&points, FLOOR).unwrap();
            assert!(found.size < f64::MIN_POSITIVE, "{name}: {found:?}");
        }
    }

    #[test]
    fn noise_is_measured_where_the_path_is_smooth() {
        let mut draws = SplitMixDraws(3);
        for (name, points) in sound_paths().into_iter().take(2) {
            for size in [0.01, 0.1, 0.5] {
                let mut shaken = points.clone();
                let mut shake = || size * 3f64.sqrt() * draw(&mut draws);
                shaken.iter_mut().for_each(|p| *p = [p[0] + shake(), p[1] + shake(), p[2] + shake(), 0.0]);
                let found = path_noise(&shaken, FLOOR).unwrap();
                // The noisiest part of some dozens; its three axes add to 1.7.
                assert!((1.5..4.0).contains(&(found.size / size)), "{name} {size}: {found:?}");
            }
        }
    }

    #[test]
    fn a_pose_displaced_by_the_stated_power_is_found_at_nearly_every_place() {
        for (name, points) in sound_paths() {
            let PathNoise { detects, ends, .. } = path_noise(&points, FLOOR).unwrap();
            let places = ends..points.len() - ends;
            let is_found = |pose: usize| {
                let mut moved = points.clone();
                moved[pose][1] += 1.001 * detects;
                path_noise(&moved, FLOOR).unwrap().size > 0.0
            };
            let found = places.clone().filter(|pose| is_found(*pose)).count();
            assert!(100 * found >= POWER_PERCENT * (places.len() - 1), "{name}: {found} of {places:?}");
        }
    }

    #[test]
    fn swapped_poses_are_found() {
        for (name, points) in sound_paths().into_iter().take(4) {
            for pose in 5..53 {
                let mut swapped = points.clone();
                swapped.swap(pose, pose + 1);
                assert!(path_noise(&swapped, FLOOR).unwrap().size > 0.1, "{name} {pose}");
            }
        }
    }

    #[test]
    fn a_short_path_says_nothing() {
        assert_eq!(path_noise(&path(|t| [t, 0.0])[..10], FLOOR), None);
        assert!(path_noise(&path(|t| [t, 0.0])[..11], FLOOR).is_some());
    }
}
