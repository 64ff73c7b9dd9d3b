//! The share of images that comes from Gaussians too deep for their distance, for which the affine
//! approximation of the projection is doubtful.

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
