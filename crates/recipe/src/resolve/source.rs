//! Resolution of the source of poses and Gaussians.

use super::Resolver;
use super::number::{RealRange, WholeRange};
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

/// Maximum number of views that a recipe may ask for.
const MAX_VIEWS: u32 = 1_000_000;

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
        let StillLife { gaussians, views, arc, seed, .. } = StillLife::default();
        let kind = self.or(&raw.kind, schema::KindKey::StillLife);
        let gaussians = self.small(&raw.gaussians, gaussians, WholeRange::new(100, 10_000_000));
        let views = self.small(&raw.views, views, WholeRange::new(2, 10_000));
        let arc = self.real(&raw.arc, arc, RealRange::above(0.0, 360.0));
        let seed = self.or(&raw.seed, seed);
        let fountain = self.fountain(&raw.fountain);
        let schema::KindKey::StillLife = kind?;
        Some(StillLife { gaussians: gaussians?, views: views?, arc: arc?, seed: seed?, fountain: fountain? })
    }

    fn fountain(&self, field: &Field<schema::FountainSection>) -> Option<Option<Fountain>> {
        let Some((raw, _)) = field.given() else { return field.is_absent().then_some(None) };
        let drops = self.small(&raw.drops, Fountain::default().drops, WholeRange::new(1, 1_000_000));
        let absent = schema::TimeSection::default();
        let time = self.section(&raw.time, &absent)?;
        if let Some(place) = time.rate.place() {
            let problem =
                FieldProblem::of_field("is the rate of a sequence of files, which a fountain does not have");
            return self.refuse(problem.help("write duration: 2, in seconds").at(place));
        }
        let time = self.scene_time(time);
        Some(Some(Fountain { drops: drops?, time: time? }))
    }

    fn captured(
        &self,
        kind: CaptureKind,
        raw: &schema::FolderSection,
        place: TextSpan,
    ) -> Option<SceneSource> {
        let path = self.path(&raw.path, place);
        let views = match &raw.views {
            Field::Absent => Some(None),
            given => self.small(given, 1, WholeRange::new(1, u64::from(MAX_VIEWS))).map(Some),
        };
        let (exclude, poses) = (self.exclude(kind, raw), self.pose_file(kind, raw));
        let (id, url) = (self.said(&raw.upstream_id), self.formed(&raw.upstream_url, forms::URL));
        let accessed = self.formed(&raw.accessed, forms::DAY);
        let accepted = raw.terms_accepted.given().map(|(accepted, _)| *accepted);
        let terms_accepted = (accepted.is_some() || raw.terms_accepted.is_absent()).then_some(accepted);
        let selection = ViewSelection { views: views?, exclude: exclude?, poses: poses? };
        let captured = DiskCapture { kind, path: path?, selection, solving: None };
        // Statements of the recipe win over values that the folders reveal.
        let known = UpstreamOrigin::from_capture(&captured);
        let upstream = UpstreamOrigin {
            id: id?.or(known.id),
            url: url?.or(known.url),
            accessed: accessed?,
            terms_accepted: terms_accepted?,
        };
        Some(SceneSource::Captured(captured, upstream))
    }

    /// Resolves the search for poses.
    fn solving(&self, kind: CaptureKind, raw: &schema::UnposedSection) -> Option<PoseSolving> {
        let of_frames = [raw.every.place(), raw.sharpness.place()].into_iter().flatten().next();
        if let Some(place) = of_frames.filter(|_| !kind.is_video()) {
            let problem = FieldProblem::of_key("applies only to a video, which has frames");
            return self.refuse(problem.help("remove it").at(place));
        }
        let plain = PoseSolving::default();
        let vocabulary = match &raw.vocabulary {
            Field::Absent => Some(None),
            given => self.path(given, self.root).map(Some),
        };
        let pairs = match &raw.pairs {
            Field::Absent => Some(None),
            given => given.given().map(|(pairs, _)| Some(*pairs)),
        };
        let lens = self.or(&raw.lens, plain.lens);
        let features = self.small(&raw.features, plain.features, WholeRange::new(256, 65_536));
        let registered = self.real(&raw.registered, plain.registered, RealRange::new(0.0, 1.0));
        let frames = FramePicking::default();
        let every = self.small(&raw.every, frames.every, WholeRange::new(1, 1_000_000));
        let sharpness = self.real(&raw.sharpness, frames.sharpness, RealRange::new(0.0, 1.0));
        let frames = FramePicking { every: every?, sharpness: sharpness? };
        Some(PoseSolving {
            lens: lens?,
            features: features?,
            pairs: pairs?,
            vocabulary: vocabulary?,
            registered: registered?,
            frames: kind.is_video().then_some(frames),
        })
    }

    /// Resolves the patterns of excluded names. By default, the known leftover files of the dataset
    /// are excluded.
    fn exclude(&self, kind: CaptureKind, raw: &schema::FolderSection) -> Option<Vec<String>> {
        let list = match &raw.exclude {
            Field::Absent => return Some(kind.leftovers()),
            Field::Bad => return None,
            Field::Given(list, _) => list,
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
        let patterns: Vec<Option<String>> = list.iter().map(pattern).collect();
        patterns.into_iter().collect()
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

    /// Returns an optional text that is not blank.
    fn said(&self, field: &Field<String>) -> Option<Option<String>> {
        match field {
            Field::Absent => Some(None),
            Field::Bad => None,
            Field::Given(text, place) => self.filled(text, *place).map(Some),
        }
    }

    /// Resolves a path relative to the folder of the file that contains it.
    pub(super) fn path(&self, field: &Field<String>, within: TextSpan) -> Option<PathBuf> {
        let (text, place) =
            self.required(field, "path", within, "a path is relative to the recipe's folder")?;
        Some(self.folders[place.file as usize].join(self.filled(text, place)?))
    }
}
