//! Resolution of the source of the Gaussians.

mod command;

use super::Resolver;
use super::number::{RealRange, WholeRange};
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::{ReconstructMethod, SceneSource, schema};
use gs2e_scene::dynamic::{SceneSpan, SceneTime};
use gs2e_train::{TrainingGoal, TrainingSettings};

/// Speeds and lengths of time, in their units.
const POSITIVE: RealRange = RealRange::above(0.0, 1e6);

const GIVEN: &str = "write reconstruct: { given: { path: point_cloud.ply } }";
const TRAINED: &str =
    "or have it trained: reconstruct: { builtin: {} }, or with a program, reconstruct: { command: { … } }";
const BUILTIN: &str =
    "write reconstruct: { builtin: {} }, or name a program: reconstruct: { command: { … } }";

/// The parts of a recipe that decide whether it has Gaussians and which ones.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReconstructContext<'a> {
    /// The source of poses, if it is valid.
    pub source: Option<&'a SceneSource>,
    /// The recipe's seed, if it is valid.
    pub seed: Option<u64>,
    /// True if anything is rendered.
    pub renders: bool,
}

impl Resolver<'_> {
    pub(super) fn reconstruct(
        &self,
        field: &Field<schema::ReconstructSection>,
        ReconstructContext { source, seed, renders }: ReconstructContext<'_>,
    ) -> Option<Option<ReconstructMethod>> {
        match (field, source) {
            (Field::Bad, _) => None,
            // Without a rendering, only poses are needed.
            (Field::Absent, Some(_)) if !renders => Some(None),
            (Field::Absent, Some(SceneSource::Captured(captured, _))) if captured.kind.has_gaussians() => {
                Some(Some(ReconstructMethod::Newest(captured.path.clone())))
            }
            (Field::Absent, Some(source)) if source.runs_programs() => {
                self.refuse(FieldProblem::missing_field("reconstruct").help(BUILTIN).at(self.root))
            }
            (Field::Absent, Some(SceneSource::Captured(..))) => {
                let help = format!("{GIVEN}, the scene file that was trained on this source, {TRAINED}");
                self.refuse(FieldProblem::missing_field("reconstruct").help(help).at(self.root))
            }
            (Field::Absent, Some(SceneSource::None)) => {
                self.refuse(FieldProblem::missing_field("reconstruct").help(GIVEN).at(self.root))
            }
            // A procedural source brings its own Gaussians, and a faulty source was reported.
            (Field::Absent, _) => Some(None),
            (Field::Given(_, place), Some(SceneSource::Procedural(_))) => {
                let problem = FieldProblem::of_key(
                    "cannot be combined with a procedural source, which has its own Gaussians",
                );
                self.refuse(problem.help("remove it, or name another source").at(*place))
            }
            (Field::Given(raw, place), source) => {
                let reconstruct = self.reconstruction(raw, seed)?;
                let without_photos = match source {
                    Some(SceneSource::Captured(captured, _)) => captured.kind.has_gaussians(),
                    Some(SceneSource::None) => true,
                    Some(SceneSource::Procedural(_)) | None => false,
                };
                let is_trained =
                    matches!(reconstruct, ReconstructMethod::Command(_) | ReconstructMethod::Builtin(_));
                if without_photos && is_trained {
                    let problem = FieldProblem::of_key("trains on photos, and this source has none");
                    return self.refuse(problem.help(GIVEN).at(*place));
                }
                if !is_trained && source.is_some_and(SceneSource::runs_programs) {
                    let problem = FieldProblem::of_key(
                        "names a scene in a world of its own: the poses of this source are found in another one",
                    );
                    return self.refuse(problem.help(BUILTIN).at(*place));
                }
                Some(Some(reconstruct))
            }
        }
    }

    /// The time of a scene that changes by itself.
    pub(super) fn scene_time(&self, raw: &schema::TimeSection) -> Option<SceneTime> {
        let start = self.real(&raw.start, 0.0, RealRange::new(0.0, 1e6));
        let speed = self.real(&raw.speed, 1.0, POSITIVE);
        if let (Some(_), Some(place)) = (raw.rate.place(), raw.duration.place()) {
            let problem = FieldProblem::of_key("and rate exclude each other");
            let help = "keep `rate` for a sequence of files, or `duration` for a file with tracks";
            return self.refuse(problem.help(help).at(place));
        }
        let span = if raw.rate.is_absent() {
            self.real(&raw.duration, 1.0, POSITIVE).map(SceneSpan::Duration)
        } else {
            self.real(&raw.rate, 1.0, POSITIVE).map(SceneSpan::Rate)
        };
        resolved!(SceneTime { start, speed, span })
    }

    /// The settings of a training, with the rendering left at its default: the recipe's is filled in
    /// when the step is wired.
    fn builtin(&self, raw: &schema::BuiltinSection, seed: Option<u64>) -> Option<TrainingSettings> {
        let plain = TrainingSettings::default();
        resolved!(TrainingSettings {
            gaussians: self.small(&raw.gaussians, plain.gaussians, WholeRange::new(1, 1 << 24)),
            iterations: self.small(&raw.iterations, plain.iterations, WholeRange::new(1, 1_000_000)),
            resolution: self.small(&raw.resolution, plain.resolution, WholeRange::new(16, 16_384)),
            seed: raw.seed.or(seed.unwrap_or_default()),
            hold_out: self.small(&raw.hold_out, plain.hold_out, WholeRange::new(0, 1_000_000)),
            until: self.until(&raw.until),
            ..plain
        })
    }

    fn until(&self, field: &Field<schema::UntilSection>) -> Option<TrainingGoal> {
        let raw = field.or_default()?;
        resolved!(TrainingGoal {
            psnr: raw.psnr.optional(|psnr| self.real(psnr, 0.0, RealRange::above(0.0, 100.0))),
            minutes: raw.minutes.optional(|minutes| self.real(minutes, 0.0, POSITIVE)),
        })
    }

    fn reconstruction(
        &self,
        raw: &schema::ReconstructSection,
        seed: Option<u64>,
    ) -> Option<ReconstructMethod> {
        match raw {
            schema::ReconstructSection::Given(field) => {
                let (given, place) = field.given()?;
                self.later(&given.undistorted, "this gs2e uses a given scene unchanged");
                let path = self.path(&given.path, place);
                match &given.time {
                    Field::Absent => path.map(ReconstructMethod::Given),
                    Field::Bad => None,
                    Field::Given(time, _) => {
                        let time = self.scene_time(time);
                        Some(ReconstructMethod::Changing(path?, time?))
                    }
                }
            }
            schema::ReconstructSection::Command(field) => {
                let (raw, place) = field.given()?;
                self.command(raw, place, seed).map(|command| ReconstructMethod::Command(Box::new(command)))
            }
            schema::ReconstructSection::Builtin(field) => {
                self.builtin(&field.or_default()?, seed).map(ReconstructMethod::Builtin)
            }
        }
    }
}
