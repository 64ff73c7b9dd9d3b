//! Scenes as `.splat` files (antimatter15/splat): 32 bytes a Gaussian, no header, no harmonics above degree 0.
//!
//! A record is three floats of position, three of standard deviation (linear), red, green, blue and opacity as
//! bytes of the shown colour, and the quaternion `w x y z` as bytes `(b - 128) / 128`; all little endian.

use super::collector::{Collector, Gaussian};
use super::cursor::Cursor;
use super::opacity::logit_of_byte;
use super::{Gaussians, SceneError, sh};
use glam::DVec3;

const RECORD_LEN: usize = 32;

/// Reads a `.splat` scene. A standard deviation of zero, a flat Gaussian, counts as the least normal number, whose
/// logarithm is finite.
///
/// # Errors
/// [`SceneError`] where the length is no multiple of 32 bytes or no finite Gaussian is left.
pub fn read_splat(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    let mut cursor = Cursor::new(".splat", bytes);
    let count = bytes.len() / RECORD_LEN;
    let mut collector = Collector::new(0, count);
    for _ in 0..count {
        push(cursor.array("a record")?, &mut collector);
    }
    if !cursor.rest().is_empty() {
        cursor.take(RECORD_LEN, "a record")?;
    }
    collector.finish(DVec3::ZERO, None)
}

fn push(record: [u8; RECORD_LEN], collector: &mut Collector) {
    let float = |k: usize| {
        f32::from_le_bytes([record[4 * k], record[4 * k + 1], record[4 * k + 2], record[4 * k + 3]])
    };
    collector.push(&Gaussian {
        position: [0, 1, 2].map(float),
        log_scale: [3, 4, 5].map(|k| log_scale(float(k))),
        rotation: [28, 29, 30, 31].map(|k| (f32::from(record[k]) - 128.0) / 128.0),
        opacity_logit: logit_of_byte(record[27]),
        sh: &[[24, 25, 26].map(|k| coefficient(record[k]))],
    });
}

fn log_scale(deviation: f32) -> f32 {
    libm::logf(if deviation == 0.0 { f32::MIN_POSITIVE } else { deviation })
}

/// The coefficient of degree 0 whose colour is `byte / 255`.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
fn coefficient(byte: u8) -> f32 {
    ((f64::from(byte) / 255.0 - 0.5) / sh::C0) as f32
}
