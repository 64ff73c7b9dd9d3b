//! Scenes as `.splat` files (antimatter15/splat): 32 bytes per Gaussian, no header, no harmonics
//! above degree 0.
//!
//! A record contains three floats of position, three of standard deviation (linear), red, green,
//! blue and opacity as bytes of the displayed colour, and the quaternion `w x y z` as bytes
//! `(b - 128) / 128`; all little endian.
//!
//! # Examples
//!
//! ```
//! use gs2e_scene::splat;
//!
//! let position = [1.5_f32, 0.0, -2.0];
//! let deviations = [1.0_f32; 3];
//! let floats = position.into_iter().chain(deviations).flat_map(f32::to_le_bytes);
//! let (colour, quaternion) = ([255, 255, 255, 128], [255, 128, 128, 128]);
//! let bytes: Vec<u8> = floats.chain(colour).chain(quaternion).collect();
//! let scene = splat::read_splat(&bytes)?;
//! assert_eq!(scene.positions, [position]);
//! // The logarithm of 1, and 127/128.
//! assert_eq!((scene.log_scales[0], scene.rotations[0][0]), ([0.0; 3], 0.992_187_5));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::collector::{Gaussian, GaussianCollector};
use super::cursor::ByteCursor;
use super::opacity::{byte_of_logit, logit_of_byte};
use super::rotation::unit_quaternion;
use super::{Gaussians, SceneError, nearest_byte, sh};
use glam::DVec3;
use std::io::{self, BufWriter, Write};

const RECORD_LEN: usize = 32;

/// Reads a `.splat` scene. A standard deviation of zero, a flat Gaussian, becomes the smallest
/// normal number, whose logarithm is finite.
///
/// # Errors
/// Returns a [`SceneError`] if the length is not a multiple of 32 bytes or no finite Gaussian is
/// left.
pub fn read_splat(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    let mut cursor = ByteCursor::new(".splat", bytes);
    let count = bytes.len() / RECORD_LEN;
    let mut collector = GaussianCollector::new(0, count)?;
    for _ in 0..count {
        push_record(cursor.array("a record")?, &mut collector);
    }
    // A rest is shorter than a record, which `take` reports.
    if !cursor.rest().is_empty() {
        cursor.take(RECORD_LEN, "a record")?;
    }
    collector.finish(DVec3::ZERO, None)
}

/// Writes `scene` as `.splat`, with every number rounded to the nearest value of the format.
/// Harmonics above degree 0 and the flag of antialiasing are omitted.
///
/// # Errors
/// Writing to `out` fails.
pub(crate) fn write_splat(scene: &Gaussians, out: impl Write) -> io::Result<()> {
    let mut out = BufWriter::new(out);
    for i in 0..scene.len() {
        out.write_all(&splat_record(scene, i))?;
    }
    out.flush()
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits of the format")]
fn splat_record(scene: &Gaussians, i: usize) -> [u8; RECORD_LEN] {
    let mut record = [0; RECORD_LEN];
    let position = scene.position(i).to_array().map(|x| x as f32);
    let floats = position.into_iter().chain(scene.log_scales[i].map(libm::expf));
    for (place, x) in record.chunks_exact_mut(4).zip(floats) {
        place.copy_from_slice(&x.to_le_bytes());
    }
    let colour = scene.sh_of(i)[0].map(|c| nearest_byte((0.5 + sh::C0 * f64::from(c)) * 255.0));
    record[24..27].copy_from_slice(&colour);
    record[27] = byte_of_logit(scene.opacity_logits[i]);
    // The byte 128 is 0, and 1 is clamped to 127/128.
    record[28..]
        .copy_from_slice(&unit_quaternion(scene.rotations[i]).map(|c| nearest_byte(c * 128.0 + 128.0)));
    record
}

fn push_record(record: [u8; RECORD_LEN], collector: &mut GaussianCollector) {
    let float = |k: usize| {
        f32::from_le_bytes([record[4 * k], record[4 * k + 1], record[4 * k + 2], record[4 * k + 3]])
    };
    collector.push(&Gaussian {
        position: [0, 1, 2].map(float),
        log_scale: [3, 4, 5].map(|k| log_scale(float(k))),
        rotation: [28, 29, 30, 31].map(|k| (f32::from(record[k]) - 128.0) / 128.0),
        opacity_logit: logit_of_byte(record[27]),
        sh: &[[24, 25, 26].map(|k| byte_coefficient(record[k]))],
    });
}

fn log_scale(deviation: f32) -> f32 {
    libm::logf(if deviation == 0.0 { f32::MIN_POSITIVE } else { deviation })
}

/// Returns the coefficient of degree 0 for the colour `byte / 255`.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
fn byte_coefficient(byte: u8) -> f32 {
    ((f64::from(byte) / 255.0 - 0.5) / sh::C0) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn splat_record(floats: [f32; 6], rgba: [u8; 4], rotation: [u8; 4]) -> Vec<u8> {
        let mut bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
        bytes.extend(rgba);
        bytes.extend(rotation);
        bytes
    }

    fn two() -> Vec<u8> {
        [
            splat_record(
                [1.0, -2.0, 0.5, 1.0, std::f32::consts::E, 0.0],
                [255, 0, 51, 255],
                [255, 128, 0, 64],
            ),
            splat_record([0.0, 0.25, 8.0, 0.1, 0.1, 0.1], [128, 128, 128, 0], [128, 128, 128, 128]),
        ]
        .concat()
    }

    #[test]
    fn records_are_read_field_by_field() {
        let scene = read_splat(&two()).unwrap();
        assert_eq!(scene.positions, [[1.0, -2.0, 0.5], [0.0, 0.25, 8.0]]);
        assert_eq!(scene.rotations, [[0.992_187_5, 0.0, -1.0, -0.5], [0.0; 4]]);
        assert_eq!((scene.sh_degree, scene.antialiased), (0, None));
        assert_eq!((scene.screening.read, scene.screening.zero_quaternions), (2, 1));
        let near = |got: f32, wanted: f32| assert!((got - wanted).abs() <= 1e-6 * wanted.abs(), "{got}");
        near(scene.log_scales[0][1], 1.0);
        near(scene.log_scales[0][2], -87.336_54); // ln of 2^-126
        near(scene.log_scales[1][0], -std::f32::consts::LN_10);
        near(scene.sh[0][0], 1.772_453_9); // sqrt(pi): 0.5 / C0
        near(scene.sh[0][2], -1.063_472_3); // (0.2 - 0.5) / C0
        near(scene.opacity_logits[0], 6.232_448); // ln 509
        near(scene.opacity_logits[1], -6.232_448);
    }

    #[test]
    fn every_truncation_is_an_error() {
        let whole = two();
        for len in (0..whole.len()).filter(|len| len % 32 != 0) {
            let error = read_splat(&whole[..len]).unwrap_err().to_string();
            let wanted = format!(
                "read .splat at byte {}: found {} bytes before the end, wanted 32 bytes of a record",
                len / 32 * 32,
                len % 32
            );
            assert_eq!(error, wanted);
        }
        assert!(read_splat(&[]).is_err());
    }

    #[test]
    fn gaussians_that_are_not_finite_are_dropped_and_counted() {
        for (field, bad) in [(0, f32::NAN), (2, f32::INFINITY), (3, f32::NAN), (5, -1.0)] {
            let mut bytes = two();
            bytes[4 * field..4 * field + 4].copy_from_slice(&bad.to_le_bytes());
            let scene = read_splat(&bytes).unwrap();
            assert_eq!((scene.len(), scene.screening.non_finite), (1, 1), "{bad} in field {field}");
        }
    }
}
