//! Pass 5: turns the sums of the tiles into images, with the background added and depth normalised.

use super::bin::TileGrid;
use super::raster::PIXELS;
use crate::shared::{DEPTH_MIN_ALPHA, TILE};
use crate::{ChannelSet, RenderedImages};
use gs2e_image::{Image, luminance};
use rayon::prelude::*;

/// The blended tiles of a frame, as written by the raster pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlendedTiles<'a> {
    /// Planes of all tiles.
    pub(super) tiles: &'a [f32],
    /// Number of features per splat.
    pub(super) features: usize,
    /// The division into tiles.
    pub(super) grid: TileGrid,
}

/// Writes the requested images.
pub(super) fn resolve_tiles(
    blended: BlendedTiles<'_>,
    want: ChannelSet,
    background: [f32; 3],
    out: &mut RenderedImages,
) {
    // The order in which `ProjectionInput::features` wrote the features.
    let mut first = 0;
    let mut next = |n: usize| {
        first += n;
        first - n
    };
    let rgb = want.rgb.then(|| next(3));
    let grey = want.luminance.then(|| next(1));
    let depth = want.depth.then(|| next(1));
    let doubtful = want.doubtful.then(|| next(1));
    fill_image(&mut out.rgb, [0.0; 3], rgb, blended, |pixel, f| {
        std::array::from_fn(|c| pixel.sum(f + c) + pixel.rest() * background[c])
    });
    let behind = luminance(background);
    fill_image(&mut out.luminance, 0.0, grey, blended, |pixel, f| pixel.sum(f) + pixel.rest() * behind);
    // Alpha is not a feature. The 0 only says that it is wanted.
    fill_image(&mut out.alpha, 0.0, want.alpha.then_some(0), blended, |pixel, _| 1.0 - pixel.rest());
    fill_image(&mut out.depth, 0.0, depth, blended, |pixel, f| {
        let alpha = 1.0 - pixel.rest();
        if alpha < DEPTH_MIN_ALPHA { f32::NAN } else { pixel.sum(f) / alpha }
    });
    fill_image(&mut out.doubtful, 0.0, doubtful, blended, |pixel, f| pixel.sum(f));
    // The rates follow the features and the transmittance.
    let rate = want.luminance_rate.then_some(blended.features + 1);
    fill_image(&mut out.luminance_rate, 0.0, rate, blended, |pixel, f| {
        pixel.sum(f) + pixel.sum(f + 1) * behind
    });
}

/// The sum of one feature at each pixel.
pub(super) fn feature_image(blended: BlendedTiles<'_>, feature: usize) -> Image<f32> {
    let mut image = None;
    fill_image(&mut image, 0.0, Some(feature), blended, |pixel, f| pixel.sum(f));
    image.expect("a feature fills its image")
}

/// The mean of three features at each pixel by weight; NaN where a depth is.
pub(super) fn mean_vectors(blended: BlendedTiles<'_>) -> Image<[f32; 3]> {
    let mut image = None;
    fill_image(&mut image, [0.0; 3], Some(0), blended, |pixel, f| {
        let alpha = 1.0 - pixel.rest();
        let mean = |k: usize| if alpha < DEPTH_MIN_ALPHA { f32::NAN } else { pixel.sum(f + k) / alpha };
        [mean(0), mean(1), mean(2)]
    });
    image.expect("features fill their image")
}

/// The values of one pixel in the planes of its tile.
struct ResolvedPixel<'a> {
    tile: &'a [f32],
    index: usize,
    features: usize,
}

impl ResolvedPixel<'_> {
    fn sum(&self, plane: usize) -> f32 {
        self.tile[plane * PIXELS + self.index]
    }

    fn rest(&self) -> f32 {
        self.sum(self.features)
    }
}

/// Fills one image from its first feature, or removes it if it is not requested.
fn fill_image<T: Copy + Send>(
    image: &mut Option<Image<T>>,
    blank: T,
    feature: Option<usize>,
    blended: BlendedTiles<'_>,
    value: impl Fn(ResolvedPixel<'_>, usize) -> T + Sync,
) {
    let Some(feature) = feature else {
        *image = None;
        return;
    };
    let BlendedTiles { tiles, features, grid } = blended;
    let stride = tiles.len() / grid.len();
    // Every pixel is written below, so an image of the right size is reused as it is.
    let reused = image.take().filter(|i| i.size() == grid.size);
    let mut filled = reused.unwrap_or_else(|| Image::filled(grid.size, blank));
    filled.pixels_mut().par_chunks_mut(grid.size.width as usize).enumerate().for_each(|(y, row)| {
        let tiles = tiles[y / TILE * grid.columns * stride..].chunks_exact(stride);
        for (tile, run) in tiles.zip(row.chunks_mut(TILE)) {
            for (x, to) in run.iter_mut().enumerate() {
                *to = value(ResolvedPixel { tile, index: y % TILE * TILE + x, features }, feature);
            }
        }
    });
    *image = Some(filled);
}
