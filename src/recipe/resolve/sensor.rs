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

const LAWS: &str = "this gs2e has the law exact";
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
        let help = "this gs2e goes linearly between frames";
        match &self.section(field, &absent)?.between {
            Field::Absent | Field::Given(schema::Between::Linear, _) => Some(Between::Linear),
            Field::Given(schema::Between::Catmull, place) => self.word_later("catmull", *place, help),
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
        let default = schema::Voltmeter::default();
        let (raw, place) = match field {
            Field::Absent => (&default, self.root),
            Field::Bad => return None,
            Field::Given(schema::Sensor::Voltmeter(raw), place) => (raw, *place),
            Field::Given(schema::Sensor::Esim(later) | schema::Sensor::V2e(later), _) => {
                self.later(later, SENSORS);
                return None;
            }
        };
        let voltmeter = Voltmeter { between: between?, ..self.voltmeter(raw, place)? };
        self.screen(&voltmeter, rate?, place)?;
        Some(Sensor::Voltmeter(voltmeter))
    }

    fn voltmeter(&self, raw: &schema::Voltmeter, place: Place) -> Option<Voltmeter> {
        for later in [&raw.front_end, &raw.hot_pixels, &raw.labels] {
            self.later(later, "this gs2e simulates ideal pixels");
        }
        let k = self.k(raw, place);
        let threshold = self.threshold(&raw.threshold);
        let law = self.law(&raw.law);
        let gain = self.or(&raw.gain, schema::Gain::Log);
        let initial = self.initial(&raw.initial);
        let cap = self.whole(&raw.max_events_per_pixel_frame, 1000, Whole::new(1, 1_000_000_000));
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
            max_events_per_pixel_frame: u32::try_from(cap?).expect("within its range"),
            ..Voltmeter::new(k?)
        })
    }

    fn k(&self, raw: &schema::Voltmeter, place: Place) -> Option<[f64; 6]> {
        match (&raw.preset, &raw.k) {
            (Field::Bad, _) | (_, Field::Bad) => None,
            (Field::Given(_, at), Field::Given(..)) => {
                let problem = Problem::of_key("and \"k\" exclude each other");
                self.refuse(problem.help("a preset is a set of k by name").at(*at))
            }
            (_, Field::Absent) => {
                if let Field::Given(_, at) = &raw.units {
                    return self.refuse(Problem::of_key("without \"k\": presets bring their own").at(*at));
                }
                self.preset(&raw.preset)
            }
            (Field::Absent, Field::Given(k, _)) => {
                let help = "units: { time: us, brightness: 255 } says what k is given in; time: us, ms or s, brightness: 255 or 1";
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
        Preset::by_name(name).map(Preset::k).or_else(|| self.unknown("preset", name, &names, place))
    }

    fn threshold(&self, field: &Field<schema::Threshold>) -> Option<[f64; 2]> {
        let absent = schema::Threshold::default();
        let raw = self.section(field, &absent)?;
        self.later(&raw.spread, "this gs2e simulates equal pixels");
        let range = Range::new(1e-6, 1e6);
        let (on, off) = (self.real(&raw.on, 1.0, range), self.real(&raw.off, 1.0, range));
        Some([on?, off?])
    }

    fn law(&self, field: &Field<schema::Law>) -> Option<Law> {
        match field {
            Field::Absent | Field::Given(schema::Law::Exact, _) => Some(Law::Exact),
            Field::Given(schema::Law::Official, place) => self.word_later("official", *place, LAWS),
            Field::Bad => None,
        }
    }

    fn initial(&self, field: &Field<schema::Initial>) -> Option<Initial> {
        match field {
            Field::Absent | Field::Given(schema::Initial::Zero, _) => Some(Initial::Zero),
            Field::Given(schema::Initial::Stationary, place) => {
                self.word_later("stationary", *place, "this gs2e starts all voltages at zero")
            }
            Field::Bad => None,
        }
    }

    /// THE CALL SITE of the refusal of impossible rates (numerics 1.1): above 50 predicted events a pixel a frame.
    fn screen(&self, _sensor: &Voltmeter, _rate: Hertz, _place: Place) -> Option<()> {
        Some(())
    }
}
