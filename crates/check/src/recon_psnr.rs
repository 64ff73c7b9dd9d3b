//! Agreement of a scene with its photos: PSNR and SSIM of renderings from the poses of the photos.
//!
//! - `drop`: mean minus smallest PSNR over the views that the training saw, at most 3 dB: warning,
//!   a gate where the recipe sets it. GS-Blur (GitHub dongwoohhh/GS-Blur), the predecessor with the
//!   same first half, rejects scenes above that. One blurred photo is enough for it in a good scene,
//!   and so is a held-out view at the end of the walk.
//! - `mean`: at least 25 dB: warning, a gate where the recipe sets it.
//! - `ssim`: the mean, reported only; a gate where the recipe sets a limit.

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{SceneSubject, Verdict, limits};
use gs2e_train::fidelity::{HeldOutViews, PhotoFidelity, PsnrFigures};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest difference between the mean and the worst PSNR. Unit: dB. Default: `DROP_DB`, as a warning.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub drop: Option<f64>,
    /// Smallest mean PSNR. Unit: dB. Default: `MEAN_DB`, as a warning.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub mean: Option<f64>,
    /// Smallest mean SSIM. Default: none.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub ssim: Option<f64>,
}

const DROP_DB: f64 = 3.0;
const MEAN_DB: f64 = 25.0;

/// The statements on a scene.
pub(super) fn judge_photos(subject: &SceneSubject<'_>) -> Statements {
    let judged = judge_fidelity(subject);
    // A statement that was not measured appears in the report all the same.
    let judged = judged.unwrap_or_else(|because| [Err(because.clone()), Err(because.clone()), Err(because)]);
    ["drop", "mean", "ssim"].into_iter().zip(judged).collect()
}

fn judge_fidelity(subject: &SceneSubject<'_>) -> Result<[JudgementResult; 3], String> {
    let fidelity = subject.fidelity.ok_or("there is no scene to render")?;
    let (Some(psnr), Some(similarity)) = (fidelity.psnr(), fidelity.ssim()) else {
        return Err(match fidelity.not_compared.first() {
            Some(first) => format!("no photo can be compared; `{}`: {}", first.name, first.because),
            None => "there are no photos".to_owned(),
        });
    };
    let limits = subject.limits.recon_psnr.unwrap_or_default();
    Ok([
        judge_drop(fidelity, &limits),
        Ok(judge_mean(fidelity, &psnr, &limits)),
        Ok(judge_ssim(similarity, psnr.views, &limits)),
    ])
}

fn judge_drop(fidelity: &PhotoFidelity, limits: &Limits) -> JudgementResult {
    let limit = LimitSide::limit_or(limits.drop, LimitSide::warning(DROP_DB));
    let trained = fidelity.trained_on();
    let (Some(psnr), Some(worst)) = (trained.psnr(), trained.worst()) else {
        return Err("all photos that can be compared were held out from training".into());
    };
    let measured = psnr.mean - psnr.min;
    let views = match fidelity.held_out {
        HeldOutViews::Every(_) => "the views that were trained on",
        HeldOutViews::Unknown | HeldOutViews::Nothing => "all views",
    };
    let because =
        format!("`{}` has {:.2} dB, {measured:.2} dB below the mean of {views}", worst.name, psnr.min);
    Ok(Judgement::at_most(measured, limit, "dB", because))
}

fn judge_mean(fidelity: &PhotoFidelity, psnr: &PsnrFigures, limits: &Limits) -> Judgement {
    let limit = LimitSide::limit_or(limits.mean, LimitSide::warning(MEAN_DB));
    let held_out = match (fidelity.held_out, psnr.held_out) {
        (HeldOutViews::Nothing, _) => "; none was held out from training".to_owned(),
        (HeldOutViews::Every(_), Some(held_out)) => {
            let count = fidelity.views.iter().filter(|view| view.held_out).count();
            format!("; the {count} that were held out from training, {held_out:.2} dB")
        }
        (HeldOutViews::Unknown, Some(held_out)) => {
            format!("; every eighth view, which trainers usually hold out, {held_out:.2} dB")
        }
        (_, None) => String::new(),
    };
    let not_compared = match fidelity.not_compared.as_slice() {
        [] => String::new(),
        [first, ..] => {
            let count = fidelity.not_compared.len();
            format!("; {count} could not be compared, for example `{}`: {}", first.name, first.because)
        }
    };
    let because =
        format!("{} views have a mean PSNR of {:.2} dB{held_out}{not_compared}", psnr.views, psnr.mean);
    Judgement::at_least(psnr.mean, limit, "dB", because)
}

fn judge_ssim(measured: f64, views: usize, limits: &Limits) -> Judgement {
    let verdict = limits.ssim.map_or(Verdict::Pass, |least| LimitSide::gate(least).at_least(measured));
    let because = format!("{views} views have a mean SSIM of {measured:.4}");
    Judgement::new(verdict, measured, limits.ssim, "1", because)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Finding, judge_scene};
    use gs2e_train::fidelity::{ComparedView, NotCompared, PhotoFidelity};

    /// The finding of a statement on views with this PSNR.
    fn found(statement: &str, limits: &str, psnr: &[f64]) -> Finding {
        found_by(HeldOutViews::Unknown, statement, limits, psnr)
    }

    fn found_by(held_out: HeldOutViews, statement: &str, limits: &str, psnr: &[f64]) -> Finding {
        let view = |(i, psnr): (usize, &f64)| ComparedView {
            name: format!("{i}.jpg"),
            psnr: *psnr,
            ssim: 0.8,
            held_out: held_out.holds_out(i),
        };
        let not_compared = vec![NotCompared { name: "9.jpg".into(), because: "neither JPEG nor PNG".into() }];
        let views = psnr.iter().enumerate().map(view).collect();
        let fidelity = PhotoFidelity { held_out, views, not_compared };
        let why = || "not asked here".to_owned();
        let limits = serde_json::from_str(limits).unwrap();
        let subject = SceneSubject {
            name: "s",
            reprojection: Err(why()),
            photos: Err(why()),
            walk: Err(why()),
            fidelity: Some(&fidelity),
            limits: &limits,
        };
        judge_scene(&subject).into_iter().find(|f| f.subject.statement == statement).unwrap()
    }

    #[test]
    fn one_bad_view_is_a_warning_and_a_fault_by_the_limit_of_a_recipe() {
        let finding = found("drop", "{}", &[30.0, 30.0, 20.0, 32.0]);
        assert_eq!((finding.verdict, finding.measured, finding.limit), (Verdict::Warn, Some(8.0), Some(3.0)));
        assert!(finding.because.starts_with("`2.jpg` has 20.00 dB, 8.00 dB below"), "{}", finding.because);
        assert_eq!(found("drop", "{}", &[30.0, 30.0, 26.5, 31.5]).verdict, Verdict::Pass);
        let asked = r#"{"recon_psnr": {"drop": 3}}"#;
        assert_eq!(found("drop", asked, &[30.0, 20.0]).verdict, Verdict::Fail);
        let waived = r#"{"recon_psnr": {"drop": 3}, "waive": [{"check": "recon_psnr", "because": "known"}]}"#;
        assert_eq!(found("drop", waived, &[30.0, 20.0]).verdict, Verdict::Waived);
        assert_eq!(found("drop", r#"{"recon_psnr": {"drop": 6}}"#, &[30.0, 20.0]).verdict, Verdict::Pass);
    }

    #[test]
    fn the_drop_is_that_of_views_that_were_trained_on() {
        let psnr = [20.0, 30.0, 31.0, 21.0, 32.0, 31.0];
        let found = |by, statement| found_by(by, statement, "{}", &psnr);
        let [every, nothing] = [3, 0].map(HeldOutViews::by_training);
        // 31 without the first and the fourth; 27.5 with all.
        assert_eq!((found(every, "drop").verdict, found(every, "drop").measured), (Verdict::Pass, Some(1.0)));
        assert_eq!(found(nothing, "drop").measured, Some(7.5));
        let said = found(every, "mean").because;
        assert!(said.contains("the 2 that were held out from training, 20.50 dB"), "{said}");
        let said = found(nothing, "mean").because;
        assert!(said.contains("dB; none was held out from training"), "{said}");
        let all = HeldOutViews::Every(1);
        assert_eq!(found(all, "drop").verdict, Verdict::NotRun);
    }

    #[test]
    fn a_poor_scene_is_told_and_fails_where_the_recipe_says_so() {
        let poor = [24.0, 25.5];
        let finding = found("mean", "{}", &poor);
        assert_eq!((finding.verdict, finding.measured), (Verdict::Warn, Some(24.75)));
        assert!(
            finding.because.contains("hold out, 24.00 dB; 1 could not be compared"),
            "{}",
            finding.because
        );
        assert_eq!(found("mean", r#"{"recon_psnr": {"mean": 25}}"#, &poor).verdict, Verdict::Fail);
        let ssim = found("ssim", "{}", &poor);
        assert_eq!((ssim.verdict, ssim.limit), (Verdict::Pass, None));
        assert_eq!(found("ssim", r#"{"recon_psnr": {"ssim": 0.9}}"#, &poor).verdict, Verdict::Fail);
    }

    #[test]
    fn without_photos_nothing_is_judged() {
        for statement in ["drop", "mean", "ssim"] {
            let finding = found(statement, "{}", &[]);
            assert_eq!((finding.verdict, finding.measured), (Verdict::NotRun, None));
            assert!(finding.because.contains("`9.jpg`: neither JPEG nor PNG"), "{}", finding.because);
        }
    }
}
