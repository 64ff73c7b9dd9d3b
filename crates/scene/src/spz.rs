//! Scenes as `.spz` files (nianticlabs/spz): versions 2, 3 and 4 are read, version 3 is written.
//!
//! Versions 2 and 3 are one gzip stream of a header and the planes (positions, opacities, colours,
//! scales, rotations, harmonics). Version 4 is a plain header, a table of sizes, and one zstd
//! stream per plane. All values are quantised to bytes. Axes are right, up, back unless an
//! extension states others; they are converted to the axes of `.ply`.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! use gs2e_scene::spz;
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [1.0, 2.0, -3.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! // `scene` has a Gaussian at [1, 2, -3], whose scales have the logarithm -1.
//! let mut bytes = Vec::new();
//! spz::write_spz(&scene, &mut bytes)?;
//! let read = spz::read_spz(&bytes)?;
//! // Positions have steps of a power of 2, and logarithms of 1/16, so these numbers are exact.
//! assert_eq!((read.positions, read.log_scales), (scene.positions, scene.log_scales));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod axes;
mod container;
mod planes;
mod write;

use super::collector::GaussianCollector;
use super::cursor::ByteCursor;
use super::{Gaussians, SceneError, sh};
use axes::AxisFlip;
use glam::DVec3;
pub(super) use write::fractional_bits;
pub use write::write_spz;

/// First bytes of a version 4 file, and of the decompressed content of earlier versions.
pub const MAGIC: [u8; 4] = *b"NGSP";
/// First bytes of a gzip stream.
pub(crate) const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Reads a `.spz` scene of version 2, 3 or 4 and harmonics of degree 0 to 3.
///
/// # Errors
/// Returns a [`SceneError`] if the bytes are not a `.spz` file of these versions and degrees.
pub fn read_spz(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    if bytes.starts_with(&GZIP_MAGIC) { container::read_gzip(bytes) } else { container::read_zstd(bytes) }
}

/// Maximum number of fractional bits of a position.
const MAX_FRACTIONAL_BITS: u8 = 24;

/// The common part of the header of all versions.
#[derive(Debug, Clone, Copy)]
struct SpzHeader {
    version: u32,
    count: usize,
    sh_degree: u8,
    fractional_bits: u8,
    antialiased: bool,
    has_extensions: bool,
}

impl SpzHeader {
    /// Reads the 15 bytes that all versions share.
    fn read(cursor: &mut ByteCursor) -> Result<Self, SceneError> {
        let at = cursor.clone();
        let magic: [u8; 4] = cursor.array("signature")?;
        if magic != MAGIC {
            return Err(at.malformed(format!("the bytes {magic:02x?}"), "the signature `NGSP`"));
        }
        let at = cursor.clone();
        let version = cursor.u32("version")?;
        if version == 1 {
            return Err(at.unsupported("version 1 (half floats)", "convert it with a current spz tool"));
        }
        if !(2..=4).contains(&version) {
            return Err(at.malformed(format!("version {version}"), "version 2, 3 or 4"));
        }
        let count = cursor.u32("the number of Gaussians")? as usize;
        let (sh_degree, fractional_bits) = read_layout(cursor)?;
        let at = cursor.clone();
        let [flags] = cursor.array("flags")?;
        // An unknown flag may change the meaning of the planes.
        if flags & !3 != 0 {
            return Err(
                at.unsupported(format!("the flags byte {flags:#04x}"), "only flags 1 and 2 are known")
            );
        }
        let (antialiased, has_extensions) = (flags & 1 != 0, flags & 2 != 0);
        Ok(Self { version, count, sh_degree, fractional_bits, antialiased, has_extensions })
    }

    /// Returns the lengths of the planes in bytes.
    fn plane_lens(&self) -> [usize; planes::COUNT] {
        let rotation = if self.version == 2 { 3 } else { 4 };
        [9, 1, 3, 3, rotation, 3 * (sh::function_count(self.sh_degree) - 1)].map(|bytes| bytes * self.count)
    }

    fn scene(&self, planes: &planes::AttributePlanes, flip: AxisFlip) -> Result<Gaussians, SceneError> {
        let mut collector = GaussianCollector::new(self.sh_degree, self.count)?;
        planes.collect(self, flip, &mut collector);
        collector.finish(DVec3::ZERO, Some(self.antialiased))
    }
}

/// Reads the degree of the harmonics and the fractional bits of the positions.
fn read_layout(cursor: &mut ByteCursor) -> Result<(u8, u8), SceneError> {
    let at = cursor.clone();
    let [sh_degree] = cursor.array("degree of the harmonics")?;
    if sh_degree == 4 {
        return Err(at.unsupported("degree 4 of the spherical harmonics", "convert the scene to degree 3"));
    }
    if sh_degree > sh::MAX_DEGREE {
        return Err(at.malformed(format!("degree {sh_degree}"), "a degree of 0 to 3"));
    }
    let at = cursor.clone();
    let [bits] = cursor.array("fractional bits")?;
    if bits > MAX_FRACTIONAL_BITS {
        return Err(at.malformed(format!("{bits} fractional bits"), format!("at most {MAX_FRACTIONAL_BITS}")));
    }
    Ok((sh_degree, bits))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::FRAC_1_SQRT_2;
    use std::io::Write;

    /// Two Gaussians of degree 1 as planes of bytes; `rotations` has the encoding of the version.
    fn planes(rotations: &[u8]) -> [Vec<u8>; planes::COUNT] {
        [
            // 1, -0.5, 2.25 and 0, 0, -2048 in units of 2^-12
            vec![0x00, 0x10, 0x00, 0x00, 0xf8, 0xff, 0x00, 0x24, 0x00, 0, 0, 0, 0, 0, 0, 0x00, 0x00, 0x80],
            vec![255, 51],
            vec![0, 255, 128, 102, 153, 204],
            vec![160, 0, 255, 16, 32, 48],
            rotations.to_vec(),
            vec![192, 128, 64, 0, 160, 128, 255, 128, 96, 128, 128, 128, 128, 128, 128, 128, 128, 128],
        ]
    }

    /// `x` of 3/5 and `y` of -3/5; then `z` of -1.
    const ROTATIONS_2: [u8; 6] = [204, 51, 127, 127, 127, 0];
    /// `w` largest, `x` of 511, `y` of -256; then `x` largest, `y` of 0, `z` of -1 and `w` of 511.
    const ROTATIONS_3: [u32; 2] = [3 << 30 | 511 << 20 | (512 | 256) << 10, (512 | 1) << 10 | 511];

    fn rotations_3() -> Vec<u8> {
        ROTATIONS_3.iter().flat_map(|r| r.to_le_bytes()).collect()
    }

    fn header(version: u8, count: u32, degree: u8, last: [u8; 2]) -> Vec<u8> {
        let mut bytes = b"NGSP".to_vec();
        bytes.extend([version, 0, 0, 0]);
        bytes.extend(count.to_le_bytes());
        bytes.extend([degree, 12]);
        bytes.extend(last);
        bytes
    }

    fn gzip(content: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    fn legacy(version: u8, rotations: &[u8]) -> Vec<u8> {
        gzip(&[header(version, 2, 1, [1, 0]), planes(rotations).concat()].concat())
    }

    fn zstd_file(degree: u8, flags: u8, extensions: &[u8], planes: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = header(4, 2, degree, [flags, u8::try_from(planes.len()).unwrap()]);
        bytes.extend(u32::try_from(32 + extensions.len()).unwrap().to_le_bytes());
        bytes.extend([0; 12]);
        bytes.extend(extensions);
        let streams: Vec<Vec<u8>> = planes.iter().map(|p| zstd::encode_all(&p[..], 3).unwrap()).collect();
        for (plane, stream) in planes.iter().zip(&streams) {
            bytes.extend((stream.len() as u64).to_le_bytes());
            bytes.extend((plane.len() as u64).to_le_bytes());
        }
        bytes.extend(streams.concat());
        bytes
    }

    fn near(got: &[f32], wanted: &[f32]) {
        for (g, w) in got.iter().zip(wanted) {
            // The wanted values have seven digits.
            assert!((g - w).abs() <= 2e-6 * w.abs().max(0.1), "{got:?} for {wanted:?}");
        }
    }

    fn check_all_but_rotations(scene: &Gaussians) {
        assert_eq!(scene.positions, [[1.0, 0.5, -2.25], [0.0, -0.0, 2048.0]]);
        assert_eq!(scene.log_scales, [[0.0, -10.0, 5.9375], [-9.0, -8.0, -7.0]]);
        near(&scene.opacity_logits, &[6.232_448, -1.386_294_4]); // ln 509, ln 1/4
        near(&scene.sh[0], &[-3.333_333_3, 3.333_333_3, 0.013_071_9]);
        near(&scene.sh[4], &[-0.666_666_7, 0.666_666_7, 2.0]);
        // The functions in y and z change sign; the function in x does not.
        assert_eq!(scene.sh[1..4], [[-0.5, 0.0, 0.5], [1.0, -0.25, 0.0], [0.992_187_5, 0.0, -0.25]]);
        assert_eq!((scene.sh_degree, scene.antialiased, scene.screening.read), (1, Some(true), 2));
    }

    #[test]
    fn version_2_is_read() {
        let scene = read_spz(&legacy(2, &ROTATIONS_2)).unwrap();
        check_all_but_rotations(&scene);
        // y and z change sign; 127 encodes -1/255; w = sqrt(1 - 0.36 - 0.36 - 1/65025).
        near(&scene.rotations[0], &[0.529_135_9, 0.6, 0.6, 0.003_921_57]);
        near(&scene.rotations[1], &[0.0, -0.003_921_57, 0.003_921_57, 1.0]);
    }

    #[test]
    fn versions_3_and_4_are_read() {
        let files = [legacy(3, &rotations_3()), zstd_file(1, 1, &[], &planes(&rotations_3()))];
        for scene in files.map(|bytes| read_spz(&bytes).unwrap()) {
            check_all_but_rotations(&scene);
            // 256/511 sqrt(1/2) = 0.3542454; sqrt(1 - 1/2 - 0.1254898) = 0.6119724
            near(&scene.rotations[0], &[0.611_972_4, FRAC_1_SQRT_2, 0.354_245_4, 0.0]);
            // 1/511 sqrt(1/2) = 0.0013837708; sqrt(1/2 - 1.9148e-6) = 0.7071054
            near(&scene.rotations[1], &[FRAC_1_SQRT_2, 0.707_105_4, 0.0, 0.001_383_770_8]);
        }
    }

    #[test]
    fn harmonics_of_degree_0_have_no_stream() {
        let scene = read_spz(&zstd_file(0, 0, &[], &planes(&rotations_3())[..5])).unwrap();
        assert_eq!((scene.sh_degree, scene.sh.len(), scene.antialiased), (0, 2, Some(false)));
    }

    #[test]
    fn an_extension_may_name_other_axes() {
        let mut extension = 0xADBE_0003_u32.to_le_bytes().to_vec();
        extension.extend([4, 0, 0, 0, 6, 0, 0, 0]);
        let v4 = zstd_file(1, 2, &extension, &planes(&rotations_3()));
        let content = [header(3, 2, 1, [2, 0]), planes(&rotations_3()).concat(), extension];
        for bytes in [v4, gzip(&content.concat())] {
            let scene = read_spz(&bytes).unwrap();
            assert_eq!(scene.positions[..1], [[1.0, -0.5, 2.25]]);
            near(&scene.rotations[0], &[0.611_972_4, FRAC_1_SQRT_2, -0.354_245_4, 0.0]);
        }
    }

    #[test]
    fn every_truncation_is_an_error() {
        for whole in [legacy(2, &ROTATIONS_2), zstd_file(1, 1, &[], &planes(&rotations_3()))] {
            for len in 0..whole.len() {
                assert!(read_spz(&whole[..len]).is_err(), "{len} of {} bytes", whole.len());
            }
        }
    }

    #[test]
    fn errors_say_what_was_found_and_wanted() {
        let t = |bytes: &[u8], message: &str| {
            let error = read_spz(bytes).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        };
        let content = |version, degree, last| [header(version, 2, degree, last), vec![0; 99]].concat();
        t(&gzip(&content(1, 0, [0, 0])), "at byte 4: version 1 (half floats) is not supported");
        t(&gzip(&content(5, 0, [0, 0])), "at byte 4: found version 5, wanted version 2, 3 or 4");
        t(&gzip(&content(4, 0, [0, 0])), "found version 4 within gzip");
        t(&gzip(&content(2, 4, [0, 0])), "at byte 12: degree 4 of the spherical harmonics is not supported");
        t(&gzip(&content(2, 7, [0, 0])), "at byte 12: found degree 7");
        t(&gzip(&content(2, 0, [0x80, 0])), "at byte 14: the flags byte 0x80 is not supported");
        t(&gzip(&content(2, 0, [0, 0])), "at byte 54: found more bytes, wanted the end of the data");
        t(&gzip(b"ply\n............"), "found the bytes [70, 6c, 79, 0a], wanted the signature `NGSP`");
        t(&content(2, 0, [0, 0]), "found version 2 without gzip");
        let good = zstd_file(1, 1, &[], &planes(&rotations_3()));
        let changed = |at: usize, byte: u8| {
            let mut bytes = good.clone();
            bytes[at] = byte;
            bytes
        };
        t(&changed(15, 5), "found 5 streams, wanted 6 streams at degree 1");
        t(&changed(16, 31), "at byte 16: found a table at byte 31, wanted an offset after the header");
        t(&changed(40, 19), "at byte 40: found 19 bytes of positions, wanted 18 bytes");
        t(&changed(11, 1), "found 16777218 Gaussians in");
        t(&changed(13, 25), "at byte 13: found 25 fractional bits");
        t(&[&good[..], &[0]].concat(), "found 1 more bytes, wanted the end of the data");
        let mut short = planes(&rotations_3());
        short[0].push(0);
        let mut long = zstd_file(1, 1, &[], &short);
        long[40] = 18;
        t(&long, "found more than 18 bytes of positions");
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig {
            failure_persistence: None, ..proptest::prelude::ProptestConfig::with_cases(500)
        })]

        #[test]
        fn damage_never_panics(at in 0_usize..1000, byte: u8, version in 2_u8..=4) {
            let mut bytes = match version {
                2 => legacy(2, &ROTATIONS_2),
                3 => legacy(3, &rotations_3()),
                _ => zstd_file(1, 1, &[], &planes(&rotations_3())),
            };
            let at = at % bytes.len();
            bytes[at] = byte;
            let _ = read_spz(&bytes);
        }
    }
}
