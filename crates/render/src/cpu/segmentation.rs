//! The moving object that each pixel shows, and the velocity: a blend of the frame's splats once more, with
//! their objects or their velocities as features.
//!
//! The weight of an object at a pixel is the sum of the blended weights of its Gaussians. What is still, and
//! what is behind, has the rest of 1. The largest weight decides; of equal ones, the object with the lower
//! number.

use super::bin::{OrderedSplats, TileGrid, TileLists};
use super::project::{CHUNK, ProjectedChunk};
use super::raster::RasterInput;
use super::raster_pass;
use super::resolve::{BlendedTiles, feature_image, mean_vectors};
use super::splat::{MAX_FEATURES, Splat};
use crate::{ChannelSet, OmissionPolicy, RenderStyle, RenderedImages};
use fearless_simd::Level;
use glam::{DMat3, DVec3};
use gs2e_image::Image;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::flow::{flow_of_objects, with_drift};
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::dynamic::SceneAt;

/// Buffers of a frame that are overwritten.
pub(super) struct BlendBuffers<'a> {
    /// The features of the splats are overwritten.
    pub(super) splats: &'a mut [Splat],
    pub(super) lists: &'a mut TileLists,
    pub(super) tiles: &'a mut Vec<f32>,
}

/// The frame whose objects or velocities are found.
#[derive(Debug, Clone, Copy)]
pub(super) struct SegmentationPass<'a> {
    pub(super) scene: &'a Gaussians,
    /// The view, from what is still and from each object.
    pub(super) views: &'a [CameraView],
    /// The moment of a scene that changes with time.
    pub(super) moment: Option<SceneAt<'a>>,
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

impl SegmentationPass<'_> {
    /// Adds the objects, velocities and flow of a frame to its images, and removes what was made for flow
    /// alone.
    pub(super) fn add_motion(
        self,
        mut buffers: BlendBuffers<'_>,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) {
        let CameraView { camera, world_from_camera, .. } = &self.views[0];
        out.segmentation =
            (want.segmentation || want.flow && self.views.len() > 1).then(|| self.objects(&mut buffers));
        let camera_from_world = world_from_camera.rotation_matrix().transpose();
        out.drift = match self.moment.filter(|_| want.drift || want.flow) {
            Some(at) => Some(self.drift(camera_from_world, at, &mut buffers)),
            None => want.drift.then(|| Image::filled(camera.size, [0.0; 3])),
        };
        let depth = out.depth.as_ref().filter(|_| want.flow);
        out.flow = depth.map(|depth| {
            let flow = flow_of_objects(depth, out.segmentation.as_ref(), self.views);
            with_drift(flow, depth, out.drift.as_ref(), camera)
        });
        // After the flow, which needs all three.
        out.depth.take_if(|_| !want.depth);
        out.segmentation.take_if(|_| !want.segmentation);
        out.drift.take_if(|_| !want.drift);
    }

    /// The object of each pixel.
    fn objects(self, buffers: &mut BlendBuffers<'_>) -> Image<u8> {
        let size = self.grid.size;
        let mut objects = Image::filled(size, 0_u8);
        let mut most = vec![0.0_f32; size.pixels()];
        let mut all = vec![0.0_f32; size.pixels()];
        let count = self.scene.object_count();
        // A splat has few features, so the parts are blended in groups.
        for before in (0..count).step_by(MAX_FEATURES) {
            let features = MAX_FEATURES.min(count - before);
            self.mark(before, buffers.splats);
            self.blend(features, buffers);
            for feature in 0..features {
                let tiles = BlendedTiles { tiles: buffers.tiles, features, grid: self.grid };
                let weights = feature_image(tiles, feature);
                let object = u8::try_from(before + feature + 1).expect("a scene has at most 255 objects");
                let pixels = objects.pixels_mut().iter_mut().zip(&mut most).zip(&mut all);
                for (((found, most), all), &weight) in pixels.zip(weights.pixels()) {
                    *all += weight;
                    // Not `>=`: of equal weights the part with the lower number counts.
                    if weight > *most {
                        (*most, *found) = (weight, object);
                    }
                }
            }
        }
        for ((found, most), all) in objects.pixels_mut().iter_mut().zip(&most).zip(&all) {
            if *most <= 1.0 - *all {
                *found = 0;
            }
        }
        objects
    }

    /// The velocity that each pixel shows, camera axes.
    fn drift(
        self,
        camera_from_world: DMat3,
        at: SceneAt<'_>,
        buffers: &mut BlendBuffers<'_>,
    ) -> Image<[f32; 3]> {
        self.each(buffers.splats, |splat, number| {
            let velocity = at.splat(number).velocity();
            let in_camera = camera_from_world * DVec3::from_array(velocity);
            splat.features[..3].copy_from_slice(&in_camera.as_vec3().to_array());
        });
        self.blend(3, buffers);
        mean_vectors(BlendedTiles { tiles: buffers.tiles, features: 3, grid: self.grid })
    }

    /// Gives each splat a feature of 1 for its object, if it is one of the next after `before`.
    fn mark(self, before: usize, splats: &mut [Splat]) {
        self.each(splats, |splat, number| {
            let object = self.scene.object_of(number);
            splat.features = [0.0; MAX_FEATURES];
            let feature = object.checked_sub(before + 1).and_then(|k| splat.features.get_mut(k));
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

    fn blend(self, features: usize, BlendBuffers { splats, lists, tiles }: &mut BlendBuffers<'_>) {
        let Self { grid, omit, level, style: RenderStyle { rules, order, .. }, .. } = self;
        lists.run(OrderedSplats { order: self.order, splats, grid }, |lists| {
            let input =
                RasterInput { splats, rates: &[], lists, grid, sample: None, rules, order, omit, level };
            raster_pass(features, false, input, tiles);
        });
    }
}
