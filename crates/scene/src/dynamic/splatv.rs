//! Scenes with tracks as `.splatv` files (antimatter15/splaTV): 64 bytes per Gaussian.
//!
//! ```text
//! u32 0x674b, u32 length of a JSON array of chunks { type, size, … }, the array, the chunks
//! chunk `splat`, per Gaussian: f32 x y z; f16 quaternion w x y z, standard deviations (linear) and 0;
//!     u8 red, green, blue, opacity; f16 motion_0..8 and 0; f16 omega_0..3; f16 centre, width (linear)
//! ```
//! All little endian. A texture has more places than Gaussians; those at the end are zero and no Gaussians.
//! Colours are those of the display. Other chunks are skipped.
//!
//! # Examples
//!
//! ```
//! use gs2e_scene::dynamic::splatv::{MAGIC, read_splatv};
//!
//! let mut record = [0_u8; 64];
//! // The upper byte of 1.0 in 16 bits: w of the quaternion, the standard deviations, the width in time.
//! [12, 20, 22, 24, 62].map(|place| record[place + 1] = 0x3c);
//! let list = br#"[{"type":"splat","size":64}]"#;
//! let file = [&MAGIC[..], &u32::try_from(list.len())?.to_le_bytes(), list, &record].concat();
//! let (scene, tracks) = read_splatv(&file)?;
//! assert_eq!(scene.rotations, [[1.0, 0.0, 0.0, 0.0]]);
//! // The logarithm of 1.
//! assert_eq!((scene.log_scales[0], tracks[0].log_width), ([0.0; 3], 0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::SplatTrack;
use crate::collector::{Gaussian, GaussianCollector};
use crate::cursor::ByteCursor;
use crate::opacity::logit_of_byte;
use crate::{Gaussians, SceneError, sh};
use glam::DVec3;
use gs2e_files::budget::try_with_room;
use serde::Deserialize;

/// The first bytes of a file.
pub const MAGIC: [u8; 4] = [0x4b, 0x67, 0, 0];

const RECORD_LEN: usize = 64;

/// A chunk of a file; other fields are ignored.
#[derive(Debug, Deserialize)]
struct ChunkHead {
    #[serde(rename = "type")]
    kind: String,
    size: usize,
}

/// Reads a scene and the track of each of its Gaussians. A Gaussian is dropped and counted if a value is not
/// finite, or a standard deviation or its width in time is 0.
///
/// # Errors
/// Returns a [`SceneError`] if the bytes do not follow the format or no Gaussian is left.
pub fn read_splatv(bytes: &[u8]) -> Result<(Gaussians, Vec<SplatTrack>), SceneError> {
    let mut cursor = ByteCursor::new(".splatv", bytes);
    cursor.array::<4>("signature")?;
    let length = cursor.u32("the length of the list of chunks")? as usize;
    let at = cursor.clone();
    let list = cursor.take(length, "the list of chunks")?;
    let chunks: Vec<ChunkHead> = serde_json::from_slice(list)
        .map_err(|e| at.malformed(format!("{e}"), "a JSON array of chunks with `type` and `size`"))?;
    let mut records = None;
    for ChunkHead { kind, size } in &chunks {
        let own = cursor.take(*size, &format!("the chunk `{}`", kind.escape_debug()))?;
        if kind == "splat" {
            records = Some(own);
        }
    }
    cursor.end()?;
    let Some(records) = records else {
        return Err(at.malformed(format!("{} chunks", chunks.len()), "a chunk of the type `splat`"));
    };
    let (records, rest) = records.as_chunks::<RECORD_LEN>();
    if !rest.is_empty() {
        let found = format!("{} bytes after {} records", rest.len(), records.len());
        return Err(at.malformed(found, "records of 64 bytes"));
    }
    let count =
        records.iter().rposition(|record| record.iter().any(|byte| *byte != 0)).map_or(0, |last| last + 1);
    let mut collector = GaussianCollector::new(0, count)?;
    let mut tracks = try_with_room(count)?;
    for record in &records[..count] {
        let track = track_of(record);
        if push_record(record, &track, &mut collector) {
            tracks.push(track);
        }
    }
    Ok((collector.finish(DVec3::ZERO, None)?, tracks))
}

fn push_record(record: &[u8; RECORD_LEN], track: &SplatTrack, collector: &mut GaussianCollector) -> bool {
    let float = |k: usize| f32::from_le_bytes([record[k], record[k + 1], record[k + 2], record[k + 3]]);
    let colour = [28, 29, 30].map(|k| coefficient_of_byte(record[k]));
    // The collector sees no track. NaN makes it drop and count a Gaussian whose track is not finite.
    let logit = if track.is_finite() { logit_of_byte(record[31]) } else { f32::NAN };
    collector.push(&Gaussian {
        position: [0, 4, 8].map(float),
        log_scale: [20, 22, 24].map(|k| logarithm(half_at(record, k))),
        rotation: [12, 14, 16, 18].map(|k| half_at(record, k)),
        opacity_logit: logit,
        sh: &[colour],
    })
}

fn track_of(record: &[u8; RECORD_LEN]) -> SplatTrack {
    let half = |k: usize| half_at(record, 32 + 2 * k);
    SplatTrack {
        motion: [[half(0), half(1), half(2)], [half(3), half(4), half(5)], [half(6), half(7), half(8)]],
        omega: [half(10), half(11), half(12), half(13)],
        centre: half(14),
        log_width: logarithm(half(15)),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "scenes hold 32 bits")]
fn logarithm(value: f32) -> f32 {
    libm::log(f64::from(value)) as f32
}

/// The coefficient of a constant with this colour.
#[expect(clippy::cast_possible_truncation, reason = "scenes hold 32 bits")]
fn coefficient_of_byte(byte: u8) -> f32 {
    ((f64::from(byte) / 255.0 - 0.5) / sh::C0) as f32
}

/// The number of 16 bits (IEEE binary16) at an offset. Widening is exact.
fn half_at(record: &[u8; RECORD_LEN], offset: usize) -> f32 {
    let bits = u16::from_le_bytes([record[offset], record[offset + 1]]);
    let (exponent, fraction) = (bits >> 10 & 31, f32::from(bits & 1023));
    let magnitude = match exponent {
        // Subnormal numbers have no leading 1, which the last arm adds as 1024.
        0 => fraction * 2_f32.powi(-24),
        31 if bits & 1023 == 0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1024.0 + fraction) * 2_f32.powi(i32::from(exponent) - 25),
    };
    if bits >> 15 == 1 { -magnitude } else { magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_widened_exactly() {
        let t = |bits: u16, wanted: f32| {
            let mut record = [0; RECORD_LEN];
            record[6..8].copy_from_slice(&bits.to_le_bytes());
            assert_eq!(half_at(&record, 6).to_bits(), wanted.to_bits(), "{bits:#x}");
        };
        t(0x0000, 0.0);
        t(0x8000, -0.0);
        t(0x3c00, 1.0);
        t(0xc580, -5.5);
        t(0x3555, 0.333_251_95);
        t(0x0001, 5.960_464_5e-8);
        t(0x7bff, 65_504.0);
        t(0x7c00, f32::INFINITY);
        let mut record = [0; RECORD_LEN];
        record[..2].copy_from_slice(&0x7e01_u16.to_le_bytes());
        assert!(half_at(&record, 0).is_nan());
    }

    #[test]
    fn faults_are_named() {
        let t = |bytes: &[u8], wanted: &str| {
            let error = read_splatv(bytes).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        let file = |list: &str, body: usize| {
            let length = u32::try_from(list.len()).unwrap().to_le_bytes();
            [&MAGIC[..], &length, list.as_bytes(), &vec![0; body]].concat()
        };
        t(&MAGIC, "wanted 4 bytes of the length of the list of chunks");
        t(&file("{}", 0), "wanted a JSON array of chunks with `type` and `size`");
        t(&file("[]", 0), "found 0 chunks, wanted a chunk of the type `splat`");
        t(&file(r#"[{"type":"splat","size":128}]"#, 64), "wanted 128 bytes of the chunk `splat`");
        t(
            &file(r#"[{"type":"splat","size":65}]"#, 65),
            "found 1 bytes after 1 records, wanted records of 64 bytes",
        );
        t(&file(r#"[{"type":"splat","size":64}]"#, 64), "find a Gaussian to render: of 0 in the scene");
    }
}
