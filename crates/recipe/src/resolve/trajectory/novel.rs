//! Mini-trajectories: the trajectory from which their key poses are drawn, and the number of groups
//! and poses.

use super::count::PoseSpread;
use super::{List, PathContext};
use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::resolve::Resolver;
use crate::resolve::number::WholeRange;
use crate::text::TextSpan;
use crate::{TrajectoryRecipe, schema};
use gs2e_num::seed::{Seed, StreamPurpose};
use gs2e_trajectory::curve::CurveKind;
use gs2e_trajectory::novel::{GroupCurve, NovelGroup};
use gs2e_trajectory::path::CameraPath;
use gs2e_trajectory::travel::PoseCount;

/// Number of groups of a novel trajectory; each is a trajectory of its own.
const GROUPS: WholeRange = WholeRange::new(1, MAX_GROUPS);
const MAX_GROUPS: u64 = 1000;
const DEFAULT_GROUPS: u32 = 3;
/// Number of key poses of a group. A path has two ends, so at least two.
const KEYFRAMES: WholeRange = WholeRange::new(2, 1_000_000);
const DEFAULT_KEYFRAMES: u32 = 5;
/// Default number of poses of a group (the paper's F), and of other paths without a capture that
/// implies a number.
pub(super) const DEFAULT_FRAMES: PoseCount = PoseCount::Frames(150);

const BASES: &str = "key poses are drawn from a trajectory with refine, orbit or keyframes";

/// The groups of one novel trajectory.
#[derive(Debug, Clone)]
pub(super) struct NovelGroups {
    /// The trajectory from which key poses are drawn.
    pub(super) base: String,
    groups: u32,
    keyframes: u32,
    count: PoseCount,
    curve: GroupCurve,
    literal: bool,
}

impl NovelGroups {
    /// Returns the path of each group. All groups share the draws; the seeds derive from the
    /// written name.
    pub(super) fn drawn(&self, seed: u64, scene: &str, written: &str) -> impl Iterator<Item = NovelGroup> {
        // Two streams, so that another curve leaves the key poses as they are.
        let seed = |purpose| Seed::for_stream(seed, scene, written, purpose);
        let (keyframes_seed, curve_seed) = (seed(StreamPurpose::Keyframes), seed(StreamPurpose::Curve));
        let Self { groups, keyframes, count, curve, literal, .. } = *self;
        (0..groups).map(move |group| NovelGroup {
            group,
            groups,
            keyframes,
            count,
            curve,
            literal,
            keyframes_seed,
            curve_seed,
        })
    }
}

/// Name of a group.
pub(super) fn group_folder(written: &str, group: u32) -> String {
    format!("{written}-{group}")
}

/// Returns the folders of the trajectory with this name, as far as they are known while fields may
/// be faulty.
pub(super) fn group_folders(name: &str, raw: &schema::TrajectorySection) -> Vec<String> {
    let Some((novel, _)) = raw.novel.given() else { return vec![name.to_owned()] };
    let groups = novel.groups.given().map_or(u64::from(DEFAULT_GROUPS), |(groups, _)| *groups);
    // A number out of range must not make a list of that length.
    let groups = usize::try_from(groups.min(MAX_GROUPS)).expect("groups are few");
    (0..).take(groups).map(|group| group_folder(name, group)).collect()
}

impl Resolver<'_> {
    pub(super) fn novel(
        &self,
        raw: &schema::NovelSection,
        place: TextSpan,
        list: &List,
        context: PathContext<'_>,
    ) -> Option<NovelGroups> {
        let base = self.base(&raw.base, place, list);
        let schema::NovelSection { frames, duration, literal, .. } = raw;
        let spread = PoseSpread { factor: None, frames, duration, literal: Some(literal) };
        let (count, literal) = self.spread(spread, DEFAULT_FRAMES, place, context);
        resolved!(NovelGroups {
            base,
            groups: self.small(&raw.groups, DEFAULT_GROUPS, GROUPS),
            keyframes: self.small(&raw.keyframes, DEFAULT_KEYFRAMES, KEYFRAMES),
            count,
            curve: self.novel_curve(&raw.curve),
            literal,
        })
    }

    fn base(&self, field: &Field<String>, novel: TextSpan, list: &List) -> Option<String> {
        let raws = || list.iter().filter_map(|item| Some(item.given()?.0));
        let name = |raw: &schema::TrajectorySection| raw.name.given().map(|(name, _)| name.clone());
        let bases: Vec<String> = raws().filter(|raw| raw.novel.is_absent()).filter_map(name).collect();
        let Some((wanted, place)) = field.given() else {
            if field.is_absent() && bases.is_empty() {
                self.report(FieldProblem::of_key("has no trajectory to draw from").help(BASES).at(novel));
            }
            return bases.into_iter().next().filter(|_| field.is_absent());
        };
        if bases.contains(wanted) {
            return Some(wanted.clone());
        }
        if raws().filter_map(name).any(|name| name == *wanted) {
            let message = format!("is {}, which is novel itself", quote_text(wanted));
            return self.refuse(FieldProblem::of_field(message).help(BASES).at(place));
        }
        let known: Vec<&str> = bases.iter().map(String::as_str).collect();
        self.refuse(FieldProblem::unknown_name("base", wanted, &known).at(place))
    }

    fn novel_curve(&self, field: &Field<schema::NovelCurveSection>) -> Option<GroupCurve> {
        let fixed = match field {
            Field::Absent | Field::Given(schema::NovelCurveSection::Any, _) => return Some(GroupCurve::Any),
            Field::Bad => return None,
            Field::Given(schema::NovelCurveSection::Cubic, _) => CurveKind::Cubic,
            Field::Given(schema::NovelCurveSection::Cumulative, _) => CurveKind::Cumulative,
            Field::Given(schema::NovelCurveSection::SlerpLerp, _) => CurveKind::SlerpLerp,
            Field::Given(schema::NovelCurveSection::Bezier(raw), _) => self.bezier(raw)?,
        };
        Some(GroupCurve::Fixed(fixed))
    }

    /// Refuses more key poses than the base has poses, if the recipe alone determines that number.
    pub(super) fn refuse_few_poses(&self, list: &List, all: &[TrajectoryRecipe]) {
        for raw in list.iter().filter_map(|item| Some(item.given()?.0)) {
            let (Some((name, _)), Some(place)) = (raw.name.given(), raw.novel.place()) else { continue };
            let Some(first) = all.iter().find(|t| t.written == *name) else { continue };
            let base = all.iter().find(|t| Some(&t.name) == first.base.as_ref());
            let (CameraPath::Novel(novel), Some(PoseCount::Frames(poses))) =
                (&first.path, base.and_then(|base| group_count(&base.path)))
            else {
                continue;
            };
            let wanted = u64::from(novel.groups) * u64::from(novel.keyframes);
            if wanted > poses {
                let message = format!("draws {wanted} key poses, but its base has {poses} poses");
                let help = "it draws groups * keyframes poses, each at most once";
                self.report(FieldProblem::of_field(message).help(help).at(place));
            }
        }
    }
}

fn group_count(path: &CameraPath) -> Option<PoseCount> {
    match path {
        CameraPath::Refine(refine) => Some(refine.count),
        CameraPath::Orbit(orbit) => Some(orbit.count),
        CameraPath::Keyframes(keyframes) => Some(keyframes.count),
        CameraPath::Novel(_) => None,
    }
}
