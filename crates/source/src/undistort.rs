//! Undistorted photos: photos resampled onto the pinhole part of their camera.
//!
//! This is OpenCV's `undistort` with the camera matrix kept
//! (`modules/calib3d/src/undistort.dispatch.cpp`): same size, same focal lengths, same principal
//! point, bilinear, black outside the photo. There are two differences. The position in the photo
//! is not rounded to 1/32 px. Pixel centres lie at half-integers, as everywhere in this program;
//! OpenCV has them at integers, so its principal point is `cx - 0.5`, `cy - 0.5`.

use super::LensModel;
use super::lens::NEGLIGIBLE_PX;
use gs2e_image::{Image, Size};
use gs2e_scene::camera::Camera;
use rayon::prelude::*;
use std::borrow::Cow;

/// Returns the pinhole image of `camera`, resampled from a `photo` taken through `lens`.
///
/// Returns the photo itself if the lens moves no point by more than `NEGLIGIBLE_PX`.
///
/// # Panics
/// The photo does not have the camera's size.
#[must_use]
pub fn undistort_photo<'a>(
    photo: &'a Image<[u8; 3]>,
    camera: &Camera,
    lens: &LensModel,
) -> Cow<'a, Image<[u8; 3]>> {
    assert_eq!(photo.size(), camera.size, "a photo has the size of its camera");
    if lens.max_displacement_px(camera) <= NEGLIGIBLE_PX {
        return Cow::Borrowed(photo);
    }
    let mut straight = Image::filled(photo.size(), [0; 3]);
    let rows = straight.pixels_mut().par_chunks_mut(camera.size.width as usize);
    rows.zip(0..camera.size.height).for_each(|(row, j)| {
        for (pixel, i) in row.iter_mut().zip(0..) {
            *pixel = bilinear_colour(photo, photo_position(camera, lens, [i, j]));
        }
    });
    Cow::Owned(straight)
}

/// Returns the mask of the pixels of [`undistort_photo`] that show only the photo, without black
/// from outside its border. Returns `None` if all pixels do.
#[must_use]
pub fn covered_pixels(camera: &Camera, lens: &LensModel) -> Option<Image<bool>> {
    if lens.max_displacement_px(camera) <= NEGLIGIBLE_PX {
        return None;
    }
    let Size { width, height } = camera.size;
    // Between the outermost pixel centres all four neighbours lie in the photo.
    let within = |place: f64, side: u32| (0.5..=f64::from(side) - 0.5).contains(&place);
    let shows = |[u, v]: [f64; 2]| within(u, width) && within(v, height);
    let row = |j| (0..width).map(move |i| shows(photo_position(camera, lens, [i, j])));
    Some(Image::from_vec(camera.size, (0..height).into_par_iter().flat_map_iter(row).collect()))
}

/// Returns the position in the photo, px, that corresponds to the centre of pixel `[i, j]` of the
/// pinhole image.
fn photo_position(camera: &Camera, lens: &LensModel, [i, j]: [u32; 2]) -> [f64; 2] {
    let x = (f64::from(i) + 0.5 - camera.cx) / camera.fx;
    let y = (f64::from(j) + 0.5 - camera.cy) / camera.fy;
    let [x, y] = lens.distort([x, y]);
    [camera.fx * x + camera.cx, camera.fy * y + camera.cy]
}

/// Interpolates between the four nearest pixel centres; those outside the photo are black.
fn bilinear_colour(photo: &Image<[u8; 3]>, [u, v]: [f64; 2]) -> [u8; 3] {
    // Pixel centres lie at half-integers; the interpolation counts from the centres.
    let (x, y) = (u - 0.5, v - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let (to_right, to_bottom) = (x - left, y - top);
    // Plain arrays and not the array functions: this runs for every pixel of every photo, and the
    // compiler may leave those as calls.
    let at = |column: f64, row: f64| pixel_colour(photo, [column, row]);
    let a = [at(left, top), at(left + 1.0, top)];
    let b = [at(left, top + 1.0), at(left + 1.0, top + 1.0)];
    let blended = |channel: usize| {
        let between = |[l, r]: [[u8; 3]; 2]| {
            f64::from(l[channel]) * (1.0 - to_right) + f64::from(r[channel]) * to_right
        };
        round_byte(between(a) * (1.0 - to_bottom) + between(b) * to_bottom)
    };
    [blended(0), blended(1), blended(2)]
}

/// Returns the colour of the pixel in this column and row, both whole numbers. The result is black
/// outside the photo, and at a pole of the lens, where the position is NaN.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers within the photo")]
#[inline(always)]
fn pixel_colour(photo: &Image<[u8; 3]>, [column, row]: [f64; 2]) -> [u8; 3] {
    let Size { width, height } = photo.size();
    let inside = (0.0..f64::from(width)).contains(&column) && (0.0..f64::from(height)).contains(&row);
    if inside { photo.pixels()[row as usize * width as usize + column as usize] } else { [0; 3] }
}

/// Rounds a value to the nearest byte; NaN becomes 0.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 255.5")]
#[inline(always)]
fn round_byte(value: f64) -> u8 {
    (value + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 97, height: 61 };
    const CAMERA: Camera = Camera { size: SIZE, fx: 90.0, fy: 80.0, cx: 50.25, cy: 29.5, lens: None };

    /// Paints a picture with the colours of `shade` at the centres of its pixels, px.
    fn picture(shade: impl Fn(f64, f64) -> [f64; 3]) -> Image<[u8; 3]> {
        let at = |k: u32| (f64::from(k % SIZE.width) + 0.5, f64::from(k / SIZE.width) + 0.5);
        let pixels = (0..SIZE.width * SIZE.height).map(at).map(|(u, v)| shade(u, v).map(round_byte));
        Image::from_vec(SIZE, pixels.collect())
    }

    /// A pattern smooth enough that bilinear interpolation is off by less than a fifth of a grey
    /// level: at most `(|f_uu| + |f_vv|) / 8`, with second derivatives below `100 / 15^2 = 0.45`
    /// and `80 / 12^2 = 0.56`.
    fn waves(u: f64, v: f64) -> [f64; 3] {
        [
            128.0 + 100.0 * libm::sin(u / 15.0 + 0.3),
            120.0 + 80.0 * libm::cos(v / 12.0),
            125.0 + 60.0 * libm::sin((u - v) / 18.0),
        ]
    }

    fn largest_difference(a: &Image<[u8; 3]>, b: &Image<[u8; 3]>) -> u8 {
        let channels = a.pixels().as_flattened().iter().zip(b.pixels().as_flattened());
        channels.map(|(a, b)| a.abs_diff(*b)).max().unwrap()
    }

    #[test]
    fn a_lens_that_moves_nothing_leaves_the_photo_alone() {
        let photo = picture(waves);
        for lens in [LensModel::Pinhole, LensModel::SimpleRadial { k1: 1e-4 }] {
            assert!(matches!(undistort_photo(&photo, &CAMERA, &lens), Cow::Borrowed(same) if same == &photo));
            assert_eq!(covered_pixels(&CAMERA, &lens), None);
        }
    }

    /// With `k r^2` far above 1, the rational lens `(1 + k1 r^2) / (1 + k4 r^2)` is a scale by
    /// `k1 / k4`.
    #[test]
    fn a_lens_that_scales_is_undone_about_the_principal_point() {
        let lens = LensModel::FullOpenCv { k: [0.5e15, 0.0, 0.0, 0.0, 0.0, 1e15, 0.0, 0.0] };
        let photo = picture(|u, v| waves(50.25 + 2.0 * (u - 50.25), 29.5 + 2.0 * (v - 29.5)));
        let straight = undistort_photo(&photo, &CAMERA, &lens);
        // Waves of half the length have four times the curvature: below one level, with the
        // rounding.
        assert!(largest_difference(&straight, &picture(waves)) <= 2);
        let lens = LensModel::FullOpenCv { k: [4e15, 0.0, 0.0, 0.0, 0.0, 1e15, 0.0, 0.0] };
        let white = Image::filled(SIZE, [255; 3]);
        // The distance from the principal point is four times as large. A pixel centre at distance
        // d of an edge at D is inside for 4 d <= D - 1/2, and black for 4 d >= D + 1/2.
        let wanted = |centre: f64, from: f64, to: f64| {
            let place = from + 4.0 * (centre - from);
            if (0.5..=to - 0.5).contains(&place) {
                Some(255)
            } else if place <= -0.5 || place >= to + 0.5 {
                Some(0)
            } else {
                None
            }
        };
        let straight = undistort_photo(&white, &CAMERA, &lens);
        let covered = covered_pixels(&CAMERA, &lens).unwrap();
        let mut judged = [0, 0];
        for (k, pixel) in straight.pixels().iter().enumerate() {
            let column = wanted((k % 97) as f64 + 0.5, CAMERA.cx, 97.0);
            let row = wanted((k / 97) as f64 + 0.5, CAMERA.cy, 61.0);
            if let (Some(a), Some(b)) = (column, row) {
                assert_eq!(*pixel, [a.min(b); 3], "{k}");
                assert_eq!(covered.pixels()[k], a.min(b) == 255, "{k}");
                judged[usize::from(a.min(b) == 0)] += 1;
            }
        }
        assert!(judged.iter().all(|&count| count > 300), "{judged:?}");
    }

    /// The photo is painted through the inverse lens, which bisection finds.
    #[test]
    fn a_planted_radial_lens_is_undone() {
        let k1 = -0.25;
        let straight_radius = |bent: f64| {
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..60 {
                let middle: f64 = f64::midpoint(low, high);
                if middle * (1.0 + k1 * middle * middle) < bent { low = middle } else { high = middle }
            }
            low
        };
        let photo = picture(|u, v| {
            let (x, y) = ((u - 50.25) / 90.0, (v - 29.5) / 80.0);
            let scale = straight_radius(x.hypot(y)) / x.hypot(y);
            waves(50.25 + 90.0 * x * scale, 29.5 + 80.0 * y * scale)
        });
        let lens = LensModel::SimpleRadial { k1 };
        assert!(lens.max_displacement_px(&CAMERA) > 5.0);
        assert!(largest_difference(&undistort_photo(&photo, &CAMERA, &lens), &picture(waves)) <= 1);
        // The photo as taken is a different picture, so the comparison above can fail.
        assert!(largest_difference(&photo, &picture(waves)) > 20);
    }
}
