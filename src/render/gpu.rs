//! The GPU back end: the CPU's passes as compute shaders, through Vulkan, Metal or DX12.
//!
//! Centres and rotations are applied in 48 bits and all else in 32 (`double.wgsl`), so that depths and means are the CPU's
//! almost to the bit; order, extents, skips and stops follow its rules. Bits differ between devices, and from the CPU's by
//! the rounding of quotients, roots and powers, and where a product is fused with a sum.
//!
//! A frame is submitted without waiting for counts from the device: where splats or pairs had no room, the frame says so
//! when it is read, and is made again with more room, or in regions where no more can be bound. Views that are expected are
//! under way while those before them are read.

mod buffers;
mod clock;
mod device;
mod frame;
mod passes;
mod readback;
mod scene;
mod shader;

pub use clock::Stage;
pub use device::{Choice, Device, GpuError};

use super::shared::TILE;
use super::{Channels, Layering, RenderError, Rendered, Renderer, Style, View, Work, flow};
use crate::image::Size;
use crate::scene::Gaussians;
use buffers::{Buffers, Room, most_pairs, most_splats};
use clock::Clock;
use glam::DVec3;
use passes::{Layouts, Passes, Pipelines};
use readback::{Copy, Ring};
use scene::Part;
use shader::{Layout, Total, Variant, splat_rows};
use std::collections::VecDeque;
use std::time::Duration;

/// A scene on a device.
#[derive(Debug)]
pub struct Gpu {
    device: Device,
    style: Style,
    origin: DVec3,
    gaussians: usize,
    sh_degree: u8,
    parts: Vec<Part>,
    layouts: Layouts,
    pipelines: Vec<(Layout, Pipelines)>,
    buffers: Buffers,
    ring: Ring,
    clock: Option<Clock>,
    times: Option<[Duration; Stage::ALL.len()]>,
    /// Views that are going to be rendered, in that order.
    expected: VecDeque<Expected>,
}

/// A view that is going to be rendered.
#[derive(Debug)]
struct Expected {
    view: View,
    want: Channels,
    begun: Result<Pending, RenderError>,
}

/// A view that the device is at work on.
#[derive(Debug)]
struct Pending {
    view: View,
    want: Channels,
    shots: Vec<Shot>,
}

/// One region of a view.
#[derive(Debug)]
struct Shot {
    region: Region,
    room: Room,
    copy: Copy,
}

/// Room that a renderer begins with, before it knows its views.
const FIRST_SPLATS: u32 = 1 << 16;
const FIRST_PAIRS: u32 = 1 << 18;

/// Memory of the machine, not of the GPU, that rendering a scene of this many bytes at this size takes, bytes: the scene,
/// and its activated form while it is brought there; the images of a few frames on their way back.
#[must_use]
pub fn memory(scene_bytes: u64, size: Size) -> u64 {
    const BYTES_A_PIXEL: u64 = 96;
    2 * scene_bytes + BYTES_A_PIXEL * u64::from(size.width) * u64::from(size.height)
}

/// Whether layers can be laid in this order.
#[must_use]
pub fn blends(order: Layering) -> bool {
    order == Layering::Depth
}

impl Gpu {
    /// Brings a scene to a device.
    ///
    /// # Errors
    /// When the style cannot be rendered, or the device has no room for the scene.
    pub fn new(device: Device, scene: &Gaussians, style: Style) -> Result<Self, RenderError> {
        super::check_style(&style)?;
        if !blends(style.order) {
            let because = "this gs2e blends orders on the CPU alone: --backend cpu or reference";
            return Err(RenderError::Style(because.to_owned()));
        }
        let parts = scene::upload(scene, &device)?;
        let layouts = Layouts::new(&device);
        let splat_rows = splat_rows(false);
        let room = Room {
            splats: FIRST_SPLATS.min(most_splats(device.limit, splat_rows)),
            pairs: FIRST_PAIRS.min(most_pairs(device.limit)),
            splat_rows,
            ..Room::default()
        };
        let buffers = Buffers::new(&device, &layouts, &parts, room)?;
        let clock = Clock::new(&device);
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
            expected: VecDeque::new(),
        })
    }

    /// How long the device was at each of [`Stage::ALL`] of the last frame, or of its last region; `None` before a frame, and
    /// of a device without a clock.
    #[must_use]
    pub fn times(&self) -> Option<[Duration; Stage::ALL.len()]> {
        self.times
    }

    /// Sets the device to work on a view.
    fn begin(&mut self, view: &View, want: Channels) -> Result<Pending, RenderError> {
        super::check_view(view)?;
        let mut shots = Vec::new();
        self.shoot(view, want, Region::whole(view.camera.size), &mut shots)?;
        Ok(Pending { view: *view, want, shots })
    }

    /// Waits for a view and takes its images.
    fn finish(&mut self, pending: Pending, out: &mut Rendered) -> Result<Work, RenderError> {
        let Pending { view, want, mut shots } = pending;
        let (size, layout) = (view.camera.size, Layout::new(want));
        let mut work: Option<Work> = None;
        while let Some(Shot { region, room, copy }) = shots.pop() {
            let floats = region.pixels(size) as u64 * u64::from(layout.floats);
            let gaussians = self.gaussians;
            let clock = self.clock.as_ref();
            let (totals, times, found) =
                self.ring.read(&self.device, copy, floats, |totals, stamps, images| {
                    let fits = totals.of_count(Total::Splats) <= room.splats
                        && totals.of_count(Total::Pairs) <= room.pairs;
                    if fits {
                        readback::place(images, region, size, (want, layout), out);
                    }
                    let times = clock.map(|clock| clock.times(stamps));
                    (*totals, times, fits.then(|| totals.work(gaussians)))
                })?;
            self.times = times;
            match found {
                Some(done) => work = Some(work.map_or(done, |sum| joined(sum, done))),
                None => self.again(&view, want, (region, totals), &mut shots)?,
            }
        }
        out.flow = if want.flow { out.depth.as_ref().map(|depth| flow::rates(depth, &view)) } else { None };
        out.depth = out.depth.take().filter(|_| want.depth);
        Ok(work.unwrap_or_default())
    }

    /// Submits a region, or its halves where its images are larger than a binding.
    fn shoot(
        &mut self,
        view: &View,
        want: Channels,
        region: Region,
        shots: &mut Vec<Shot>,
    ) -> Result<(), RenderError> {
        let layout = Layout::new(want);
        let pixels = region.pixels(view.camera.size) as u64;
        let needed = buffers::room_of(region, pixels, layout.floats);
        if readback::bytes(needed.floats).max(8 * u64::from(needed.tiles)) > self.device.limit {
            let [one, other] = region.halves().ok_or_else(|| self.device.too_small("images"))?;
            self.shoot(view, want, other, shots)?;
            return self.shoot(view, want, one, shots);
        }
        let splat_rows = splat_rows(want.luminance_rate);
        self.make_room(Room { splat_rows, ..needed })?;
        let at = self.compiled(layout)?;
        let room = self.buffers.room;
        let bytes = frame::bytes(view, self.origin, &self.style, region, [room.splats, room.pairs]);
        self.device.queue.write_buffer(&self.buffers.frame, 0, &bytes);
        let mut encoder =
            self.device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let (pipelines, buffers) = (&self.pipelines[at].1, &self.buffers);
        let clock = self.clock.as_ref();
        Passes { pipelines, buffers, parts: &self.parts, region, clock }.record(&mut encoder);
        let copy = self.ring.submit(&self.device, encoder, (buffers, needed.floats), clock)?;
        shots.push(Shot { region, room, copy });
        Ok(())
    }

    /// Submits a region again that there was no room for: with more, or in halves.
    fn again(
        &mut self,
        view: &View,
        want: Channels,
        (region, totals): (Region, readback::Totals),
        shots: &mut Vec<Shot>,
    ) -> Result<(), RenderError> {
        let (splats, pairs) = (totals.of_count(Total::Splats), totals.of_count(Total::Pairs));
        let splat_rows = self.buffers.room.splat_rows;
        let most = [most_splats(self.device.limit, splat_rows), most_pairs(self.device.limit)];
        if splats > most[0] || pairs > most[1] {
            let what = if splats > most[0] { "splats" } else { "pairs" };
            let halves = region.halves().ok_or_else(|| self.device.too_small(what))?;
            return halves.into_iter().try_for_each(|half| self.shoot(view, want, half, shots));
        }
        // Some more, so that the next view does not ask again.
        let more = |count: u32, most: u32| (count + count / 4).min(most);
        let room = Room { splats: more(splats, most[0]), pairs: more(pairs, most[1]), ..Room::default() };
        self.make_room(room)?;
        self.shoot(view, want, region, shots)
    }

    /// Sees to it that there is room. Frames in flight keep the memory that they were submitted with.
    fn make_room(&mut self, needed: Room) -> Result<(), RenderError> {
        let mut room = self.buffers.room.or(needed);
        // Larger splats: fewer may fit a binding.
        room.splats = room.splats.min(most_splats(self.device.limit, room.splat_rows));
        if room != self.buffers.room {
            self.buffers = Buffers::new(&self.device, &self.layouts, &self.parts, room)?;
        }
        Ok(())
    }

    /// Where the pipelines for these images are.
    fn compiled(&mut self, layout: Layout) -> Result<usize, RenderError> {
        if let Some(at) = self.pipelines.iter().position(|(l, _)| *l == layout) {
            return Ok(at);
        }
        let variant = Variant { style: self.style, sh_degree: self.sh_degree, layout };
        self.pipelines.push((layout, Pipelines::new(&self.device, &self.layouts, &variant)));
        self.device.check()?;
        Ok(self.pipelines.len() - 1)
    }
}

impl Renderer for Gpu {
    fn fingerprint(&self) -> &str {
        self.device.fingerprint()
    }

    fn expect(&mut self, view: &View, want: Channels) {
        let begun = self.begin(view, want);
        self.expected.push_back(Expected { view: *view, want, begun });
    }

    fn render(&mut self, view: &View, want: Channels, out: &mut Rendered) -> Result<Work, RenderError> {
        let expected = self.expected.pop_front().filter(|e| e.view == *view && e.want == want);
        let pending = match expected {
            Some(expected) => expected.begun?,
            None => {
                self.expected.clear();
                self.begin(view, want)?
            }
        };
        self.finish(pending, out)
    }
}

/// The work of two regions of a view: what was left out of the image is the same in both.
fn joined(a: Work, b: Work) -> Work {
    Work {
        tile_pairs: a.tile_pairs + b.tile_pairs,
        blended: a.blended + b.blended,
        stopped: a.stopped + b.stopped,
        ..a
    }
}

/// Tiles of an image: first and end, columns and rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Region {
    first: [u32; 2],
    end: [u32; 2],
}

#[expect(clippy::cast_possible_truncation, reason = "a tile's edge is small")]
const EDGE: u32 = TILE as u32;

impl Region {
    /// All tiles of an image.
    fn whole(size: Size) -> Self {
        Self { first: [0; 2], end: [size.width.div_ceil(EDGE), size.height.div_ceil(EDGE)] }
    }

    /// Columns and rows of tiles.
    fn tiles(self) -> [u32; 2] {
        [0, 1].map(|k| self.end[k] - self.first[k])
    }

    /// The first pixel: column and row.
    fn origin(self) -> [usize; 2] {
        self.first.map(|tile| (tile * EDGE) as usize)
    }

    /// Columns and rows of pixels within an image of this size.
    fn extent(self, size: Size) -> [usize; 2] {
        let edges = [size.width, size.height];
        [0, 1].map(|k| ((self.end[k] * EDGE).min(edges[k]) - self.first[k] * EDGE) as usize)
    }

    /// Pixels within an image of this size.
    fn pixels(self, size: Size) -> usize {
        let [columns, rows] = self.extent(size);
        columns * rows
    }

    /// Two parts, cut across the longer edge; a single tile has none.
    fn halves(self) -> Option<[Self; 2]> {
        let [columns, rows] = self.tiles();
        let k = usize::from(rows >= columns);
        let middle = u32::midpoint(self.first[k], self.end[k]);
        let (mut one, mut other) = (self, self);
        (one.end[k], other.first[k]) = (middle, middle);
        (columns.max(rows) > 1).then_some([one, other])
    }
}
