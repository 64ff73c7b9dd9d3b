//! The binary form, little endian. Every count is compared with the remaining bytes before any
//! allocation.

use super::lenses::CameraModel;
use super::{ColmapImage, ColmapPoint, KeyPoint, ModelCamera, image_pose};
use crate::{SourceError, SourcePlace};
use glam::DVec3;
use gs2e_files as files;
use gs2e_image::Size;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// Size in bytes of the shortest camera: id, model, size and three parameters.
const CAMERA_BYTES: usize = 4 + 4 + 16 + 24;
/// Size in bytes of the shortest image: id, pose, camera, the end of a name and a count.
const IMAGE_BYTES: usize = 4 + 56 + 4 + 1 + 8;
/// Size in bytes of an observation.
const OBSERVATION_BYTES: usize = 24;
/// Size in bytes of the shortest point: id, position, colour, error and a count.
const POINT_BYTES: usize = 8 + 24 + 3 + 8 + 8;
/// Size in bytes of an element of a track.
const TRACK_BYTES: usize = 8;

pub(super) fn read_cameras(path: &Path) -> Result<BTreeMap<u32, ModelCamera>, SourceError> {
    let data = load_bytes(path)?;
    let mut bytes = BinaryCursor::new(path, &data);
    let mut cameras = BTreeMap::new();
    bytes.records("camera", CAMERA_BYTES, |bytes| {
        let start = bytes.at;
        let (id, camera) = read_camera(bytes)?;
        match cameras.insert(id, camera) {
            None => Ok(()),
            Some(_) => Err(bytes.fault(start, format!("camera {id} was already listed"))),
        }
    })?;
    Ok(cameras)
}

fn read_camera(bytes: &mut BinaryCursor<'_>) -> Result<(u32, ModelCamera), SourceError> {
    let start = bytes.at;
    let id = bytes.u32()?;
    let model = CameraModel::from_number(bytes.u32()?.cast_signed()).map_err(|e| bytes.fault(start, e))?;
    let (width, height) = (bytes.u64()?, bytes.u64()?);
    let parameters = (0..model.parameters).map(|_| bytes.f64()).collect::<Result<Vec<f64>, _>>()?;
    let size = Size { width: clamp_size(width), height: clamp_size(height) };
    let camera = model.camera(size, &parameters).map_err(|e| bytes.fault(start, e))?;
    Ok((id, camera))
}

/// Converts a side to u32. A value that does not fit becomes the largest one, which is refused
/// later.
fn clamp_size(side: u64) -> u32 {
    u32::try_from(side).unwrap_or(u32::MAX)
}

pub(super) fn read_images(path: &Path) -> Result<Vec<ColmapImage>, SourceError> {
    let data = load_bytes(path)?;
    let mut bytes = BinaryCursor::new(path, &data);
    let mut images = Vec::new();
    bytes.records("image", IMAGE_BYTES, |bytes| {
        images.push(read_image(bytes)?);
        Ok(())
    })?;
    Ok(images)
}

fn read_image(bytes: &mut BinaryCursor<'_>) -> Result<ColmapImage, SourceError> {
    let start = bytes.at;
    let place = bytes.place(start);
    // The id of the image. Only tracks refer to it.
    bytes.u32()?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = bytes.f64()?;
    }
    let camera_id = bytes.u32()?;
    let name = bytes.name()?;
    let (rotation, translation) =
        image_pose(numbers).map_err(|e| bytes.fault(start, format!("`{name}`: {e}")))?;
    let count = bytes.count(OBSERVATION_BYTES)?;
    let observations = (0..count).map(|_| read_observation(bytes)).collect::<Result<_, _>>()?;
    Ok(ColmapImage { name, camera_id, rotation, translation, observations, place })
}

fn read_observation(bytes: &mut BinaryCursor<'_>) -> Result<KeyPoint, SourceError> {
    let xy = [bytes.f64()?, bytes.f64()?];
    // All bits set is COLMAP's mark of a key point without a triangulated point.
    let point = Some(bytes.u64()?).filter(|&id| id != u64::MAX);
    Ok(KeyPoint { xy, point })
}

pub(super) fn read_points(path: &Path) -> Result<BTreeMap<u64, ColmapPoint>, SourceError> {
    let data = load_bytes(path)?;
    let mut bytes = BinaryCursor::new(path, &data);
    let mut points = BTreeMap::new();
    bytes.records("point", POINT_BYTES, |bytes| {
        let id = bytes.u64()?;
        let xyz = DVec3::new(bytes.f64()?, bytes.f64()?, bytes.f64()?);
        let rgb = bytes.array()?;
        let error = bytes.f64()?;
        // Tracks are skipped: the key points of the images contain the same pairs.
        let track = bytes.count(TRACK_BYTES)?;
        bytes.take(track * TRACK_BYTES)?;
        points.insert(id, ColmapPoint { xyz, rgb, error });
        Ok(())
    })?;
    Ok(points)
}

/// Returns the images of a file with other names, every other byte unchanged.
pub(super) fn rename_images(path: &Path, name_of: &dyn Fn(&str) -> String) -> Result<Vec<u8>, SourceError> {
    let data = load_bytes(path)?;
    let mut bytes = BinaryCursor::new(path, &data);
    // The number of images, which `records` reads but does not pass on.
    let mut renamed = data.get(..8).unwrap_or_default().to_vec();
    bytes.records("image", IMAGE_BYTES, |bytes| {
        // Id, pose and camera.
        renamed.extend_from_slice(bytes.take(4 + 56 + 4)?);
        renamed.extend_from_slice(name_of(&bytes.name()?).as_bytes());
        renamed.push(0);
        let start = bytes.at;
        let count = bytes.count(OBSERVATION_BYTES)?;
        bytes.take(count * OBSERVATION_BYTES)?;
        renamed.extend_from_slice(&data[start..bytes.at]);
        Ok(())
    })?;
    Ok(renamed)
}

/// Reads the number of records that a file states.
pub(super) fn count_records(path: &Path) -> Result<u64, SourceError> {
    let mut head = Vec::new();
    let file = files::open(path).map_err(SourceError::io_error(path))?;
    // Each of the three files begins with its number of records in 64 bits.
    file.take(8).read_to_end(&mut head).map_err(SourceError::io_error(path))?;
    BinaryCursor::new(path, &head).u64()
}

fn load_bytes(path: &Path) -> Result<Vec<u8>, SourceError> {
    files::read(path, files::MAX_MODEL).map_err(SourceError::io_error(path))
}

/// The bytes of a file with the current position.
struct BinaryCursor<'a> {
    path: &'a Path,
    data: &'a [u8],
    at: usize,
    record: String,
}

impl<'a> BinaryCursor<'a> {
    fn new(path: &'a Path, data: &'a [u8]) -> Self {
        Self { path, data, at: 0, record: "the head".to_owned() }
    }

    /// Reads the count at the start and this number of records, which must be the whole file.
    fn records(
        &mut self,
        name: &str,
        least_bytes: usize,
        mut read: impl FnMut(&mut Self) -> Result<(), SourceError>,
    ) -> Result<(), SourceError> {
        let count = self.count(least_bytes)?;
        for number in 1..=count {
            self.record = format!("{name} {number} of {count}");
            read(self)?;
        }
        match self.data.len() - self.at {
            0 => Ok(()),
            more => Err(self.fault(self.at, format!("{more} bytes follow the last {name}"))),
        }
    }

    fn place(&self, offset: usize) -> SourcePlace {
        SourcePlace::Byte { record: self.record.clone(), offset }
    }

    fn fault(&self, offset: usize, because: String) -> SourceError {
        SourceError::Content { path: self.path.to_owned(), place: self.place(offset), because }
    }

    fn take(&mut self, len: usize) -> Result<&'a [u8], SourceError> {
        let left = self.data.len() - self.at;
        if len > left {
            return Err(self.fault(self.at, format!("the file ends early: {left} bytes left, wanted {len}")));
        }
        let taken = &self.data[self.at..self.at + len];
        self.at += len;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], SourceError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, SourceError> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, SourceError> {
        self.array().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, SourceError> {
        self.array().map(f64::from_le_bytes)
    }

    /// Reads a count of elements, each of at least `least_bytes` bytes.
    fn count(&mut self, least_bytes: usize) -> Result<usize, SourceError> {
        let start = self.at;
        let count = self.u64()?;
        let room = (self.data.len() - self.at) / least_bytes;
        usize::try_from(count).ok().filter(|&count| count <= room).ok_or_else(|| {
            self.fault(start, format!("a count of {count}, but the rest of the file has room for {room}"))
        })
    }

    /// Reads a name that ends with NUL.
    fn name(&mut self) -> Result<String, SourceError> {
        let start = self.at;
        let Some(len) = self.data[start..].iter().position(|&b| b == 0) else {
            return Err(self.fault(start, "the file ends inside a name".to_owned()));
        };
        let name = self.take(len + 1)?;
        match std::str::from_utf8(&name[..len]) {
            Ok("") => Err(self.fault(start, "an image without a name".to_owned())),
            Ok(name) => Ok(name.to_owned()),
            Err(e) => Err(self.fault(start, format!("a name that is not UTF-8: {e}"))),
        }
    }
}
