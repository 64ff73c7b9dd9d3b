//! Memory of a training.

use super::photos::trained_size;
use super::settings::TrainingSettings;
use gs2e_image::Size;
use gs2e_source::{CapturedView, LensModel};

/// Number of photos that are read at a time: each takes memory at its own size.
pub(super) const READ_AT_ONCE: usize = 2;

/// Parameters, two means, the activated form, the splat, its sums and gradients, and six tiles.
const BYTES_A_GAUSSIAN: f64 = 1120.0;
/// Three levels of a photo of 3 bytes, and of the mask of a photo with a lens.
const BYTES_A_PHOTO_PIXEL: f64 = 3.0 * LEVEL_SUM;
const BYTES_A_MASK_PIXEL: f64 = LEVEL_SUM;
/// 1 + 1/4 + 1/16.
const LEVEL_SUM: f64 = 1.3125;
/// The image, its gradient, the slopes of the loss, the traced tiles.
const BYTES_A_PIXEL: f64 = 115.0;
/// A photo while it is read: its file, as decoded, straightened, and its mask.
const BYTES_A_TAKEN_PIXEL: f64 = 8.0;
/// Pages that the allocator keeps after photos with a lens were straightened.
const BYTES_A_STRAIGHTENED_PIXEL: f64 = 12.0;

/// Memory of a training on these views, bytes, without the program itself. The factors were
/// measured: `crates/lab/results/training.md` compares.
#[must_use]
pub fn memory_needed(settings: &TrainingSettings, views: &[CapturedView]) -> u64 {
    let pixels = |size: Size| f64::from(size.width) * f64::from(size.height);
    let (mut photos, mut largest, mut taken, mut straightened) = (0.0, 0.0_f64, 0.0_f64, 0.0_f64);
    for view in views {
        let size = pixels(trained_size(view.camera.size, settings.resolution));
        let mut mask = 0.0;
        if view.lens != LensModel::Pinhole {
            mask = BYTES_A_MASK_PIXEL;
            straightened = straightened.max(pixels(view.camera.size));
        }
        // Photos stay in memory as bytes: decoding a view again in each iteration would take longer
        // than rendering it.
        photos += size * (BYTES_A_PHOTO_PIXEL + mask);
        // One view at a time is rendered, so the largest one decides.
        largest = largest.max(size);
        taken = taken.max(pixels(view.camera.size));
    }
    // Reading and training do not overlap, so the larger of both counts.
    let reading = READ_AT_ONCE as f64 * BYTES_A_TAKEN_PIXEL * taken;
    let training = BYTES_A_GAUSSIAN * f64::from(settings.gaussians)
        + BYTES_A_PIXEL * largest
        + BYTES_A_STRAIGHTENED_PIXEL * straightened;
    // All photos are read before anything else is allocated.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast saturates")]
    let bytes = (photos + reading.max(training)) as u64;
    bytes
}
