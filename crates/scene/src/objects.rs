//! Scenes with objects: Gaussians of a scene, or other scenes that are placed in it, as its moving objects.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_scene::motion::ObjectPath;
//! use gs2e_scene::objects::{ObjectSettings, ObjectSource, add_objects};
//!
//! # let mut collector = GaussianCollector::new(0, 3)?;
//! # for position in [[0.0; 3], [5.0, 0.0, 0.0], [6.0, 0.0, 0.0]] {
//! #     let (rotation, sh) = ([1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! #     collector.push(&Gaussian { position, log_scale: [-1.0; 3], rotation, opacity_logit: 0.0, sh });
//! # }
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! // `scene` has three Gaussians, at x = 0, 5 and 6. The first one rises.
//! let from = ObjectSource::Sphere { centre: DVec3::ZERO, radius: 1.0 };
//! let path = ObjectPath::Straight { velocity: DVec3::NEG_Y, spin: DVec3::ZERO };
//! let object = ObjectSettings { name: "balloon".into(), from, pivot: None, path };
//! let scene = add_objects(&scene, &[object])?;
//! // What moves comes last.
//! assert_eq!([0, 1, 2].map(|i| scene.object_of(i)), [0, 0, 1]);
//! assert_eq!(scene.position(2), DVec3::ZERO);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::motion::{MAX_OBJECTS, ObjectPath, ObjectPathError, ObjectRecord, SceneMotion};
use super::{Gaussians, SceneError, read_file};
use glam::{DQuat, DVec3};
use gs2e_files as files;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use serde::Serialize;
use std::io::BufRead as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An object: its Gaussians and its path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObjectSettings {
    /// Name.
    pub name: String,
    /// The source of its Gaussians.
    pub from: ObjectSource,
    /// The point about which it turns, world coordinates; the mean of its means if there is none here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pivot: Option<DVec3>,
    /// Its path.
    pub path: ObjectPath,
}

/// The source of an object's Gaussians.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObjectSource {
    /// The Gaussians of the scene whose means are in a box, its faces included.
    Box {
        /// Its least corner, world coordinates.
        low: DVec3,
        /// Its greatest corner.
        high: DVec3,
    },
    /// The Gaussians of the scene whose means are in a ball, its surface included.
    Sphere {
        /// Its centre, world coordinates.
        centre: DVec3,
        /// Its radius, scene units.
        radius: f64,
    },
    /// The Gaussians of the scene with the numbers in a file, whose content enters the key by its digest.
    Ids {
        /// The file: one number a line, from 0, in the order of the scene file.
        #[serde(skip)]
        file: PathBuf,
    },
    /// A scene file of its own, whose content enters the key by its digest.
    Scene {
        /// Place of the file's origin, world coordinates.
        at: DVec3,
        /// Turn of the file's axes: the axis in world axes, as long as the angle in degrees.
        turn: DVec3,
        /// Scene units per unit of the file.
        scale: f64,
        /// True for a `.splat` file, which only its name tells.
        splat: bool,
        /// The file.
        #[serde(skip)]
        file: PathBuf,
    },
}

impl ObjectSettings {
    /// Its place at rest, world from object, but for the origins that positions are stored relative to.
    #[must_use]
    pub fn rest(&self) -> Se3 {
        match &self.from {
            ObjectSource::Scene { at, turn, .. } => {
                let turn = DVec3::from_array(turn.to_array().map(f64::to_radians));
                Se3 { rotation: exp_vector(turn), translation: *at }
            }
            _ => Se3 { rotation: DQuat::IDENTITY, translation: DVec3::ZERO },
        }
    }

    /// The point about which it turns, if that does not depend on its Gaussians.
    #[must_use]
    pub fn stated_pivot(&self) -> Option<DVec3> {
        match &self.path {
            ObjectPath::Orbit { centre, .. } => Some(*centre),
            _ => self.pivot,
        }
    }
}

impl ObjectSource {
    /// The file that it reads.
    #[must_use]
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Ids { file } | Self::Scene { file, .. } => Some(file),
            Self::Box { .. } | Self::Sphere { .. } => None,
        }
    }
}

/// The reason why objects cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ObjectError {
    /// A file cannot be read.
    #[error("object {name}: {because}")]
    File {
        /// The object.
        name: String,
        /// The reason, with the file.
        because: String,
    },
    /// No Gaussian is selected.
    #[error(
        "object {name} selects none of the {of} Gaussians of the scene; `gs2e info` shows where they are"
    )]
    Empty {
        /// The object.
        name: String,
        /// Number of Gaussians of the scene.
        of: usize,
    },
    /// Two objects select the same Gaussians.
    #[error("objects {one} and {other} share {count} Gaussians; wanted each in one object")]
    Shared {
        /// The earlier object.
        one: String,
        /// The later object.
        other: String,
        /// Number of Gaussians.
        count: usize,
    },
    /// Too many objects.
    #[error("found {0} objects, wanted at most {MAX_OBJECTS}")]
    TooMany(usize),
    /// A path is not one.
    #[error(transparent)]
    Path(#[from] ObjectPathError),
}

/// The scene with its objects, which move. What is still keeps its order and comes first; the objects
/// follow in their order.
///
/// # Errors
/// A file cannot be read, an object is empty, two of them share Gaussians, or a path is not one.
pub fn add_objects(scene: &Gaussians, objects: &[ObjectSettings]) -> Result<Gaussians, ObjectError> {
    if objects.len() > MAX_OBJECTS {
        return Err(ObjectError::TooMany(objects.len()));
    }
    let owners = owners_of(scene, objects)?;
    let placed = objects.iter().map(placed_scene).collect::<Result<Vec<_>, _>>()?;
    let degree = placed.iter().flatten().map(|scene| scene.sh_degree).fold(scene.sh_degree, u8::max);
    let mut all = Gaussians { sh_degree: degree, motion: None, ..scene.empty() };
    let owned = |owner: u8| owners.iter().enumerate().filter(move |(_, o)| **o == owner).map(|(i, _)| i);
    all.extend_from(scene, owned(0));
    let mut records = Vec::with_capacity(objects.len());
    for (number, (object, placed)) in (1_u8..=u8::MAX).zip(objects.iter().zip(&placed)) {
        let first = all.len();
        let Se3 { rotation, translation } = object.rest();
        let shift = match (placed, &object.from) {
            (Some(own), ObjectSource::Scene { scale, .. }) => {
                all.extend_from(own, 0..own.len());
                grow(&mut all, first, *scale);
                // `grow` scales positions about the file's origin, so the origin itself is scaled here.
                own.origin * *scale - scene.origin
            }
            _ => {
                all.extend_from(scene, owned(number));
                DVec3::ZERO
            }
        };
        let count = (all.len() - first) as f64;
        // `position` adds the origin of the scene, and `shift` takes it off for an object with its own file.
        let mean = (first..all.len()).map(|i| all.position(i) / count).sum::<DVec3>() + shift;
        let pivot = object.stated_pivot().unwrap_or(rotation * mean + translation);
        let (name, path) = (object.name.clone(), object.path.clone());
        records.push(ObjectRecord { name, first, shift, rotation, translation, pivot, path });
    }
    all.motion = Some(Arc::new(SceneMotion::prepare(records)?));
    Ok(all)
}

/// The number of the object that selects each Gaussian of the scene, from 1; 0 for none.
fn owners_of(scene: &Gaussians, objects: &[ObjectSettings]) -> Result<Vec<u8>, ObjectError> {
    let mut owners = vec![0_u8; scene.len()];
    for (number, object) in (1_u8..=u8::MAX).zip(objects) {
        let Some(selected) = select(scene, object)? else { continue };
        if selected.is_empty() {
            return Err(ObjectError::Empty { name: object.name.clone(), of: scene.len() });
        }
        if let Some(&shared) = selected.iter().find(|i| owners[**i] > 0) {
            let one = owners[shared];
            let count = selected.iter().filter(|i| owners[**i] == one).count();
            let one = objects[usize::from(one) - 1].name.clone();
            return Err(ObjectError::Shared { one, other: object.name.clone(), count });
        }
        selected.into_iter().for_each(|i| owners[i] = number);
    }
    Ok(owners)
}

/// The indices that an object selects of the scene; `None` for one with a scene of its own.
fn select(scene: &Gaussians, object: &ObjectSettings) -> Result<Option<Vec<usize>>, ObjectError> {
    let within =
        |holds: &dyn Fn(DVec3) -> bool| (0..scene.len()).filter(|i| holds(scene.position(*i))).collect();
    Ok(Some(match &object.from {
        ObjectSource::Box { low, high } => within(&|p| p.cmpge(*low).all() && p.cmple(*high).all()),
        ObjectSource::Sphere { centre, radius } => {
            within(&|p| (p - *centre).length_squared() <= radius * radius)
        }
        ObjectSource::Ids { file } => {
            let failed = |because| ObjectError::File { name: object.name.clone(), because };
            read_ids(file, scene.len()).map_err(|e| failed(format!("{}: {e}", file.display())))?
        }
        ObjectSource::Scene { .. } => return Ok(None),
    }))
}

/// Numbers of Gaussians, one a line, ascending and each once.
fn read_ids(file: &Path, count: usize) -> Result<Vec<usize>, String> {
    let bytes = files::read(file, files::MAX_SCENE).map_err(|e| e.to_string())?;
    let mut ids = Vec::new();
    for (line, text) in bytes.lines().enumerate() {
        let text = text.map_err(|e| e.to_string())?;
        if text.trim().is_empty() {
            continue;
        }
        match text.trim().parse::<usize>() {
            Ok(id) if id < count => ids.push(id),
            _ => {
                let found = text.trim().escape_debug();
                return Err(format!(
                    "line {}: found `{found}`, wanted a number from 0 to {}",
                    line + 1,
                    count - 1
                ));
            }
        }
    }
    ids.sort_unstable();
    ids.dedup();
    Ok(ids)
}

fn placed_scene(object: &ObjectSettings) -> Result<Option<Gaussians>, ObjectError> {
    let ObjectSource::Scene { file, .. } = &object.from else { return Ok(None) };
    let failed = |e: SceneError| ObjectError::File { name: object.name.clone(), because: e.to_string() };
    read_file(file).map(Some).map_err(failed)
}

/// Scales the Gaussians from `first` on about their local origin.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits of a scene")]
fn grow(scene: &mut Gaussians, first: usize, scale: f64) {
    if (scale - 1.0).abs() == 0.0 {
        return;
    }
    let (more, log) = (|x: f32| (f64::from(x) * scale) as f32, libm::log(scale));
    scene.positions[first..].iter_mut().for_each(|p| *p = p.map(more));
    let scales = scene.log_scales[first..].iter_mut();
    scales.for_each(|s| *s = s.map(|x| (f64::from(x) + log) as f32));
}

impl Gaussians {
    /// A scene of the same kind without Gaussians.
    fn empty(&self) -> Self {
        Self {
            origin: self.origin,
            positions: Vec::new(),
            log_scales: Vec::new(),
            rotations: Vec::new(),
            opacity_logits: Vec::new(),
            sh: Vec::new(),
            sh_degree: self.sh_degree,
            antialiased: self.antialiased,
            screening: self.screening,
            motion: None,
        }
    }

    /// Appends Gaussians of another scene, with 0 for harmonics that it lacks.
    fn extend_from(&mut self, other: &Self, indices: impl IntoIterator<Item = usize>) {
        let lacking = self.sh_len() - other.sh_len();
        for i in indices {
            self.positions.push(other.positions[i]);
            self.log_scales.push(other.log_scales[i]);
            self.rotations.push(other.rotations[i]);
            self.opacity_logits.push(other.opacity_logits[i]);
            self.sh.extend_from_slice(other.sh_of(i));
            self.sh.extend(std::iter::repeat_n([0.0; 3], lacking));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::collector::{Gaussian, GaussianCollector};

    /// 400 Gaussians of SH degree 2 in a cube of side 3 about the origin.
    fn scene() -> Gaussians {
        let mut gaussians = GaussianCollector::new(2, 400).unwrap();
        for i in 0..400_u16 {
            let value = |k: u16| ((f32::from(i) + 0.37 * f32::from(k)) * 0.618_034).fract() - 0.5;
            gaussians.push(&Gaussian {
                // The points of Roberts' R3 sequence fill the cube evenly.
                position: [0.819_172_5, 0.671_043_6, 0.549_700_5]
                    .map(|a| 3.0 * ((f32::from(i) * a).fract() - 0.5)),
                log_scale: [3, 4, 5].map(|k| value(k) - 4.0),
                rotation: [6, 7, 8, 9].map(value),
                opacity_logit: value(10),
                sh: &[11, 12, 13].map(value).map(|v| [v; 3]).repeat(3),
            });
        }
        gaussians.finish(DVec3::ZERO, None).unwrap()
    }

    fn object(name: &str, from: ObjectSource) -> ObjectSettings {
        let path = ObjectPath::Straight { velocity: DVec3::X, spin: DVec3::ZERO };
        ObjectSettings { name: name.into(), from, pivot: None, path }
    }

    fn ball(name: &str, radius: f64) -> ObjectSettings {
        object(name, ObjectSource::Sphere { centre: DVec3::ZERO, radius })
    }

    #[test]
    fn selected_gaussians_come_last_and_nothing_else_changes() {
        let scene = scene();
        let made = add_objects(&scene, &[ball("ball", 0.7)]).unwrap();
        let inside = |i: &usize| scene.position(*i).length() <= 0.7;
        let (own, still): (Vec<usize>, Vec<usize>) = (0..scene.len()).partition(inside);
        assert!(!own.is_empty() && !still.is_empty());
        assert_eq!(
            (made.object_end(0), made.object_end(1), made.object_count()),
            (still.len(), scene.len(), 1)
        );
        for (k, i) in still.iter().chain(&own).enumerate() {
            assert_eq!((made.positions[k], made.sh_of(k)), (scene.positions[*i], scene.sh_of(*i)));
            assert_eq!(made.object_of(k), usize::from(k >= still.len()));
        }
        // At rest, the object is where it was.
        let rest = made.motion.as_ref().unwrap().objects[0].at(0.0).pose;
        assert_eq!((rest.rotation, rest.translation.length() < 1e-15), (DQuat::IDENTITY, true));
    }

    #[test]
    fn faulty_selections_are_named() {
        let scene = scene();
        let t = |objects: &[ObjectSettings], wanted: &str| {
            assert_eq!(add_objects(&scene, objects).unwrap_err().to_string(), wanted);
        };
        let far = ObjectSource::Sphere { centre: DVec3::splat(1e4), radius: 1.0 };
        t(
            &[object("far", far)],
            "object far selects none of the 400 Gaussians of the scene; `gs2e info` shows where they are",
        );
        let whole = ObjectSource::Box { low: DVec3::splat(-1e3), high: DVec3::splat(1e3) };
        let inside = (0..scene.len()).filter(|i| scene.position(*i).length() <= 0.7).count();
        t(
            &[ball("ball", 0.7), object("all", whole)],
            &format!("objects ball and all share {inside} Gaussians; wanted each in one object"),
        );
    }

    #[test]
    fn a_placed_scene_is_scaled_and_has_the_degree_of_both() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cup.ply");
        let cup = scene().with_degree(0);
        crate::ply::write_ply(&cup, std::fs::File::create(&file).unwrap()).unwrap();
        let from = ObjectSource::Scene {
            at: DVec3::new(0.0, 0.0, 5.0),
            turn: DVec3::new(0.0, 90.0, 0.0),
            scale: 0.5,
            splat: false,
            file,
        };
        let made = add_objects(&scene(), &[object("cup", from)]).unwrap();
        assert_eq!((made.len(), made.sh_degree, made.object_end(0)), (800, 2, 400));
        assert!(made.sh_of(500)[1..].iter().all(|c| c.iter().all(|v| v.to_bits() == 0)));
        assert!((made.log_scales[400][0] - (cup.log_scales[0][0] - 2_f32.ln())).abs() < 1e-5);
        let pose = made.motion.as_ref().unwrap().objects[0].at(0.0).pose;
        let [x, y, z] = cup.positions[0].map(|v| f64::from(v) * 0.5);
        // A quarter turn about y takes z to x and x to -z.
        let wanted = DVec3::new(z, y, 5.0 - x);
        assert!((pose.rotation * made.position(400) + pose.translation - wanted).length() < 1e-6);
    }
}
