//! The GPU back end: the CPU's passes as compute shaders, on Vulkan, Metal or DX12.
//!
//! Centres and rotations are applied with 48 bits and everything else with 32 (`double.wgsl`), so
//! depths and means equal the CPU's almost to the bit; order, extents, skips and stops follow the
//! CPU's rules. Bits differ between devices and from the CPU, because of the rounding of quotients,
//! roots and powers, and because of fused products and sums.
//!
//! A frame is submitted without waiting for counts from the device. If splats or pairs exceed the
//! capacity, the frame reports it when it is read. It is then rendered again with more capacity, or
//! in regions if a larger binding is not possible. Announced views are rendered while earlier views
//! are read.
//!
//! It implements the renderer and the back end of `gs2e-render`, for scenes of `gs2e-scene` and images
//! of `gs2e-image`. From `gs2e-files` it needs the test for the device nodes of a system. Only the
//! program uses it: the other crates receive it as a `Backend` of `gs2e-render`.
//!
//! # Examples
//!
//! ```
//! use gs2e_gpu::{DeviceChoice, FeatureSet, GpuDevice, GpuFeature};
//!
//! let without: FeatureSet = "subgroups".parse()?;
//! assert_eq!(without, FeatureSet::NONE.with(GpuFeature::Subgroups, true));
//! // There may be no GPU.
//! match GpuDevice::open_without(&DeviceChoice::Hardware, without) {
//!     Ok(device) => assert!(!device.features().has(GpuFeature::Subgroups)),
//!     Err(because) => println!("the CPU renders: {because}"),
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod buffers;
mod clock;
mod device;
mod features;
mod frame;
mod gradients;
mod passes;
mod pool;
mod readback;
mod scene;
mod shader;
#[cfg(test)]
mod sums;
mod work;

pub use clock::TimedStage;
pub use device::{DeviceChoice, GpuDevice, ListedGpu, list_gpus};
pub use features::{FeatureSet, GpuFeature};
pub use gradients::GpuGradientRenderer;
pub use pool::GpuPool;
pub use work::{FrameWork, StageWork};

use buffers::{BufferCapacity, FrameBuffers, most_pairs, most_splats};
use clock::DeviceClock;
use glam::DVec3;
use gs2e_image::{Image, Size};
use gs2e_render::backend::Backend;
use gs2e_render::shared::TILE;
use gs2e_render::{ChannelSet, RenderError, RenderStyle, RenderWork, RenderedImages, Renderer};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::flow::flow_rates;
use gs2e_scene::camera::view::CameraView;
use passes::{BindingLayouts, FramePipelines, RegionPasses};
use readback::{Copy, RegionImages, Ring};
use scene::ScenePart;
use shader::{DIGIT_BITS, GRADIENT_ROWS, ImageLayout, SUMS, ShaderVariant, Total, splat_rows};
use std::collections::VecDeque;
use std::time::Duration;

/// A scene on a device.
#[derive(Debug)]
pub struct GpuRenderer {
    device: GpuDevice,
    style: RenderStyle,
    origin: DVec3,
    gaussians: usize,
    sh_degree: u8,
    parts: Vec<ScenePart>,
    layouts: BindingLayouts,
    pipelines: Vec<(ImageLayout, FramePipelines)>,
    buffers: FrameBuffers,
    ring: Ring,
    clock: Option<DeviceClock>,
    times: Option<[Duration; TimedStage::ALL.len()]>,
    work: FrameWork,
    /// The first picture of the scene was looked at.
    is_checked: bool,
    /// Announced views, in order.
    expected: VecDeque<ExpectedView>,
    /// For gradients: the regions of the last view, in the order in which they were rendered.
    traced: Option<Vec<TracedRegion>>,
}

/// A region whose trace is kept.
#[derive(Debug, Clone, Copy)]
struct TracedRegion {
    region: TileRegion,
    splats: u32,
}

/// A view that was announced.
#[derive(Debug)]
struct ExpectedView {
    view: CameraView,
    want: ChannelSet,
    begun: Result<PendingView, RenderError>,
}

/// A view that the device is rendering.
#[derive(Debug)]
struct PendingView {
    view: CameraView,
    want: ChannelSet,
    shots: Vec<GpuShot>,
}

/// One region of a view.
#[derive(Debug)]
struct GpuShot {
    region: TileRegion,
    room: BufferCapacity,
    copy: Copy,
}

/// Initial capacities, before any view is known.
const FIRST_SPLATS: u32 = 1 << 16;
const FIRST_PAIRS: u32 = 1 << 18;

impl GpuRenderer {
    /// Uploads a scene to a device.
    ///
    /// # Errors
    /// The style cannot be rendered, or the device has no memory for the scene.
    pub fn new(device: GpuDevice, scene: &Gaussians, style: RenderStyle) -> Result<Self, RenderError> {
        Self::prepare(device, scene, style, None)
    }

    fn prepare(
        device: GpuDevice,
        scene: &Gaussians,
        style: RenderStyle,
        traced: Option<Vec<TracedRegion>>,
    ) -> Result<Self, RenderError> {
        gs2e_render::check_style(&style)?;
        if !Backend::gpu_supports_order(style.order) {
            let because = "this gs2e renders blended orders only on the CPU: --backend cpu or reference";
            return Err(RenderError::Style(because.to_owned()));
        }
        if scene.object_count() > 0 {
            let because = "this gs2e renders moving objects only on the CPU: --backend cpu or reference";
            return Err(RenderError::Scene(because.to_owned()));
        }
        if scene.dynamics().is_some() {
            let because =
                "this gs2e renders scenes that change with time only on the CPU: --backend cpu or reference";
            return Err(RenderError::Scene(because.to_owned()));
        }
        let parts = scene::upload_scene(scene, scene.sh_degree, traced.is_some(), &device)?;
        let layouts = BindingLayouts::new(&device);
        let splat_rows = splat_rows(false);
        let [splats, pairs] = most_entries(device.limit, splat_rows, traced.is_some());
        let room = BufferCapacity {
            splats: FIRST_SPLATS.min(splats),
            pairs: FIRST_PAIRS.min(pairs),
            splat_rows,
            traced: traced.is_some(),
            ..BufferCapacity::default()
        };
        let buffers = FrameBuffers::new(&device, &layouts, &parts, room)?;
        let clock = DeviceClock::new(&device);
        Ok(Self {
            device,
            style,
            origin: scene.origin,
            gaussians: scene.len(),
            sh_degree: scene.sh_degree,
            parts,
            layouts,
            pipelines: Vec::new(),
            buffers,
            ring: Ring::default(),
            clock,
            times: None,
            work: FrameWork::default(),
            is_checked: false,
            expected: VecDeque::new(),
            traced,
        })
    }

    /// Durations of [`TimedStage::ALL`] for the last frame, regions that were rendered again included.
    /// `None` before the first frame, and for a device without a clock.
    #[must_use]
    pub fn times(&self) -> Option<[Duration; TimedStage::ALL.len()]> {
        self.times
    }

    /// The work of the last frame.
    #[must_use]
    pub fn frame_work(&self) -> FrameWork {
        self.work
    }

    /// Submits a view.
    fn begin(&mut self, view: &CameraView, want: ChannelSet) -> Result<PendingView, RenderError> {
        gs2e_render::check_view(view)?;
        if let Some(traced) = &mut self.traced {
            traced.clear();
        }
        let mut pending = PendingView { view: *view, want, shots: Vec::new() };
        self.shoot(&mut pending, TileRegion::whole_image(view.camera.size))?;
        Ok(pending)
    }

    /// Waits for a view, and returns its images.
    fn finish(
        &mut self,
        mut pending: PendingView,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError> {
        let PendingView { view, want, .. } = pending;
        let (size, layout) = (view.camera.size, self.layout(want));
        let mut work: Option<RenderWork> = None;
        let mut checked = Ok(());
        (self.times, self.work) = (None, FrameWork::default());
        // The capacities of the submission, not those of now: an earlier region may have raised
        // them.
        while let Some(GpuShot { region, room, copy }) = pending.shots.pop() {
            let floats = region.pixels(size) as u64 * u64::from(layout.floats);
            let gaussians = self.gaussians;
            let clock = self.clock.as_ref();
            let is_checked = self.is_checked;
            let (totals, times, found) =
                self.ring.read(&self.device, copy, floats, |totals, stamps, images| {
                    let fits = totals.of_count(Total::Splats) <= room.splats
                        && totals.of_count(Total::Pairs) <= room.pairs;
                    if fits {
                        let images = RegionImages { bytes: images, layout, region, size };
                        images.place(out);
                        if !is_checked && !images.is_finite() {
                            checked = Err(());
                        }
                    }
                    let times = clock.map(|clock| clock.times(stamps));
                    (*totals, times, fits.then(|| totals.work(gaussians)))
                })?;
            self.times = join_times(self.times, times);
            match found {
                Some(done) => {
                    self.work.add(&self.region_work(region, size, layout, &totals));
                    work = Some(work.map_or(done, |sum| join_work(sum, done)));
                    if let Some(traced) = &mut self.traced {
                        traced.push(TracedRegion { region, splats: totals.of_count(Total::Splats) });
                    }
                }
                None => self.resubmit(&mut pending, region, &totals)?,
            }
        }
        checked.map_err(|()| self.device.not_finite())?;
        self.is_checked = true;
        out.flow = if want.flow { out.depth.as_ref().map(|depth| flow_rates(depth, &view)) } else { None };
        out.depth = out.depth.take().filter(|_| want.depth);
        // Nothing moves in the scenes of this back end.
        out.segmentation = want.segmentation.then(|| Image::filled(view.camera.size, 0));
        out.drift = want.drift.then(|| Image::filled(view.camera.size, [0.0; 3]));
        Ok(work.unwrap_or_default())
    }

    /// Submits a region, or its halves if its images exceed a binding.
    fn shoot(&mut self, pending: &mut PendingView, region: TileRegion) -> Result<(), RenderError> {
        let PendingView { view, want, .. } = *pending;
        let layout = self.layout(want);
        let pixels = region.pixels(view.camera.size) as u64;
        let needed = buffers::room_of(region, pixels, layout.floats_on_device());
        // The lists of the tiles, 8 bytes each, must fit one binding as well.
        if readback::transfer_bytes(needed.floats).max(8 * u64::from(needed.tiles)) > self.device.limit {
            let [one, other] = region.halves().ok_or_else(|| self.device.too_small("images"))?;
            // `finish` takes regions from the end, so the first half is pushed last.
            self.shoot(pending, other)?;
            return self.shoot(pending, one);
        }
        let splat_rows = splat_rows(want.luminance_rate);
        self.make_room(BufferCapacity { splat_rows, ..needed })?;
        let at = self.compiled(layout)?;
        let room = self.buffers.room;
        let style = self.device.spoilt_style(self.style);
        let bytes = frame::frame_bytes(&view, self.origin, &style, region, [room.splats, room.pairs]);
        // The queue keeps the order of writes and submissions, so frames under way see their own
        // values.
        self.device.queue.write_buffer(&self.buffers.frame, 0, &bytes);
        let (pipelines, buffers) = (&self.pipelines[at].1, &self.buffers);
        let clock = self.clock.as_ref();
        let passes = RegionPasses { pipelines, buffers, parts: &self.parts, region, clock };
        let copy = self.ring.submit(&self.device, &passes, pixels * u64::from(layout.floats))?;
        pending.shots.push(GpuShot { region, room, copy });
        Ok(())
    }

    /// The work of a region.
    fn region_work(
        &self,
        region: TileRegion,
        size: Size,
        layout: ImageLayout,
        totals: &readback::Totals,
    ) -> FrameWork {
        let count = |total| u64::from(totals.of_count(total));
        let work = totals.work(self.gaussians);
        work::RegionCounts {
            parts: self.parts.len() as u64,
            gaussians: self.gaussians as u64,
            behind: work.behind,
            splats: count(Total::Splats),
            pairs: count(Total::Pairs),
            loaded: count(Total::Loaded),
            blended: work.blended,
            tiles: region.tiles().into_iter().map(u64::from).product(),
            pixels: region.pixels(size) as u64,
            digits: u64::from(region.tile_digits()),
            layout,
            sh_degree: self.sh_degree,
        }
        .work()
    }

    /// Submits a region again that exceeded the capacity: with more, or in halves.
    fn resubmit(
        &mut self,
        pending: &mut PendingView,
        region: TileRegion,
        totals: &readback::Totals,
    ) -> Result<(), RenderError> {
        let (splats, pairs) = (totals.of_count(Total::Splats), totals.of_count(Total::Pairs));
        let splat_rows = self.buffers.room.splat_rows;
        let most = most_entries(self.device.limit, splat_rows, self.traced.is_some());
        if splats > most[0] || pairs > most[1] {
            let what = if splats > most[0] { "splats" } else { "pairs" };
            let halves = region.halves().ok_or_else(|| self.device.too_small(what))?;
            return halves.into_iter().try_for_each(|half| self.shoot(pending, half));
        }
        // A margin, so that the next view does not exceed it again.
        let more = |count: u32, most: u32| (count + count / 4).min(most);
        let room = BufferCapacity {
            splats: more(splats, most[0]),
            pairs: more(pairs, most[1]),
            ..BufferCapacity::default()
        };
        self.make_room(room)?;
        self.shoot(pending, region)
    }

    /// Makes sure that the capacities suffice. Frames under way keep the buffers with which they
    /// were submitted.
    fn make_room(&mut self, needed: BufferCapacity) -> Result<(), RenderError> {
        let mut room = self.buffers.room.or(needed);
        // Larger splats: fewer may fit a binding.
        room.splats = room.splats.min(most_entries(self.device.limit, room.splat_rows, room.traced)[0]);
        if room != self.buffers.room {
            self.buffers = FrameBuffers::new(&self.device, &self.layouts, &self.parts, room)?;
        }
        Ok(())
    }

    /// The layout of these channels, with a trace if gradients are wanted.
    fn layout(&self, want: ChannelSet) -> ImageLayout {
        let layout = ImageLayout::new(want);
        if self.traced.is_some() { layout.with_trace() } else { layout }
    }

    /// Index of the pipelines for these channels.
    fn compiled(&mut self, layout: ImageLayout) -> Result<usize, RenderError> {
        if let Some(at) = self.pipelines.iter().position(|(l, _)| *l == layout) {
            return Ok(at);
        }
        let subgroups = self.device.features().has(GpuFeature::Subgroups);
        let variant = ShaderVariant { style: self.style, sh_degree: self.sh_degree, layout, subgroups };
        self.pipelines.push((layout, FramePipelines::new(&self.device, &self.layouts, &variant)));
        // Errors of compilation arrive through the device's callback.
        self.device.check()?;
        Ok(self.pipelines.len() - 1)
    }
}

impl Renderer for GpuRenderer {
    fn fingerprint(&self) -> &str {
        self.device.fingerprint()
    }

    fn expect(&mut self, view: &CameraView, want: ChannelSet) {
        let begun = self.begin(view, want);
        self.expected.push_back(ExpectedView { view: *view, want, begun });
    }

    fn render(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError> {
        let expected = self.expected.pop_front().filter(|e| e.view == *view && e.want == want);
        let pending = match expected {
            Some(expected) => expected.begun?,
            None => {
                // The caller departed from the announced order, so the remaining announcements are
                // dropped.
                self.expected.clear();
                self.begin(view, want)?
            }
        };
        self.finish(pending, out)
    }
}

/// Largest numbers of splats and of pairs that the device can bind.
fn most_entries(limit: u64, splat_rows: u32, traced: bool) -> [u32; 2] {
    // A traced pair has ten sums, and a traced splat has gradients of its own rows.
    let (rows, pair) =
        if traced { (splat_rows.max(GRADIENT_ROWS), 4 * u64::from(SUMS)) } else { (splat_rows, 8) };
    [most_splats(limit, rows), most_pairs(limit, pair)]
}

/// Adds the durations of two regions of a view.
fn join_times(
    a: Option<[Duration; TimedStage::ALL.len()]>,
    b: Option<[Duration; TimedStage::ALL.len()]>,
) -> Option<[Duration; TimedStage::ALL.len()]> {
    let (Some(a), Some(b)) = (a, b) else { return a.or(b) };
    Some(std::array::from_fn(|k| a[k] + b[k]))
}

/// Adds the work of two regions of a view. Both count what was left out of the whole image.
fn join_work(a: RenderWork, b: RenderWork) -> RenderWork {
    RenderWork {
        tile_pairs: a.tile_pairs + b.tile_pairs,
        blended: a.blended + b.blended,
        stopped: a.stopped + b.stopped,
        ..a
    }
}

/// A rectangle of tiles: first and end, columns and rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct TileRegion {
    first: [u32; 2],
    end: [u32; 2],
}

#[expect(clippy::cast_possible_truncation, reason = "a tile's edge is small")]
const EDGE: u32 = TILE as u32;

impl TileRegion {
    /// All tiles of an image.
    fn whole_image(size: Size) -> Self {
        Self { first: [0; 2], end: [size.width.div_ceil(EDGE), size.height.div_ceil(EDGE)] }
    }

    /// Columns and rows of tiles.
    fn tiles(self) -> [u32; 2] {
        [0, 1].map(|k| self.end[k] - self.first[k])
    }

    /// Number of digits of a tile's index in the sort, including a larger value for the empty pair.
    fn tile_digits(self) -> u32 {
        let [columns, rows] = self.tiles();
        // Of the empty pair's ones, only these digits are sorted. Their value is at least
        // `columns * rows`, which no tile has.
        (u32::BITS - (columns * rows).leading_zeros()).div_ceil(DIGIT_BITS)
    }

    /// The first pixel: column and row.
    fn origin(self) -> [usize; 2] {
        self.first.map(|tile| (tile * EDGE) as usize)
    }

    /// Columns and rows of pixels, clipped to an image of this size.
    fn extent(self, size: Size) -> [usize; 2] {
        let edges = [size.width, size.height];
        [0, 1].map(|k| ((self.end[k] * EDGE).min(edges[k]) - self.first[k] * EDGE) as usize)
    }

    /// Number of pixels, clipped to an image of this size.
    fn pixels(self, size: Size) -> usize {
        let [columns, rows] = self.extent(size);
        columns * rows
    }

    /// Two halves, cut across the longer edge; `None` for a single tile.
    fn halves(self) -> Option<[Self; 2]> {
        let [columns, rows] = self.tiles();
        let k = usize::from(rows >= columns);
        let middle = u32::midpoint(self.first[k], self.end[k]);
        let (mut one, mut other) = (self, self);
        (one.end[k], other.first[k]) = (middle, middle);
        (columns.max(rows) > 1).then_some([one, other])
    }
}
