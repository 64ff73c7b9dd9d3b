//! `index.parquet`: its rows match the recipe and the files, and it is the same on every machine.

use crate::release::small::{copy, gs2e, release};
use crate::support::workspace::{Workspace, tiny_with};
use gs2e_event::{EventSource as _, h5};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;

type Row = BTreeMap<String, Field>;

fn reader(release: &Path) -> SerializedFileReader<File> {
    SerializedFileReader::new(File::open(release.join("index.parquet")).unwrap()).unwrap()
}

fn rows(release: &Path) -> Vec<Row> {
    let rows = reader(release);
    let rows = rows.get_row_iter(None).unwrap();
    rows.map(|row| row.unwrap().into_columns().into_iter().collect()).collect()
}

fn text(row: &Row, column: &str) -> Option<String> {
    match &row[column] {
        Field::Str(text) => Some(text.clone()),
        Field::Null => None,
        other => panic!("{column} is {other:?}"),
    }
}

fn whole(row: &Row, column: &str) -> i64 {
    let Field::Long(value) = row[column] else { panic!("{column} is {:?}", row[column]) };
    value
}

fn number(row: &Row, column: &str) -> f64 {
    let Field::Double(value) = row[column] else { panic!("{column} is {:?}", row[column]) };
    value
}

/// Number of events in a stream, and number of ON events.
fn counted(path: &Path) -> (i64, i64) {
    let mut reader = h5::Reader::open(path).unwrap();
    let (mut chunk, mut all, mut on) = (Vec::new(), 0, 0);
    while reader.next_chunk(&mut chunk).unwrap() {
        all += i64::try_from(chunk.len()).unwrap();
        on += chunk.iter().map(|event| i64::from(event.polarity == gs2e_event::Polarity::On)).sum::<i64>();
    }
    (all, on)
}

#[test]
fn rows_agree_with_the_recipe_and_the_files() {
    let rows = rows(release());
    assert_eq!(rows.len(), 2);
    for (row, (name, poses)) in rows.iter().zip([("base", 24), ("slow", 36)]) {
        let folder = format!("small/one/{name}");
        let wanted = [
            ("id", Some(folder.as_str())),
            ("path", Some(&folder)),
            ("scene", Some("small/one")),
            ("trajectory", Some(name)),
            ("sensor", None),
            ("source", Some("procedural")),
            ("upstream_id", None),
            ("split", None),
            ("licence", Some("CC0-1.0")),
            ("model", Some("voltmeter")),
            ("seed", Some("7")),
        ];
        wanted
            .iter()
            .for_each(|(column, value)| assert_eq!(text(row, column).as_deref(), *value, "{column}"));
        assert_eq!([whole(row, "width"), whole(row, "height"), whole(row, "frames")], [64, 48, poses]);
        assert_eq!((&row["gated"], &row["blur"]), (&Field::Bool(false), &Field::Bool(true)));
        let asked = [("rate", 2400.0), ("threshold_on", 1.0), ("threshold_off", 1.0)];
        asked.iter().for_each(|(column, value)| assert_eq!(row[*column], Field::Double(*value), "{column}"));
        // The threshold divided by the gain k1 of the preset.
        assert!((number(row, "c_on") - 1.0 / 5.265).abs() < 1e-15);
        // Pose j is at j / 2400 s, rounded half up.
        assert_eq!(whole(row, "duration_us"), ((poses - 1) * 1_000_000 * 2 + 2400) / 4800);
        let (all, on) = counted(&release().join(&folder).join("events.h5"));
        assert!(all > 0);
        assert_eq!(whole(row, "events"), all);
        assert!((number(row, "on_share") * all as f64 - on as f64).abs() < 1e-9);
        let checks = fs::read(release().join(&folder).join("checks.json")).unwrap();
        let checks: Vec<serde_json::Value> = serde_json::from_slice(&checks).unwrap();
        let passed = checks.iter().filter(|finding| finding["verdict"] == "pass").count();
        assert_eq!(
            [whole(row, "checks"), whole(row, "checks_passed")],
            [checks.len(), passed].map(|n| i64::try_from(n).unwrap())
        );
        speeds(row, &release().join(&folder));
    }
    assert_eq!(text(&rows[0], "speed_profile").as_deref(), Some("non-uniform"));
}

/// Checks that half of the steps are slower than the median, and no step is beyond the extremes.
fn speeds(row: &Row, folder: &Path) {
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("speed.json")).unwrap()).unwrap();
    let speeds: Vec<f64> =
        report["linear_unit_s"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let [min, median, max] =
        ["min", "median", "max"].map(|which| number(row, &format!("speed_{which}_unit_s")));
    assert!(speeds.iter().all(|speed| (min..=max).contains(speed)));
    assert!(speeds.contains(&min) && speeds.contains(&max));
    let below = speeds.iter().filter(|speed| **speed < median).count();
    let above = speeds.iter().filter(|speed| **speed > median).count();
    assert_eq!(below, above);
}

#[test]
fn the_file_is_one_row_group_of_zstd_without_a_time() {
    let reader = reader(release());
    let file = reader.metadata();
    assert_eq!(file.num_row_groups(), 1);
    for column in file.row_group(0).columns() {
        assert!(matches!(column.compression(), parquet::basic::Compression::ZSTD(_)), "{column:?}");
    }
    let described = file.file_metadata();
    assert_eq!(described.created_by(), Some(concat!("gs2e ", env!("CARGO_PKG_VERSION"))));
    assert_eq!(described.key_value_metadata(), None);
}

#[test]
fn scenes_and_sensors_are_sorted_and_a_second_release_is_the_same() {
    let place = Workspace::new();
    let sensors = "sensors:\n  usual: { v2e: { preset: clean } }\n  fine: { esim: { threshold: { on: 0.3, off: 0.2 } } }\n";
    let several = tiny_with(sensors);
    place.write("recipes/b.yaml", several.replace("scene: tiny", "scene: a/tiny"));
    place.write("recipes/a.yaml", several.replace("outputs: [events, sharp]", "outputs: [sharp]"));
    place.ok("release --to one recipes");
    place.ok("release --to two recipes --store elsewhere");
    let [one, two] = ["one", "two"].map(|tree| fs::read(place.path(tree).join("index.parquet")).unwrap());
    assert!(one == two);
    let rows = rows(&place.path("one"));
    let ids: Vec<String> = rows.iter().map(|row| text(row, "id").unwrap()).collect();
    assert_eq!(ids, ["a/tiny/base/fine", "a/tiny/base/usual", "tiny/base"]);
    assert_eq!(text(&rows[0], "sensor").as_deref(), Some("fine"));
    let thresholds = [&rows[0]["threshold_on"], &rows[0]["threshold_off"]];
    assert_eq!(thresholds, [&Field::Double(0.3), &Field::Double(0.2)]);
    let stream = place.path("one/a/tiny/base/events/fine.h5");
    assert_eq!(whole(&rows[0], "events"), counted(&stream).0);
    assert_eq!([&rows[2]["events"], &rows[2]["model"], &rows[2]["c_on"]], [&Field::Null; 3]);
    place.ok("audit one");
}

#[test]
fn a_release_without_an_index_is_faulty() {
    let folder = copy();
    fs::remove_file(folder.path().join("index.parquet")).unwrap();
    assert_eq!(gs2e(folder.path(), &["audit", "."]).status.code(), Some(3));
}
