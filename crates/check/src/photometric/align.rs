//! The motion between two pictures that depth and poses do not explain.
//!
//! A pixel `p` of picture `from`, at its depth, lies at `q` in picture `to`. Without a fault,
//! `to(q) = from(p)`. A small error of the relative pose, a twist `x` of the camera `to`, moves `q`
//! by `J x`, so that `to(q) - from(p) = -g J x`, `g` the mean gradient of both pictures (direct image
//! alignment: Irani and Anandan, Vision Algorithms 1999; Kerl et al., ICRA 2013). The least squares
//! over the picture, with the weights of a Cauchy error, give `x`. The size of the fault is the root
//! mean square of `J x` over the pixels, in px: it is well determined even where rotation and
//! translation can hardly be separated. Faults of scale, depth, order and convention all move the
//! picture; those of more than about 2 px are measured too small, but still as large.
//!
//! Depth images are aligned in the same way, by `(depth_to(q) - z) / z`, `z` the depth of the point
//! in view `to`; the twist moves both terms.
//!
//! Pixels whose depth in `to` differs are occluded and left out. The standard error is that of a
//! jackknife over blocks of the picture.

use glam::{DVec2, DVec3};
use gs2e_image::{Image, Size};
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;

/// Maximum number of pixels used per pair; more would only add time.
const MOST_PIXELS: usize = 20_000;
/// Minimum number of pixels for a statement.
const LEAST_PIXELS: usize = 200;
/// Parts of the picture in each direction, for the jackknife.
const BLOCKS: usize = 4;
/// Rounds of reweighting. The weights settle in two or three.
const ROUNDS: usize = 4;
/// Pixels at the border that are left out: smoothing and gradients reach over it.
const BORDER: u32 = 3;

/// The quantity that two pictures are aligned by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlignedQuantity {
    /// Brightness on the grey scale, smoothed by [`smooth_picture`].
    Brightness,
    /// Depth.
    Depth,
}

impl AlignedQuantity {
    /// Relative difference of depths from which on a pixel is occluded.
    fn most_apart(self) -> f64 {
        match self {
            Self::Brightness => 0.02,
            // A wrong depth must not look like an occlusion.
            Self::Depth => 0.05,
        }
    }

    /// Smallest scale of residuals: rounding to 8 bits after smoothing, and to 32 bits.
    fn least_scale(self) -> f64 {
        match self {
            Self::Brightness => 0.3,
            Self::Depth => 1e-6,
        }
    }
}

/// A picture with its depth and pose.
#[derive(Debug, Clone)]
pub struct PosedPicture {
    /// Number of the pose.
    pub pose: usize,
    /// The pose.
    pub world_from_camera: Se3,
    /// Brightness, or depth again.
    pub values: Image<f32>,
    /// Depth along the optical axis; NaN where no depth is known.
    pub depth: Image<f32>,
}

/// The motion between two pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairAlignment {
    /// Numbers of both poses.
    pub poses: [usize; 2],
    /// Motion by depth and poses, root mean square, px.
    pub motion_px: f64,
    /// Motion that is left, root mean square, px.
    pub left_px: f64,
    /// Its standard error, px.
    pub deviation_px: f64,
}

/// Aligns two pictures of one camera. `None` if they share too little.
///
/// # Panics
/// A picture does not have the camera's size.
#[must_use]
pub(crate) fn align_pair(
    quantity: AlignedQuantity,
    camera: &Camera,
    [from, to]: [&PosedPicture; 2],
) -> Option<PairAlignment> {
    for image in [&from.values, &from.depth, &to.values, &to.depth] {
        assert_eq!(image.size(), camera.size, "pictures of the camera's size");
    }
    let rows = PairWarp::new(quantity, camera, from, to).rows();
    let fit = TwistFit::of_rows(&rows, quantity.least_scale())?;
    Some(PairAlignment { poses: [from.pose, to.pose], ..fit })
}

/// A picture smoothed by the binomial filter of five samples, in both directions. Its gradients are
/// linear over more than a pixel.
#[must_use]
pub fn smooth_picture(image: &Image<f32>) -> Image<f32> {
    const WEIGHTS: [f32; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];
    let Size { width, height } = image.size();
    let (w, h) = (width as usize, height as usize);
    let clamped = |i: usize, k: usize, n: usize| (i + k).saturating_sub(2).min(n - 1);
    let mut along_x = Vec::with_capacity(w * h);
    for row in image.pixels().chunks_exact(w.max(1)) {
        let at = |x: usize, k: usize| row[clamped(x, k, w)];
        let edge = |x: usize| (0..5).map(|k| WEIGHTS[k] * at(x, k)).sum::<f32>();
        let inner =
            row.array_windows::<5>().map(|five| WEIGHTS.iter().zip(five).map(|(k, v)| k * v).sum::<f32>());
        // Only two pixels at either end reach over the border.
        along_x.extend((0..w.min(2)).map(edge));
        along_x.extend(inner);
        along_x.extend((w.saturating_sub(2).max(2)..w).map(edge));
    }
    let mut smooth = Vec::with_capacity(w * h);
    for y in 0..h {
        let rows: [&[f32]; 5] = std::array::from_fn(|k| &along_x[clamped(y, k, h) * w..][..w]);
        smooth.extend((0..w).map(|x| (0..5).map(|k| WEIGHTS[k] * rows[k][x]).sum::<f32>()));
    }
    Image::from_vec(image.size(), smooth)
}

/// A pixel's residual, and its change with the twist.
struct WarpRow {
    residual: f64,
    response: [f64; 6],
    /// Motion of the pixel with the twist, px, both axes.
    moves: [[f64; 6]; 2],
    /// Motion by depth and poses, px.
    motion: [f64; 2],
    block: usize,
}

/// The warp of one picture into another.
struct PairWarp<'a> {
    quantity: AlignedQuantity,
    camera: &'a Camera,
    from: &'a PosedPicture,
    to: &'a PosedPicture,
    turn: glam::DMat3,
    shift: DVec3,
    /// Unit of the twist's translation: with the median depth, both halves have one scale.
    unit: f64,
}

impl<'a> PairWarp<'a> {
    fn new(
        quantity: AlignedQuantity,
        camera: &'a Camera,
        from: &'a PosedPicture,
        to: &'a PosedPicture,
    ) -> Self {
        let to_from_world = to.world_from_camera.rotation_matrix().transpose();
        let turn = to_from_world * from.world_from_camera.rotation_matrix();
        // Centres are subtracted first: far from the world's origin, products would cancel.
        let shift = to_from_world * (from.world_from_camera.translation - to.world_from_camera.translation);
        let mut depths: Vec<f32> = from.depth.pixels().iter().copied().filter(|z| z.is_finite()).collect();
        let middle = depths.len() / 2;
        let unit = if depths.is_empty() {
            1.0
        } else {
            f64::from(*depths.select_nth_unstable_by(middle, f32::total_cmp).1)
        };
        Self { quantity, camera, from, to, turn, shift, unit }
    }

    fn rows(&self) -> Vec<WarpRow> {
        let Size { width, height } = self.camera.size;
        // A lattice of pixels, not a random choice: the result is the same in each run.
        let mut step = 1;
        while (width as usize / step) * (height as usize / step) > MOST_PIXELS {
            step += 1;
        }
        let inner = |side: u32| (BORDER..side.saturating_sub(BORDER)).step_by(step);
        inner(height).flat_map(|y| inner(width).filter_map(move |x| self.row(x, y))).collect()
    }

    /// The row of a pixel; `None` without depth, off the other picture, or where it is occluded.
    fn row(&self, x: u32, y: u32) -> Option<WarpRow> {
        let Camera { fx, fy, cx, cy, size, lens } = *self.camera;
        let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        let depth = value_at(&self.from.depth, place)?;
        let point = self.turn * self.camera.unproject(place, depth) + self.shift;
        let [u, v] = self.camera.project(point)?;
        let seen = value_at(&self.to.depth, [u, v])?;
        // Another depth than predicted means that something else is seen there: an occlusion, whose
        // difference says nothing about the poses.
        if (seen / point.z - 1.0).abs() > self.quantity.most_apart() {
            return None;
        }
        // Behind a lens, the place in the picture is not the slope of the ray.
        let (a, b) = lens.map_or(((u - cx) / fx, (v - cy) / fy), |_| (point.x / point.z, point.y / point.z));
        // Linear motion is measured in units of the scene's depth, so that all six columns are
        // pixels of like size and the normal equations are well scaled.
        let near = self.unit / point.z;
        // Motion by a twist (linear, angular) of the point: d(point) = linear + angular x point.
        let moves = [
            [fx * near, 0.0, -fx * a * near, -fx * a * b, fx * (1.0 + a * a), -fx * b],
            [0.0, fy * near, -fy * b * near, -fy * (1.0 + b * b), fy * a * b, fy * a],
        ];
        let moves = lens.map_or(moves, |lens| {
            let bend = lens.distort(DVec2::new(a, b)).1;
            // The lens bends slopes, and `moves` are pixels: the mixed terms change the axis and its unit.
            let [across, down] = [bend.y_axis.x * fx / fy, bend.x_axis.y * fy / fx];
            let bent = |i: usize| {
                [
                    bend.x_axis.x * moves[0][i] + across * moves[1][i],
                    down * moves[0][i] + bend.y_axis.y * moves[1][i],
                ]
            };
            [0, 1].map(|row| std::array::from_fn(|i| bent(i)[row]))
        });
        let [gx, gy] = gradient_at(&self.to.values, [u, v])?;
        let along = |gradient: [f64; 2]| -> [f64; 6] {
            std::array::from_fn(|i| gradient[0] * moves[0][i] + gradient[1] * moves[1][i])
        };
        let (residual, response) = match self.quantity {
            AlignedQuantity::Brightness => {
                // The mean of both gradients is that in the middle of the way, which makes the
                // linear model exact to the second order.
                let [hx, hy] = gradient_at(&self.from.values, place)?;
                let residual = value_at(&self.to.values, [u, v])? - value_at(&self.from.values, place)?;
                (residual, along([0.5 * (gx + hx), 0.5 * (gy + hy)]))
            }
            AlignedQuantity::Depth => {
                // The motion also changes the depth of the point itself, by its third component
                // over its depth.
                let deeper = [0.0, 0.0, near, b, -a, 0.0];
                let response = along([gx / point.z, gy / point.z]);
                (seen / point.z - 1.0, std::array::from_fn(|i| response[i] - deeper[i]))
            }
        };
        let block = |at: u32, side: u32| at as usize * BLOCKS / side as usize;
        let block = block(y, size.height) * BLOCKS + block(x, size.width);
        Some(WarpRow { residual, response, moves, motion: [u - place[0], v - place[1]], block })
    }
}

/// The bilinear value at a place; `None` off the centres of the pixels, or next to a pixel without a
/// value.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places inside of the picture")]
fn value_at(image: &Image<f32>, [x, y]: [f64; 2]) -> Option<f64> {
    let Size { width, height } = image.size();
    let (x, y) = (x - 0.5, y - 0.5);
    // Written so that NaN is outside.
    if !(x >= 0.0 && y >= 0.0 && x < f64::from(width) - 1.0 && y < f64::from(height) - 1.0) {
        return None;
    }
    let (i, j) = (x as usize, y as usize);
    let (a, b) = (x - i as f64, y - j as f64);
    let at = |i: usize, j: usize| f64::from(image.pixels()[j * width as usize + i]);
    let row = |j| (1.0 - a) * at(i, j) + a * at(i + 1, j);
    Some((1.0 - b) * row(j) + b * row(j + 1)).filter(|value| value.is_finite())
}

/// The central difference at a place.
fn gradient_at(image: &Image<f32>, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let along = |dx: f64, dy: f64| {
        Some(0.5 * (value_at(image, [x + dx, y + dy])? - value_at(image, [x - dx, y - dy])?))
    };
    Some([along(1.0, 0.0)?, along(0.0, 1.0)?])
}

/// Normal equations of a twist.
#[derive(Clone, Copy)]
struct TwistFit {
    matrix: [[f64; 6]; 6],
    right: [f64; 6],
}

impl TwistFit {
    const EMPTY: Self = Self { matrix: [[0.0; 6]; 6], right: [0.0; 6] };

    /// The alignment of these rows, with poses 0.
    fn of_rows(rows: &[WarpRow], least_scale: f64) -> Option<PairAlignment> {
        if rows.len() < LEAST_PIXELS {
            return None;
        }
        let n = rows.len() as f64;
        let mut twist = [0.0; 6];
        let mut blocks = [Self::EMPTY; BLOCKS * BLOCKS];
        for _ in 0..ROUNDS {
            let left = |row: &WarpRow| row.residual + dot(&row.response, &twist);
            // The weights of Cauchy's distribution, at twice the median residual: highlights and
            // edges of depth lose their pull, and half of the pixels keep theirs. A picture without
            // noise has a spread of 0, hence the least scale.
            let scale = 2.0 * spread(rows.iter().map(left)).max(least_scale);
            blocks = [Self::EMPTY; BLOCKS * BLOCKS];
            for row in rows {
                let off = left(row) / scale;
                blocks[row.block].add(row, 1.0 / (1.0 + off * off));
            }
            twist = sum_blocks(&blocks, None).solve()?;
        }
        let mut shown = Self::EMPTY;
        for row in rows {
            row.moves.iter().for_each(|moves| shown.add_square(moves, 1.0 / n));
        }
        let size = |twist: &[f64; 6]| shown.square_of(twist).max(0.0).sqrt();
        // The jackknife over blocks of the picture. Residuals of neighbouring pixels depend on each
        // other, so the scatter of single pixels would state too small an error.
        let filled: Vec<usize> = (0..blocks.len()).filter(|i| blocks[*i].matrix[5][5] > 0.0).collect();
        let without = filled.iter().map(|i| {
            let other = sum_blocks(&blocks, Some(*i)).solve()?;
            Some(size(&std::array::from_fn(|i| other[i] - twist[i])).powi(2))
        });
        let squares: Option<f64> = without.sum();
        let count = filled.len() as f64;
        let deviation_px = (squares? * (count - 1.0) / count).sqrt();
        let motion = rows.iter().map(|row| row.motion[0] * row.motion[0] + row.motion[1] * row.motion[1]);
        let motion_px = (motion.sum::<f64>() / n).sqrt();
        Some(PairAlignment { poses: [0; 2], motion_px, left_px: size(&twist), deviation_px })
    }

    fn add(&mut self, row: &WarpRow, weight: f64) {
        self.add_square(&row.response, weight);
        for (right, response) in self.right.iter_mut().zip(row.response) {
            *right -= weight * response * row.residual;
        }
    }

    fn add_square(&mut self, row: &[f64; 6], weight: f64) {
        for (line, a) in self.matrix.iter_mut().zip(row) {
            line.iter_mut().zip(row).for_each(|(sum, b)| *sum += weight * a * b);
        }
    }

    /// `x' A x`.
    fn square_of(&self, x: &[f64; 6]) -> f64 {
        (0..6).map(|i| x[i] * dot(&self.matrix[i], x)).sum()
    }

    /// The twist. A ridge of 1e-9 of the trace keeps directions out that the picture does not show.
    fn solve(&self) -> Option<[f64; 6]> {
        let ridge = 1e-9 * (0..6).map(|i| self.matrix[i][i]).sum::<f64>();
        if !(ridge > 0.0 && ridge.is_finite()) {
            return None;
        }
        let (mut m, mut x) = (self.matrix, self.right);
        (0..6).for_each(|i| m[i][i] += ridge);
        // A positive definite matrix needs no pivots.
        for k in 0..6 {
            for i in k + 1..6 {
                let factor = m[i][k] / m[k][k];
                let pivot = m[k];
                m[i].iter_mut().zip(pivot).skip(k).for_each(|(value, above)| *value -= factor * above);
                x[i] -= factor * x[k];
            }
        }
        for i in (0..6).rev() {
            let known: f64 = (i + 1..6).map(|j| m[i][j] * x[j]).sum();
            x[i] = (x[i] - known) / m[i][i];
        }
        x.iter().all(|v| v.is_finite()).then_some(x)
    }
}

fn sum_blocks(blocks: &[TwistFit], left_out: Option<usize>) -> TwistFit {
    let mut sum = TwistFit::EMPTY;
    for (_, block) in blocks.iter().enumerate().filter(|(i, _)| Some(*i) != left_out) {
        sum.right.iter_mut().zip(block.right).for_each(|(sum, right)| *sum += right);
        for (sums, line) in sum.matrix.iter_mut().zip(block.matrix) {
            sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += value);
        }
    }
    sum
}

fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The standard deviation of a normal distribution with the median size of these values.
fn spread(values: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = values.map(f64::abs).collect();
    let middle = sizes.len() / 2;
    // The median of the absolute value of a normal number is its standard deviation over 1.4826.
    1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    const CAMERA: Camera =
        Camera { size: Size { width: 80, height: 60 }, fx: 90.0, fy: 90.0, cx: 40.0, cy: 30.0, lens: None };

    /// The picture of a wavy wall that is tilted against the camera, and its depth. Independent of
    /// the code under test: each ray meets the wall.
    #[expect(clippy::cast_possible_truncation, reason = "pictures have 32 bits")]
    fn view(pose: usize, world_from_camera: Se3) -> PosedPicture {
        let (mut values, mut depth) = (Vec::new(), Vec::new());
        for i in 0..CAMERA.size.pixels() {
            let pixel = [(i % 80) as f64 + 0.5, (i / 80) as f64 + 0.5];
            let ray = world_from_camera.rotation * CAMERA.unproject(pixel, 1.0);
            let centre = world_from_camera.translation;
            // Along the ray to z = wall(x, y); each round halves the error at least.
            let wall = |p: DVec3| 4.0 + 0.3 * p.x + 0.2 * p.y + 0.15 * (2.0 * p.x).sin() * (2.0 * p.y).cos();
            let t = (0..60).fold(4.0f64, |t, _| (wall(centre + t * ray) - centre.z) / ray.z);
            let at = centre + t * ray;
            let wave = (5.0 * at.x).sin() * (4.0 * at.y + 1.0).cos() + (2.3 * at.x - 3.1 * at.y).sin();
            values.push((120.0 + 50.0 * wave) as f32);
            depth.push(t as f32);
        }
        let image = |pixels| Image::from_vec(CAMERA.size, pixels);
        PosedPicture { pose, world_from_camera, values: smooth_picture(&image(values)), depth: image(depth) }
    }

    fn pose(x: f64, angle: f64) -> Se3 {
        Se3 { rotation: DQuat::from_rotation_y(angle), translation: DVec3::new(x, 0.3 * x, 0.1 * x) }
    }

    #[test]
    fn the_right_geometry_leaves_nothing() {
        let [a, b] = [view(0, pose(0.0, 0.0)), view(1, pose(0.08, 0.01))];
        let found = align_pair(AlignedQuantity::Brightness, &CAMERA, [&a, &b]).unwrap();
        assert!(found.motion_px > 0.7 && found.left_px < 0.02 * found.motion_px, "{found:?}");
    }

    #[test]
    fn a_planted_shift_is_measured_in_pixels() {
        let [a, mut b] = [view(0, pose(0.0, 0.0)), view(1, pose(0.08, 0.01))];
        // A turn of 0.005 moves the picture by about 90 * 0.005 px, more at its edges.
        for turn in [0.005, -0.01] {
            b.world_from_camera = pose(0.08, 0.01 + turn);
            let found = align_pair(AlignedQuantity::Brightness, &CAMERA, [&a, &b]).unwrap();
            let wanted = 90.0 * turn.abs() * 1.06;
            assert!((found.left_px / wanted - 1.0).abs() < 0.08, "{turn}: {found:?}");
        }
    }

    #[test]
    fn depth_shows_a_shift_that_it_can_see() {
        let quantity = AlignedQuantity::Depth;
        let of = |pose: usize, at: Se3| {
            let view = view(pose, at);
            PosedPicture { values: view.depth.clone(), ..view }
        };
        let [a, mut b] = [of(0, pose(0.0, 0.0)), of(1, pose(0.08, 0.01))];
        let sound = align_pair(quantity, &CAMERA, [&a, &b]).unwrap();
        assert!(sound.left_px < 0.05, "{sound:?}");
        b.world_from_camera = pose(0.08, 0.02);
        let turned = align_pair(quantity, &CAMERA, [&a, &b]).unwrap();
        // The turn moves the picture by 0.9 px.
        assert!((turned.left_px / 0.95 - 1.0).abs() < 0.15, "{turned:?}");
    }

    #[test]
    fn pictures_that_share_nothing_say_nothing() {
        let [a, b] = [view(0, pose(0.0, 0.0)), view(1, pose(0.0, 1.5))];
        assert_eq!(align_pair(AlignedQuantity::Brightness, &CAMERA, [&a, &b]), None);
        let mut empty = a.clone();
        empty.depth.pixels_mut().fill(f32::NAN);
        assert_eq!(align_pair(AlignedQuantity::Brightness, &CAMERA, [&empty, &a]), None);
    }
}
