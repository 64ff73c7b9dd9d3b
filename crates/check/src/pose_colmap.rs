//! Poses against COLMAP, which reconstructs them from a sample of the sharp pictures. Gates;
//! `registered` is a warning. The pass runs if the recipe requests it and COLMAP is installed.
//!
//! | statement | measured value | default limit |
//! |---|---|---|
//! | `registered` | share of the pictures that COLMAP registers | at least 0.9, warning |
//! | `rotation` | median angle between stated and reconstructed rotation | 0.1 degrees |
//! | `rotation-worst` | largest angle between these rotations | 0.5 degrees |
//! | `translation` | largest distance between the centres, over the path's length | 0.01 |
//!
//! The pass must find a fault of one degree in one pose; the limit of `rotation-worst` is half of
//! it.
//!
//! `foreign/align.rs` describes the alignment of the two worlds. The remaining difference on sound
//! poses is COLMAP's own error: on renderings of 640x360, the median was 0.02 to 0.12 degrees and
//! the largest 0.03 to 0.40, growing with the arc; centres agreed within 0.003 of the path. A path
//! of more than half a turn can exceed the limit of `rotation` and be sound
//! (`docs/checks.md`).

use super::subject::{Judgement, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use gs2e_num::stats::upper_median;
use gs2e_source::foreign::colmap::{ColmapRegistration, MIN_PICTURES, PoseAgreement};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Number of sharp frames to register, evenly spread. Default: `20`.
    #[serde(deserialize_with = "parse_enough", skip_serializing_if = "Option::is_none")]
    pub frames: Option<u32>,
    /// Smallest share of them that COLMAP registers. Default: `REGISTERED`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub registered: Option<f64>,
    /// Largest median angle between rotations. Unit: degrees. Default: `MAX_DEG`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub max_deg: Option<f64>,
    /// Largest angle between rotations. Unit: degrees. Default: `WORST_DEG`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub worst_deg: Option<f64>,
    /// Largest distance between centres, over the length of the path. Default: `TRANSLATION`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub translation: Option<f64>,
}

const REGISTERED: f64 = 0.9;
const MAX_DEG: f64 = 0.1;
const WORST_DEG: f64 = 0.5;
const TRANSLATION: f64 = 0.01;

/// The pass.
pub(crate) struct PoseColmap;

impl ValidationPass for PoseColmap {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let found = subject.foreign.and_then(|foreign| foreign.colmap.as_ref());
        let found = found.ok_or_else(|| limits::not_asked("pose_colmap"))?.as_ref()?;
        let ColmapRegistration { program, given, poses, .. } = found;
        let registered = format!("{program} registers {} of {given} pictures", poses.len());
        if poses.len() < MIN_PICTURES as usize {
            return Err(registered);
        }
        Ok(judge_registration(subject, found, registered))
    }
}

/// The statements on a registration; `registered` are the words for its size.
fn judge_registration(
    subject: &TrajectorySubject<'_>,
    found: &ColmapRegistration,
    registered: String,
) -> Statements {
    let limits = subject.limits.pose_colmap.unwrap_or_default();
    let ColmapRegistration { program, given, poses, .. } = found;
    let of = |value: fn(&PoseAgreement) -> f64| {
        poses.iter().max_by(|a, b| value(a).total_cmp(&value(b))).expect("there are poses")
    };
    let share = poses.len() as f64 / *given as f64;
    let least = LimitSide::limit_or(limits.registered, LimitSide::warning(REGISTERED));
    let registered = Judgement::at_least(share, least, "1", registered);
    let middle = upper_median(poses.iter().map(|p| p.rotation_deg).collect()).unwrap_or(0.0);
    let because = format!(
        "the median difference between {} stated rotations and those of {program} is {middle:.4} degrees",
        poses.len()
    );
    let (turned, moved) = (of(|p| p.rotation_deg), of(|p| p.translation));
    let bound = LimitSide::limit_or(limits.max_deg, LimitSide::gate(MAX_DEG));
    let rotation = Judgement::at_most(middle, bound, "deg", because);
    let because = format!(
        "pose {} differs by {:.4} degrees from the rotation of {program}, the largest difference",
        turned.pose, turned.rotation_deg
    );
    let bound = LimitSide::limit_or(limits.worst_deg, LimitSide::gate(WORST_DEG));
    let worst = Judgement::at_most(turned.rotation_deg, bound, "deg", because);
    let because = format!(
        "pose {} differs by {:.5} of the path's length from the centre of {program}, the largest difference",
        moved.pose, moved.translation
    );
    let bound = LimitSide::limit_or(limits.translation, LimitSide::gate(TRANSLATION));
    let translation = Judgement::at_most(moved.translation, bound, "1", because);
    vec![
        ("registered", Ok(registered)),
        ("rotation", Ok(rotation)),
        ("rotation-worst", Ok(worst)),
        ("translation", Ok(translation)),
    ]
}

fn parse_enough<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u32>, D::Error> {
    let frames = u32::deserialize(deserializer)?;
    if frames >= MIN_PICTURES {
        Ok(Some(frames))
    } else {
        Err(D::Error::custom(format_args!("{MIN_PICTURES} frames are the fewest, not {frames}")))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::planted::PlantedWorld;
    use super::*;

    fn registration(world: &mut PlantedWorld) -> &mut ColmapRegistration {
        world.foreign.colmap.as_mut().unwrap().as_mut().unwrap()
    }

    #[test]
    fn one_pose_that_is_turned_by_a_degree_is_found() {
        let mut world = PlantedWorld::default_world();
        registration(&mut world).poses[7].rotation_deg = 1.0;
        assert_eq!(world.faults(), ["pose_colmap#rotation-worst"]);
        let finding = world.finding("pose_colmap#rotation-worst");
        assert!(finding.because.starts_with("pose 49 differs by 1.0000 degrees"), "{}", finding.because);
    }

    #[test]
    fn poses_that_are_all_a_little_off_are_found() {
        let mut world = PlantedWorld::default_world();
        for pose in &mut registration(&mut world).poses {
            (pose.rotation_deg, pose.translation) = (0.11, 0.011);
        }
        assert_eq!(world.faults(), ["pose_colmap#rotation", "pose_colmap#translation"]);
        world.limits.pose_colmap =
            Some(Limits { max_deg: Some(0.2), translation: Some(0.1), ..Limits::default() });
        assert_eq!(world.faults(), [""; 0]);
    }

    #[test]
    fn pictures_without_a_place_are_told_and_too_few_say_nothing() {
        let mut world = PlantedWorld::default_world();
        registration(&mut world).poses.truncate(17);
        assert_eq!(world.finding("pose_colmap#registered").verdict, Verdict::Warn);
        registration(&mut world).poses.truncate(2);
        let finding = world.finding("pose_colmap");
        assert_eq!(finding.verdict, Verdict::NotRun);
        assert_eq!(finding.because, "COLMAP 3.8 registers 2 of 20 pictures");
    }

    #[test]
    fn nobody_asked_or_nobody_there_is_told() {
        let mut world = PlantedWorld::default_world();
        world.foreign.colmap = Some(Err("there is no program `colmap`".into()));
        assert_eq!(world.finding("pose_colmap").because, "there is no program `colmap`");
        world.foreign.colmap = None;
        let wanted = "the recipe does not request it; `checks: { pose_colmap: {} }` does";
        assert_eq!(world.finding("pose_colmap").because, wanted);
    }
}
