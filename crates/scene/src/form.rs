//! Formats in which a scene can be written, and the losses of each.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! use gs2e_scene::form::SceneFormat;
//! use std::path::Path;
//!
//! # let mut collector = GaussianCollector::new(1, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.1; 3]; 4]);
//! # collector.push(&Gaussian { position: [0.0; 3], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! // `scene` has one Gaussian with harmonics of degree 1, which a `.splat` file cannot hold.
//! let format = SceneFormat::for_path(Path::new("scene.splat")).ok_or("another extension")?;
//! let (bytes, losses) = format.write(&scene)?;
//! assert_eq!((format, bytes.len()), (SceneFormat::Splat, 32));
//! assert!(losses.iter().any(|loss| loss.field == "harmonics"));
//! // A `.ply` file holds everything.
//! assert!(SceneFormat::Ply.write(&scene)?.1.is_empty());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::dynamic::splatv;
use super::{Gaussians, SceneError, WriteError, ply, rotation, sh, sog, splat, spz};
use gs2e_files as files;
use std::io::{self, Read as _};
use std::path::Path;

/// A file format that can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneFormat {
    /// Floats, without loss.
    Ply,
    /// Bytes and fixed-point numbers, with harmonics.
    Spz,
    /// Floats and bytes, without harmonics.
    Splat,
}

/// A part of a scene that a format loses.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct FormatLoss {
    /// The field.
    pub field: &'static str,
    /// The effect of the loss.
    pub what: String,
    /// The largest change from rounding, in the unit of the field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest: Option<f64>,
}

/// The form of a scene file.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct SceneFileForm {
    /// The format, in words.
    pub format: &'static str,
    /// Bits of a coordinate, if the format stores floats.
    pub position_bits: Option<u8>,
    /// True if such scenes may change with time.
    #[serde(skip)]
    pub may_change: bool,
}

/// The form of a scene, by the rules of [`super::read_any`]. The content of the file is not
/// checked.
///
/// # Errors
/// The file cannot be read.
pub fn file_form(path: &Path) -> io::Result<SceneFileForm> {
    let of = |format, position_bits| Ok(SceneFileForm { format, position_bits, may_change: false });
    let changing = |format, position_bits| Ok(SceneFileForm { format, position_bits, may_change: true });
    if path.is_dir() && !files::is_there(&path.join(sog::META)) {
        return changing("folder of scene files", None);
    }
    if path.is_dir() || path.file_name().is_some_and(|name| name == sog::META) {
        return of("folder of a SOG", None);
    }
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("splat")) {
        // Such a file has no first bytes of its own, so its name alone tells.
        return of(".splat", Some(32));
    }
    let mut head = Vec::new();
    files::open(path)?.take(ply::MAX_HEADER as u64 + 1).read_to_end(&mut head)?;
    if head.starts_with(&splatv::MAGIC) {
        changing(".splatv", Some(32))
    } else if ply::has_tracks_at(&head) {
        changing(".ply with tracks", ply::position_bits(&head))
    } else if head.starts_with(&sog::ZIP_MAGIC) {
        of(".sog", None)
    } else if !head.starts_with(b"ply") {
        of(".spz", None)
    } else {
        match ply::position_bits(&head) {
            Some(bits) => of(".ply", Some(bits)),
            None => of("compressed .ply", None),
        }
    }
}

/// Returns true if a path has a format of a scene, by its first bytes or, where these say nothing, its name.
///
/// # Errors
/// The file cannot be read.
pub fn has_scene_form(path: &Path) -> io::Result<bool> {
    let named = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    if path.is_dir() || path.file_name().is_some_and(|name| name == sog::META) || named("splat") {
        return Ok(true);
    }
    let mut head = Vec::new();
    files::open(path)?.take(16).read_to_end(&mut head)?;
    let magics: [&[u8]; 5] = [b"ply", &splatv::MAGIC, &sog::ZIP_MAGIC, &spz::MAGIC, &spz::GZIP_MAGIC];
    Ok(magics.iter().any(|magic| head.starts_with(magic)))
}

impl SceneFormat {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Ply, Self::Spz, Self::Splat];

    /// The format that belongs to a file name.
    #[must_use]
    pub fn for_path(path: &Path) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|form| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(form.extension())))
    }

    /// The file extension, without the point.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Spz => "spz",
            Self::Splat => "splat",
        }
    }

    /// The content of the file, and the losses. The content is read back and compared with `scene`.
    ///
    /// # Errors
    /// [`WriteError`] if the format cannot hold the scene at all.
    pub fn write(self, scene: &Gaussians) -> Result<(Vec<u8>, Vec<FormatLoss>), WriteError> {
        let mut bytes = Vec::new();
        let back = match self {
            Self::Ply => {
                // Floats are written as they are, so there is nothing to compare.
                ply::write_ply(scene, &mut bytes)?;
                return Ok((bytes, Vec::new()));
            }
            Self::Spz => {
                spz::write_spz(scene, &mut bytes)?;
                spz::read_spz(&bytes)
            }
            Self::Splat => {
                splat::write_splat(scene, &mut bytes)?;
                splat::read_splat(&bytes)
            }
        };
        let back = back.map_err(|e| match e {
            // Numbers beyond the format become infinite, and the reader drops those Gaussians.
            SceneError::Empty { .. } if !scene.is_empty() => WriteError::Overflow { count: scene.len() },
            other => WriteError::Unreadable(Box::new(other)),
        })?;
        // Losses are compared by index, which one dropped Gaussian would shift.
        if back.len() != scene.len() {
            return Err(WriteError::Overflow { count: scene.len() - back.len() });
        }
        let losses = self.losses(scene, &back)?;
        Ok((bytes, losses))
    }

    fn losses(self, scene: &Gaussians, back: &Gaussians) -> Result<Vec<FormatLoss>, WriteError> {
        let all = 0..scene.len();
        let largest = |of: &dyn Fn(usize) -> f64| all.clone().map(of).fold(0.0, f64::max);
        let [position, scale, turn, opacity, colour, harmonic] = self.steps(scene)?;
        let kept = scene.sh_len().min(back.sh_len());
        let opacity_of = |logit: f32| 1.0 / (1.0 + libm::exp(-f64::from(logit)));
        let rounded = [
            ("positions", position, largest(&|i| (scene.position(i) - back.position(i)).abs().max_element())),
            (
                "log scales",
                scale,
                largest(&|i| largest_difference(&scene.log_scales[i], &back.log_scales[i])),
            ),
            (
                "rotations",
                turn,
                largest(&|i| rotation::rotation_angle(scene.rotations[i], back.rotations[i])),
            ),
            (
                "opacities",
                opacity,
                largest(&|i| {
                    (opacity_of(scene.opacity_logits[i]) - opacity_of(back.opacity_logits[i])).abs()
                }),
            ),
            (
                "colours",
                colour,
                largest(&|i| sh::C0 * largest_difference(&scene.sh_of(i)[0], &back.sh_of(i)[0])),
            ),
            (
                "harmonics",
                harmonic,
                largest(&|i| {
                    largest_difference(
                        scene.sh_of(i)[1..kept].as_flattened(),
                        back.sh_of(i)[1..kept].as_flattened(),
                    )
                }),
            ),
        ];
        let rounded =
            rounded.into_iter().filter(|(.., largest)| *largest > 0.0).map(|(field, step, largest)| {
                FormatLoss {
                    field,
                    what: format!("rounded to {step}, at most {largest:.2e} off"),
                    largest: Some(largest),
                }
            });
        Ok(rounded.chain(dropped_fields(scene, back)).collect())
    }

    /// Rounding of each field: positions, log scales, rotations, opacities, colours, harmonics.
    fn steps(self, scene: &Gaussians) -> Result<[String; 6], WriteError> {
        let floats = "32 bits";
        Ok(match self {
            Self::Ply => [floats; 6].map(String::from),
            Self::Spz => {
                let bits = spz::fractional_bits(scene)?;
                let position = format!("steps of 2^-{bits} units");
                let others = [
                    "steps of 1/16 from -10 to 5.9375",
                    "unit quaternions in steps of sqrt(1/2)/511",
                    "steps of 1/255",
                    "steps of 0.0074",
                    "steps of 1/128 within 127/128",
                ];
                let [a, b, c, d, e] = others.map(String::from);
                [position, a, b, c, d, e]
            }
            Self::Splat => [
                floats,
                floats,
                "unit quaternions in steps of 1/128",
                "steps of 1/255",
                "steps of 1/255 from 0 to 1",
                floats,
            ]
            .map(String::from),
        })
    }
}

/// The largest difference between two numbers at the same place.
fn largest_difference(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs()).fold(0.0, f64::max)
}

/// Fields that are missing entirely.
fn dropped_fields(scene: &Gaussians, back: &Gaussians) -> Vec<FormatLoss> {
    let loss = |field, what: String| FormatLoss { field, what, largest: None };
    let mut losses = Vec::new();
    if back.sh_degree < scene.sh_degree {
        let what =
            format!("dropped above degree {}; the input has degree {}", back.sh_degree, scene.sh_degree);
        losses.push(loss("harmonics", what));
    }
    if scene.antialiased == Some(true) && back.antialiased != Some(true) {
        losses.push(loss("antialiased", "dropped: the reader must be set to antialiased".into()));
    }
    losses
}

#[cfg(test)]
mod tests;
