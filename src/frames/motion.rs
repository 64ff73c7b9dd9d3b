//! An estimate of the picture's motion from frame to frame, from a few thousand pixels at edges.
//!
//! An edge of slope `g` that moves by `d` pixels across itself changes the brightness by `g d`, as
//! long as the slope reaches that far. So `|change| / g` estimates `d`. Motion along an edge is
//! invisible, and a change cannot exceed the contrast: the estimate is a lower bound of the motion.

use crate::image::Image;

/// Pixels that are looked at, at most.
const SAMPLES: f64 = 4096.0;
/// Smallest slope of an edge, in grey per pixel: several times the noise of 8-bit video.
const EDGE: f32 = 8.0;
/// Number of edge pixels below which two frames say nothing.
const FEW: usize = 50;

/// The motion between the frames of a sequence so far.
#[derive(Debug, Default)]
pub struct EdgeMotion {
    /// Index, brightness and slope of the edge pixels of the last frame.
    edges: Vec<(usize, f32, f32)>,
    /// Median motion between two frames, for each pair with enough edges.
    medians: Vec<f32>,
}

impl EdgeMotion {
    /// Takes the next frame.
    pub fn see(&mut self, luminance: &Image<f32>) {
        let pixels = luminance.pixels();
        let mut moved: Vec<f32> =
            self.edges.iter().map(|&(at, before, slope)| (pixels[at] - before).abs() / slope).collect();
        if moved.len() >= FEW {
            let middle = moved.len() / 2;
            self.medians.push(*moved.select_nth_unstable_by(middle, f32::total_cmp).1);
        }
        self.edges = edges(luminance);
    }

    /// The median motion over pairs of frames, in pixels; `None` if too few pixels are at edges.
    #[must_use]
    pub fn median_px(&self) -> Option<f32> {
        let mut medians = self.medians.clone();
        let middle = medians.len() / 2;
        (!medians.is_empty()).then(|| *medians.select_nth_unstable_by(middle, f32::total_cmp).1)
    }
}

/// The pixels at edges, on a grid that is as fine as [`SAMPLES`] allows.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "at least 1, at most the side of a frame"
)]
fn edges(luminance: &Image<f32>) -> Vec<(usize, f32, f32)> {
    let size = luminance.size();
    let (width, height) = (size.width as usize, size.height as usize);
    let step = (size.pixels() as f64 / SAMPLES).sqrt().ceil().max(1.0) as usize;
    let pixels = luminance.pixels();
    let at = |y: usize, x: usize| {
        let i = y * width + x;
        let (right, down) = (pixels[i + 1] - pixels[i - 1], pixels[i + width] - pixels[i - width]);
        let slope = 0.5 * (right * right + down * down).sqrt();
        (slope >= EDGE).then_some((i, pixels[i], slope))
    };
    // The outermost pixels have no slope on one side.
    let rows = (1..height.saturating_sub(1)).step_by(step);
    rows.flat_map(|y| (1..width.saturating_sub(1)).step_by(step).filter_map(move |x| at(y, x))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;

    const SIZE: Size = Size { width: 64, height: 48 };

    /// A grating of amplitude 100 and of 40 pixels per period, moved across itself by `px`.
    fn grating(px: f64) -> Image<f32> {
        #[expect(clippy::cast_possible_truncation, reason = "greys")]
        let grey = |i: usize| {
            let (x, y) = ((i % 64) as f64, (i / 64) as f64);
            (128.0 + 100.0 * ((0.8 * x + 0.6 * y - px) * std::f64::consts::TAU / 40.0).sin()) as f32
        };
        Image::from_vec(SIZE, (0..SIZE.pixels()).map(grey).collect())
    }

    fn median(frames: impl IntoIterator<Item = Image<f32>>) -> Option<f32> {
        let mut motion = EdgeMotion::default();
        frames.into_iter().for_each(|frame| motion.see(&frame));
        motion.median_px()
    }

    #[test]
    fn motion_across_edges_is_found() {
        for px in [0.0, 0.2, 0.9, 1.5, 3.0] {
            let found = f64::from(median((0..5).map(|i| grating(px * f64::from(i)))).unwrap());
            // The curvature within 3 px of a period of 40 changes a slope by at most a quarter.
            assert!((found - px).abs() <= 0.25 * px + 1e-3, "{px}: {found}");
        }
    }

    #[test]
    fn pictures_without_edges_say_nothing() {
        assert_eq!(median((0..3u8).map(|i| Image::filled(SIZE, f32::from(i) * 50.0))), None);
        assert_eq!(median([]), None);
        assert_eq!(median([grating(0.0)]), None);
        let thin = Size { width: 1, height: 1 };
        assert_eq!(median((0..3u8).map(|i| Image::filled(thin, f32::from(i)))), None);
    }
}
