//! `trajectory.png`: the path from above and from the side, for users without an SVG viewer. The
//! scale and the speed over time are in `trajectory.svg`.

use gs2e_build::artifact::TrajectoryProduct;
use gs2e_image::{Image, Size, png};
use gs2e_trajectory::picture::sketch;

/// Name of the file.
pub const NAME: &str = "trajectory.png";

/// Width and height of each of the two views, px.
const VIEW: [u32; 2] = [400, 360];
/// Maximum number of points of the path, and of cameras.
const DRAWN: [usize; 2] = [1500, 19];
const PATH: [f64; 3] = [153.0; 3];
const BAR: [f64; 3] = [51.0; 3];

/// Draws the picture; `None` if there is no pose.
pub fn compose_picture(motion: &TrajectoryProduct) -> Option<Vec<u8>> {
    let [width, height] = VIEW;
    let (poses, speeds) = (&motion.trajectory.world_from_camera, &motion.report.linear_unit_s);
    let views = sketch(poses, speeds, [f64::from(width), f64::from(height)], DRAWN)?;
    let size = Size { width: 2 * width, height };
    let mut canvas = PathCanvas { size, pixels: vec![[255.0; 3]; size.pixels()] };
    for (view, left) in views.iter().zip([0.0, f64::from(width)]) {
        let place = |[x, y]: [f64; 2]| [x + left, y];
        let mut stroke = |points: &[[f64; 2]], colour, thick| {
            for pair in points.windows(2) {
                canvas.line([place(pair[0]), place(pair[1])], colour, thick);
            }
        };
        stroke(&view.path, PATH, 1.5);
        for (strokes, colour) in &view.frusta {
            stroke(strokes, parse_colour(colour), 1.2);
        }
        let bottom = f64::from(height) - 10.0;
        stroke(&[[10.0, bottom], [10.0 + view.bar, bottom]], BAR, 2.0);
    }
    let mut bytes = Vec::new();
    png::write_image(&canvas.image(), &mut bytes).expect("a Vec takes any bytes");
    Some(bytes)
}

/// Parses a colour written as `#rrggbb`; black if it is not one.
fn parse_colour(text: &str) -> [f64; 3] {
    [1, 3, 5].map(|at| {
        text.get(at..at + 2).and_then(|hex| u8::from_str_radix(hex, 16).ok()).map_or(0.0, f64::from)
    })
}

struct PathCanvas {
    size: Size,
    pixels: Vec<[f64; 3]>,
}

impl PathCanvas {
    /// Draws a straight line with soft edges: each pixel is mixed with the colour by its share
    /// within the line, which falls from 1 to 0 over one pixel.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the picture")]
    fn line(&mut self, [a, b]: [[f64; 2]; 2], colour: [f64; 3], thick: f64) {
        let [width, height] = [self.size.width, self.size.height];
        // Centres up to `thick / 2 + 0.5` away are coloured, and lie 0.5 inside their pixels.
        let reach = thick / 2.0 + 1.0;
        let side = |k: usize, end: u32| {
            let [low, high] = [a[k].min(b[k]) - reach, a[k].max(b[k]) + reach + 1.0];
            low.clamp(0.0, f64::from(end)) as u32..high.clamp(0.0, f64::from(end)) as u32
        };
        for y in side(1, height) {
            for x in side(0, width) {
                let away = segment_distance([f64::from(x) + 0.5, f64::from(y) + 0.5], a, b);
                let share = (thick / 2.0 + 0.5 - away).clamp(0.0, 1.0);
                let pixel = &mut self.pixels[(y * width + x) as usize];
                for (value, colour) in pixel.iter_mut().zip(colour) {
                    *value += share * (colour - *value);
                }
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "mixtures of 0 to 255")]
    fn image(self) -> Image<[u8; 3]> {
        // `round` is a call, and most of the time of a picture.
        let bytes = self.pixels.into_iter().map(|pixel| pixel.map(|v| (v + 0.5) as u8));
        Image::from_vec(self.size, bytes.collect())
    }
}

/// Distance of a point from a segment.
fn segment_distance(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let [along, to] = [[b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]];
    let length = along[0] * along[0] + along[1] * along[1];
    let share =
        if length > 0.0 { ((to[0] * along[0] + to[1] * along[1]) / length).clamp(0.0, 1.0) } else { 0.0 };
    let [x, y] = [to[0] - share * along[0], to[1] - share * along[1]];
    (x * x + y * y).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_covers_what_it_covers() {
        let size = Size { width: 8, height: 5 };
        let mut canvas = PathCanvas { size, pixels: vec![[255.0; 3]; 40] };
        // Two px thick along the edge of rows 1 and 2, and beyond the picture on the right.
        canvas.line([[2.0, 2.0], [20.0, 2.0]], [0.0; 3], 2.0);
        let grey: Vec<u8> = canvas.image().pixels().iter().map(|p| p[1]).collect();
        assert_eq!(&grey[8..16], &grey[16..24], "it is symmetric");
        assert_eq!(&grey[10..16], &[0; 6]);
        assert_eq!((grey[0], grey[8], grey[4 * 8 + 5]), (255, 255, 255));
    }

    #[test]
    fn colours_are_read() {
        assert_eq!(parse_colour("#ff8001").map(f64::to_bits), [255.0f64, 128.0, 1.0].map(f64::to_bits));
        assert_eq!(parse_colour("none").map(f64::to_bits), [0; 3]);
    }
}
