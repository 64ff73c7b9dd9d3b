//! The files of one trajectory, as the types that they hold.

use crate::files::{ReleaseFiles, TreeError, json_of};
use glam::DVec3;
use gs2e_event::{Event, EventSource as _, h5};
use gs2e_files as files;
use gs2e_image::{Image, Size, npy, png};
use gs2e_scene::camera::Camera;
use gs2e_trajectory::imu::files::{SAMPLES, SAMPLES_HEAD, read_lines};
use gs2e_trajectory::{Trajectory, report::SpeedReport};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::fmt::Display;
use std::io::Cursor;
use std::path::PathBuf;
use std::sync::Arc;

/// Name of the file of a stream of events in the folder of its trajectory. The stream of a single sensor has
/// no name.
#[must_use]
pub fn event_file(sensor: Option<&str>) -> String {
    sensor.map_or_else(|| "events.h5".to_owned(), |name| format!("events/{name}.h5"))
}

/// A kind of pictures. A trajectory has one at some of its poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureKind {
    /// What the camera sees at the pose, PNG in sRGB.
    Sharp,
    /// The mean over an exposure around the pose, PNG in sRGB.
    Blur,
    /// Depth along the optical axis, scene units, NumPy float32 (H, W).
    Depth,
    /// Disparity to the second camera of a stereo pair, px, NumPy float32 (H, W).
    Disparity,
    /// Optical flow, px/s to the right and down, NumPy float32 (H, W, 2).
    Flow,
    /// Numbers of objects, PNG.
    Segmentation,
}

impl PictureKind {
    /// The folder of the pictures, and the extension of their files.
    fn form(self) -> [&'static str; 2] {
        match self {
            Self::Sharp => ["sharp", "png"],
            Self::Blur => ["blur", "png"],
            Self::Depth => ["depth", "npy"],
            Self::Disparity => ["disparity", "npy"],
            Self::Flow => ["flow", "npy"],
            Self::Segmentation => ["segmentation", "png"],
        }
    }

    /// Name of the picture of a pose in the folder of its trajectory.
    #[must_use]
    pub fn name(self, pose: usize) -> String {
        let [folder, extension] = self.form();
        format!("{folder}/{pose:06}.{extension}")
    }
}

/// A blurred picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exposure {
    /// The pose in the middle, which names the picture.
    pub pose: usize,
    /// Times at which the shutter opens and closes, in the times of the release, us.
    pub open_us: [i64; 2],
}

impl Exposure {
    /// The exposure of a frame of `transforms.json`, if it states one.
    #[must_use]
    pub fn read(frame: &Value) -> Option<Self> {
        let name = frame["blur_file_path"].as_str()?.strip_prefix("blur/")?.strip_suffix(".png")?;
        let open_us = [frame["exposure_start_us"].as_i64()?, frame["exposure_end_us"].as_i64()?];
        Some(Self { pose: name.parse().ok()?, open_us })
    }

    /// Returns true if its pose exists and lies within the exposure, and the exposure within the poses.
    fn fits(&self, stamps_us: &[i64]) -> bool {
        let [start, end] = self.open_us;
        let within = |stamp: &i64| (start..=end).contains(stamp);
        let ends = stamps_us.first().zip(stamps_us.last());
        start < end
            && stamps_us.get(self.pose).is_some_and(within)
            && ends.is_some_and(|(first, last)| *first <= start && end <= *last)
    }
}

/// The files of a trajectory of a release.
#[derive(Debug, Clone)]
pub struct TrajectoryFiles<'a> {
    files: Arc<dyn ReleaseFiles + 'a>,
    /// Path of its folder in the release.
    folder: String,
    /// The camera of all pictures and events.
    pub camera: Camera,
}

impl<'a> TrajectoryFiles<'a> {
    /// The trajectory `name` of the scene `scene`, seen by `camera`.
    ///
    /// # Errors
    /// The camera is larger than any sensor.
    pub fn new(
        files: Arc<dyn ReleaseFiles + 'a>,
        scene: &str,
        name: &str,
        camera: Camera,
    ) -> Result<Self, TreeError> {
        // Names of a release that others made may hold anything; each file is opened below the folder. The
        // size is a claim of a file, and memory grows with it.
        let described = || files.display_path(&format!("{scene}/scene.json"));
        camera.size.check_sensor().map_err(|e| TreeError::new(described(), e))?;
        Ok(Self { files, folder: format!("{scene}/{name}"), camera })
    }

    /// Path of a file in the release.
    #[must_use]
    pub fn path(&self, name: &str) -> String {
        format!("{}/{name}", self.folder)
    }

    /// The path of a file in messages.
    #[must_use]
    pub fn display_path(&self, name: &str) -> PathBuf {
        self.files.display_path(&self.path(name))
    }

    /// The fault of a file.
    pub fn refusal(&self, name: &str, because: impl Display) -> TreeError {
        TreeError::new(self.display_path(name), because)
    }

    /// Returns true if there is a file of this name.
    ///
    /// # Errors
    /// There is something else, such as a link.
    pub fn has(&self, name: &str) -> Result<bool, TreeError> {
        self.files.has(&self.path(name)).map_err(|e| self.refusal(name, e))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn read(&self, name: &str) -> Result<Vec<u8>, TreeError> {
        self.files.read(&self.path(name), files::MAX_DOCUMENT).map_err(|e| self.refusal(name, e))
    }

    /// Reads a JSON file.
    ///
    /// # Errors
    /// It cannot be read, or has another form.
    pub fn json<T: DeserializeOwned>(&self, name: &str) -> Result<T, TreeError> {
        json_of(&*self.files, &self.path(name))
    }

    /// The poses of `poses.txt`: camera to world with OpenCV axes, and their stamps, us.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn poses(&self) -> Result<Trajectory, TreeError> {
        let name = "poses.txt";
        Trajectory::read_poses(self.read(name)?.as_slice()).map_err(|e| self.refusal(name, e))
    }

    /// The speeds of `speed.json`.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn speeds(&self) -> Result<SpeedReport, TreeError> {
        self.json("speed.json")
    }

    /// The blurred pictures that `transforms.json` lists, ascending. There are none if the release has none
    /// of their files.
    ///
    /// # Errors
    /// The file cannot be read, or a picture has no exposure around a pose of these stamps.
    pub fn exposures(&self, stamps_us: &[i64]) -> Result<Vec<Exposure>, TreeError> {
        let name = "transforms.json";
        let poses = 0..stamps_us.len();
        if self.poses_with(PictureKind::Blur, poses)?.is_empty() {
            return Ok(Vec::new());
        }
        let listed: Value = self.json(name)?;
        let frames = listed["frames"].as_array().map_or(&[][..], Vec::as_slice);
        let blurred = frames.iter().filter(|frame| frame.get("blur_file_path").is_some());
        let read = |frame: &Value| {
            let exposure = Exposure::read(frame).filter(|exposure| exposure.fits(stamps_us));
            let wanted = "a blurred picture has no pose, or no exposure around it within the poses";
            exposure.ok_or_else(|| self.refusal(name, wanted))
        };
        let mut exposures = blurred.map(read).collect::<Result<Vec<_>, _>>()?;
        exposures.sort_by_key(|exposure| exposure.pose);
        Ok(exposures)
    }

    /// Those of some poses that have a picture of this kind.
    ///
    /// # Errors
    /// Something that is no file has the name of a picture.
    pub fn poses_with(
        &self,
        kind: PictureKind,
        poses: impl IntoIterator<Item = usize>,
    ) -> Result<Vec<usize>, TreeError> {
        let found = poses.into_iter().map(|pose| Ok(self.has(&kind.name(pose))?.then_some(pose)));
        found.filter_map(Result::transpose).collect()
    }

    /// The file of a picture.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn picture(&self, kind: PictureKind, pose: usize) -> Result<Vec<u8>, TreeError> {
        let name = kind.name(pose);
        self.files.read(&self.path(&name), files::MAX_PICTURE).map_err(|e| self.refusal(&name, e))
    }

    /// A picture that is a PNG, sRGB.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub fn colours(&self, kind: PictureKind, pose: usize) -> Result<Image<[u8; 3]>, TreeError> {
        let read = png::read_sized(Cursor::new(self.picture(kind, pose)?), self.camera.size);
        read.map_err(|e| self.refusal(&kind.name(pose), e))
    }

    /// A picture that is an array of one number per pixel; NaN where it is undefined.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub fn values(&self, kind: PictureKind, pose: usize) -> Result<Image<f32>, TreeError> {
        Ok(Image::from_vec(self.camera.size, self.array(kind, pose, &[])?))
    }

    /// The optical flow at a pose, px/s to the right and down; NaN where it is undefined.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub fn flow(&self, pose: usize) -> Result<Image<[f32; 2]>, TreeError> {
        let values = self.array(PictureKind::Flow, pose, &[2])?;
        Ok(Image::from_vec(self.camera.size, values.as_chunks().0.to_vec()))
    }

    fn array(&self, kind: PictureKind, pose: usize, channels: &[u64]) -> Result<Vec<f32>, TreeError> {
        let Size { width, height } = self.camera.size;
        let shape = [&[height.into(), width.into()], channels].concat();
        npy::read_floats(&shape, &mut Cursor::new(self.picture(kind, pose)?))
            .map_err(|e| self.refusal(&kind.name(pose), e))
    }

    /// The inertial measurements: times from the first pose, ns, with body rates, rad/s, and specific forces,
    /// m/s^2; empty if the release has none.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn inertial(&self) -> Result<Vec<(i64, [DVec3; 2])>, TreeError> {
        let name = format!("imu/{SAMPLES}");
        if !self.has(&name)? {
            return Ok(Vec::new());
        }
        let lines = read_lines(&self.read(&name)?, SAMPLES_HEAD).map_err(|e| self.refusal(&name, e))?;
        let vectors = |v: Vec<f64>| [DVec3::from_slice(&v[..3]), DVec3::from_slice(&v[3..6])];
        Ok(lines.into_iter().map(|(stamp, values)| (stamp, vectors(values))).collect())
    }

    /// Opens the stream of events of a sensor; see [`event_file`].
    ///
    /// # Errors
    /// It cannot be read.
    pub fn events(&self, sensor: Option<&str>) -> Result<h5::Reader, TreeError> {
        let name = event_file(sensor);
        let place = self.files.place(&self.path(&name)).map_err(|e| self.refusal(&name, e))?;
        h5::Reader::open(&place).map_err(|e| self.refusal(&name, e))
    }

    /// Calls `see` with each event from `first_us` to `last_us`, both included, and its time in
    /// microseconds, in the order of the file. Chunks are read one at a time.
    ///
    /// # Errors
    /// The events cannot be read, are not sorted, or lie outside the sensor; or `see` fails.
    pub fn for_each_event<E: From<TreeError>>(
        &self,
        sensor: Option<&str>,
        [first_us, last_us]: [i64; 2],
        mut see: impl FnMut(&Event, i64) -> Result<(), E>,
    ) -> Result<(), E> {
        let unreadable = |because: String| self.refusal(&event_file(sensor), because);
        let size = self.camera.size;
        let mut events = self.events(sensor)?;
        let (mut chunk, mut last) = (Vec::new(), i64::MIN);
        while events.next_chunk(&mut chunk).map_err(|e| unreadable(e.to_string()))? {
            for event in &chunk {
                let t_us = event.t.floor_micros();
                if t_us < last || u32::from(event.x) >= size.width || u32::from(event.y) >= size.height {
                    let because = format!("an event at {t_us} us is not sorted, or is outside of {size}");
                    return Err(unreadable(because).into());
                }
                last = t_us;
                // The stream is sorted, so no later event lies in the interval.
                if t_us > last_us {
                    return Ok(());
                }
                if t_us >= first_us {
                    see(event, t_us)?;
                }
            }
        }
        Ok(())
    }
}
