//! Every format, read back bit for bit by the field's own programs:
//! `../shared/tools/check_events.py` compares count, order, positions, polarities and times with
//! the stream itself.
//!
//! The table below lists the readers of each format. If Python lacks one, a message goes to stderr;
//! with `REQUIRE_READERS=1` that is a failure.

use crate::support::absent::absent;
use crate::support::foreign::python;
use crate::support::shared;
use crate::support::workspace::Workspace;
use serde_json::Value;

/// File, options of its writing, and its readers.
const WANTED: [(&str, &str, &[&str]); 5] = [
    ("e.h5", "", &["h5py", "evutils", "evlib", "eventcv"]),
    ("evt2.raw", "--codec evt2", &["evutils", "expelliarmus", "faery", "evlib", "eventcv"]),
    // expelliarmus gives times of EVT 3.0 that are off by multiples of 4,096 us, for files of any
    // writer.
    ("evt3.raw", "--codec evt3", &["evt3", "faery", "evlib", "eventcv"]),
    ("e.aedat4", "", &["dv_processing", "aedat", "tonic", "eventcv", "faery"]),
    ("e.npz", "", &["numpy", "evutils"]),
];

/// Filters of HDF5 files, including two that need a plug-in. h5py reads a file of each.
const FILTERS: [&str; 4] = ["none", "gzip:1", "zstd", "lz4"];

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;
const EVENTS: u32 = 60_000;

/// Events at places without a pattern, several per microsecond and then none for a long time, in
/// file order.
fn stream() -> String {
    let mut events: Vec<[u32; 4]> = (0..EVENTS)
        .map(|i| {
            let hash = i.wrapping_mul(2_654_435_769) >> 8;
            let t = i / 3 + 70_000 * (i / 20_000);
            [t, hash / WIDTH % HEIGHT, hash % WIDTH, hash >> 20 & 1]
        })
        .collect();
    events.sort_unstable();
    let mut text = format!("# t x y p in us; sensor {WIDTH}x{HEIGHT}\n");
    events.iter().for_each(|[t, y, x, p]| text += &format!("{t} {x} {y} {p}\n"));
    text
}

/// The verdicts of the readers of a file: name, verdict, and reason.
fn verdicts(place: &Workspace, name: &str, readers: &[&str]) -> Option<Vec<(String, String, String)>> {
    let tool = shared::path("tools/check_events.py")?;
    let path = |name: &str| place.path(name).display().to_string();
    let (report, only) = (path("report.json"), readers.join(","));
    let (width, height) = (WIDTH.to_string(), HEIGHT.to_string());
    let (tool, file, reference) = (tool.display().to_string(), path(name), path("reference.npz"));
    let sized = ["--size", &width, &height, "--only", &only, "--json", &report, "--timeout", "60"];
    let args = [&[tool.as_str(), &file, "--ref", &reference], &sized[..]].concat();
    let output = python(&args).expect("Python starts");
    let seen = String::from_utf8_lossy(&output.stdout).into_owned();
    let report: Value = serde_json::from_slice(&std::fs::read(report).expect(&seen)).unwrap();
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let of = |reader: &&str| {
        let found = &report["readers"][reader];
        let why = [&found["skip"], &found["error"]].map(text).concat();
        (format!("{name} by {reader}"), text(&found["verdict"]), why)
    };
    Some(readers.iter().map(of).collect())
}

#[test]
fn foreign_readers_read_the_written_events() {
    if shared::path("tools/check_events.py").is_none() {
        return;
    }
    if !python(&["-c", "import numpy"]).is_some_and(|output| output.status.success()) {
        return absent("REQUIRE_READERS", "python3 with numpy is absent");
    }
    let place = Workspace::new();
    place.write("in.txt", stream());
    place.ok("convert in.txt reference.npz --lossy");
    let mut found = Vec::new();
    for (name, options, readers) in WANTED {
        place.ok(&format!("convert in.txt {name} --lossy {options}"));
        found.extend(verdicts(&place, name, readers).unwrap());
    }
    for filter in FILTERS {
        let name = format!("{}.h5", filter.replace(':', "-"));
        place.ok(&format!("convert in.txt {name} --h5-filter {filter}"));
        found.extend(verdicts(&place, &name, &["h5py"]).unwrap());
    }
    let (skipped, tried): (Vec<_>, Vec<_>) = found.into_iter().partition(|(_, verdict, _)| verdict == "SKIP");
    let wrong: Vec<_> = tried.iter().filter(|(_, verdict, _)| verdict != "OK").collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    for (what, _, why) in &skipped {
        absent("REQUIRE_READERS", &format!("{what}: {why}"));
    }
}
