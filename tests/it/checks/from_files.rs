//! Faults that are planted in the files of a release, whose sums are then computed again: each is
//! found by `check --tree`, from the files alone, by a check whose name says what is wrong.

use super::planted_tree::{BASE, PlantedTree, SIZE};
use crate::release::small::{edit, gs2e};
use gs2e_event::{Event, EventLabel, Polarity};
use gs2e_num::units::Timestamp;
use std::fs;

/// A fixed sequence of numbers (splitmix64).
struct Draws(u64);

impl Draws {
    /// A number from 0 to below `n`.
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % n
    }

    /// True once in `n` draws.
    fn once_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    /// A pixel of the sensor.
    fn pixel(&mut self) -> (u16, u16) {
        let [x, y] = SIZE.map(|side| u16::try_from(self.below(side.into())).unwrap());
        (x, y)
    }
}

/// Plants a fault in the events, and requires that each of the checks finds it.
fn events(name: &str, wanted: &[&str], change: impl FnOnce(&mut Vec<Event>, &mut Draws, i64)) {
    let tree = PlantedTree::new();
    let end = *tree.stamps().last().unwrap();
    tree.events(|events| change(events, &mut Draws(1), end));
    finds(name, wanted, &tree);
}

fn finds(name: &str, wanted: &[&str], tree: &PlantedTree) {
    let (code, faults) = tree.faults();
    for check in wanted {
        assert!(faults.iter().any(|fault| fault.starts_with(check)), "{name}: {check} not in {faults:#?}");
    }
    // Warnings alone leave the exit code at 0.
    assert!(code == Some(3) || wanted.contains(&"event_rate#rate"), "{name}: {code:?}");
}

fn flipped(polarity: Polarity) -> Polarity {
    if polarity == Polarity::On { Polarity::Off } else { Polarity::On }
}

fn at_us(event: &Event) -> i64 {
    event.t.floor_micros()
}

#[test]
fn an_untouched_tree_is_sound() {
    let (code, found) = PlantedTree::new().faults();
    // The build found Gaussians near the camera, and the release states it.
    assert!(code == Some(0) && found.iter().all(|fault| fault.starts_with("affine#")), "{found:#?}");
}

#[test]
fn wrong_polarities_are_found() {
    events("all flipped", &["polarity#contrary"], |events, _, _| {
        events.iter_mut().for_each(|e| e.polarity = flipped(e.polarity));
    });
    events("one in ten flipped", &["polarity#contrary"], |events, draws, _| {
        events.iter_mut().filter(|_| draws.once_in(10)).for_each(|e| e.polarity = flipped(e.polarity));
    });
}

#[test]
fn misplaced_events_are_found() {
    let [width, height] = SIZE;
    events("mirrored in x", &["alignment#orientation"], |events, _, _| {
        events.iter_mut().for_each(|e| e.x = width - 1 - e.x);
    });
    events("mirrored in y", &["alignment#orientation"], |events, _, _| {
        events.iter_mut().for_each(|e| e.y = height - 1 - e.y);
    });
    events("transposed", &["alignment#orientation"], |events, _, _| {
        events.iter_mut().for_each(|e| (e.x, e.y) = (e.y, e.x));
        events.retain(|e| e.x < width && e.y < height);
    });
    events("x + 1", &["alignment#shift"], |events, _, _| {
        events.retain(|e| e.x + 1 < width);
        events.iter_mut().for_each(|e| e.x += 1);
    });
    events("y + 1", &["alignment#shift"], |events, _, _| {
        events.retain(|e| e.y + 1 < height);
        events.iter_mut().for_each(|e| e.y += 1);
    });
}

#[test]
fn wrong_times_are_found() {
    events("reversed", &["event_frame#residual"], |events, _, end| {
        events.iter_mut().for_each(|e| e.t = Timestamp::from_micros(end - at_us(e)));
    });
    events("shuffled", &["event_frame#residual"], |events, draws, _| {
        for i in (1..events.len()).rev() {
            let j = usize::try_from(draws.below(i as u64 + 1)).unwrap();
            (events[i].t, events[j].t) = (events[j].t, events[i].t);
        }
    });
    events("in half the time", &["event_frame#residual", "completeness#time"], |events, _, _| {
        events.iter_mut().for_each(|e| e.t = Timestamp::from_micros(at_us(e) / 2));
    });
    let stamps = PlantedTree::new().stamps();
    events("rounded to frames", &["batching#times"], |events, _, _| {
        for event in events {
            let frame = stamps.partition_point(|t| *t < at_us(event));
            event.t = Timestamp::from_micros(stamps[frame]);
        }
    });
}

#[test]
fn missing_events_are_found() {
    events("last half", &["completeness#time"], |events, _, end| events.retain(|e| at_us(e) < end / 2));
    events("left half", &["completeness#place"], |events, _, _| events.retain(|e| e.x >= SIZE[0] / 2));
    events("5 ms", &["completeness#time"], |events, _, _| {
        events.retain(|e| !(12_000..17_000).contains(&at_us(e)));
    });
    events("a fifth", &["event_frame#residual", "records#events"], |events, draws, _| {
        events.retain(|_| !draws.once_in(5));
    });
    events("one in a hundred", &["event_frame#residual", "records#events"], |events, draws, _| {
        events.retain(|_| !draws.once_in(100));
    });
    events("all", &["event_rate#rate", "completeness#time"], |events, _, _| events.clear());
}

#[test]
fn events_of_another_origin_are_found() {
    events("uniform noise", &["alignment#correlation", "structure#"], |events, draws, end| {
        for event in events {
            (event.x, event.y) = draws.pixel();
            let t_us = draws.below(end.try_into().unwrap());
            event.t = Timestamp::from_micros(t_us.try_into().unwrap());
        }
    });
    events("one in a hundred twice", &["duplicates#share"], |events, draws, _| {
        let twice: Vec<Event> = events.iter().filter(|_| draws.once_in(100)).copied().collect();
        events.extend(twice);
    });
    // No check of duplicates sees these, because no two events have one time.
    events("one in a hundred twice, 1 us apart", &["event_frame#residual"], |events, draws, end| {
        let twice: Vec<Event> =
            events.iter().filter(|e| at_us(e) < end && draws.once_in(100)).copied().collect();
        events.extend(twice.into_iter().map(|e| Event { t: Timestamp::from_micros(at_us(&e) + 1), ..e }));
    });
    // With this many, none of them is far busier than all others.
    events("one pixel in twenty hot", &["event_frame#residual"], |events, draws, end| {
        for _ in 0..SIZE[0] * SIZE[1] / 20 {
            let (x, y) = draws.pixel();
            events.extend((0..end).step_by(2500).map(|t_us| {
                let (t, polarity, label) = (Timestamp::from_micros(t_us), Polarity::On, EventLabel::Signal);
                Event { t, x, y, polarity, label }
            }));
        }
    });
    events("hot pixels", &["hot_pixels#hot"], |events, draws, end| {
        for _ in 0..20 {
            let (x, y) = draws.pixel();
            events.extend((0..end).step_by(100).map(|t_us| {
                let (t, polarity, label) = (Timestamp::from_micros(t_us), Polarity::On, EventLabel::Signal);
                Event { t, x, y, polarity, label }
            }));
        }
    });
    events("dead pixels", &["hot_pixels#dead"], |events, draws, _| {
        let dead: Vec<bool> = (0..SIZE[0] * SIZE[1]).map(|_| draws.once_in(50)).collect();
        events.retain(|e| !dead[usize::from(e.y * SIZE[0] + e.x)]);
    });
}

#[test]
fn pictures_that_do_not_belong_to_the_events_are_found() {
    let tree = PlantedTree::new();
    let frames = tree.stamps().len();
    let name = |j: usize| format!("{BASE}/sharp/{j:06}.png");
    let bytes: Vec<Vec<u8>> = (0..frames).map(|j| fs::read(tree.path().join(name(j))).unwrap()).collect();
    for (j, bytes) in bytes.iter().rev().enumerate() {
        tree.write(&name(j), bytes);
    }
    finds("frames in reverse", &["polarity#contrary", "records#blur"], &tree);

    let tree = PlantedTree::new();
    let blurred = fs::read_dir(tree.path().join(BASE).join("blur")).unwrap().map(|e| e.unwrap().file_name());
    let mut blurred: Vec<String> = blurred.map(|name| name.into_string().unwrap()).collect();
    blurred.sort();
    let last = fs::read(tree.path().join(format!("{BASE}/blur/{}", blurred[blurred.len() - 1]))).unwrap();
    tree.write(&format!("{BASE}/blur/{}", blurred[0]), &last);
    finds("another exposure", &["records#blur"], &tree);
}

#[test]
fn files_edited_without_the_others_are_found() {
    let tree = PlantedTree::new();
    let poses = format!("{BASE}/poses.txt");
    let text = fs::read_to_string(tree.path().join(&poses)).unwrap();
    let first = text.lines().next().unwrap().split_once(' ').unwrap().1.to_owned();
    let still: String = tree.stamps().iter().map(|t_us| format!("{t_us} {first}\n")).collect();
    tree.write(&poses, still.as_bytes());
    finds("a camera that stands still", &["speed#length", "records#poses"], &tree);

    let tree = PlantedTree::new();
    let transforms = format!("{BASE}/transforms.json");
    let text = fs::read(tree.path().join(&transforms)).unwrap();
    tree.write(&transforms, &text);
    edit(tree.path(), &transforms, |value| value["fl_x"] = (value["fl_x"].as_f64().unwrap() * 1.01).into());
    finds("another focal length", &["records#poses"], &tree);

    let tree = PlantedTree::new();
    fs::remove_file(tree.path().join(BASE).join("events.h5")).unwrap();
    finds("no event file", &["records#events"], &tree);

    let tree = PlantedTree::new();
    let manifest = fs::read(tree.path().join("manifest.json")).unwrap();
    tree.write("manifest.json", &manifest);
    edit(tree.path(), "manifest.json", |value| value["scenes"] = serde_json::json!([]));
    let output = gs2e(tree.path(), &["check", "--tree", "."]);
    assert_eq!(output.status.code(), Some(3));
}
