//! Files of kept renderings: one entry per view, each with a hash, so that a file can be read at any entry
//! and a damaged one is not believed.
//!
//! ```text
//! file  = MAGIC entry*
//! entry = head bytes u32 | body bytes u64 | BLAKE3 of head and body | head | body
//! ```
//! The head is an [`EntryHead`] (postcard), the body the compressed blocks of its images one after the other.

use super::codec;
use gs2e_files as files;
use gs2e_image::{Image, Size};
use gs2e_render::{ChannelSet, RenderWork, RenderedImages};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

const MAGIC: &[u8] = b"gs2e frames 1\n";
/// Bytes before a head.
const LENGTHS: usize = 4 + 8 + 32;
/// Maximum bytes of a head: one of an image of 2^28 pixels has fewer.
const MAX_HEAD: u32 = 1 << 20;

/// Contents of an entry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct EntryHead {
    /// The view.
    pub(super) view: KeptView,
    /// The images.
    pub(super) channels: Vec<KeptChannel>,
    width: u32,
    height: u32,
    /// The work of the rendering.
    pub(super) work: RenderWork,
    /// Bytes of the blocks of all images.
    blocks: Vec<u32>,
}

/// A view of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(super) struct KeptView {
    /// Digest of camera, pose and promised poses.
    pub(super) digest: [u8; 32],
    /// Bits of the velocity of the camera, on which rates depend.
    pub(super) velocity: [u64; 6],
}

/// The images that can be kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum KeptChannel {
    Luminance,
    LuminanceRate,
    Rgb,
    Alpha,
    Depth,
    Doubtful,
}

impl KeptChannel {
    const ALL: [Self; 6] =
        [Self::Luminance, Self::LuminanceRate, Self::Rgb, Self::Alpha, Self::Depth, Self::Doubtful];

    /// The channels of a set that can be kept.
    pub(super) fn of(set: ChannelSet) -> Vec<Self> {
        Self::ALL.into_iter().filter(|channel| channel.set().with(set) == set).collect()
    }

    fn set(self) -> ChannelSet {
        let none = ChannelSet::NONE;
        match self {
            Self::Luminance => ChannelSet { luminance: true, ..none },
            Self::LuminanceRate => ChannelSet { luminance_rate: true, ..none },
            Self::Rgb => ChannelSet { rgb: true, ..none },
            Self::Alpha => ChannelSet { alpha: true, ..none },
            Self::Depth => ChannelSet { depth: true, ..none },
            Self::Doubtful => ChannelSet { doubtful: true, ..none },
        }
    }

    /// Values of a pixel.
    fn stride(self) -> usize {
        if self == Self::Rgb { 3 } else { 1 }
    }

    fn grey(self, images: &mut RenderedImages) -> &mut Option<Image<f32>> {
        match self {
            Self::Luminance => &mut images.luminance,
            Self::LuminanceRate => &mut images.luminance_rate,
            Self::Alpha => &mut images.alpha,
            Self::Depth => &mut images.depth,
            Self::Doubtful => &mut images.doubtful,
            Self::Rgb => unreachable!("colours are not one image of one value"),
        }
    }

    fn values(self, images: &RenderedImages) -> Option<(Size, &[f32])> {
        let grey = match self {
            Self::Rgb => {
                let rgb = images.rgb.as_ref()?;
                return Some((rgb.size(), rgb.pixels().as_flattened()));
            }
            Self::Luminance => &images.luminance,
            Self::LuminanceRate => &images.luminance_rate,
            Self::Alpha => &images.alpha,
            Self::Depth => &images.depth,
            Self::Doubtful => &images.doubtful,
        };
        grey.as_ref().map(|image| (image.size(), image.pixels()))
    }
}

impl EntryHead {
    /// The images, as a set.
    pub(super) fn set(&self) -> ChannelSet {
        self.channels.iter().fold(ChannelSet::NONE, |set, channel| set.with(channel.set()))
    }

    /// Returns true if it has the wanted images of a view.
    pub(super) fn shows(&self, view: &KeptView, want: ChannelSet) -> bool {
        let moves_alike = !want.luminance_rate || self.view.velocity == view.velocity;
        self.view.digest == view.digest && moves_alike && self.set().with(want) == self.set()
    }
}

/// A file that is being written.
#[derive(Debug)]
pub(super) struct EntryWriter {
    file: BufWriter<File>,
    /// Bytes written.
    pub(super) bytes: u64,
}

impl EntryWriter {
    pub(super) fn create(path: &Path) -> io::Result<Self> {
        let mut file = BufWriter::new(File::create_new(path)?);
        file.write_all(MAGIC)?;
        Ok(Self { file, bytes: MAGIC.len() as u64 })
    }

    /// Writes the images of a view.
    pub(super) fn write(
        &mut self,
        view: KeptView,
        channels: Vec<KeptChannel>,
        images: &RenderedImages,
        work: RenderWork,
    ) -> io::Result<()> {
        let (mut body, mut blocks, mut size) = (Vec::new(), Vec::new(), Size { width: 0, height: 0 });
        for channel in &channels {
            let Some((of, values)) = channel.values(images) else { return Ok(()) };
            size = of;
            for block in codec::compress(values, channel.stride())? {
                blocks.push(u32::try_from(block.len()).map_err(|_| io::ErrorKind::InvalidData)?);
                body.extend(block);
            }
        }
        let Size { width, height } = size;
        let head = EntryHead { view, channels, width, height, work, blocks };
        let head = postcard::to_stdvec(&head).map_err(io::Error::other)?;
        let head_bytes = u32::try_from(head.len()).map_err(|_| io::ErrorKind::InvalidData)?;
        self.file.write_all(&head_bytes.to_le_bytes())?;
        self.file.write_all(&(body.len() as u64).to_le_bytes())?;
        self.file.write_all(seal(&head, &body).as_bytes())?;
        self.file.write_all(&head)?;
        self.file.write_all(&body)?;
        self.bytes += (LENGTHS + head.len() + body.len()) as u64;
        Ok(())
    }

    /// Ends the file. Returns its bytes.
    pub(super) fn finish(mut self) -> io::Result<u64> {
        self.file.flush()?;
        Ok(self.bytes)
    }
}

fn seal(head: &[u8], body: &[u8]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new_derive_key("gs2e 2026 kept rendering v1");
    hasher.update(head).update(body);
    hasher.finalize()
}

/// A file that is open for reading, and the places of its entries.
#[derive(Debug)]
pub(super) struct EntryFile {
    file: File,
}

/// Place of an entry.
#[derive(Debug, Clone)]
pub(super) struct EntryPlace {
    pub(super) head: EntryHead,
    /// First byte of the entry.
    at: u64,
    head_bytes: u32,
    body_bytes: u64,
}

impl EntryFile {
    /// Opens a file. Entries from the first damaged one on are left out.
    pub(super) fn open(path: &Path) -> io::Result<(Self, Vec<EntryPlace>)> {
        let mut file = files::open(path)?;
        let end = file.metadata()?.len();
        let mut magic = [0; MAGIC.len()];
        let mut places = Vec::new();
        if file.read_exact(&mut magic).is_ok() && magic == *MAGIC {
            let mut at = MAGIC.len() as u64;
            while let Some(place) = place_at(&mut file, at, end)? {
                at += LENGTHS as u64 + u64::from(place.head_bytes) + place.body_bytes;
                places.push(place);
            }
        }
        Ok((Self { file }, places))
    }

    /// Reads the wanted images of an entry. `None` if its bytes were altered.
    pub(super) fn read(
        &mut self,
        place: &EntryPlace,
        want: ChannelSet,
        images: &mut RenderedImages,
    ) -> io::Result<Option<()>> {
        let EntryPlace { head, at, head_bytes, body_bytes } = place;
        let bytes =
            LENGTHS + *head_bytes as usize + usize::try_from(*body_bytes).map_err(io::Error::other)?;
        let mut entry = vec![0; bytes];
        self.file.seek(SeekFrom::Start(*at))?;
        self.file.read_exact(&mut entry)?;
        let (lengths, rest) = entry.split_at(LENGTHS);
        let (head_text, body) = rest.split_at(*head_bytes as usize);
        if lengths[LENGTHS - 32..] != *seal(head_text, body).as_bytes() {
            return Ok(None);
        }
        let size = Size { width: head.width, height: head.height };
        let (mut blocks, mut body) = (head.blocks.iter(), body);
        for channel in &head.channels {
            let values = channel.stride() * size.pixels();
            let mut own = Vec::new();
            for bytes in blocks.by_ref().take(codec::count_blocks(values)) {
                let Some((block, rest)) = body.split_at_checked(*bytes as usize) else { return Ok(None) };
                own.push(block);
                body = rest;
            }
            if channel.set().with(want) == want {
                fill(*channel, images, size, &own)?;
            }
        }
        Ok(Some(()))
    }
}

/// Fills an image from its blocks.
fn fill(channel: KeptChannel, images: &mut RenderedImages, size: Size, blocks: &[&[u8]]) -> io::Result<()> {
    if channel == KeptChannel::Rgb {
        let image = images.rgb.take().filter(|image| image.size() == size);
        let mut image = image.unwrap_or_else(|| Image::filled(size, [0.0; 3]));
        codec::decompress(blocks, 3, image.pixels_mut().as_flattened_mut())?;
        images.rgb = Some(image);
    } else {
        let place = channel.grey(images);
        let image = place.take().filter(|image| image.size() == size);
        let mut image = image.unwrap_or_else(|| Image::filled(size, 0.0));
        codec::decompress(blocks, 1, image.pixels_mut())?;
        *place = Some(image);
    }
    Ok(())
}

/// The entry at a place; `None` at the end of the sound ones.
fn place_at(file: &mut File, at: u64, end: u64) -> io::Result<Option<EntryPlace>> {
    let mut lengths = [0; LENGTHS];
    if end.saturating_sub(at) < LENGTHS as u64 {
        return Ok(None);
    }
    file.seek(SeekFrom::Start(at))?;
    file.read_exact(&mut lengths)?;
    let head_bytes = u32::from_le_bytes(lengths[..4].try_into().expect("4 bytes"));
    let body_bytes = u64::from_le_bytes(lengths[4..12].try_into().expect("8 bytes"));
    let rest = end - at - LENGTHS as u64;
    if head_bytes > MAX_HEAD || u64::from(head_bytes) > rest || body_bytes > rest - u64::from(head_bytes) {
        return Ok(None);
    }
    let mut head = vec![0; head_bytes as usize];
    file.read_exact(&mut head)?;
    let head = postcard::from_bytes::<EntryHead>(&head).ok();
    Ok(head.map(|head| EntryPlace { head, at, head_bytes, body_bytes }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn images(seed: f32) -> RenderedImages {
        let size = Size { width: 300, height: 250 };
        let grey = |phase: f32| {
            let values = (0..size.pixels()).map(|i| (i as f32 * 0.01 + phase + seed).sin()).collect();
            Some(Image::from_vec(size, values))
        };
        let rgb = (0..size.pixels()).map(|i| [i as f32, seed, -(i as f32)]).collect();
        RenderedImages {
            luminance: grey(0.0),
            luminance_rate: grey(1.0),
            rgb: Some(Image::from_vec(size, rgb)),
            ..RenderedImages::default()
        }
    }

    /// A file with three entries.
    fn file(folder: &Path) -> std::path::PathBuf {
        let path = folder.join("kept");
        let mut writer = EntryWriter::create(&path).unwrap();
        for view in 0..3u8 {
            let channels = vec![KeptChannel::Luminance, KeptChannel::LuminanceRate, KeptChannel::Rgb];
            let work = RenderWork { blended: view.into(), ..RenderWork::default() };
            let seen = KeptView { digest: [view; 32], velocity: [0; 6] };
            writer.write(seen, channels, &images(view.into()), work).unwrap();
        }
        assert_eq!(writer.finish().unwrap(), path.metadata().unwrap().len());
        path
    }

    #[test]
    fn entries_return_in_any_order_and_in_part() {
        let folder = tempfile::tempdir().unwrap();
        let (mut entries, places) = EntryFile::open(&file(folder.path())).unwrap();
        assert_eq!(places.len(), 3);
        for view in [2u8, 0, 1] {
            let place = &places[usize::from(view)];
            assert_eq!((place.head.view.digest, place.head.work.blended), ([view; 32], u64::from(view)));
            let (want, mut found) = (place.head.set(), RenderedImages::default());
            entries.read(place, want, &mut found).unwrap().unwrap();
            let wanted = images(view.into());
            assert_eq!(
                (&found.luminance, &found.luminance_rate),
                (&wanted.luminance, &wanted.luminance_rate)
            );
            assert_eq!(found.rgb, wanted.rgb);
            let mut part = RenderedImages::default();
            let want = ChannelSet { luminance_rate: true, ..ChannelSet::NONE };
            entries.read(place, want, &mut part).unwrap().unwrap();
            assert_eq!((part.luminance, part.luminance_rate, part.rgb), (None, wanted.luminance_rate, None));
        }
    }

    #[test]
    fn no_damage_is_believed() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path());
        let sound = std::fs::read(&path).unwrap();
        for at in (0..sound.len()).step_by(20_011).chain((0..200).step_by(3)) {
            let mut bytes = sound.clone();
            bytes[at] ^= 1 << (at % 8);
            std::fs::write(&path, bytes).unwrap();
            let (mut entries, places) = EntryFile::open(&path).unwrap();
            for place in &places {
                let mut found = RenderedImages::default();
                if let Ok(Some(())) = entries.read(place, place.head.set(), &mut found) {
                    let wanted = images(place.head.view.digest[0].into());
                    assert_eq!((found.luminance, found.rgb), (wanted.luminance, wanted.rgb), "byte {at}");
                    assert_eq!(place.head.work.blended, u64::from(place.head.view.digest[0]), "byte {at}");
                }
            }
        }
    }

    #[test]
    fn a_file_that_is_cut_off_has_its_first_entries() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path());
        let sound = std::fs::read(&path).unwrap();
        for (part, entries) in [(sound.len() - 1, 2), (sound.len() / 2, 1), (20, 0), (3, 0), (0, 0)] {
            std::fs::write(&path, &sound[..part]).unwrap();
            assert_eq!(EntryFile::open(&path).unwrap().1.len(), entries, "{part} bytes");
        }
    }
}
