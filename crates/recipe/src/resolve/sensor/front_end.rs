//! The optical front end of a sensor, before its pixels.

use super::super::Resolver;
use super::super::number::RealRange;
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::schema;
use crate::text::TextSpan;
use gs2e_sensor::front_end;
use gs2e_sensor::front_end::{FrontEnd, LuminanceWeights};
use gs2e_sensor::voltmeter::BetweenFrames;

/// Range of the weights of a colour.
const WEIGHT: RealRange = RealRange::new(0.0, 1.0);
/// Range of the factors on brightness.
const EXPOSURE: RealRange = RealRange::above(0.0, 1e6);
/// Range of the light of white, lux.
const LUX: RealRange = RealRange::above(0.0, 1e9);
/// Range of the grey levels.
const GREY: RealRange = RealRange::new(0.0, 1e9);
const SUM: &str = "rec601 is 0.299, 0.587, 0.114, and rec709 is 0.2126, 0.7152, 0.0722";

impl Resolver<'_> {
    /// Resolves a front end. `in_lux` says that the sensor behind it depends on the light of white.
    pub(super) fn front_end(&self, field: &Field<schema::FrontEndSection>, in_lux: bool) -> Option<FrontEnd> {
        let raw = field.or_default()?;
        resolved!(FrontEnd {
            luminance: self.luminance(&raw.luminance),
            decode: raw.decode.or_default(),
            exposure: self.real(&raw.exposure, 1.0, EXPOSURE),
            range: self.brightness_range(&raw.range),
            lux: self.lux(&raw.lux, in_lux),
        })
    }

    fn lux(&self, field: &Field<f64>, in_lux: bool) -> Option<Option<f64>> {
        let lux = self.real(field, front_end::WHITE_LUX, LUX)?;
        match field.place() {
            Some(place) if !in_lux => {
                let problem = FieldProblem::of_key("has no effect: the constants of this sensor are in grey");
                self.refuse(
                    problem
                        .help("remove it, or use the preset davis346, evk4 or dvxplorer of voltmeter")
                        .at(place),
                )
            }
            _ => Some(in_lux.then_some(lux)),
        }
    }

    fn luminance(&self, field: &Field<schema::LuminanceSection>) -> Option<LuminanceWeights> {
        match field.given() {
            None => field.is_absent().then(LuminanceWeights::default),
            Some((schema::LuminanceSection::Rec601, _)) => Some(LuminanceWeights::Rec601),
            Some((schema::LuminanceSection::Rec709, _)) => Some(LuminanceWeights::Rec709),
            Some((schema::LuminanceSection::Weights(weights), _)) => {
                let (weights, place) = weights.given()?;
                self.weights(weights, place)
            }
        }
    }

    fn weights(&self, fields: &[Field<f64>; 3], place: TextSpan) -> Option<LuminanceWeights> {
        let weights = self.numbers(fields, WEIGHT)?;
        LuminanceWeights::from_weights(weights).ok().or_else(|| {
            let sum = front_end::told_sum(&weights);
            let found = format!("sums to {sum}, wanted 1 within 1e-6");
            self.refuse(FieldProblem::of_field(found).help(SUM).at(place))
        })
    }

    fn brightness_range(&self, field: &Field<schema::RangeSection>) -> Option<front_end::GreyRange> {
        let raw = field.or_default()?;
        let (min, max) = (self.real(&raw.min, 0.0, GREY), raw.max.optional(|max| self.real(max, 0.0, GREY)));
        let (min, max) = (min?, max?);
        match (max, field.place()) {
            (Some(max), Some(place)) if max <= min => self
                .refuse(FieldProblem::of_field(format!("is {min} to {max}, wanted min below max")).at(place)),
            _ => Some(front_end::GreyRange { min, max }),
        }
    }

    /// Rates of change are rendered for one fixed sum of the colours.
    pub(super) fn rates_of(
        &self,
        front_end: &FrontEnd,
        between: BetweenFrames,
        field: &Field<schema::FrontEndSection>,
    ) -> Option<()> {
        if between != BetweenFrames::Hermite || !front_end.needs_colour() {
            return Some(());
        }
        let problem = FieldProblem::of_key(
            "and hermite exclude each other: rates of change are rendered only for luminance rec601, not decoded",
        );
        let help = "write sampling: { between: catmull }; exposure and range work with hermite";
        self.refuse(problem.help(help).at(field.place()?))
    }
}
