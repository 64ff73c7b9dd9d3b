//! A sound world in which faults are planted: a picture that moves over a sensor without noise, and
//! its events.
//!
//! The sensor is independent: it emits an event where the voltage, linear between frames, crosses a
//! threshold counted from the last event. It shares no code with the simulated sensors.

#![expect(clippy::cast_possible_truncation, reason = "small numbers of a small world")]

use super::coverage::ViewCoverage;
use super::drift::DriftLaw;
use super::motion::warp::{FlowAt, total_px};
use super::sampling::ResampledIntervals;
use super::tally::{StreamObserver, TallyReference};
use super::{Finding, FindingSubject, Limits, TrajectorySubject, Verdict, judge_trajectory};
use glam::{DQuat, DVec3};
use gs2e_event::{Event, EventLabel, Polarity};
use gs2e_image::{Image, Size};
use gs2e_num::se3::Se3;
use gs2e_num::units::{Hertz, Timestamp};
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::frames::anchors::{AnchorChoice, AnchorFrames};
use gs2e_sensor::noise::{FloorPoint, NoiseFloor, PhotoreceptorNoise, ReceptorPoint};
use gs2e_sensor::voltmeter::{InitialVoltage, VoltmeterModel};
use gs2e_sensor::{SensorChoice, SimulationAccount};
use gs2e_source::foreign::{ExternalReport, colmap, opencv, readback};
use gs2e_trajectory::curve::CurveKind;
use gs2e_trajectory::flow::FlowQuantiles;
use gs2e_trajectory::report::{FollowError, SpeedReport};
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::speed::SpeedMeaning;
use gs2e_trajectory::{CourseKind, Trajectory};
use std::f64::consts::TAU;
use std::sync::OnceLock;

#[derive(Clone)]
pub(super) struct PlantedWorld {
    pub(super) trajectory: Trajectory,
    pub(super) report: SpeedReport,
    pub(super) sensor: VoltmeterModel,
    pub(super) account: SimulationAccount,
    pub(super) events: Vec<Event>,
    pub(super) anchors: AnchorFrames,
    pub(super) flows: Vec<FlowAt>,
    /// The sensor given to the passes, if it differs.
    pub(super) stated: Option<SensorChoice>,
    pub(super) resampled: Option<ResampledIntervals>,
    pub(super) flow: Option<FlowQuantiles>,
    pub(super) tolerance: Option<f64>,
    pub(super) coverage: Option<ViewCoverage>,
    pub(super) doubtful_share: Option<f64>,
    pub(super) foreign: ExternalReport,
    pub(super) light_changes: bool,
    pub(super) is_release: bool,
    pub(super) limits: Limits,
}

pub(super) const SIZE: Size = Size { width: 96, height: 72 };
pub(super) const FRAMES: usize = 150;

pub(super) fn frame_rate() -> Hertz {
    Hertz("2400".parse().unwrap())
}

/// Settings of a sound world.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorldSettings {
    /// Image motion, px per frame.
    pub(super) pace: f64,
    pub(super) thresholds: [f64; 2],
    /// Standard deviation of `ln(L)` in the picture.
    pub(super) contrast: f64,
    /// Relative growth of all luminance over the clip.
    pub(super) dawn: f64,
    pub(super) initial: InitialVoltage,
    pub(super) frames: usize,
    /// Standard deviation of the thresholds over the pixels.
    pub(super) spread: f64,
    /// ON and OFF events of the noise floor per pixel and second.
    pub(super) floor_hz: [f64; 2],
    /// Deviation of the photoreceptor's noise, as a contrast; its cutoff is 30 Hz.
    pub(super) receptor: f64,
}

impl Default for WorldSettings {
    fn default() -> Self {
        Self {
            pace: 0.3,
            thresholds: [1.0; 2],
            contrast: 0.6,
            dawn: 0.0,
            initial: InitialVoltage::Zero,
            frames: FRAMES,
            spread: 0.0,
            floor_hz: [0.0; 2],
            receptor: 0.0,
        }
    }
}

impl PlantedWorld {
    pub(super) fn new(setting: WorldSettings) -> Self {
        let stamps_us: Vec<i64> = (0..setting.frames as u64).map(|j| frame_rate().stamp_us(j)).collect();
        let mut sensor = VoltmeterModel::new([5.265, 20.0, 0.0, 1e-7, 0.0, 0.0]);
        [sensor.threshold_on, sensor.threshold_off] = setting.thresholds;
        sensor.initial = setting.initial;
        sensor.threshold_spread = setting.spread;
        if setting.floor_hz.iter().any(|hz| *hz > 0.0) {
            let [on, off] = setting.floor_hz;
            sensor.floor = NoiseFloor(vec![FloorPoint { lux: 1.0, on, off }]);
            sensor.settings.front_end.lux = Some(250.0);
        }
        if setting.receptor > 0.0 {
            let point = ReceptorPoint { lux: 1.0, deviation: setting.receptor, cutoff_hz: 30.0 };
            sensor.photoreceptor_noise = PhotoreceptorNoise { spread: 0.0, points: vec![point] };
        }
        let images: Vec<Image<f32>> = (0..setting.frames).map(|j| wave_picture(setting, j)).collect();
        let events = simulate_events(&sensor, &images, &stamps_us);
        let apart = (1..50).find(|n| setting.pace * *n as f64 >= 1.0).unwrap_or(50);
        let choice = AnchorChoice::from_stamps(&stamps_us, apart);
        let mut anchors = AnchorFrames::without_frames(&choice);
        for j in choice.frames {
            let frame = DenseFrame {
                index: j,
                t: Timestamp::from_micros(stamps_us[j]),
                luminance: images[j].clone(),
                rate: None,
            };
            anchors.keep(&frame, stamps_us[j]);
        }
        let pace = setting.pace as f32;
        // The picture moves towards smaller x.
        let px_s = Image::filled(SIZE, [-pace * frame_rate().to_f64() as f32, 0.0]);
        let moments = (0..5).map(|i| stamps_us[i * (setting.frames - 1) / 4]);
        let flows = moments.map(|t_us| FlowAt { t_us, px_s: px_s.clone() }).collect();
        Self {
            flows,
            stated: None,
            resampled: Some(ResampledIntervals {
                intervals: 4,
                events: 1000,
                at_twice: 1004,
                paired: 990,
                shift_us: Some(3.0),
                tolerance: None,
            }),
            report: speed_report(setting.frames),
            account: count_events(&events),
            trajectory: Trajectory { world_from_camera: arc_poses(setting.frames), stamps_us },
            sensor,
            events,
            anchors,
            flow: Some(FlowQuantiles { median: pace, p95: pace, max: pace }),
            tolerance: None,
            coverage: Some(ViewCoverage { views: 9, empty: 0, least: 0.9, at_us: 0 }),
            doubtful_share: Some(0.001),
            foreign: agreeing_reports(),
            light_changes: false,
            is_release: false,
            limits: Limits::default(),
        }
    }

    /// The world of the default settings, made once.
    pub(super) fn default_world() -> Self {
        static SOUND: OnceLock<PlantedWorld> = OnceLock::new();
        SOUND.get_or_init(|| Self::new(WorldSettings::default())).clone()
    }

    pub(super) fn findings(&self) -> Vec<Finding> {
        let sensor = self.stated.clone().unwrap_or_else(|| SensorChoice::Voltmeter(self.sensor.clone()));
        let end = *self.trajectory.stamps_us.last().unwrap();
        let against = TallyReference {
            observed: Some((DriftLaw::for_sensor(&sensor), &self.anchors)),
            flows: &self.flows,
            dead_us: sensor.dead_us(),
            hot_hz: &[],
            labelled: false,
        };
        let mut observer = StreamObserver::new(SIZE, frame_rate(), end, against);
        for chunk in self.events.chunks(1000) {
            observer.append(chunk);
        }
        let tally = observer.finish();
        let subject = TrajectorySubject {
            speed: Some(&self.report),
            sensor: Some(&sensor),
            account: Some(&self.account),
            tally: Some(&tally),
            resampled: self.resampled.as_ref(),
            flow: self.flow,
            moved_px: self.flow.and_then(|_| total_px(&self.flows, end)),
            tolerance: self.tolerance,
            coverage: self.coverage,
            doubtful_share: self.doubtful_share,
            views: Some(30),
            foreign: Some(&self.foreign),
            light_changes: self.light_changes,
            is_release: self.is_release,
            ..TrajectorySubject::new("world/base", frame_rate(), &self.trajectory, &self.limits)
        };
        judge_trajectory(&subject, &[subject])
    }

    /// `check#statement` of the findings that are neither passed nor not run.
    pub(super) fn faults(&self) -> Vec<String> {
        let unsound = |f: &Finding| !matches!(f.verdict, Verdict::Pass | Verdict::NotRun);
        let name = |f: Finding| match f.subject.text_without("world/base").as_str() {
            "" => f.check,
            statement => format!("{}#{statement}", f.check),
        };
        self.findings().into_iter().filter(unsound).map(name).collect()
    }

    /// The finding `check#statement`.
    pub(super) fn finding(&self, name: &str) -> Finding {
        let (check, statement) = name.split_once('#').unwrap_or((name, ""));
        let found = self.findings();
        let wanted =
            |f: &&Finding| f.check == check && f.subject == FindingSubject::new("world/base", statement);
        found.iter().find(wanted).unwrap_or_else(|| panic!("{name} not in {found:#?}")).clone()
    }
}

/// Plants a fault in a sound world. The passes must find exactly `wanted`.
pub(super) fn check(plant: impl FnOnce(&mut PlantedWorld), wanted: &[&str]) {
    let mut world = PlantedWorld::default_world();
    plant(&mut world);
    assert_eq!(world.faults(), wanted, "{:#?}", world.findings());
}

/// Random numbers (splitmix64) for streams without structure.
pub(super) struct SplitMixDraws(pub(super) u64);

impl SplitMixDraws {
    /// A number from 0 to below `n`, uniformly.
    pub(super) fn below(&mut self, n: u64) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n) as usize
    }

    /// A number between 0 and 1, uniformly.
    pub(super) fn share(&mut self) -> f64 {
        (self.below(1 << 40) as f64 + 0.5) / (1u64 << 40) as f64
    }

    /// A normal deviate, by Box and Muller.
    pub(super) fn normal(&mut self) -> f64 {
        let (radius, angle) = (self.share(), self.share());
        (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * angle).cos()
    }

    /// A column and a row, uniformly.
    pub(super) fn at(&mut self, n: u16) -> u16 {
        u16::try_from(self.below(n.into())).expect("it is below n")
    }
}

/// Waves of four directions and lengths that move along x.
pub(super) fn wave_picture(setting: WorldSettings, frame: usize) -> Image<f32> {
    let shift = setting.pace * frame as f64;
    let light = 100.0 * (1.0 + setting.dawn * frame as f64 / setting.frames as f64);
    let waves = [(0.31, 0.17, 0.0), (0.13, -0.23, 1.0), (0.55, 0.4, 2.0), (0.07, 0.11, 3.0)];
    let along_x = |x: u32| waves.map(|(a, _, c)| (a * (f64::from(x) + shift) + c).sin_cos());
    let along_y = |y: u32| waves.map(|(_, b, _)| (b * f64::from(y)).sin_cos());
    let columns: Vec<_> = (0..SIZE.width).map(along_x).collect();
    let luminance = |xs: [(f64, f64); 4], ys: [(f64, f64); 4]| {
        let sum: f64 = xs.iter().zip(ys).map(|((sx, cx), (sy, cy))| sx * cy + cx * sy).sum();
        // Each wave has a variance of a half.
        (light * (setting.contrast * sum / 2f64.sqrt()).exp()) as f32
    };
    let row = |y| columns.iter().map(move |xs| luminance(*xs, along_y(y)));
    Image::from_vec(SIZE, (0..SIZE.height).flat_map(row).collect())
}

/// Steps of the noise of the photoreceptor from frame to frame.
const NOISE_STEPS: u32 = 26;

fn simulate_events(sensor: &VoltmeterModel, images: &[Image<f32>], stamps_us: &[i64]) -> Vec<Event> {
    let [k1, k2, _, k4, ..] = sensor.k;
    let mut events = Vec::new();
    let mut draws = SplitMixDraws(11);
    let receptor = sensor.photoreceptor_noise.points.first().copied();
    let receptor = receptor.unwrap_or(ReceptorPoint { lux: 1.0, deviation: 0.0, cutoff_hz: 1.0 });
    for i in 0..SIZE.pixels() {
        let [up, down] = [sensor.threshold_on, sensor.threshold_off]
            .map(|nominal| (nominal + sensor.threshold_spread * draws.normal()).max(0.01));
        let volts = |j: usize| {
            k1 * (f64::from(images[j].pixels()[i]) + k2).ln() + k4 * (stamps_us[j] - stamps_us[0]) as f64
        };
        // Noise that returns, in steps.
        let (deviation, returning) = (k1 * receptor.deviation, 1e-6 * TAU * receptor.cutoff_hz);
        let steps = if deviation > 0.0 { NOISE_STEPS } else { 1 };
        let mut noise = if steps > 1 { deviation * draws.normal() } else { 0.0 };
        let mut from = volts(0) + noise;
        // The golden ratio spreads the initial voltages evenly over (-B, A).
        let start = match sensor.initial {
            InitialVoltage::Zero => 0.0,
            InitialVoltage::Stationary => {
                let width = sensor.threshold_on + sensor.threshold_off;
                (i as f64 * 0.618_033_988_749_895).fract() * width - sensor.threshold_off
            }
        };
        let mut level = from - start;
        for j in 1..images.len() {
            let [t0, t1] = [stamps_us[j - 1], stamps_us[j]].map(|t| (1000 * t) as f64);
            let kept = (-returning * 1e-3 * (t1 - t0) / f64::from(steps)).exp();
            let [before, after] = [j - 1, j].map(volts);
            for step in 1..=steps {
                let [begun, done] = [step - 1, step].map(|step| f64::from(step) / f64::from(steps));
                if steps > 1 {
                    noise = kept * noise + deviation * (1.0 - kept * kept).sqrt() * draws.normal();
                }
                let to = before * (1.0 - done) + after * done + noise;
                let times = [begun, done].map(|share| t0 * (1.0 - share) + t1 * share);
                cross_levels(&mut level, [up, down], [from, to], |share, polarity| {
                    let t = times[0] + (times[1] - times[0]) * share;
                    events.push(event_at(i, t.ceil() as i64, polarity));
                });
                from = to;
            }
        }
        let end = (1000 * (stamps_us[images.len() - 1] - stamps_us[0])) as f64;
        let rates = sensor.floor.0.first().map_or([0.0; 2], |point| [point.on, point.off]);
        for (hz, polarity) in rates.into_iter().zip([Polarity::On, Polarity::Off]) {
            // Waiting times of a Poisson process; without a rate, the first is infinite.
            let mut t = -draws.share().ln() / (1e-9 * hz);
            while t < end {
                events.push(event_at(i, t.ceil() as i64, polarity));
                t -= draws.share().ln() / (1e-9 * hz);
            }
        }
    }
    events.sort_by_cached_key(Event::file_order);
    events
}

/// Notes the events of a voltage that goes straight from one value to another, by their shares of the way.
fn cross_levels(
    level: &mut f64,
    [up, down]: [f64; 2],
    [from, to]: [f64; 2],
    mut note: impl FnMut(f64, Polarity),
) {
    loop {
        let (next, polarity) = if to - *level >= up {
            (*level + up, Polarity::On)
        } else if *level - to >= down {
            (*level - down, Polarity::Off)
        } else {
            return;
        };
        *level = next;
        note(((next - from) / (to - from)).clamp(0.0, 1.0), polarity);
    }
}

pub(super) fn event_at(pixel: usize, t_ns: i64, polarity: Polarity) -> Event {
    let (x, y) = (pixel % SIZE.width as usize, pixel / SIZE.width as usize);
    Event { t: Timestamp(t_ns), x: x as u16, y: y as u16, polarity, label: EventLabel::Signal }
}

fn count_events(events: &[Event]) -> SimulationAccount {
    let on = events.iter().filter(|e| e.polarity == Polarity::On).count() as u64;
    let place = |e: &Event| (e.t.floor_micros(), e.y, e.x);
    let together = events.chunk_by(|a, b| place(a) == place(b)).map(|group| group.len() as u64);
    let pairs = together.map(|n| n * (n - 1) / 2).sum();
    SimulationAccount {
        events: events.len() as u64,
        on,
        off: events.len() as u64 - on,
        same_us_same_pixel: pairs,
        ..SimulationAccount::default()
    }
}

/// Reports of other programs that agree with the world, as closely as they do with renderings.
fn agreeing_reports() -> ExternalReport {
    let pose = |k: usize| colmap::PoseAgreement { pose: 7 * k, rotation_deg: 0.05, translation: 0.001 };
    let registration = colmap::ColmapRegistration {
        program: "COLMAP 3.8".into(),
        given: 20,
        path: 0.8,
        poses: (0..20).map(pose).collect(),
    };
    let projection = opencv::ProjectionAgreement { px: 1e-9, pose: Some(3), points: 15_000 };
    let motion = |k: usize| opencv::RelativeMotion {
        from: 7 * k,
        to: 7 * k + 4,
        matches: 300,
        rotation_deg: 0.1,
        direction_deg: 1.0,
    };
    let geometry = opencv::OpencvGeometry {
        program: "OpenCV 5.0.0, numpy 2.4.6".into(),
        poses_txt: projection,
        transforms_json: projection,
        tried: 20,
        pairs: (0..19).map(motion).collect(),
    };
    let stream = readback::StreamRead { events: 1000, differing: Vec::new(), entries: 64, wrong_entries: 0 };
    let readback = readback::ReadbackReport {
        program: "h5py 3.16.0, numpy 2.4.6, OpenCV 5.0.0".into(),
        streams: vec![stream],
        pictures: Ok(readback::PicturesRead { count: 150, differing: Vec::new() }),
    };
    ExternalReport {
        colmap: Some(Ok(registration)),
        opencv: Some(Ok(geometry)),
        readback: Some(Ok(readback)),
    }
}

/// An arc at an even pace, looking at its centre.
fn arc_poses(frames: usize) -> Vec<Se3> {
    let pose = |j: usize| {
        let angle = 0.4 * j as f64 / frames as f64;
        let rotation = DQuat::from_rotation_y(-angle);
        Se3 { rotation, translation: rotation * DVec3::new(0.0, 0.0, -2.0) }
    };
    (0..frames).map(pose).collect()
}

fn speed_report(frames: usize) -> SpeedReport {
    // A step of the arc: its angle, and its chord in scale distances of 2.
    let angle = 0.4 / frames as f64;
    let step = angle + 2.0 * 2.0 * (angle / 2.0).sin() / 2.0;
    let length = step * (frames - 1) as f64;
    let even = Some(FollowError { min: 1.0, max: 1.0, rms: 0.0, p95: 0.0 });
    SpeedReport {
        kind: CourseKind::Refine,
        curve: Some(CurveKind::Cubic),
        keyframes: Vec::new(),
        knot_distance: None,
        knot_jumps: None,
        flow: None,
        degree_drawn: None,
        degree_used: None,
        law: SummationRule::Sum,
        literal: false,
        meaning: SpeedMeaning::Speed,
        alpha: 1.0,
        beta: 1.0,
        scale_distance: 2.0,
        gamma: None,
        rate: "2400/1".into(),
        poses: frames,
        length,
        length_ratio: Some(1.0),
        merged: Vec::new(),
        gaps: Vec::new(),
        u: vec![1.0; frames - 1],
        s: (0..frames).map(|j| step * j as f64).collect(),
        mixed_ratio: even,
        mixed_chord_ratio: even,
        linear_ratio: even,
        angular_ratio: even,
        linear_unit_s: Vec::new(),
        angular_rad_s: Vec::new(),
        max_step_deg: 0.1,
        max_step_change: 0.0,
        warnings: Vec::new(),
    }
}
