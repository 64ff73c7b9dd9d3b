//! Resolution of the source of the Gaussians.

mod command;

use super::Resolver;
use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::{Reconstruct, Source, schema};
use crate::source::kind::Kind;

const GIVEN: &str = "write reconstruct: { given: { path: point_cloud.ply } }";
const TRAINED: &str = "or reconstruct: { command: { … } }, a program that trains it";

/// The parts of a recipe that decide whether it has Gaussians and which ones.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ground<'a> {
    /// The source of poses, if it is valid.
    pub source: Option<&'a Source>,
    /// The recipe's seed, if it is valid.
    pub seed: Option<u64>,
    /// True if anything is rendered.
    pub renders: bool,
}

impl Resolver<'_> {
    pub(super) fn reconstruct(
        &self,
        field: &Field<schema::Reconstruct>,
        Ground { source, seed, renders }: Ground<'_>,
    ) -> Option<Option<Reconstruct>> {
        match (field, source) {
            (Field::Bad, _) => None,
            // Paths need only poses.
            (Field::Absent, Some(_)) if !renders => Some(None),
            (Field::Absent, Some(Source::Captured(captured, _))) if captured.kind == Kind::Model => {
                Some(Some(Reconstruct::Newest(captured.path.clone())))
            }
            (Field::Absent, Some(Source::Captured(..))) => {
                let help = format!("{GIVEN}, the scene file that was trained on this source, {TRAINED}");
                self.refuse(Problem::missing_field("reconstruct").help(help).at(self.root))
            }
            (Field::Absent, Some(Source::None)) => {
                self.refuse(Problem::missing_field("reconstruct").help(GIVEN).at(self.root))
            }
            (Field::Absent, _) => Some(None),
            (Field::Given(_, place), Some(Source::Procedural(_))) => {
                let problem =
                    Problem::of_key("does not go with a procedural source, which brings its own Gaussians");
                self.refuse(problem.help("remove it, or name another source").at(*place))
            }
            (Field::Given(raw, place), source) => {
                let reconstruct = self.reconstruction(raw, seed)?;
                let without_photos = match source {
                    Some(Source::Captured(captured, _)) => captured.kind == Kind::Model,
                    Some(Source::None) => true,
                    Some(Source::Procedural(_)) | None => false,
                };
                if without_photos && matches!(reconstruct, Reconstruct::Command(_)) {
                    let problem = Problem::of_key("trains on photos, and this source has none");
                    return self.refuse(problem.help(GIVEN).at(*place));
                }
                Some(Some(reconstruct))
            }
        }
    }

    fn reconstruction(&self, raw: &schema::Reconstruct, seed: Option<u64>) -> Option<Reconstruct> {
        match raw {
            schema::Reconstruct::Given(field) => {
                let (given, place) = field.given()?;
                self.later(&given.undistorted, "this gs2e takes a given scene as it is");
                self.path(&given.path, place).map(Reconstruct::Given)
            }
            schema::Reconstruct::Command(field) => {
                let (raw, place) = field.given()?;
                self.command(raw, place, seed).map(|command| Reconstruct::Command(Box::new(command)))
            }
            schema::Reconstruct::Builtin(later) => {
                self.later(later, &format!("this gs2e takes a given scene file: {GIVEN}, {TRAINED}"));
                None
            }
        }
    }
}
