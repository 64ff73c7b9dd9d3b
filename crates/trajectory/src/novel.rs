//! The paper's 3.5.2: mini-trajectories between key poses drawn from a dense one.
//!
//! One draw without replacement serves all groups, which take their key poses from it in turn. Each
//! group then sorts its key poses by time. In the order of the draw, a path would cut back through
//! the object.

use super::course::{CourseKind, PoseCourse};
use super::curve::CurveKind;
use super::knots::KnotSequence;
use super::metric::MixedMetric;
use super::refine::{TranslationScale, screen_views};
use super::travel::{PoseCount, TravelPlan};
use super::{NamedPose, TrajectoryError};
use gs2e_num::se3::Se3;
use gs2e_num::seed::{CellDraws, DrawSpace, Seed, SeedCell};
use serde::Serialize;

/// Degrees of a Bezier curve, from which one is drawn.
const DEGREES: [u32; 4] = [2, 3, 4, 5];

/// One group of key poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NovelGroup {
    /// Index of the group, from 0.
    pub group: u32,
    /// Number of groups that share the draw.
    pub groups: u32,
    /// Number of key poses of a group, at least 2.
    pub keyframes: u32,
    /// Number of poses to make.
    pub count: PoseCount,
    /// The curve through the key poses.
    pub curve: GroupCurve,
    /// True if the chord lengths are used unchanged.
    pub literal: bool,
    /// Seed of the draw of key poses, common to all groups.
    pub keyframes_seed: Seed,
    /// Seed of the draw of curves, common to all groups.
    pub curve_seed: Seed,
}

/// The curve of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum GroupCurve {
    /// A fair coin selects `cubic` or `bezier`; the degree of the latter is drawn from 2 to 5.
    Any,
    /// A given curve.
    Fixed(CurveKind),
}

/// The trajectory from which key poses are drawn.
#[derive(Debug, Clone, Copy)]
pub struct BaseTrajectory<'a> {
    /// Its poses, camera to world.
    pub poses: &'a [Se3],
    /// Its scale distance D, units.
    pub scale: f64,
}

impl NovelGroup {
    pub(super) fn travel(&self) -> TravelPlan {
        TravelPlan { count: self.count, literal: self.literal }
    }

    /// The course of the group through its key poses, in the metric of the base.
    pub(super) fn course(&self, base: BaseTrajectory<'_>) -> Result<PoseCourse, TrajectoryError> {
        self.screen_numbers(base.poses.len())?;
        let keyframes = self.draw(base.poses.len());
        let names: Vec<String> = keyframes.iter().map(|k| format!("pose {k}")).collect();
        let named = |(name, k)| NamedPose { name, world_from_camera: base.poses[k] };
        let views = names.iter().map(String::as_str).zip(keyframes.iter().copied()).map(named);
        let (origin, views, warnings) = screen_views(views.collect())?;
        let metric = MixedMetric::new(TranslationScale::Fixed(base.scale), &views)?;
        let (curve, degree_drawn) = self.draw_curve();
        let mut course = PoseCourse::through_knots(
            CourseKind::Novel,
            KnotSequence::new(&views, metric)?,
            curve,
            origin,
            metric,
        )?;
        course.degree_drawn = degree_drawn;
        course.keyframes = keyframes;
        course.warnings.splice(..0, warnings);
        Ok(course)
    }

    fn screen_numbers(&self, found: usize) -> Result<(), TrajectoryError> {
        let &Self { group, groups, keyframes, .. } = self;
        let wrong = |field, found: u32, wanted| TrajectoryError::Parameter {
            field,
            found: found.to_string(),
            wanted,
        };
        if groups == 0 {
            return Err(wrong("groups", groups, "a whole number from 1"));
        }
        if group >= groups {
            return Err(wrong("group", group, "a whole number below `groups`"));
        }
        if keyframes < 2 {
            return Err(wrong("keyframes", keyframes, "a whole number from 2"));
        }
        // The product of two 32-bit numbers may need 64 bits.
        let wanted = u64::from(groups) * u64::from(keyframes);
        if wanted > found as u64 {
            return Err(TrajectoryError::FewPoses { groups, keyframes, wanted, found });
        }
        Ok(())
    }

    /// Indices of the group's key poses among `poses`, in ascending order: the group's part of a
    /// partial Fisher-Yates shuffle.
    fn draw(&self, poses: usize) -> Vec<usize> {
        let (group, keyframes) = (self.group as usize, self.keyframes as usize);
        let mut draws = choice_draws(self.keyframes_seed, 0);
        let mut deck: Vec<usize> = (0..poses).collect();
        // Each group repeats the shuffle of the groups before it. The seed fixes the shuffle, so
        // groups built apart draw different poses.
        for next in 0..(group + 1) * keyframes {
            deck.swap(next, next + draws.index(poses - next));
        }
        let mut drawn = deck[group * keyframes..(group + 1) * keyframes].to_vec();
        drawn.sort_unstable();
        drawn
    }

    /// The group's curve, and the degree if one was drawn. Its draws do not depend on those of
    /// other groups.
    fn draw_curve(&self) -> (CurveKind, Option<u32>) {
        if let GroupCurve::Fixed(curve) = self.curve {
            return (curve, None);
        }
        let mut draws = choice_draws(self.curve_seed, u64::from(self.group));
        if draws.index(2) == 0 {
            return (CurveKind::Cubic, None);
        }
        let degree = DEGREES[draws.index(DEGREES.len())];
        (CurveKind::Bezier { degree }, Some(degree))
    }
}

/// The draws of one choice.
fn choice_draws(seed: Seed, index: u64) -> CellDraws {
    seed.draws(SeedCell { x: 0, y: 0, level: 0, index }, DrawSpace::Choice)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn novel(group: u32, groups: u32, keyframes: u32, seed: u64) -> NovelGroup {
        NovelGroup {
            group,
            groups,
            keyframes,
            count: PoseCount::Frames(150),
            curve: GroupCurve::Any,
            literal: false,
            keyframes_seed: Seed(seed),
            curve_seed: Seed(seed),
        }
    }

    #[test]
    fn groups_share_no_pose_and_more_groups_change_no_earlier_one() {
        for seed in 0..50 {
            let of = |groups| (0..groups).map(move |g| novel(g, groups, 5, seed).draw(20));
            let (few, all): (Vec<_>, Vec<_>) = (of(2).collect(), of(4).collect());
            assert_eq!(few[..], all[..2]);
            assert!(all.iter().all(|drawn| drawn.is_sorted()));
            let mut every: Vec<usize> = all.concat();
            every.sort_unstable();
            assert_eq!(every, (0..20).collect::<Vec<_>>());
        }
    }

    /// Compares counts over many seeds with equal shares, or with the given ones.
    fn check_shares<K: Ord>(name: &str, draw: impl Fn(u64) -> K, share: impl Fn(&K) -> f64, limit: f64) {
        const N: u32 = 60_000;
        let mut found: BTreeMap<K, u32> = BTreeMap::new();
        (0..u64::from(N)).for_each(|seed| *found.entry(draw(seed)).or_default() += 1);
        let excess = |(k, n): (&K, &u32)| {
            let expected = share(k) * f64::from(N);
            (f64::from(*n) - expected).powi(2) / expected
        };
        let statistic: f64 = found.iter().map(excess).sum();
        println!("{name}: chi-square of {} cells {statistic:.2} (limit {limit})", found.len());
        let covered: f64 = found.keys().map(share).sum();
        assert!((covered - 1.0).abs() < 1e-12 && statistic < limit, "{name}: {covered}");
    }

    /// Limits of chi-square with 14, 29, 4 and 24 degrees of freedom at alpha 1e-4 over the four.
    #[test]
    fn draws_are_fair() {
        check_shares("two of six", |seed| novel(0, 1, 2, seed).draw(6), |_| 1.0 / 15.0, 46.30);
        let pairs = |seed| [0, 1].map(|group| novel(group, 2, 2, seed).draw(5));
        check_shares("two groups of two of five", pairs, |_| 1.0 / 30.0, 70.61);
        let likely = |degree: &Option<u32>| if degree.is_some() { 1.0 / 8.0 } else { 1.0 / 2.0 };
        let degree = |group| move |seed| novel(group, 9, 2, seed).draw_curve().1;
        check_shares("curve", degree(3), likely, 26.50);
        let both = |seed| [0, 1].map(|group| degree(group)(seed));
        check_shares("curves of neighbours", both, |[a, b]| likely(a) * likely(b), 62.85);
    }

    /// The first draws are part of the law: changing them changes every released novel trajectory.
    #[test]
    fn first_draws_are_frozen() {
        let drawn: Vec<Vec<usize>> = (0..3).map(|group| novel(group, 3, 5, 1).draw(150)).collect();
        assert_eq!(drawn, DRAWN);
        let degrees: Vec<Option<u32>> = (0..12).map(|group| novel(group, 12, 5, 1).draw_curve().1).collect();
        assert_eq!(degrees, DEGREES_DRAWN);
    }

    const DRAWN: [[usize; 5]; 3] = [[35, 41, 65, 86, 118], [20, 67, 84, 87, 146], [13, 62, 103, 104, 142]];
    const DEGREES_DRAWN: [Option<u32>; 12] =
        [None, Some(4), Some(5), None, None, None, Some(2), None, Some(5), Some(4), None, None];
}
