//! Points on the surfaces that photos show, found without any key point: a plane sweep (R. T.
//! Collins, "A space-sweep approach to true multi-image matching", CVPR 1996) for single pixels.
//!
//! A pixel's ray is cut into steps of equal inverse depth. At each step the square around the pixel
//! is projected into four other views, and compared. Half of these views may be occluded, so only
//! the better half counts (S. B. Kang, R. Szeliski and J. Chai, "Handling occlusions in dense
//! multi-view stereo", CVPR 2001). A depth is kept if no other depth is nearly as good, and if the
//! sweep of the best other view finds the same point.

use super::photos::TrainingView;
use glam::DVec3;
use gs2e_image::Image;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;

/// Longest side of the photos that are compared, px.
const LONGEST_SIDE: u32 = 320;
/// Views that a view is compared with, at most.
const OTHERS: usize = 4;
/// Steps of a sweep, and the parts of a step in which the best one is refined.
const STEPS: usize = 128;
const PARTS: usize = 8;
/// Range of a sweep, relative to the inverse of the typical depth.
const INVERSE_DEPTHS: [f64; 2] = [0.02, 4.0];
/// Reach of the square around a pixel, px.
const REACH: usize = 2;
const SIDE: usize = 2 * REACH + 1;
/// Distance of a square from the middles of the outer pixels, px.
const MARGIN: f32 = 0.01;
/// Largest mean difference of two squares that show the same surface, of 255.
const MAX_COST: f32 = 20.0;
/// A second depth must be worse by this factor and by this difference. Flat areas have no best depth.
const DISTINCT: (f32, f32) = (1.25, 1.0);
/// Steps around the best one that belong to it.
const SAME_STEPS: usize = 2;
/// Steps by which the sweeps of two views may differ.
const AGREEMENT: f64 = 1.5;
/// Angle between two views of a point that shows its depth best, and how far smaller and larger
/// ones may be from it, degrees (Y. Yao et al., "MVSNet", ECCV 2018, section 4.1).
const BEST_ANGLE: f64 = 5.0;
const ANGLE_WIDTHS: [f64; 2] = [1.0, 10.0];

/// A photo at the size of the sweep, and the views that it is compared with.
#[derive(Debug)]
struct SweptView {
    camera: Camera,
    world_from_camera: Se3,
    colours: Image<[u8; 3]>,
    counted: Option<Image<bool>>,
    /// Depth around which surfaces are expected, scene units.
    typical: f64,
    others: Vec<usize>,
}

/// The photos of a training, ready to be swept.
#[derive(Debug)]
pub(super) struct PlaneSweep {
    views: Vec<SweptView>,
}

/// A depth that a sweep found.
#[derive(Debug, Clone, Copy)]
struct SweptDepth {
    /// Inverse depth along the optical axis, 1 / scene units.
    inverse: f64,
    /// Index of the view that agrees best.
    other: usize,
    /// True if no other depth is nearly as good.
    is_distinct: bool,
}

impl PlaneSweep {
    /// `middle` is the place that the views look at.
    pub(super) fn new(views: &[TrainingView], middle: DVec3) -> Self {
        let mut swept: Vec<SweptView> = views.iter().map(|view| SweptView::new(view, middle)).collect();
        for i in 0..swept.len() {
            swept[i].others = others_of(&swept, i);
        }
        Self { views: swept }
    }

    /// The point that a place of a view shows, and its colour; the place is in 0..1 of the photo's
    /// width and height. `None` if the photos leave its depth open.
    pub(super) fn surface_point(&self, view: usize, place: [f64; 2]) -> Option<(DVec3, [u8; 3])> {
        let own = &self.views[view];
        let size = own.camera.size;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
        let pixel =
            [(place[0] * f64::from(size.width)) as usize, (place[1] * f64::from(size.height)) as usize];
        let found = self.sweep(view, pixel).filter(|found| found.is_distinct)?;
        let point = own.point_at(pixel, found.inverse);
        let other = &self.views[found.other];
        let (there, inverse) = other.pixel_of(point)?;
        let back = self.sweep(found.other, there)?;
        let agrees = (back.inverse - inverse).abs() <= AGREEMENT * other.step();
        agrees.then(|| (point, own.colour(pixel)))
    }

    /// The depth of a pixel; `None` if too few other views see it, or none agrees.
    fn sweep(&self, view: usize, pixel: [usize; 2]) -> Option<SweptDepth> {
        let own = &self.views[view];
        let square = own.square(pixel)?;
        let rays: Vec<OtherRays<'_>> =
            own.others.iter().map(|&i| OtherRays::new(own, i, &self.views[i], pixel)).collect();
        let inverse_at = |step: f64| INVERSE_DEPTHS[0] / own.typical + step * own.step();
        let costs: Vec<Option<(f32, usize)>> =
            (0..STEPS).map(|k| cost_at(&rays, &square, inverse_at(k as f64))).collect();
        let costs_of = |from: usize, to: usize| costs[from..to].iter().flatten().map(|cost| cost.0);
        let cost = |k: &usize| costs[*k].map_or(f32::INFINITY, |cost| cost.0);
        let best = (0..STEPS).min_by(|a, b| cost(a).total_cmp(&cost(b)))?;
        let (least, other) = costs[best].filter(|(least, _)| *least <= MAX_COST)?;
        // Beyond the near end there may be a better one.
        if best + 1 == STEPS {
            return None;
        }
        let beyond = costs_of(0, best.saturating_sub(SAME_STEPS))
            .chain(costs_of((best + SAME_STEPS + 1).min(STEPS), STEPS))
            .fold(f32::INFINITY, f32::min);
        let is_distinct = beyond > DISTINCT.0 * least + DISTINCT.1;
        let mut refined = (least, inverse_at(best as f64));
        // From one step before the best to one after it. The best itself is part `PARTS`, and its cost is
        // known.
        for part in (1..2 * PARTS).filter(|part| *part != PARTS) {
            let inverse = inverse_at(best as f64 - 1.0 + part as f64 / PARTS as f64);
            if let Some((cost, _)) = cost_at(&rays, &square, inverse).filter(|(cost, _)| *cost < refined.0) {
                refined = (cost, inverse);
            }
        }
        (refined.1 > 0.0).then_some(SweptDepth { inverse: refined.1, other, is_distinct })
    }
}

impl SweptView {
    fn new(view: &TrainingView, middle: DVec3) -> Self {
        let size = view.at_level(0).0.camera.size;
        let side = size.width.max(size.height);
        let width = if side > LONGEST_SIDE { (size.width * LONGEST_SIDE / side).max(1) } else { size.width };
        let (camera, photo) = view.at_width(width);
        let world_from_camera = view.world_from_camera;
        let typical = (middle - world_from_camera.translation).length();
        Self {
            camera,
            world_from_camera,
            colours: photo.colours,
            counted: photo.counted,
            typical,
            others: Vec::new(),
        }
    }

    /// Inverse depth between two steps.
    fn step(&self) -> f64 {
        (INVERSE_DEPTHS[1] - INVERSE_DEPTHS[0]) / (self.typical * (STEPS - 1) as f64)
    }

    /// The ray through the middle of a pixel, in camera axes, with depth 1.
    fn ray(&self, [x, y]: [usize; 2]) -> DVec3 {
        self.camera.unproject([x as f64 + 0.5, y as f64 + 0.5], 1.0)
    }

    fn point_at(&self, pixel: [usize; 2], inverse: f64) -> DVec3 {
        self.world_from_camera.rotation * (self.ray(pixel) / inverse) + self.world_from_camera.translation
    }

    /// The pixel that shows a point, and the point's inverse depth.
    fn pixel_of(&self, point: DVec3) -> Option<([usize; 2], f64)> {
        let seen = self.world_from_camera.rotation.conjugate() * (point - self.world_from_camera.translation);
        let [x, y] = self.camera.project(seen)?;
        let size = self.camera.size;
        let inside = (0.0..f64::from(size.width)).contains(&x) && (0.0..f64::from(size.height)).contains(&y);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
        inside.then_some(([x as usize, y as usize], 1.0 / seen.z))
    }

    fn colour(&self, [x, y]: [usize; 2]) -> [u8; 3] {
        self.colours.pixels()[y * self.camera.size.width as usize + x]
    }

    /// The colours around a pixel; `None` at the border, and where the photo does not count.
    fn square(&self, [x, y]: [usize; 2]) -> Option<[[f32; 3]; SIDE * SIDE]> {
        let [width, height] = [self.camera.size.width, self.camera.size.height].map(|n| n as usize);
        let fits = |at: usize, side: usize| at >= REACH && at + REACH < side;
        let counts = self.counted.as_ref().is_none_or(|counted| counted.pixels()[y * width + x]);
        let colour = |i: usize| self.colour([x + i % SIDE - REACH, y + i / SIDE - REACH]).map(f32::from);
        (fits(x, width) && fits(y, height) && counts).then(|| std::array::from_fn(colour))
    }

    /// Colour between pixels, bilinear. The place is inside the middles of the outer pixels.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
    fn colour_between(&self, x: f32, y: f32) -> [f32; 3] {
        let (column, row) = (x as usize, y as usize);
        let (u, v) = (x - column as f32, y - row as f32);
        let at = row * self.camera.size.width as usize + column;
        let [upper, lower] =
            [at, at + self.camera.size.width as usize].map(|at| &self.colours.pixels()[at..at + 2]);
        std::array::from_fn(|c| {
            let across = |row: &[[u8; 3]]| f32::from(row[0][c]) * (1.0 - u) + f32::from(row[1][c]) * u;
            across(upper) * (1.0 - v) + across(lower) * v
        })
    }
}

/// The rays of a pixel and of its right and lower neighbours, in the axes of another view.
struct OtherRays<'a> {
    index: usize,
    view: &'a SweptView,
    rays: [DVec3; 3],
    /// The pixel's own camera.
    centre: DVec3,
}

impl<'a> OtherRays<'a> {
    fn new(own: &SweptView, index: usize, view: &'a SweptView, [x, y]: [usize; 2]) -> Self {
        let turn = view.world_from_camera.rotation.conjugate();
        let ray = |pixel| turn * (own.world_from_camera.rotation * own.ray(pixel));
        let rays = [ray([x, y]), ray([x + 1, y]), ray([x, y + 1])];
        let centre = turn * (own.world_from_camera.translation - view.world_from_camera.translation);
        Self { index, view, rays, centre }
    }

    /// Mean difference of the square and its image in the other view; `None` if it is not in view.
    #[expect(clippy::cast_possible_truncation, reason = "pixels need no 64 bits")]
    fn cost(&self, square: &[[f32; 3]; SIDE * SIDE], inverse: f64) -> Option<f32> {
        // The point times its inverse depth: the same pixel, and finite for a point at infinity.
        let seen = |ray: DVec3| self.view.camera.project(ray + self.centre * inverse);
        let [at, right, below] = [seen(self.rays[0])?, seen(self.rays[1])?, seen(self.rays[2])?];
        // Coordinates of the middles of pixels, and the axes of the square, which are nearly straight.
        let [x, y] = at.map(|v| (v - 0.5) as f32);
        let [across, down] = [right, below].map(|to| [(to[0] - at[0]) as f32, (to[1] - at[1]) as f32]);
        let reach = REACH as f32;
        let span = [0, 1].map(|c| reach * (across[c].abs() + down[c].abs()));
        let size = [self.view.camera.size.width, self.view.camera.size.height].map(|n| n as f32);
        // The sums below round otherwise than these: without the margin a place could lie outside.
        let fits = |at: f32, span: f32, side: f32| at - span >= MARGIN && at + span < side - 1.0 - MARGIN;
        if !(fits(x, span[0], size[0]) && fits(y, span[1], size[1])) {
            return None;
        }
        let mut sum = 0.0;
        for (i, own) in square.iter().enumerate() {
            let (i, j) = ((i % SIDE) as f32 - reach, (i / SIDE) as f32 - reach);
            let there =
                self.view.colour_between(x + i * across[0] + j * down[0], y + i * across[1] + j * down[1]);
            sum += (0..3).map(|c| (there[c] - own[c]).abs()).sum::<f32>();
        }
        Some(sum / (3 * SIDE * SIDE) as f32)
    }
}

/// Mean over the better half of the views that see the square at this inverse depth, and the best
/// of them; `None` if fewer than two of several do.
fn cost_at(rays: &[OtherRays<'_>], square: &[[f32; 3]; SIDE * SIDE], inverse: f64) -> Option<(f32, usize)> {
    let costs = rays.iter().filter_map(|rays| Some((rays.cost(square, inverse)?, rays.index)));
    let mut costs: Vec<(f32, usize)> = costs.collect();
    if costs.len() < rays.len().min(2) {
        return None;
    }
    costs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let better = costs.len().div_ceil(2);
    let sum: f32 = costs[..better].iter().map(|cost| cost.0).sum();
    Some((sum / better as f32, costs.first()?.1))
}

/// The views that show best how far away that is which a view shows.
fn others_of(views: &[SweptView], own: usize) -> Vec<usize> {
    let Se3 { rotation, translation } = views[own].world_from_camera;
    let aim = translation + rotation * DVec3::Z * views[own].typical;
    let fitness = |other: &SweptView| {
        other.pixel_of(aim)?;
        let [a, b] = [translation, other.world_from_camera.translation].map(|centre| centre - aim);
        let cosine = a.dot(b) / (a.length_squared() * b.length_squared()).sqrt();
        let angle = libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees();
        let apart = angle - BEST_ANGLE;
        let width = ANGLE_WIDTHS[usize::from(apart > 0.0)];
        Some(apart.abs() / width)
    };
    let mut fit: Vec<(f64, usize)> =
        (0..views.len()).filter(|i| *i != own).filter_map(|i| Some((fitness(&views[i])?, i))).collect();
    fit.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    fit.truncate(OTHERS);
    fit.into_iter().map(|(_, i)| i).collect()
}

#[cfg(test)]
mod tests {
    use super::super::draws::TrainingDraws;
    use super::super::photos::TrainingViews;
    use super::super::start::starting_scene;
    use super::*;
    use gs2e_image::{Size, png};
    use gs2e_num::seed::Seed;
    use gs2e_source::colmap::ColmapPoint;
    use gs2e_source::{Capture, CapturedView, LensModel};
    use std::fs::File;
    use std::path::PathBuf;

    const SIZE: Size = Size { width: 96, height: 72 };
    const CAMERA: Camera = Camera { size: SIZE, fx: 90.0, fy: 90.0, cx: 48.0, cy: 36.0, lens: None };
    /// The wall: all points with `z = DISTANCE + SLOPE x`.
    const DISTANCE: f64 = 4.0;
    const SLOPE: f64 = 0.3;

    /// Brightness of the wall: waves longer than 6 pixels in two directions, without a common
    /// period. It is even left of `x = -0.8`.
    fn painted(x: f64, y: f64) -> [u8; 3] {
        let wave = |k: f64, phase: f64| {
            ((4.1 * k * x + 2.3 * y + phase).sin() + (5.3 * y - 3.7 * k * x + 2.0 * phase).cos()) / 2.0
        };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 28 to 228")]
        let level = |v: f64| (128.0 + 100.0 * v) as u8;
        if x < -0.8 { [90; 3] } else { [wave(1.0, 0.0), wave(1.3, 1.0), wave(0.8, 2.5)].map(level) }
    }

    /// Photos of the wall from a row of cameras.
    fn photographed() -> (tempfile::TempDir, TrainingViews) {
        let folder = tempfile::tempdir().unwrap();
        let (mut views, mut files) = (Vec::new(), Vec::<(String, PathBuf)>::new());
        for i in 0..6 {
            let translation = DVec3::new(0.3 * f64::from(i) - 0.75, 0.1 * f64::from(i % 2), 0.0);
            let world_from_camera = Se3 { rotation: glam::DQuat::IDENTITY, translation };
            let pixel = |k: usize| {
                let ray = CAMERA.unproject([(k % 96) as f64 + 0.5, (k / 96) as f64 + 0.5], 1.0);
                // (DISTANCE + SLOPE c.x) = t (1 - SLOPE ray.x), from the equation of the wall.
                let at = translation + ray * ((DISTANCE + SLOPE * translation.x) / (1.0 - SLOPE * ray.x));
                painted(at.x, at.y)
            };
            let image = Image::from_vec(SIZE, (0..SIZE.pixels()).map(pixel).collect());
            let (name, path) = (format!("{i}.png"), folder.path().join(format!("{i}.png")));
            png::write_image(&image, File::create(&path).unwrap()).unwrap();
            files.push((name.clone(), path));
            let (camera, lens) = (CAMERA, LensModel::Pinhole);
            views.push(CapturedView { name, world_from_camera, camera, lens, sha256: None });
        }
        let capture = Capture { views, unused: Vec::new() };
        let read = TrainingViews::read(&capture, &files, SIZE.width, 0, &|| true).unwrap();
        (folder, read)
    }

    #[test]
    fn points_lie_on_the_wall_and_even_areas_have_none() {
        let (_folder, views) = photographed();
        let sweep = PlaneSweep::new(&views.training, DVec3::Z * DISTANCE);
        let (mut asked, mut found) = (0, Vec::new());
        for view in 0..views.training.len() {
            for place in (0..100).map(|k| [0.05 + 0.1 * f64::from(k % 10), 0.05 + 0.1 * f64::from(k / 10)]) {
                asked += 1;
                found.extend(sweep.surface_point(view, place));
            }
        }
        // A fifth of the wall is even, and the rays at the border leave the other photos.
        assert!(found.len() * 3 > asked, "{} of {asked}", found.len());
        // One step at this distance is a depth of z^2 / typical * 3.98 / 127: 0.13.
        let is_near = |point: &DVec3| (point.z - DISTANCE - SLOPE * point.x).abs() < 0.13;
        let near = found.iter().filter(|(point, _)| is_near(point)).count();
        assert!(near * 100 >= found.len() * 98, "{near} of {} are on the wall", found.len());
        // The square reaches 3 pixels, 0.13 at this distance, into the painted part.
        let even = found.iter().filter(|(point, _)| point.x < -0.8 - 0.15).count();
        assert!(even * 100 <= found.len(), "{even} of {} are on the even part", found.len());
    }

    #[test]
    fn a_start_has_the_points_of_the_model_and_others_up_to_the_budget() {
        let (_folder, views) = photographed();
        let model = [[-0.2, 0.1], [0.3, -0.2]].map(|[x, y]| ColmapPoint {
            xyz: DVec3::new(x, y, DISTANCE + SLOPE * x),
            rgb: [9; 3],
            error: 0.5,
        });
        let draws = TrainingDraws::new(Seed(1));
        let start = |budget| starting_scene(&model, &views.training, budget, &draws).unwrap().positions;
        assert_eq!(start(2), model.map(|point| point.xyz.as_vec3().to_array()));
        let all = start(60);
        assert_eq!((all.len(), &all[..2]), (60, &start(2)[..]));
        // A fifth of the wall is even, and points there can be anywhere. Depths drawn from the range of
        // a sweep would put one point in a hundred on the wall.
        let is_near = |[x, _, z]: &&[f32; 3]| (f64::from(*z) - DISTANCE - SLOPE * f64::from(*x)).abs() < 0.13;
        assert!(all.iter().filter(is_near).count() >= 48, "{all:?}");
    }
}
