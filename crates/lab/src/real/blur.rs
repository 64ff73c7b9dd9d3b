//! A Gaussian of 1 px over a picture whose border is mirrored.

use gs2e_image::Size;

/// Weights end at this distance.
const RADIUS: usize = 4;

/// The Gaussian for pictures of one size.
#[derive(Debug, Clone)]
pub(super) struct PictureBlur {
    size: Size,
    /// Weights from the middle outwards.
    weights: [f64; RADIUS + 1],
}

impl PictureBlur {
    pub(super) fn new(size: Size) -> Self {
        let mut weights = [0.0; RADIUS + 1];
        weights.iter_mut().enumerate().for_each(|(k, weight)| *weight = libm::exp(-0.5 * (k * k) as f64));
        let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
        Self { size, weights: weights.map(|weight| weight / sum) }
    }

    /// The blurred picture, row by row. The sum of the picture stays.
    pub(super) fn apply(&self, picture: &[f64]) -> Vec<f64> {
        let [width, height] = [self.size.width as usize, self.size.height as usize];
        let along = self.lines(picture, [width, height], [1, width]);
        self.lines(&along, [height, width], [width, 1])
    }

    /// Blurs lines of `length`, whose elements and starts are at these steps.
    fn lines(&self, picture: &[f64], [length, lines]: [usize; 2], [step, next]: [usize; 2]) -> Vec<f64> {
        let mut out = vec![0.0; picture.len()];
        let mut line = vec![0.0; length + 2 * RADIUS];
        for first in (0..lines).map(|k| k * next) {
            for (k, value) in line.iter_mut().enumerate() {
                *value = picture[first + step * mirrored(k, length)];
            }
            for i in 0..length {
                let middle = &line[i..=i + 2 * RADIUS];
                let mut sum = self.weights[0] * middle[RADIUS];
                for k in 1..=RADIUS {
                    sum += self.weights[k] * (middle[RADIUS - k] + middle[RADIUS + k]);
                }
                out[first + step * i] = sum;
            }
        }
        out
    }
}

/// The element that place `k - RADIUS` of a line shows: the border mirrors the line, its end twice.
fn mirrored(k: usize, length: usize) -> usize {
    // Lines may be shorter than the radius: the mirrored line repeats after twice its length.
    let place = (k + 2 * length * RADIUS - RADIUS) % (2 * length);
    if place < length { place } else { 2 * length - 1 - place }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point in the middle becomes the Gaussian, and one in a corner keeps its sum.
    #[test]
    fn points_become_gaussians() {
        let size = Size { width: 11, height: 9 };
        let blur = PictureBlur::new(size);
        let mut picture = vec![0.0; size.pixels()];
        picture[4 * 11 + 5] = 2.0;
        let found = blur.apply(&picture);
        // Weights beyond the radius are 1.3e-4 of all.
        let wanted = 2.0 / std::f64::consts::TAU;
        assert!((found[4 * 11 + 5] - wanted).abs() < 2e-4 * wanted, "{}", found[4 * 11 + 5]);
        assert!((found[2 * 11 + 4] - wanted * (-2.5_f64).exp()).abs() < 2e-4 * wanted);
        for size in
            [Size { width: 11, height: 9 }, Size { width: 2, height: 1 }, Size { width: 1, height: 3 }]
        {
            let mut picture = vec![0.0; size.pixels()];
            picture[0] = 1.0;
            let sum: f64 = PictureBlur::new(size).apply(&picture).iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "{size}: {sum}");
        }
    }
}
