//! Pass 1: every Gaussian onto the image plane, or out.
//!
//! Formulas: `numerics.md` 7.1 and 7.2. The camera's centre is subtracted and the rotation into camera axes applied
//! in f64, so that scenes far from the world's origin lose nothing; what follows is f32 in the stable forms, whose
//! determinant does not cancel.

#![expect(clippy::cast_possible_truncation, reason = "positions become f32 once they are camera coordinates")]

use super::activate::Activated;
use super::extent;
use super::splat::{MAX_FEATURES, Splat};
use crate::image::luminance;
use crate::render::shared::{
    AFFINE_DOUBTFUL, AFFINE_INVALID, COMPENSATION_FLOOR, DILATION, FRUSTUM_SLACK, GSPLAT_FAR, GSPLAT_NEAR,
    GSPLAT_SLACK, NEAR, least_alpha,
};
use crate::render::{Channels, Rules, Style, View, Work};
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
    /// Projects all Gaussians: those of chunk `k` come to lie from `splats[k * CHUNK]` on, in file order.
    pub(super) fn run(&self, splats: &mut Vec<Splat>, chunks: &mut Vec<Projected>) {
        splats.resize(self.scene.len(), Splat::default());
        splats
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(k, out)| self.chunk(k * CHUNK, out))
            .collect_into_vec(chunks);
    }

    fn chunk(&self, first: usize, out: &mut [Splat]) -> Projected {
        let mut done = Projected::default();
        done.work.gaussians = out.len() as u64;
        for i in first..first + out.len() {
            match self.one(i, &mut done.work) {
                Ok(splat) => {
                    out[done.drawn] = splat;
                    done.drawn += 1;
                }
                Err(Culled::Behind) => done.work.behind += 1,
                Err(Culled::Degenerate) => done.work.degenerate += 1,
                Err(Culled::Outside) => done.work.outside += 1,
            }
        }
        done
    }

    fn one(&self, i: usize, work: &mut Work) -> Result<Splat, Culled> {
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
        let direction = [point.x / point.z, point.y / point.z];
        let mean = [0, 1].map(|k| (self.eye.focal[k] * direction[k] + self.eye.centre[k]) as f32);
        let shape = self.eye.footprint(direction, z, &self.activated[i].axes);
        if !(shape.det.is_finite() && shape.det > 0.0 && mean[0].is_finite() && mean[1].is_finite()) {
            return Err(Culled::Degenerate);
        }
        let mut opacity = self.activated[i].opacity;
        if self.style.antialiased {
            opacity *= (shape.det0 / shape.det).max(COMPENSATION_FLOOR).sqrt();
        }
        if opacity < least_alpha(rules) {
            return Err(Culled::Outside);
        }
        let splat = self.place(mean, &shape, opacity).ok_or(Culled::Outside)?;
        work.affine_doubtful += u64::from(shape.depth_deviation > AFFINE_DOUBTFUL * z);
        work.affine_invalid += u64::from(shape.depth_deviation > AFFINE_INVALID * z);
        Ok(Splat { depth: z, features: self.features(i, from_camera, z), ..splat })
    }

    /// The splat's geometry, or `None` where it touches no pixel.
    fn place(&self, mean: [f32; 2], shape: &Footprint, opacity: f32) -> Option<Splat> {
        let reach = extent::reach(self.style.rules, opacity);
        let [columns, rows] = extent::pixels(self.style.rules, mean, shape, reach, self.eye.size)?;
        Some(Splat { mean, w: shape.weights(), opacity, reach, columns, rows, ..Splat::default() })
    }

    /// The values to blend, one after another as [`Channels`] lists them.
    fn features(&self, i: usize, from_camera: DVec3, z: f32) -> [f32; MAX_FEATURES] {
        let mut features = [0.0; MAX_FEATURES];
        let mut n = 0;
        let mut push = |values: &[f32]| {
            features[n..n + values.len()].copy_from_slice(values);
            n += values.len();
        };
        if self.want.rgb || self.want.luminance {
            let colour = self.colour(i, from_camera);
            if self.want.rgb {
                push(&colour);
            }
            if self.want.luminance {
                push(&[luminance(colour)]);
            }
        }
        if self.want.depth {
            push(&[z]);
        }
        features
    }

    /// The colour seen from the camera, each channel at least 0.
    fn colour(&self, i: usize, from_camera: DVec3) -> [f32; 3] {
        let direction = from_camera.normalize().as_vec3().to_array();
        let basis = sh::basis(self.scene.sh_degree, direction);
        sh::colour(self.scene.sh_of(i), &basis)
    }
}

/// A Gaussian's dilated covariance `[[a, b], [b, c]]` on the image, px^2, and what else is read off its axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Footprint {
    /// Variance along x.
    pub(super) a: f32,
    /// Covariance.
    pub(super) b: f32,
    /// Variance along y.
    pub(super) c: f32,
    /// Determinant.
    pub(super) det: f32,
    /// Determinant before dilation.
    pub(super) det0: f32,
    /// Standard deviation of depth, scene units.
    pub(super) depth_deviation: f32,
}

impl Footprint {
    /// `w1, w2, w3` of [`Splat`]. `w2` is `-b / sqrt(c det)` without the product, which overflows first.
    pub(super) fn weights(&self) -> [f32; 3] {
        let w1 = (self.c / self.det).sqrt() * TO_BINARY;
        [w1, -(self.b / self.c) * w1, TO_BINARY / self.c.sqrt()]
    }
}

impl Eye {
    /// The footprint of a Gaussian with these scaled world axes, seen in `direction = (x / z, y / z)`.
    fn footprint(&self, direction: [f64; 2], z: f32, axes: &[[f32; 3]; 3]) -> Footprint {
        let focal = self.focal.map(|v| v as f32);
        let clamped = [0, 1].map(|k| direction[k].clamp(self.slack[k][0], self.slack[k][1]) as f32);
        let scale = [focal[0] / z, focal[1] / z];
        let [right, down, forward] = self.rows;
        let along = axes.map(|axis| dot(forward, axis));
        // rows of the projection's derivative times the axes: they stay in the Gaussian's own axes, where the
        // cross product does not cancel
        let a0 = [0, 1, 2].map(|k| scale[0] * (dot(right, axes[k]) - clamped[0] * along[k]));
        let a1 = [0, 1, 2].map(|k| scale[1] * (dot(down, axes[k]) - clamped[1] * along[k]));
        let n = cross(a0, a1);
        let (aa, cc, det0) = (dot(a0, a0), dot(a1, a1), dot(n, n));
        Footprint {
            a: aa + DILATION,
            b: dot(a0, a1),
            c: cc + DILATION,
            det: det0 + DILATION * (aa + cc) + DILATION * DILATION,
            det0,
            depth_deviation: dot(along, along).sqrt(),
        }
    }
}

fn dot([a, b, c]: [f32; 3], [x, y, z]: [f32; 3]) -> f32 {
    a * x + b * y + c * z
}

fn cross([a, b, c]: [f32; 3], [x, y, z]: [f32; 3]) -> [f32; 3] {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}
