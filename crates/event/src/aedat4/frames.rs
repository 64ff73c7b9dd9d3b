//! Frames of the camera in the same file: packets of one frame each (schema `Frame` of dv-processing).

use super::FRAMES;
use super::buffer::BufferTable;
use super::info;
use super::packets::{HEADER_AT, PacketHead, PacketStream, wrong_packet};
use crate::EventFileError;
use crate::order::END_US;
use gs2e_files as files;
use gs2e_image::Size;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Fields of a frame by their number.
const STAMP: usize = 0;
const EXPOSURE_START: usize = 3;
const EXPOSURE_END: usize = 4;
const FORMAT: usize = 5;
const SIDES: [usize; 2] = [6, 7];
const PIXELS: usize = 10;
const EXPOSURE: usize = 11;

/// Formats: numbers of `OpenCV` for pixels of one, three and four bytes.
const GREY: i8 = 0;
const BGR: i8 = 16;
const BGRA: i8 = 24;

/// The samples of a frame, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FramePixels {
    /// Greys.
    Grey(Vec<u8>),
    /// Red, green and blue.
    Rgb(Vec<[u8; 3]>),
}

/// A frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraFrame {
    /// The middle of its exposure, or its own stamp if it states no exposure.
    pub stamp_us: i64,
    /// Length of the exposure, if it is stated.
    pub exposure_us: Option<i64>,
    /// Columns and rows.
    pub size: Size,
    /// Its samples.
    pub pixels: FramePixels,
}

/// Reads the first stream of frames of a file.
///
/// # Examples
/// ```
/// use gs2e_event::aedat4::FrameReader;
///
/// let because = FrameReader::new(&b"no frames"[..]).unwrap_err();
/// assert!(because.to_string().contains("AER-DAT4.0"));
/// ```
#[derive(Debug)]
pub struct FrameReader<R = BufReader<File>> {
    packets: PacketStream<R>,
    stream: i32,
}

impl FrameReader {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// The file is of another version, or its header names no stream of frames.
    pub fn open(path: &Path) -> Result<Self, EventFileError> {
        Self::new(BufReader::new(files::open(path)?))
    }
}

impl<R: Read> FrameReader<R> {
    /// Reads the header of a recording.
    ///
    /// # Errors
    /// It is of another version, or its header names no stream of frames.
    pub fn new(input: R) -> Result<Self, EventFileError> {
        let (packets, text) = PacketStream::new(input)?;
        let stream = info::frame_stream(&text).map_err(|because| wrong_packet(HEADER_AT, &because))?;
        Ok(Self { packets, stream })
    }

    /// The next frame; `None` after the last.
    ///
    /// # Errors
    /// A packet is damaged, or its frame has pixels of another kind than bytes.
    pub fn next_frame(&mut self) -> Result<Option<CameraFrame>, EventFileError> {
        while let Some(packet) = self.packets.next()? {
            if packet.stream == self.stream {
                return self.frame(&packet).map(Some);
            }
        }
        Ok(None)
    }

    fn frame(&mut self, packet: &PacketHead) -> Result<CameraFrame, EventFileError> {
        let inflated = self.packets.inflate(packet)?;
        // The first 4 bytes are the size of the buffer.
        let table = inflated.get(4..).and_then(|bytes| BufferTable::root_table(bytes, FRAMES));
        let table = table.ok_or_else(|| wrong_packet(packet.at, "the packet holds no frame"))?;
        parse_frame(&table).map_err(|because| wrong_packet(packet.at, &because))
    }
}

fn parse_frame(table: &BufferTable<'_>) -> Result<CameraFrame, String> {
    let [width, height] = SIDES.map(|k| u32::try_from(table.i16(k).unwrap_or(0)).unwrap_or(0));
    let size = Size { width, height };
    if size.pixels() == 0 {
        return Err(format!("a frame of {size}, wanted at least one pixel"));
    }
    let format = table.i8(FORMAT).unwrap_or(GREY);
    let each = match format {
        GREY => 1,
        BGR => 3,
        BGRA => 4,
        other => {
            return Err(format!(
                "a frame of format {other}, wanted {GREY} (grey), {BGR} (BGR) or {BGRA} (BGRA) of 8 bits"
            ));
        }
    };
    let bytes = table.elements(PIXELS, 1).unwrap_or_default();
    let wanted = each * size.pixels();
    if bytes.len() != wanted {
        return Err(format!("{} bytes of pixels, wanted {wanted} for a frame of {size}", bytes.len()));
    }
    let pixels = match each {
        1 => FramePixels::Grey(bytes.to_vec()),
        _ => FramePixels::Rgb(bytes.chunks_exact(each).map(|bgr| [bgr[2], bgr[1], bgr[0]]).collect()),
    };
    let (stamp_us, exposure_us) = stamp(table)?;
    Ok(CameraFrame { stamp_us, exposure_us, size, pixels })
}

/// The middle and the length of the exposure.
fn stamp(table: &BufferTable<'_>) -> Result<(i64, Option<i64>), String> {
    let time = |k: usize| table.i64(k).filter(|us| (1..END_US).contains(us));
    let stamp = table.i64(STAMP).unwrap_or(0);
    if !(0..END_US).contains(&stamp) {
        return Err(format!("a frame at {stamp} us, wanted 0 to {}", END_US - 1));
    }
    // Older files state start and end, and their stamp is the middle. In newer ones the stamp is the start.
    let bounds = time(EXPOSURE_START).zip(time(EXPOSURE_END)).filter(|(start, end)| end >= start);
    let [start, end] = match (bounds, time(EXPOSURE)) {
        (Some((start, end)), _) => [start, end],
        (None, Some(exposure)) => [stamp, stamp.saturating_add(exposure).min(END_US - 1)],
        (None, None) => return Ok((stamp, None)),
    };
    Ok((start + (end - start) / 2, Some(end - start)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file that dv-processing wrote: frames of 8x6 pixels every 20 ms from 1 s on, exposed for 4 ms.
    fn file(name: &str) -> Vec<u8> {
        let place = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/fuzz/corpus/");
        std::fs::read(format!("{place}{name}")).unwrap()
    }

    fn read(bytes: &[u8]) -> Result<Vec<CameraFrame>, EventFileError> {
        let mut reader = FrameReader::new(bytes)?;
        let mut frames = Vec::new();
        while let Some(frame) = reader.next_frame()? {
            frames.push(frame);
        }
        Ok(frames)
    }

    #[test]
    fn frames_of_another_program_are_read() {
        let greys = |k: usize| (0..48).map(move |i| 10 * k + 20 * (i / 8) + 3 * (i % 8));
        for (name, is_grey) in [("davis.aedat4", true), ("colour.aedat4", false)] {
            let frames = read(&file(name)).unwrap();
            assert_eq!(frames.len(), 4);
            for (k, frame) in frames.iter().enumerate() {
                let stamp = 1_000_000 + 20_000 * i64::try_from(k).unwrap() + 2000;
                assert_eq!((frame.stamp_us, frame.exposure_us), (stamp, Some(4000)));
                assert_eq!(frame.size, Size { width: 8, height: 6 });
                let byte = |v: usize| u8::try_from(v).unwrap();
                let wanted = if is_grey {
                    FramePixels::Grey(greys(k).map(byte).collect())
                } else {
                    // Blue comes first in the file, and is darkest.
                    FramePixels::Rgb(greys(k).map(|v| [byte(v + 40), byte(v + 20), byte(v)]).collect())
                };
                assert_eq!(frame.pixels, wanted, "{name} {k}");
            }
        }
    }

    #[test]
    fn damaged_files_are_refused_or_read() {
        for name in ["davis.aedat4", "colour.aedat4"] {
            let sound = file(name);
            // The table of packets at the end is not needed, so a file that lacks it may be sound.
            (0..sound.len()).for_each(|end| drop(read(&sound[..end])));
            assert!(read(&sound[..sound.len() / 2]).unwrap_err().to_string().contains("truncated"));
            for at in 0..sound.len() {
                let mut bytes = sound.clone();
                for bits in [0xff, 0x01, 0x80] {
                    bytes[at] = sound[at] ^ bits;
                    drop(read(&bytes));
                }
            }
        }
    }

    /// A packet whose frame is laid out here: fields by number, each with its bytes.
    fn frame(fields: &[(usize, &[u8])]) -> Vec<u8> {
        let slots = 13;
        let list = 4 + 2 * slots;
        let mut table = vec![0; 4];
        let mut offsets = vec![0_u16; slots];
        for (number, bytes) in fields {
            offsets[*number] = u16::try_from(table.len()).unwrap();
            table.extend(*bytes);
        }
        let mut out = Vec::new();
        out.extend(u32::try_from(8 + list).unwrap().to_le_bytes());
        out.extend(FRAMES);
        out.extend(
            [u16::try_from(list).unwrap(), u16::try_from(table.len()).unwrap()]
                .map(u16::to_le_bytes)
                .concat(),
        );
        out.extend(offsets.into_iter().flat_map(u16::to_le_bytes));
        table[..4].copy_from_slice(&i32::try_from(list).unwrap().to_le_bytes());
        out.extend(table);
        out
    }

    #[test]
    fn stamps_and_formats_of_other_versions() {
        let parse = |fields: &[(usize, &[u8])]| {
            let bytes = frame(fields);
            parse_frame(&BufferTable::root_table(&bytes, FRAMES).unwrap())
        };
        let time = |us: i64| us.to_le_bytes();
        let one: &[u8] = &1_i16.to_le_bytes();
        let sides = [(SIDES[0], one), (SIDES[1], one)];
        // A vector follows its offset.
        let grey: &[u8] = &[4, 0, 0, 0, 1, 0, 0, 0, 77];
        let with = |more: &[(usize, &[u8])]| parse(&[&sides[..], &[(PIXELS, grey)][..], more].concat());
        // Older files: the stamp is the middle. Start and end say the same.
        let old =
            with(&[(STAMP, &time(500)), (EXPOSURE_START, &time(400)), (EXPOSURE_END, &time(600))]).unwrap();
        assert_eq!((old.stamp_us, old.exposure_us), (500, Some(200)));
        let new = with(&[(STAMP, &time(400)), (EXPOSURE, &time(200))]).unwrap();
        assert_eq!((new.stamp_us, new.exposure_us), (500, Some(200)));
        let bare = with(&[(STAMP, &time(500))]).unwrap();
        assert_eq!((bare.stamp_us, bare.exposure_us), (500, None));
        assert_eq!(bare.pixels, FramePixels::Grey(vec![77]));
        let because = with(&[(FORMAT, &[2])]).unwrap_err();
        assert!(because.contains("format 2, wanted 0 (grey)"), "{because}");
        let because = with(&[(FORMAT, &[16])]).unwrap_err();
        assert!(because.contains("1 bytes of pixels, wanted 3"), "{because}");
        let because = with(&[(STAMP, &time(-5))]).unwrap_err();
        assert!(because.contains("at -5 us"), "{because}");
        assert!(parse(&[(PIXELS, grey)]).unwrap_err().contains("at least one pixel"));
    }
}
