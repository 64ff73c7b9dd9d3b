//! The planes of a `.spz` file and the Gaussians in them.

use super::{AxisFlip, SpzHeader};
use crate::collector::{Gaussian, GaussianCollector};
use crate::opacity::logit_of_byte;
use crate::sh;
use std::f32::consts::FRAC_1_SQRT_2;

/// Number of planes.
pub(super) const COUNT: usize = 6;
/// Names of the planes, in file order.
pub(super) const NAMES: [&str; COUNT] =
    ["positions", "opacities", "colours", "scales", "rotations", "harmonics"];

/// The bytes of the planes, each of the length that the header determines.
#[derive(Debug)]
pub(super) struct AttributePlanes(pub(super) [Vec<u8>; COUNT]);

impl AttributePlanes {
    /// Adds every Gaussian to `collector`.
    pub(super) fn collect(&self, header: &SpzHeader, flip: AxisFlip, collector: &mut GaussianCollector) {
        let [positions, opacities, colours, scales, rotations, harmonics] = &self.0;
        let signs = QuaternionSigns::for_flip(flip);
        let unit = 1.0 / (1_u32 << header.fractional_bits) as f32;
        // Three bytes in version 2, four from version 3 on. A file of no Gaussians has no bytes at
        // all.
        let rotation_len = rotations.len() / header.count.max(1);
        let rest_len = sh::function_count(header.sh_degree) - 1;
        let mut coefficients = vec![[0.0; 3]; rest_len + 1];
        for (i, &opacity) in opacities.iter().enumerate() {
            coefficients[0] = three_bytes(colours, i).map(|b| (f32::from(b) / 255.0 - 0.5) / COLOUR_SCALE);
            for k in 0..rest_len {
                let sign = signs.harmonics[k + 1];
                coefficients[k + 1] =
                    three_bytes(harmonics, i * rest_len + k).map(|b| sign * ((f32::from(b) - 128.0) / 128.0));
            }
            collector.push(&Gaussian {
                position: decode_position(&positions[9 * i..9 * i + 9], unit, signs.position),
                // Sixteenths from -10 on (nianticlabs/spz, `load-spz.cc`).
                log_scale: three_bytes(scales, i).map(|b| f32::from(b) / 16.0 - 10.0),
                rotation: decode_rotation(
                    &rotations[rotation_len * i..rotation_len * (i + 1)],
                    signs.rotation,
                ),
                opacity_logit: logit_of_byte(opacity),
                sh: &coefficients,
            });
        }
    }
}

/// Colours are stored as `0.5 + COLOUR_SCALE * coefficient`. The scale leaves room beyond black and
/// white.
pub(super) const COLOUR_SCALE: f32 = 0.15;

/// Signs by which the change of axes multiplies positions, quaternions and harmonics.
struct QuaternionSigns {
    position: [f32; 3],
    rotation: [f32; 3],
    harmonics: [f32; sh::MAX_LEN],
}

impl QuaternionSigns {
    fn for_flip(flip: AxisFlip) -> Self {
        Self { position: flip.of_position(), rotation: flip.of_rotation(), harmonics: flip.of_harmonics() }
    }
}

fn three_bytes(plane: &[u8], i: usize) -> [u8; 3] {
    [plane[3 * i], plane[3 * i + 1], plane[3 * i + 2]]
}

/// Decodes three 24-bit numbers in units of `unit`, a power of two. The result is exact in 32 bits.
fn decode_position(bytes: &[u8], unit: f32, signs: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|k| {
        // Read into the high bytes and shifted down, which extends the sign of the 24 bits.
        let [low, mid, high] = three_bytes(bytes, k);
        let fixed = i32::from_le_bytes([0, low, mid, high]) >> 8;
        signs[k] * (fixed as f32 * unit)
    })
}

/// Decodes the quaternion `w x y z` from three bytes (version 2) or four (from version 3 on).
fn decode_rotation(bytes: &[u8], signs: [f32; 3]) -> [f32; 4] {
    let [x, y, z, w] = match *bytes {
        [x, y, z] => first_three([x, y, z]),
        [a, b, c, d] => smallest_three(u32::from_le_bytes([a, b, c, d])),
        _ => unreachable!("the header fixes three or four bytes a rotation"),
    };
    [w, signs[0] * x, signs[1] * y, signs[2] * z]
}

/// Decodes `x, y, z` from bytes of -1..1. `w` is not negative and completes the unit quaternion.
fn first_three(xyz: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = xyz.map(|b| f32::from(b) / 127.5 - 1.0);
    [x, y, z, (1.0 - (x * x + y * y + z * z)).max(0.0).sqrt()]
}

/// Decodes a quaternion without its largest component. From the lowest bits up, the word contains
/// the other components of `w, z, y, x`, each with nine bits of magnitude in units of
/// `sqrt(1/2) / 511` and a sign. The last two bits are the index of the largest component in
/// `x y z w`.
pub(super) fn smallest_three(mut packed: u32) -> [f32; 4] {
    let largest = (packed >> 30) as usize;
    let mut components = [0.0; 4];
    let mut squares = 0.0;
    for i in (0..4).rev().filter(|&i| i != largest) {
        let magnitude = FRAC_1_SQRT_2 * (packed & 511) as f32 / 511.0;
        components[i] = if packed & 512 != 0 { -magnitude } else { magnitude };
        squares += magnitude * magnitude;
        packed >>= 10;
    }
    components[largest] = (1.0_f32 - squares).max(0.0).sqrt();
    components
}
