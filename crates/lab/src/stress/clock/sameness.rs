//! One signal gives one stream, for any sampling, cropping and scheduling.

use super::FIRST;
use crate::stress::clips::{by_pixel, make_clip, run_sensor};
use crate::stress::{CaseResult, StressArea, StressCase, StressPoint, WorstPoint};
use gs2e_event::Event;
use gs2e_image::{Image, Size};
use gs2e_num::seed::Seed;
use gs2e_sensor::SensorModel as _;
use gs2e_sensor::frames::FrameSequence as _;
use gs2e_sensor::frames::array::ArrayFrames;
use gs2e_sensor::voltmeter::{SamplerKind, VoltmeterModel};

const SIZE: Size = Size { width: 24, height: 10 };
/// Origins of a crop of the sensor.
const CORNER: [u16; 2] = [600, 400];

pub(super) fn sameness_cases<'a>() -> Vec<StressCase<'a>> {
    let case = |words, run: fn() -> CaseResult| StressCase::new(StressArea::Clock, words, run);
    vec![
        case(["frame-rates", "one signal at 10, 37.3, 240, 2400 fps and irregularly", "ns"], frame_rates),
        case(["threads", "1, 2, 3, 64", "events"], threads_case),
        case(["crops", "tiles of 1x1 to the whole, and parts", "events"], crops_case),
    ]
}

/// Enough noise that every pixel fires occasionally, static or not.
fn noisy_sensor() -> VoltmeterModel {
    VoltmeterModel::new([5.0, 16.0, 2e-2, 1e-5, 1e-7, 4e-3])
}

/// With noise, without noise, and by the published law.
fn compared_sensors() -> [(&'static str, VoltmeterModel); 3] {
    let [k1, k2, _, k4, k5, _] = noisy_sensor().k;
    let official = VoltmeterModel { law: SamplerKind::Official, ..noisy_sensor() };
    [
        ("exact", noisy_sensor()),
        ("no noise", VoltmeterModel::new([k1, k2, 0.0, k4, k5, 0.0])),
        ("official", official),
    ]
}

/// Events that differ, in either stream.
fn differing_events(a: &[Event], b: &[Event]) -> usize {
    a.iter().zip(b).filter(|(a, b)| a != b).count() + a.len().abs_diff(b.len())
}

/// Adds a comparison of two streams for equality.
fn add_same(worst: &mut WorstPoint, found: &[Event], wanted: &[Event], at: impl FnOnce() -> String) {
    worst.see_same(differing_events(found, wanted), wanted.len(), at);
}

/// Adds a comparison of the events of each pixel, and of their times.
fn add_near(worst: &mut WorstPoint, found: &[Event], wanted: &[Event], what: &str) {
    let pairs = by_pixel(SIZE, found).into_iter().zip(by_pixel(SIZE, wanted));
    let (mut others, mut furthest) = (0, 0);
    for (found, wanted) in pairs {
        others += found.len().abs_diff(wanted.len());
        for (a, b) in found.into_iter().zip(wanted) {
            others += usize::from(a.1 != b.1);
            furthest = furthest.max((a.0 - b.0).abs());
        }
    }
    worst.see_same(others, wanted.len(), || format!("{what}: other events"));
    // One nanosecond is the rounding of times.
    worst.see(StressPoint::absolute_error(furthest as f64, 0.0, 1.0), || format!("{what}: times"));
}

/// Stamps of a clip that ends at `end_us`, at this frame rate as far as it divides.
#[expect(clippy::cast_possible_truncation, reason = "short clips")]
fn clip_stamps(rate: f64, end_us: i64) -> Vec<i64> {
    let regular = (0..).map(|i| (f64::from(i) * 1e6 / rate).round() as i64);
    regular.take_while(|&t| t < end_us).chain([end_us]).collect()
}

/// Constant light, and light whose `L + 16` passes through four octaves, which frames at each
/// octave represent exactly.
fn frame_rates() -> CaseResult {
    let mut worst = WorstPoint::default();
    let at_rest = |stamps: &[i64]| {
        run_sensor(&noisy_sensor(), &make_clip(SIZE, stamps, |x, y, _| f64::from(x * 10 + y)), 5).0
    };
    let coarse = at_rest(&clip_stamps(10.0, 300_000));
    for rate in [37.3, 240.0, 2400.0] {
        add_near(&mut worst, &at_rest(&clip_stamps(rate, 300_000)), &coarse, &format!("at rest, {rate} fps"));
    }
    let irregular = [0, 1, 700, 701, 50_000, 123_456, 299_999, 300_000];
    add_near(&mut worst, &at_rest(&irregular), &coarse, "at rest, irregular");
    let octaves = |t: i64| 16.0 * (1_i64 << (t / 20_000)) as f64 - 16.0;
    let rising =
        |stamps: &[i64]| run_sensor(&noisy_sensor(), &make_clip(SIZE, stamps, |_, _, t| octaves(t)), 6).0;
    let coarse = rising(&[0, 80_000]);
    for cut in [&[0, 20_000, 40_000, 60_000, 80_000][..], &[0, 60_000, 80_000], &[0, 20_000, 80_000]] {
        add_near(&mut worst, &rising(cut), &coarse, &format!("rising, cut at {cut:?}"));
    }
    worst.found()
}

/// A moving clip with dark, bright and static parts.
fn moving_clip(size: Size, first_us: i64) -> ArrayFrames {
    let stamps: Vec<i64> = clip_stamps(2400.0, 12_000).into_iter().map(|t| first_us + t).collect();
    make_clip(size, &stamps, |x, y, t| {
        let phase = f64::from(x) * 0.4 + f64::from(y) * 0.2 - (t - first_us) as f64 * 5e-4;
        if x < 4 { f64::from(y) } else { 120.0 + 120.0 * libm::sin(phase) }
    })
}

pub(super) fn origins_case() -> CaseResult {
    let mut worst = WorstPoint::default();
    for (name, sensor) in compared_sensors() {
        let wanted = run_sensor(&sensor, &moving_clip(SIZE, 0), 1).0;
        for first in FIRST {
            let found = run_sensor(&sensor, &moving_clip(SIZE, first), 1).0;
            add_same(&mut worst, &found, &wanted, || format!("{name}, first stamp {first} us"));
        }
    }
    worst.found()
}

fn threads_case() -> CaseResult {
    let mut worst = WorstPoint::default();
    // Several bands of rows.
    let clip = moving_clip(Size { width: 96, height: 90 }, 0);
    for (name, sensor) in compared_sensors() {
        let by = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads can be started").install(|| run_sensor(&sensor, &clip, 3).0)
        };
        let one = by(1);
        for threads in [2, 3, 64] {
            add_same(&mut worst, &by(threads), &one, || format!("{name}, {threads} threads"));
        }
    }
    worst.found()
}

/// Events of the part of the clip that begins at a place, in the coordinates of the part.
fn of_crop(sensor: &VoltmeterModel, clip: &ArrayFrames, [left, top]: [u16; 2], size: Size) -> Vec<Event> {
    // Draws belong to places on the sensor, so a part begins at its own place.
    let origin = [CORNER[0] + left, CORNER[1] + top];
    let mut pixels = sensor.start(size, origin, Seed(4)).expect("a sound sensor");
    let (mut clip, mut events) = (clip.clone(), Vec::new());
    while let Some(mut frame) = clip.next().expect("a clip in memory") {
        let row = |y: u32| {
            let from = ((u32::from(top) + y) * SIZE.width + u32::from(left)) as usize;
            frame.luminance.pixels()[from..from + size.width as usize].to_vec()
        };
        frame.luminance = Image::from_vec(size, (0..size.height).flat_map(row).collect());
        pixels.advance(&frame, &mut events).expect("a sound frame");
    }
    pixels.finish(&mut events).expect("events in memory");
    events
}

fn crops_case() -> CaseResult {
    let mut worst = WorstPoint::default();
    let clip = moving_clip(SIZE, 0);
    for (name, sensor) in compared_sensors() {
        let whole = of_crop(&sensor, &clip, [0, 0], SIZE);
        for [left, top, width, height] in
            [[0, 0, 24, 10], [3, 2, 7, 5], [23, 9, 1, 1], [0, 4, 24, 1], [5, 0, 1, 10]]
        {
            let size = Size { width: width.into(), height: height.into() };
            let inside =
                |e: &&Event| (left..left + width).contains(&e.x) && (top..top + height).contains(&e.y);
            let crop = whole.iter().filter(inside).map(|e| Event { x: e.x - left, y: e.y - top, ..*e });
            let wanted: Vec<Event> = crop.collect();
            let found = of_crop(&sensor, &clip, [left, top], size);
            add_same(&mut worst, &found, &wanted, || format!("{name}, {size} at ({left}, {top})"));
        }
    }
    // Every pixel by itself: together, the tiles cover the whole.
    let whole = of_crop(&noisy_sensor(), &clip, [0, 0], SIZE);
    let tile = |x: u16, y: u16| {
        let tile = of_crop(&noisy_sensor(), &clip, [x, y], Size { width: 1, height: 1 });
        tile.into_iter().map(move |e| Event { x, y, ..e })
    };
    let mut tiles: Vec<Event> =
        (0..10).flat_map(|y| (0..24).map(move |x| (x, y))).flat_map(|(x, y)| tile(x, y)).collect();
    tiles.sort_by_key(Event::file_order);
    add_same(&mut worst, &tiles, &whole, || "tiles of 1x1".to_owned());
    worst.found()
}
