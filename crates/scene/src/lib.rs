//! A scene of 3D Gaussians in memory.
//!
//! Fields are stored as trained files store them (log scales, opacity logits, spherical-harmonic
//! coefficients), so that reading and writing lose nothing. The renderer applies the activations.
//! Axes are those of the scene's `.ply` form.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! use gs2e_scene::{ply, read_file};
//!
//! let mut collector = GaussianCollector::new(0, 1)?;
//! let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! let scene = collector.finish(DVec3::ZERO, None)?;
//!
//! let path = std::env::temp_dir().join(format!("gs2e-scene-root-{}.ply", std::process::id()));
//! ply::write_ply(&scene, std::fs::File::create(&path)?)?;
//! // A `.ply` file loses nothing.
//! assert_eq!(read_file(&path)?, scene);
//! # std::fs::remove_file(&path)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod blobs;
pub mod camera;
pub mod collector;
mod cursor;
pub mod dynamic;
pub mod form;
pub mod motion;
pub mod objects;
mod opacity;
pub mod ply;
mod rotation;
pub mod sh;
pub mod sog;
pub mod splat;
pub mod spz;
pub mod survey;

use glam::DVec3;
use gs2e_files as files;
use motion::SceneMotion;
use std::collections::TryReserveError;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Gaussians as a structure of arrays. All arrays have one entry per Gaussian, in file order.
#[derive(Debug, Clone, PartialEq)]
pub struct Gaussians {
    /// World position of the local origin. Zero for files with 32-bit positions, which are then
    /// exact. Files with 64-bit positions are recentred, so that 32 bits are sufficient for the
    /// rest.
    pub origin: DVec3,
    /// Means relative to `origin`, in scene units.
    pub positions: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations along the Gaussian's own axes.
    pub log_scales: Vec<[f32; 3]>,
    /// Quaternions `w, x, y, z`, as stored: not necessarily of unit length.
    pub rotations: Vec<[f32; 4]>,
    /// Opacity before the sigmoid.
    pub opacity_logits: Vec<f32>,
    /// Spherical-harmonic coefficients: Gaussian `i` owns `sh[i * n .. (i + 1) * n]` with
    /// `n = (degree + 1)^2`. Each entry has the red, green and blue coefficient of one basis
    /// function.
    pub sh: Vec<[f32; 3]>,
    /// Degree of the harmonics, 0 to 3.
    pub sh_degree: u8,
    /// True if the scene was trained with the antialiased rule; `None` if the file format cannot
    /// say.
    pub antialiased: Option<bool>,
    /// Counts of what the reader dropped or repaired.
    pub screening: SceneScreening,
    /// The objects that move, and the change of the Gaussians; `None` for a scene at rest.
    pub motion: Option<Arc<SceneMotion>>,
}

/// Counts of what the reader of a scene file dropped or repaired.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SceneScreening {
    /// Gaussians in the file.
    pub read: u64,
    /// Gaussians dropped because a field was NaN or infinite.
    pub non_finite: u64,
    /// Gaussians kept with the identity rotation because their quaternion was zero.
    pub zero_quaternions: u64,
}

impl Gaussians {
    /// Number of Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns true if there are no Gaussians.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Mean of Gaussian `i` in the world.
    #[must_use]
    pub fn position(&self, i: usize) -> DVec3 {
        self.origin + DVec3::from_array(self.positions[i].map(f64::from))
    }

    /// Number of basis functions per Gaussian: `(sh_degree + 1)^2`.
    #[must_use]
    pub fn sh_len(&self) -> usize {
        (usize::from(self.sh_degree) + 1).pow(2)
    }

    /// The scene without the harmonics above a degree.
    #[must_use]
    pub fn with_degree(&self, degree: u8) -> Self {
        let sh_degree = degree.min(self.sh_degree);
        let kept = (usize::from(sh_degree) + 1).pow(2);
        let sh = (0..self.len()).flat_map(|i| &self.sh_of(i)[..kept]).copied().collect();
        Self { sh, sh_degree, ..self.clone() }
    }

    /// The coefficients of Gaussian `i`.
    #[must_use]
    pub fn sh_of(&self, i: usize) -> &[[f32; 3]] {
        let n = self.sh_len();
        &self.sh[i * n..(i + 1) * n]
    }
}

/// The reason why a scene file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file could not be read at all.
    #[error("read `{path}`: {because}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The reason given by the system.
        because: io::Error,
    },
    /// The file's content could not be read as a scene.
    #[error("read `{path}`: {because}", path = path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The problem with the content.
        because: Box<SceneError>,
    },
    /// The bytes do not follow the format.
    #[error("read {format} at byte {offset}: found {found}, wanted {wanted}")]
    Malformed {
        /// The format, and the part of it if offsets do not count from the start of the file.
        format: &'static str,
        /// Offset in bytes from the start.
        offset: usize,
        /// Value found.
        found: String,
        /// Value wanted.
        wanted: String,
    },
    /// A format, or a variant of one, that is not supported.
    #[error("read {format} at byte {offset}: {what} is not supported; {hint}")]
    Unsupported {
        /// The format.
        format: &'static str,
        /// Offset in bytes from the start.
        offset: usize,
        /// The variant.
        what: String,
        /// Suggested remedy.
        hint: &'static str,
    },
    /// The files of a sequence do not fit together.
    #[error("read the frames of `{path}`: {because}", path = path.display())]
    Frames {
        /// The folder.
        path: PathBuf,
        /// The frame, the value found and the one wanted.
        because: String,
    },
    /// There is no memory for what the file holds.
    #[error("allocate memory for the scene: {0}")]
    Memory(#[from] TryReserveError),
    /// No Gaussian is left.
    #[error("find a Gaussian to render: of {read} in the scene, {non_finite} hold a NaN or an infinity")]
    Empty {
        /// Gaussians in the file.
        read: u64,
        /// Number of dropped Gaussians.
        non_finite: u64,
    },
}

/// The reason why a scene could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A position is out of range for the format's fixed-point numbers.
    #[error("write .spz: found a coordinate of {farthest:e}, wanted less than 2^23")]
    TooFar {
        /// Its distance from zero along an axis.
        farthest: f64,
    },
    /// The format cannot count this many Gaussians.
    #[error("write .spz: found {count} Gaussians, wanted less than 2^32")]
    TooMany {
        /// Number of Gaussians.
        count: usize,
    },
    /// The format's numbers overflow.
    #[error("write the scene: {count} Gaussians have a position or a scale out of the format's range")]
    Overflow {
        /// Number of Gaussians.
        count: usize,
    },
    /// The written bytes are not a valid scene.
    #[error("read the written scene back: {0}")]
    Unreadable(Box<SceneError>),
    /// The reason given by the system.
    #[error("write the scene: {0}")]
    Io(#[from] io::Error),
}

/// The byte nearest to `x`.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
fn nearest_byte(x: f64) -> u8 {
    x.round().clamp(0.0, 255.0) as u8
}

/// Reads a scene from one file: `.splat`, which has no signature, by its extension; `.ply` (plain
/// and compressed), `.spz` and `.sog` by their content.
///
/// # Errors
/// [`SceneError::File`] or [`SceneError::Content`].
pub fn read_file(path: &Path) -> Result<Gaussians, SceneError> {
    let bytes = files::read(path, files::MAX_SCENE)
        .map_err(|because| SceneError::File { path: path.to_owned(), because })?;
    let is_splat = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("splat"));
    let scene = if is_splat { splat::read_splat(&bytes) } else { read_by_content(&bytes) };
    scene.map_err(|because| SceneError::Content { path: path.to_owned(), because: Box::new(because) })
}

/// Reads a scene from one file, as [`read_file`], or from several: a folder with a SOG scene, or
/// its `meta.json`.
///
/// # Errors
/// [`SceneError::File`] or [`SceneError::Content`].
pub fn read_any(path: &Path) -> Result<Gaussians, SceneError> {
    let folder = if path.is_dir() {
        path
    } else if path.file_name().is_some_and(|name| name == sog::META) {
        path.parent().unwrap_or(Path::new(""))
    } else {
        return read_file(path);
    };
    sog::read_sog_folder(folder).map_err(|error| match error {
        // The error of one file names its path already.
        file @ SceneError::File { .. } => file,
        because => SceneError::Content { path: folder.to_owned(), because: Box::new(because) },
    })
}

fn read_by_content(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    let starts = |magic: &[u8]| bytes.starts_with(magic);
    if starts(b"ply\n") || starts(b"ply\r\n") {
        ply::read_ply(bytes)
    } else if starts(&spz::MAGIC) || starts(&spz::GZIP_MAGIC) {
        spz::read_spz(bytes)
    } else if starts(&sog::ZIP_MAGIC) {
        sog::read_sog(bytes)
    } else if starts(&dynamic::splatv::MAGIC) {
        Err(SceneError::Unsupported {
            format: ".splatv",
            offset: 0,
            what: "a scene that changes with time".into(),
            hint: dynamic::HINT,
        })
    } else if bytes.trim_ascii_start().starts_with(b"{") {
        // JSON is recognised only for the hint in the error.
        Err(SceneError::Unsupported {
            format: "scene",
            offset: 0,
            what: "a JSON file (the `meta.json` of a SOG?)".into(),
            hint: "zip the folder's files into one .sog",
        })
    } else {
        let head = &bytes[..bytes.len().min(4)];
        Err(SceneError::Malformed {
            format: "scene",
            offset: 0,
            found: format!("the bytes {head:02x?}"),
            wanted: "`ply`, `NGSP`, gzip or zip (a .splat file is recognised by its extension)".into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_told_apart_by_content() {
        let t = |bytes: &[u8], message: &str| {
            assert_eq!(read_by_content(bytes).unwrap_err().to_string(), message);
        };
        t(
            b"",
            "read scene at byte 0: found the bytes [], \
             wanted `ply`, `NGSP`, gzip or zip (a .splat file is recognised by its extension)",
        );
        t(
            b" {}",
            "read scene at byte 0: a JSON file (the `meta.json` of a SOG?) is not supported; \
             zip the folder's files into one .sog",
        );
        t(b"NGSP", "read .spz at byte 4: found the end of the data, wanted 4 bytes of version");
        t(b"ply\n", "read .ply at byte 4: found the end of the data, wanted a header line");
    }

    #[test]
    fn lower_degrees_keep_the_first_harmonics_of_each() {
        let scene = Gaussians {
            origin: DVec3::ZERO,
            positions: vec![[0.0; 3]; 2],
            log_scales: vec![[0.0; 3]; 2],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            opacity_logits: vec![0.0; 2],
            sh: (0u8..18).map(|i| [f32::from(i); 3]).collect(),
            sh_degree: 2,
            antialiased: None,
            screening: SceneScreening::default(),
            motion: None,
        };
        let firsts = |degree: u8| -> Vec<f32> { scene.with_degree(degree).sh.iter().map(|c| c[0]).collect() };
        assert_eq!(firsts(0), [0.0, 9.0]);
        assert_eq!(firsts(1), [0.0, 1.0, 2.0, 3.0, 9.0, 10.0, 11.0, 12.0]);
        assert_eq!(scene.with_degree(3), scene);
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = read_file(Path::new("no/such.ply")).unwrap_err().to_string();
        assert!(error.starts_with("read `no/such.ply`: "), "{error}");
    }
}
