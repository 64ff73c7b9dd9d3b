//! Objects of a scene that move as rigid bodies, on paths that are functions of time.
//!
//! ```text
//! world_from_object(t) = [ about the pivot p: X -> R(t) (X - p) + p + d(t) ] after the object's own place
//! ```
//! `d` and `R` are C2, and their derivatives are exact. Nothing of an object is ever rotated: a renderer sees
//! each object from the camera's place in the object's own axes, where its means, covariances and harmonics
//! are at rest.
//!
//! # Examples
//!
//! ```
//! use glam::{DQuat, DVec3};
//! use gs2e_scene::motion::{ObjectPath, ObjectRecord, SceneMotion};
//!
//! // An object that begins at x = 1, and makes a quarter of a turn about the z axis in a second.
//! let (name, rotation, translation) = ("moon".to_owned(), DQuat::IDENTITY, DVec3::X);
//! let path = ObjectPath::Orbit { centre: DVec3::ZERO, axis: DVec3::Z, degrees_per_second: 90.0 };
//! let [shift, pivot] = [DVec3::ZERO; 2];
//! let record = ObjectRecord { name, first: 0, shift, rotation, translation, pivot, path };
//! let motion = SceneMotion::prepare(vec![record])?;
//! let pose = motion.objects[0].at(1.0).pose;
//! assert!((pose.translation - DVec3::Y).length() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::Gaussians;
use super::dynamic::SplatDynamics;
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::se3::rotation_spline::{RotationSpline, SplineDiverged};
use gs2e_num::se3::spline::{CubicSpline, CurvePlace};
use serde::{Deserialize, Serialize};
use std::io::{self, Write};

/// Most objects of a scene: a segmentation numbers them in 8 bits, and 0 is what is still.
pub const MAX_OBJECTS: usize = 255;

/// Excess over the last keyframe that a rounded stamp may have, s.
const SLACK: f64 = 1e-6;

/// The path of an object: its motion away from its place at rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum ObjectPath {
    /// C2 splines through keyframes; the first is at 0 s. The object has no place after the last one.
    Keyframes(Vec<ObjectKeyframe>),
    /// A rotation about a fixed axis, at a constant rate.
    Orbit {
        /// A point of the axis, world coordinates.
        centre: DVec3,
        /// Direction of the axis, of any length but 0.
        axis: DVec3,
        /// Rate, right-handed about the axis, degrees/s.
        degrees_per_second: f64,
    },
    /// A constant velocity and a constant spin.
    Straight {
        /// Velocity, world axes, scene units/s.
        velocity: DVec3,
        /// Spin about the pivot: the axis in world axes, as long as the rate in degrees/s.
        spin: DVec3,
    },
}

/// A keyframe of an object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectKeyframe {
    /// Time from the first pose of the trajectory, s.
    pub at: f64,
    /// Displacement of the pivot from its place at rest, world axes, scene units.
    pub shift: DVec3,
    /// Turn about the pivot: the axis in world axes, as long as the angle in degrees.
    pub turn: DVec3,
}

/// An object as it is stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectRecord {
    /// Name.
    pub name: String,
    /// Index of its first Gaussian. The objects are the last Gaussians of a scene, one after the other.
    pub first: usize,
    /// Origin of the positions of its file minus that of the scene.
    pub shift: DVec3,
    /// Rotation of its place at rest, world from object.
    pub rotation: DQuat,
    /// Translation of its place at rest.
    pub translation: DVec3,
    /// The point about which it turns, world coordinates, at rest.
    pub pivot: DVec3,
    /// Its path.
    pub path: ObjectPath,
}

/// The moving objects of a scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SceneMotion {
    /// The objects, in the order of their Gaussians.
    pub objects: Vec<MovingObject>,
    /// The change of the Gaussians themselves, if they change.
    pub dynamics: Option<SplatDynamics>,
}

/// An object with its path prepared.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingObject {
    /// What is stored.
    pub record: ObjectRecord,
    curve: ObjectCurve,
}

#[derive(Debug, Clone, PartialEq)]
enum ObjectCurve {
    Splines {
        seconds: Vec<f64>,
        shifts: CubicSpline,
        turns: RotationSpline,
    },
    /// A turn about the pivot and a velocity, both constant: rad/s and units/s, world axes.
    Steady {
        velocity: DVec3,
        spin: DVec3,
    },
}

/// Place and motion of an object at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObjectMotion {
    /// Pose `world_from_object`.
    pub pose: Se3,
    /// Velocity of the object's origin, world axes, scene units/s.
    pub velocity: DVec3,
    /// Angular velocity, world axes, rad/s.
    pub angular: DVec3,
}

/// The reason why an object has no path.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ObjectPathError {
    /// A path cannot be laid through the keyframes.
    #[error("object {name}: {because}")]
    Path {
        /// The object.
        name: String,
        /// The keyframe found and the one wanted.
        because: String,
    },
    /// A moment outside the keyframes.
    #[error(
        "object {name} has keyframes from 0 to {end} s, found a view at {found} s; add a keyframe at its end"
    )]
    Ended {
        /// The object.
        name: String,
        /// Its last keyframe.
        end: f64,
        /// The moment.
        found: f64,
    },
}

impl SceneMotion {
    /// Prepares the paths of stored objects.
    ///
    /// # Errors
    /// No path leads through the keyframes of an object.
    pub fn prepare(records: Vec<ObjectRecord>) -> Result<Self, ObjectPathError> {
        let prepare = |record: ObjectRecord| {
            let path = |because| ObjectPathError::Path { name: record.name.clone(), because };
            let curve = ObjectCurve::new(&record.path).map_err(path)?;
            Ok(MovingObject { record, curve })
        };
        Ok(Self { objects: records.into_iter().map(prepare).collect::<Result<_, _>>()?, dynamics: None })
    }

    /// The records of the objects, as they are stored.
    pub fn records(&self) -> impl Iterator<Item = &ObjectRecord> {
        self.objects.iter().map(|object| &object.record)
    }

    /// Checks that every object has a place at this time after the first pose, s.
    ///
    /// # Errors
    /// The keyframes of an object end before.
    pub fn check(&self, seconds: f64) -> Result<(), ObjectPathError> {
        let late = self
            .objects
            .iter()
            .find_map(|object| Some((object, object.end().filter(|end| seconds > end + SLACK)?)));
        late.map_or(Ok(()), |(object, end)| {
            Err(ObjectPathError::Ended { name: object.record.name.clone(), end, found: seconds })
        })
    }
}

impl ObjectPath {
    /// Checks that there is a path.
    ///
    /// # Errors
    /// The keyframe found and the one wanted, or the reason why no spline leads through the keyframes.
    pub fn check(&self) -> Result<(), String> {
        ObjectCurve::new(self).map(|_| ())
    }
}

impl ObjectCurve {
    fn new(path: &ObjectPath) -> Result<Self, String> {
        Ok(match path {
            ObjectPath::Keyframes(keys) => {
                check_keyframes(keys)?;
                let seconds: Vec<f64> = keys.iter().map(|key| key.at).collect();
                let steps: Vec<f64> = seconds.windows(2).map(|pair| pair[1] - pair[0]).collect();
                let shifts: Vec<DVec3> = keys.iter().map(|key| key.shift).collect();
                let turns: Vec<DQuat> = keys.iter().map(|key| exp_vector(radians(key.turn))).collect();
                let turns = RotationSpline::new(&steps, &turns).map_err(|e: SplineDiverged| e.to_string())?;
                Self::Splines { shifts: CubicSpline::not_a_knot(&steps, &shifts), turns, seconds }
            }
            ObjectPath::Orbit { axis, degrees_per_second, .. } => {
                let axis = axis.try_normalize().ok_or("the axis of its orbit has the length 0")?;
                Self::Steady { velocity: DVec3::ZERO, spin: axis * degrees_per_second.to_radians() }
            }
            ObjectPath::Straight { velocity, spin } => {
                Self::Steady { velocity: *velocity, spin: radians(*spin) }
            }
        })
    }
}

fn check_keyframes(keys: &[ObjectKeyframe]) -> Result<(), String> {
    let first = keys.first().map(|key| key.at).filter(|_| keys.len() > 1);
    let Some(first) = first else { return Err(format!("found {} keyframes, wanted at least 2", keys.len())) };
    if first.abs() > 0.0 {
        return Err(format!("the first keyframe is at {first} s, wanted 0"));
    }
    match keys.windows(2).find(|pair| pair[1].at <= pair[0].at) {
        Some(pair) => {
            Err(format!("a keyframe at {} s follows one at {} s, wanted a later one", pair[1].at, pair[0].at))
        }
        None => Ok(()),
    }
}

fn radians(degrees: DVec3) -> DVec3 {
    DVec3::from_array(degrees.to_array().map(f64::to_radians))
}

impl MovingObject {
    /// The last moment at which the object has a place; `None` if it has one at all times.
    #[must_use]
    pub fn end(&self) -> Option<f64> {
        match &self.curve {
            ObjectCurve::Splines { seconds, .. } => seconds.last().copied(),
            ObjectCurve::Steady { .. } => None,
        }
    }

    /// Place and motion of the axes of its scene file, without the origin that the positions are stored
    /// relative to.
    fn moved_origin(&self, seconds: f64) -> ObjectMotion {
        let ObjectMotion { pose, velocity, angular } = self.at(seconds);
        // Positions are stored relative to an origin. The file's own zero is this far from it.
        let origin = pose.rotation * self.record.shift;
        let pose = Se3 { translation: pose.translation - origin, ..pose };
        ObjectMotion { pose, velocity: velocity - angular.cross(origin), angular }
    }

    /// Place and motion at this time after the first pose, s. Times beyond the keyframes are those of the
    /// last one.
    #[must_use]
    pub fn at(&self, seconds: f64) -> ObjectMotion {
        let (shift, turn, moving, angular) = match &self.curve {
            ObjectCurve::Splines { seconds: keys, shifts, turns } => {
                let last = keys.len() - 1;
                let t = seconds.clamp(keys[0], keys[last]);
                // Among the inner keyframes only, because no segment begins at the last one.
                let segment = keys[1..last].partition_point(|start| *start <= t);
                let at = CurvePlace { segment, x: t - keys[segment] };
                let (curve, turn) = (shifts.segment(segment), turns.rotation(at));
                // The spline gives the rate in the axes of the turning body.
                (curve.value(at.x), turn, curve.slope(at.x), turn * turns.rate(at))
            }
            ObjectCurve::Steady { velocity, spin } => {
                (*velocity * seconds, exp_vector(*spin * seconds), *velocity, *spin)
            }
        };
        let ObjectRecord { shift: origin, rotation, translation, pivot, .. } = self.record;
        let rotation = turn * rotation;
        // The place of the object's origin relative to the pivot, which turns about it.
        let arm = turn * (translation - pivot) + rotation * origin;
        let pose = Se3 { rotation, translation: pivot + shift + arm };
        ObjectMotion { pose, velocity: moving + angular.cross(arm), angular }
    }
}

/// Columns of [`write_places`].
pub(crate) const PLACES_HEAD: &str = "#stamp_us,id,name,tx,ty,tz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz";

/// Writes the motion of every object at these stamps: number and name, pose `world_from_object`, velocity of
/// the object's origin and angular velocity, both in world axes. The axes of an object are those of its scene
/// file.
///
/// # Errors
/// `out` fails.
pub fn write_places(motion: Option<&SceneMotion>, stamps_us: &[i64], mut out: impl Write) -> io::Result<()> {
    writeln!(out, "{PLACES_HEAD}")?;
    for stamp in stamps_us {
        for (number, object) in motion.into_iter().flat_map(|motion| (1..).zip(&motion.objects)) {
            let ObjectMotion { pose, velocity, angular } = object.moved_origin(*stamp as f64 * 1e-6);
            let Se3 { rotation, translation } = pose;
            write!(out, "{stamp},{number},{}", object.record.name)?;
            let vectors = [translation.to_array(), velocity.to_array(), angular.to_array()];
            let numbers =
                vectors[0].into_iter().chain(rotation.to_array()).chain(vectors[1]).chain(vectors[2]);
            // The shortest text that reads back as the same number.
            numbers.into_iter().try_for_each(|number| write!(out, ",{number}"))?;
            writeln!(out)?;
        }
    }
    out.flush()
}

/// A line of a file of [`write_places`].
#[derive(Debug, Clone, PartialEq)]
pub struct PlaceLine {
    /// Stamp of the pose.
    pub stamp_us: i64,
    /// Number of the object, from 1.
    pub number: u8,
    /// Its name.
    pub name: String,
    /// The other columns.
    pub values: Vec<f64>,
}

/// The lines of a file of [`write_places`].
///
/// # Errors
/// The first line that has another form.
pub fn read_places(bytes: &[u8]) -> Result<Vec<PlaceLine>, String> {
    place_lines(bytes)?.collect()
}

/// The lines of a file of [`write_places`], one in memory at a time.
///
/// # Errors
/// The first line has another form. Each other line is an error by itself.
pub fn place_lines(bytes: &[u8]) -> Result<impl Iterator<Item = Result<PlaceLine, String>>, String> {
    let text = str::from_utf8(bytes).map_err(|_| "it is no text".to_owned())?;
    let mut lines = text.lines();
    let columns = PLACES_HEAD.split(',').count();
    if lines.next() != Some(PLACES_HEAD) {
        return Err(format!("its first line is not {PLACES_HEAD}"));
    }
    let line = move |(number, line): (usize, &str)| {
        // One field more than the columns shows that there are too many.
        let fields: Vec<&str> = line.split(',').take(columns + 1).collect();
        let value = |text: &&str| text.parse().ok().filter(|value: &f64| value.is_finite());
        let values = || fields[3..].iter().map(value).collect::<Option<Vec<f64>>>();
        let read = || {
            let (stamp_us, number) = (fields[0].parse().ok()?, fields[1].parse().ok()?);
            Some(PlaceLine { stamp_us, number, name: fields[2].to_owned(), values: values()? })
        };
        let found = (fields.len() == columns).then(read).flatten();
        found.ok_or_else(|| format!("line {} has not the {columns} columns of the first one", number + 2))
    };
    Ok(lines.enumerate().map(line))
}

/// Returns true if a file is in the form of [`write_places`].
///
/// # Errors
/// As [`read_places`].
pub fn is_canonical(bytes: &[u8]) -> Result<bool, String> {
    let mut texts = str::from_utf8(bytes).map_err(|_| "it is no text".to_owned())?.split_inclusive('\n');
    let mut is_same = texts.next().is_some_and(|first| first.strip_suffix('\n') == Some(PLACES_HEAD));
    for line in place_lines(bytes)? {
        let PlaceLine { stamp_us, number, name, values } = line?;
        let values: String = values.iter().map(|value| format!(",{value}")).collect();
        is_same &= texts.next() == Some(format!("{stamp_us},{number},{name}{values}\n").as_str());
    }
    Ok(is_same)
}

impl Gaussians {
    /// Number of objects that move.
    #[must_use]
    pub fn object_count(&self) -> usize {
        self.motion.as_ref().map_or(0, |motion| motion.objects.len())
    }

    /// Index after the last Gaussian of an object; object 0 is what is still.
    #[must_use]
    pub fn object_end(&self, object: usize) -> usize {
        let next = self.motion.as_ref().and_then(|motion| motion.objects.get(object));
        next.map_or(self.len(), |next| next.record.first)
    }

    /// Mean of the means of an object, from 1, in its own axes, and the distance within which 95 % of them
    /// lie.
    #[must_use]
    pub fn object_ball(&self, object: usize) -> (DVec3, f64) {
        let own = self.object_end(object - 1)..self.object_end(object);
        let count = own.len().max(1) as f64;
        let centre = own.clone().map(|i| self.position(i) / count).sum::<DVec3>();
        let mut distances: Vec<f64> = own.map(|i| (self.position(i) - centre).length()).collect();
        distances.sort_unstable_by(f64::total_cmp);
        (centre, distances.get(distances.len() * 95 / 100).copied().unwrap_or(0.0))
    }

    /// The object of Gaussian `i`: 0 for what is still, and then the number of the object, from 1.
    #[must_use]
    pub fn object_of(&self, i: usize) -> usize {
        let Some(motion) = &self.motion else { return 0 };
        motion.objects.partition_point(|object| object.record.first <= i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(path: ObjectPath) -> MovingObject {
        let record = ObjectRecord {
            name: "ball".into(),
            first: 0,
            shift: DVec3::new(0.2, -0.1, 0.4),
            rotation: exp_vector(DVec3::new(0.3, 1.0, -0.4)),
            translation: DVec3::new(1.0, 2.0, -3.0),
            pivot: DVec3::new(0.5, 0.0, 1.0),
            path,
        };
        SceneMotion::prepare(vec![record]).unwrap().objects.remove(0)
    }

    fn keyframes() -> ObjectPath {
        let key = |at, shift: [f64; 3], turn: [f64; 3]| ObjectKeyframe {
            at,
            shift: shift.into(),
            turn: turn.into(),
        };
        ObjectPath::Keyframes(vec![
            key(0.0, [0.0; 3], [0.0; 3]),
            key(0.4, [1.0, 0.2, 0.0], [0.0, 60.0, 10.0]),
            key(0.7, [1.5, -0.3, 0.4], [20.0, 110.0, 0.0]),
            key(1.5, [0.0, 0.5, 1.0], [0.0, 200.0, -40.0]),
        ])
    }

    /// Central differences over 2e-5 s: their error is a third derivative, below 1e4, times 1e-10 / 6, and
    /// rounding at 1e-16 / 1e-5.
    #[test]
    fn motions_are_the_derivatives_of_places() {
        let orbit = ObjectPath::Orbit {
            centre: DVec3::new(0.0, 1.0, 0.0),
            axis: DVec3::new(0.0, 2.0, 1.0),
            degrees_per_second: 250.0,
        };
        let straight =
            ObjectPath::Straight { velocity: DVec3::new(0.4, 0.0, -2.0), spin: DVec3::new(90.0, 0.0, 700.0) };
        for path in [keyframes(), orbit, straight] {
            let object = object(path);
            for t in [0.05, 0.39, 0.5, 0.9, 1.3] {
                let h = 1e-5;
                let [before, now, after] = [t - h, t, t + h].map(|t| object.at(t));
                for point in [DVec3::ZERO, DVec3::new(3.0, -1.0, 2.0)] {
                    let place = |at: &ObjectMotion| at.pose.rotation * point + at.pose.translation;
                    let wanted = (place(&after) - place(&before)) / (2.0 * h);
                    let found = now.velocity + now.angular.cross(now.pose.rotation * point);
                    assert!((found - wanted).length() < 1e-6, "{t}: {found} for {wanted}");
                }
            }
        }
    }

    /// Both sides of a keyframe agree up to the second derivative, by differences of the exact first ones.
    #[test]
    fn keyframes_are_met_without_a_jump_of_acceleration() {
        let object = object(keyframes());
        let h = 1e-6;
        for t in [0.4, 0.7] {
            let [a, b, c] = [t - h, t, t + h].map(|t| object.at(t));
            let [left, right] = [(b.velocity - a.velocity) / h, (c.velocity - b.velocity) / h];
            // A third derivative below 1e3 changes the acceleration by 1e-3 over 1e-6 s.
            assert!((left - right).length() < 1e-2 && (b.velocity - a.velocity).length() < 1e-3, "{t}");
            assert!((c.angular - b.angular - (b.angular - a.angular)).length() / h < 1e-2, "{t}");
        }
        let end = object.at(1.5);
        let turned = exp_vector(radians(DVec3::new(0.0, 200.0, -40.0))) * object.record.rotation;
        assert!(end.pose.rotation.dot(turned).abs() > 1.0 - 1e-12);
    }

    #[test]
    fn an_orbit_takes_the_object_about_its_axis() {
        // Half a turn about the vertical axis through (0.5, ., 1), the pivot of the record.
        let orbit = ObjectPath::Orbit { centre: DVec3::ZERO, axis: DVec3::Y * 3.0, degrees_per_second: 90.0 };
        let object = object(orbit);
        let rest = object.at(0.0).pose.translation;
        let half = object.at(2.0).pose.translation;
        assert!((half - DVec3::new(1.0 - rest.x, rest.y, 2.0 - rest.z)).length() < 1e-12, "{rest} {half}");
    }

    #[test]
    fn bad_keyframes_and_late_views_are_named() {
        let t = |times: &[f64], wanted: &str| {
            let key = |at: &f64| ObjectKeyframe { at: *at, shift: DVec3::ZERO, turn: DVec3::ZERO };
            let error =
                ObjectCurve::new(&ObjectPath::Keyframes(times.iter().map(key).collect())).unwrap_err();
            assert_eq!(error, wanted);
        };
        t(&[0.0], "found 1 keyframes, wanted at least 2");
        t(&[0.5, 1.0], "the first keyframe is at 0.5 s, wanted 0");
        t(&[0.0, 1.0, 1.0], "a keyframe at 1 s follows one at 1 s, wanted a later one");
        let motion = SceneMotion { objects: vec![object(keyframes())], dynamics: None };
        assert_eq!(motion.check(1.500_000_5), Ok(()));
        let late = motion.check(1.6).unwrap_err().to_string();
        assert_eq!(
            late,
            "object ball has keyframes from 0 to 1.5 s, found a view at 1.6 s; add a keyframe at its end"
        );
    }
}
