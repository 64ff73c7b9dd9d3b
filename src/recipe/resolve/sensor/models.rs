//! The sensors `esim` and `v2e`, and the parts that sensors share.

use super::super::Resolver;
use super::super::number::{Range, Whole};
use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::schema;
use crate::recipe::text::Place;
use crate::sensor::esim::Esim;
use crate::sensor::noise::{HotPixels, Refractory, Threshold};
use crate::sensor::v2e::{Leak, Preset, V2e};
use crate::sensor::voltmeter::Between;

/// Range of the thresholds.
pub(super) const THRESHOLD: Range = Range::new(1e-6, 1e6);
/// Range of the spreads of thresholds.
const SPREAD: Range = Range::new(0.0, 1e6);
/// Range of the event rates, Hz.
const RATE: Range = Range::new(0.0, 1e9);

impl Resolver<'_> {
    pub(super) fn esim(&self, raw: &schema::Esim) -> Option<Esim> {
        let usual = Esim::default();
        let threshold = self.threshold_of(&raw.threshold, usual.threshold);
        let mismatch = self.or(&raw.mismatch, usual.mismatch);
        let intensity = self.or(&raw.intensity, usual.intensity);
        let eps = self.real(&raw.eps, usual.eps, Range::above(0.0, 1e6));
        let refractory = self.refractory(&raw.refractory, usual.refractory);
        let hot_pixels = self.hot_pixels(&raw.hot_pixels);
        let cap = self.cap(&raw.max_events_per_pixel_frame);
        let allow_cap = self.or(&raw.allow_cap, false);
        let (front_end, labels) = (self.front_end(&raw.front_end), self.or(&raw.labels, false));
        Some(Esim {
            threshold: threshold?,
            mismatch: mismatch?,
            intensity: intensity?,
            eps: eps?,
            refractory: refractory?,
            hot_pixels: hot_pixels?,
            max_events_per_pixel_frame: cap?,
            allow_cap: allow_cap?,
            front_end: front_end?,
            labels: labels?,
        })
    }

    pub(super) fn v2e(&self, raw: &schema::V2e) -> Option<V2e> {
        let usual = V2e::from(self.v2e_preset(&raw.preset)?);
        let threshold = self.threshold_of(&raw.threshold, usual.threshold);
        let cutoff = self.real(&raw.cutoff, usual.cutoff, Range::new(0.0, 1e9));
        let filter = self.or(&raw.filter, usual.filter);
        let leak = self.leak(&raw.leak, usual.leak);
        let shot = self.real(&raw.shot, usual.shot, RATE);
        let refractory = self.refractory(&raw.refractory, usual.refractory);
        let hot_pixels = self.hot_pixels(&raw.hot_pixels);
        let cap = self.cap(&raw.max_events_per_pixel_frame);
        let allow_cap = self.or(&raw.allow_cap, false);
        let (front_end, labels) = (self.front_end(&raw.front_end), self.or(&raw.labels, false));
        Some(V2e {
            threshold: threshold?,
            cutoff: cutoff?,
            filter: filter?,
            leak: leak?,
            shot: shot?,
            refractory: refractory?,
            hot_pixels: hot_pixels?,
            max_events_per_pixel_frame: cap?,
            allow_cap: allow_cap?,
            front_end: front_end?,
            labels: labels?,
        })
    }

    /// Refuses interpolations other than the linear one. Frame-by-frame laws know no other course
    /// between two frames.
    pub(super) fn only_linear(&self, between: Option<Between>, what: &str, place: Place) -> Option<()> {
        if between? == Between::Linear {
            return Some(());
        }
        let problem = Problem::of_key(format!("has {what}, which goes linearly between frames"));
        self.refuse(problem.help("write sampling: { between: linear }").at(place))
    }

    fn v2e_preset(&self, field: &Field<String>) -> Option<Preset> {
        let Some((name, place)) = field.given() else { return field.is_absent().then_some(Preset::Clean) };
        let names = Preset::ALL.map(Preset::name);
        Preset::by_name(name).or_else(|| self.refuse(Problem::unknown_name("preset", name, &names).at(place)))
    }

    fn threshold_of(&self, field: &Field<schema::Threshold>, usual: Threshold) -> Option<Threshold> {
        let absent = schema::Threshold::default();
        let raw = self.section(field, &absent)?;
        let on = self.real(&raw.on, usual.on, THRESHOLD);
        let off = self.real(&raw.off, usual.off, THRESHOLD);
        Some(Threshold { spread: self.threshold_spread(&raw.spread, usual.spread)?, on: on?, off: off? })
    }

    pub(super) fn threshold_spread(&self, field: &Field<f64>, usual: f64) -> Option<f64> {
        self.real(field, usual, SPREAD)
    }

    fn leak(&self, field: &Field<schema::Leak>, usual: Leak) -> Option<Leak> {
        let absent = schema::Leak::default();
        let raw = self.section(field, &absent)?;
        let rate = self.real(&raw.rate, usual.rate, RATE);
        let jitter = self.real(&raw.jitter, usual.jitter, Range::new(0.0, 10.0));
        let cov = self.real(&raw.cov, usual.cov, Range::new(0.0, 3.0));
        Some(Leak { rate: rate?, jitter: jitter?, cov: cov? })
    }

    fn refractory(&self, field: &Field<schema::Refractory>, usual: Refractory) -> Option<Refractory> {
        let absent = schema::Refractory::default();
        let raw = self.section(field, &absent)?;
        let period_us = self.real(&raw.period_us, usual.period_us, Range::new(0.0, 1e9));
        let reference = self.or(&raw.reference, usual.reference);
        Some(Refractory { period_us: period_us?, reference: reference? })
    }

    pub(super) fn hot_pixels(&self, field: &Field<schema::HotPixels>) -> Option<HotPixels> {
        let Some((raw, place)) = field.given() else {
            return field.is_absent().then_some(HotPixels::default());
        };
        let share = self.required(&raw.share, "share", place, "write share: 0.001, of all pixels");
        let rate = self.required(&raw.rate, "rate", place, "write rate: 10, events per second");
        share.and(rate)?;
        let share = self.real(&raw.share, 0.0, Range::new(0.0, 1.0));
        let rate = self.real(&raw.rate, 0.0, RATE);
        Some(HotPixels { share: share?, rate: rate? })
    }

    pub(super) fn cap(&self, field: &Field<u64>) -> Option<u32> {
        self.small(field, 1000, Whole::new(1, 1_000_000_000))
    }
}
