//! Where poses and Gaussians come from.

use super::Resolver;
use super::number::{Range, Whole};
use crate::recipe::field::Field;
use crate::recipe::text::Place;
use crate::recipe::{Source, schema};
use crate::scene::procedural::StillLife;
use std::path::PathBuf;

const SOURCES: &str = "this gs2e reads the sources procedural, colmap, nerfstudio, model and none";

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

    /// A path, relative to the folder of the file that names it.
    pub(super) fn path(&self, field: &Field<String>, within: Place) -> Option<PathBuf> {
        let (text, place) =
            self.required(field, "path", within, "a path is relative to the recipe's folder")?;
        Some(self.folders[place.file as usize].join(self.filled(text, place)?))
    }
}
