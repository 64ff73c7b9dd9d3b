//! Writer of `.spz` scenes: version 3, which every reader of the format supports, with ten bits per
//! rotation component.

use super::planes::{COLOUR_SCALE, smallest_three};
use super::{AxisFlip, MAGIC, MAX_FRACTIONAL_BITS};
use crate::opacity::byte_of_logit;
use crate::rotation::unit_quaternion;
use crate::{Gaussians, WriteError, nearest_byte};
use std::f64::consts::FRAC_1_SQRT_2;
use std::io::Write;

/// Maximum of a signed 24-bit number.
const MAX_STEPS: f64 = 8_388_607.0;

/// Writes `scene` as `.spz`, with every number rounded to the nearest value of the format.
/// Positions get the most fractional bits that the farthest position permits. The flag of
/// antialiasing is taken from the scene.
///
/// # Errors
/// Returns a [`WriteError`] if a position is 2^23 or more from zero, there are 2^32 Gaussians or
/// more, or `out` fails.
pub fn write_spz(scene: &Gaussians, out: impl Write) -> Result<(), WriteError> {
    let bits = fractional_bits(scene)?;
    let count = u32::try_from(scene.len()).map_err(|_| WriteError::TooMany { count: scene.len() })?;
    let mut out = flate2::write::GzEncoder::new(out, flate2::Compression::default());
    out.write_all(&MAGIC)?;
    out.write_all(&3_u32.to_le_bytes())?;
    out.write_all(&count.to_le_bytes())?;
    out.write_all(&[scene.sh_degree, bits, u8::from(scene.antialiased == Some(true)), 0])?;
    for plane in encode_planes(scene, bits) {
        out.write_all(&plane)?;
    }
    out.finish()?.flush()?;
    Ok(())
}

/// Returns the maximum number of fractional bits that keeps every position within 24 bits.
pub(crate) fn fractional_bits(scene: &Gaussians) -> Result<u8, WriteError> {
    let farthest =
        (0..scene.len()).flat_map(|i| scene.position(i).to_array()).fold(0.0, |f, x| x.abs().max(f));
    let fits = |bits: &u8| (farthest * scale_value(*bits)).round() <= MAX_STEPS;
    (0..=MAX_FRACTIONAL_BITS).rev().find(fits).ok_or(WriteError::TooFar { farthest })
}

fn scale_value(bits: u8) -> f64 {
    f64::from(1_u32 << bits)
}

fn encode_planes(scene: &Gaussians, bits: u8) -> [Vec<u8>; 6] {
    let flip = AxisFlip::RIGHT_UP_BACK;
    let (signs, turns, parities) = (flip.of_position(), flip.of_rotation(), flip.of_harmonics());
    let mut planes: [Vec<u8>; 6] = Default::default();
    let [positions, opacities, colours, scales, rotations, harmonics] = &mut planes;
    for i in 0..scene.len() {
        for (x, sign) in scene.position(i).to_array().into_iter().zip(signs) {
            positions.extend(&fixed_point(f64::from(sign) * x * scale_value(bits)).to_le_bytes()[..3]);
        }
        opacities.push(byte_of_logit(scene.opacity_logits[i]));
        let (colour, rest) = scene.sh_of(i).split_at(1);
        let colour_scale = f64::from(COLOUR_SCALE);
        colours.extend(colour[0].map(|c| nearest_byte((f64::from(c) * colour_scale + 0.5) * 255.0)));
        scales.extend(scene.log_scales[i].map(|s| nearest_byte((f64::from(s) + 10.0) * 16.0)));
        let [w, x, y, z] = unit_quaternion(scene.rotations[i]);
        let turned = [x * f64::from(turns[0]), y * f64::from(turns[1]), z * f64::from(turns[2]), w];
        rotations.extend(packed_rotation(turned).to_le_bytes());
        for (c, parity) in rest.iter().zip(&parities[1..]) {
            harmonics.extend(c.map(|c| nearest_byte(f64::from(parity * c) * 128.0 + 128.0)));
        }
    }
    planes
}

/// Rounds to the nearest whole number. The caller guarantees that it fits in 24 bits.
#[expect(clippy::cast_possible_truncation, reason = "it has 24 bits")]
fn fixed_point(x: f64) -> i32 {
    x.round() as i32
}

/// Encodes the rotation nearest to the unit quaternion `x y z w`. If two components are about
/// equally large, either may be omitted, and possibly only one choice is exact.
fn packed_rotation(rotation: [f64; 4]) -> u32 {
    let largest = rotation.iter().fold(0.0, |l: f64, c| c.abs().max(l));
    let candidates = (0..4).filter(|&k| rotation[k].abs() > largest - STEP);
    let words = candidates.map(|k| packed_without(rotation, k));
    let off = |word: &u32| {
        let read = smallest_three(*word).map(f64::from);
        let product: f64 = read.iter().zip(rotation).map(|(a, b)| a * b).sum();
        let sign = if product < 0.0 { -1.0 } else { 1.0 };
        read.iter().zip(rotation).map(|(a, b)| (sign * a - b).powi(2)).sum::<f64>()
    };
    words.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or_default()
}

/// The step between two values of a component.
const STEP: f64 = FRAC_1_SQRT_2 / 511.0;

#[expect(clippy::cast_possible_truncation, reason = "an index of four")]
fn packed_without(rotation: [f64; 4], left_out: usize) -> u32 {
    // A quaternion and its negative are one rotation, so the omitted component can be made
    // positive.
    let others = (0..4_usize).filter(|&k| k != left_out).map(|k| rotation[k] * rotation[left_out].signum());
    others.fold(left_out as u32, |word, c| {
        let magnitude = u32::from(nearest_magnitude(c.abs() / STEP));
        // A zero has no sign, so that equal rotations are equal words.
        word << 10 | u32::from(c < 0.0 && magnitude > 0) << 9 | magnitude
    })
}

/// Rounds to the nearest whole number, at most 511.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
fn nearest_magnitude(x: f64) -> u16 {
    x.round().clamp(0.0, 511.0) as u16
}
