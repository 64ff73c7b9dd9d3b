//! `index.parquet` against the files whose content it repeats.

use super::{Code, Fault, Tree, claims};
use crate::check::Finding;
use crate::release::index::table::{self, Table};
use crate::release::index::{self, COLUMNS, NAME, Told};
use crate::release::scene::SceneFile;
use crate::trajectory::report::Report;

/// Reads the index; what is wrong with the file itself is a fault.
pub(super) fn read_index(tree: &Tree<'_>, faults: &mut Vec<Fault>) -> Option<Table> {
    if !tree.has(NAME) {
        faults.push(Fault::of_file(
            Code::Missing,
            NAME,
            "a release has one, and it is not there, or not whole",
        ));
        return None;
    }
    let table = table::read_table(&tree.path_of(NAME)).map_err(|e| e.to_string());
    table.map_err(|message| faults.push(Fault::of_file(Code::Unreadable, NAME, message))).ok()
}

/// Holds its cells against the scenes, all of which are given: nothing is said where one of them, or a file that the
/// index repeats, could not be read, since that is a fault already.
pub(super) fn compare_index(tree: &Tree<'_>, table: &Table, scenes: &[SceneFile]) -> Vec<Fault> {
    let disagrees = |message: String| vec![Fault::of_file(Code::ClaimsDisagree, NAME, message)];
    let names = || table.columns.iter().map(|(name, kind)| (name.as_str(), *kind));
    if !names().eq(COLUMNS.iter().map(|column| (column.name, Some(column.kind)))) {
        let found: Vec<&str> = names().map(|(name, _)| name).collect();
        return disagrees(format!("its columns are not those of this release format: {}", found.join(", ")));
    }
    let Some(told) = scenes.iter().map(|scene| index_sources(tree, scene)).collect::<Option<Vec<_>>>() else {
        return Vec::new();
    };
    let rows = scenes.iter().zip(&told).flat_map(|(scene, told)| index::scene_rows(scene, told));
    let wanted = index::sorted_cells(rows.collect());
    if table.rows.len() != wanted.len() {
        return disagrees(format!("it has {} rows, the scenes have {}", table.rows.len(), wanted.len()));
    }
    let mut faults = Vec::new();
    for (row, wanted) in table.rows.iter().zip(&wanted) {
        let cells = COLUMNS.iter().zip(row.iter().zip(wanted));
        for (column, (found, wanted)) in cells.filter(|(_, (found, wanted))| found != wanted) {
            let message = format!("{} of {} is {found}, the scenes say {wanted}", column.name, name_of(row));
            faults.extend(disagrees(message));
        }
    }
    faults
}

/// The row's name for itself.
fn name_of(row: &[table::Value]) -> String {
    row.first().map_or_else(String::new, ToString::to_string)
}

/// What the trajectories' own files tell; `None` where one of them cannot be read.
fn index_sources(tree: &Tree<'_>, scene: &SceneFile) -> Option<Vec<Told>> {
    let said_elsewhere = &mut Vec::new();
    let mut of = |name: &str| {
        let path = |file: &str| format!("{}/{name}/{file}", scene.id);
        let report: Report = claims::parse_claims(tree, &path("speed.json"), said_elsewhere)?;
        let findings: Vec<Finding> = claims::parse_claims(tree, &path("checks.json"), said_elsewhere)?;
        Some(Told::from_files(&report, &findings))
    };
    scene.trajectories.iter().map(|part| of(&part.name)).collect()
}
