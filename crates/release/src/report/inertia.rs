//! Inertial data as a picture: three body rates above, three specific forces below, over the whole
//! trajectory.

use super::embed::EmbeddedPicture;
use super::previews::{PictureRequest, Preview};
use gs2e_image::{Image, Size, png};
use gs2e_trajectory::imu::files::{SAMPLES, SAMPLES_HEAD, read_lines};
use gs2e_trajectory::picture::short_number;

/// Size of the picture: two panels, one above the other.
const SIZE: Size = Size { width: 320, height: 160 };
const PANEL: usize = SIZE.height as usize / 2;
/// Rows between a curve and the edge of its panel.
const MARGIN: f64 = 4.0;

const PAPER: [u8; 3] = [255; 3];
const ZERO: [u8; 3] = [200; 3];
/// Colours of x, y and z.
const AXES: [[u8; 3]; 3] = [[200, 40, 40], [30, 140, 30], [40, 60, 200]];

/// The inertial data of a trajectory.
pub(crate) fn inertial_picture(of: PictureRequest<'_>) -> Option<Preview> {
    let bytes = of.read(&of.track.path_of(&format!("{}/{SAMPLES}", of.product.name())))?;
    let lines = read_lines(&bytes, SAMPLES_HEAD).ok()?;
    let columns: Vec<Vec<f64>> =
        (0..6).map(|axis| lines.iter().map(|(_, values)| values[axis]).collect()).collect();
    let mut image = Image::filled(SIZE, PAPER);
    let most = [0, 1].map(|panel| draw_panel(&mut image, panel, &columns[3 * panel..3 * panel + 3]));
    let words = format!(
        "inertial data: body rates up to {} rad/s above, specific forces up to {} m/s² below; x red, y green, z blue",
        short_number(most[0]),
        short_number(most[1])
    );
    let mut file = Vec::new();
    png::write_image(&image, &mut file).ok()?;
    Some(Preview { picture: EmbeddedPicture::of_png(&file, of.width)?, words, wheel: false })
}

/// Draws three curves about the middle row of a panel. Returns the largest size of a value, to which the
/// panel is scaled.
fn draw_panel(image: &mut Image<[u8; 3]>, panel: usize, curves: &[Vec<f64>]) -> f64 {
    let (width, middle) = (SIZE.width as usize, panel * PANEL + PANEL / 2);
    let pixels = image.pixels_mut();
    pixels[middle * width..(middle + 1) * width].fill(ZERO);
    let most = curves.iter().flatten().fold(0.0f64, |most, value| most.max(value.abs()));
    let scale = if most > 0.0 { (PANEL as f64 / 2.0 - MARGIN) / most } else { 0.0 };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the panel")]
    let row = |value: f64| (middle as f64 - value * scale).round() as usize;
    for (curve, colour) in curves.iter().zip(AXES) {
        for x in 0..width {
            // The samples of a column, and the first of the next, so that steep curves have no gaps.
            let [from, to] = [x, x + 1].map(|x| x * curve.len() / width);
            let Some(seen) = curve.get(from..(to + 1).max(from + 1).min(curve.len())) else { continue };
            let rows = seen.iter().map(|value| row(*value));
            let (Some(top), Some(bottom)) = (rows.clone().min(), rows.max()) else { continue };
            (top..=bottom).for_each(|y| pixels[y * width + x] = colour);
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_stay_in_their_panels_and_show_their_signs() {
        let mut image = Image::filled(SIZE, PAPER);
        let ramp: Vec<f64> = (0..5000).map(|i| f64::from(i) - 2500.0).collect();
        let flat = vec![0.0; 5000];
        assert!((draw_panel(&mut image, 1, &[ramp, flat.clone(), flat]) - 2500.0).abs() < 1e-9);
        let width = SIZE.width as usize;
        let red = |x: usize| (0..SIZE.height as usize).find(|y| image.pixels()[y * width + x] == AXES[0]);
        // Down on the left, where the value is negative, and up on the right.
        assert!(red(5).unwrap() > PANEL + PANEL / 2 && red(315).unwrap() < PANEL + PANEL / 2);
        assert!(image.pixels()[..PANEL * width].iter().all(|pixel| *pixel == PAPER));
    }

    #[test]
    fn a_single_sample_and_zeros_are_drawn() {
        let mut image = Image::filled(SIZE, PAPER);
        let most = draw_panel(&mut image, 0, &[vec![0.0], vec![0.0], vec![0.0]]);
        assert!(most.abs() < f64::EPSILON);
    }
}
