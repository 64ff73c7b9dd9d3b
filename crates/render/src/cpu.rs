//! The CPU back end: plain IEEE arithmetic, in f64 up to camera coordinates and in f32 from there
//! on.
//!
//! The passes are: `project` every Gaussian, `sort` those that remain, `bin` them into tiles,
//! `raster` each tile, `resolve` the tiles into images. No pixel depends on a fused multiply-add or
//! on a transcendental function of the platform, and the order of every sum is fixed. The bytes are
//! therefore the same on every machine and with any number of threads.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_render::{LayerOrder, RenderRules, RenderStyle};
//! use gs2e_render::cpu::{CpuRenderer, PassKind};
//! use gs2e_render::{ChannelSet, RenderedImages};
//! use gs2e_scene::camera::{Camera, view::CameraView};
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! # let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! # let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! # let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! // The only Gaussian of `scene` has an opacity of 1/2, and is seen in the middle pixel.
//! let view = CameraView::at_rest(camera, Se3::IDENTITY);
//! let (want, mut images) = (ChannelSet { alpha: true, ..ChannelSet::NONE }, RenderedImages::default());
//! let mut passes = Vec::new();
//! let mut renderer = CpuRenderer::new(scene.into(), style)?;
//! renderer.render_in_passes(&view, want, &mut images, &mut |pass| passes.push(pass))?;
//! assert_eq!(images.alpha.ok_or("no opacity")?.pixels()[4 * 9 + 4], 0.5);
//! assert_eq!((passes.first(), passes.last()), (Some(&PassKind::Project), Some(&PassKind::Resolve)));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod activate;
pub mod backward;
mod bin;
mod cull;
mod exp2;
mod extent;
pub mod eye;
mod level;
mod project;
mod raster;
mod resolve;
mod segmentation;
mod sort;
mod splat;
mod unseen;

pub use level::InstructionSet;

use super::sample::TileSample;
use super::{
    ChannelSet, OmissionPolicy, RenderError, RenderRules, RenderStyle, RenderWork, RenderedImages, Renderer,
    objects,
};
use activate::{GaussianBlock, PROMISES};
use bin::{OrderedSplats, TileGrid, TileLists};
use cull::CullCounts;
use eye::ViewTransform;
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::dynamic::SceneMoment;
use gs2e_scene::{Gaussians, sh};
use project::{ProjectedSplats, ProjectionInput};
use raster::RasterInput;
use rayon::prelude::*;
use resolve::BlendedTiles;
use segmentation::{BlendBuffers, SegmentationPass};
use sort::DepthSorter;
use std::sync::Arc;

/// A scene ready for rendering, and the buffers of its last frame.
#[derive(Debug)]
pub struct CpuRenderer {
    scene: Arc<Gaussians>,
    /// Gaussians that some view may see, in activated form.
    blocks: Vec<GaussianBlock>,
    /// Highest degree of harmonics that is evaluated. If work is left out, it is the highest degree
    /// that is not all zero.
    sh_degree: u8,
    style: RenderStyle,
    omit: OmissionPolicy,
    instructions: InstructionSet,
    frame: FrameBuffers,
    /// The tiles that are read, if not all are.
    sample: Option<Arc<TileSample>>,
    /// Number of Gaussians of each promise.
    promised: [usize; PROMISES],
    /// The moment that the blocks show, of a scene that changes.
    moment: Option<SceneMoment>,
}

/// Index of the promise of [`Renderer::keep_to`].
const ALL_FRAMES: usize = 0;
/// Index of the promise of [`Renderer::keep_also`].
const ONE_READER: usize = 1;

/// The buffers of a frame's passes, kept for the next frame.
#[derive(Debug)]
struct FrameBuffers {
    projected: ProjectedSplats,
    sorter: DepthSorter,
    lists: TileLists,
    tiles: Vec<f32>,
}

impl FrameBuffers {
    fn new() -> Self {
        Self {
            projected: ProjectedSplats::default(),
            sorter: DepthSorter::default(),
            lists: TileLists::new(bin::BUDGET),
            tiles: Vec::new(),
        }
    }

    /// Projects every Gaussian. Returns the work, with the culled Gaussians of the first promise.
    fn project(&mut self, input: &ProjectionInput<'_>) -> RenderWork {
        input.run(&mut self.projected);
        let mut work = RenderWork { gaussians: input.scene.len() as u64, ..RenderWork::default() };
        self.projected.chunks.iter().for_each(|chunk| work += chunk.work);
        self.culled(ALL_FRAMES).within(work)
    }

    /// The culled Gaussians of the last frame for a promise.
    fn culled(&self, promise: usize) -> CullCounts {
        let mut sum = CullCounts::default();
        self.projected.chunks.iter().for_each(|chunk| sum += chunk.culled[promise]);
        sum
    }

    /// Number of splats of the last frame.
    fn drawn(&self) -> usize {
        self.projected.chunks.iter().map(|chunk| chunk.drawn).sum()
    }
}

/// The numerical class: plain IEEE operations in a fixed order, equal on every machine. Raise it
/// with every change of a pixel's bits.
pub const FINGERPRINT: &str = "cpu/1";

/// Memory for rendering a scene of this many bytes at this size, in bytes, as measured: the scene
/// as stored and in activated form; colour, alpha and depth of every pixel; the lists of the tiles.
#[must_use]
pub fn memory_needed(scene_bytes: u64, size: Size) -> u64 {
    const BYTES_A_PIXEL: u64 = 24;
    2 * scene_bytes + BYTES_A_PIXEL * u64::from(size.width) * u64::from(size.height)
}

impl CpuRenderer {
    /// Prepares a scene. Gaussians with a value that is not finite are excluded from every image.
    ///
    /// # Errors
    /// The scene has more than 2^32 - 1 Gaussians, or the background is not finite.
    pub fn new(scene: Arc<Gaussians>, style: RenderStyle) -> Result<Self, RenderError> {
        // The places in the keys of the sort have 32 bits.
        if u32::try_from(scene.len()).is_err() {
            let because = format!("{} Gaussians, wanted at most {}", scene.len(), u32::MAX);
            return Err(RenderError::Scene(because));
        }
        super::check_style(&style)?;
        let blocks = activate::activate_all(&scene, style.rules, &unseen::all_indices(&scene));
        let sh_degree = activate::sh_degree(&scene);
        let promised = [scene.len(); PROMISES];
        Ok(Self {
            scene,
            blocks,
            sh_degree,
            style,
            omit: OmissionPolicy::default(),
            instructions: InstructionSet::widest_set(),
            frame: FrameBuffers::new(),
            sample: None,
            promised,
            moment: None,
        })
    }
}

/// One pass over the scene or the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PassKind {
    /// Projection of every Gaussian.
    Project,
    /// Sort by depth.
    Sort,
    /// Lists per tile.
    Bin,
    /// Blending of each tile.
    Raster,
    /// Images from tiles.
    Resolve,
}

impl CpuRenderer {
    /// Sets the instruction set for later frames: the same bits at another speed.
    pub fn set_instructions(&mut self, instructions: InstructionSet) {
        self.instructions = instructions;
    }

    /// Sets the maximum number of (Gaussian, tile) pairs that are listed at once: the same bits
    /// with more or less memory. A single tile may exceed it.
    pub fn set_list_budget(&mut self, pairs: usize) {
        self.frame.lists = TileLists::new(pairs);
    }

    /// [`Renderer::render`] with a callback at the end of each pass. If the lists exceed their
    /// budget, binning and blending alternate.
    ///
    /// # Errors
    /// The view cannot be rendered.
    pub fn render_in_passes(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
        done: &mut dyn FnMut(PassKind),
    ) -> Result<RenderWork, RenderError> {
        super::check_view(view)?;
        let asked = ChannelSet { depth: want.depth || want.flow, ..want };
        let views = objects::object_views(&self.scene, view)?;
        self.advance(view.seconds);
        let mut work = self.project(&views, asked);
        done(PassKind::Project);

        let FrameBuffers { projected, sorter, lists, tiles } = &mut self.frame;
        // One order serves the whole frame, so ties do not depend on tiles or threads.
        let sorted = sorter.run(&projected.depths, &projected.chunks);
        done(PassKind::Sort);
        let grid = TileGrid::new(view.camera.size);
        let sample = self.sample.as_deref().filter(|sample| sample.size() == grid.size);
        let (splats, rates) = (&projected.splats, &projected.rates);
        let (RenderStyle { rules, order, .. }, level, omit) =
            (self.style, self.instructions.level, self.omit);
        let features = feature_count(asked);
        work.tile_pairs = lists.run(OrderedSplats { order: sorted, splats, grid }, |lists| {
            done(PassKind::Bin);
            let input = RasterInput { splats, rates, lists, grid, sample, rules, order, omit, level };
            work += raster_pass(features, asked.luminance_rate, input, tiles);
            done(PassKind::Raster);
        });
        let blended = BlendedTiles { tiles, features, grid };
        resolve::resolve_tiles(blended, asked, self.style.background, out);
        let pass = SegmentationPass {
            scene: &self.scene,
            views: &views,
            moment: self.scene.at(view.seconds),
            order: sorted,
            numbers: &projected.numbers,
            chunks: &projected.chunks,
            grid,
            style: self.style,
            omit,
            level,
        };
        pass.add_motion(BlendBuffers { splats: &mut projected.splats, lists, tiles }, want, out);
        done(PassKind::Resolve);
        Ok(work)
    }

    /// Projects the scene for a view, from what is still and from each object.
    fn project(&mut self, views: &[CameraView], want: ChannelSet) -> RenderWork {
        let CameraView { camera, seconds, .. } = views[0];
        let eyes = self.eyes(views);
        let projection = ProjectionInput {
            scene: &self.scene,
            blocks: &self.blocks,
            sh_degree: self.sh_degree,
            style: self.style,
            eyes: &eyes,
            want,
            sample: self.sample.as_deref().filter(|sample| sample.size() == camera.size),
            moment: self.scene.at(seconds),
            level: self.instructions.level,
        };
        let mut work = self.frame.project(&projection);
        work.unseen = work.gaussians - self.promised[ALL_FRAMES] as u64;
        let zero = self.scene.sh_len() - sh::function_count(self.sh_degree);
        work.zero_harmonics = (self.frame.drawn() * zero) as u64;
        work
    }
}

impl CpuRenderer {
    /// Brings Gaussians that change to the time of a view.
    fn advance(&mut self, seconds: f64) {
        let Some(at) = self.scene.at(seconds).filter(|at| self.moment != Some(at.moment)) else { return };
        let rules = self.style.rules;
        self.blocks.par_iter_mut().for_each(|block| block.advance(at, rules));
        self.moment = Some(at.moment);
    }

    fn eyes(&self, views: &[CameraView]) -> Vec<ViewTransform> {
        views.iter().map(|view| ViewTransform::new(view, self.scene.origin, self.style.rules)).collect()
    }

    /// Restricts later frames to the Gaussians with these indices. Blocks are rebuilt in place, so
    /// this takes no more memory than before, plus 4 bytes per Gaussian for the list.
    fn keep(&mut self, numbers: &[u32]) {
        // Freed first, so that the old and the new blocks do not exist at once.
        self.blocks = Vec::new();
        self.blocks = activate::activate_all(&self.scene, self.style.rules, numbers);
        self.moment = None;
        self.promised = [numbers.len(); PROMISES];
    }

    /// Sets the Gaussians of [`ONE_READER`] to these indices, ascending, and keeps them in addition to
    /// those that are kept already.
    fn keep_more(&mut self, numbers: &[u32]) {
        let kept: Vec<u32> =
            self.blocks.iter().flat_map(|block| &block.numbers[..block.len]).copied().collect();
        let all = unseen::merged_indices(&kept, numbers);
        if all.len() > kept.len() {
            let first = self.promised_to(ALL_FRAMES);
            self.keep(&all);
            self.promise(ALL_FRAMES, &first);
        }
        self.promise(ONE_READER, numbers);
    }

    /// Indices of the Gaussians of a promise.
    fn promised_to(&self, promise: usize) -> Vec<u32> {
        let lanes = |block: &GaussianBlock| {
            let has = move |lane: &usize| block.promised[promise] >> lane & 1 == 1;
            (0..block.len).filter(has).map(|lane| block.numbers[lane]).collect::<Vec<u32>>()
        };
        self.blocks.iter().flat_map(lanes).collect()
    }

    /// Marks the kept Gaussians with these indices, ascending, as those of a promise.
    fn promise(&mut self, promise: usize, numbers: &[u32]) {
        let mut rest = numbers;
        for block in &mut self.blocks {
            let mut lanes = 0_u64;
            for (lane, number) in block.numbers[..block.len].iter().enumerate() {
                if let Some(after) = rest.strip_prefix(std::slice::from_ref(number)) {
                    (lanes, rest) = (lanes | 1 << lane, after);
                }
            }
            // All lanes of a short block count as all: the usual case is one comparison.
            let all = lanes.count_ones() as usize == block.len;
            block.promised[promise] = if all { cull::ALL_LANES } else { lanes };
        }
        self.promised[promise] = numbers.len();
    }
}

impl Renderer for CpuRenderer {
    fn fingerprint(&self) -> &str {
        FINGERPRINT
    }

    fn omit(&mut self, omit: OmissionPolicy) {
        if omit == self.omit {
            return;
        }
        self.omit = omit;
        self.sh_degree = match omit {
            OmissionPolicy::Needless => activate::sh_degree(&self.scene),
            OmissionPolicy::Nothing => self.scene.sh_degree,
        };
        // An earlier promise may have left Gaussians out, which a later frame must show.
        if omit == OmissionPolicy::Nothing && self.promised != [self.scene.len(); PROMISES] {
            self.keep(&unseen::all_indices(&self.scene));
        }
    }

    fn keep_to(&mut self, camera: &Camera, poses: &[Se3]) {
        if self.omit == OmissionPolicy::Needless {
            self.keep(&unseen::visible_indices(&self.scene, self.style.rules, camera, poses));
        }
    }

    fn keep_also(&mut self, camera: &Camera, poses: &[Se3]) {
        if self.omit == OmissionPolicy::Needless {
            self.keep_more(&unseen::visible_indices(&self.scene, self.style.rules, camera, poses));
        }
    }

    fn sample(&mut self, sample: Option<Arc<TileSample>>) {
        self.sample = sample;
    }

    fn motion_channels(&self) -> ChannelSet {
        ChannelSet::of_motion(&self.scene)
    }

    fn object_views(&self, view: &CameraView) -> Vec<CameraView> {
        objects::held_object_views(&self.scene, view)
    }

    fn work_within(&self, work: RenderWork) -> RenderWork {
        let unseen = work.gaussians - self.promised[ONE_READER] as u64;
        RenderWork { unseen, ..self.frame.culled(ONE_READER).within(work) }
    }

    fn render(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError> {
        self.render_in_passes(view, want, out, &mut |_| ())
    }
}

/// Number of feature values per splat for these channels. Alpha needs none.
fn feature_count(want: ChannelSet) -> usize {
    3 * usize::from(want.rgb)
        + usize::from(want.luminance)
        + usize::from(want.depth)
        + usize::from(want.doubtful)
}

/// The raster pass for this number of features, with or without rates.
fn raster_pass(features: usize, rate: bool, frame: RasterInput<'_>, out: &mut Vec<f32>) -> RenderWork {
    // One copy per number of features, so that the sums of a pixel can stay in registers.
    macro_rules! with {
        ($($n:literal)+) => {
            match (features, frame.rules == RenderRules::Soft, rate) {
                $(($n, false, false) => raster::raster_tiles::<$n, false, false>(frame, out),
                ($n, true, false) => raster::raster_tiles::<$n, true, false>(frame, out),
                ($n, false, true) => raster::raster_tiles::<$n, false, true>(frame, out),
                ($n, true, true) => raster::raster_tiles::<$n, true, true>(frame, out),)+
                (n, ..) => unreachable!("colour, luminance, depth and doubt make six features, not {n}"),
            }
        };
    }
    with!(0 1 2 3 4 5 6)
}
