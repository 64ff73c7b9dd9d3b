//! Comparison of `index.parquet` with the files whose content it repeats.

use super::{AuditFault, FaultCode, TrustedTree, claims};
use gs2e_check::Finding;
use gs2e_release::index;
use gs2e_release::index::table::IndexTable;
use gs2e_release::index::{COLUMNS, IndexSources, NAME, table};
use gs2e_release::scene::SceneRecord;
use gs2e_trajectory::report::SpeedReport;

/// Reads the index, if it is intact. A fault of the file itself is added to `faults`.
pub(super) fn read_index(tree: &TrustedTree<'_>, faults: &mut Vec<AuditFault>) -> Option<IndexTable> {
    let table = table::read_table(&tree.intact_path(NAME)?).map_err(|e| e.to_string());
    table.map_err(|message| faults.push(AuditFault::of_file(FaultCode::Unreadable, NAME, message))).ok()
}

/// Compares the cells with the scenes. All scenes must be given. Nothing is reported if a file that
/// the index repeats could not be read, since that is a fault already.
pub(super) fn compare_index(
    tree: &TrustedTree<'_>,
    table: &IndexTable,
    scenes: &[SceneRecord],
) -> Vec<AuditFault> {
    let disagrees = |message: String| vec![AuditFault::of_file(FaultCode::ClaimsDisagree, NAME, message)];
    let names = || table.columns.iter().map(|(name, kind)| (name.as_str(), *kind));
    if !names().eq(COLUMNS.iter().map(|column| (column.name, Some(column.kind)))) {
        let found: Vec<&str> = names().map(|(name, _)| name).collect();
        return disagrees(format!("its columns differ from this release format: {}", found.join(", ")));
    }
    let Some(sources) = scenes.iter().map(|scene| index_sources(tree, scene)).collect::<Option<Vec<_>>>()
    else {
        return Vec::new();
    };
    let rows = scenes.iter().zip(&sources).flat_map(|(scene, sources)| index::scene_rows(scene, sources));
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

/// The name of a row, which is its first cell.
fn name_of(row: &[table::CellValue]) -> String {
    row.first().map_or_else(String::new, ToString::to_string)
}

/// Reads what the index repeats of the trajectories' own files. Returns `None` if one of them
/// cannot be read.
fn index_sources(tree: &TrustedTree<'_>, scene: &SceneRecord) -> Option<Vec<IndexSources>> {
    // The audit of the contents has reported the faults of these files.
    let said_elsewhere = &mut Vec::new();
    let mut of = |name: &str| {
        let path = |file: &str| format!("{}/{name}/{file}", scene.id);
        let report: SpeedReport = claims::parse_claims(tree, &path("speed.json"), said_elsewhere)?;
        let findings: Vec<Finding> = claims::parse_claims(tree, &path("checks.json"), said_elsewhere)?;
        Some(IndexSources::from_files(&report, &findings))
    };
    scene.trajectories.iter().map(|part| of(&part.name)).collect()
}
