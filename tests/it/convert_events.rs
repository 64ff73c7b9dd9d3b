//! `gs2e convert`: events between file formats, compared with words and lines written by hand.

use crate::support::workspace::Workspace;
use serde_json::Value;
use std::fs;

/// The lines of a `.txt` after its comment.
fn lines(place: &Workspace, name: &str) -> Vec<String> {
    let text = fs::read_to_string(place.path(name)).unwrap();
    let mut lines = text.lines();
    assert!(lines.next().is_some_and(|first| first.starts_with("# t x y p in us; sensor ")), "{text}");
    lines.map(str::to_owned).collect()
}

fn words32(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

pub(crate) fn words16(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

fn raw(header: &str, words: &[u8]) -> Vec<u8> {
    [header.as_bytes(), words].concat()
}

/// Words as the documentation of EVT 2.0 lays them out: kind, time, column, row.
#[test]
fn evt2_is_read_as_it_is_documented() {
    let place = Workspace::new();
    let event = |on: u32, low: u32, x: u32, y: u32| on << 28 | low << 22 | x << 11 | y;
    let words = [
        event(1, 3, 1, 1), // before any time
        0x8000_0001,       // 64 us
        event(1, 5, 639, 479),
        event(0, 5, 0, 0), // comes as the camera sends it, not in the order of files
        0xa000_0000,       // a trigger
        0x8fff_ffff,
        event(1, 63, 7, 8),
        0x8000_0000, // the counter restarted
        event(0, 0, 9, 10),
    ];
    let header = "% date 2026-01-01 00:00:00\n% evt 2.0\n% geometry 640x480\n% end\n";
    place.write("in.raw", raw(header, &words32(&words)));
    let refused = place.gs2e("convert in.raw out.txt");
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("events: 1 before the first timestamp of the recording are dropped"));
    assert!(!place.path("out.txt").exists());
    let found: Value =
        serde_json::from_str(&place.ok("convert --lossy in.raw out.txt --json").stdout).unwrap();
    assert_eq!((&found["events"], &found["on"], &found["untimed"]), (&4.into(), &2.into(), &1.into()));
    let end = (1_i64 << 34) - 1;
    let wanted = ["69 0 0 0", "69 639 479 1", &format!("{end} 7 8 1"), &format!("{} 9 10 0", end + 1)];
    assert_eq!(lines(&place, "out.txt"), wanted);
}

/// Words as the documentation of EVT 3.0 lays them out.
#[test]
fn evt3_is_read_as_it_is_documented() {
    let place = Workspace::new();
    let words = [
        0x8001, 0x6010, // 4096 + 16 us
        0x0005, 0x2803, // row 5, column 3 on
        0x3064, 0x4805, 0x5081, // base 100 off; of 12: 0, 2, 11; then of 8 from 112: 0 and 7
        0x6011, 0x2004, // the next microsecond, the same row, column 4 off
        0xe000, 0x7123, 0xf456, // others and what belongs to them
        0x8fff, 0x6fff, 0x2806, // the last microsecond before the counter restarts
        0x8000, 0x0007, 0x2808,
    ];
    let header = "% evt 3.0\n% format EVT3;height=480;width=640\n% end\n";
    place.write("in.raw", raw(header, &words16(&words)));
    place.ok("convert in.raw out.txt");
    let wanted = [
        "4112 3 5 1",
        "4112 100 5 0",
        "4112 102 5 0",
        "4112 111 5 0",
        "4112 112 5 0",
        "4112 119 5 0",
        "4113 4 5 0",
        "16777215 6 5 1",
        "16777216 8 7 1",
    ];
    assert_eq!(lines(&place, "out.txt"), wanted);
}

/// Conversion from format to format and back gives the same lines.
#[test]
fn a_stream_goes_through_every_format() {
    let place = Workspace::new();
    // runs of neighbours, a pixel twice in one microsecond, a gap beyond EVT 3.0's counter
    let mut text = "# t x y p in us; sensor 320x240\n".to_owned();
    for x in 10..40 {
        text += &format!("5 {x} 7 1\n");
    }
    text += "5 40 7 0\n5 40 7 1\n5 319 239 0\n4095 1 1 1\n4096 0 0 0\n40000000 2 3 1\n40000001 2 3 0\n";
    place.write("in.txt", &text);
    let chain = [
        "a.raw --codec evt2",
        "b.raw --codec evt3",
        "c.h5",
        "c.npz",
        "c.aedat4",
        "d.raw --codec evt3",
        "e.txt",
    ];
    let mut from = "in.txt".to_owned();
    for to in chain {
        place.ok(&format!("convert {from} {to}"));
        to.split(' ').next().unwrap().clone_into(&mut from);
    }
    assert_eq!(fs::read_to_string(place.path("e.txt")).unwrap(), text);
    assert_eq!(fs::read(place.path("b.raw")).unwrap(), fs::read(place.path("d.raw")).unwrap());
    // CSV keeps the sensor's size in a comment, as .txt does.
    let noted = place.ok("convert e.txt g.csv").stderr;
    assert!(!noted.contains("note:"), "{noted}");
    let noted = place.ok("convert g.csv h.txt").stderr;
    assert!(noted.contains("a sensor of 320x240") && !noted.contains("note:"), "{noted}");
    assert_eq!(fs::read_to_string(place.path("h.txt")).unwrap(), text);
}

/// The contrast of a simulation is a property of the recording and not of its events.
#[test]
fn a_contrast_without_a_place_is_a_note() {
    let place = Workspace::new();
    place.write("frames.npy", fs::read("tests/fuzz/corpus/bytes.npy").unwrap());
    place.ok("simulate --frames frames.npy --fps 100 --sensor dvs346 --out e.h5");
    for name in ["e.raw", "e.npz", "e.aedat4", "e.txt"] {
        let ended = place.ok(&format!("convert --json e.h5 {name}"));
        assert!(ended.stderr.contains("note: the contrast thresholds are not stored"), "{}", ended.stderr);
        let value: Value = serde_json::from_str(&ended.stdout).unwrap();
        assert_eq!(
            (value["lost"].as_array().map(Vec::len), value["notes"].as_array().map(Vec::len)),
            (Some(0), Some(1))
        );
        // The way back needs no --lossy either.
        assert_eq!(place.ok(&format!("convert {name} back.h5")).code, 0, "{name}");
    }
    place.ok("simulate --frames frames.npy --fps 100 --sensor dvs346 --labels --out l.h5");
    assert_eq!(place.gs2e("convert l.h5 l.raw").code, 2, "labels belong to events");
    place.ok("convert --lossy l.h5 l.raw");
}

#[test]
fn other_peoples_text_is_read() {
    let place = Workspace::new();
    let t = |text: &str, options: &str, wanted: &[&str]| {
        place.write("in.txt", text);
        place.ok(&format!("convert in.txt out.txt {options}"));
        assert_eq!(lines(&place, "out.txt"), wanted, "{text}");
    };
    // DVS-Voltmeter's: integer microseconds; the size is an option
    t("12 3 4 1\n15 3 5 0\n", "--size 346x260", &["12 3 4 1", "15 3 5 0"]);
    // E2VID's: the size, then seconds
    t(
        "240 180\n0.000012 3 4 1\n1600000000.123456 3 5 0\n",
        "--time-unit s",
        &["12 3 4 1", "1600000000123456 3 5 0"],
    );
    // names in another order, polarities of either sign, another separator
    t("x,y,polarity,timestamp\n3,4,-1,12\n3,5,1,13\n", "--size 9x9", &["12 3 4 0", "13 3 5 1"]);
    t("# a comment\n\n1.5; 3; 4; 1\n", "--size 9x9 --time-unit ms", &["1500 3 4 1"]);
}

/// Whole times without a unit are microseconds, and every verb says so. A fraction has no unit by itself.
#[test]
fn one_rule_holds_for_times_without_a_unit() {
    let place = Workspace::new();
    place.write("whole.txt", "12 3 4 1\n15 3 5 0\n");
    place.write("whole.csv", "t,x,y,p\n12,3,4,1\n15,3,5,0\n");
    place.write("decimal.txt", "0.012 3 4 1\n0.015 3 5 0\n");
    place.write("own.txt", "# t x y p in us; sensor 9x9\n12 3 4 1\n");
    let verbs = ["convert IN out.h5 --size 9x9", "info IN --size 9x9", "check --events IN --size 9x9"];
    for verb in verbs {
        let said = |file: &str, options: &str| {
            let ended = place.gs2e(&format!("{} {options}", verb.replace("IN", file)));
            (ended.code, format!("{}{}", ended.stdout, ended.stderr))
        };
        for file in ["whole.txt", "whole.csv"] {
            let (code, text) = said(file, "");
            assert!(code == 0 && text.contains("are read as microseconds"), "{verb} {file}: {text}");
            assert!(!said(file, "--time-unit ns").1.contains("are read as microseconds"), "{verb}");
        }
        assert!(!said("own.txt", "").1.contains("are read as microseconds"), "{verb}");
        let (code, text) = said("decimal.txt", "");
        assert!(code == 1 && text.contains("give its unit with --time-unit"), "{verb}: {text}");
        assert_eq!(said("decimal.txt", "--time-unit s").0, 0, "{verb}");
        // Both that is missing, at once.
        let ended = place.gs2e(&verb.replace("IN", "decimal.txt").replace(" --size 9x9", ""));
        assert!(ended.stderr.contains("--size") && ended.stderr.contains("--time-unit"), "{}", ended.stderr);
    }
}

#[test]
fn faults_are_named_and_no_file_is_written() {
    let place = Workspace::new();
    let header = "% evt 3.0\n% geometry 8x8\n% end\n";
    let t = |name: &str, bytes: &[u8], options: &str, code: i32, found: &str| {
        place.write(name, bytes);
        let ended = place.gs2e(&format!("convert {name} out.h5 {options}"));
        assert_eq!(ended.code, code, "{found}: {}", ended.stderr);
        assert!(ended.stderr.contains(found), "{found}: {}", ended.stderr);
        let left: Vec<_> = fs::read_dir(place.path("")).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.iter().all(|name| !name.to_string_lossy().contains("out")), "{left:?}");
    };
    t(
        "a.raw",
        &raw(header, &[0, 0x80, 0]),
        "",
        1,
        "byte 33: 1 bytes of a 2-byte word: the file is truncated",
    );
    t("a.raw", &raw(header, &words16(&[0x8000, 0x6000, 0x1000])), "", 1, "byte 35: a word of kind 0x1");
    t(
        "a.raw",
        &raw(header, &words16(&[0x8000, 0x0009, 0x2001])),
        "",
        1,
        "pixel (1, 9) is outside the sensor of 8x8",
    );
    // 600,000 turns of 4.8 hours
    let turns: Vec<u32> = [0x8fff_ffff, 0x8000_0000].repeat(600_000).into_iter().chain([0]).collect();
    let evt2 = raw("% evt 2.0\n% geometry 8x8\n% end\n", &words32(&turns));
    t("a.raw", &evt2, "", 1, "byte 4800031: t = 10307921510400000 us, wanted less than");
    t("a.raw", b"% evt 2.1\n% geometry 8x8\n% end\n", "", 1, "the format `2.1`, wanted EVT 2.0 or EVT 3.0");
    t("a.raw", b"% evt 3.0\n% end\n", "", 1, "the header lacks the sensor size");
    t("a.raw", b"% evt 3.0", "", 1, "the header has no end");
    t("a.txt", b"1 2 3 1\n", "", 1, "the file does not state the sensor's size: give --size WIDTHxHEIGHT");
    t("a.txt", b"1 2 3 1\n0 2 3 1\n", "--size 9x9", 1, "event 1: t = 0 us, earlier than the previous 1 us");
    t("a.txt", b"1 2 3 1\n1 9 3 1\n", "--size 9x9", 1, "line 2: x = 9, wanted 0 to 8");
    t("a.txt", b"1 2 3 2\n", "--size 9x9", 1, "line 1: p = 2, wanted 0 or 1, or -1 or 1");
    t(
        "a.txt",
        b"0.5 2 3 1\n",
        "--size 9x9",
        1,
        "line 1: t = 0.5 has a fraction: give its unit with --time-unit s, ms, us or ns",
    );
    t("a.txt", b"1 2 3\n", "--size 9x9", 1, "line 1: 3 columns, but p is expected in column 4");
    t("a.txt", b"12 9\n1 2 3 1\n", "--size 9x9", 1, "line 1: a sensor of 12x9, but --size is 9x9");
    t("a.txt", b"1500 2 3 1\n", "--size 9x9 --time-unit ns", 2, "times: 1 are truncated to the microsecond");
    t("a.csv", b"t,x,z,p\n1,2,3,1\n", "--size 9x9", 1, "line 1: no column is named y, found t, x, z, p");
    t("a.h5", b"no HDF5", "", 1, "a.h5: failed to read events");
    t("a.db3", b"SQLite format 3", "", 1, "convert it to MCAP with `rosbags-convert");
    t("a.bag", b"#ROSBAG V2.0", "", 1, "convert it to MCAP with `rosbags-convert");
    t("a.txt", b"", "--size 9", 2, "9 is not WIDTHxHEIGHT");
}
