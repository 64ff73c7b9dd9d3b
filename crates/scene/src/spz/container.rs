//! The two containers of `.spz`: one gzip stream, or a table of zstd streams.

use super::SpzHeader;
use super::axes::AxisFlip;
use super::planes::{AttributePlanes, COUNT, NAMES};
use crate::cursor::ByteCursor;
use crate::{Gaussians, SceneError};
use gs2e_files::budget::ByteBudget;
use std::io::{self, Read};

const LEGACY: &str = ".spz (decompressed)";
const EXTENSIONS: &str = ".spz (extensions)";
const PLANE: &str = ".spz (decompressed plane)";
/// Maximum size of the extension records that are read, in bytes.
const MAX_EXTENSIONS: usize = 1 << 20;
/// Maximum ratio of decompressed to compressed bytes (nianticlabs/spz's own bound). A header that
/// states more Gaussians is refused before any decompression.
const MAX_RATIO: usize = 1024;

/// Reads versions 2 and 3. Offsets in errors count decompressed bytes.
pub(super) fn read_gzip(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    let mut stream = SpzStream { format: LEGACY, inner: flate2::read::GzDecoder::new(bytes), offset: 0 };
    let start = stream.take(16, "header")?;
    let mut cursor = ByteCursor::new(LEGACY, &start);
    let header = SpzHeader::read(&mut cursor)?;
    if header.version == 4 {
        return Err(cursor.malformed("version 4 within gzip", "version 2 or 3"));
    }
    bound_count(&header, bytes.len(), &cursor)?;
    if is_beyond_budget(&header, bytes.len()) {
        // A first pass keeps nothing, so that a broken file takes no memory.
        let mut trial = SpzStream { format: LEGACY, inner: flate2::read::GzDecoder::new(bytes), offset: 0 };
        trial.skip(start.len(), "header")?;
        header.plane_lens().into_iter().zip(NAMES).try_for_each(|(len, name)| trial.skip(len, name))?;
        legacy_flip(&header, &mut trial)?;
    }
    let mut planes = AttributePlanes(Default::default());
    for ((plane, len), name) in planes.0.iter_mut().zip(header.plane_lens()).zip(NAMES) {
        *plane = stream.take(len, name)?;
    }
    let flip = legacy_flip(&header, &mut stream)?;
    header.scene(&planes, flip)
}

/// Reads to the end of the stream, because gzip verifies its checksum there.
fn legacy_flip(header: &SpzHeader, stream: &mut SpzStream<impl Read>) -> Result<AxisFlip, SceneError> {
    let start = stream.offset;
    // One byte more than allowed shows that the limit is exceeded.
    let rest = stream.up_to(MAX_EXTENSIONS + 1, "extensions")?;
    let allowed = if header.has_extensions { MAX_EXTENSIONS } else { 0 };
    if rest.len() > allowed {
        let wanted = format!("the end of the data within {allowed} bytes");
        return Err(stream.malformed(start, "more bytes", wanted));
    }
    AxisFlip::from_extensions(&mut ByteCursor::new(EXTENSIONS, &rest))
}

/// Reads version 4.
pub(super) fn read_zstd(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    let mut cursor = ByteCursor::new(".spz", bytes);
    let header = SpzHeader::read(&mut cursor)?;
    if header.version != 4 {
        return Err(cursor.malformed(format!("version {} without gzip", header.version), "version 4"));
    }
    bound_count(&header, bytes.len(), &cursor)?;
    let [stream_count] = cursor.array("number of streams")?;
    let at = cursor.clone();
    let table = cursor.u32("offset of the table")? as usize;
    cursor.take(12, "reserved bytes")?;
    let Some(extensions_len) = table.checked_sub(cursor.offset()) else {
        return Err(at.malformed(format!("a table at byte {table}"), "an offset after the header"));
    };
    // Extensions lie between the header and the table.
    let extensions = cursor.take(extensions_len, "extensions")?;
    let flip = if header.has_extensions {
        AxisFlip::from_extensions(&mut ByteCursor::new(EXTENSIONS, extensions))?
    } else {
        AxisFlip::RIGHT_UP_BACK
    };
    let planes = read_streams(&header, stream_count, bytes.len(), &mut cursor)?;
    header.scene(&planes, flip)
}

/// Reads the table and the streams behind it. A plane without bytes, harmonics of degree 0, has no
/// stream.
fn read_streams(
    header: &SpzHeader,
    stream_count: u8,
    file_len: usize,
    cursor: &mut ByteCursor,
) -> Result<AttributePlanes, SceneError> {
    let lens = header.plane_lens();
    let present: Vec<usize> = (0..COUNT).filter(|&i| lens[i] > 0).collect();
    if usize::from(stream_count) != present.len() {
        let wanted = format!("{} streams at degree {}", present.len(), header.sh_degree);
        return Err(cursor.malformed(format!("{stream_count} streams"), wanted));
    }
    let mut compressed_lens = [0; COUNT];
    for &i in &present {
        compressed_lens[i] = cursor.u64("a stream's length")?;
        let at = cursor.clone();
        let raw = cursor.u64("a plane's length")?;
        if raw != lens[i] as u64 {
            return Err(at.malformed(format!("{raw} bytes of {}", NAMES[i]), format!("{} bytes", lens[i])));
        }
    }
    // All streams are cut out before one is decompressed, so that a wrong table costs no work.
    let mut streams = Vec::new();
    for &i in &present {
        let at = cursor.clone();
        let len = usize::try_from(compressed_lens[i]).unwrap_or(usize::MAX);
        streams.push((i, cursor.take(len, NAMES[i])?, at));
    }
    cursor.end()?;
    if is_beyond_budget(header, file_len) {
        for (i, compressed, at) in &streams {
            decompress_stream(compressed, lens[*i], NAMES[*i], at, SpzStream::skip)?;
        }
    }
    let mut planes = AttributePlanes(Default::default());
    for (i, compressed, at) in &streams {
        planes.0[*i] = decompress_stream(compressed, lens[*i], NAMES[*i], at, SpzStream::take)?;
    }
    Ok(planes)
}

/// Returns true if the planes take more memory than a file of this length may. A first pass then
/// decompresses without keeping anything, so that a broken file takes no memory.
fn is_beyond_budget(header: &SpzHeader, file_len: usize) -> bool {
    ByteBudget::of(file_len).check(header.plane_lens().iter().sum(), 1).is_err()
}

/// A stream of one plane. The function `read` keeps its bytes or skips them.
type Zstd<'a> = SpzStream<zstd::stream::read::Decoder<'a, &'a [u8]>>;

fn decompress_stream<'a, T>(
    compressed: &'a [u8],
    len: usize,
    name: &'static str,
    at: &ByteCursor,
    read: impl FnOnce(&mut Zstd<'a>, usize, &'static str) -> Result<T, SceneError>,
) -> Result<T, SceneError> {
    let broken = |e: io::Error| at.malformed(format!("a broken stream of {name} ({e})"), "a zstd stream");
    let mut inner = zstd::stream::read::Decoder::with_buffer(compressed).map_err(broken)?;
    // No window needs to be larger than the plane. Every decoder must support 8 MiB (RFC 8878).
    inner.window_log_max((usize::BITS - len.leading_zeros()).clamp(23, 27)).map_err(broken)?;
    let mut stream = SpzStream { format: PLANE, inner, offset: 0 };
    let plane = read(&mut stream, len, name)?;
    let rest = stream.up_to(1, name)?;
    if rest.is_empty() {
        return Ok(plane);
    }
    Err(at.malformed(format!("more than {len} bytes of {name}"), "the length in the table"))
}

fn bound_count(header: &SpzHeader, file_len: usize, at: &ByteCursor) -> Result<(), SceneError> {
    let [positions, ..] = header.plane_lens();
    if positions > file_len.saturating_mul(MAX_RATIO) {
        let found = format!("{} Gaussians in {file_len} bytes", header.count);
        return Err(
            at.malformed(found, format!("positions that take at most {MAX_RATIO} times the file's length"))
        );
    }
    Ok(())
}

/// A decompressed stream. Memory grows with the actual output, not with the stated size.
struct SpzStream<R> {
    format: &'static str,
    inner: R,
    offset: usize,
}

impl<R: Read> SpzStream<R> {
    /// Reads exactly `len` bytes.
    fn take(&mut self, len: usize, what: &'static str) -> Result<Vec<u8>, SceneError> {
        let start = self.offset;
        let bytes = self.up_to(len, what)?;
        if bytes.len() == len {
            return Ok(bytes);
        }
        let found = format!("{} bytes before the end", bytes.len());
        Err(self.malformed(start, found, format!("{len} bytes of {what}")))
    }

    /// Skips exactly `len` bytes.
    fn skip(&mut self, len: usize, what: &'static str) -> Result<(), SceneError> {
        let start = self.offset;
        match io::copy(&mut self.inner.by_ref().take(len as u64), &mut io::sink()) {
            Ok(copied) if copied == len as u64 => {
                self.offset += len;
                Ok(())
            }
            Ok(copied) => {
                let found = format!("{copied} bytes before the end");
                Err(self.malformed(start, found, format!("{len} bytes of {what}")))
            }
            Err(e) => Err(self.malformed(start, format!("a broken stream ({e})"), what)),
        }
    }

    /// `len` bytes, or fewer where the stream ends before.
    fn up_to(&mut self, len: usize, what: &'static str) -> Result<Vec<u8>, SceneError> {
        let mut bytes = Vec::new();
        let read = self.inner.by_ref().take(len as u64).read_to_end(&mut bytes);
        self.offset += bytes.len();
        match read {
            Ok(_) => Ok(bytes),
            Err(e) => Err(self.malformed(self.offset, format!("a broken stream ({e})"), what)),
        }
    }

    fn malformed(&self, offset: usize, found: impl Into<String>, wanted: impl Into<String>) -> SceneError {
        SceneError::Malformed { format: self.format, offset, found: found.into(), wanted: wanted.into() }
    }
}
