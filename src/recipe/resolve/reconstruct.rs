//! Where the Gaussians come from.

use super::Resolver;
use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::{Reconstruct, Source, schema};

const GIVEN: &str = "write reconstruct: { given: { path: point_cloud.ply } }";

impl Resolver<'_> {
    pub(super) fn reconstruct(
        &self,
        field: &Field<schema::Reconstruct>,
        source: Option<&Source>,
    ) -> Option<Option<Reconstruct>> {
        match (field, source) {
            (Field::Bad, _) => None,
            (Field::Absent, Some(Source::Colmap(_) | Source::Nerfstudio(_))) => {
                let help = format!("{GIVEN}, the scene file that was trained on this source");
                self.refuse(Problem::missing("reconstruct").help(help).at(self.root))
            }
            (Field::Absent, Some(Source::None)) => {
                self.refuse(Problem::missing("reconstruct").help(GIVEN).at(self.root))
            }
            (Field::Absent, Some(Source::Model(path))) => Some(Some(Reconstruct::Newest(path.clone()))),
            (Field::Absent, _) => Some(None),
            (Field::Given(_, place), Some(Source::Procedural(_))) => {
                let problem =
                    Problem::of_key("does not go with a procedural source, which brings its own Gaussians");
                self.refuse(problem.help("remove it, or name another source").at(*place))
            }
            (Field::Given(raw, _), _) => self.reconstruction(raw).map(Some),
        }
    }

    fn reconstruction(&self, raw: &schema::Reconstruct) -> Option<Reconstruct> {
        match raw {
            schema::Reconstruct::Given(field) => {
                let (given, place) = field.given()?;
                self.later(&given.undistorted, "this gs2e takes a given scene as it is");
                self.path(&given.path, place).map(Reconstruct::Given)
            }
            schema::Reconstruct::Builtin(later) | schema::Reconstruct::Command(later) => {
                self.later(later, &format!("this gs2e takes a given scene file: {GIVEN}"));
                None
            }
        }
    }
}
