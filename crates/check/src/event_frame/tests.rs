//! Sound and planted streams of unequal pixels with a noise floor.

use crate::Verdict;
use crate::planted::{PlantedWorld, SIZE, SplitMixDraws, WorldSettings};
use gs2e_event::{Event, Polarity};
use gs2e_num::units::Timestamp;
use gs2e_sensor::noise::NoiseFloor;

/// Thresholds of a DAVIS346, their spread, and its noise at these rates.
fn uneven(floor_hz: [f64; 2]) -> WorldSettings {
    WorldSettings {
        thresholds: [1.0, 1.907],
        spread: 0.157,
        floor_hz,
        contrast: 0.8,
        ..WorldSettings::default()
    }
}

const STATEMENTS: [&str; 7] =
    ["gain", "gain-on", "gain-off", "threshold-on", "threshold-off", "residual", "sign"];

fn verdicts(world: &PlantedWorld) -> Vec<Verdict> {
    let found = STATEMENTS.map(|statement| world.finding(&format!("event_frame#{statement}")));
    found.iter().for_each(|f| {
        println!("{} {:?} of {:?}: {}", f.subject.text_without("world/base"), f.measured, f.limit, f.because)
    });
    found.into_iter().map(|f| f.verdict).collect()
}

#[test]
fn sound_unequal_pixels_pass_every_statement() {
    let mut thresholds = 0;
    // No floor, that of bright light, and that of dim light over these 62 ms.
    for floor_hz in [[0.0; 2], [0.2, 0.05], [2.0, 3.0]] {
        for (pace, dawn) in [(0.3, 0.0), (0.8, 0.0), (0.3, 1.0)] {
            let mut world = PlantedWorld::new(WorldSettings { pace, dawn, ..uneven(floor_hz) });
            // The usual rate per flow holds for scenes, which these waves are not.
            world.flow = None;
            println!("{floor_hz:?}, {pace} px per frame, {dawn} brighter");
            let found = verdicts(&world);
            // Waves that rise and fall show few pixels about to fire.
            let judged = |i: &usize| found[*i] != Verdict::NotRun || ![3, 4].contains(i);
            assert!((0..7).filter(judged).all(|i| found[i] == Verdict::Pass), "{found:?}");
            assert_eq!(world.faults(), [""; 0]);
            thresholds += usize::from(found[3] == Verdict::Pass) + usize::from(found[4] == Verdict::Pass);
        }
    }
    assert!(thresholds >= 9, "{thresholds} of 18 statements on thresholds");
}

/// The statement of the sensor differs from the sensor.
fn stated(
    world: &PlantedWorld,
    change: impl FnOnce(&mut gs2e_sensor::voltmeter::VoltmeterModel),
) -> PlantedWorld {
    let mut sensor = world.sensor.clone();
    change(&mut sensor);
    PlantedWorld { stated: Some(sensor.into()), ..world.clone() }
}

#[test]
fn mean_thresholds_off_by_a_quarter_are_found() {
    let world = PlantedWorld::new(WorldSettings { dawn: 1.0, ..uneven([0.2, 0.05]) });
    for factor in [0.75, 1.33] {
        let on = stated(&world, |sensor| sensor.threshold_on *= factor);
        println!("{factor}: {:?}", verdicts(&on));
        assert_eq!(on.finding("event_frame#threshold-on").verdict, Verdict::Fail, "{factor}");
    }
}

/// Turns the polarity of one event in `one_in`.
fn turn_some(world: &mut PlantedWorld, one_in: u64) {
    let mut draws = SplitMixDraws(2);
    for event in world.events.iter_mut().filter(|_| draws.below(one_in) == 0) {
        event.polarity = if event.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
    }
    world.events.sort_by_cached_key(Event::file_order);
}

#[test]
fn turned_events_are_found_where_a_floor_makes_contrary_events() {
    for floor_hz in [[0.2, 0.05], [2.0, 3.0]] {
        let mut world = PlantedWorld::new(uneven(floor_hz));
        turn_some(&mut world, 20);
        let found = verdicts(&world);
        assert_eq!(found[5..], [Verdict::Fail; 2], "{floor_hz:?}");
    }
}

/// The events of a floor that the sensor does not state look like turned events, and are found.
#[test]
fn a_floor_that_is_not_stated_is_found() {
    let world = PlantedWorld::new(uneven([60.0, 60.0]));
    let silent = stated(&world, |sensor| sensor.floor = NoiseFloor::default());
    assert_eq!(silent.finding("event_frame#sign").verdict, Verdict::Fail);
}

#[test]
fn noise_that_spoils_most_pixels_leaves_residuals_unjudged() {
    let world = PlantedWorld::new(uneven([60.0, 60.0]));
    assert_eq!(verdicts(&world)[5..], [Verdict::NotRun, Verdict::Pass]);
}

/// Frames that a tolerance chose show a brief change late, at a few of all pixels. These may be most of the
/// pixels that have changed yet.
#[test]
fn pixels_that_a_tolerance_may_miss_are_not_among_those_of_the_wrong_sign() {
    let at = |e: &Event| usize::from(e.y) * SIZE.width as usize + usize::from(e.x);
    let mut world = PlantedWorld { is_release: true, tolerance: Some(0.1), ..PlantedWorld::default_world() };
    let early = |e: &Event| e.t.floor_micros() < 20_000;
    let mut counts = vec![0; SIZE.pixels()];
    world.events.iter().filter(|e| early(e)).for_each(|e| counts[at(e)] += 1);
    let mut order: Vec<usize> = (0..SIZE.pixels()).collect();
    order.sort_by_key(|i| std::cmp::Reverse(counts[*i]));
    // Fewer than a 25th.
    let missed: Vec<usize> = order[..250].to_vec();
    for event in world.events.iter_mut().filter(|e| early(e) && missed.contains(&at(e))) {
        event.t = Timestamp::from_micros(20_000);
    }
    world.events.sort_by_cached_key(Event::file_order);
    assert_eq!(world.finding("event_frame#sign").verdict, Verdict::Pass);
    // Without a tolerance they are wrong, and with one, turned events are.
    let exact = PlantedWorld { tolerance: None, ..world.clone() };
    assert_eq!(exact.finding("event_frame#sign").verdict, Verdict::Fail);
    for event in world.events.iter_mut().filter(|e| at(e).is_multiple_of(6)) {
        event.polarity = if event.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
    }
    world.events.sort_by_cached_key(Event::file_order);
    assert_eq!(world.finding("event_frame#sign").verdict, Verdict::Fail);
}

#[test]
fn thresholds_off_by_a_tenth_are_found() {
    let t = |on: f64, off: f64, wanted: &str| {
        let mut world = PlantedWorld::default_world();
        world.sensor.threshold_on = on;
        world.sensor.threshold_off = off;
        assert!(world.faults().contains(&wanted.to_owned()), "{on} {off}: {:#?}", world.findings());
    };
    t(0.9, 1.0, "event_frame#threshold-on");
    t(1.1, 1.0, "event_frame#threshold-on");
    t(1.0, 0.9, "event_frame#threshold-off");
    t(1.0, 1.1, "event_frame#threshold-off");
}

#[test]
fn the_shown_threshold_is_that_of_the_sensor() {
    for [on, off] in [[1.0, 1.0], [0.6, 0.9]] {
        let world = PlantedWorld::new(WorldSettings { thresholds: [on, off], ..WorldSettings::default() });
        for (side, wanted) in [("on", on), ("off", off)] {
            let shown = world.finding(&format!("event_frame#threshold-{side}")).measured.unwrap();
            assert!((shown / wanted - 1.0).abs() < 0.02, "{side}: {shown} for {wanted}");
        }
    }
}

#[test]
fn voltages_may_start_anywhere() {
    let initial = gs2e_sensor::voltmeter::InitialVoltage::Stationary;
    let mut world = PlantedWorld::new(WorldSettings { initial, dawn: 0.5, ..WorldSettings::default() });
    world.flow = None;
    assert_eq!(world.faults(), [""; 0], "{:#?}", world.findings());
    assert_eq!(world.finding("event_frame#threshold-on").verdict, Verdict::NotRun);
    world.events.retain(|e| e.polarity == Polarity::On);
    assert_eq!(world.finding("event_frame#residual").verdict, Verdict::Fail);
}
