//! Places of objects against their paths in the recipe.
//!
//! A path is a function of time, so each line of `objects.csv` follows from the recipe and its stamp, to the
//! rounding of 64 bits. The recipe may leave open the point about which an object turns: then it is the point
//! that explains the places best. The comparison finds lines that are missing, of another object or time, and
//! another scale, sign, path or unit of places and velocities.

use super::{Finding, judge_agreement};
use glam::{DMat3, DQuat, DVec3};
use gs2e_num::se3::rotation::{exp_vector, log_vector};
use gs2e_scene::motion::{ObjectMotion, ObjectPath, ObjectRecord, PlaceLine, SceneMotion};
use gs2e_scene::objects::{ObjectSettings, ObjectSource};

/// Largest difference, as a share of the sizes that it comes from: far above rounding, and below a visible
/// motion.
const SHARE: f64 = 1e-6;
/// Weight of no displacement in the search for a pivot, as a share of the equations: it decides along an axis
/// of all turns, where the pivot does not matter, and moves the places by 1e-7 of its distance at most.
const RIDGE: f64 = 1e-14;

/// The motion of an object on a line of `objects.csv`. `None` if the line has other columns.
#[must_use]
pub fn stated_motion(line: &PlaceLine) -> Option<ObjectMotion> {
    let v: &[f64; 13] = line.values.as_slice().try_into().ok()?;
    let rotation = DQuat::from_xyzw(v[3], v[4], v[5], v[6]);
    let pose =
        gs2e_num::se3::Se3 { rotation: rotation.normalize(), translation: DVec3::new(v[0], v[1], v[2]) };
    let (velocity, angular) = (DVec3::new(v[7], v[8], v[9]), DVec3::new(v[10], v[11], v[12]));
    Some(ObjectMotion { pose, velocity, angular })
}

/// Compares the lines of `objects.csv` with the paths of the objects at these stamps.
#[must_use]
pub fn judge_places(
    subject: &str,
    objects: &[ObjectSettings],
    stamps_us: &[i64],
    lines: &[PlaceLine],
) -> Finding {
    let faults = match order_fault(objects, stamps_us, lines) {
        Some(fault) => vec![fault],
        None => {
            (0..objects.len()).filter_map(|i| object_fault(&objects[i], i, objects.len(), lines)).collect()
        }
    };
    judge_agreement(subject, "objects", "the places of segmentation/objects.csv", &faults)
}

/// The first line that is not that of its stamp and object, or the number of lines if that is wrong.
fn order_fault(objects: &[ObjectSettings], stamps_us: &[i64], lines: &[PlaceLine]) -> Option<String> {
    let numbers = || (1_u8..=u8::MAX).zip(objects);
    let wanted =
        stamps_us.iter().flat_map(|stamp| numbers().map(move |(number, own)| (*stamp, number, &own.name)));
    for (i, ((stamp, number, name), line)) in wanted.zip(lines).enumerate() {
        if (line.stamp_us, line.number, &line.name) != (stamp, number, name) {
            let PlaceLine { stamp_us: found_us, number: found, .. } = line;
            return Some(format!(
                "line {} of segmentation/objects.csv is of object {found} at {found_us} us, wanted {number}, {name}, at \
                 {stamp} us",
                i + 2
            ));
        }
    }
    let wanted = stamps_us.len() * objects.len();
    let found = lines.len();
    (found != wanted).then(|| {
        format!("segmentation/objects.csv has {found} lines, wanted {wanted}: one for each pose and object")
    })
}

/// The largest difference of an object from its path, if it is too large.
fn object_fault(object: &ObjectSettings, i: usize, count: usize, lines: &[PlaceLine]) -> Option<String> {
    let own: Vec<(f64, ObjectMotion)> = lines
        .iter()
        .skip(i)
        .step_by(count)
        .filter_map(|line| Some((line.stamp_us as f64 * 1e-6, stated_motion(line)?)))
        .collect();
    let path = match path_of(object, &own) {
        Ok(path) => path,
        Err(because) => return Some(because),
    };
    let differences =
        own.iter().map(|(seconds, stated)| (*seconds, difference(stated, &path.objects[0].at(*seconds))));
    let (seconds, (what, off)) = differences.max_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
    (off > SHARE || off.is_nan()).then(|| {
        format!(
            "segmentation/objects.csv: the {what} of {} at {seconds} s differs from its path in the recipe by {off:.2e} \
             of its size",
            object.name
        )
    })
}

/// The worst of the four quantities of a motion, and its difference as a share of the sizes that it comes
/// from.
fn difference(stated: &ObjectMotion, expected: &ObjectMotion) -> (&'static str, f64) {
    let arm = expected.pose.translation.length().max(1.0);
    let turn = expected.angular.length();
    let off = [
        ("place", (stated.pose.translation - expected.pose.translation).length() / arm),
        ("rotation", log_vector(stated.pose.rotation.conjugate() * expected.pose.rotation).length()),
        (
            "velocity",
            (stated.velocity - expected.velocity).length()
                / (expected.velocity.length() + turn * arm).max(1.0),
        ),
        ("angular velocity", (stated.angular - expected.angular).length() / turn.max(1.0)),
    ];
    off.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or(("place", 0.0))
}

/// The path of an object as the recipe states it, about the stated pivot or the one that explains `stated`.
fn path_of(object: &ObjectSettings, stated: &[(f64, ObjectMotion)]) -> Result<SceneMotion, String> {
    let (rotation, translation) = match &object.from {
        ObjectSource::Scene { at, turn, .. } => {
            (exp_vector(DVec3::from_array(turn.to_array().map(f64::to_radians))), *at)
        }
        _ => (DQuat::IDENTITY, DVec3::ZERO),
    };
    // The axes of the file have the origin of the file, so that shifts of stored positions do not count.
    let about = |pivot: DVec3| {
        let (name, path) = (object.name.clone(), object.path.clone());
        let record = ObjectRecord { name, first: 0, shift: DVec3::ZERO, rotation, translation, pivot, path };
        SceneMotion::prepare(vec![record]).map_err(|e| e.to_string())
    };
    match (&object.path, object.pivot) {
        (ObjectPath::Orbit { centre, .. }, _) => about(*centre),
        (_, Some(pivot)) => about(pivot),
        (_, None) => about(found_pivot(&about(DVec3::ZERO)?, stated)),
    }
}

/// The pivot `p` with the least squares of `(1 - R) p + T - stated`, `T` the place with a pivot at the
/// origin.
fn found_pivot(at_origin: &SceneMotion, stated: &[(f64, ObjectMotion)]) -> DVec3 {
    let rest = at_origin.objects[0].record.rotation.conjugate();
    let (mut square, mut side) = (DMat3::ZERO, DVec3::ZERO);
    for (seconds, stated) in stated {
        let expected = at_origin.objects[0].at(*seconds).pose;
        let turn = DMat3::IDENTITY - DMat3::from_quat(expected.rotation * rest);
        square += turn.transpose() * turn;
        side += turn.transpose() * (stated.pose.translation - expected.translation);
    }
    let trace = square.x_axis.x + square.y_axis.y + square.z_axis.z;
    let square = square + DMat3::from_diagonal(DVec3::splat(RIDGE * trace));
    // Without a turn, each pivot is as good.
    if trace > 0.0 { square.inverse() * side } else { DVec3::ZERO }
}
