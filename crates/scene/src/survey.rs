//! Survey of a scene: the region that holds its opacity, a guess at its up direction, and an orbit
//! that shows the scene whole.
//!
//! Trained scenes have stray Gaussians far from everything else, so nothing here is an extreme
//! value: all numbers are quantiles weighted by opacity. The `p` quantile is the smallest value at
//! which the Gaussians up to it hold the share `p` of the opacity.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! use gs2e_scene::survey::SceneSurvey;
//!
//! # let mut collector = GaussianCollector::new(0, 5)?;
//! # for x in [0.0, 1.0, 2.0, 3.0, 100.0] {
//! #     let (position, rotation, sh) = ([x, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! #     collector.push(&Gaussian { position, log_scale: [-1.0; 3], rotation, opacity_logit: 0.0, sh });
//! # }
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! // `scene` has five Gaussians of equal opacity, at x = 0, 1, 2, 3 and 100.
//! let survey = SceneSurvey::measure_scene(&scene);
//! // The centre is the median, so the stray one does not move it.
//! assert_eq!(survey.centre, DVec3::new(2.0, 0.0, 0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod axes;
mod up;

use up::{SortedWeights, guess_up};
pub use up::{UpGuess, UpRule};

use super::Gaussians;
use crate::camera::Camera;
use glam::DVec3;
use serde::Serialize;

/// Share of the opacity within the radius.
const HELD: f64 = 0.95;
/// Largest ratio of the least variance to the next for which the Gaussians count as a layer.
const FLAT: f64 = 0.25;
/// Ratio of the middle variance to the largest up to which the Gaussians count as a line.
const LINEAR: f64 = 1e-9;
/// Smallest skewness along the normal of a layer that decides which side is up.
const LOPSIDED: f64 = 0.1;
/// Elevation of the suggested camera above the centre, degrees.
const ELEVATION: f64 = 20.0;

/// The region and the orientation of a scene. World axes, scene units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SceneSurvey {
    /// Lower ends of the intervals that hold 95 % of the opacity on each axis: 2.5 % quantiles.
    pub low: DVec3,
    /// Upper ends: 97.5 % quantiles.
    pub high: DVec3,
    /// The median on each axis.
    pub centre: DVec3,
    /// Distance from the centre within which 95 % of the opacity lies.
    pub radius: f64,
    /// The up direction. A guess.
    pub up: UpGuess,
}

/// An orbit about the scene, as recipes describe it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SceneOrbit {
    /// The point that the camera looks at.
    pub centre: DVec3,
    /// Start of the camera.
    pub from: DVec3,
    /// Direction of the axis.
    pub up: DVec3,
}

impl SceneSurvey {
    /// Surveys a scene that has at least one Gaussian.
    ///
    /// # Panics
    /// The scene is empty.
    #[must_use]
    pub fn measure_scene(scene: &Gaussians) -> Self {
        let weights = opacities(scene);
        let means: Vec<DVec3> = (0..scene.len()).map(|i| scene.position(i)).collect();
        let quantiles = [0, 1, 2].map(|axis| {
            let along = SortedWeights::new(means.iter().map(|mean| mean[axis]), &weights);
            [0.025, 0.5, 0.975].map(|share| along.quantile(share))
        });
        let [low, centre, high] = [0, 1, 2].map(|k| DVec3::from_array(quantiles.map(|axis| axis[k])));
        let distances = SortedWeights::new(means.iter().map(|mean| (*mean - centre).length()), &weights);
        // Stray Gaussians would turn the axes: their squared distances outweigh thousands of
        // others.
        let held: Vec<(DVec3, f64)> = means
            .iter()
            .zip(&weights)
            .filter(|(mean, _)| mean.cmpge(low).all() && mean.cmple(high).all())
            .map(|(mean, weight)| (*mean - centre, *weight))
            .collect();
        Self { low, high, centre, radius: distances.quantile(HELD), up: guess_up(&held) }
    }

    /// The orbit on which the ball of [`Self::radius`] about the centre just fits into the image of
    /// this camera, seen from 20 degrees above.
    #[must_use]
    pub fn orbit(&self, camera: &Camera) -> SceneOrbit {
        let [width, height] = [camera.size.width, camera.size.height].map(f64::from);
        // The narrower angle of view decides, so that the scene fits in both directions.
        let half = libm::atan((width / camera.fx).min(height / camera.fy) * 0.5);
        // A scene at one point has no size, and any distance shows it.
        let radius = if self.radius > 0.0 { self.radius } else { 1.0 };
        let up = self.up.direction;
        // Level, and towards the capture's usual camera at -z, or at -y if z is up.
        let ahead = if up.z.abs() < 0.9 { DVec3::NEG_Z } else { DVec3::NEG_Y };
        let level = ahead.reject_from_normalized(up).normalize();
        let (sin, cos) = libm::sincos(ELEVATION.to_radians());
        // The sine and not the tangent: the rays at the image's edge touch the ball in front of its centre.
        let from = self.centre + (level * cos + up * sin) * (radius / libm::sin(half));
        SceneOrbit { centre: self.centre, from, up }
    }
}

impl SceneOrbit {
    /// The orbit in about four digits of its own radius, for people to read and edit.
    #[must_use]
    pub fn rounded(&self) -> Self {
        let digits = (4.0 - libm::log10((self.from - self.centre).length()).ceil()).clamp(0.0, 12.0);
        let unit = libm::pow(10.0, digits);
        let short = |v: DVec3, unit: f64| (v * unit).round() / unit;
        Self { centre: short(self.centre, unit), from: short(self.from, unit), up: short(self.up, 1e4) }
    }
}

/// Opacities, 0 to 1; all 1 if each is too small for a number.
fn opacities(scene: &Gaussians) -> Vec<f64> {
    let sigmoid = |logit: &f32| 1.0 / (1.0 + libm::exp(-f64::from(*logit)));
    let found: Vec<f64> = scene.opacity_logits.iter().map(sigmoid).collect();
    // Without any opacity, all Gaussians count alike, so that there is a centre to look at.
    if found.iter().any(|weight| *weight > 0.0) { found } else { vec![1.0; found.len()] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneScreening;
    use gs2e_image::Size;

    fn scene(points: &[([f32; 3], f32)]) -> Gaussians {
        let n = points.len();
        Gaussians {
            origin: DVec3::ZERO,
            positions: points.iter().map(|(p, _)| *p).collect(),
            log_scales: vec![[-3.0; 3]; n],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
            opacity_logits: points.iter().map(|(_, logit)| *logit).collect(),
            sh: vec![[0.0; 3]; n],
            sh_degree: 0,
            antialiased: None,
            screening: SceneScreening::default(),
            motion: None,
        }
    }

    fn survey(points: &[([f32; 3], f32)]) -> SceneSurvey {
        SceneSurvey::measure_scene(&scene(points))
    }

    /// 1000 points along x at 1, 2, …, 1000, with one opacity.
    fn line() -> Vec<([f32; 3], f32)> {
        (1..=1000u16).map(|i| ([f32::from(i), 0.0, 0.0], 0.0)).collect()
    }

    #[test]
    fn bounds_hold_95_percent_and_strays_do_not_count() {
        let found = survey(&line());
        assert_eq!((found.low.x, found.centre.x, found.high.x), (25.0, 500.0, 975.0));
        // 950 of the points are at most 475 from 500: both ends of 25.., 24 more above.
        assert!((found.radius - 475.0).abs() < 1e-9);
        let mut strayed = line();
        // Invisible Gaussians weigh nothing, whatever their place and number.
        strayed.extend((0..500).map(|_| ([-1e6, 1e6, 3e5], -100.0)));
        let again = survey(&strayed);
        assert_eq!((again.low, again.high, again.centre), (found.low, found.high, found.centre));
        strayed.truncate(1000);
        strayed.extend([([1e9, -1e9, 1e9], 10.0); 3]);
        assert!(survey(&strayed).radius < 480.0);
    }

    #[test]
    fn a_scene_of_almost_no_opacity_is_weighed_equally() {
        let faint: Vec<_> = line().into_iter().map(|(p, _)| (p, -2000.0)).collect();
        assert!((survey(&faint).centre.x - 500.0).abs() < 1e-9);
    }

    /// A floor of 20 by 20 points, alternately a little up and down, with a pillar of 40 on one side of it,
    /// in these axes.
    fn floor(pillar: f32, place: impl Fn([f32; 3]) -> [f32; 3]) -> Vec<([f32; 3], f32)> {
        let cell = |i: u16| f32::from(i % 20) - 9.5;
        let floor =
            (0..400u16).map(|i| [cell(i), if (i + i / 20) % 2 == 0 { 0.05 } else { -0.05 }, cell(i / 20)]);
        let pillar = (0..40u16).map(|i| [0.3, pillar * 0.1 * f32::from(i), 0.2]);
        floor.chain(pillar).map(|p| (place(p), 2.0)).collect()
    }

    #[test]
    fn up_is_the_side_of_a_layer_on_which_things_stand() {
        let t = |points: &[([f32; 3], f32)], wanted: DVec3, rule: UpRule| {
            let up = survey(points).up;
            assert!(up.direction.dot(wanted) > 0.99 && up.rule == rule, "{up:?}");
        };
        t(&floor(1.0, |p| p), DVec3::Y, UpRule::Layer);
        t(&floor(-1.0, |p| p), DVec3::NEG_Y, UpRule::Layer);
        t(&floor(1.0, |[x, y, z]| [x, -z, y]), DVec3::Z, UpRule::Layer);
        let tilted = DVec3::new(0.0, 0.8, 0.6);
        t(&floor(1.0, |[x, y, z]| [x, 0.8 * y - 0.6 * z, 0.6 * y + 0.8 * z]), tilted, UpRule::Layer);
        // Without a pillar both sides are alike.
        t(&floor(0.0, |p| p), DVec3::NEG_Y, UpRule::LayerAlike);
    }

    #[test]
    fn without_a_layer_up_is_that_of_colmap() {
        let cube: Vec<_> =
            (0..1000u16).map(|i| ([i % 10, i / 10 % 10, i / 100].map(f32::from), 1.0)).collect();
        let colmap = UpGuess { direction: DVec3::NEG_Y, rule: UpRule::Colmap };
        assert_eq!(survey(&cube).up, colmap);
        assert_eq!(survey(&[([1.0, 2.0, 3.0], 0.0)]).up, colmap);
        assert_eq!(survey(&line()).up, colmap);
        let skew: Vec<_> = line().into_iter().map(|([x, ..], w)| ([x, 0.3 * x, -0.7 * x], w)).collect();
        assert_eq!(survey(&skew).up, colmap);
    }

    #[test]
    fn the_orbit_fits_the_ball_into_the_image() {
        // 90 degrees wide, and less high: tan of the half angle is 0.75.
        let camera = Camera::pinhole(Size { width: 400, height: 300 }, [200.0, 200.0, 200.0, 150.0]);
        for points in [floor(1.0, |p| p), floor(1.0, |[x, y, z]| [x, -z, y]), line()] {
            let found = survey(&points);
            let SceneOrbit { centre, from, up } = found.orbit(&camera);
            let arm = from - centre;
            // The sine of an angle with tangent 3/4 is 3/5.
            assert!((arm.length() * 0.6 / found.radius - 1.0).abs() < 1e-12);
            let elevation = (arm.dot(up) / arm.length()).asin().to_degrees();
            assert!((elevation - 20.0).abs() < 1e-9, "{elevation}");
        }
        let alone = survey(&[([1.0, 2.0, 3.0], 0.0)]).orbit(&camera);
        assert!((alone.from - alone.centre).length() > 1.0);
    }

    #[test]
    fn rounding_keeps_four_digits_of_the_radius() {
        let t = |size: f64| {
            let orbit = SceneOrbit {
                centre: DVec3::splat(size / 3.0),
                from: DVec3::new(1.0, 2.0, 7.0) * size / 3.0,
                up: DVec3::splat(3f64.sqrt().recip()),
            };
            let short = orbit.rounded();
            assert!((short.from - orbit.from).length() <= 1e-3 * size, "{short:?}");
            assert!((short.up - orbit.up).length() < 1e-4);
        };
        [1e-7, 0.02, 1.0, 30.0, 99_999.0, 1e12].into_iter().for_each(t);
        let planted = SceneOrbit { centre: DVec3::ZERO, from: DVec3::new(0.0, 1.0 / 3.0, 5.0), up: DVec3::Y };
        assert_eq!(planted.rounded().from, DVec3::new(0.0, 0.333, 5.0));
    }
}
