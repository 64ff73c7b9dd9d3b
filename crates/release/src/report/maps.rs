//! Depth and optical flow as pictures: numbers of the release's own arrays, coloured.
//!
//! Depth goes from dark (near) to yellow (far). Flow is the colour wheel of optical flow (Baker et
//! al., IJCV 2011, in the hues of HSV): the hue is the direction, and the saturation is the speed.
//! Pixels without a value are grey in both. Values beyond the ends of a scale have the colour of the
//! end, so that a few extreme pixels do not hide the rest.

use super::previews::{PictureRequest, Preview};
use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_image::{Image, npy};
use gs2e_trajectory::picture::{scale_rgb, short_number};
use std::io::BufReader;

/// Colour of a pixel without a value.
const UNDEFINED: [u8; 3] = [150; 3];
/// Share of the pixels beyond each end of the scale of depth: a scene outdoors has a few pixels far behind.
const BEYOND_DEPTH: f64 = 0.05;
/// Share of the pixels beyond the end of the scale of flow.
const BEYOND_FLOW: f64 = 0.01;

/// The depth nearest to the middle of the trajectory.
pub(crate) fn depth_picture(of: PictureRequest<'_>) -> Option<Preview> {
    scale_picture(of, ["depth", "units"])
}

/// The disparity nearest to the middle of the trajectory.
pub(crate) fn disparity_picture(of: PictureRequest<'_>) -> Option<Preview> {
    scale_picture(of, ["disparity", "px"])
}

/// A map of one value per pixel, in the colours of a scale.
fn scale_picture(of: PictureRequest<'_>, [what, unit]: [&str; 2]) -> Option<Preview> {
    let (number, values) = read_map::<1>(of)?;
    let (image, [low, high]) = colour_depths(&values)?;
    let words = format!(
        "{what} at {}, from {} (dark) to {} {unit} (yellow)",
        of.moment_words(number),
        short_number(low),
        short_number(high)
    );
    of.show_pixels(&image, words)
}

/// The optical flow nearest to the middle of the trajectory.
pub(crate) fn flow_picture(of: PictureRequest<'_>) -> Option<Preview> {
    let (number, flows) = read_map::<2>(of)?;
    let (image, full) = colour_flows(&flows)?;
    let words = format!(
        "optical flow at {}: full colour is {} px/s, white is none; red moves right, green down, cyan left, violet up",
        of.moment_words(number),
        short_number(full)
    );
    Some(Preview { wheel: true, ..of.show_pixels(&image, words)? })
}

/// The array of a product whose pose is nearest to the shown moment, with the number of this pose.
/// Pixels have `N` numbers.
fn read_map<const N: usize>(of: PictureRequest<'_>) -> Option<(usize, Image<[f32; N]>)> {
    let (number, path) = of.nearest_file()?;
    let size = of.checked_size()?;
    let whole = [size.height.into(), size.width.into(), N as u64];
    let shape = if N == 1 { &whole[..2] } else { &whole };
    let mut file = BufReader::new(files::open_with(&(of.places)(path)?, LinkRule::Refuse).ok()?);
    let values = npy::read_values(shape, &mut file).ok()?;
    let (pixels, _) = values.as_chunks::<N>();
    Some((number, Image::from_vec(size, pixels.to_vec())))
}

/// Colours depths; returns the picture with the depths at both ends of its scale. `None` if no pixel
/// has a depth.
fn colour_depths(depths: &Image<[f32; 1]>) -> Option<(Image<[u8; 3]>, [f64; 2])> {
    let ends = scale_ends(depths.pixels().iter().map(|[depth]| f64::from(*depth)), BEYOND_DEPTH)?;
    let [near, far] = ends;
    // All depths can be equal.
    let range = if far > near { far - near } else { 1.0 };
    let colour = |[depth]: &[f32; 1]| {
        let share = (f64::from(*depth) - near) / range;
        if share.is_nan() { UNDEFINED } else { scale_rgb(share.clamp(0.0, 1.0)) }
    };
    Some((Image::from_vec(depths.size(), depths.pixels().iter().map(colour).collect()), ends))
}

/// Colours flows, px/s; returns the picture with the speed that has the full colour. `None` if no
/// pixel has a flow.
fn colour_flows(flows: &Image<[f32; 2]>) -> Option<(Image<[u8; 3]>, f64)> {
    let speed = |[u, v]: &[f32; 2]| libm::hypot(f64::from(*u), f64::from(*v));
    let [_, full] = scale_ends(flows.pixels().iter().map(speed), BEYOND_FLOW)?;
    let colour = |flow: &[f32; 2]| {
        // Nothing moves if the full colour stands for 0.
        let share = if full > 0.0 { speed(flow) / full } else { speed(flow) };
        if share.is_nan() { UNDEFINED } else { wheel_colour(flow.map(f64::from), share.min(1.0)) }
    };
    Some((Image::from_vec(flows.size(), flows.pixels().iter().map(colour).collect()), full))
}

/// The values that this share of the pixels lies below and above, of those that are finite.
fn scale_ends(values: impl Iterator<Item = f64>, share: f64) -> Option<[f64; 2]> {
    let mut finite: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    finite.sort_unstable_by(f64::total_cmp);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
    let beyond = (finite.len() as f64 * share) as usize;
    let end = |at: usize| finite.get(at).copied();
    Some([end(beyond)?, end(finite.len().checked_sub(1 + beyond)?)?])
}

/// The colour of a direction: red to the right, then clockwise through the hues. `share` is the
/// saturation; 0 is white.
fn wheel_colour([u, v]: [f64; 2], share: f64) -> [u8; 3] {
    // In sixths of a turn, 0 to 6. The rows of an image go down, so the turn is clockwise.
    let turn = libm::atan2(v, u) / std::f64::consts::FRAC_PI_3;
    let sixth = if turn < 0.0 { turn + 6.0 } else { turn };
    // Distance of each channel's own hue (red 0, green 2, blue 4) around the wheel. A channel is
    // full within one sixth of its hue and empty beyond two.
    let channel = |own: f64| {
        let apart = (sixth - own).abs();
        let full = (2.0 - apart.min(6.0 - apart)).clamp(0.0, 1.0);
        255.0 * (1.0 - share * (1.0 - full))
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "values from 0 to 255")]
    [0.0, 2.0, 4.0].map(|own| channel(own).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;

    /// The pure hues by their names: 0, 60, 120, ... degrees of HSV.
    #[test]
    fn directions_have_the_hues_of_the_wheel() {
        let at = |degrees: f64| {
            let (v, u) = degrees.to_radians().sin_cos();
            wheel_colour([u, v], 1.0)
        };
        let wanted = [[255, 0, 0], [255, 255, 0], [0, 255, 0], [0, 255, 255], [0, 0, 255], [255, 0, 255]];
        for (k, wanted) in (0..6).zip(wanted) {
            assert_eq!(at(60.0 * f64::from(k)), wanted, "{k} sixths");
        }
        assert_eq!(wheel_colour([3.0, 4.0], 0.0), [255; 3]);
        assert_eq!(wheel_colour([1.0, 0.0], 0.6), [255, 102, 102]);
    }

    #[test]
    fn undefined_pixels_are_grey_and_the_far_end_is_yellow() {
        let size = Size { width: 4, height: 1 };
        let depths = Image::from_vec(size, [2.0, f32::NAN, 3.0, 6.0].map(|d| [d]).to_vec());
        let (image, ends) = colour_depths(&depths).unwrap();
        assert_eq!(ends.map(short_number), ["2", "6"]);
        assert_eq!(image.pixels()[1], UNDEFINED);
        let [near, _, _, far] = image.pixels() else { panic!("four pixels") };
        assert_eq!((near, far), (&scale_rgb(0.0), &scale_rgb(1.0)));
        assert_eq!(colour_depths(&Image::filled(size, [f32::NAN])), None);
        let (image, full) =
            colour_flows(&Image::from_vec(size, vec![[0.0, 0.0], [f32::NAN; 2], [-5.0, 0.0], [3.0, 4.0]]))
                .unwrap();
        assert_eq!(short_number(full), "5");
        assert_eq!(image.pixels()[..3], [[255; 3], UNDEFINED, [0, 255, 255]]);
    }

    #[test]
    fn a_few_extreme_values_do_not_set_the_scale() {
        let ends = scale_ends((0..=1000).map(|k| if k == 1000 { 1e9 } else { f64::from(k) }), 0.01);
        assert_eq!(ends.map(|ends| ends.map(short_number)), Some(["10", "990"].map(str::to_owned)));
        assert_eq!(scale_ends(std::iter::empty(), 0.01), None);
    }
}
