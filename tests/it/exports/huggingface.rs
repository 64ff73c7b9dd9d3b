//! The layouts for networks, read by Hugging Face `datasets`: every event and every frame.
//!
//! If Python lacks `datasets`, a message goes to stderr; with `REQUIRE_DATASETS=1` that is a failure.

use super::{TestExport, plane, samples};
use crate::support::absent::absent;
use gs2e_event::Polarity;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Loads both exports, and compares events, stamps, pictures and descriptions with each other and with the
/// stream, whose numbers t, x, y, p are in a file of int64.
const READ: &str = "
import glob, json, sys
import numpy as np
from datasets import Image, load_dataset

table, tars, truth, frames = sys.argv[1:]
truth = np.fromfile(truth, '<i8').reshape(-1, 4)

def events(window, start):
    columns = [np.asarray(window[name]).astype(np.int64) for name in 'txyp']
    return np.stack([columns[0] + start] + columns[1:], axis=1)

def of_table(split):
    rows = load_dataset(table, split=split)
    assert isinstance(rows.features['sharp'], Image), rows.features
    for row in rows:
        described = json.loads(row['description'])
        assert (described['t0_us'], described['t1_us']) == (row['t0_us'], row['t1_us'])
        yield described, events(row, row['t0_us']), np.asarray(row['sharp'])

def of_tars(split):
    files = sorted(glob.glob(f'{tars}/{split}-*.tar'))
    for row in load_dataset('webdataset', data_files={split: files}, split=split, streaming=True):
        yield row['json'], events(row['events.npz'], row['json']['t0_us']), np.asarray(row['sharp.png'])

def all_windows(read):
    windows = [window for split in ('train', 'test') for window in read(split)]
    return sorted(windows, key=lambda window: window[0]['t0_us'])

first, second = all_windows(of_table), all_windows(of_tars)
assert len(first) == len(second) == int(frames) - 1
for (a, b) in zip(first, second):
    assert a[0] == b[0] and np.array_equal(a[1], b[1]) and np.array_equal(a[2], b[2])
    assert a[2].shape == (a[0]['height'], a[0]['width'], 3) and a[2].dtype == np.uint8
for windows in first, second:
    assert np.array_equal(np.concatenate([window[1] for window in windows]), truth)
print(len(truth), 'events in', len(first), 'windows')
";

fn python(script: &str, args: &[PathBuf], home: &Path) -> Option<Output> {
    let mut command = Command::new("python3");
    // The library keeps converted copies, and must not ask its hub.
    command.args(["-c", script]).args(args).env("HF_HOME", home);
    command.env("HF_HUB_OFFLINE", "1").env("HF_DATASETS_OFFLINE", "1").output().ok()
}

#[test]
fn datasets_reads_every_event_of_both_layouts() {
    let home = tempfile::tempdir().unwrap();
    if !python("import datasets, PIL", &[], home.path()).is_some_and(|output| output.status.success()) {
        return absent("REQUIRE_DATASETS", "python3 with datasets and Pillow is absent");
    }
    let plane = plane::half_pixel();
    let [table, tars] = ["parquet", "webdataset"].map(|format| TestExport::of(plane, format, &[]));
    let truth = home.path().join("truth");
    let numbers = samples::stream(plane).into_iter().flat_map(|event| {
        let p = i64::from(event.polarity == Polarity::On);
        [event.t.floor_micros(), event.x.into(), event.y.into(), p]
    });
    std::fs::write(&truth, numbers.flat_map(i64::to_le_bytes).collect::<Vec<u8>>()).unwrap();
    let frames = plane::POSES.div_ceil(plane.sharp_every).to_string();
    let args = [table.path(""), tars.path(""), truth, PathBuf::from(frames)];
    let output = python(READ, &args, home.path()).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    eprint!("datasets: {}", String::from_utf8_lossy(&output.stdout));
}
