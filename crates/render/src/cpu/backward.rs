//! Gradients: the derivative of a loss on the image by every parameter of the scene.
//!
//! The passes of the forward direction run as always, and leave a trace per pixel. Then `raster`
//! takes the layers of each tile away, back to front; `gather` adds the sums of each splat over its
//! tiles; `chain` takes them back through the projection. The forward pass keeps its bits, and the
//! gradients have the same bits with any number of threads and any instruction set.
//!
//! The gradient is that of the image as it is rendered: a layer that the rules cut off, a capped
//! opacity and a stopped pixel have no part in it. Depths decide the order of layers, and the order
//! has no gradient.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_render::{LayerOrder, RenderRules, RenderStyle};
//! # use gs2e_scene::camera::{Camera, view::CameraView};
//! use gs2e_render::cpu::backward::{GradientRenderer, ViewGradients};
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! # let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! # let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! # let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! // The only Gaussian of `scene` is grey, and covers half of the black in the middle pixel.
//! let mut renderer = GradientRenderer::new(scene, style)?;
//! renderer.render(&CameraView::at_rest(camera, Se3::IDENTITY))?;
//! let (mut by_pixel, mut found) = ([[0.0; 3]; 9 * 9], ViewGradients::default());
//! by_pixel[4 * 9 + 4] = [1.0, 0.0, 0.0];
//! renderer.gradients(&by_pixel, &[0.0; 9 * 9], &mut found);
//! // The red of this pixel is the opacity times the red of the Gaussian.
//! assert!((found.gradients[0].colour[0] - 0.5).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod chain;
mod gather;
mod raster;
#[cfg(test)]
mod tests;

use super::activate::{self, GaussianBlock, LANES};
use super::bin::{OrderedSplats, TileGrid, TileLists};
use super::eye::ViewTransform;
use super::project::{CHUNK, ProjectedSplats, ProjectionInput};
use super::raster::{PIXELS, RasterInput, TRACED_PLANES, raster_traced};
use super::{FrameBuffers, InstructionSet, unseen};
use crate::shared::TILE;
use crate::{ChannelSet, LayerOrder, OmissionPolicy, RenderError, RenderRules, RenderStyle, RenderWork};
use chain::{DrawnGaussian, ProjectionChain};
use fearless_simd::dispatch;
use gs2e_image::{Image, Size};
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::{Gaussians, sh};
use raster::{BackwardInput, SplatMoments, backward_tile};
use rayon::prelude::*;

/// Colour is the only channel with gradients.
const COLOUR: ChannelSet = ChannelSet { rgb: true, ..ChannelSet::NONE };

/// Largest number of Gaussians. Places in the list of a tile are kept as 32-bit floats, which are
/// exact up to here.
pub const MAX_GAUSSIANS: usize = 1 << 24;

/// The gradients of one Gaussian: the loss by its stored parameters.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GaussianGradient<S = f32> {
    /// By its position.
    pub position: [S; 3],
    /// By the logarithms of its scales.
    pub log_scale: [S; 3],
    /// By its stored quaternion, `w x y z`.
    pub rotation: [S; 4],
    /// By the logit of its opacity.
    pub logit: S,
    /// By its colour before the clamp at 0. The gradient by the coefficients of a harmonic is this
    /// times the harmonic's value in `direction`.
    pub colour: [S; 3],
    /// Unit direction from the camera, in world axes.
    pub direction: [S; 3],
    /// Its share of the score: the sum of its blended weight times the pixel's score.
    pub score: S,
}

impl GaussianGradient {
    /// Values of the harmonics of degree 0 to `degree` in the direction of view.
    #[must_use]
    pub fn harmonics(&self, degree: u8) -> [f32; sh::MAX_LEN] {
        sh::basis_values(degree, self.direction)
    }
}

/// The gradients of the Gaussians that a view draws.
#[derive(Debug, Clone, Default)]
pub struct ViewGradients {
    /// Indices of the drawn Gaussians in the scene, ascending.
    pub numbers: Vec<u32>,
    /// Their gradients.
    pub gradients: Vec<GaussianGradient>,
}

/// A scene that is rendered with gradients and changed between renderings.
#[derive(Debug)]
pub struct GradientRenderer {
    scene: Gaussians,
    blocks: Vec<GaussianBlock>,
    style: RenderStyle,
    sh_degree: u8,
    instructions: InstructionSet,
    /// The last view; its tiles are traced.
    frame: FrameBuffers,
    image: Image<[f32; 3]>,
    rendered: Option<(ViewTransform, TileGrid)>,
    pairs: Vec<SplatMoments>,
    sums: Vec<SplatMoments>,
}

impl GradientRenderer {
    /// Prepares a scene.
    ///
    /// # Errors
    /// The scene has more than [`MAX_GAUSSIANS`], or the style has no gradients.
    pub fn new(scene: Gaussians, style: RenderStyle) -> Result<Self, RenderError> {
        crate::check_style(&style)?;
        refuse_without_gradients(&scene, style)?;
        let blocks = activate::activate_all(&scene, style.rules, &unseen::all_indices(&scene));
        Ok(Self {
            sh_degree: scene.sh_degree,
            scene,
            blocks,
            style,
            instructions: InstructionSet::widest_set(),
            frame: FrameBuffers::new(),
            image: Image::from_vec(Size { width: 0, height: 0 }, Vec::new()),
            rendered: None,
            pairs: Vec::new(),
            sums: Vec::new(),
        })
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Gaussians {
        &self.scene
    }

    /// Returns the scene and drops the rest.
    #[must_use]
    pub fn into_scene(self) -> Gaussians {
        self.scene
    }

    /// Sets the highest degree of harmonics that is evaluated. Higher ones count as zero.
    pub fn set_degree(&mut self, degree: u8) {
        self.sh_degree = degree.min(self.scene.sh_degree);
    }

    /// The highest degree of harmonics that is evaluated.
    #[must_use]
    pub fn degree(&self) -> u8 {
        self.sh_degree
    }

    /// Sets the instruction set: the same bits at another speed.
    pub fn set_instructions(&mut self, instructions: InstructionSet) {
        self.instructions = instructions;
    }

    /// Sets the maximum number of (Gaussian, tile) pairs that are listed at once: the same bits with
    /// more or less memory.
    #[cfg(test)]
    fn set_list_budget(&mut self, pairs: usize) {
        self.frame.lists = TileLists::new(pairs);
        self.rendered = None;
    }

    /// Changes parameters of the Gaussians with these indices, ascending. The number of Gaussians
    /// stays.
    ///
    /// # Panics
    /// The change adds or removes Gaussians.
    pub fn change<T>(&mut self, numbers: &[u32], change: impl FnOnce(&mut Gaussians) -> T) -> T {
        let count = self.scene.len();
        let changed = change(&mut self.scene);
        assert_eq!(self.scene.len(), count, "the number of Gaussians stays");
        let (scene, rules) = (&self.scene, self.style.rules);
        self.blocks.par_iter_mut().enumerate().for_each(|(k, block)| {
            // Blocks are changed in place: to build all of them anew would cost as much as the
            // rendering.
            let end = |lane: usize| numbers.partition_point(|&number| (number as usize) < k * LANES + lane);
            for &number in &numbers[end(0)..end(LANES)] {
                block.refresh(scene, rules, number as usize - k * LANES);
            }
        });
        self.rendered = None;
        changed
    }

    /// Changes the scene in any way.
    pub fn rebuild<T>(&mut self, change: impl FnOnce(&mut Gaussians) -> T) -> T {
        let changed = change(&mut self.scene);
        // Freed first, so that the old and the new blocks do not exist at once.
        self.blocks = Vec::new();
        self.blocks =
            activate::activate_all(&self.scene, self.style.rules, &unseen::all_indices(&self.scene));
        self.rendered = None;
        changed
    }

    /// Renders a view and keeps the trace for [`Self::gradients`].
    ///
    /// # Errors
    /// The view cannot be rendered.
    pub fn render(&mut self, view: &CameraView) -> Result<(&Image<[f32; 3]>, RenderWork), RenderError> {
        crate::check_view(view)?;
        let eye = ViewTransform::new(view, self.scene.origin, self.style.rules);
        let level = self.instructions.level;
        let projection = ProjectionInput {
            scene: &self.scene,
            blocks: &self.blocks,
            sh_degree: self.sh_degree,
            style: self.style,
            eyes: std::slice::from_ref(&eye),
            want: COLOUR,
            sample: None,
            moment: None,
            level,
        };
        let mut work = self.frame.project(&projection);
        let FrameBuffers { projected, sorter, lists, tiles } = &mut self.frame;
        let order = sorter.run(&projected.depths, &projected.chunks);
        let grid = TileGrid::new(view.camera.size);
        let (splats, rates) = (&projected.splats, &projected.rates);
        let RenderStyle { rules, order: layers, background, .. } = self.style;
        work.tile_pairs = lists.run(OrderedSplats { order, splats, grid }, |lists| {
            // Work that changes no bit of the image changes none of the trace either.
            let omit = OmissionPolicy::Needless;
            work += raster_traced(
                RasterInput { splats, rates, lists, grid, sample: None, rules, order: layers, omit, level },
                tiles,
            );
        });
        if self.image.size() != grid.size {
            self.image = Image::filled(grid.size, [0.0; 3]);
        }
        show_tiles(tiles, grid, background, &mut self.image);
        self.rendered = Some((eye, grid));
        Ok((&self.image, work))
    }

    /// The gradients of a loss on the last rendered view. `by_pixel` is the gradient by the colour
    /// of each pixel, row by row, and `score` a value per pixel that is shared out among its layers.
    ///
    /// # Panics
    /// No view was rendered since the last change of the scene, or there is not one value per pixel.
    pub fn gradients(&mut self, by_pixel: &[[f32; 3]], score: &[f32], out: &mut ViewGradients) {
        let (eye, grid) = self.rendered.expect("a view was rendered");
        let pixels = grid.size.pixels();
        assert_eq!((by_pixel.len(), score.len()), (pixels, pixels), "one value per pixel");
        let FrameBuffers { projected, sorter, lists, tiles } = &mut self.frame;
        let splats = &projected.splats;
        let input = BackwardInput {
            splats,
            rules: self.style.rules,
            background: self.style.background,
            grid,
            tiles,
            gradient: by_pixel,
            score,
        };
        self.sums.clear();
        self.sums.resize(splats.len(), SplatMoments::default());
        let (pairs, sums) = (&mut self.pairs, &mut self.sums);
        let level = self.instructions.level;
        let mut back = |lists: &TileLists| {
            backward_band(lists, &input, level, pairs);
            gather::add_by_splat(lists, pairs, sums);
        };
        // If all tiles were one band, their lists are still there.
        if lists.band() == (0..grid.len()) {
            back(lists);
        } else {
            let order = sorter.run(&projected.depths, &projected.chunks);
            lists.run(OrderedSplats { order, splats, grid }, |lists| back(lists));
        }
        let chain = ProjectionChain {
            scene: &self.scene,
            eye,
            sh_degree: self.sh_degree,
            antialiased: self.style.antialiased,
        };
        self.collect(&chain, out);
    }

    /// The gradients of the drawn Gaussians, in order of the scene.
    fn collect(&self, chain: &ProjectionChain<'_>, out: &mut ViewGradients) {
        let ProjectedSplats { splats, numbers, chunks, .. } = &self.frame.projected;
        // In the order of the scene, not of depth: Adam walks the parameters once, from front to
        // back in memory.
        out.numbers.clear();
        out.gradients.resize(self.frame.drawn(), GaussianGradient::default());
        let mut rest = out.gradients.as_mut_slice();
        let mut parts = Vec::with_capacity(chunks.len());
        for (k, chunk) in chunks.iter().enumerate() {
            // The splats of a chunk begin at a multiple of `CHUNK`.
            out.numbers.extend_from_slice(&numbers[k * CHUNK..][..chunk.drawn]);
            parts.push((k * CHUNK, rest.split_off_mut(..chunk.drawn).expect("as many as are drawn")));
        }
        let each = |(place, gradient): (usize, &mut GaussianGradient)| {
            let number = numbers[place] as usize;
            let active = self.blocks[number / LANES].lane(number % LANES);
            let drawn = DrawnGaussian::new(&active, &splats[place]);
            *gradient = chain.gradient(number, &drawn, &self.sums[place]);
        };
        parts.into_par_iter().for_each(|(first, part)| {
            part.par_iter_mut().with_min_len(LANES).enumerate().for_each(|(i, g)| each((first + i, g)));
        });
    }
}

/// Refuses a scene or a style that has no gradients, on any back end.
///
/// # Errors
/// The scene has too many Gaussians, or the order of the layers is blended.
pub fn refuse_without_gradients(scene: &Gaussians, style: RenderStyle) -> Result<(), RenderError> {
    if scene.len() > MAX_GAUSSIANS {
        let because = format!("{} Gaussians, wanted at most {MAX_GAUSSIANS} for gradients", scene.len());
        return Err(RenderError::Scene(because));
    }
    if style.order == LayerOrder::Blended {
        return Err(RenderError::Style("a blended order has no gradients".to_owned()));
    }
    Ok(())
}

/// Writes the image of traced tiles: the arithmetic of `resolve`, row by row.
fn show_tiles(tiles: &[f32], grid: TileGrid, [r, g, b]: [f32; 3], image: &mut Image<[f32; 3]>) {
    let stride = TRACED_PLANES * PIXELS;
    image.pixels_mut().par_chunks_mut(grid.size.width as usize).enumerate().for_each(|(y, row)| {
        let tiles = &tiles[y / TILE * grid.columns * stride..];
        for (tile, run) in tiles.chunks_exact(stride).zip(row.chunks_mut(TILE)) {
            let plane = |n: usize| &tile[n * PIXELS + y % TILE * TILE..][..run.len()];
            let (red, green, blue, rest) = (plane(0), plane(1), plane(2), plane(3));
            for (x, to) in run.iter_mut().enumerate() {
                *to = [red[x] + rest[x] * r, green[x] + rest[x] * g, blue[x] + rest[x] * b];
            }
        }
    });
}

/// The moments of all entries of a band's lists, one tile after the other.
fn backward_band(
    lists: &TileLists,
    input: &BackwardInput<'_>,
    level: fearless_simd::Level,
    pairs: &mut Vec<SplatMoments>,
) {
    // Each tile writes the moments of its own entries. They are added by splat in a second pass, in
    // the order of the tiles, so the sums have the same bits with any number of threads.
    let runs: Vec<Vec<&[u32]>> = lists.band().map(|tile| lists.of(tile).collect()).collect();
    let lengths: Vec<usize> = runs.iter().map(|runs| runs.iter().map(|run| run.len()).sum()).collect();
    // Entries that nothing blends keep their zeros.
    pairs.clear();
    pairs.resize(lengths.iter().sum(), SplatMoments::default());
    let mut rest = pairs.as_mut_slice();
    let parts = lengths.iter().map(|&n| rest.split_off_mut(..n).expect("the sum of all lengths"));
    let parts: Vec<&mut [SplatMoments]> = parts.collect();
    // The choice is made once per band. A branch per pixel would keep the compiler from vector
    // code.
    let soft = input.rules == RenderRules::Soft;
    parts.into_par_iter().zip(&runs).zip(lists.band()).for_each(|((out, runs), tile)| {
        if soft {
            dispatch!(level, simd => backward_tile::<_, true>(simd, input, tile, runs, out));
        } else {
            dispatch!(level, simd => backward_tile::<_, false>(simd, input, tile, runs, out));
        }
    });
}
