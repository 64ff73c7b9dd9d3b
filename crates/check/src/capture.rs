//! The capture of a scene: the fit of its poses to its points, missing views, outliers. Warnings;
//! gates where the recipe sets the limit.
//!
//! - `reprojection`: the mean distance of COLMAP's points from their key points, at most 2 px, over
//!   points (as in COLMAP) and over observations. COLMAP drops observations beyond 4 px
//!   (`Mapper.filter_max_reproj_error`). If errors have standard deviation `s` in both directions,
//!   their mean is `s sqrt(pi/2)`, and a mean of 2 px has `exp(-4^2 / (2 s^2)) = exp(-pi)`, 4.3 %,
//!   beyond that filter. Above 2 px, the filter determines the error.
//! - `gap`: the longest step between neighbouring views, at most 8 median steps ([`GAP`]).
//! - `outlier`: the largest detour ([`gs2e_trajectory::walk`]), at most 3 median steps. A walk
//!   has no detour above 1 except where it turns back. Views that fill a ball of radius R have none
//!   above 2 in any order: a detour is at most one distance between two views, so at most 2 R, and
//!   the median of such distances is about R.
//! - `registered`: the share of photos with a pose, at least 0.9.

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{SceneSubject, limits};
use gs2e_source::colmap::ReprojectionStats;
use gs2e_trajectory::knots::GAP;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest mean reprojection error. Unit: px. Default: `REPROJECTION_PX`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub reprojection: Option<f64>,
    /// Longest step between neighbouring views. Unit: median steps. Default: `8`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub gap: Option<f64>,
    /// Largest detour of a view. Unit: median steps. Default: `OUTLIER`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub outlier: Option<f64>,
    /// Smallest share of photos that have a pose. Default: `REGISTERED`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub registered: Option<f64>,
}

const REPROJECTION_PX: f64 = 2.0;
const OUTLIER: f64 = 3.0;
const REGISTERED: f64 = 0.9;

/// Maximum number of names in a finding.
const MAX_LISTED: usize = 3;

/// The statements on a scene. One that was not measured appears in the report all the same.
pub(super) fn judge_capture(subject: &SceneSubject<'_>) -> Statements {
    let limits = subject.limits.capture.unwrap_or_default();
    let [over_points, over_observations] = match &subject.reprojection {
        Ok(found) => judge_reprojection(found, &limits).map(Ok),
        Err(because) => [Err(because.clone()), Err(because.clone())],
    };
    vec![
        ("reprojection", over_points),
        ("reprojection-observations", over_observations),
        ("gap", judge_gap(subject, &limits)),
        ("outlier", judge_outlier(subject, &limits)),
        ("registered", judge_registered(subject, &limits)),
    ]
}

/// The mean errors over points and over observations.
fn judge_reprojection(found: &ReprojectionStats, limits: &Limits) -> [Judgement; 2] {
    let limit = LimitSide::limit_or(limits.reprojection, LimitSide::warning(REPROJECTION_PX));
    // Points behind the camera have no place in the picture, so the means leave them out.
    let behind = match found.behind {
        0 => String::new(),
        count => format!("; {count} more observations are of points behind the camera"),
    };
    let judge = |measured, over: String| {
        let because = format!("the mean reprojection error is {measured:.2} px over {over}{behind}");
        Judgement::at_most(measured, limit, "px", because)
    };
    [
        judge(found.over_points_px, format!("{} points", found.points)),
        judge(found.over_observations_px, format!("{} observations", found.observations)),
    ]
}

/// Returns the largest of named quantities and the names of those beyond a limit, in descending
/// order; `None` for an empty list.
fn largest_beyond(mut named: Vec<(String, f64)>, limit: f64) -> Option<(f64, String)> {
    named.sort_by(|a, b| b.1.total_cmp(&a.1));
    let (first, measured) = named.first()?.clone();
    let beyond: Vec<String> =
        named.into_iter().take_while(|(_, v)| *v > limit).map(|(name, _)| name).collect();
    // A finding within its limit names the largest all the same.
    let phrase = match beyond.len() {
        0 => first,
        count if count <= MAX_LISTED => beyond.join(", "),
        count => format!("{} and {} more", beyond[..MAX_LISTED].join(", "), count - MAX_LISTED),
    };
    Some((measured, phrase))
}

fn judge_gap(subject: &SceneSubject<'_>, limits: &Limits) -> JudgementResult {
    let walk = subject.walk.as_ref()?;
    let limit = LimitSide::limit_or(limits.gap, LimitSide::warning(GAP));
    let steps = walk.steps.iter().map(|s| (format!("`{}` to `{}`", s.after, s.before), s.times_median));
    let (measured, phrase) = largest_beyond(steps.collect(), limit.value).ok_or("there is only one view")?;
    let because =
        format!("the longest step between neighbouring views is {measured:.2} median steps: {phrase}");
    Ok(Judgement::at_most(measured, limit, "1", because))
}

fn judge_outlier(subject: &SceneSubject<'_>, limits: &Limits) -> JudgementResult {
    let walk = subject.walk.as_ref()?;
    let limit = LimitSide::limit_or(limits.outlier, LimitSide::warning(OUTLIER));
    let detours = walk.detours.iter().map(|d| (format!("`{}`", d.name), d.times_median));
    let (measured, phrase) =
        largest_beyond(detours.collect(), limit.value).ok_or("there are fewer than 3 views")?;
    let because =
        format!("the largest detour of a view from its neighbours is {measured:.2} median steps: {phrase}");
    Ok(Judgement::at_most(measured, limit, "1", because))
}

fn judge_registered(subject: &SceneSubject<'_>, limits: &Limits) -> JudgementResult {
    let photos = subject.photos.as_ref()?;
    if photos.there == 0 {
        return Err("there are no photos".into());
    }
    let limit = LimitSide::limit_or(limits.registered, LimitSide::warning(REGISTERED));
    let measured = photos.registered as f64 / photos.there as f64;
    let absent = match photos.views - photos.registered {
        0 => String::new(),
        count => format!("; {count} views have no photo"),
    };
    let because = format!("{} of {} photos have a pose{absent}", photos.registered, photos.there);
    Ok(Judgement::at_least(measured, limit, "1", because))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CapturePhotos, Verdict, judge_scene};
    use glam::{DQuat, DVec3};
    use gs2e_num::se3::Se3;
    use gs2e_train::fidelity::PhotoFidelity;
    use gs2e_trajectory::NamedPose;
    use gs2e_trajectory::walk::CaptureEvenness;

    /// Verdict, value and sentence of a statement about a walk of 30 evenly spaced views, after
    /// `plant`.
    fn found(statement: &str, limits: &str, plant: impl FnOnce(&mut Vec<DVec3>)) -> (Verdict, f64, String) {
        let mut centres: Vec<DVec3> = (0..30u8).map(|i| DVec3::X * f64::from(i)).collect();
        plant(&mut centres);
        let names: Vec<String> = (0..centres.len()).map(|i| format!("{i}.jpg")).collect();
        let at = |centre: &DVec3| Se3 { rotation: DQuat::IDENTITY, translation: *centre };
        let views = names.iter().zip(&centres);
        let views: Vec<NamedPose<'_>> =
            views.map(|(name, c)| NamedPose { name, world_from_camera: at(c) }).collect();
        let limits = serde_json::from_str(limits).unwrap();
        let subject = SceneSubject {
            name: "s",
            reprojection: Ok(ReprojectionStats {
                points: 10,
                observations: 40,
                over_points_px: 1.5,
                over_observations_px: 2.5,
                behind: 0,
            }),
            photos: Ok(CapturePhotos { there: 40, registered: 30, views: 31 }),
            walk: Ok(CaptureEvenness::measure_views(&views).unwrap().unwrap()),
            fidelity: Some(&PhotoFidelity::default()),
            limits: &limits,
        };
        let found = judge_scene(&subject).into_iter().find(|f| f.subject.statement == statement).unwrap();
        (found.verdict, found.measured.unwrap(), found.because)
    }

    fn close(found: f64, wanted: f64) {
        assert!((found - wanted).abs() < 1e-9, "{found}, {wanted}");
    }

    #[test]
    fn an_even_walk_is_sound() {
        for (statement, wanted) in [("gap", 1.0), ("outlier", 0.0)] {
            let (verdict, measured, _) = found(statement, "{}", |_| ());
            assert_eq!(verdict, Verdict::Pass, "{statement}");
            close(measured, wanted);
        }
    }

    #[test]
    fn a_pose_moved_off_its_way_is_found() {
        let (verdict, measured, because) = found("outlier", "{}", |c| c[13] += 7.0 * DVec3::Y);
        // Both legs are sqrt(1 + 49).
        close(measured, 50f64.sqrt() - 1.0);
        assert_eq!(verdict, Verdict::Warn);
        assert!(because.ends_with("6.07 median steps: `13.jpg`"), "{because}");
        // It is not a gap, and a view within the limit is not an outlier.
        assert_eq!(found("gap", "{}", |c| c[13] += 7.0 * DVec3::Y).0, Verdict::Pass);
        assert_eq!(found("outlier", "{}", |c| c[13] += 3.8 * DVec3::Y).0, Verdict::Pass);
        assert_eq!(found("outlier", "{}", |c| c[13] += 4.0 * DVec3::Y).0, Verdict::Warn);
    }

    #[test]
    fn a_run_of_views_that_is_missing_is_a_gap() {
        let (verdict, measured, because) = found("gap", "{}", |c| drop(c.drain(10..19)));
        close(measured, 10.0);
        assert_eq!(verdict, Verdict::Warn);
        assert!(because.ends_with("10.00 median steps: `9.jpg` to `10.jpg`"), "{because}");
        assert_eq!(found("outlier", "{}", |c| drop(c.drain(10..19))).0, Verdict::Pass);
        assert_eq!(found("gap", "{}", |c| drop(c.drain(10..17))).0, Verdict::Pass);
        let many = |c: &mut Vec<DVec3>| (0..5).for_each(|i| c[6 * i] += 50.0 * DVec3::Y);
        let (_, _, because) = found("outlier", "{}", many);
        assert!(because.contains(", `") && because.ends_with(" and 1 more"), "{because}");
    }

    #[test]
    fn photos_without_a_pose_and_points_off_their_places_are_found() {
        let (verdict, measured, because) = found("registered", "{}", |_| ());
        assert_eq!(
            (verdict, because.as_str()),
            (Verdict::Warn, "30 of 40 photos have a pose; 1 views have no photo")
        );
        close(measured, 0.75);
        let (verdict, measured, _) = found("reprojection", "{}", |_| ());
        assert_eq!(verdict, Verdict::Pass);
        close(measured, 1.5);
        let (verdict, measured, _) = found("reprojection-observations", "{}", |_| ());
        assert_eq!(verdict, Verdict::Warn);
        close(measured, 2.5);
    }

    #[test]
    fn a_recipes_limit_is_a_gate_and_can_be_waived() {
        let t = |statement: &str, limits: &str, wanted| {
            assert_eq!(found(statement, limits, |_| ()).0, wanted, "{limits}")
        };
        t("reprojection", r#"{"capture": {"reprojection": 1.4}}"#, Verdict::Fail);
        t("reprojection", r#"{"capture": {"reprojection": 1.6}}"#, Verdict::Pass);
        t("registered", r#"{"capture": {"registered": 0.8}}"#, Verdict::Fail);
        t("registered", r#"{"capture": {"registered": 0.7}}"#, Verdict::Pass);
        t("gap", r#"{"capture": {"gap": 0.5}}"#, Verdict::Fail);
        let waived = r#"{"capture": {"gap": 0.5}, "waive": [{"check": "capture", "because": "old"}]}"#;
        t("gap", waived, Verdict::Waived);
    }
}
