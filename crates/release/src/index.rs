//! `index.parquet`: one row per trajectory, from which a reader chooses before downloading
//! anything. If several sensors saw a trajectory, it has one row per sensor. Each column is defined
//! once, in [`COLUMNS`], as a function of other files of the tree, so an audit can compare it with
//! them. Unknown values are null.

pub mod table;

use super::scene::{SceneRecord, SensorPart, TrajectoryPart, TrajectoryStatistics};
use gs2e_check::{Finding, Verdict};
use gs2e_num::stats::mean_median;
use gs2e_num::units::Hertz;
use gs2e_trajectory::report::SpeedReport;
use serde_json::Value as Json;
use std::collections::BTreeMap;
use table::{CellValue, ColumnKind};

/// Name of the file.
pub const NAME: &str = "index.parquet";

/// Values for the index from `speed.json` and `checks.json` of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IndexSources {
    speed_median_unit_s: Option<f64>,
    checks: usize,
    checks_passed: usize,
}

impl IndexSources {
    /// From the contents of the two files.
    #[must_use]
    pub fn from_files(report: &SpeedReport, findings: &[Finding]) -> Self {
        Self {
            speed_median_unit_s: mean_median(report.linear_unit_s.clone()),
            checks: findings.len(),
            checks_passed: findings.iter().filter(|f| f.verdict == Verdict::Pass).count(),
        }
    }
}

/// A trajectory as seen by one sensor.
#[derive(Debug)]
pub struct IndexRow<'a> {
    scene: &'a SceneRecord,
    part: &'a TrajectoryPart,
    /// The name and the part of one of several sensors.
    named: Option<(&'a str, &'a SensorPart)>,
    sources: IndexSources,
}

impl IndexRow<'_> {
    fn name(&self) -> Option<&str> {
        self.named.map(|(name, _)| name)
    }

    fn path(&self) -> String {
        format!("{}/{}", self.scene.id, self.part.name)
    }

    fn statistics(&self) -> &TrajectoryStatistics {
        self.named.map_or(&self.part.statistics, |(_, sensor)| &sensor.statistics)
    }

    fn sensor(&self) -> Option<&Json> {
        self.named.map_or(self.part.sensor.as_ref(), |(_, part)| Some(&part.sensor))
    }

    fn drawn(&self) -> Option<&BTreeMap<String, f64>> {
        self.named.map_or(self.part.drawn.as_ref(), |(_, part)| part.drawn.as_ref())
    }

    /// The first of these values that the sensor has.
    fn sensor_number(&self, pointers: &[&str]) -> Option<f64> {
        let sensor = self.sensor()?;
        pointers.iter().find_map(|pointer| sensor.pointer(pointer)?.as_f64())
    }

    fn cells(&self) -> Vec<CellValue> {
        COLUMNS.iter().map(|column| (column.value)(self)).collect()
    }
}

/// A column of the index.
#[derive(Debug)]
pub struct IndexColumn {
    /// Its name in the file.
    pub name: &'static str,
    /// Type of its cells.
    pub kind: ColumnKind,
    /// Description for people, with the unit.
    pub(super) description: &'static str,
    value: fn(&IndexRow<'_>) -> CellValue,
}

const fn index_column(
    name: &'static str,
    kind: ColumnKind,
    description: &'static str,
    value: fn(&IndexRow<'_>) -> CellValue,
) -> IndexColumn {
    IndexColumn { name, kind, description, value }
}

/// All columns, in the order of the file.
pub const COLUMNS: [IndexColumn; 36] = [
    index_column(
        "id",
        ColumnKind::Text,
        "scene/trajectory, and /sensor where there are several; unique",
        |r| r.name().map_or_else(|| r.path(), |name| format!("{}/{name}", r.path())).into(),
    ),
    index_column("scene", ColumnKind::Text, "scene id", |r| r.scene.id.as_str().into()),
    index_column("trajectory", ColumnKind::Text, "name of the trajectory", |r| r.part.name.as_str().into()),
    index_column("sensor", ColumnKind::Text, "name of the sensor, if the trajectory has several", |r| {
        r.name().into()
    }),
    index_column("path", ColumnKind::Text, "folder of the trajectory in the release", |r| r.path().into()),
    index_column("source", ColumnKind::Text, "kind of source that the poses come from", |r| {
        r.scene.source.kind.as_str().into()
    }),
    index_column("upstream_id", ColumnKind::Text, "the upstream dataset's own id of the scene", |r| {
        r.scene.source.upstream_id.as_deref().into()
    }),
    index_column("split", ColumnKind::Text, "split that the scene belongs to", |r| {
        r.scene.split.as_ref().map(|split| split.name.as_str()).into()
    }),
    index_column("licence", ColumnKind::Text, "SPDX expression of the scene", |r| {
        r.scene.licence.expression.as_str().into()
    }),
    index_column("gated", ColumnKind::Flag, "whether receivers must accept the upstream terms first", |r| {
        r.scene.licence.gated.into()
    }),
    index_column("width", ColumnKind::Whole, "width of the sensor, px", |r| {
        u64::from(r.scene.camera_of(r.part).width).into()
    }),
    index_column("height", ColumnKind::Whole, "height of the sensor, px", |r| {
        u64::from(r.scene.camera_of(r.part).height).into()
    }),
    index_column(
        "frames",
        ColumnKind::Whole,
        "number of poses; sharp/ has a picture of each, or of every n-th",
        |r| (r.part.poses as u64).into(),
    ),
    index_column("duration_us", ColumnKind::Whole, "time stamp of the last pose, us", |r| {
        r.part.duration_us.into()
    }),
    index_column("rate", ColumnKind::Number, "poses per second, Hz", |r| {
        r.part.rate.parse().ok().map(|ratio| Hertz(ratio).to_f64()).into()
    }),
    index_column("speed_profile", ColumnKind::Text, "uniform or non-uniform", |r| {
        r.scene.attributes.speed_profile.as_str().into()
    }),
    index_column(
        "speed_min_unit_s",
        ColumnKind::Number,
        "smallest speed of the camera's centre, scene units/s",
        |r| r.part.statistics.linear_unit_s.map(|range| range.min).into(),
    ),
    index_column(
        "speed_median_unit_s",
        ColumnKind::Number,
        "median speed of the camera's centre, scene units/s",
        |r| r.sources.speed_median_unit_s.into(),
    ),
    index_column(
        "speed_max_unit_s",
        ColumnKind::Number,
        "largest speed of the camera's centre, scene units/s",
        |r| r.part.statistics.linear_unit_s.map(|range| range.max).into(),
    ),
    index_column(
        "max_step_px",
        ColumnKind::Number,
        "largest optical flow between consecutive poses, px, over sampled poses",
        |r| r.part.statistics.max_step_px.map(f64::from).into(),
    ),
    index_column("blur", ColumnKind::Flag, "whether there are blurred pictures", |r| {
        r.part.blur.is_some().into()
    }),
    index_column("model", ColumnKind::Text, "sensor model", |r| {
        r.sensor().and_then(|sensor| sensor["model"].as_str()).into()
    }),
    index_column(
        "threshold_on",
        ColumnKind::Number,
        "threshold of brighter events, in the model's own unit",
        |r| r.sensor_number(&["/theta_on", "/threshold/on"]).into(),
    ),
    index_column(
        "threshold_off",
        ColumnKind::Number,
        "threshold of darker events, in the model's own unit",
        |r| r.sensor_number(&["/theta_off", "/threshold/off"]).into(),
    ),
    index_column(
        "c_on",
        ColumnKind::Number,
        "contrast threshold of brighter events, in natural logarithm of brightness",
        |r| r.sensor_number(&["/c_on"]).into(),
    ),
    index_column(
        "c_off",
        ColumnKind::Number,
        "contrast threshold of darker events, in natural logarithm of brightness",
        |r| r.sensor_number(&["/c_off"]).into(),
    ),
    index_column(
        "drawn",
        ColumnKind::Text,
        "numbers of the sensor that were drawn for the trajectory, as JSON by path",
        |r| r.drawn().map(|drawn| serde_json::json!(drawn).to_string()).into(),
    ),
    index_column("events", ColumnKind::Whole, "number of events", |r| r.statistics().events.into()),
    index_column("on_share", ColumnKind::Number, "share of brighter events", |r| {
        let TrajectoryStatistics { events, on, .. } = r.statistics();
        events.filter(|events| *events > 0).zip(*on).map(|(events, on)| on as f64 / events as f64).into()
    }),
    index_column("rate_ev_px_s", ColumnKind::Number, "events per pixel and second", |r| {
        r.statistics().rate_ev_px_s.into()
    }),
    index_column("peak_ev_per_ms", ColumnKind::Whole, "most events in one millisecond", |r| {
        r.statistics().peak_ev_per_ms.into()
    }),
    // Text: a seed can exceed a signed number of 64 bits.
    index_column("seed", ColumnKind::Text, "the recipe's seed, a 64-bit number in decimal", |r| {
        r.scene.seed.to_string().into()
    }),
    index_column("gaussians", ColumnKind::Whole, "number of Gaussians of the scene", |r| {
        r.scene.reconstruction.as_ref().map(|it| it.gaussians).into()
    }),
    index_column("checks", ColumnKind::Whole, "number of records in checks.json", |r| {
        (r.sources.checks as u64).into()
    }),
    index_column("checks_passed", ColumnKind::Whole, "number of those records that passed", |r| {
        (r.sources.checks_passed as u64).into()
    }),
    index_column("recipe_sha256", ColumnKind::Text, "SHA-256 of the recipe as compact JSON", |r| {
        r.scene.recipe_sha256.as_str().into()
    }),
];

/// The rows of a scene. The second argument has one element per trajectory, in their order.
pub fn scene_rows<'a>(scene: &'a SceneRecord, sources: &[IndexSources]) -> Vec<IndexRow<'a>> {
    let mut rows = Vec::new();
    // The body of a rig sees nothing; its cameras have rows.
    let seen = scene.trajectories.iter().zip(sources).filter(|(part, _)| part.cameras.is_empty());
    for (part, sources) in seen {
        let mut add = |named| rows.push(IndexRow { scene, part, named, sources: *sources });
        // One sensor alone has no name. A trajectory without events has a row too.
        if part.sensors.is_empty() {
            add(None);
        }
        part.sensors.iter().for_each(|(name, sensor)| add(Some((name, sensor))));
    }
    rows
}

/// The cells of all rows, sorted by scene, trajectory and sensor.
pub fn sorted_cells(mut rows: Vec<IndexRow<'_>>) -> Vec<Vec<CellValue>> {
    let place =
        |row: &IndexRow<'_>| (row.scene.id.clone(), row.part.name.clone(), row.name().map(str::to_owned));
    rows.sort_by_cached_key(place);
    rows.iter().map(IndexRow::cells).collect()
}

/// Composes the file.
pub(super) fn compose_index(rows: Vec<IndexRow<'_>>) -> Vec<u8> {
    let columns = COLUMNS.each_ref().map(|column| (column.name, column.kind));
    table::write_table(&columns, &sorted_cells(rows), super::TOOL)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn columns_have_names_of_their_own() {
        let names: BTreeSet<&str> = COLUMNS.iter().map(|column| column.name).collect();
        assert_eq!(names.len(), COLUMNS.len());
    }
}
