//! EXIF of a JPEG (CIPA DC-008-2019), as far as it identifies a camera: maker, model, lens and focal
//! length. Everything else is skipped.

/// Tags of the camera in the first directory: Make, Model.
const CAMERA: [u16; 2] = [0x010f, 0x0110];
/// Tags in the EXIF directory: FocalLength, FocalLengthIn35mmFilm, DigitalZoomRatio, LensModel.
const LENS: [u16; 4] = [0x920a, 0xa405, 0xa404, 0xa434];
/// Tag of the EXIF directory.
const DIRECTORY: u16 = 0x8769;
/// Maximum number of entries of a directory that are read; cameras write fewer than 100.
const ENTRIES: usize = 1000;

/// The bytes that identify camera, lens and focal length: tags with their values. `None` for a file
/// without EXIF, or if none of the tags exists. `head` is the start of the file.
#[must_use]
pub(super) fn camera_marks(head: &[u8]) -> Option<Vec<u8>> {
    let tiff = TiffBlock::of_jpeg(head)?;
    // The head of TIFF ends with the offset of the first directory, after the byte order and the number 42.
    let first = tiff.u32(4)?;
    let mut marks = tiff.values(first, &CAMERA);
    if let Some(directory) = tiff.entry(first, DIRECTORY).and_then(|at| tiff.u32(at + 8)) {
        marks.extend(tiff.values(directory, &LENS));
    }
    (!marks.is_empty()).then_some(marks)
}

/// The block of a file that has the layout of TIFF. Offsets count from its start.
struct TiffBlock<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl<'a> TiffBlock<'a> {
    /// Finds the block in the segment APP1 of a JPEG.
    fn of_jpeg(head: &'a [u8]) -> Option<Self> {
        // Behind the marker of the start of the picture, which has no length.
        let mut at = 2;
        // Every segment before the picture begins with a marker and its length.
        while let [0xff, marker, high, low] = *head.get(at..at + 4)?.first_chunk::<4>()? {
            let length = usize::from(u16::from_be_bytes([high, low]));
            let content = head.get(at + 4..).unwrap_or_default();
            if marker == 0xe1 && content.starts_with(b"Exif\0\0") {
                // A head that ends within the segment is read as far as it goes.
                let bytes = &content[6..content.len().min(length.saturating_sub(2)).max(6)];
                let big_endian = bytes.starts_with(b"MM");
                return (big_endian || bytes.starts_with(b"II")).then_some(Self { bytes, big_endian });
            }
            // A length counts its own two bytes. A smaller one of a damaged file must not lead into the
            // length itself.
            at += 2 + length.max(2);
        }
        None
    }

    fn u16(&self, at: usize) -> Option<u16> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn u32(&self, at: usize) -> Option<usize> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        let value = if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) };
        usize::try_from(value).ok()
    }

    /// Offset of the entry with this tag in the directory at `directory`.
    fn entry(&self, directory: usize, tag: u16) -> Option<usize> {
        let count = usize::from(self.u16(directory)?).min(ENTRIES);
        // A directory is its number of entries in 16 bits, then 12 bytes for each: tag, type, count and
        // value.
        let entries = (0..count).map(|k| directory.saturating_add(2 + 12 * k));
        entries.into_iter().find(|at| self.u16(*at) == Some(tag))
    }

    /// The values of these tags, each after its tag.
    fn values(&self, directory: usize, tags: &[u16]) -> Vec<u8> {
        let value =
            |tag: &u16| Some([&tag.to_be_bytes(), self.value(self.entry(directory, *tag)?)?].concat());
        tags.iter().filter_map(value).flatten().collect()
    }

    /// The bytes of the value of an entry.
    fn value(&self, entry: usize) -> Option<&'a [u8]> {
        // The types of TIFF 6.0, section 2. Unknown ones count as bytes.
        let width = match self.u16(entry + 2)? {
            3 | 8 => 2,
            4 | 9 | 11 => 4,
            5 | 10 | 12 => 8,
            _ => 1,
        };
        let length = self.u32(entry + 4)?.checked_mul(width)?;
        // Up to four bytes are in the entry itself.
        let at = if length <= 4 { entry + 8 } else { self.u32(entry + 8)? };
        self.bytes.get(at..at.checked_add(length)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A JPEG with a camera's model and a focal length of `mm` / 10, without a picture.
    fn jpeg(model: &[u8; 6], mm: u32) -> Vec<u8> {
        let entry = |tag: u16, kind: u16, count: u32, value: u32| {
            [&tag.to_be_bytes()[..], &kind.to_be_bytes(), &count.to_be_bytes(), &value.to_be_bytes()].concat()
        };
        let mut tiff = [b"MM\0\x2a".to_vec(), 8u32.to_be_bytes().to_vec()].concat();
        // Two entries from 8 to 38; the EXIF directory from 38 to 56; values after it.
        tiff.extend([0, 2]);
        tiff.extend(entry(0x0110, 2, 6, 56));
        tiff.extend(entry(DIRECTORY, 4, 1, 38));
        tiff.extend(0u32.to_be_bytes());
        tiff.extend([0, 1]);
        tiff.extend(entry(0x920a, 5, 1, 62));
        tiff.extend(0u32.to_be_bytes());
        tiff.extend(model);
        tiff.extend([mm.to_be_bytes(), 10u32.to_be_bytes()].concat());
        let exif = [b"Exif\0\0".to_vec(), tiff].concat();
        let length = u16::try_from(exif.len() + 2).unwrap().to_be_bytes();
        // A comment comes first, as cameras write it.
        [vec![0xff, 0xd8, 0xff, 0xfe, 0, 4, 1, 2, 0xff, 0xe1], length.to_vec(), exif, vec![0xff, 0xd9]]
            .concat()
    }

    #[test]
    fn cameras_and_focal_lengths_have_different_marks() {
        let marks = |model, mm| camera_marks(&jpeg(model, mm)).unwrap();
        assert_eq!(marks(b"CamA1\0", 43), marks(b"CamA1\0", 43));
        assert_ne!(marks(b"CamA1\0", 43), marks(b"CamA2\0", 43));
        assert_ne!(marks(b"CamA1\0", 43), marks(b"CamA1\0", 70));
    }

    #[test]
    fn damaged_bytes_give_nothing_and_no_panic() {
        let whole = jpeg(b"CamA1\0", 43);
        (0..whole.len()).for_each(|cut| drop(camera_marks(&whole[..cut])));
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] = 0xff;
            drop(camera_marks(&bytes));
        }
        assert_eq!(camera_marks(b"\x89PNG"), None);
        assert_eq!(camera_marks(&[0xff, 0xd8, 0xff, 0xda, 0, 2]), None);
    }
}
