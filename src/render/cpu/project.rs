//! Pass 1: every Gaussian onto the image plane, or out.
//!
//! Formulas: `numerics.md` 7.1 and 7.2. The camera's centre is subtracted and the rotation into camera axes applied
//! in f64, so that scenes far from the world's origin lose nothing; what follows is f32 in the stable forms, whose
//! determinant does not cancel.

#![expect(clippy::cast_possible_truncation, reason = "positions become f32 once they are camera coordinates")]

use super::activate::Activated;
use super::extent;
use super::splat::{MAX_FEATURES, Rates, Splat};
use crate::image::luminance;
use crate::render::dual::{Dual, Real, cross, dot};
use crate::render::shared::{
    AFFINE_DOUBTFUL, AFFINE_INVALID, COMPENSATION_FLOOR, DILATION, FRUSTUM_SLACK, GSPLAT_FAR, GSPLAT_NEAR,
    GSPLAT_SLACK, NEAR, least_alpha,
};
use crate::render::{Channels, Rules, Style, Velocity, View, Work};
use crate::scene::{Gaussians, sh};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Gaussians that one task projects; the first of them decides where their splats lie in the pass's output.
pub(super) const CHUNK: usize = 4096;

/// `sqrt(log2(e) / 2)`: makes `exp(-x^2 / 2)` into `2^-x^2`.
const TO_BINARY: f32 = 0.849_321_8;

/// A view in the form that every Gaussian needs it in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eye {
    camera_from_world: DMat3,
    /// The same rounded, row by row.
    rows: [[f32; 3]; 3],
    /// The scene's local origin minus the camera's centre, world axes.
    origin: DVec3,
    focal: [f64; 2],
    centre: [f64; 2],
    /// Least and largest `x / z`, `y / z` at which the projection's derivative is taken.
    slack: [[f64; 2]; 2],
    size: [f32; 2],
    /// Of the camera, in its own axes.
    velocity: Velocity,
    /// How fast the ray from the camera to any point of the scene changes: world axes, units a second.
    ray_rate: DVec3,
}

impl Eye {
    /// The view of a scene whose positions are relative to `origin`.
    pub(super) fn new(view: &View, origin: DVec3, rules: Rules) -> Self {
        let camera = view.camera;
        let camera_from_world = view.world_from_camera.rotation_matrix().transpose();
        let size = [camera.size.width, camera.size.height].map(f64::from);
        let (focal, centre) = ([camera.fx, camera.fy], [camera.cx, camera.cy]);
        let slack = |k: usize| match rules {
            Rules::Official | Rules::Exact | Rules::Soft => {
                let most = FRUSTUM_SLACK * size[k] / (2.0 * focal[k]);
                [-most, most]
            }
            Rules::Gsplat => {
                let more = GSPLAT_SLACK * size[k] / focal[k];
                [-(centre[k] / focal[k] + more), (size[k] - centre[k]) / focal[k] + more]
            }
        };
        Self {
            camera_from_world,
            rows: [0, 1, 2].map(|k| camera_from_world.row(k).as_vec3().to_array()),
            origin: origin - view.world_from_camera.translation,
            focal,
            centre,
            slack: [0, 1].map(slack),
            size: size.map(|v| v as f32),
            velocity: view.velocity,
            ray_rate: -(view.world_from_camera.rotation * view.velocity.linear),
        }
    }
}

/// Why a Gaussian is not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Culled {
    Behind,
    Degenerate,
    Outside,
}

/// What the pass reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projection<'a> {
    /// The scene.
    pub(super) scene: &'a Gaussians,
    /// Its activated form.
    pub(super) activated: &'a [Activated],
    /// Parameters.
    pub(super) style: Style,
    /// View.
    pub(super) eye: Eye,
    /// Which features the splats carry.
    pub(super) want: Channels,
}

/// Splats of one [`CHUNK`] of Gaussians and what happened to them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Projected {
    /// How many of the chunk's places in `splats` are filled, from the first on.
    pub(super) drawn: usize,
    /// Counts.
    pub(super) work: Work,
}

impl Projection<'_> {
    /// Projects all Gaussians: those of chunk `k` come to lie from `splats[k * CHUNK]` on, in file order; their rates
    /// likewise, where a channel is a rate.
    pub(super) fn run(&self, splats: &mut Vec<Splat>, rates: &mut Vec<Rates>, chunks: &mut Vec<Projected>) {
        splats.resize(self.scene.len(), Splat::default());
        let parts = splats.par_chunks_mut(CHUNK).enumerate();
        if self.want.luminance_rate {
            rates.resize(self.scene.len(), Rates::default());
            let parts = parts.zip(rates.par_chunks_mut(CHUNK));
            let project = |((k, out), rates): ((usize, &mut [Splat]), &mut [Rates])| {
                self.chunk::<Dual<f32>>(k * CHUNK, out, |place, found| rates[place] = found)
            };
            parts.map(project).collect_into_vec(chunks);
        } else {
            parts.map(|(k, out)| self.chunk::<f32>(k * CHUNK, out, |_, _| ())).collect_into_vec(chunks);
        }
    }

    fn chunk<S: Real<Plain = f32>>(
        &self,
        first: usize,
        out: &mut [Splat],
        mut keep: impl FnMut(usize, Rates),
    ) -> Projected {
        let mut done = Projected::default();
        done.work.gaussians = out.len() as u64;
        for i in first..first + out.len() {
            match self.one::<S>(i, &mut done.work) {
                Ok((splat, rates)) => {
                    out[done.drawn] = splat;
                    keep(done.drawn, rates);
                    done.drawn += 1;
                }
                Err(Culled::Behind) => done.work.behind += 1,
                Err(Culled::Degenerate) => done.work.degenerate += 1,
                Err(Culled::Outside) => done.work.outside += 1,
            }
        }
        done
    }

    fn one<S: Real<Plain = f32>>(&self, i: usize, work: &mut Work) -> Result<(Splat, Rates), Culled> {
        let seen = self.scene.positions[i].map(f64::from);
        let from_camera = self.eye.origin + DVec3::from_array(seen);
        let point = self.eye.camera_from_world * from_camera;
        let z = point.z as f32;
        let rules = self.style.rules;
        let in_front = match rules {
            Rules::Official | Rules::Exact | Rules::Soft => z > NEAR,
            Rules::Gsplat => (GSPLAT_NEAR..=GSPLAT_FAR).contains(&z),
        };
        if !in_front {
            return Err(Culled::Behind);
        }
        let sight = self.eye.sight::<S>(point);
        let mean = sight.mean.map(S::value);
        let shape = sight.footprint(&self.eye, &self.activated[i].axes);
        let plain = shape.plain();
        if !(plain.det.is_finite() && plain.det > 0.0 && mean[0].is_finite() && mean[1].is_finite()) {
            return Err(Culled::Degenerate);
        }
        let mut opacity = S::with_rate(self.activated[i].opacity, 0.0);
        if self.style.antialiased {
            opacity =
                opacity * (shape.det0 / shape.det).at_least(S::nearest(COMPENSATION_FLOOR.into())).sqrt();
        }
        if opacity.value() < least_alpha(rules) {
            return Err(Culled::Outside);
        }
        let w = shape.weights();
        let splat = self.place(mean, &plain, w.map(S::value), opacity.value()).ok_or(Culled::Outside)?;
        let doubtful = plain.depth_deviation > AFFINE_DOUBTFUL * z;
        work.affine_doubtful += u64::from(doubtful);
        work.affine_invalid += u64::from(plain.depth_deviation > AFFINE_INVALID * z);
        let colour = self.colour::<S>(i, from_camera);
        let grey = luminance(colour.map(S::value));
        let rates = Rates {
            mean: sight.mean.map(S::rate),
            w: w.map(S::rate),
            opacity: opacity.rate() / opacity.value(),
            depth: sight.depth.rate(),
            grey,
            grey_rate: luminance(colour.map(S::rate)),
        };
        Ok((Splat { depth: z, features: self.features(colour.map(S::value), z, doubtful), ..splat }, rates))
    }

    /// The splat's geometry, or `None` where it touches no pixel.
    fn place(&self, mean: [f32; 2], shape: &Footprint<f32>, w: [f32; 3], opacity: f32) -> Option<Splat> {
        let reach = extent::reach(self.style.rules, opacity);
        let [columns, rows] = extent::pixels(self.style.rules, mean, shape, reach, self.eye.size)?;
        Some(Splat { mean, w, opacity, reach, columns, rows, ..Splat::default() })
    }

    /// The values to blend, one after another as [`Channels`] lists them.
    fn features(&self, colour: [f32; 3], z: f32, doubtful: bool) -> [f32; MAX_FEATURES] {
        let mut features = [0.0; MAX_FEATURES];
        let mut n = 0;
        let mut push = |values: &[f32]| {
            features[n..n + values.len()].copy_from_slice(values);
            n += values.len();
        };
        if self.want.rgb {
            push(&colour);
        }
        if self.want.luminance {
            push(&[luminance(colour)]);
        }
        if self.want.depth {
            push(&[z]);
        }
        if self.want.doubtful {
            push(&[f32::from(u8::from(doubtful))]);
        }
        features
    }

    /// The colour seen from the camera, each channel at least 0; zero where no channel wants one.
    fn colour<S: Real<Plain = f32>>(&self, i: usize, from_camera: DVec3) -> [S; 3] {
        if !(self.want.rgb || self.want.luminance || self.want.luminance_rate) {
            return [S::nearest(0.0); 3];
        }
        let direction = from_camera.normalize();
        // The ray turns by what of its own rate is across it.
        let rate = self.eye.ray_rate;
        let turning = (rate - direction * direction.dot(rate)) / from_camera.length();
        let direction = [0, 1, 2].map(|k| S::with_rate(direction[k] as f32, turning[k] as f32));
        let basis = sh::basis(self.scene.sh_degree, direction);
        sh::colour(self.scene.sh_of(i), &basis)
    }
}

/// A Gaussian's dilated covariance `[[a, b], [b, c]]` on the image, px^2, and what else is read off its axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Footprint<S> {
    /// Variance along x.
    pub(super) a: S,
    /// Covariance.
    pub(super) b: S,
    /// Variance along y.
    pub(super) c: S,
    /// Determinant.
    pub(super) det: S,
    /// Determinant before dilation.
    pub(super) det0: S,
    /// Standard deviation of depth, scene units.
    pub(super) depth_deviation: f32,
}

impl<S: Real<Plain = f32>> Footprint<S> {
    /// `w1, w2, w3` of [`Splat`]. `w2` is `-b / sqrt(c det)` without the product, which overflows first.
    pub(super) fn weights(&self) -> [S; 3] {
        let to_binary = S::with_rate(TO_BINARY, 0.0);
        let w1 = (self.c / self.det).sqrt() * to_binary;
        [w1, -(self.b / self.c) * w1, to_binary / self.c.sqrt()]
    }

    /// Without rates.
    fn plain(&self) -> Footprint<f32> {
        let [a, b, c, det, det0] = [self.a, self.b, self.c, self.det, self.det0].map(S::value);
        Footprint { a, b, c, det, det0, depth_deviation: self.depth_deviation }
    }
}

/// Where a Gaussian's mean is seen.
struct Sight<S> {
    /// px
    mean: [S; 2],
    /// `x / z` and `y / z` where the projection's derivative is taken.
    slopes: [S; 2],
    /// Focal lengths over depth.
    scale: [S; 2],
    /// Scene units.
    depth: S,
}

impl Eye {
    /// A point in camera axes; `qdot = -v - w x q` while the camera moves.
    fn sight<S: Real<Plain = f32>>(&self, point: DVec3) -> Sight<S> {
        let rate = -self.velocity.linear - self.velocity.angular.cross(point);
        let slope = |k: usize| {
            let value = point[k] / point.z;
            (value, (rate[k] - value * rate.z) / point.z)
        };
        let mean = |k: usize| {
            let (value, rate) = slope(k);
            S::with_rate((self.focal[k] * value + self.centre[k]) as f32, (self.focal[k] * rate) as f32)
        };
        let clamped = |k: usize| {
            let ((value, rate), [low, high]) = (slope(k), self.slack[k]);
            let inside = low < value && value < high;
            S::with_rate(value.clamp(low, high) as f32, if inside { rate as f32 } else { 0.0 })
        };
        let z = S::with_rate(point.z as f32, rate.z as f32);
        let scale = |k: usize| S::with_rate(self.focal[k] as f32, 0.0) / z;
        Sight {
            mean: [mean(0), mean(1)],
            slopes: [clamped(0), clamped(1)],
            scale: [scale(0), scale(1)],
            depth: z,
        }
    }
}

impl<S: Real<Plain = f32>> Sight<S> {
    /// The footprint of a Gaussian with these scaled world axes.
    fn footprint(&self, eye: &Eye, axes: &[[f32; 3]; 3]) -> Footprint<S> {
        let turning = eye.velocity.angular.as_vec3().to_array();
        // The axes in camera axes, which turn against the camera.
        let [m0, m1, m2] = axes.map(|axis| {
            let seen = eye.rows.map(|row| dot(row, axis));
            let rate = cross(seen, turning);
            [0, 1, 2].map(|k| S::with_rate(seen[k], rate[k]))
        });
        let along = [m0[2], m1[2], m2[2]];
        // rows of the projection's derivative times the axes: they stay in the Gaussian's own axes, where the
        // cross product does not cancel
        let row = |k: usize| [m0, m1, m2].map(|m| self.scale[k] * (m[k] - self.slopes[k] * m[2]));
        let (a0, a1) = (row(0), row(1));
        let n = cross(a0, a1);
        let (aa, cc, det0) = (dot(a0, a0), dot(a1, a1), dot(n, n));
        let d = S::with_rate(DILATION, 0.0);
        let depth_deviation = dot(along, along).value().sqrt();
        Footprint {
            a: aa + d,
            b: dot(a0, a1),
            c: cc + d,
            det: det0 + d * (aa + cc) + d * d,
            det0,
            depth_deviation,
        }
    }
}
