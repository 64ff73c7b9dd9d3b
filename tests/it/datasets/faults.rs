//! Faults of events against frames, each of a size that the check states to see.

use super::{END_US, HEIGHT, Row, WIDTH, check, measured, phase, verdict, write_set};
use crate::support::workspace::Workspace;
use serde_json::Value;
use std::cell::Cell;
use std::fs;

/// The findings on the set with each event changed, and the exit code.
fn judge(place: &Workspace, change: &dyn Fn(Row) -> Vec<Row>) -> (i32, Vec<(String, Value)>) {
    write_set(place, change);
    check(place, "")
}

fn one(change: impl Fn(Row) -> Row) -> impl Fn(Row) -> Vec<Row> {
    move |row| vec![change(row)]
}

/// The smallest fault that a finding states to see.
fn detects(found: &[(String, Value)], name: &str) -> f64 {
    let (_, finding) =
        found.iter().find(|(own, _)| own == name).unwrap_or_else(|| panic!("{name}: {found:#?}"));
    finding["detects"]["size"].as_f64().unwrap_or_else(|| panic!("{name} states no size: {finding}"))
}

fn because<'a>(found: &'a [(String, Value)], name: &str) -> &'a str {
    found.iter().find(|(own, _)| own == name).unwrap().1["because"].as_str().unwrap()
}

/// A noise event beside a share of the events, at a pixel, a time and with a polarity of its own.
fn noisy(share: f64) -> impl Fn(Row) -> Vec<Row> {
    let count = Cell::new(0u16);
    // Of n events and m of noise, m / (n + m) is the share.
    let per_event = share / (1.0 - share);
    let owed = Cell::new(0.0);
    move |row| {
        let mut rows = vec![row];
        owed.set(owed.get() + per_event);
        while owed.get() >= 1.0 {
            owed.set(owed.get() - 1.0);
            let n = count.replace(count.get().wrapping_add(1));
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the sensor")]
            let [x, y] = [
                (phase(n) * f64::from(WIDTH)) as u16,
                (phase(n.wrapping_mul(7).wrapping_add(3)) * f64::from(HEIGHT)) as u16,
            ];
            let t_us = (i64::from(n) * 7919 + row.0 * 31) % END_US;
            rows.push((t_us, x, y, u8::from(phase(n.wrapping_mul(13)) < 0.5)));
        }
        rows
    }
}

#[test]
fn a_sound_set_states_what_it_would_see() {
    let place = Workspace::new();
    let (code, found) = judge(&place, &one(|row| row));
    assert_eq!(code, 0, "{found:#?}");
    // Frames at 1,000 Hz: a quarter of an interval, and the error of the estimate.
    assert!((250.0..400.0).contains(&detects(&found, "time_offset")), "{found:#?}");
    // A quarter of an interval over 0.1 s.
    assert!((0.0025..0.006).contains(&detects(&found, "time_offset#drift")), "{found:#?}");
    assert!((0.3..0.4).contains(&detects(&found, "noise_floor#share")), "{found:#?}");
    assert!(detects(&found, "completeness#gaps") <= 5000.0, "{found:#?}");
}

#[test]
fn clocks_are_found_from_the_stated_size_on() {
    let place = Workspace::new();
    let (_, sound) = judge(&place, &one(|row| row));
    #[expect(clippy::cast_possible_truncation, reason = "microseconds")]
    let late = detects(&sound, "time_offset").ceil() as i64;
    for by in [late, 1000, 5000] {
        let (code, found) = judge(&place, &one(|(t, x, y, p)| (t + by, x, y, p)));
        assert_eq!((code, verdict(&found, "time_offset").as_str()), (3, "fail"), "{by}: {found:#?}");
        let offset = measured(&found, "time_offset");
        assert!((offset - by as f64).abs() < 50.0, "{by}: {offset}");
    }
    for share in [0.01, 0.02, -0.01] {
        #[expect(clippy::cast_possible_truncation, reason = "microseconds")]
        let stretched = |t: i64| (t as f64 * (1.0 + share)) as i64;
        let (code, found) = judge(&place, &one(|(t, x, y, p)| (stretched(t), x, y, p)));
        assert_eq!((code, verdict(&found, "time_offset#drift").as_str()), (3, "fail"), "{share}: {found:#?}");
        let drift = measured(&found, "time_offset#drift");
        assert!((drift - share).abs() < 0.1 * share.abs() + 2e-4, "{share}: {drift}");
    }
}

#[test]
fn a_hole_is_found_and_a_pause_of_the_scene_is_not() {
    let place = Workspace::new();
    for (length, at) in [(5000, 47_000), (20_000, 30_000), (30_000, 52_000)] {
        let hole = |row: Row| {
            let keeps = row.0 < at || row.0 >= at + length;
            if keeps { vec![row] } else { Vec::new() }
        };
        let (code, found) = judge(&place, &hole);
        assert_eq!(
            (code, verdict(&found, "completeness#gaps").as_str()),
            (3, "fail"),
            "{length}: {found:#?}"
        );
        let longest = measured(&found, "completeness#gaps");
        assert!((longest - length as f64).abs() < 1000.0, "{length}: {longest}");
        // Events alone show it as well.
        let ended = place.gs2e("check --events set/events.txt --size 48x36 --time-unit s");
        assert_eq!(ended.code, 3, "{}", ended.stdout);
    }
    // Bursts of 2 ms, 8 ms apart: one per frame of a slow clip.
    let (_, found) = judge(&place, &|row| if row.0 % 10_000 < 2000 { vec![row] } else { Vec::new() });
    assert_eq!(verdict(&found, "completeness#gaps"), "pass", "{found:#?}");
}

#[test]
fn noise_is_estimated_and_fails_from_the_stated_size_on() {
    let place = Workspace::new();
    for (share, wanted) in [(0.1, "pass"), (0.46, "fail"), (0.7, "fail")] {
        let (code, found) = judge(&place, &noisy(share));
        assert_eq!(verdict(&found, "noise_floor#share"), wanted, "{share}: {found:#?}");
        assert_eq!(code == 3, wanted == "fail", "{share}: {found:#?}");
        let found = measured(&found, "noise_floor#share");
        assert!((found - share).abs() < 0.05, "{share}: {found}");
    }
    // Three in ten events have the wrong polarity.
    let is_flipped = |t: i64, x: u16| phase(u16::try_from(t / 25 % 4000).unwrap() + x) < 0.3;
    let flipped = |(t, x, y, p): Row| (t, x, y, if is_flipped(t, x) { 1 - p } else { p });
    let (code, found) = judge(&place, &one(flipped));
    assert_eq!((code, verdict(&found, "polarity#contrary").as_str()), (3, "fail"), "{found:#?}");
}

#[test]
fn all_orientations_are_named() {
    let place = Workspace::new();
    let (w, h) = (WIDTH - 1, HEIGHT - 1);
    let t = |turn: &dyn Fn(u16, u16) -> [u16; 2], words: &str| {
        let turned = |(t, x, y, p): Row| {
            let [x, y] = turn(x, y);
            if x < WIDTH && y < HEIGHT { vec![(t, x, y, p)] } else { Vec::new() }
        };
        let (code, found) = judge(&place, &turned);
        assert_eq!((code, verdict(&found, "event_frame#correlation").as_str()), (3, "fail"), "{found:#?}");
        assert!(because(&found, "event_frame#correlation").ends_with(words), "{words}: {found:#?}");
    };
    t(&|x, y| [w - x, y], "if the frames are mirrored left to right");
    t(&|x, y| [x, h - y], "if the frames are mirrored top to bottom");
    t(&|x, y| [w - x, h - y], "if the frames are turned by 180 degrees");
    t(&|x, y| [y, x], "if x and y are swapped");
    t(&|x, y| [y, w - x], "if the frames are turned by 90 degrees to the left");
    t(&|x, y| [h - y, x], "if the frames are turned by 90 degrees to the right");
    t(&|x, y| [h - y, w - x], "if x and y are swapped and the frames are turned by 180 degrees");
    // The file states a sensor of 36x48 then.
    write_set(&place, |(t, x, y, p)| vec![(t, y, x, p)]);
    let text = fs::read_to_string(place.path("set/events.txt")).unwrap();
    place.write("set/events.txt", format!("{HEIGHT} {WIDTH}\n{text}"));
    let (code, found) = check(&place, "");
    assert_eq!(code, 3, "{found:#?}");
    assert!(because(&found, "event_frame#correlation").ends_with("if x and y are swapped"), "{found:#?}");
}

#[test]
fn events_that_follow_nothing_fail_and_the_page_says_so_first() {
    let place = Workspace::new();
    // The place of each event is that of another.
    let count = Cell::new(0u16);
    write_set(&place, |(t, _, _, p)| {
        let n = count.replace(count.get().wrapping_add(1));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the sensor")]
        let at = (phase(n) * f64::from(WIDTH * HEIGHT)) as u16;
        vec![(t, at % WIDTH, at / WIDTH, p)]
    });
    let (code, found) = check(&place, "--report page.html");
    assert_eq!((code, verdict(&found, "event_frame#correlation").as_str()), (3, "fail"), "{found:#?}");
    let page = fs::read_to_string(place.path("page.html")).unwrap();
    let said = page.find("wrong: events follow the change of the frames").unwrap();
    assert!(said < page.find("<img").unwrap() && said < page.find("<table").unwrap(), "{page}");
}
