//! Pass 1: projects every Gaussian onto the image plane, or culls it.
//!
//! The projection of one Gaussian is in `eye`. This file applies it to blocks, lane by lane.
//!
//! Each step is a loop over all lanes of a block without a branch: culled lanes are computed as
//! well and discarded at the end. Wasted lanes cost less than branches would, because the compiler
//! turns such loops into vector code.

#![expect(clippy::cast_possible_truncation, reason = "positions become f32 once they are camera coordinates")]

mod changing;
mod colour;

use super::activate::{GaussianBlock, LANES, Lane, PROMISES};
use super::cull::{BEHIND, CullCounts, DEGENERATE, DRAWN, Fate, OUTSIDE, count_culled};
use super::extent;
use super::eye::ViewTransform;
use super::splat::{MAX_FEATURES, Splat, SplatRates};
use crate::dual::{DualNumber, RealNumber};
use crate::sample::TileSample;
use crate::shared::{
    AFFINE_DOUBTFUL, AFFINE_INVALID, COMPENSATION_FLOOR, GSPLAT_FAR, GSPLAT_NEAR, NEAR, least_alpha,
};
use crate::{ChannelSet, RenderRules, RenderStyle, RenderWork};
use fearless_simd::{Level, Simd, dispatch};
use gs2e_image::luminance;
use gs2e_scene::dynamic::SceneAt;
use gs2e_scene::{Gaussians, sh};
use rayon::prelude::*;

/// Number of Gaussians that one task projects. Its multiples are the places at which the tasks'
/// output begins.
pub(super) const CHUNK: usize = 4096;

/// The input of the pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProjectionInput<'a> {
    /// The scene.
    pub(super) scene: &'a Gaussians,
    /// Gaussians that the view may see, in activated form. All blocks but the last of each object are full.
    pub(super) blocks: &'a [GaussianBlock],
    /// Highest degree of harmonics that is evaluated.
    pub(super) sh_degree: u8,
    /// Rendering parameters.
    pub(super) style: RenderStyle,
    /// The view, from what is still and from each object.
    pub(super) eyes: &'a [ViewTransform],
    /// The features that the splats carry.
    pub(super) want: ChannelSet,
    /// The tiles that are read, if not all are. Gaussians that touch none of them are left out.
    pub(super) sample: Option<&'a TileSample>,
    /// The moment of a scene that changes with time.
    pub(super) moment: Option<SceneAt<'a>>,
    /// The instruction set.
    pub(super) level: Level,
}

/// The output of the pass, kept for the next frame. What belongs to chunk `k` of Gaussians starts at
/// `k * CHUNK`, in file order.
#[derive(Debug, Default)]
pub(super) struct ProjectedSplats {
    pub(super) splats: Vec<Splat>,
    /// Depth of each splat, for the sort.
    pub(super) depths: Vec<f32>,
    /// Index in the scene of each splat.
    pub(super) numbers: Vec<u32>,
    /// Of each splat, if a channel needs rates.
    pub(super) rates: Vec<SplatRates>,
    pub(super) chunks: Vec<ProjectedChunk>,
}

/// Counts for one [`CHUNK`] of Gaussians.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ProjectedChunk {
    /// Number of splats at the front of the chunk's piece of `splats`.
    pub(super) drawn: usize,
    /// Counts, without those of culled Gaussians.
    pub(super) work: RenderWork,
    /// Culled Gaussians of each promise.
    pub(super) culled: [CullCounts; PROMISES],
}

/// The places of a chunk in [`ProjectedSplats`].
struct DrawnSplats<'a> {
    splats: &'a mut [Splat],
    depths: &'a mut [f32],
    numbers: &'a mut [u32],
    rates: &'a mut [SplatRates],
    done: ProjectedChunk,
}

/// A number, or a number with its rate, stored as one array per block.
trait LaneValue: RealNumber<Plain = f32> {
    /// The array for a block.
    type Lanes: Copy;
    /// An array of zeros.
    const ZEROS: Self::Lanes;
    /// True if there are rates.
    const HAS_RATES: bool;

    fn at(lanes: &Self::Lanes, i: usize) -> Self;
    fn put(self, lanes: &mut Self::Lanes, i: usize);
}

impl LaneValue for f32 {
    type Lanes = Lane;
    const ZEROS: Lane = [0.0; LANES];
    const HAS_RATES: bool = false;

    #[inline(always)]
    fn at(lanes: &Lane, i: usize) -> Self {
        lanes[i]
    }

    #[inline(always)]
    fn put(self, lanes: &mut Lane, i: usize) {
        lanes[i] = self;
    }
}

impl LaneValue for DualNumber<f32> {
    type Lanes = DualNumber<Lane>;
    const ZEROS: DualNumber<Lane> = DualNumber { value: [0.0; LANES], rate: [0.0; LANES] };
    const HAS_RATES: bool = true;

    #[inline(always)]
    fn at(lanes: &DualNumber<Lane>, i: usize) -> Self {
        Self { value: lanes.value[i], rate: lanes.rate[i] }
    }

    #[inline(always)]
    fn put(self, lanes: &mut DualNumber<Lane>, i: usize) {
        lanes.value[i] = self.value;
        lanes.rate[i] = self.rate;
    }
}

/// The projection of a block, lane by lane.
struct ProjectedBlock<S: LaneValue> {
    fate: [Fate; LANES],
    depth: S::Lanes,
    mean: [S::Lanes; 2],
    slopes: [S::Lanes; 2],
    /// `a`, `b` and `c` of `SplatCovariance`.
    covariance: [Lane; 3],
    depth_deviation: Lane,
    w: [S::Lanes; 3],
    opacity: S::Lanes,
    reach: Lane,
    columns: [[u16; LANES]; 2],
    rows: [[u16; LANES]; 2],
    /// Lanes that are drawn, in order.
    drawn: [u8; LANES],
    /// Means of the drawn lanes, without gaps.
    positions: [Lane; 3],
    /// Harmonics in the directions of the drawn lanes, without gaps.
    basis: [S::Lanes; sh::MAX_LEN],
}

impl ProjectionInput<'_> {
    /// Projects all Gaussians.
    pub(super) fn run(&self, out: &mut ProjectedSplats) {
        let ProjectedSplats { splats, depths, numbers, rates, chunks } = out;
        // A place for every lane, also in blocks that are not full.
        let count = self.blocks.len() * LANES;
        splats.resize(count, Splat::default());
        depths.resize(count, 0.0);
        numbers.resize(count, 0);
        // These chunks of blocks and of splats hold the same Gaussians.
        let drawn =
            (splats.par_chunks_mut(CHUNK), depths.par_chunks_mut(CHUNK), numbers.par_chunks_mut(CHUNK));
        let pieces = self.blocks.par_chunks(CHUNK / LANES).zip(drawn);
        if self.want.luminance_rate {
            rates.resize(count, SplatRates::default());
            let pieces = pieces.zip(rates.par_chunks_mut(CHUNK));
            let pieces = pieces.map(|((blocks, (splats, depths, numbers)), rates)| {
                let drawn = DrawnSplats { splats, depths, numbers, rates, done: ProjectedChunk::default() };
                dispatch!(self.level, simd => self.chunk::<_, DualNumber<f32>>(simd, blocks, drawn))
            });
            pieces.collect_into_vec(chunks);
        } else {
            let pieces = pieces.map(|(blocks, (splats, depths, numbers))| {
                let (rates, done) = (&mut [][..], ProjectedChunk::default());
                let drawn = DrawnSplats { splats, depths, numbers, rates, done };
                dispatch!(self.level, simd => self.chunk::<_, f32>(simd, blocks, drawn))
            });
            pieces.collect_into_vec(chunks);
        }
    }

    /// Projects one chunk. This function and all that it calls are inlined into one copy per
    /// instruction set.
    #[inline(always)]
    fn chunk<V: Simd, S: LaneValue>(
        &self,
        simd: V,
        blocks: &[GaussianBlock],
        mut drawn: DrawnSplats<'_>,
    ) -> ProjectedChunk {
        let mut projected = ProjectedBlock::<S>::new();
        for block in blocks {
            self.block(simd, block, &mut projected, &mut drawn);
        }
        drawn.done
    }

    #[inline(always)]
    fn block<V: Simd, S: LaneValue>(
        &self,
        simd: V,
        block: &GaussianBlock,
        projected: &mut ProjectedBlock<S>,
        DrawnSplats { splats, depths, numbers, rates, done }: &mut DrawnSplats<'_>,
    ) {
        let eye = &self.eyes[block.object];
        projected.locate(eye, self.style.rules, block);
        projected.outline(eye, self.style, block);
        match self.style.rules {
            RenderRules::Official => projected.bound(RenderRules::Official, eye.size),
            RenderRules::Exact | RenderRules::Soft => projected.bound(RenderRules::Exact, eye.size),
            RenderRules::Gsplat => projected.bound(RenderRules::Gsplat, eye.size),
        }
        if let Some(sample) = self.sample {
            projected.leave_out(sample);
        }
        let count = projected.count(block.len, &mut done.work);
        count_culled(&projected.fate[..block.len], block.promised, &mut done.culled);
        let coloured = self.want.rgb || self.want.luminance || self.want.luminance_rate;
        if coloured {
            projected.face(eye, block, self.sh_degree, count);
        }
        for k in 0..count {
            let i = usize::from(projected.drawn[k]);
            let mut colour = [S::nearest(0.0); 3];
            if coloured {
                let number = block.numbers[i] as usize;
                colour = match self.moment.and_then(|at| at.harmonics(number)) {
                    Some(harmonics) => {
                        projected.changing_colour(k, &harmonics[..sh::function_count(self.sh_degree)])
                    }
                    None => {
                        let coefficients = self.scene.sh_of(number).as_flattened();
                        projected.colour(simd, k, &coefficients[..3 * sh::function_count(self.sh_degree)])
                    }
                };
            }
            let value = [colour[0].value(), colour[1].value(), colour[2].value()];
            depths[done.drawn] = S::at(&projected.depth, i).value();
            numbers[done.drawn] = block.numbers[i];
            let splat = &mut splats[done.drawn];
            *splat = projected.splat(i);
            self.write_features(value, projected, i, &mut splat.features);
            if S::HAS_RATES {
                let rate = [colour[0].rate(), colour[1].rate(), colour[2].rate()];
                rates[done.drawn] = projected.rates(i, luminance(value), luminance(rate));
            }
            done.drawn += 1;
        }
    }

    /// Writes the features to blend, in the order of [`ChannelSet`]. Into the splat itself: a copy of single
    /// numbers that is read as a vector would wait for all of them.
    #[inline(always)]
    fn write_features<S: LaneValue>(
        &self,
        colour: [f32; 3],
        projected: &ProjectedBlock<S>,
        i: usize,
        features: &mut [f32; MAX_FEATURES],
    ) {
        // `resolve_tiles` reads the features in this order.
        let mut n = 0;
        if self.want.rgb {
            features[..3].copy_from_slice(&colour);
            n = 3;
        }
        if self.want.luminance {
            features[n] = luminance(colour);
            n += 1;
        }
        if self.want.depth {
            features[n] = S::at(&projected.depth, i).value();
            n += 1;
        }
        if self.want.doubtful {
            features[n] = f32::from(u8::from(projected.is_deeper(i, AFFINE_DOUBTFUL)));
        }
    }
}

impl<S: LaneValue> ProjectedBlock<S> {
    #[inline(always)]
    fn new() -> Self {
        let zero = [0.0; LANES];
        Self {
            fate: [DRAWN; LANES],
            depth: S::ZEROS,
            mean: [S::ZEROS; 2],
            slopes: [S::ZEROS; 2],
            covariance: [zero; 3],
            depth_deviation: zero,
            w: [S::ZEROS; 3],
            opacity: S::ZEROS,
            reach: zero,
            columns: [[0; LANES]; 2],
            rows: [[0; LANES]; 2],
            drawn: [0; LANES],
            positions: [zero; 3],
            basis: [S::ZEROS; sh::MAX_LEN],
        }
    }

    /// Projects the means.
    #[inline(always)]
    fn locate(&mut self, eye: &ViewTransform, rules: RenderRules, block: &GaussianBlock) {
        let [x, y, z] = &block.positions;
        let (nearest, farthest) = match rules {
            // The rules ask for `z > NEAR`. The next float turns that into the comparison of
            // `gsplat`.
            RenderRules::Official | RenderRules::Exact | RenderRules::Soft => (NEAR.next_up(), f32::INFINITY),
            RenderRules::Gsplat => (GSPLAT_NEAR, GSPLAT_FAR),
        };
        for i in 0..LANES {
            let sight = eye.sight::<S>(eye.camera_from_world * eye.ray([x[i], y[i], z[i]]));
            let depth = sight.depth.value();
            // A depth that is NaN fails both comparisons and counts as behind.
            let in_front = depth >= nearest && depth <= farthest;
            self.fate[i] = if in_front { DRAWN } else { BEHIND };
            sight.depth.put(&mut self.depth, i);
            for k in 0..2 {
                sight.mean[k].put(&mut self.mean[k], i);
                sight.slopes[k].put(&mut self.slopes[k], i);
            }
        }
    }

    /// The covariances and the reach.
    #[inline(always)]
    fn outline(&mut self, eye: &ViewTransform, style: RenderStyle, block: &GaussianBlock) {
        match block.motion.as_deref().filter(|_| S::HAS_RATES) {
            Some(motion) => self.outline_changing(eye, style, block, motion),
            None if style.antialiased => self.shape::<_, true>(eye, style.rules, block, StillGaussians),
            None => self.shape::<_, false>(eye, style.rules, block, StillGaussians),
        }
        if style.antialiased {
            self.reach_anew(style.rules);
        } else {
            self.reach = block.reach;
        }
    }

    /// Projects the covariances. If `ANTIALIASED`, the opacities are scaled too.
    #[inline(always)]
    fn shape<M: LaneMotion, const ANTIALIASED: bool>(
        &mut self,
        eye: &ViewTransform,
        rules: RenderRules,
        block: &GaussianBlock,
        motion: M,
    ) {
        let least = least_alpha(rules);
        let [m0, m1, m2] = &block.axes;
        for i in 0..LANES {
            let slopes = [S::at(&self.slopes[0], i), S::at(&self.slopes[1], i)];
            let mean = [S::at(&self.mean[0], i).value(), S::at(&self.mean[1], i).value()];
            let axis = |m: &[Lane; 3]| [m[0][i], m[1][i], m[2][i]];
            let axes = [axis(m0), axis(m1), axis(m2)];
            let shape = eye.footprint(slopes, S::at(&self.depth, i), motion.turned(eye, axes, i));
            let mut opacity = S::with_rate(block.opacity[i], 0.0);
            if ANTIALIASED {
                let floor = S::nearest(COMPENSATION_FLOOR.into());
                opacity = opacity * (shape.det0 / shape.det).at_least(floor).sqrt();
            }
            let det = shape.det.value();
            // `&` instead of `&&`, so that the loop has no branch.
            let sound = det.is_finite() & (det > 0.0) & mean[0].is_finite() & mean[1].is_finite();
            // A Gaussian has one fate. Behind comes before degenerate, and degenerate before
            // outside.
            let fate = if opacity.value() < least { OUTSIDE } else { DRAWN };
            let fate = if sound { fate } else { DEGENERATE };
            self.fate[i] = if self.fate[i] == BEHIND { BEHIND } else { fate };
            for (w, to) in shape.weights().iter().zip(&mut self.w) {
                w.put(to, i);
            }
            opacity.put(&mut self.opacity, i);
            self.covariance[0][i] = shape.a.value();
            self.covariance[1][i] = shape.b.value();
            self.covariance[2][i] = shape.c.value();
            self.depth_deviation[i] = shape.depth_deviation;
        }
    }

    /// The reach of the scaled opacities.
    #[inline(always)]
    fn reach_anew(&mut self, rules: RenderRules) {
        // The logarithm is not vector code, so it is computed for drawn lanes only.
        for i in 0..LANES {
            if self.fate[i] == DRAWN {
                self.reach[i] = extent::opacity_reach(rules, S::at(&self.opacity, i).value());
            }
        }
    }

    /// The pixel ranges that the splats may touch.
    #[inline(always)]
    fn bound(&mut self, rules: RenderRules, size: [f32; 2]) {
        let [a, b, c] = &self.covariance;
        for i in 0..LANES {
            let mean = [S::at(&self.mean[0], i).value(), S::at(&self.mean[1], i).value()];
            let [columns, rows] =
                extent::touched_pixels(rules, mean, [a[i], b[i], c[i]], self.reach[i], size);
            let empty = (columns[0] >= columns[1]) | (rows[0] >= rows[1]);
            self.fate[i] = if empty & (self.fate[i] == DRAWN) { OUTSIDE } else { self.fate[i] };
            for k in 0..2 {
                self.columns[k][i] = columns[k];
                self.rows[k][i] = rows[k];
            }
        }
    }

    /// Leaves out the lanes that touch no tile of a sample.
    #[inline(always)]
    fn leave_out(&mut self, sample: &TileSample) {
        for i in 0..LANES {
            let [columns, rows] = [&self.columns, &self.rows].map(|range| [range[0][i], range[1][i]]);
            if self.fate[i] == DRAWN && !sample.touches(columns, rows) {
                self.fate[i] = OUTSIDE;
            }
        }
    }

    /// Lists the drawn lanes among the first `len`, and counts those with a doubtful approximation.
    #[inline(always)]
    fn count(&mut self, len: usize, work: &mut RenderWork) -> usize {
        let mut drawn = 0;
        for i in 0..len {
            // Written for every lane and kept only if the lane is drawn: there is no branch.
            self.drawn[drawn] = i as u8;
            drawn += usize::from(self.fate[i] == DRAWN);
        }
        for k in 0..drawn {
            let i = usize::from(self.drawn[k]);
            work.affine_doubtful += u64::from(self.is_deeper(i, AFFINE_DOUBTFUL));
            work.affine_invalid += u64::from(self.is_deeper(i, AFFINE_INVALID));
        }
        drawn
    }

    /// Returns true if the standard deviation of depth exceeds this share of the depth.
    #[inline(always)]
    fn is_deeper(&self, i: usize, share: f32) -> bool {
        self.depth_deviation[i] > share * S::at(&self.depth, i).value()
    }

    /// A splat without features.
    #[inline(always)]
    fn splat(&self, i: usize) -> Splat {
        let value = |lanes: &S::Lanes| S::at(lanes, i).value();
        Splat {
            mean: [value(&self.mean[0]), value(&self.mean[1])],
            w: [value(&self.w[0]), value(&self.w[1]), value(&self.w[2])],
            opacity: value(&self.opacity),
            reach: self.reach[i],
            columns: [self.columns[0][i], self.columns[1][i]],
            rows: [self.rows[0][i], self.rows[1][i]],
            features: [0.0; MAX_FEATURES],
            depth: value(&self.depth),
        }
    }

    #[inline(always)]
    fn rates(&self, i: usize, grey: f32, grey_rate: f32) -> SplatRates {
        let rate = |lanes: &S::Lanes| S::at(lanes, i).rate();
        let opacity = S::at(&self.opacity, i);
        SplatRates {
            mean: [rate(&self.mean[0]), rate(&self.mean[1])],
            w: [rate(&self.w[0]), rate(&self.w[1]), rate(&self.w[2])],
            // A drawn opacity is at least the least one, so the quotient is finite.
            opacity: opacity.rate() / opacity.value(),
            depth: rate(&self.depth),
            grey,
            grey_rate,
        }
    }
}

/// How the Gaussians of a block move. A trait and no closures, which would be compiled without the
/// instruction set in use.
trait LaneMotion: Copy {
    /// The scaled axes of lane `i` in camera axes.
    fn turned<S: LaneValue>(self, eye: &ViewTransform, axes: [[f32; 3]; 3], i: usize) -> [[S; 3]; 3];

    /// The direction to the `k`-th drawn Gaussian.
    fn direction<S: LaneValue>(self, eye: &ViewTransform, point: [f32; 3], k: usize) -> [S; 3];
}

/// The Gaussians of a scene that does not change.
#[derive(Debug, Clone, Copy)]
struct StillGaussians;

impl LaneMotion for StillGaussians {
    #[inline(always)]
    fn turned<S: LaneValue>(self, eye: &ViewTransform, axes: [[f32; 3]; 3], _: usize) -> [[S; 3]; 3] {
        [eye.turned(axes[0]), eye.turned(axes[1]), eye.turned(axes[2])]
    }

    #[inline(always)]
    fn direction<S: LaneValue>(self, eye: &ViewTransform, point: [f32; 3], _: usize) -> [S; 3] {
        eye.direction(point)
    }
}
