//! Files of scenes that change with time: a scene with tracks, or a folder with a sequence of scene files.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_scene::ply;
//! use gs2e_scene::dynamic::file::{read_dynamic, default_time};
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0; 3], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! let folder = std::env::temp_dir().join(format!("gs2e-scene-frames-{}", std::process::id()));
//! std::fs::create_dir_all(&folder)?;
//! for name in ["frame-0.ply", "frame-1.ply"] {
//!     ply::write_ply(&scene, std::fs::File::create(folder.join(name))?)?;
//! }
//! let time = default_time(&folder)?.ok_or("a scene at rest")?;
//! let sequence = read_dynamic(&folder, time)?;
//! # std::fs::remove_dir_all(&folder)?;
//! // The usual rate is 30 Hz, and the second frame is the last one.
//! assert_eq!(sequence.dynamics().map(|dynamics| dynamics.end_s()), Some(1.0 / 30.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::splatv::{self, read_splatv};
use super::{SceneSpan, SceneTime, SplatCourse, SplatDynamics, SplatFrames, SplatTrack};
use crate::motion::SceneMotion;
use crate::ply::TrackColours;
use crate::{Gaussians, SceneError, ply, read_file};
use gs2e_files as files;
use gs2e_files::natural;
use serde::{Deserialize, Serialize};
use std::io::{self, Read as _, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum number of frames of a sequence.
pub const MAX_FRAMES: usize = 10_000;

/// Extensions of the files of a sequence.
const FRAME_FILES: [&str; 4] = ["ply", "spz", "splat", "sog"];

/// Reads a scene that changes with time.
///
/// # Errors
/// A file cannot be read or lacks a track, or the frames of a sequence do not fit together.
pub fn read_dynamic(path: &Path, time: SceneTime) -> Result<Gaussians, SceneError> {
    if time.is_sequence() {
        let listed =
            frame_files(path).map_err(|because| SceneError::File { path: path.to_owned(), because })?;
        return read_frames(path, &listed, time);
    }
    let (scene, tracks) = read_tracks(path, TrackColours::Plain)?;
    Ok(scene.with_dynamics(time, SplatCourse::Tracks(tracks)))
}

/// The usual time of what changes: 1 s for a file with tracks, 30 frames per second for a folder with scene
/// files. `None` for a scene at rest.
///
/// # Errors
/// The file or the folder cannot be read.
pub fn default_time(path: &Path) -> io::Result<Option<SceneTime>> {
    if path.is_dir() {
        let is_sequence = frame_files(path)?.len() > 1;
        return Ok(is_sequence.then(|| SceneTime { span: SceneSpan::Rate(30.0), ..SceneTime::default() }));
    }
    let mut head = Vec::new();
    files::open(path)?.take(ply::MAX_HEADER as u64 + 1).read_to_end(&mut head)?;
    let changes = head.starts_with(&splatv::MAGIC) || ply::has_tracks_at(&head);
    Ok(changes.then(SceneTime::default))
}

/// The scene of a file with a track for each of its Gaussians, and the tracks.
///
/// # Errors
/// The file cannot be read.
pub fn read_tracks(path: &Path, colours: TrackColours) -> Result<(Gaussians, Vec<SplatTrack>), SceneError> {
    let bytes = files::read(path, files::MAX_SCENE)
        .map_err(|because| SceneError::File { path: path.to_owned(), because })?;
    let failed = |because| SceneError::Content { path: path.to_owned(), because: Box::new(because) };
    let read = if bytes.starts_with(&splatv::MAGIC) {
        read_splatv(&bytes)
    } else {
        ply::read_tracks(&bytes, colours)
    };
    read.map_err(failed)
}

/// The scene files of a folder, in the natural order of their names. Hidden ones are left out.
///
/// # Errors
/// The folder cannot be read.
pub fn frame_files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let name = entry?.file_name();
        let is_frame = |name: &&str| {
            let extension = Path::new(name).extension();
            !name.starts_with('.')
                && extension.is_some_and(|e| FRAME_FILES.iter().any(|known| e.eq_ignore_ascii_case(known)))
        };
        names.extend(name.to_str().filter(is_frame).map(str::to_owned));
    }
    names.sort_by(|a, b| natural::compare_names(a, b));
    Ok(names.iter().map(|name| folder.join(name)).collect())
}

/// The scene of a sequence of files. `folder` names it in errors.
///
/// # Errors
/// A file cannot be read, or the frames do not fit together.
pub fn read_frames(folder: &Path, listed: &[PathBuf], time: SceneTime) -> Result<Gaussians, SceneError> {
    let failed = |because| SceneError::Frames { path: folder.to_owned(), because };
    if listed.len() > MAX_FRAMES {
        return Err(failed(format!("found {} frames, wanted at most {MAX_FRAMES}", listed.len())));
    }
    let name =
        |k: usize| listed.get(k).and_then(|path| path.file_name()).unwrap_or_default().display().to_string();
    let mut frames = Vec::with_capacity(listed.len());
    for (k, file) in listed.iter().enumerate() {
        let frame = read_file(file)?;
        // Without it, the Gaussians after it would be taken for others.
        if frame.screening.non_finite > 0 {
            let count = frame.screening.non_finite;
            return Err(failed(format!(
                "{}: {count} Gaussians hold a NaN or an infinity, wanted 0",
                name(k)
            )));
        }
        frames.push(frame);
    }
    let frames = SplatFrames::new(frames).map_err(|(number, because)| {
        failed(if number == 0 { because } else { format!("{}: {because}", name(number)) })
    })?;
    let first = frames.frames()[0].clone();
    Ok(first.with_dynamics(time, SplatCourse::Frames(frames)))
}

/// The record of a scene that changes, which is stored next to its files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DynamicsRecord {
    /// Its time.
    pub time: SceneTime,
    /// Number of the frames of a sequence; 0 for a scene with tracks.
    pub frames: usize,
}

impl DynamicsRecord {
    /// Names of the files of the scene.
    pub fn names(&self) -> impl Iterator<Item = String> {
        let name =
            |number| if number == 0 { "scene.ply".to_owned() } else { format!("frame-{number:06}.ply") };
        (0..self.frames.max(1)).map(name)
    }
}

impl SplatDynamics {
    /// The record next to the files of the scene.
    #[must_use]
    pub fn record(&self) -> DynamicsRecord {
        let frames = match &self.course {
            SplatCourse::Tracks(_) => 0,
            SplatCourse::Frames(frames) => frames.frames().len(),
        };
        DynamicsRecord { time: self.time, frames }
    }
}

/// The scene of stored files, in the order of [`DynamicsRecord::names`].
///
/// # Errors
/// A file cannot be read, or they do not fit together.
pub fn open_files(record: &DynamicsRecord, listed: &[PathBuf]) -> Result<Gaussians, SceneError> {
    match listed {
        [one] if record.frames == 0 => {
            let (scene, tracks) = read_tracks(one, TrackColours::Harmonics)?;
            Ok(scene.with_dynamics(record.time, SplatCourse::Tracks(tracks)))
        }
        _ => read_frames(Path::new("frame-*.ply"), listed, record.time),
    }
}

/// A file of a scene.
#[derive(Debug, Clone, Copy)]
pub struct SceneFile<'a> {
    scene: &'a Gaussians,
    tracks: Option<&'a [SplatTrack]>,
}

impl SceneFile<'_> {
    /// Writes the file.
    ///
    /// # Errors
    /// `out` fails.
    pub fn write(self, out: impl Write) -> io::Result<()> {
        match self.tracks {
            Some(tracks) => ply::write_tracks(self.scene, tracks, out),
            None => ply::write_ply(self.scene, out),
        }
    }
}

/// The files of a scene with their names: one, or one per frame of a sequence.
#[must_use]
pub fn scene_files(scene: &Gaussians) -> Vec<(String, SceneFile<'_>)> {
    let plain = |scene| SceneFile { scene, tracks: None };
    let Some(dynamics) = scene.dynamics() else { return vec![("scene.ply".to_owned(), plain(scene))] };
    let files = match &dynamics.course {
        SplatCourse::Tracks(tracks) => vec![SceneFile { scene, tracks: Some(tracks) }],
        SplatCourse::Frames(frames) => frames.frames().iter().map(plain).collect(),
    };
    dynamics.record().names().zip(files).collect()
}

impl Gaussians {
    /// The scene with this change of its Gaussians.
    #[must_use]
    pub fn with_dynamics(self, time: SceneTime, course: SplatCourse) -> Self {
        let dynamics = Some(SplatDynamics { time, course });
        Self { motion: Some(Arc::new(SceneMotion { objects: Vec::new(), dynamics })), ..self }
    }
}
