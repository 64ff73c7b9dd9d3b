//! The sensors `esim` and `v2e`, and the parts that sensors share.

use super::super::number::{RealRange, WholeRange};
use super::super::{Resolver, all};
use crate::drawn::RANDOMISED;
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::schema;
use crate::text::TextSpan;
use gs2e_sensor::SensorSettings;
use gs2e_sensor::bandwidth;
use gs2e_sensor::bandwidth::{BandwidthPoint, PixelBandwidth};
use gs2e_sensor::esim::{EsimModel, TRAINABLE};
use gs2e_sensor::latency;
use gs2e_sensor::latency::PixelLatency;
use gs2e_sensor::noise::{
    FloorPoint, HotPixelNoise, NoiseFloor, PhotoreceptorNoise, ReceptorPoint, RefractoryPeriod,
    ThresholdMismatch, photoreceptor,
};
use gs2e_sensor::readout::ReadoutBus;
use gs2e_sensor::v2e::{LeakNoise, V2eModel, V2ePreset};
use gs2e_sensor::voltmeter::BetweenFrames;

/// Range of the thresholds.
const THRESHOLD: RealRange = RealRange::new(1e-6, 1e6);
/// Range of the spreads of thresholds.
const SPREAD: RealRange = RealRange::new(0.0, 1e6);
/// Range of the delays of events, us.
const DELAY: RealRange = RealRange::new(0.0, 1e6);
/// Range of the event rates, Hz.
const RATE: RealRange = RealRange::new(0.0, 1e9);

/// The settings that the sections of all sensors have. `in_lux` is true if the sensor depends on the light of
/// white by more than its latency.
macro_rules! settings {
    ($resolver:ident, $raw:ident, $default:expr, in_lux: $in_lux:expr) => {{
        let latency = $resolver.latency(&$raw.latency);
        let follows_light = latency.flatten().is_some_and(|latency| latency.tau_us > 0.0);
        resolved!(SensorSettings {
            refractory: $resolver.refractory(&$raw.refractory, $default.refractory),
            hot_pixels: $resolver.hot_pixels(&$raw.hot_pixels, $default.hot_pixels),
            max_events_per_pixel_frame: $resolver
                .cap(&$raw.max_events_per_pixel_frame, $default.max_events_per_pixel_frame),
            allow_cap: $raw.allow_cap.or($default.allow_cap),
            front_end: $resolver.front_end(&$raw.front_end, $in_lux || follows_light),
            labels: $raw.labels.or($default.labels),
            readout: $resolver.readout(&$raw.readout),
            latency,
        })
    }};
}
pub(super) use settings;

impl Resolver<'_> {
    pub(super) fn esim(&self, raw: &schema::EsimSection) -> Option<EsimModel> {
        let preset = match raw.preset.given() {
            Some((name, _)) if name == TRAINABLE => Some(EsimModel::trainable()),
            Some((name, place)) => {
                // The preset of ranges was replaced by them before.
                let names = [TRAINABLE, RANDOMISED];
                self.refuse(FieldProblem::unknown_name("preset", name, &names).at(place))
            }
            None => raw.preset.is_absent().then(EsimModel::default),
        };
        let default = preset.clone().unwrap_or_default();
        let model = resolved!(EsimModel {
            threshold: self.threshold_of(&raw.threshold, default.threshold),
            mismatch: raw.mismatch.or(default.mismatch),
            intensity: raw.intensity.or(default.intensity),
            eps: self.real(&raw.eps, default.eps, RealRange::above(0.0, 1e6)),
            settings: settings!(self, raw, default.settings, in_lux: false),
        });
        preset.and(model)
    }

    pub(super) fn v2e(&self, raw: &schema::V2eSection) -> Option<V2eModel> {
        let default = V2eModel::from(self.v2e_preset(&raw.preset)?);
        resolved!(V2eModel {
            threshold: self.threshold_of(&raw.threshold, default.threshold),
            cutoff: self.real(&raw.cutoff, default.cutoff, RATE),
            filter: raw.filter.or(default.filter),
            leak: self.leak(&raw.leak, default.leak),
            shot: self.real(&raw.shot, default.shot, RATE),
            settings: settings!(self, raw, default.settings, in_lux: false),
        })
    }

    /// Refuses interpolations other than the linear one. Frame-by-frame laws know no other course
    /// between two frames.
    pub(super) fn only_linear(
        &self,
        between: Option<BetweenFrames>,
        what: &str,
        place: TextSpan,
    ) -> Option<()> {
        if between? == BetweenFrames::Linear {
            return Some(());
        }
        let problem = FieldProblem::of_key(format!("has {what}, which interpolates linearly between frames"));
        self.refuse(problem.help("write sampling: { between: linear }").at(place))
    }

    fn v2e_preset(&self, field: &Field<String>) -> Option<V2ePreset> {
        let Some((name, place)) = field.given() else { return field.is_absent().then_some(V2ePreset::Clean) };
        let [clean, noisy] = V2ePreset::ALL.map(V2ePreset::name);
        // The preset of ranges was replaced by them before.
        let names = [clean, noisy, RANDOMISED];
        V2ePreset::by_name(name)
            .or_else(|| self.refuse(FieldProblem::unknown_name("preset", name, &names).at(place)))
    }

    pub(super) fn threshold_of(
        &self,
        field: &Field<schema::ThresholdSection>,
        default: ThresholdMismatch,
    ) -> Option<ThresholdMismatch> {
        let raw = field.or_default()?;
        resolved!(ThresholdMismatch {
            on: self.real(&raw.on, default.on, THRESHOLD),
            off: self.real(&raw.off, default.off, THRESHOLD),
            spread: self.real(&raw.spread, default.spread, SPREAD),
        })
    }

    fn leak(&self, field: &Field<schema::LeakSection>, default: LeakNoise) -> Option<LeakNoise> {
        let raw = field.or_default()?;
        resolved!(LeakNoise {
            rate: self.real(&raw.rate, default.rate, RATE),
            jitter: self.real(&raw.jitter, default.jitter, RealRange::new(0.0, 10.0)),
            cov: self.real(&raw.cov, default.cov, RealRange::new(0.0, 3.0)),
        })
    }

    pub(super) fn refractory(
        &self,
        field: &Field<schema::RefractorySection>,
        default: RefractoryPeriod,
    ) -> Option<RefractoryPeriod> {
        let raw = field.or_default()?;
        resolved!(RefractoryPeriod {
            period_us: self.real(&raw.period_us, default.period_us, RealRange::new(0.0, 1e9)),
            reference: raw.reference.or(default.reference),
        })
    }

    /// Resolves the points of a noise floor. They rise, or the sensor is refused.
    pub(super) fn floor(
        &self,
        field: &Field<Vec<Field<schema::FloorPointSection>>>,
        default: NoiseFloor,
    ) -> Option<NoiseFloor> {
        let Some((points, place)) = field.given() else { return field.is_absent().then_some(default) };
        let point = |field: &Field<schema::FloorPointSection>| {
            let (raw, place) = field.given()?;
            self.required(&raw.lux, "lux", place, "write lux: 10, the light on the sensor")?;
            resolved!(FloorPoint {
                lux: self.real(&raw.lux, 1.0, RealRange::above(0.0, 1e9)),
                on: self.real(&raw.on, 0.0, RATE),
                off: self.real(&raw.off, 0.0, RATE),
            })
        };
        let points: Vec<FloorPoint> = all(points, point)?;
        self.rising(&points, |point| point.lux, place).map(|()| NoiseFloor(points))
    }

    /// Checks that the lights of points rise.
    fn rising<P>(&self, points: &[P], lux: impl Fn(&P) -> f64, place: TextSpan) -> Option<()> {
        if points.is_sorted_by(|before, after| lux(before) < lux(after)) {
            return Some(());
        }
        let found = FieldProblem::of_field("has lights that do not rise from point to point");
        self.refuse(found.help("order the points by lux, each light once").at(place))
    }

    /// Resolves the noise of the photoreceptor.
    pub(super) fn photoreceptor_noise(
        &self,
        field: &Field<schema::PhotoreceptorNoiseSection>,
        default: &PhotoreceptorNoise,
    ) -> Option<PhotoreceptorNoise> {
        let raw = field.or_default()?;
        resolved!(PhotoreceptorNoise {
            spread: self.real(&raw.spread, default.spread, RealRange::new(0.0, photoreceptor::MAX_SPREAD)),
            points: self.receptor_points(&raw.points, &default.points),
        })
    }

    fn receptor_points(
        &self,
        field: &Field<Vec<Field<schema::ReceptorPointSection>>>,
        default: &[ReceptorPoint],
    ) -> Option<Vec<ReceptorPoint>> {
        let Some((points, place)) = field.given() else { return field.is_absent().then(|| default.to_vec()) };
        let point = |field: &Field<schema::ReceptorPointSection>| {
            let (raw, place) = field.given()?;
            let lux = self.required(&raw.lux, "lux", place, "write lux: 100, the light on the sensor");
            let deviation =
                self.required(&raw.deviation, "deviation", place, "write deviation: 0.02, a contrast");
            let cutoff = self.required(&raw.cutoff_hz, "cutoff_hz", place, "write cutoff_hz: 200, in Hz");
            // An absent key was reported, and the defaults below are not for use.
            lux.and(deviation).and(cutoff)?;
            resolved!(ReceptorPoint {
                lux: self.real(&raw.lux, 1.0, RealRange::above(0.0, 1e9)),
                deviation: self.real(&raw.deviation, 0.0, RealRange::new(0.0, 10.0)),
                cutoff_hz: self.real(
                    &raw.cutoff_hz,
                    1.0,
                    RealRange::above(0.0, photoreceptor::MAX_CUTOFF_HZ)
                ),
            })
        };
        let points: Vec<ReceptorPoint> = all(points, point)?;
        self.rising(&points, |point| point.lux, place).map(|()| points)
    }

    /// Resolves the bandwidth of the pixels.
    pub(super) fn bandwidth(
        &self,
        field: &Field<schema::BandwidthSection>,
        default: &PixelBandwidth,
    ) -> Option<PixelBandwidth> {
        let raw = field.or_default()?;
        resolved!(PixelBandwidth {
            order: self.small(&raw.order, default.order, WholeRange::new(1, bandwidth::MAX_ORDER.into())),
            points: self.bandwidth_points(&raw.points, &default.points),
        })
    }

    fn bandwidth_points(
        &self,
        field: &Field<Vec<Field<schema::BandwidthPointSection>>>,
        default: &[BandwidthPoint],
    ) -> Option<Vec<BandwidthPoint>> {
        let Some((points, place)) = field.given() else { return field.is_absent().then(|| default.to_vec()) };
        let point = |field: &Field<schema::BandwidthPointSection>| {
            let (raw, place) = field.given()?;
            let lux = self.required(&raw.lux, "lux", place, "write lux: 100, the light on the sensor");
            let cutoff = self.required(&raw.cutoff_hz, "cutoff_hz", place, "write cutoff_hz: 200, in Hz");
            // An absent key was reported, and the defaults below are not for use.
            lux.and(cutoff)?;
            resolved!(BandwidthPoint {
                lux: self.real(&raw.lux, 1.0, RealRange::above(0.0, 1e9)),
                cutoff_hz: self.real(&raw.cutoff_hz, 1.0, RealRange::above(0.0, bandwidth::MAX_CUTOFF_HZ)),
            })
        };
        let points: Vec<BandwidthPoint> = all(points, point)?;
        self.rising(&points, |point| point.lux, place).map(|()| points)
    }

    pub(super) fn hot_pixels(
        &self,
        field: &Field<schema::HotPixelsSection>,
        default: HotPixelNoise,
    ) -> Option<HotPixelNoise> {
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(default) };
        let share = self.required(&raw.share, "share", place, "write share: 0.001, of all pixels");
        let rate = self.required(&raw.rate, "rate", place, "write rate: 10, events per second");
        // An absent key was reported, and the defaults below are not for use.
        share.and(rate)?;
        resolved!(HotPixelNoise {
            share: self.real(&raw.share, 0.0, RealRange::new(0.0, 1.0)),
            rate: self.real(&raw.rate, 0.0, RATE),
            spread: self.real(&raw.spread, 0.0, RealRange::new(0.0, 3.0)),
        })
    }

    pub(super) fn latency(&self, field: &Field<schema::LatencySection>) -> Option<Option<PixelLatency>> {
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
        let us = self.required(&raw.us, "us", place, "write us: 100, in microseconds");
        resolved!(PixelLatency {
            jitter_us: self.real(&raw.jitter_us, 0.0, DELAY),
            tau_us: self.real(&raw.tau_us, 0.0, DELAY),
            max_us: self.real(&raw.max_us, latency::MAX_US, RealRange::above(0.0, 1e6)),
            us: us.and_then(|(_, at)| {
                let (us, max) = (self.real(&raw.us, 0.0, DELAY)?, max_us?);
                let found =
                    || FieldProblem::of_field(format!("is {us}, above the largest delay of {max} us"));
                if us > max { self.refuse(found().help("write a larger max_us").at(at)) } else { Some(us) }
            }),
        })
        .map(Some)
    }

    pub(super) fn readout(&self, field: &Field<schema::ReadoutSection>) -> Option<Option<ReadoutBus>> {
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
        let help = "write rate_mev_s: 12, in millions of events per second";
        let rate = self.required(&raw.rate_mev_s, "rate_mev_s", place, help);
        resolved!(ReadoutBus {
            rate_mev_s: rate.and_then(|_| self.real(&raw.rate_mev_s, 0.0, RealRange::new(1e-6, 1e6))),
            arbiter: raw.arbiter.or_default(),
            queue: raw.queue.optional(|queue| self.whole(queue, 0, WholeRange::new(0, 1_000_000_000_000))),
        })
        .map(Some)
    }

    pub(super) fn cap(&self, field: &Field<u64>, default: u32) -> Option<u32> {
        self.small(field, default, WholeRange::new(1, 1_000_000_000))
    }
}
