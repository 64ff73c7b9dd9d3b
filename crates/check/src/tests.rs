//! Planted faults, each found by its pass; and sound worlds without findings.

use super::planted::{PlantedWorld, SIZE, SplitMixDraws, WorldSettings, event_at};
use super::*;
use glam::DVec3;
use gs2e_event::{Event, Polarity};
use gs2e_num::units::Timestamp;
use gs2e_sensor::noise::HotPixelNoise;

#[test]
fn every_pass_says_something() {
    let world = PlantedWorld::default_world();
    let findings = world.findings();
    for (check, _) in PASSES {
        assert!(findings.iter().any(|f| f.check == *check), "{check}");
    }
    // Everything moves in this world, and its sensor has no dead time. There are no released files.
    let silent = findings.iter().filter(|f| f.verdict == Verdict::NotRun);
    let silent: Vec<&str> = silent.map(|f| f.check.as_str()).collect();
    let released = ["event_times", "event_times", "photometric", "depth_consistency", "flow_projection"];
    let wanted = [&["refractory", "flash"], &released[..2], &["noise_floor"], &released[2..]].concat();
    assert_eq!(silent, wanted, "{findings:#?}");
}

#[test]
fn sound_worlds_raise_no_alarm() {
    let (paces, thresholds) = ([0.05, 0.3, 0.8], [[1.0, 1.0], [0.6, 0.9], [1.4, 1.0]]);
    let lights = [(0.6, 0.0), (0.25, 0.0), (0.4, 1.5)];
    // A Latin square: each pace, pair of thresholds and light meets each other once.
    for i in 0..9 {
        let (contrast, dawn) = lights[(i / 3 + i) % 3];
        let thresholds = thresholds[i % 3];
        let setting =
            WorldSettings { pace: paces[i / 3], thresholds, contrast, dawn, ..WorldSettings::default() };
        let mut world = PlantedWorld::new(setting);
        // The usual rate per flow holds for scenes, which these waves are not.
        world.flow = None;
        assert_eq!(world.faults(), [""; 0], "{setting:?}: {:#?}", world.findings());
    }
}

#[test]
fn verdicts_have_one_name() {
    for verdict in [Verdict::Pass, Verdict::Warn, Verdict::Fail, Verdict::Waived, Verdict::NotRun] {
        assert_eq!(serde_json::to_value(verdict).unwrap(), verdict.name());
    }
}

/// Plants a fault in a sound world. The passes must find exactly `wanted`.
fn check(plant: impl FnOnce(&mut PlantedWorld), wanted: &[&str]) {
    let mut world = PlantedWorld::default_world();
    plant(&mut world);
    assert_eq!(world.faults(), wanted, "{:#?}", world.findings());
}

#[test]
fn flipped_polarity_is_found() {
    let flip = |w: &mut PlantedWorld| {
        for event in &mut w.events {
            event.polarity = if event.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
        }
        w.events.sort_by_cached_key(Event::file_order);
    };
    let wanted = [
        "polarity#contrary",
        "event_frame#gain",
        "event_frame#gain-on",
        "event_frame#gain-off",
        "event_frame#threshold-on",
        "event_frame#threshold-off",
        "event_frame#residual",
        "event_frame#sign",
        "alignment#correlation",
        "completeness#time",
        "completeness#place",
        "drift_identity#events",
    ];
    check(flip, &wanted);
}

/// Hot pixels fire ON events whatever the brightness does, and their number is drawn.
#[test]
fn hot_pixels_do_not_contradict_a_steady_change() {
    let hot = HotPixelNoise { share: 0.004, rate: 20_000.0, spread: 0.0 };
    for seed in 0..12 {
        let mut world = PlantedWorld::default_world();
        world.sensor.settings.hot_pixels = hot;
        let mut draws = SplitMixDraws(seed);
        let end_us = world.trajectory.stamps_us.last().unwrap().unsigned_abs();
        for pixel in (0..SIZE.pixels()).filter(|_| draws.share() < hot.share).collect::<Vec<_>>() {
            // 20 events a millisecond on average.
            for _ in 0..20 * end_us / 1000 {
                let t_us = draws.below(end_us) as i64;
                world.events.push(event_at(pixel, 1000 * t_us, Polarity::On));
            }
        }
        world.events.sort_by_cached_key(Event::file_order);
        let found = world.finding("polarity#contrary");
        println!("{seed}: {:?} {:?} {}", found.measured, found.limit, found.because);
        assert_eq!(found.verdict, Verdict::Pass, "{seed}: {found:?}");
    }
}

/// A share of few events scatters.
#[test]
fn a_few_contrary_events_are_no_share() {
    let contrary = |share: f64| {
        let mut world = PlantedWorld::new(WorldSettings { thresholds: [1.7; 2], ..WorldSettings::default() });
        let mut draws = SplitMixDraws(7);
        for event in &mut world.events {
            if draws.share() < share {
                event.polarity = if event.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
            }
        }
        world.events.sort_by_cached_key(Event::file_order);
        world.finding("polarity#contrary").verdict
    };
    assert_eq!([0.0, 0.065, 0.2].map(contrary), [Verdict::Pass, Verdict::Pass, Verdict::Fail]);
}

/// A lamp changes all pixels in step and without motion, and its events show the picture where it stands.
#[test]
fn a_lamp_leaves_offset_motion_and_rate_unjudged() {
    let mut world = PlantedWorld::default_world();
    for check in ["motion#median", "event_rate#flow"] {
        assert_eq!(world.finding(check).verdict, Verdict::Pass);
    }
    world.light_changes = true;
    for check in ["motion", "event_rate#flow", "time_offset"] {
        assert_eq!(world.finding(check).verdict, Verdict::NotRun);
    }
}

#[test]
fn misplaced_events_are_found_by_their_place() {
    let t = |wanted: &str, plant: fn(&mut Event)| {
        let mut world = PlantedWorld::default_world();
        world.events.iter_mut().for_each(plant);
        world.events.retain(|e| e.x < 96 && e.y < 72);
        world.events.sort_by_cached_key(Event::file_order);
        assert!(world.faults().contains(&wanted.to_owned()), "{wanted}: {:#?}", world.findings());
    };
    t("alignment#shift", |e| e.x += 1);
    t("alignment#shift", |e| e.y += 1);
    t("alignment#orientation", |e| e.x = 95 - e.x);
    t("alignment#orientation", |e| e.y = 71 - e.y);
    t("alignment#orientation", |e| (e.x, e.y) = (e.y, e.x));
}

#[test]
fn missing_events_are_found_by_time_and_place() {
    let t = |wanted: &str, keep: fn(&Event) -> bool| {
        let mut world = PlantedWorld::default_world();
        world.events.retain(keep);
        assert!(world.faults().contains(&wanted.to_owned()), "{wanted}: {:#?}", world.findings());
    };
    t("completeness#time", |e| !(19_000..31_000).contains(&e.t.floor_micros()));
    t("completeness#place", |e| e.x >= 24);
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

#[test]
fn a_dropped_chunk_is_found() {
    let drop = |w: &mut PlantedWorld| {
        let tenth = w.events.len() / 10;
        w.events.drain(3 * tenth..4 * tenth);
    };
    let mut world = PlantedWorld::default_world();
    drop(&mut world);
    let faults = world.faults();
    for wanted in ["event_frame#residual", "drift_identity#events"] {
        assert!(faults.contains(&wanted.to_owned()), "{faults:?}");
    }
}

#[test]
fn a_repeated_chunk_is_found() {
    let repeat = |w: &mut PlantedWorld| {
        let tenth = w.events[..w.events.len() / 10].to_vec();
        w.events.extend(tenth);
        w.events.sort_by_cached_key(Event::file_order);
    };
    let mut world = PlantedWorld::default_world();
    repeat(&mut world);
    let faults = world.faults();
    for wanted in ["duplicates#share", "duplicates#account", "event_frame#residual", "drift_identity#events"]
    {
        assert!(faults.contains(&wanted.to_owned()), "{faults:?}");
    }
}

#[test]
fn shifted_time_is_found() {
    let shift = |w: &mut PlantedWorld| {
        for event in &mut w.events {
            event.t = Timestamp(event.t.0 + 1_000_000);
        }
    };
    let mut world = PlantedWorld::default_world();
    shift(&mut world);
    let faults = world.faults();
    assert!(faults.contains(&"stamps#events".to_owned()), "{faults:?}");
}

#[test]
fn frame_times_are_found() {
    let snap = |w: &mut PlantedWorld| {
        let stamps = w.trajectory.stamps_us.clone();
        for event in &mut w.events {
            let later = stamps.partition_point(|stamp| *stamp < event.t.floor_micros());
            event.t = Timestamp::from_micros(stamps[later]);
        }
        w.events.sort_by_cached_key(Event::file_order);
    };
    let mut world = PlantedWorld::default_world();
    snap(&mut world);
    let faults = world.faults();
    assert!(faults.contains(&"batching#times".to_owned()), "{faults:?}");
    assert!(faults.contains(&"batching#phase".to_owned()), "{faults:?}");
}

#[test]
fn disorder_and_strange_pixels_are_found() {
    check(|w| w.events.swap(10, 5000), &["schema#order"]);
    check(|w| w.events[7].x = 96, &["schema#place"]);
}

#[test]
fn a_pose_jump_is_found() {
    let shift = |w: &mut PlantedWorld| w.trajectory.world_from_camera[70].translation += DVec3::X * 0.05;
    check(
        shift,
        &["pose_continuity#translation", "pose_continuity#noise-translation", "speed#chord", "speed#length"],
    );
    let turn = |w: &mut PlantedWorld| {
        let pose = &mut w.trajectory.world_from_camera[70];
        pose.rotation *= glam::DQuat::from_rotation_x(0.02);
    };
    check(
        turn,
        &["pose_continuity#rotation", "pose_continuity#noise-rotation", "speed#chord", "speed#length"],
    );
}

#[test]
fn a_path_that_changes_its_speed_is_no_jump() {
    // From pose 70 on, every step is fifty times as long.
    let hurry = |w: &mut PlantedWorld| {
        for (j, pose) in w.trajectory.world_from_camera.iter_mut().enumerate() {
            let steps = j.min(70) + 50 * j.saturating_sub(70);
            pose.translation = DVec3::X * 1e-3 * steps as f64;
            pose.rotation = glam::DQuat::IDENTITY;
        }
    };
    // The poses contradict the speeds that the report asks for, but none of them is a jump.
    check(hurry, &["speed#chord", "speed#length"]);
}

#[test]
fn a_wrong_stamp_is_found() {
    check(|w| w.trajectory.stamps_us[20] += 1, &["stamps#poses"]);
}

#[test]
fn a_law_that_is_not_followed_is_found() {
    check(|w| w.report.mixed_ratio.as_mut().unwrap().max = 1.00001, &["speed#arc"]);
    let still = |w: &mut PlantedWorld| {
        let first = w.trajectory.world_from_camera[0];
        w.trajectory.world_from_camera.fill(first);
    };
    check(still, &["speed#length"]);
}

#[test]
fn a_fast_picture_warns_and_fails_where_the_recipe_says_so() {
    let mut world = PlantedWorld::default_world();
    world.flow.as_mut().unwrap().p95 = 1.2;
    assert_eq!(world.finding("sampling").verdict, Verdict::Warn);
    // The error of a tolerance was measured, so the distance is not judged.
    world.tolerance = Some(0.1);
    assert_eq!(world.finding("sampling").verdict, Verdict::Pass);
    world.limits.sampling = Some(sampling::Limits { max: Some(1.0), ..Default::default() });
    assert_eq!(world.finding("sampling").verdict, Verdict::Fail);
}

#[test]
fn deep_gaussians_warn_and_fail_where_the_recipe_says_so() {
    let mut world = PlantedWorld::default_world();
    world.doubtful_share = Some(0.02);
    assert_eq!(world.finding("affine").verdict, Verdict::Warn);
    world.limits.affine = Some(affine::Limits { max: Some(0.01) });
    assert_eq!(world.finding("affine").verdict, Verdict::Fail);
    world.doubtful_share = None;
    assert_eq!(world.finding("affine").verdict, Verdict::NotRun);
}

#[test]
fn a_flash_of_all_pixels_is_found_at_its_time() {
    let mut world = PlantedWorld::default_world();
    assert_eq!(world.finding("flash#events").verdict, Verdict::Pass);
    let at = |k: u16| Event { x: k % 96, y: k / 96, t: Timestamp::from_micros(30_500), ..world.events[0] };
    let flash: Vec<Event> = (0..96 * 72).map(at).collect();
    world.events.extend(flash);
    world.events.sort_by_cached_key(Event::file_order);
    let found = world.finding("flash#events");
    assert_eq!(found.verdict, Verdict::Fail, "{found:#?}");
    assert!(found.because.starts_with("from 30.0 to 31.0 ms, near pose 72, "), "{found:#?}");
    world.limits.flash = Some(flash::Limits { max: Some(1e4) });
    assert_eq!(world.finding("flash#events").verdict, Verdict::Pass);
}

#[test]
fn events_in_the_dead_time_are_found() {
    use gs2e_sensor::SensorChoice;
    use gs2e_sensor::esim::EsimModel;
    let mut world = PlantedWorld::default_world();
    let mut last = std::collections::BTreeMap::new();
    let mut gap_us = i64::MAX;
    for event in &world.events {
        let t_us = event.t.floor_micros();
        if let Some(before) = last.insert((event.x, event.y), t_us) {
            gap_us = gap_us.min(t_us - before);
        }
    }
    let mut verdict = |period_us: i64| {
        let mut sensor = EsimModel::default();
        sensor.settings.refractory.period_us = period_us as f64;
        world.stated = Some(SensorChoice::Esim(sensor));
        world.finding("refractory").verdict
    };
    assert_eq!([verdict(gap_us), verdict(gap_us + 1)], [Verdict::Pass, Verdict::Fail]);
    assert_eq!(verdict(0), Verdict::NotRun);
}

#[test]
fn hot_and_dead_pixels_are_found() {
    let mut world = PlantedWorld::default_world();
    let hot = |i: i64| Event {
        t: Timestamp::from_micros(60 * i),
        x: 40,
        y: 30,
        polarity: Polarity::On,
        label: gs2e_event::EventLabel::Signal,
    };
    world.events.extend((0..1000).map(hot));
    world.events.sort_by_cached_key(Event::file_order);
    assert_eq!(world.finding("hot_pixels#hot").verdict, Verdict::Warn);
    world.sensor.settings.hot_pixels = gs2e_sensor::noise::HotPixelNoise {
        share: 1e-3,
        rate: 1e4,
        ..gs2e_sensor::noise::HotPixelNoise::default()
    };
    assert_eq!(world.finding("hot_pixels#hot").verdict, Verdict::Pass, "the recipe says so");
    world.limits.hot_pixels = Some(hot_pixels::Limits { hot: Some(0.0), dead: None });
    assert_eq!(world.finding("hot_pixels#hot").verdict, Verdict::Fail);
    let of_first = |n: u16| move |e: &Event| e.y == 30 && (27..27 + n).contains(&e.x);
    check(|w| w.events.retain(|e| !of_first(3)(e)), &["drift_identity#events"]);
    check(|w| w.events.retain(|e| !of_first(4)(e)), &["hot_pixels#dead", "drift_identity#events"]);
    // Pixels that fire later have missed a change, and are not dead.
    let late = |e: &Event| e.t.floor_micros() > 30_000;
    check(|w| w.events.retain(|e| !of_first(4)(e) || late(e)), &["drift_identity#events"]);
}

#[test]
fn events_without_structure_are_found() {
    let mut world = PlantedWorld::default_world();
    let mut draws = super::planted::SplitMixDraws(1);
    for event in &mut world.events {
        (event.x, event.y) = (draws.at(96), draws.at(72));
    }
    world.events.sort_by_cached_key(Event::file_order);
    assert_eq!(world.finding("structure").verdict, Verdict::Warn);
}

#[test]
fn events_that_do_not_move_with_the_scene_are_found() {
    let turned = |flow: fn([f32; 2]) -> [f32; 2], verdict: Verdict| {
        let mut world = PlantedWorld::default_world();
        for at in &mut world.flows {
            at.px_s.pixels_mut().iter_mut().for_each(|v| *v = flow(*v));
        }
        let found = world.finding("motion#median");
        assert_eq!(found.verdict, verdict, "{found:?}");
    };
    // As with poses from world to camera, or with OpenGL camera axes.
    turned(|[u, v]| [-u, v], Verdict::Fail);
    turned(|[u, v]| [u, v], Verdict::Pass);
    let mut world = PlantedWorld::default_world();
    world.flow.as_mut().unwrap().median = 3.0;
    assert_eq!(world.finding("motion").verdict, Verdict::NotRun);
    // A single window has no median.
    let mut world = PlantedWorld::default_world();
    let limit = |world: &PlantedWorld| world.finding("motion#median").limit.unwrap();
    assert!(limit(&world) > 1.1);
    world.flows.truncate(1);
    assert!((limit(&world) - 1.0).abs() < 1e-9);
}

#[test]
fn an_offset_of_a_frame_is_found() {
    for (late_us, verdict) in
        [(417, Verdict::Fail), (-417, Verdict::Fail), (150, Verdict::Pass), (-150, Verdict::Pass)]
    {
        let mut world = PlantedWorld::default_world();
        let end = *world.trajectory.stamps_us.last().unwrap();
        world.events.iter_mut().for_each(|e| e.t = Timestamp(e.t.0 + 1000 * late_us));
        world.events.retain(|e| (0..=end).contains(&e.t.floor_micros()));
        let found = world.finding("time_offset");
        assert_eq!(found.verdict, verdict, "{late_us}: {found:?}");
        assert!((found.measured.unwrap() - late_us as f64).abs() < 60.0, "{late_us}: {found:?}");
    }
}

#[test]
fn an_offset_of_half_a_frame_passes_where_few_pixels_measure_it() {
    // High thresholds leave 580 pixels, whose estimate errs by up to 36 us.
    for (late_us, verdict) in
        [(417, Verdict::Fail), (-417, Verdict::Fail), (208, Verdict::Pass), (-208, Verdict::Pass)]
    {
        let mut world =
            PlantedWorld::new(WorldSettings { thresholds: [1.75; 2], ..WorldSettings::default() });
        world.events.iter_mut().for_each(|e| e.t = Timestamp(e.t.0 + 1000 * late_us));
        let found = world.finding("time_offset");
        assert_eq!(found.verdict, verdict, "{late_us}: {found:?}");
        assert!((found.measured.unwrap() - late_us as f64).abs() < 60.0, "{late_us}: {found:?}");
    }
}

#[test]
fn a_noise_floor_of_other_units_and_pixels_in_step_are_found() {
    let mut world = PlantedWorld::new(WorldSettings { pace: 0.0, ..WorldSettings::default() });
    world.flow = None;
    assert_eq!(world.finding("noise_floor#rate").verdict, Verdict::Pass);
    let mut draws = super::planted::SplitMixDraws(2);
    let mut noise = |world: &mut PlantedWorld, t_us: &dyn Fn(usize) -> i64| {
        world.events = (0..2000)
            .map(|_| Event {
                t: Timestamp::from_micros(t_us(draws.below(62_000))),
                x: draws.at(96),
                y: draws.at(72),
                polarity: Polarity::On,
                label: gs2e_event::EventLabel::Signal,
            })
            .collect();
        world.events.sort_by_cached_key(Event::file_order);
    };
    // The leak of 1e-7 per us makes 43 events.
    noise(&mut world, &|t| t as i64);
    let [rate, rhythm] =
        ["rate", "rhythm"].map(|statement| world.finding(&format!("noise_floor#{statement}")).verdict);
    assert_eq!([rate, rhythm], [Verdict::Warn, Verdict::Pass]);
    noise(&mut world, &|t| if t % 4 == 0 { t as i64 / 8000 * 8000 } else { t as i64 });
    assert_eq!(world.finding("noise_floor#rhythm").verdict, Verdict::Warn);
    world.limits.noise_floor = Some(noise_floor::Limits { factor: Some(100.0) });
    assert_eq!(world.finding("noise_floor#rate").verdict, Verdict::Pass);
}

#[test]
fn frames_too_far_apart_are_found_by_doing() {
    let verdict = |statement: &str, plant: fn(&mut sampling::ResampledIntervals)| {
        let mut world = PlantedWorld::default_world();
        plant(world.resampled.as_mut().unwrap());
        world.finding(&format!("sampling#{statement}")).verdict
    };
    assert_eq!(verdict("count", |r| r.at_twice = 1051), Verdict::Warn);
    assert_eq!(verdict("count", |r| r.at_twice = 951), Verdict::Pass);
    assert_eq!(verdict("shift", |r| r.shift_us = Some(20.5)), Verdict::Warn);
    let asked = |r: &mut sampling::ResampledIntervals| (r.shift_us, r.tolerance) = (Some(20.5), Some(0.05));
    assert_eq!(verdict("shift", asked), Verdict::Pass);
    assert_eq!(verdict("twice", |r| r.events = 30), Verdict::NotRun);
}

#[test]
fn a_recipes_rate_is_a_gate() {
    let mut world = PlantedWorld::default_world();
    let rate = world.finding("event_rate#rate").measured.unwrap();
    world.limits.event_rate = Some(event_rate::Limits { min: None, max: Some(rate * 0.99) });
    assert_eq!(world.finding("event_rate#rate").verdict, Verdict::Fail);
    world.limits.event_rate = Some(event_rate::Limits { min: None, max: Some(rate * 1.01) });
    assert_eq!(world.finding("event_rate#rate").verdict, Verdict::Pass);
}

#[test]
fn a_stream_without_events_is_told_and_fails_a_limit() {
    let mut world = PlantedWorld::default_world();
    world.events.clear();
    let found = world.finding("event_rate#rate");
    assert_eq!((found.verdict, found.measured), (Verdict::Warn, Some(0.0)));
    assert!(found.because.starts_with("no events"), "{}", found.because);
    assert_eq!(world.finding("event_rate#flow").verdict, Verdict::NotRun);
    world.limits.event_rate = Some(event_rate::Limits { min: Some(1e-3), max: None });
    assert_eq!(world.finding("event_rate#rate").verdict, Verdict::Fail);
}

#[test]
fn a_brightening_scene_is_predicted_to_be_on() {
    let setting = WorldSettings { pace: 0.0, dawn: 3.0, ..WorldSettings::default() };
    let world = PlantedWorld::new(setting);
    let finding = world.finding("polarity");
    assert_eq!((finding.verdict, finding.measured), (Verdict::Pass, Some(1.0)), "{finding:?}");
    let mut flipped = world;
    for event in &mut flipped.events {
        event.polarity = Polarity::Off;
    }
    assert_eq!(flipped.finding("polarity").verdict, Verdict::Warn);
}

#[test]
fn an_account_of_broken_pixels_is_a_fault() {
    let breaks = |w: &mut PlantedWorld| {
        w.account.drift_violations = 1;
        w.account.drift_worst = 1.5;
    };
    check(breaks, &["drift_identity#pixels"]);
}

#[test]
fn waived_faults_say_why() {
    let mut world = PlantedWorld::default_world();
    world.trajectory.stamps_us[20] += 1;
    world.limits.waive = vec![CheckWaiver { check: "stamps".into(), because: "a test".into() }];
    let finding = world.finding("stamps#poses");
    assert_eq!(finding.verdict, Verdict::Waived);
    assert!(finding.because.ends_with("; accepted: a test"), "{}", finding.because);
}
