//! Products of each trajectory and their spacing.

use super::number::{RealRange, WholeRange};
use super::{Resolver, all};
use crate::field::Field;
use crate::output::WrittenSpacing;
use crate::problem::{FieldProblem, quote_text};
use crate::{OutputKind, PictureSpacing, Recipe, TrajectoryRecipe, schema};
use gs2e_image::light::MeanScale;
use gs2e_num::units::Hertz;
use gs2e_sampling::exposure::{FRAMES, ShutterSettings, SubframeRule};
use gs2e_trajectory::{MAX_POSES, MAX_RATE_HZ};
use std::collections::BTreeSet;

/// Maximum number of exposed frames: four seconds at 2,400 frames per second.
const MAX_EXPOSED: u64 = 9_999;
/// Accepted readouts: up to a second.
const READOUT_US: WholeRange = WholeRange::new(1, 1_000_000);

impl Resolver<'_> {
    pub(super) fn outputs(&self, field: &Field<Vec<Field<OutputKind>>>) -> Option<BTreeSet<OutputKind>> {
        let Some((list, _)) = field.given() else {
            return field.is_absent().then(|| BTreeSet::from(OutputKind::DEFAULT));
        };
        let mut outputs = BTreeSet::new();
        for (output, place) in all::<_, _, Vec<_>>(list, Field::given)? {
            if !outputs.insert(*output) {
                self.report(FieldProblem::of_field("names an output twice").at(place));
            }
        }
        Some(outputs)
    }

    pub(super) fn spacing(&self, raw: &schema::RecipeSchema, rate: Option<Hertz>) -> Option<PictureSpacing> {
        let every = |spacing: Option<WrittenSpacing<'_>>| {
            let WrittenSpacing { every, fps } = spacing?;
            self.refuse_both(every, fps, "every")?;
            match self.poses_a_picture(fps, rate)? {
                Some(poses) => Some(nearest(poses)),
                None => self.small(every, 1, WholeRange::new(1, MAX_POSES)),
            }
        };
        let every = PictureSpacing::written(raw).map(|(output, spacing)| (output, every(spacing)));
        // Every section reports its faults before the first faulty one ends this.
        let every = every.into_iter().map(|(output, every)| Some((output, every?)));
        every.collect::<Option<_>>().map(PictureSpacing::from_spacings)
    }

    /// Refuses pictures per second together with the key that counts poses.
    fn refuse_both(&self, counted: &Field<u64>, fps: &Field<f64>, name: &str) -> Option<()> {
        match (counted.is_absent(), fps.place()) {
            (false, Some(at)) => {
                let problem = FieldProblem::of_key(format!("and {name} exclude each other"));
                self.refuse(problem.help("keep one of them: both set the spacing of the pictures").at(at))
            }
            _ => Some(()),
        }
    }

    /// Number of poses from one picture to the next at the pictures per second that a recipe asks for.
    fn poses_a_picture(&self, fps: &Field<f64>, rate: Option<Hertz>) -> Option<Option<f64>> {
        let Some((_, at)) = fps.given() else { return fps.is_absent().then_some(None) };
        let fps = self.real(fps, 30.0, RealRange::above(0.0, MAX_RATE_HZ))?;
        let rate = rate?.to_f64();
        if fps > rate {
            let problem = FieldProblem::of_field(format!("is {fps}, above the {rate} poses per second"));
            return self.refuse(problem.help("write less, or a higher sampling.rate").at(at));
        }
        Some(Some(rate / fps))
    }

    /// Time from the first row of a sharp frame to the last, if the shutter rolls.
    pub(super) fn readout_us(&self, field: &Field<schema::SharpSection>) -> Option<Option<u32>> {
        field.or_default()?.readout_us.optional(|readout| self.small(readout, 1, READOUT_US))
    }

    /// Refuses blurred frames along a path that is known to be shorter than an exposure.
    pub(super) fn refuse_long_exposures(
        &self,
        field: &Field<schema::BlurSection>,
        recipe: &Recipe,
    ) -> Option<()> {
        let (frames, wanted) = (recipe.shutter.frames, recipe.shutter.frames + 2);
        let is_short = |own: &&TrajectoryRecipe| {
            let poses = own.path.stated_poses(recipe.rate);
            recipe.exposed_along(&own.name).is_some() && poses.is_some_and(|poses| poses < f64::from(wanted))
        };
        let Some(short) = recipe.trajectories.iter().find(is_short) else { return Some(()) };
        let found = format!(
            "blurred frames need {wanted} poses for an exposure of {frames} frames, and the trajectory {} has fewer",
            quote_text(&short.written)
        );
        let fields =
            field.given().map(|(raw, place)| raw.fps.place().or(raw.frames.place()).unwrap_or(place));
        let problem = FieldProblem::new(found).help("write fewer blur.frames, or a longer path");
        self.refuse(problem.at(fields.unwrap_or(self.root)))
    }

    /// An exposure of this many frames, if it is not too long.
    fn exposed_at(&self, fps: &Field<f64>, frames: u32) -> Option<u32> {
        if u64::from(frames) <= MAX_EXPOSED {
            return Some(frames);
        }
        let found = format!("makes exposures of {frames} frames, wanted at most {MAX_EXPOSED}");
        self.refuse(FieldProblem::of_field(found).help("write more pictures per second").at(fps.place()?))
    }

    pub(super) fn shutter(
        &self,
        field: &Field<schema::BlurSection>,
        rate: Option<Hertz>,
    ) -> Option<ShutterSettings> {
        let raw = field.or_default()?;
        self.refuse_both(&raw.frames, &raw.fps, "frames")?;
        let frames = match self.poses_a_picture(&raw.fps, rate)? {
            // The nearest odd number.
            Some(poses) => self.exposed_at(&raw.fps, 2 * nearest((poses + 1.0) / 2.0) - 1),
            None => self.small(&raw.frames, FRAMES, WholeRange::new(1, MAX_EXPOSED)),
        };
        if let (Some(frames), Some(place)) = (frames, raw.frames.place())
            && frames % 2 == 0
        {
            let problem = FieldProblem::of_field(format!("is {frames}, wanted an odd number"));
            return self.refuse(
                problem
                    .help("write an odd number, so that one frame is in the middle of an exposure")
                    .at(place),
            );
        }
        let (subframes, mean) = (raw.subframes.or(SubframeRule::Auto), raw.mean.or(MeanScale::Linear));
        resolved!(ShutterSettings { frames, subframes, mean })
    }
}

/// The nearest whole number, at least 1 and in the range of poses.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the range of poses")]
fn nearest(poses: f64) -> u32 {
    poses.round().clamp(1.0, MAX_POSES as f64) as u32
}
