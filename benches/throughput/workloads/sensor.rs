//! Simulating one block of frames in memory; the events are counted and dropped.

use super::amount;
use crate::measure::{COST_OF, Workload, timed};
use gs2e_event::{Event, EventSink};
use gs2e_image::{Image, Size};
use gs2e_num::seed::Seed;
use gs2e_num::units::{Hertz, Timestamp};
use gs2e_sensor::bandwidth::{BandwidthPoint, PixelBandwidth};
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::noise::{PhotoreceptorNoise, ReceptorPoint, RefractoryPeriod};
use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use gs2e_sensor::{SensorModel as _, SensorPixels, SensorSettings};
use std::sync::Arc;

const SIZE: Size = Size { width: 640, height: 480 };
const FRAMES: u16 = 50;

/// Events per pixel and second that the brightness alone asks for, and the amplitude of ln(L + k2)
/// that makes them.
const RATES: [f64; 3] = [0.3, 10.0, 1000.0];
const AMPLITUDE: f64 = 0.8;

pub(super) fn workloads() -> Vec<Workload> {
    let mut all = of_paper();
    all.extend(costs());
    all
}

/// The cost of the photoreceptor's noise and of a bandwidth: `davis346` with each of them, and other presets,
/// on the same frames and one core.
fn costs() -> Vec<Workload> {
    let davis = VoltmeterPreset::Davis346.model();
    let noise = |cutoff_hz| {
        let points = vec![ReceptorPoint { lux: 250.0, deviation: 0.02, cutoff_hz }];
        let photoreceptor_noise = PhotoreceptorNoise { spread: 0.35, points };
        VoltmeterModel { photoreceptor_noise, ..davis.clone() }
    };
    let low_pass = |order, points: &[[f64; 2]]| {
        let point = |[lux, cutoff_hz]: &[f64; 2]| BandwidthPoint { lux: *lux, cutoff_hz: *cutoff_hz };
        let bandwidth = PixelBandwidth { order, points: points.iter().map(point).collect() };
        VoltmeterModel { bandwidth, ..davis.clone() }
    };
    let models = [
        ("davis346", davis.clone()),
        ("davis346 with noise of 5 Hz", noise(5.0)),
        ("davis346 with noise of 60 Hz", noise(60.0)),
        ("davis346 with noise of 200 Hz", noise(200.0)),
        ("davis346 with a bandwidth of 200 Hz", low_pass(1, &[[100.0, 200.0]])),
        ("davis346 with a bandwidth of 200 Hz and two stages", low_pass(2, &[[100.0, 200.0]])),
        ("davis346 with a bandwidth of 20 to 200 Hz", low_pass(1, &[[1.0, 20.0], [100.0, 200.0]])),
        ("evk4", VoltmeterPreset::Evk4.model()),
        ("dvxplorer", VoltmeterPreset::Dvxplorer.model()),
    ];
    let mut all = Vec::new();
    for (hertz, count) in [("240", 14), ("1000", FRAMES), ("2400", FRAMES)] {
        let rate = RATES[1];
        let frames: Arc<[DenseFrame]> = frames(rate, &davis, hertz, count).into();
        for (name, model) in &models {
            all.push(workload(&format!("{COST_OF}{name}"), model, rate, &frames, 1));
        }
    }
    all
}

/// The sensor of the published program, with more and with less noise.
fn of_paper() -> Vec<Workload> {
    let noisy = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
    let mut quiet = noisy.clone();
    quiet.k[2..].fill(0.0);
    let refractory = RefractoryPeriod { period_us: 79.0, ..RefractoryPeriod::default() };
    let settings = SensorSettings { refractory, ..noisy.settings };
    let unequal = VoltmeterModel { threshold_spread: 0.0434, settings, ..noisy.clone() };
    let points = vec![ReceptorPoint { lux: 250.0, deviation: 0.02, cutoff_hz: 60.0 }];
    let photoreceptor_noise = PhotoreceptorNoise { spread: 0.35, points };
    let receptor = VoltmeterModel { photoreceptor_noise, ..quiet.clone() };
    let [plain_noise, filtered] = [&noisy, &receptor].map(with_bandwidth);
    let models = [
        ("dvs346 with noise", &noisy),
        ("dvs346 with noise and bandwidth", &plain_noise),
        ("dvs346 with photoreceptor noise", &receptor),
        ("dvs346 with photoreceptor noise and bandwidth", &filtered),
        ("dvs346 without noise", &quiet),
        ("dvs346 with spread and dead time", &unequal),
    ];
    let mut all = Vec::new();
    for rate in RATES {
        let frames: Arc<[DenseFrame]> = frames(rate, &noisy, "2400", FRAMES).into();
        for (name, model) in models {
            all.push(workload(name, model, rate, &frames, 0));
            all.push(workload(name, model, rate, &frames, 1));
            if rate <= RATES[0] {
                all.push(plain_loop(&frames));
            }
        }
    }
    all
}

/// A sensor whose pixels are slower in the dark.
fn with_bandwidth(model: &VoltmeterModel) -> VoltmeterModel {
    let point = |lux, cutoff_hz| BandwidthPoint { lux, cutoff_hz };
    let mut filtered = model.clone();
    filtered.bandwidth = PixelBandwidth { order: 1, points: vec![point(1.0, 20.0), point(100.0, 200.0)] };
    filtered.settings.front_end.lux = Some(250.0);
    filtered
}

/// One pass per frame over the arrays that the sensor reads and writes, on one core: the frame and its copy,
/// the frame before, the seat, and the voltage, drift and variance of each pixel. It shows what the memory
/// allows.
fn plain_loop(frames: &Arc<[DenseFrame]>) -> Workload {
    let frames = Arc::clone(frames);
    let steps = frames.len() - 2;
    let n = SIZE.pixels();
    let what = format!("a plain loop over the same arrays, {SIZE}, {steps} steps, one core");
    let run = move || {
        let seats: Vec<u32> = (0..).take(n).collect();
        let (mut copy, mut state) = (vec![0.0_f32; n], vec![[0.0_f64; 3]; n]);
        timed(|| {
            for pair in frames[1..].windows(2) {
                let [before, after] = [0, 1].map(|i| pair[i].luminance.pixels());
                let arrays = before.iter().zip(after).zip(&seats).zip(&mut copy).zip(&mut state);
                for ((((before, after), seat), copy), [voltage, drift, variance]) in arrays {
                    let change = f64::from(*after) - f64::from(*before);
                    *copy = *after;
                    *voltage += change;
                    *drift += change;
                    *variance += f64::from(*seat);
                }
            }
            std::hint::black_box((&copy, &state));
            vec![amount(steps * n, "Mpixel-frame")]
        })
    };
    Workload { part: "sensor", what, rival: true, run: Box::new(run) }
}

/// A workload on `threads` threads; 0 for one per core.
fn workload(
    name: &str,
    model: &VoltmeterModel,
    rate: f64,
    frames: &Arc<[DenseFrame]>,
    threads: usize,
) -> Workload {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
    let cores = if threads == 1 { "one core" } else { "all cores" };
    let (model, frames) = (model.clone(), Arc::clone(frames));
    let steps = frames.len() - 2;
    let seconds = frames[1 + steps].t.seconds() - frames[1].t.seconds();
    let per_second = steps as f64 / seconds;
    let what = format!(
        "voltmeter {name}, {SIZE}, {steps} steps at {per_second:.0}/s, {seconds:.3} s, {rate} ev/px/s asked, {cores}"
    );
    let simulate = move || {
        let mut pixels = model.start(SIZE, [0, 0], Seed(1)).expect("the preset is valid");
        let mut settled = EventCounter(0);
        advance(&mut *pixels, &frames[..2], &mut settled);
        timed(|| {
            let mut events = EventCounter(0);
            advance(&mut *pixels, &frames[2..], &mut events);
            vec![amount(steps * SIZE.pixels(), "Mpixel-frame"), amount(events.0, "Mevent")]
        })
    };
    let run = move || pool.install(&simulate);
    Workload { part: "sensor", what, rival: false, run: Box::new(run) }
}

fn advance(pixels: &mut dyn SensorPixels, frames: &[DenseFrame], sink: &mut EventCounter) {
    frames.iter().for_each(|frame| pixels.advance(frame, sink).expect("the rate is far below the cap"));
}

/// Counts events and drops them.
struct EventCounter(usize);

impl EventSink for EventCounter {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.0 += events.len();
        Ok(())
    }
}

/// Frames in which ln(L + k2) of every pixel is a triangle wave about ln(80 + k2), each pixel at a
/// phase of its own. The first frame is lower by a share of one event that differs between pixels,
/// so that the pixels fire at different times from the second frame on, and not together after 1 /
/// rate.
#[expect(clippy::cast_possible_truncation, reason = "frames are f32")]
fn frames(rate: f64, model: &VoltmeterModel, hertz: &str, count: u16) -> Vec<DenseFrame> {
    let [k1, k2, ..] = model.k;
    // A triangle wave travels four amplitudes per period; an event takes a threshold of 1 of k1
    // ln(L + k2).
    let period = 4.0 * AMPLITUDE * k1 / rate;
    let hertz = Hertz(hertz.parse().expect("it is a ratio"));
    let centre = libm::log(80.0 + k2);
    // Multiples of two irrational numbers spread over [0, 1) evenly, and not together.
    let spread = |pixel: usize, irrational: f64| (pixel as f64 * irrational).fract();
    let frame = |index: u16| {
        let t = Timestamp::from_micros(hertz.stamp_us(u64::from(index)));
        let level = |pixel: usize| {
            let phase = (spread(pixel, std::f64::consts::SQRT_2) + t.seconds() / period).fract();
            let wave = AMPLITUDE * (4.0 * (phase - 0.5).abs() - 1.0);
            let below = if index == 0 { (2.0 * spread(pixel, std::f64::consts::E) - 1.0) / k1 } else { 0.0 };
            (libm::exp(centre + wave - below) - k2) as f32
        };
        let luminance = Image::from_vec(SIZE, (0..SIZE.pixels()).map(level).collect());
        DenseFrame { index: usize::from(index), t, luminance, rate: None }
    };
    (0..count).map(frame).collect()
}
