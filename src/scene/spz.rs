//! Scenes as `.spz` files (nianticlabs/spz), versions 2, 3 and 4.
//!
//! Versions 2 and 3 are one gzip stream of a header and the planes (positions, opacities, colours, scales, rotations,
//! harmonics); version 4 is a plain header, a table of sizes, and one zstd stream a plane. Everything is quantised
//! to bytes. Axes are right, up, back unless an extension says otherwise; they are turned into those of `.ply`.

mod axes;
mod container;
mod planes;

use super::collector::Collector;
use super::cursor::Cursor;
use super::{Gaussians, SceneError, sh};
use axes::Flip;
use glam::DVec3;

/// First bytes of a version 4 file, and of the gzipped content of the versions before it.
pub const MAGIC: [u8; 4] = *b"NGSP";
/// First bytes of a gzip stream.
pub const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Reads a `.spz` scene of version 2, 3 or 4 and harmonics of degree 0 to 3.
///
/// # Errors
/// [`SceneError`] where the bytes are no such file.
pub fn read_spz(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    if bytes.starts_with(&GZIP_MAGIC) { container::read_gzip(bytes) } else { container::read_zstd(bytes) }
}

/// What all versions say first.
#[derive(Debug, Clone, Copy)]
struct Header {
    version: u32,
    count: usize,
    sh_degree: u8,
    fractional_bits: u8,
    antialiased: bool,
    has_extensions: bool,
}

impl Header {
    /// Reads the 15 bytes that all versions share.
    fn read(cursor: &mut Cursor) -> Result<Self, SceneError> {
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
        if flags & !3 != 0 {
            return Err(at.unsupported(format!("the flags {flags:#04x}"), "flags 1 and 2 are known"));
        }
        let (antialiased, has_extensions) = (flags & 1 != 0, flags & 2 != 0);
        Ok(Self { version, count, sh_degree, fractional_bits, antialiased, has_extensions })
    }

    /// Lengths of the planes in bytes.
    fn plane_lens(&self) -> [usize; planes::COUNT] {
        let rotation = if self.version == 2 { 3 } else { 4 };
        [9, 1, 3, 3, rotation, 3 * (sh::len(self.sh_degree) - 1)].map(|bytes| bytes * self.count)
    }

    fn scene(&self, planes: &planes::Planes, flip: Flip) -> Result<Gaussians, SceneError> {
        let mut collector = Collector::new(self.sh_degree, self.count);
        planes.collect(self, flip, &mut collector);
        collector.finish(DVec3::ZERO, Some(self.antialiased))
    }
}

/// The degree of the harmonics and the fractional bits of the positions.
fn read_layout(cursor: &mut Cursor) -> Result<(u8, u8), SceneError> {
    let at = cursor.clone();
    let [sh_degree] = cursor.array("degree of the harmonics")?;
    if sh_degree == 4 {
        return Err(at.unsupported("spherical harmonics of degree 4", "convert the scene to degree 3"));
    }
    if sh_degree > sh::MAX_DEGREE {
        return Err(at.malformed(format!("degree {sh_degree}"), "a degree of 0 to 3"));
    }
    let at = cursor.clone();
    let [bits] = cursor.array("fractional bits")?;
    if bits > 24 {
        return Err(at.malformed(format!("{bits} fractional bits"), "at most 24"));
    }
    Ok((sh_degree, bits))
}
