//! The share of 24 kinds of faults that `check --tree` finds from the files alone, each by a check whose
//! name says what is wrong. Agreement of files (`records`) does not count: a forger edits all of them.

use super::planted_tree::{BASE, PlantedTree, SIZE};
use crate::support::absent::runs_slow_tests;
use glam::DVec3;
use gs2e_event::{Event, Polarity};
use gs2e_num::se3::Se3;
use gs2e_num::units::Timestamp;
use gs2e_trajectory::Trajectory;
use std::fs;

/// A kind of fault: its name, its plant, and the checks of which one must find it.
struct FaultKind {
    name: &'static str,
    plant: Box<dyn Fn(&PlantedTree)>,
    found_by: &'static [&'static str],
}

fn kind(
    name: &'static str,
    found_by: &'static [&'static str],
    plant: impl Fn(&PlantedTree) + 'static,
) -> FaultKind {
    FaultKind { name, plant: Box::new(plant), found_by }
}

fn of_events(
    name: &'static str,
    found_by: &'static [&'static str],
    change: impl Fn(&mut Vec<Event>, i64) + 'static,
) -> FaultKind {
    kind(name, found_by, move |tree| {
        let end = *tree.stamps().last().unwrap();
        tree.events(|events| change(events, end));
    })
}

fn of_poses(
    name: &'static str,
    found_by: &'static [&'static str],
    change: impl Fn(&mut Vec<Se3>) + 'static,
) -> FaultKind {
    kind(name, found_by, move |tree| {
        let path = format!("{BASE}/poses.txt");
        let bytes = fs::read(tree.path().join(&path)).unwrap();
        let mut trajectory = Trajectory::read_poses(bytes.as_slice()).unwrap();
        change(&mut trajectory.world_from_camera);
        let mut bytes = Vec::new();
        trajectory.write_poses(&mut bytes).unwrap();
        tree.write(&path, &bytes);
    })
}

fn with_time(change: impl Fn(i64, i64) -> i64 + 'static) -> impl Fn(&mut Vec<Event>, i64) {
    move |events, end| {
        for event in events.iter_mut() {
            event.t = Timestamp::from_micros(change(event.t.floor_micros(), end));
        }
        events.retain(|event| (0..=end).contains(&event.t.floor_micros()));
    }
}

/// A number from 0 to 1 that differs from event to event.
fn share(i: usize, salt: f64) -> f64 {
    (i as f64 * 0.618_033_988_749_895 + salt * i as f64 * 0.414_213_562_373_095).fract()
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places on the sensor")]
fn noise(events: &mut [Event], end: i64) {
    let [width, height] = SIZE.map(f64::from);
    for (i, event) in events.iter_mut().enumerate() {
        (event.x, event.y) = ((share(i, 0.0) * width) as u16, (share(i, 1.0) * height) as u16);
        event.t = Timestamp::from_micros((share(i, 2.0) * end as f64) as i64);
    }
}

fn kinds_of_events() -> Vec<FaultKind> {
    let flip = |event: &mut Event| {
        event.polarity = if event.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
    };
    vec![
        of_events("polarity flipped", &["polarity#contrary"], move |events, _| {
            events.iter_mut().for_each(flip);
        }),
        of_events("one polarity in ten flipped", &["polarity#contrary"], move |events, _| {
            events.iter_mut().step_by(10).for_each(flip);
        }),
        of_events("mirrored in x", &["alignment#orientation"], |events, _| {
            events.iter_mut().for_each(|e| e.x = SIZE[0] - 1 - e.x);
        }),
        of_events("mirrored in y", &["alignment#orientation"], |events, _| {
            events.iter_mut().for_each(|e| e.y = SIZE[1] - 1 - e.y);
        }),
        of_events("moved by a column", &["alignment#shift"], |events, _| {
            events.retain(|e| e.x + 1 < SIZE[0]);
            events.iter_mut().for_each(|e| e.x += 1);
        }),
        of_events("last half missing", &["completeness#time"], |events, end| {
            events.retain(|e| e.t.floor_micros() < end / 2);
        }),
        of_events("left half missing", &["completeness#place"], |events, _| {
            events.retain(|e| e.x >= SIZE[0] / 2);
        }),
        of_events("one in five dropped", &["event_frame#residual"], |events, _| {
            let mut i = 0;
            events.retain(|_| {
                i += 1;
                i % 5 != 0
            });
        }),
        of_events("one in a hundred twice", &["duplicates#share"], |events, _| {
            let twice: Vec<Event> = events.iter().step_by(100).copied().collect();
            events.extend(twice);
        }),
        of_events("uniform noise", &["alignment#correlation", "structure#"], |events, end| {
            noise(events, end)
        }),
        of_events("no events", &["event_rate#rate", "completeness#time"], |events, _| events.clear()),
        of_events("hot pixels", &["hot_pixels#hot"], |events, end| {
            let one = events[0];
            for (x, y) in (1..20).map(|i| (9 * i, 7 * i)) {
                let at = |t_us: i64| Event {
                    t: Timestamp::from_micros(t_us),
                    x,
                    y,
                    polarity: Polarity::On,
                    ..one
                };
                events.extend((0..end).step_by(100).map(at));
            }
        }),
    ]
}

fn kinds_of_time() -> Vec<FaultKind> {
    let backward: &[&str] = &["event_frame#residual", "completeness#time"];
    vec![
        of_events("time reversed", backward, with_time(|t, end| end - t)),
        of_events("times shuffled", backward, |events, _| {
            let times: Vec<Timestamp> = events.iter().map(|event| event.t).collect();
            let count = times.len();
            for (i, event) in events.iter_mut().enumerate() {
                event.t = times[i * 7919 % count];
            }
        }),
        kind("times rounded to frames", &["batching#times"], |tree| {
            let stamps = tree.stamps();
            tree.events(|events| {
                for event in events {
                    let frame = stamps.partition_point(|t| *t < event.t.floor_micros());
                    event.t = Timestamp::from_micros(stamps[frame]);
                }
            });
        }),
        of_events("100 us late", &["event_times#offset", "time_offset#"], with_time(|t, _| t + 100)),
        of_events("a clock of 0.99", &["event_times#scale"], with_time(|t, _| t * 99 / 100)),
        of_events("times rounded to 100 us", &["event_times#grid"], with_time(|t, _| t / 100 * 100)),
    ]
}

/// Kinds that no scene explains only if its depth is known.
fn kinds_with_depth() -> Vec<FaultKind> {
    let motion: &[&str] = &["photometric#motion", "photometric#frames"];
    vec![
        of_poses("poses inverted", motion, |poses| poses.iter_mut().for_each(|pose| *pose = pose.inverse())),
        of_poses("poses reversed", motion, |poses| poses.reverse()),
        kind("depth of another scale", &["photometric#motion", "flow_projection#"], |tree| {
            for entry in fs::read_dir(tree.path().join(BASE).join("depth")).unwrap() {
                let name = entry.unwrap().file_name().into_string().unwrap();
                let path = format!("{BASE}/depth/{name}");
                let mut bytes = fs::read(tree.path().join(&path)).unwrap();
                let head = bytes.len() - 4 * usize::from(SIZE[0]) * usize::from(SIZE[1]);
                for number in bytes[head..].as_chunks_mut().0 {
                    *number = (1.3 * f32::from_le_bytes(*number)).to_le_bytes();
                }
                tree.write(&path, &bytes);
            }
        }),
    ]
}

fn kinds_of_pictures() -> Vec<FaultKind> {
    vec![
        of_poses("poses constant", &["speed#length", "photometric#"], |poses| {
            let first = poses[0];
            poses.fill(first);
        }),
        of_poses("poses shaken by half a step", &["pose_continuity#noise-translation"], |poses| {
            let step = (poses[11].translation - poses[10].translation).length();
            for (i, pose) in poses.iter_mut().enumerate() {
                let draw = DVec3::new(share(i, 0.3), share(i, 1.3), share(i, 2.3)) - 0.5;
                // An even number between -0.5 and 0.5 has a standard deviation of 1 / sqrt(12).
                pose.translation += 0.5 * step * 12f64.sqrt() * draw;
            }
        }),
        kind("frames in another order", &["photometric#order", "photometric#frames"], |tree| {
            let name = |j: usize| format!("{BASE}/sharp/{j:06}.png");
            let [a, b] = [12, 14].map(|j| fs::read(tree.path().join(name(j))).unwrap());
            tree.write(&name(12), &b);
            tree.write(&name(14), &a);
        }),
    ]
}

/// Plants each kind, and returns the names of those that no check finds, with what was found.
fn missed(kinds: &[FaultKind], left_out: &[&str]) -> Vec<String> {
    let is_missed = |kind: &FaultKind| {
        let tree = PlantedTree::new();
        (kind.plant)(&tree);
        for folder in left_out {
            fs::remove_dir_all(tree.path().join(BASE).join(folder)).unwrap();
        }
        let (_, faults) = tree.faults();
        let found = kind.found_by.iter().any(|check| faults.iter().any(|fault| fault.starts_with(check)));
        (!found).then(|| format!("{}: {faults:#?}", kind.name))
    };
    kinds.iter().filter_map(is_missed).collect()
}

#[test]
fn at_least_22_of_24_kinds_of_faults_are_found_from_files_alone() {
    let mut kinds = kinds_of_events();
    kinds.extend(kinds_of_time());
    kinds.extend(kinds_of_pictures());
    kinds.extend(kinds_with_depth());
    assert_eq!(kinds.len(), 24);
    let missed = missed(&kinds, &[]);
    eprintln!("{} of 24 kinds found; missed: {missed:#?}", 24 - missed.len());
    assert!(missed.len() <= 2, "{missed:#?}");
}

/// Without depth, another scene explains inverted and reversed poses; there is no depth to scale.
#[test]
fn events_and_sharp_frames_alone_show_19_of_21_kinds() {
    if !runs_slow_tests() {
        return;
    }
    let mut kinds = kinds_of_events();
    kinds.extend(kinds_of_time());
    kinds.extend(kinds_of_pictures());
    assert_eq!(kinds.len(), 21);
    let missed = missed(&kinds, &["depth", "flow", "blur"]);
    eprintln!("{} of 21 kinds found; missed: {missed:#?}", 21 - missed.len());
    assert!(missed.len() <= 2, "{missed:#?}");
}
