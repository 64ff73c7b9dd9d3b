//! Light that changes with time.

use super::number::RealRange;
use super::{Resolver, all};
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::text::TextSpan;
use crate::{OutputKind, schema};
use gs2e_num::units::{Hertz, brief};
use gs2e_render::lights::{Flicker, LevelMoment, SceneLights};
use gs2e_sensor::voltmeter::BetweenFrames;
use std::collections::BTreeSet;

/// Frequencies: from a slow breath to pulse-width modulation.
const HERTZ: RealRange = RealRange::new(1e-3, 1e5);
/// Times of the level, s.
const TIME: RealRange = RealRange::new(0.0, 1e6);
/// Levels: a factor of a million in both directions.
const STOPS: RealRange = RealRange::new(-20.0, 20.0);
/// Minimum frames in a period for events. With fewer, the frames miss the bright and the dark parts of a
/// period.
const FRAMES_A_PERIOD: f64 = 4.0;

impl Resolver<'_> {
    /// The light, if the recipe has it. Without an output of pictures or events, it has no effect.
    pub(super) fn lights(
        &self,
        raw: &schema::RecipeSchema,
        rate: Option<Hertz>,
        outputs: Option<&BTreeSet<OutputKind>>,
    ) -> Option<Option<SceneLights>> {
        let Some((section, place)) = raw.lights.given() else {
            return raw.lights.is_absent().then_some(None);
        };
        let level = self.level(&section.level);
        let flicker = section.flicker.optional(|flicker| self.flicker(flicker));
        let (flicker, level) = (flicker?, level?);
        if flicker.is_none() && level.is_empty() {
            let problem = FieldProblem::of_field("has neither `flicker` nor `level`");
            return self.refuse(problem.help("write flicker: { hz: 100, depth: 0.3 }").at(place));
        }
        if let Some(flicker) = flicker {
            let place = section.flicker.place().unwrap_or(place);
            let has_events = outputs.into_iter().flatten().any(|output| output.is_simulated());
            if has_events {
                self.follows(&flicker, &raw.sampling, rate, place)?;
            }
        }
        Some(Some(SceneLights { flicker, level }))
    }

    fn flicker(&self, field: &Field<schema::FlickerSection>) -> Option<Flicker> {
        let (raw, place) = field.given()?;
        let help = "write the frequency of the light, for example hz: 100";
        let hz = self.required(&raw.hz, "hz", place, help);
        let help = "write the depth of modulation, for example depth: 0.3";
        let depth = self.required(&raw.depth, "depth", place, help);
        resolved!(Flicker {
            hz: hz.and_then(|_| self.real(&raw.hz, 1.0, HERTZ)),
            depth: depth.and_then(|_| self.real(&raw.depth, 1.0, RealRange::above(0.0, 1.0))),
            waveform: raw.waveform.or_default(),
            phase: self.real(&raw.phase, 0.0, RealRange::new(0.0, 1.0)),
        })
    }

    fn level(&self, field: &Field<Vec<Field<schema::LevelSection>>>) -> Option<Vec<LevelMoment>> {
        let Some((list, _)) = field.given() else { return field.is_absent().then(Vec::new) };
        let mut last: Option<f64> = None;
        all(list, |field| {
            let (raw, place) = field.given()?;
            self.required(&raw.t, "t", place, "write the time in seconds");
            self.required(&raw.stops, "stops", place, "write the level in stops");
            let (t, stops) = (self.real(&raw.t, 0.0, TIME), self.real(&raw.stops, 0.0, STOPS));
            let (t, stops) = (t?, stops?);
            if let Some(last) = last.filter(|last| *last >= t) {
                let found = format!("has t {}, wanted above {}", brief(t), brief(last));
                return self.refuse(FieldProblem::of_field(found).at(place));
            }
            // The numbers above are then defaults, which must not become a moment.
            if raw.t.is_absent() || raw.stops.is_absent() {
                return None;
            }
            last = Some(t);
            Some(LevelMoment { t, stops })
        })
    }

    /// Checks that the frames of the events follow a flicker.
    fn follows(
        &self,
        flicker: &Flicker,
        sampling: &Field<schema::SamplingSection>,
        rate: Option<Hertz>,
        place: TextSpan,
    ) -> Option<()> {
        let sampling = sampling.or_default()?;
        if flicker.waveform.jumps() {
            if let Some(place) = sampling.tolerance.place() {
                let problem = FieldProblem::of_key("and a flicker with waveform square exclude each other");
                let help = "write a rate: the jumps of the light are between two frames in any case";
                return self.refuse(problem.help(help).at(place));
            }
            if let Some((BetweenFrames::Catmull, place)) = sampling.between.given() {
                let problem =
                    FieldProblem::of_field("is catmull, which overshoots at the jumps of the light");
                return self.refuse(problem.help("write between: linear, or hermite").at(place));
            }
        }
        let rate = rate?.to_f64();
        if sampling.tolerance.is_absent() && rate < FRAMES_A_PERIOD * flicker.hz {
            let found = format!(
                "is {} Hz, and the sensor sees {} frames per second, fewer than 4 in a period",
                brief(flicker.hz),
                brief(rate)
            );
            let help = format!("write sampling: {{ rate: {} }}, or more", brief(20.0 * flicker.hz));
            return self.refuse(FieldProblem::of_field(found).help(help).at(place));
        }
        Some(())
    }
}
