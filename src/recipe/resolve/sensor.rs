//! The sensor: presets and units become numbers.

use super::Resolver;
use super::number::{Range, Whole};
use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::schema;
use crate::recipe::text::Place;
use crate::sensor::Sensor;
use crate::sensor::voltmeter::{Between, Gain, Initial, Law, Preset, Voltmeter};
use crate::units::Hertz;

const SENSORS: &str = "this gs2e has the sensor voltmeter";

/// Of `k1` to `k6`: the gain and the offset of the logarithm are positive, standard deviations are not negative.
const K: [Range; 6] = [
    Range::above(0.0, 1e12),
    Range::above(0.0, 1e12),
    Range::new(0.0, 1e12),
    Range::new(-1e12, 1e12),
    Range::new(-1e12, 1e12),
    Range::new(0.0, 1e12),
];

impl Resolver<'_> {
    pub(super) fn between(&self, field: &Field<schema::Sampling>) -> Option<Between> {
        let absent = schema::Sampling::default();
        let help = "this gs2e renders no rates of change: linear and catmull do without";
        match &self.section(field, &absent)?.between {
            Field::Absent | Field::Given(schema::Between::Linear, _) => Some(Between::Linear),
            Field::Given(schema::Between::Catmull, _) => Some(Between::Catmull),
            Field::Given(schema::Between::Hermite, place) => self.word_later("hermite", *place, help),
            Field::Bad => None,
        }
    }

    pub(super) fn sensor(
        &self,
        field: &Field<schema::Sensor>,
        between: Option<Between>,
        rate: Option<Hertz>,
    ) -> Option<Sensor> {
        let default = Field::Given(Box::default(), self.root);
        let raw = match field {
            Field::Absent => &default,
            Field::Bad => return None,
            Field::Given(schema::Sensor::Voltmeter(raw), _) => raw,
            Field::Given(schema::Sensor::Esim(later) | schema::Sensor::V2e(later), _) => {
                self.later(later, SENSORS);
                return None;
            }
        };
        let (raw, place) = raw.given()?;
        let voltmeter = Voltmeter { between: between?, ..self.voltmeter(raw, place)? };
        self.possible(&voltmeter, rate?, place).then_some(Sensor::Voltmeter(voltmeter))
    }

    /// Whether the sensor makes a stream that can be used (numerics 1.1); if not, that is reported.
    fn possible(&self, voltmeter: &Voltmeter, rate: Hertz, place: Place) -> bool {
        let screened = voltmeter.screen(rate).map_err(|error| {
            let problem = Problem::of_key(format!("is no usable sensor: {error}"));
            self.report(problem.at(place));
        });
        screened.is_ok()
    }

    fn voltmeter(&self, raw: &schema::Voltmeter, place: Place) -> Option<Voltmeter> {
        for later in [&raw.front_end, &raw.hot_pixels, &raw.labels] {
            self.later(later, "this gs2e simulates ideal pixels");
        }
        let k = self.k(raw, place);
        let threshold = self.threshold(&raw.threshold);
        let law = self.sampler(&raw.law);
        let gain = self.or(&raw.gain, schema::Gain::Log);
        let initial = initial(&raw.initial);
        let cap = self.small(&raw.max_events_per_pixel_frame, 1000, Whole::new(1, 1_000_000_000));
        let [threshold_on, threshold_off] = threshold?;
        Some(Voltmeter {
            threshold_on,
            threshold_off,
            law: law?,
            gain: match gain? {
                schema::Gain::Log => Gain::Log,
                schema::Gain::Midpoint => Gain::Midpoint,
            },
            initial: initial?,
            max_events_per_pixel_frame: cap?,
            ..Voltmeter::new(k?)
        })
    }

    fn k(&self, raw: &schema::Voltmeter, place: Place) -> Option<[f64; 6]> {
        match (&raw.preset, &raw.k) {
            (Field::Bad, _) | (_, Field::Bad) => None,
            (Field::Given(_, at), Field::Given(..)) => {
                let problem = Problem::of_key("and k exclude each other");
                self.refuse(problem.help("a preset is a k by name").at(*at))
            }
            (preset, Field::Absent) => {
                if let Some(at) = raw.units.place() {
                    self.report(
                        Problem::of_key("goes with k: a preset has its own units").help("remove it").at(at),
                    );
                }
                self.preset(preset)
            }
            (Field::Absent, Field::Given(k, _)) => {
                let help =
                    "write units: { time: us, brightness: 255 }; time is us, ms or s, brightness 255 or 1";
                let units = self.required(&raw.units, "units", place, help);
                let k: Vec<Option<f64>> =
                    k.iter().zip(K).map(|(k, range)| self.real(k, 0.0, range)).collect();
                Some(units?.0.to_official([k[0]?, k[1]?, k[2]?, k[3]?, k[4]?, k[5]?]))
            }
        }
    }

    fn preset(&self, field: &Field<String>) -> Option<[f64; 6]> {
        let Some((name, place)) = field.given() else { return Some(Preset::Dvs346.k()) };
        let names = Preset::ALL.map(Preset::name);
        Preset::by_name(name)
            .map(Preset::k)
            .or_else(|| self.refuse(Problem::unknown("preset", name, &names).at(place)))
    }

    fn threshold(&self, field: &Field<schema::Threshold>) -> Option<[f64; 2]> {
        let absent = schema::Threshold::default();
        let raw = self.section(field, &absent)?;
        self.later(&raw.spread, "this gs2e simulates equal pixels");
        let [on, off] = [&raw.on, &raw.off].map(|field| self.real(field, 1.0, Range::new(1e-6, 1e6)));
        Some([on?, off?])
    }

    fn sampler(&self, field: &Field<schema::Law>) -> Option<Law> {
        match field {
            Field::Absent | Field::Given(schema::Law::Exact, _) => Some(Law::Exact),
            Field::Given(schema::Law::Official, place) => {
                self.word_later("official", *place, "this gs2e has the law exact")
            }
            Field::Bad => None,
        }
    }
}

fn initial(field: &Field<schema::Initial>) -> Option<Initial> {
    match field {
        Field::Absent | Field::Given(schema::Initial::Zero, _) => Some(Initial::Zero),
        Field::Given(schema::Initial::Stationary, _) => Some(Initial::Stationary),
        Field::Bad => None,
    }
}
