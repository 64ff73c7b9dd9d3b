use super::*;
use crate::noise::RefractoryPeriod;
use gs2e_event::{EventLabel, Polarity};
use gs2e_image::{Image, Size};
use gs2e_num::seed::{Seed, ks};
use gs2e_num::units::Timestamp;

const SIZE: Size = Size { width: 64, height: 48 };
const IEBCS: PixelLatency = PixelLatency { us: 100.0, jitter_us: 10.0, tau_us: 0.0, max_us: 1e4 };

fn array(origin: [u16; 2]) -> PixelArray {
    PixelArray { size: SIZE, origin, seed: Seed(3), labels: false }
}

fn event(ns: i64, x: u16, y: u16) -> Event {
    Event { t: Timestamp(ns), x, y, polarity: Polarity::On, label: EventLabel::Signal }
}

/// One event of every pixel, in file order, at times that differ by `step_ns`.
fn one_each(step_ns: i64) -> Vec<Event> {
    let pixels = (0..48).flat_map(|y| (0..64).map(move |x| (x, y)));
    pixels.zip(1..).map(|((x, y), i)| event(i * step_ns, x, y)).collect()
}

/// The events, late, taken in parts of `chunk`, and their counts.
fn late(mut state: LateEvents, events: &[Event], chunk: usize, last_ns: i64) -> (Vec<Event>, LatencyAccount) {
    let mut out = Vec::new();
    state.last_ns = last_ns;
    for part in events.chunks(chunk) {
        state.take(part, &mut out).unwrap();
    }
    state.finish(SimulationAccount::default(), &mut out).unwrap();
    assert_eq!(state.counts.kept, out.len() as u64);
    assert!(out.is_sorted_by_key(Event::file_order));
    (out, state.counts)
}

fn dark() -> LateEvents {
    LateEvents::new(IEBCS, &SensorSettings::default(), array([0, 0]))
}

/// Delays of the only event of each pixel, us.
fn delays(before: &[Event], after: &[Event]) -> Vec<f64> {
    let mut after = after.to_vec();
    after.sort_by_key(|event| (event.y, event.x));
    assert_eq!(before.len(), after.len());
    let pairs = before.iter().zip(&after);
    pairs
        .map(|(a, b)| {
            assert_eq!((a.x, a.y, a.polarity, a.label), (b.x, b.y, b.polarity, b.label));
            (b.t.0 - a.t.0) as f64 * 1e-3
        })
        .collect()
}

#[test]
fn delays_are_normal_and_no_event_is_lost() {
    let events = one_each(700);
    let (out, counts) = late(dark(), &events, 100, 1_000_000_000);
    assert_eq!((counts.made, counts.kept, counts.unread), (3072, 3072, 0));
    let found = delays(&events, &out);
    let mean = found.iter().sum::<f64>() / found.len() as f64;
    // Ten standard deviations from 0, where nothing is cut. Five standard errors of the mean.
    assert!((mean - 100.0).abs() < 5.0 * 10.0 / 3072f64.sqrt(), "{mean}");
    assert!((counts.mean_us - mean).abs() < 1e-9);
    let most = found.iter().copied().fold(0.0, f64::max);
    assert!((counts.max_us - most).abs() < 1e-9);
    let normal = |us: f64| 0.5 * libm::erfc(-(us - 100.0) / (10.0 * std::f64::consts::SQRT_2));
    let distance = ks::scaled_distance(found, normal);
    println!("scaled distance {distance:.3}");
    assert!(distance < 2.23, "{distance}");
    // The parts in which events arrive do not matter.
    assert!(late(dark(), &events, 3072, 1_000_000_000) == (out, counts));
}

#[test]
fn a_latency_without_a_number_is_absent() {
    let nothing = PixelLatency { us: 0.0, jitter_us: 0.0, ..IEBCS };
    assert!(nothing.is_absent() && !IEBCS.is_absent());
    let none = LateEvents::new(nothing, &SensorSettings::default(), array([0, 0]));
    let events = one_each(700);
    let (out, counts) = late(none, &events, 64, 1_000_000_000);
    assert!(out == events);
    assert_eq!(counts.max_us.to_bits(), 0.0f64.to_bits());
}

#[test]
fn a_crop_has_the_delays_of_the_whole() {
    let events = one_each(700);
    let whole = delays(&events, &late(dark(), &events, 64, 1_000_000_000).0);
    let cropped = LateEvents::new(IEBCS, &SensorSettings::default(), array([10, 20]));
    let inside: Vec<Event> = events.iter().filter(|e| e.x < 54 && e.y < 28).copied().collect();
    let found = delays(&inside, &late(cropped, &inside, 64, 1_000_000_000).0);
    for (event, found) in inside.iter().zip(found) {
        let place = usize::from(event.y + 20) * 64 + usize::from(event.x + 10);
        assert_eq!(found.to_bits(), whole[place].to_bits());
    }
}

/// Events of one pixel, 20 us apart, with a jitter of 30 us: they would often overtake each other.
#[test]
fn events_of_a_pixel_keep_their_order_and_their_dead_time() {
    let wide = PixelLatency { jitter_us: 30.0, max_us: 180.0, ..IEBCS };
    let events: Vec<Event> = (0..5000)
        .map(|i| {
            let polarity = if i % 2 == 0 { Polarity::On } else { Polarity::Off };
            Event { polarity, ..event(20_000 * i, 3, 4) }
        })
        .collect();
    for dead_ns in [0, 15_000] {
        let refractory = RefractoryPeriod { period_us: dead_ns as f64 * 1e-3, ..Default::default() };
        let settings = SensorSettings { refractory, ..SensorSettings::default() };
        let state = LateEvents::new(wide, &settings, array([0, 0]));
        let (out, counts) = late(state, &events, 100, 1_000_000_000);
        assert_eq!(counts.kept, 5000);
        // Within a microsecond, files are in order of polarity.
        let mut times: Vec<i64> = out.iter().map(|event| event.t.0).collect();
        times.sort_unstable();
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] >= dead_ns));
        let delays = times.iter().zip(&events).map(|(late, event)| (late - event.t.0) as f64 * 1e-3);
        assert!(delays.into_iter().all(|us| (0.0..=180.0).contains(&us)));
        if dead_ns > 0 {
            assert!(out.iter().zip(&events).all(|(late, event)| late.polarity == event.polarity));
        }
    }
}

/// One event per us, and delays of 150 us at most.
#[test]
fn no_more_events_wait_than_come_in_the_longest_delay() {
    let latency = PixelLatency { max_us: 150.0, ..IEBCS };
    let mut state = LateEvents::new(latency, &SensorSettings::default(), array([0, 0]));
    let (mut out, mut most) = (Vec::new(), 0);
    for event in one_each(1000) {
        state.take(&[event], &mut out).unwrap();
        most = most.max(state.waiting.len());
    }
    assert!((100..=151).contains(&most), "{most}");
}

#[test]
fn events_after_the_last_frame_are_counted_and_left_out() {
    let steady = PixelLatency { jitter_us: 0.0, ..IEBCS };
    let state = LateEvents::new(steady, &SensorSettings::default(), array([0, 0]));
    let events = [event(1_000, 0, 0), event(900_000, 1, 0), event(900_001, 2, 0), event(1_000_000, 3, 0)];
    let (out, counts) = late(state, &events, 4, 1_000_000);
    assert_eq!(out.iter().map(|event| event.t.0).collect::<Vec<_>>(), [101_000, 1_000_000]);
    assert_eq!((counts.made, counts.kept, counts.unread), (4, 2, 2));
    assert!((counts.mean_us - 100.0).abs() < 1e-9);
}

/// 40 us at 1000 lux, as in the example of the program: 400 us at 100 lux, 10 ms at most in the dark.
#[test]
fn delays_grow_with_falling_light() {
    let latency = PixelLatency { jitter_us: 0.0, tau_us: 40.0, ..IEBCS };
    let front_end = FrontEnd { lux: Some(255.0), ..FrontEnd::default() };
    let settings = SensorSettings { front_end, ..SensorSettings::default() };
    let mut state = LateEvents::new(latency, &settings, array([0, 0]));
    let greys = [255.0, 100.0, 4.0, 0.0];
    let picture: Vec<f32> = (0..SIZE.pixels()).map(|pixel| greys[pixel % 4]).collect();
    for (index, t) in [0, 1_000_000].into_iter().enumerate() {
        let luminance = Image::from_vec(SIZE, picture.clone());
        let frame = DenseFrame { index, t: Timestamp(t), luminance, rate: None };
        state.light.as_mut().unwrap().add(&frame);
    }
    let events: Vec<Event> = (0..4).map(|x| event(500_000, x, 0)).collect();
    let (out, _) = late(state, &events, 4, 1_000_000_000);
    let found = delays(&events, &out);
    // 100 us + 40 us * 1000 lux / light.
    let wanted = [100.0 + 40_000.0 / 255.0, 500.0, 10_000.0, 10_000.0];
    assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-3), "{found:?}");
}

#[test]
fn numbers_outside_their_range_are_refused() {
    let dim = FrontEnd::default();
    let lit = FrontEnd { lux: Some(250.0), ..dim };
    assert!(IEBCS.validate(&dim).is_ok());
    for wrong in [
        PixelLatency { us: -1.0, ..IEBCS },
        PixelLatency { jitter_us: f64::NAN, ..IEBCS },
        PixelLatency { max_us: 0.0, ..IEBCS },
        PixelLatency { us: 2e4, ..IEBCS },
    ] {
        assert!(wrong.validate(&lit).is_err(), "{wrong:?}");
    }
    let filtered = PixelLatency { tau_us: 40.0, ..IEBCS };
    assert!(filtered.validate(&dim).is_err() && filtered.validate(&lit).is_ok());
}
