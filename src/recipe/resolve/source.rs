//! Where poses and Gaussians come from.

use super::Resolver;
use super::number::{Range, Whole};
use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::text::Place;
use crate::recipe::{Reconstruct, Source, schema};
use crate::scene::procedural::StillLife;
use std::path::PathBuf;

const SOURCES: &str = "this gs2e reads the sources procedural, colmap and nerfstudio";
const RECONSTRUCTIONS: &str =
    "this gs2e takes a given scene file: reconstruct: { given: { path: point_cloud.ply } }";

impl Resolver<'_> {
    pub(super) fn source(&self, field: &Field<schema::Source>) -> Option<Source> {
        let help = "source: { procedural: { kind: still-life } }, or colmap or nerfstudio with a path";
        let (source, place) = self.required(field, "source", self.root, help)?;
        match source {
            schema::Source::Procedural(raw) => self.still_life(raw).map(Source::Procedural),
            schema::Source::Colmap(raw) => self.folder(raw, place).map(Source::Colmap),
            schema::Source::Nerfstudio(raw) => self.folder(raw, place).map(Source::Nerfstudio),
            schema::Source::Mvimgnet(later) | schema::Source::Dl3dv(later) | schema::Source::Model(later) => {
                self.later(later, SOURCES);
                None
            }
        }
    }

    fn still_life(&self, raw: &schema::Procedural) -> Option<StillLife> {
        let StillLife { gaussians, views, arc, seed } = StillLife::default();
        let kind = self.or(&raw.kind, schema::Kind::StillLife);
        let gaussians = self.whole(&raw.gaussians, gaussians.into(), Whole::new(100, 10_000_000));
        let views = self.whole(&raw.views, views.into(), Whole::new(2, 10_000));
        let arc = self.real(&raw.arc, arc, Range::above(0.0, 360.0));
        let seed = self.or(&raw.seed, seed);
        let schema::Kind::StillLife = kind?;
        let small = |n: u64| u32::try_from(n).expect("within its range");
        Some(StillLife { gaussians: small(gaussians?), views: small(views?), arc: arc?, seed: seed? })
    }

    fn folder(&self, raw: &schema::Folder, within: Place) -> Option<PathBuf> {
        self.later(&raw.views, "this gs2e uses every view of the source");
        for later in [&raw.upstream_id, &raw.upstream_url, &raw.accessed, &raw.terms_accepted] {
            self.later(later, "this gs2e records no upstream");
        }
        self.path(&raw.path, within)
    }

    pub(super) fn reconstruct(
        &self,
        field: &Field<schema::Reconstruct>,
        source: Option<&Source>,
    ) -> Option<Option<Reconstruct>> {
        match (field, source) {
            (Field::Bad, _) => None,
            (Field::Absent, Some(Source::Colmap(_) | Source::Nerfstudio(_))) => {
                let problem = Problem::new("missing field \"reconstruct\"").help(
                    "reconstruct: { given: { path: point_cloud.ply } } names the scene file that was trained on this source",
                );
                self.refuse(problem.at(self.root))
            }
            (Field::Absent, _) => Some(None),
            (Field::Given(_, place), Some(Source::Procedural(_))) => {
                let problem =
                    Problem::of_key("is not for a procedural source, which brings its own Gaussians");
                self.refuse(problem.help("remove it, or name another source").at(*place))
            }
            (Field::Given(raw, place), _) => self.reconstruction(raw, *place).map(Some),
        }
    }

    fn reconstruction(&self, raw: &schema::Reconstruct, place: Place) -> Option<Reconstruct> {
        match raw {
            schema::Reconstruct::Given(given) => {
                self.later(&given.undistorted, "this gs2e takes a given scene as it is");
                self.path(&given.path, place).map(Reconstruct::Given)
            }
            schema::Reconstruct::Builtin(later) | schema::Reconstruct::Command(later) => {
                self.later(later, RECONSTRUCTIONS);
                None
            }
        }
    }
}
