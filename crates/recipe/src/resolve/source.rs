//! Resolution of the source of poses and Gaussians.

use super::number::{RealRange, WholeRange};
use super::{Resolver, all};
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::schema::CaptureSection;
use crate::text::TextSpan;
use crate::{SceneSource, UpstreamOrigin, forms, schema};
use gs2e_demo::{Fountain, StillLife};
use gs2e_source as source;
use gs2e_source::kind::CaptureKind;
use gs2e_source::solving::{FramePicking, PoseSolving};
use gs2e_source::{DiskCapture, PoseFile, ViewSelection};
use std::path::PathBuf;

/// Numbers of views that a recipe may ask for.
const VIEWS: WholeRange = WholeRange::new(1, 1_000_000);

impl Resolver<'_> {
    pub(super) fn source(&self, field: &Field<schema::SourceSection>) -> Option<SceneSource> {
        let help = "write source: { procedural: { kind: still-life } }, or photos, video, colmap, nerfstudio, model, \
                    mvimgnet or dl3dv with a path, or none";
        let (source, _) = self.required(field, "source", self.root, help)?;
        match (source, source.capture()) {
            (_, Some((kind, CaptureSection::Posed(raw)))) => {
                let (raw, place) = raw.given()?;
                self.captured(kind, raw, place)
            }
            (_, Some((kind, CaptureSection::Unposed(raw)))) => {
                let (raw, place) = raw.given()?;
                let (solving, captured) =
                    (self.solving(kind, raw), self.captured(kind, &raw.folder(), place));
                let SceneSource::Captured(captured, upstream) = captured? else { return None };
                Some(SceneSource::Captured(DiskCapture { solving: Some(solving?), ..captured }, upstream))
            }
            (schema::SourceSection::Procedural(raw), _) => self.still_life(raw).map(SceneSource::Procedural),
            _ => Some(SceneSource::None),
        }
    }

    fn still_life(&self, field: &Field<schema::ProceduralSection>) -> Option<StillLife> {
        let (raw, _) = field.given()?;
        let plain = StillLife::default();
        let still_life = resolved!(StillLife {
            gaussians: self.small(&raw.gaussians, plain.gaussians, WholeRange::new(100, 10_000_000)),
            views: self.small(&raw.views, plain.views, WholeRange::new(2, 10_000)),
            arc: self.real(&raw.arc, plain.arc, RealRange::above(0.0, 360.0)),
            seed: raw.seed.or(plain.seed),
            fountain: raw.fountain.optional(|fountain| self.fountain(fountain)),
        });
        let schema::KindKey::StillLife = raw.kind.or(schema::KindKey::StillLife)?;
        still_life
    }

    fn fountain(&self, field: &Field<schema::FountainSection>) -> Option<Fountain> {
        let (raw, _) = field.given()?;
        let drops = self.small(&raw.drops, Fountain::default().drops, WholeRange::new(1, 1_000_000));
        let time = raw.time.or_default()?;
        if let Some(place) = time.rate.place() {
            let problem =
                FieldProblem::of_field("is the rate of a sequence of files, which a fountain does not have");
            return self.refuse(problem.help("write duration: 2, in seconds").at(place));
        }
        resolved!(Fountain { drops, time: self.scene_time(&time) })
    }

    fn captured(
        &self,
        kind: CaptureKind,
        raw: &schema::FolderSection,
        place: TextSpan,
    ) -> Option<SceneSource> {
        let path = self.path(&raw.path, place);
        let selection = resolved!(ViewSelection {
            views: raw.views.optional(|views| self.small(views, 1, VIEWS)),
            exclude: self.exclude(kind, raw),
            poses: self.pose_file(kind, raw),
        });
        let stated = resolved!(UpstreamOrigin {
            id: self.said(&raw.upstream_id),
            url: self.formed(&raw.upstream_url, forms::URL),
            accessed: self.formed(&raw.accessed, forms::DAY),
            terms_accepted: raw.terms_accepted.optional(|accepted| Some(*accepted.given()?.0)),
        });
        let captured = DiskCapture { kind, path: path?, selection: selection?, solving: None };
        // Statements of the recipe win over values that the folders reveal.
        let (known, stated) = (UpstreamOrigin::from_capture(&captured), stated?);
        let upstream = UpstreamOrigin { id: stated.id.or(known.id), url: stated.url.or(known.url), ..stated };
        Some(SceneSource::Captured(captured, upstream))
    }

    /// Resolves the search for poses.
    fn solving(&self, kind: CaptureKind, raw: &schema::UnposedSection) -> Option<PoseSolving> {
        let of_frames = [raw.every.place(), raw.sharpness.place()].into_iter().flatten().next();
        if let Some(place) = of_frames.filter(|_| !kind.is_video()) {
            let problem = FieldProblem::of_key("applies only to a video, which has frames");
            return self.refuse(problem.help("remove it").at(place));
        }
        let (plain, picking) = (PoseSolving::default(), FramePicking::default());
        let frames = resolved!(FramePicking {
            every: self.small(&raw.every, picking.every, WholeRange::new(1, 1_000_000)),
            sharpness: self.real(&raw.sharpness, picking.sharpness, RealRange::new(0.0, 1.0)),
        });
        resolved!(PoseSolving {
            lens: raw.lens.or(plain.lens),
            features: self.small(&raw.features, plain.features, WholeRange::new(256, 65_536)),
            pairs: raw.pairs.optional(|pairs| Some(*pairs.given()?.0)),
            vocabulary: raw.vocabulary.optional(|vocabulary| self.path(vocabulary, self.root)),
            registered: self.real(&raw.registered, plain.registered, RealRange::new(0.0, 1.0)),
            frames: frames.map(|frames| kind.is_video().then_some(frames)),
        })
    }

    /// Resolves the patterns of excluded names. By default, the known leftover files of the dataset
    /// are excluded.
    fn exclude(&self, kind: CaptureKind, raw: &schema::FolderSection) -> Option<Vec<String>> {
        let Some((list, _)) = raw.exclude.given() else {
            return raw.exclude.is_absent().then(|| kind.leftovers());
        };
        let pattern = |item: &Field<String>| {
            let (text, place) = item.given()?;
            match source::check_pattern(text) {
                Ok(()) => self.filled(text, place),
                Err(because) => {
                    self.refuse(FieldProblem::of_field(format!("is not a pattern: {because}")).at(place))
                }
            }
        };
        all(list, pattern)
    }

    fn pose_file(&self, kind: CaptureKind, raw: &schema::FolderSection) -> Option<Option<PoseFile>> {
        match &raw.poses {
            Field::Absent => Some(None),
            Field::Bad => None,
            Field::Given(poses, _) if kind.dataset().is_some_and(|dataset| dataset.has_two_poses) => {
                Some(Some(*poses))
            }
            Field::Given(_, place) => {
                let problem = FieldProblem::of_key(
                    "applies only to the source dl3dv, which may have two sets of poses",
                );
                self.refuse(problem.help("remove it: this source has one").at(*place))
            }
        }
    }

    /// Resolves a path relative to the folder of the file that contains it.
    pub(super) fn path(&self, field: &Field<String>, within: TextSpan) -> Option<PathBuf> {
        let (text, place) =
            self.required(field, "path", within, "a path is relative to the recipe's folder")?;
        Some(self.folders[place.file as usize].join(self.filled(text, place)?))
    }
}
