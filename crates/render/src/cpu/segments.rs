//! The moving part that each pixel shows, and the velocity: a blend of the frame's splats once more, with their parts or
//! their velocities as features.
//!
//! The weight of a part at a pixel is the sum of the blended weights of its Gaussians. What is still, and what is
//! behind, has the rest of 1. The largest weight decides; of equal ones, the part with the lower number.

use super::bin::{OrderedSplats, TileGrid, TileLists};
use super::project::{CHUNK, ProjectedChunk};
use super::raster::RasterInput;
use super::raster_pass;
use super::resolve::{BlendedTiles, feature_image, mean_vectors};
use super::splat::{MAX_FEATURES, Splat};
use crate::{OmissionPolicy, RenderStyle};
use fearless_simd::Level;
use glam::{DMat3, DVec3};
use gs2e_image::Image;
use gs2e_scene::Gaussians;
use gs2e_scene::dynamic::{SceneMoment, SplatDynamics};

/// The frame whose parts or velocities are found.
#[derive(Debug, Clone, Copy)]
pub(super) struct SegmentPass<'a> {
    pub(super) scene: &'a Gaussians,
    /// The order of the frame's splats.
    pub(super) order: &'a [u64],
    /// Index in the scene of each splat.
    pub(super) numbers: &'a [u32],
    pub(super) chunks: &'a [ProjectedChunk],
    pub(super) grid: TileGrid,
    pub(super) style: RenderStyle,
    pub(super) omit: OmissionPolicy,
    pub(super) level: Level,
}

impl SegmentPass<'_> {
    /// The part of each pixel. The features of the splats, the lists and the tiles are overwritten.
    pub(super) fn run(self, splats: &mut [Splat], lists: &mut TileLists, tiles: &mut Vec<f32>) -> Image<u8> {
        let size = self.grid.size;
        let mut parts = Image::filled(size, 0_u8);
        let mut most = vec![0.0_f32; size.pixels()];
        let mut all = vec![0.0_f32; size.pixels()];
        let count = self.scene.part_count();
        for before in (0..count).step_by(MAX_FEATURES) {
            let features = MAX_FEATURES.min(count - before);
            self.mark(before, splats);
            self.blend(features, splats, lists, tiles);
            for feature in 0..features {
                let weights = feature_image(BlendedTiles { tiles, features, grid: self.grid }, feature);
                let part = u8::try_from(before + feature + 1).expect("a scene has at most 255 parts");
                let pixels = parts.pixels_mut().iter_mut().zip(&mut most).zip(&mut all);
                for (((found, most), all), &weight) in pixels.zip(weights.pixels()) {
                    *all += weight;
                    if weight > *most {
                        (*most, *found) = (weight, part);
                    }
                }
            }
        }
        for ((found, most), all) in parts.pixels_mut().iter_mut().zip(&most).zip(&all) {
            if *most <= 1.0 - *all {
                *found = 0;
            }
        }
        parts
    }

    /// The velocity that each pixel shows, camera axes. What [`Self::run`] overwrites is overwritten.
    pub(super) fn drift(
        self,
        camera_from_world: DMat3,
        (dynamics, moment): (&SplatDynamics, SceneMoment),
        (splats, lists, tiles): (&mut [Splat], &mut TileLists, &mut Vec<f32>),
    ) -> Image<[f32; 3]> {
        self.each(splats, |splat, number| {
            let velocity = dynamics.splat(self.scene, number, moment).velocity();
            let seen = camera_from_world * DVec3::from_array(velocity);
            splat.features[..3].copy_from_slice(&seen.as_vec3().to_array());
        });
        self.blend(3, splats, lists, tiles);
        mean_vectors(BlendedTiles { tiles, features: 3, grid: self.grid })
    }

    /// Gives each splat a feature of 1 for its part, if it is one of the next after `before`.
    fn mark(self, before: usize, splats: &mut [Splat]) {
        self.each(splats, |splat, number| {
            let part = self.scene.part_of(number);
            splat.features = [0.0; MAX_FEATURES];
            let feature = part.checked_sub(before + 1).and_then(|k| splat.features.get_mut(k));
            feature.into_iter().for_each(|feature| *feature = 1.0);
        });
    }

    /// Does something with each splat and the number of its Gaussian.
    fn each(self, splats: &mut [Splat], act: impl Fn(&mut Splat, usize)) {
        for (chunk, first) in self.chunks.iter().zip((0..).step_by(CHUNK)) {
            let places = first..first + chunk.drawn;
            for (splat, number) in splats[places.clone()].iter_mut().zip(&self.numbers[places]) {
                act(splat, *number as usize);
            }
        }
    }

    fn blend(self, features: usize, splats: &[Splat], lists: &mut TileLists, tiles: &mut Vec<f32>) {
        let Self { grid, omit, level, style: RenderStyle { rules, order, .. }, .. } = self;
        lists.run(OrderedSplats { order: self.order, splats, grid }, |lists| {
            let input =
                RasterInput { splats, rates: &[], lists, grid, sample: None, rules, order, omit, level };
            raster_pass(features, false, input, tiles);
        });
    }
}
