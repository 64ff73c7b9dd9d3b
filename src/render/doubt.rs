//! How much of some pictures is made by Gaussians too deep for their distance
//! (docs/design/numerics-rendering.md, "Affine validity").

use super::Rendered;
use crate::image::Image;

/// Blended weight, summed over pictures.
#[derive(Debug, Clone, Copy, Default)]
pub struct Doubt {
    weight: f64,
    doubtful: f64,
}

impl Doubt {
    /// Adds a picture of which opacity and doubtful weight were asked for.
    pub fn add(&mut self, rendered: &Rendered) {
        let sum = |image: &Option<Image<f32>>| -> f64 {
            image.iter().flat_map(Image::pixels).map(|v| f64::from(*v)).sum()
        };
        self.weight += sum(&rendered.alpha);
        self.doubtful += sum(&rendered.doubtful);
    }

    /// The doubtful share; `None` where nothing is blended.
    #[must_use]
    pub fn share(&self) -> Option<f64> {
        (self.weight > 0.0).then(|| self.doubtful / self.weight)
    }
}
