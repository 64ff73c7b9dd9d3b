//! Where poses and Gaussians come from.

use super::Resolver;
use super::number::{Range, Whole};
use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::text::Place;
use crate::recipe::{Reconstruct, Source, schema};
use crate::scene::procedural::StillLife;
use std::path::PathBuf;

const SOURCES: &str = "this gs2e reads the sources procedural, colmap, nerfstudio, model and none";
const GIVEN: &str = "write reconstruct: { given: { path: point_cloud.ply } }";

impl Resolver<'_> {
    pub(super) fn source(&self, field: &Field<schema::Source>) -> Option<Source> {
        let help = "write source: { procedural: { kind: still-life } }, or colmap, nerfstudio or model with a path, or none";
        let (source, _) = self.required(field, "source", self.root, help)?;
        match source {
            schema::Source::Procedural(raw) => self.still_life(raw).map(Source::Procedural),
            schema::Source::Colmap(raw) => self.folder(raw).map(Source::Colmap),
            schema::Source::Nerfstudio(raw) => self.folder(raw).map(Source::Nerfstudio),
            schema::Source::None => Some(Source::None),
            schema::Source::Model(raw) => self.folder(raw).map(Source::Model),
            schema::Source::Mvimgnet(later) | schema::Source::Dl3dv(later) => {
                self.later(later, SOURCES);
                None
            }
        }
    }

    fn still_life(&self, field: &Field<schema::Procedural>) -> Option<StillLife> {
        let (raw, _) = field.given()?;
        let StillLife { gaussians, views, arc, seed } = StillLife::default();
        let kind = self.or(&raw.kind, schema::Kind::StillLife);
        let gaussians = self.small(&raw.gaussians, gaussians, Whole::new(100, 10_000_000));
        let views = self.small(&raw.views, views, Whole::new(2, 10_000));
        let arc = self.real(&raw.arc, arc, Range::above(0.0, 360.0));
        let seed = self.or(&raw.seed, seed);
        let schema::Kind::StillLife = kind?;
        Some(StillLife { gaussians: gaussians?, views: views?, arc: arc?, seed: seed? })
    }

    fn folder(&self, field: &Field<schema::Folder>) -> Option<PathBuf> {
        let (raw, place) = field.given()?;
        self.later(&raw.views, "this gs2e uses every view of the source");
        for later in [&raw.upstream_id, &raw.upstream_url, &raw.accessed, &raw.terms_accepted] {
            self.later(later, "this gs2e records no upstream");
        }
        self.path(&raw.path, place)
    }

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

    /// A path, relative to the folder of the file that names it.
    fn path(&self, field: &Field<String>, within: Place) -> Option<PathBuf> {
        let (text, place) =
            self.required(field, "path", within, "a path is relative to the recipe's folder")?;
        Some(self.folders[place.file as usize].join(self.filled(text, place)?))
    }
}
