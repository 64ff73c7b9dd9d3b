//! The share of images that comes from Gaussians too deep for their distance, for which the affine
//! approximation of the projection is doubtful.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::{Image, Size};
//! use gs2e_render::{RenderedImages, doubt::BlendDoubt};
//!
//! let image = |value| Some(Image::filled(Size { width: 4, height: 3 }, value));
//! let mut doubt = BlendDoubt::default();
//! assert_eq!(doubt.share(), None);
//! // Half of each pixel is blended, and a quarter of that is doubtful.
//! doubt.add(&RenderedImages { alpha: image(0.5), doubtful: image(0.125), ..RenderedImages::default() });
//! assert_eq!(doubt.share(), Some(0.25));
//! ```

use super::RenderedImages;
use gs2e_image::Image;

/// Sums of blended weight over images.
#[derive(Debug, Clone, Copy, Default)]
pub struct BlendDoubt {
    weight: f64,
    doubtful: f64,
}

impl BlendDoubt {
    /// Adds an image with the channels opacity and doubtful weight.
    pub fn add(&mut self, rendered: &RenderedImages) {
        // Sums in 64 bits: images have millions of pixels.
        let sum = |image: &Option<Image<f32>>| -> f64 {
            image.iter().flat_map(Image::pixels).map(|v| f64::from(*v)).sum()
        };
        self.weight += sum(&rendered.alpha);
        self.doubtful += sum(&rendered.doubtful);
    }

    /// The doubtful share; `None` if nothing was blended.
    #[must_use]
    pub fn share(&self) -> Option<f64> {
        (self.weight > 0.0).then(|| self.doubtful / self.weight)
    }
}
