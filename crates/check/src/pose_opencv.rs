//! Poses and camera against OpenCV, which reads them as released. The pass runs if the recipe
//! requests it and OpenCV is installed.
//!
//! | statement | measured value | default limit |
//! |---|---|---|
//! | `projection` | largest distance between two projections of a point | 1e-3 px, gate |
//! | `relative-rotation` | median angle between motions of pictures | 0.5 degrees, warning |
//! | `relative-direction` | median angle between directions of translation | 10 degrees, warning |
//!
//! `projection` compares OpenCV with the renderer's camera, with the poses of `poses.txt` and with
//! those of `transforms.json`. It tests the conventions of both files: axes, direction, order of
//! numbers, centre of a pixel. No limit can be set. The other two compare the motion that OpenCV
//! finds in pictures with the stated motion. They are less precise: two views determine a motion
//! less well than twenty do (`pose_colmap`).

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use gs2e_num::stats::upper_median;
use gs2e_source::foreign::opencv::{OpencvGeometry, ProjectionAgreement, RelativeMotion};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest median angle between rotations. Unit: degrees. Default: `ROTATION_DEG`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub rotation_deg: Option<f64>,
    /// Largest median angle between directions. Unit: degrees. Default: `DIRECTION_DEG`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub direction_deg: Option<f64>,
}

const PX: f64 = 1e-3;
const ROTATION_DEG: f64 = 0.5;
const DIRECTION_DEG: f64 = 10.0;
/// Minimum number of motions for a median.
const MIN_PAIRS: usize = 3;

/// The pass.
pub(crate) struct PoseOpencv;

impl ValidationPass for PoseOpencv {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let found = subject.foreign.and_then(|foreign| foreign.opencv.as_ref());
        let geometry = found.ok_or_else(|| limits::not_asked("pose_opencv"))?.as_ref()?;
        let [rotation, direction] = judge_relative(subject, geometry);
        Ok(vec![
            ("projection", judge_projection(geometry)),
            ("relative-rotation", rotation),
            ("relative-direction", direction),
        ])
    }
}

fn judge_projection(geometry: &OpencvGeometry) -> JudgementResult {
    let files = [("poses.txt", geometry.poses_txt), ("transforms.json", geometry.transforms_json)];
    let (name, ProjectionAgreement { px, pose, points }) =
        if files[1].1.px > files[0].1.px { files[1] } else { files[0] };
    let program = &geometry.program;
    // A file without known poses has no distance, and would pass.
    if let Some((name, _)) = files.iter().find(|(_, seen)| seen.pose.is_none()) {
        return Err(format!("{name} contains none of the sampled poses, so {program} cannot be compared"));
    }
    let pose = pose.unwrap_or_default();
    let because = format!(
        "{program} projects {points} points to within {px:.2e} px of gs2e with {name}, worst in pose {pose}"
    );
    Ok(Judgement::at_most(px, LimitSide::gate(PX), "px", because))
}

fn judge_relative(subject: &TrajectorySubject<'_>, geometry: &OpencvGeometry) -> [JudgementResult; 2] {
    let OpencvGeometry { program, tried, pairs, .. } = geometry;
    let limits = subject.limits.pose_opencv.unwrap_or_default();
    let judge = |value: fn(&RelativeMotion) -> f64, limit: LimitSide| {
        if pairs.len() < MIN_PAIRS {
            return Err(format!(
                "{program} finds the motion for only {} of {tried} picture pairs: too few key points are shared \
                 by pictures that are 8 px or more apart",
                pairs.len()
            ));
        }
        let measured = upper_median(pairs.iter().map(value).collect()).unwrap_or(0.0);
        let because = format!(
            "over {} picture pairs, the motion found by {program} differs from that of the poses by {measured:.3} degrees in the median",
            pairs.len()
        );
        Ok(Judgement::at_most(measured, limit, "deg", because))
    };
    let rotation = LimitSide::limit_or(limits.rotation_deg, LimitSide::warning(ROTATION_DEG));
    let direction = LimitSide::limit_or(limits.direction_deg, LimitSide::warning(DIRECTION_DEG));
    [judge(|m| m.rotation_deg, rotation), judge(|m| m.direction_deg, direction)]
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::planted::PlantedWorld;
    use super::*;

    fn geometry(world: &mut PlantedWorld) -> &mut OpencvGeometry {
        world.foreign.opencv.as_mut().unwrap().as_mut().unwrap()
    }

    #[test]
    fn a_point_that_is_elsewhere_by_either_file_is_found() {
        let t = |plant: fn(&mut OpencvGeometry), file: &str| {
            let mut world = PlantedWorld::default_world();
            plant(geometry(&mut world));
            assert_eq!(world.faults(), ["pose_opencv#projection"]);
            let because = world.finding("pose_opencv#projection").because;
            assert!(because.contains(&format!("of gs2e with {file}, worst in pose 3")), "{because}");
        };
        t(|g| g.poses_txt.px = 1.1e-3, "poses.txt");
        t(|g| g.transforms_json.px = 0.5, "transforms.json");
        let mut world = PlantedWorld::default_world();
        geometry(&mut world).transforms_json.pose = None;
        assert_eq!(world.finding("pose_opencv#projection").verdict, Verdict::NotRun);
    }

    #[test]
    fn motions_that_pictures_do_not_show_warn_and_fail_where_the_recipe_says_so() {
        let mut world = PlantedWorld::default_world();
        for pair in &mut geometry(&mut world).pairs {
            pair.rotation_deg = 0.6;
        }
        assert_eq!(world.finding("pose_opencv#relative-rotation").verdict, Verdict::Warn);
        world.limits.pose_opencv = Some(Limits { rotation_deg: Some(0.55), direction_deg: Some(0.9) });
        assert_eq!(world.finding("pose_opencv#relative-rotation").verdict, Verdict::Fail);
        assert_eq!(world.finding("pose_opencv#relative-direction").verdict, Verdict::Fail);
    }

    #[test]
    fn too_few_motions_say_nothing_of_pictures_and_all_of_projection() {
        let mut world = PlantedWorld::default_world();
        geometry(&mut world).pairs.truncate(2);
        assert_eq!(world.finding("pose_opencv#relative-rotation").verdict, Verdict::NotRun);
        assert_eq!(world.finding("pose_opencv#projection").verdict, Verdict::Pass);
    }
}
