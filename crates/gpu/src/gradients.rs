//! Gradients on the GPU: [`GradientRenderer`] of the CPU as compute shaders.
//!
//! The forward passes leave a trace per pixel on the device: the light that is left, and the place of
//! the last blended layer. Three passes go backwards:
//!
//! ```text
//! backward  per tile      gradient by pixel -> ten sums per pair of tile and splat
//! gather    per splat     the sums over its tiles, in order of the tiles
//! chain     per splat     projection, covariance, opacity and harmonics backwards
//! ```
//!
//! WGSL has no atomic float, and the order of atomic sums would change from run to run. Each pair has a
//! slot of its own instead (`slots.wgsl`), so no two threads write to one place, and every sum has one
//! order: two runs on one device give the same bits. They are not those of the CPU, for the reasons
//! that images are not.
//!
//! [`GradientRenderer`]: gs2e_render::cpu::backward::GradientRenderer

mod buffers;

use super::device::GpuDevice;
use super::features::GpuFeature;
use super::passes::ShaderCompiler;
use super::readback::Copy;
use super::shader::{Dispatch, GRADIENT_ROWS, ImageLayout, ShaderKind, ShaderVariant};
use super::{GpuRenderer, PendingView, TileRegion, TracedRegion, scene};
use buffers::GradientBuffers;
use gs2e_image::{Image, Size};
use gs2e_render::cpu::backward::{GaussianGradient, ViewGradients, refuse_without_gradients};
use gs2e_render::differentiable::DifferentiableRenderer;
use gs2e_render::{ChannelSet, RenderError, RenderStyle, RenderWork, RenderedImages};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;
use std::ops::Range;
use wgpu::{CommandEncoder, CommandEncoderDescriptor, ComputePassDescriptor, ComputePipeline};

/// Colour is the only channel with gradients.
const COLOUR: ChannelSet = ChannelSet { rgb: true, ..ChannelSet::NONE };

/// Size of the gradients of a splat, bytes.
const GRADIENT: usize = 16 * GRADIENT_ROWS as usize;

/// A scene on a device that is rendered with gradients and changed between renderings.
#[derive(Debug)]
pub struct GpuGradientRenderer {
    scene: Gaussians,
    sh_degree: u8,
    renderer: GpuRenderer,
    pipelines: BackwardPipelines,
    buffers: Option<GradientBuffers>,
    images: RenderedImages,
    /// The view whose trace is kept.
    traced_view: Option<CameraView>,
}

/// The backward passes.
#[derive(Debug)]
struct BackwardPipelines {
    backward: ComputePipeline,
    gather: ComputePipeline,
    chain: ComputePipeline,
}

impl GpuGradientRenderer {
    /// Uploads a scene to a device.
    ///
    /// # Errors
    /// The scene has more than `MAX_GAUSSIANS`, the style has no gradients, or the device has no
    /// memory for the scene.
    pub fn new(device: GpuDevice, scene: Gaussians, style: RenderStyle) -> Result<Self, RenderError> {
        refuse_without_gradients(&scene, style)?;
        let renderer = GpuRenderer::prepare(device, &scene, style, Some(Vec::new()))?;
        let layout = ImageLayout::new(COLOUR).with_trace();
        let subgroups = renderer.device.features().has(GpuFeature::Subgroups);
        let variant = ShaderVariant { style, sh_degree: scene.sh_degree, layout, subgroups };
        let entry = |shader: ShaderKind| {
            ShaderCompiler::new(&renderer.device, &renderer.layouts, shader, &variant).entry(shader.name())
        };
        let [backward, gather, chain] =
            [ShaderKind::Backward, ShaderKind::Gather, ShaderKind::Chain].map(entry);
        // Errors of compilation arrive through the device's callback.
        renderer.device.check()?;
        Ok(Self {
            sh_degree: scene.sh_degree,
            scene,
            renderer,
            pipelines: BackwardPipelines { backward, gather, chain },
            buffers: None,
            images: RenderedImages::default(),
            traced_view: None,
        })
    }

    /// The highest degree of harmonics that is evaluated.
    #[must_use]
    pub fn degree(&self) -> u8 {
        self.sh_degree
    }

    /// Renders one region of a view again.
    fn retrace(&mut self, view: &CameraView, region: TileRegion) -> Result<(), RenderError> {
        let renderer = &mut self.renderer;
        let mut pending = PendingView { view: *view, want: COLOUR, shots: Vec::new() };
        renderer.shoot(&mut pending, region)?;
        renderer.traced = Some(Vec::new());
        renderer.finish(pending, &mut self.images)?;
        // The region was rendered with these capacities or less before.
        match renderer.traced.as_deref() {
            Some([traced]) if traced.region == region => Ok(()),
            _ => Err(renderer.device.too_small("gradients").into()),
        }
    }

    /// Makes sure that the buffers fit those of the frame.
    fn make_room(&mut self) -> Result<(), RenderError> {
        if self.buffers.as_ref().is_none_or(|buffers| buffers.room != self.renderer.buffers.room) {
            // Freed first: sums are the largest of all buffers.
            self.buffers = None;
            self.buffers = Some(GradientBuffers::new(&self.renderer)?);
        }
        Ok(())
    }

    /// Uploads the gradient and the score of each pixel of a region.
    fn give_pixels(&self, by_pixel: &[[f32; 3]], score: &[f32], region: TileRegion, size: Size) {
        let Some(buffers) = &self.buffers else { return };
        let ([x, y], [columns, rows]) = (region.origin(), region.extent(size));
        let mut bytes = Vec::with_capacity(16 * columns * rows);
        for row in y..y + rows {
            let row = row * size.width as usize + x..row * size.width as usize + x + columns;
            for ([r, g, b], score) in by_pixel[row.clone()].iter().zip(&score[row]) {
                [*r, *g, *b, *score].into_iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            }
        }
        self.renderer.device.queue.write_buffer(&buffers.by_pixel, 0, &bytes);
    }

    /// Runs the backward passes for the region that the device rendered last, and adds the gradients
    /// of its splats.
    fn backward(
        &mut self,
        region: TileRegion,
        splats: u32,
        out: &mut ViewGradients,
    ) -> Result<(), RenderError> {
        let Some(buffers) = &mut self.buffers else { return Ok(()) };
        let device = &self.renderer.device;
        let size = (GRADIENT * splats as usize) as u64;
        let staging = buffers.staging(device, size)?;
        let mut encoder = device.device.create_command_encoder(&CommandEncoderDescriptor::default());
        record(&mut encoder, &self.renderer, &self.pipelines, buffers, region);
        encoder.copy_buffer_to_buffer(&buffers.gradients, 0, &staging, 0, size);
        let copy = Copy::submit(device, encoder, staging, size);
        let (found, staging) = copy.read(device, size, read_gradients)?;
        buffers.staging = Some(staging);
        *out = join_gradients(std::mem::take(out), found);
        Ok(())
    }

    fn upload(&self, range: Range<usize>) {
        let GpuRenderer { parts, device, .. } = &self.renderer;
        parts.iter().for_each(|part| part.write(&self.scene, self.sh_degree, range.clone(), device));
    }
}

impl DifferentiableRenderer for GpuGradientRenderer {
    fn scene(&self) -> &Gaussians {
        &self.scene
    }

    fn into_scene(self: Box<Self>) -> Gaussians {
        self.scene
    }

    fn set_degree(&mut self, degree: u8) {
        let degree = degree.min(self.scene.sh_degree);
        // The device has the harmonics of the set degree only, so another one is a new upload.
        if degree != self.sh_degree {
            (self.sh_degree, self.traced_view) = (degree, None);
            self.upload(0..self.scene.len());
        }
    }

    fn change(&mut self, numbers: &[u32], change: &mut dyn FnMut(&mut Gaussians)) {
        let count = self.scene.len();
        change(&mut self.scene);
        assert_eq!(self.scene.len(), count, "the number of Gaussians stays");
        changed_spans(numbers).into_iter().for_each(|span| self.upload(span));
        self.traced_view = None;
    }

    fn rebuild(&mut self, change: &mut dyn FnMut(&mut Gaussians)) -> Result<(), RenderError> {
        let degree = self.scene.sh_degree;
        change(&mut self.scene);
        assert_eq!(self.scene.sh_degree, degree, "the degree of harmonics stays");
        let renderer = &mut self.renderer;
        // Bindings refer to the old scene. They go first, so that the old and the new one do not exist
        // at once.
        (self.traced_view, self.buffers) = (None, None);
        renderer.parts = Vec::new();
        renderer.parts = scene::upload_scene(&self.scene, self.sh_degree, true, &renderer.device)?;
        (renderer.gaussians, renderer.origin) = (self.scene.len(), self.scene.origin);
        let (parts, room) = (&renderer.parts, renderer.buffers.room);
        renderer.buffers = super::FrameBuffers::new(&renderer.device, &renderer.layouts, parts, room)?;
        Ok(())
    }

    fn render(&mut self, view: &CameraView) -> Result<(&Image<[f32; 3]>, RenderWork), RenderError> {
        // First: a rendering that fails leaves no whole trace.
        self.traced_view = None;
        let pending = self.renderer.begin(view, COLOUR)?;
        let work = self.renderer.finish(pending, &mut self.images)?;
        self.traced_view = Some(*view);
        Ok((self.images.rgb.as_ref().expect("colour was asked for"), work))
    }

    fn gradients(
        &mut self,
        by_pixel: &[[f32; 3]],
        score: &[f32],
        out: &mut ViewGradients,
    ) -> Result<(), RenderError> {
        let view = self.traced_view.expect("a view was rendered");
        let size = view.camera.size;
        assert_eq!((by_pixel.len(), score.len()), (size.pixels(), size.pixels()), "one value per pixel");
        out.numbers.clear();
        out.gradients.clear();
        let regions = self.renderer.traced.clone().unwrap_or_default();
        for &TracedRegion { region, splats } in &regions {
            // The buffers hold the trace of one region.
            if regions.len() > 1 {
                self.retrace(&view, region)?;
            }
            if splats > 0 {
                self.make_room()?;
                self.give_pixels(by_pixel, score, region, size);
                self.backward(region, splats, out)?;
            }
        }
        self.renderer.traced = Some(regions);
        Ok(())
    }
}

/// Records the backward passes of a region.
fn record(
    encoder: &mut CommandEncoder,
    renderer: &GpuRenderer,
    pipelines: &BackwardPipelines,
    buffers: &GradientBuffers,
    region: TileRegion,
) {
    // Tiles do not visit the slots behind their last layer.
    encoder.clear_buffer(&buffers.moments, 0, None);
    let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
    pass.set_bind_group(0, &renderer.buffers.bound.frame, &[]);
    pass.set_pipeline(&pipelines.backward);
    // The pairs lie where their sort left them.
    pass.set_bind_group(1, &buffers.backward[(region.tile_digits() % 2) as usize], &[]);
    let [columns, rows] = region.tiles();
    pass.dispatch_workgroups(columns, rows, 1);
    let sizes = &renderer.buffers.groups;
    pass.set_pipeline(&pipelines.gather);
    pass.set_bind_group(1, &buffers.gather, &[]);
    pass.dispatch_workgroups_indirect(sizes, Dispatch::Splats.offset());
    pass.set_pipeline(&pipelines.chain);
    for part in &buffers.chain {
        pass.set_bind_group(1, part, &[]);
        pass.dispatch_workgroups_indirect(sizes, Dispatch::Splats.offset());
    }
}

/// Runs of neighbouring Gaussians that hold all of these. A gap of some unchanged ones costs less than
/// another transfer.
fn changed_spans(numbers: &[u32]) -> Vec<Range<usize>> {
    const GAP: usize = 256;
    let mut spans: Vec<Range<usize>> = Vec::new();
    for number in numbers.iter().map(|number| *number as usize) {
        match spans.last_mut() {
            Some(span) if number <= span.end + GAP => span.end = number + 1,
            _ => spans.push(number..number + 1),
        }
    }
    spans
}

/// The gradients as `chain.wgsl` lays them out.
fn read_gradients(bytes: &[u8]) -> ViewGradients {
    let mut found = ViewGradients::default();
    for row in bytes.as_chunks::<GRADIENT>().0 {
        let words = row.as_chunks::<4>().0;
        let float = |at: usize| f32::from_le_bytes(words[at]);
        let three = |at: usize| [float(at), float(at + 1), float(at + 2)];
        found.numbers.push(u32::from_le_bytes(words[3]));
        found.gradients.push(GaussianGradient {
            position: three(0),
            log_scale: three(4),
            logit: float(7),
            rotation: [float(8), float(9), float(10), float(11)],
            colour: three(12),
            score: float(15),
            direction: three(16),
        });
    }
    found
}

/// Adds the gradients of two regions of a view, in order of the scene.
fn join_gradients(a: ViewGradients, b: ViewGradients) -> ViewGradients {
    if a.numbers.is_empty() {
        return b;
    }
    let mut sum = ViewGradients::default();
    // Splats are in the order of the scene on the device, so both lists ascend and one pass merges them.
    let mut left = a.numbers.into_iter().zip(a.gradients).peekable();
    let mut right = b.numbers.into_iter().zip(b.gradients).peekable();
    loop {
        let next = match (left.peek(), right.peek()) {
            (None, None) => return sum,
            (Some((i, _)), Some((j, _))) if i == j => {
                left.next().zip(right.next()).map(|((i, a), (_, b))| (i, add_gradients(a, &b)))
            }
            (Some((i, _)), Some((j, _))) if i < j => left.next(),
            (Some(_), None) => left.next(),
            (_, Some(_)) => right.next(),
        };
        let Some((number, gradient)) = next else { return sum };
        sum.numbers.push(number);
        sum.gradients.push(gradient);
    }
}

/// The sum of two gradients of one Gaussian, which is seen in one direction.
fn add_gradients(a: GaussianGradient, b: &GaussianGradient) -> GaussianGradient {
    let three = |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|k| a[k] + b[k]);
    GaussianGradient {
        position: three(a.position, b.position),
        log_scale: three(a.log_scale, b.log_scale),
        rotation: std::array::from_fn(|k| a.rotation[k] + b.rotation[k]),
        logit: a.logit + b.logit,
        colour: three(a.colour, b.colour),
        direction: a.direction,
        score: a.score + b.score,
    }
}
