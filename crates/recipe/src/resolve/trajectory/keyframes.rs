//! Hand-written key poses.

use super::PathContext;
use super::count::PoseSpread;
use super::novel::DEFAULT_FRAMES;
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::resolve::number::RealRange;
use crate::resolve::{Resolver, all};
use crate::schema;
use crate::text::TextSpan;
use glam::{DQuat, DVec3};
use gs2e_num::se3::{look_at, rotation_from_quaternion};
use gs2e_trajectory::keyframes::{CameraFacing, Keyframe, KeyframePath};

const POSES: &str =
    "write poses: [{ position: [0, 0, 0], rotation: [0, 0, 0, 1] }], or look_at and up in place of rotation";

impl Resolver<'_> {
    pub(super) fn keyframes(
        &self,
        raw: &schema::KeyframesSection,
        place: TextSpan,
        context: PathContext<'_>,
    ) -> Option<KeyframePath> {
        let poses = self.poses(&raw.poses, place);
        let schema::KeyframesSection { factor, frames, duration, literal, .. } = raw;
        let spread = PoseSpread { factor: Some(factor), frames, duration, literal: Some(literal) };
        let (count, literal) = self.spread(spread, DEFAULT_FRAMES, place, context);
        resolved!(KeyframePath {
            poses,
            count,
            curve: self.curve(&raw.curve),
            scale: self.scale(&raw.metric),
            literal,
        })
    }

    fn poses(
        &self,
        field: &Field<Vec<Field<schema::PoseSection>>>,
        within: TextSpan,
    ) -> Option<Vec<Keyframe>> {
        let (list, place) = self.required(field, "poses", within, POSES)?;
        if list.is_empty() {
            let problem = FieldProblem::of_field("is an empty list, wanted at least one");
            return self.refuse(problem.help(POSES).at(place));
        }
        all(list, |item| self.keyframe(item))
    }

    fn keyframe(&self, item: &Field<schema::PoseSection>) -> Option<Keyframe> {
        let (raw, place) = item.given()?;
        let position = self.required(&raw.position, "position", place, POSES);
        let position = position.and_then(|_| self.point(&raw.position)?);
        let facing = self.facing(raw, place, position);
        Some(Keyframe { position: position?, facing: facing? })
    }

    fn facing(
        &self,
        raw: &schema::PoseSection,
        place: TextSpan,
        position: Option<DVec3>,
    ) -> Option<CameraFacing> {
        let looks = !raw.look_at.is_absent() || !raw.up.is_absent();
        if looks && !raw.rotation.is_absent() {
            let problem = FieldProblem::of_field("has both a rotation and look_at or up");
            return self
                .refuse(problem.help("write only one: each defines where the camera looks").at(place));
        }
        if !looks {
            let (rotation, place) = self.required(&raw.rotation, "rotation", place, POSES)?;
            return self.rotation(rotation, place).map(CameraFacing::Rotation);
        }
        let help = "look_at is a point in the world, up is the direction of the image's top";
        for (field, name) in [(&raw.look_at, "look_at"), (&raw.up, "up")] {
            self.required(field, name, place, help);
        }
        let (target, up) = (self.point(&raw.look_at), self.direction(&raw.up));
        let (target, up) = (target??, up??);
        if position.is_some_and(|position| look_at(target - position, up).is_none()) {
            let problem = FieldProblem::of_field("looks along its own up direction, or at its own position");
            return self.refuse(problem.at(place));
        }
        Some(CameraFacing::Towards { target, up })
    }

    fn rotation(&self, raw: &[Field<f64>; 4], place: TextSpan) -> Option<DQuat> {
        // The range is wide, so that a vector that is no rotation gets the message about rotations.
        let rotation = DQuat::from_array(self.numbers(raw, RealRange::new(-1e6, 1e6))?);
        if let Err(error) = rotation_from_quaternion(rotation) {
            let problem = FieldProblem::of_field(format!("is invalid: {error}"));
            return self.refuse(problem.help("write qx, qy, qz, qw of length 1, camera to world").at(place));
        }
        Some(rotation)
    }
}
