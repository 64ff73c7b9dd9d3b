//! Trajectories: a name, a path, and a speed.

mod count;
mod keyframes;
mod novel;
mod orbit;
mod refine;
mod speed;
mod vector;

use super::{Resolver, all};
use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::text::TextSpan;
use crate::{SceneSource, TrajectoryRecipe, names, schema};
use gs2e_num::units::Hertz;
use gs2e_trajectory::novel::NovelGroup;
use gs2e_trajectory::path::CameraPath;
use gs2e_trajectory::sample::SummationRule;
use std::collections::BTreeSet;

pub(crate) use speed::{CONSTANT_SPEED, PAPERS_SPEED};
pub(super) use vector::Triple;

const PATHS: &str = "refine, novel, orbit and keyframes";

/// The other parts of the recipe that trajectories depend on, as far as they are valid.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrajectoryContext<'a> {
    pub(super) scene: Option<&'a str>,
    pub(super) seed: Option<u64>,
    pub(super) source: Option<&'a SceneSource>,
    pub(super) rate: Option<Hertz>,
    pub(super) law: Option<SummationRule>,
    /// True if the recipe names the Gaussians.
    pub(super) has_scene: bool,
}

/// The context of a path.
#[derive(Debug, Clone, Copy)]
struct PathContext<'a> {
    setting: TrajectoryContext<'a>,
    /// True if the speed is a flow, which determines the number of poses itself.
    flows: bool,
}

impl TrajectoryContext<'_> {
    fn has_views(&self) -> bool {
        self.source.is_none_or(SceneSource::has_views)
    }
}

/// The list as written.
type List = [Field<schema::TrajectorySection>];

impl Resolver<'_> {
    pub(super) fn trajectories(
        &self,
        field: &Field<Vec<Field<schema::TrajectorySection>>>,
        setting: TrajectoryContext<'_>,
    ) -> Option<Vec<TrajectoryRecipe>> {
        let help = "write trajectories: [{ name: base, refine: {} }]";
        let (list, place) = self.required(field, "trajectories", self.root, help)?;
        if list.is_empty() {
            return self.refuse(
                FieldProblem::of_field("is an empty list, wanted at least one").help(help).at(place),
            );
        }
        self.refuse_repeated_names(list);
        let all = all::<_, _, Vec<_>>(list, |item| self.trajectory(item, list, setting))?.concat();
        // Last, because it needs the number of poses of every base.
        self.refuse_few_poses(list, &all);
        Some(all)
    }

    /// Reports repeated names. Names that differ only in case are one folder on some systems.
    fn refuse_repeated_names(&self, list: &List) {
        // Written names are compared with each other, and folders of groups with all folders.
        let (mut written, mut folders) = (BTreeSet::new(), BTreeSet::new());
        for raw in list.iter().filter_map(|item| Some(item.given()?.0)) {
            let Some((name, place)) = raw.name.given() else { continue };
            let own = novel::group_folders(name, raw);
            let repeated = own.iter().find(|folder| folders.contains(&folder.to_lowercase()));
            let message = if written.contains(&name.to_lowercase()) {
                Some(format!("is {}, the name of an earlier trajectory", quote_text(name)))
            } else {
                repeated.map(|folder| clash_message(name, folder))
            };
            let help = "names are folders, and some systems ignore case in them";
            message.into_iter().for_each(|m| self.report(FieldProblem::of_field(m).help(help).at(place)));
            written.insert(name.to_lowercase());
            folders.extend(own.iter().map(|folder| folder.to_lowercase()));
        }
    }

    /// Resolves a trajectory, or all groups of a novel trajectory.
    fn trajectory(
        &self,
        item: &Field<schema::TrajectorySection>,
        list: &List,
        setting: TrajectoryContext<'_>,
    ) -> Option<Vec<TrajectoryRecipe>> {
        let (raw, place) = item.given()?;
        let name = self.required(&raw.name, "name", place, "write name: base, its folder in the release");
        let name = name.and_then(|(name, at)| {
            self.named(name, at, names::check_trajectory(name), names::TRAJECTORY_HELP)
        });
        // Every part is resolved before a fault returns, so that all faults are reported.
        let speed = self.speed(&raw.speed, raw.refine.is_absent(), setting.law);
        let flows = matches!(raw.speed.given(), Some((schema::SpeedSection::Flow(_), _)));
        let context = PathContext { setting, flows };
        if self.several_paths(raw, place) {
            return None;
        }
        if let Field::Given(novel, at) = &raw.novel {
            let groups = self.novel(novel, *at, list, context)?;
            let (written, speed, place) = (name?, speed?, raw.name.place()?);
            let group = |path: NovelGroup| {
                let name = novel::group_folder(&written, path.group);
                let name =
                    self.named(&name, place, names::check_trajectory(&name), names::TRAJECTORY_HELP)?;
                let base = Some(groups.base.clone());
                let whole = TrajectoryRecipe::new(written.clone(), CameraPath::Novel(path), speed.clone());
                Some(TrajectoryRecipe { name, base, ..whole })
            };
            return groups.drawn(setting.seed?, setting.scene?, &written).map(group).collect();
        }
        let path = self.path_of(raw, place, context);
        Some(vec![TrajectoryRecipe::new(name?, path?, speed?)])
    }

    /// Returns true, after reporting it, if there is more than one path.
    fn several_paths(&self, raw: &schema::TrajectorySection, place: TextSpan) -> bool {
        let absent =
            [raw.refine.is_absent(), raw.novel.is_absent(), raw.orbit.is_absent(), raw.keyframes.is_absent()];
        let several = absent.iter().filter(|absent| !**absent).count() > 1;
        if several {
            let help = "a trajectory has one path; write another trajectory for another path";
            let message = format!("has more than one of {PATHS}");
            self.report(FieldProblem::of_field(message).help(help).at(place));
        }
        several
    }

    /// Resolves a path that is a trajectory by itself.
    fn path_of(
        &self,
        raw: &schema::TrajectorySection,
        within: TextSpan,
        context: PathContext<'_>,
    ) -> Option<CameraPath> {
        match (&raw.orbit, &raw.keyframes) {
            (Field::Given(raw, place), _) => self.orbit(raw, *place, context).map(CameraPath::Orbit),
            (_, Field::Given(raw, place)) => self.keyframes(raw, *place, context).map(CameraPath::Keyframes),
            // A faulty `novel` was reported, and must not become the default path.
            (Field::Absent, Field::Absent) if !raw.novel.is_absent() => None,
            (Field::Absent, Field::Absent) => {
                self.refine(&raw.refine, within, context).map(CameraPath::Refine)
            }
            _ => None,
        }
    }
}

/// Message for a folder that an earlier trajectory already has.
fn clash_message(name: &str, folder: &str) -> String {
    if name == folder {
        format!("is {}, the name of a group of an earlier trajectory", quote_text(name))
    } else {
        format!(
            "is {}, and its group {} has the name of an earlier trajectory",
            quote_text(name),
            quote_text(folder)
        )
    }
}
