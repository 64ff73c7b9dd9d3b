//! The files at the top of a release, composed from its scenes.

use super::composed::{FileContent, ReleaseTree};
use super::croissant::DescribedRelease;
use super::facts::ReleaseFacts;
use super::published::{PublishedScene, PublishedTrajectory, StoredPlaces};
use super::scene::SceneRecord;
use super::{card, checksum, croissant, datasheet, index, layout, loader, manifest, report, reuse};
use gs2e_source::licence::ComposedTerms;
use std::collections::BTreeSet;

/// The combined terms of all scenes.
pub fn terms_of(scenes: &[PublishedScene]) -> ComposedTerms {
    gs2e_source::licence::compose_all(scenes.iter().map(|scene| &scene.licence))
}

/// Composes the files at the top of the tree, except for the manifest and the sums.
pub fn compose_top(facts: &ReleaseFacts<'_>, places: StoredPlaces<'_>) -> ReleaseTree {
    let ReleaseFacts { scenes, info, licence, .. } = *facts;
    let mut top = ReleaseTree::default();
    top.add(layout::CARD.into(), FileContent::Bytes(card::compose_card(facts).into_bytes()));
    top.add(datasheet::NAME.into(), FileContent::Bytes(datasheet::compose_datasheet(facts).into_bytes()));
    let files: Vec<&SceneRecord> = scenes.iter().map(|scene| &scene.file).collect();
    let reuse = reuse::compose_reuse(&files, &licence.expression);
    top.add(reuse::NAME.into(), FileContent::Bytes(reuse.into_bytes()));
    // The loader has terms of its own, which no scene brings.
    for id in licence.ids.iter().cloned().chain(loader::licence_ids()).collect::<BTreeSet<_>>() {
        let text = gs2e_source::licence::licence_text(&id, &sorted_holders(scenes));
        top.add(layout::licence_text(&id), FileContent::Bytes(text.into_bytes()));
    }
    top.add(loader::NAME.into(), FileContent::Bytes(loader::TEXT.into()));
    let index = index_of(scenes);
    let paths = scenes.iter().flat_map(|scene| &scene.files).map(|file| file.path.clone()).collect();
    let release =
        DescribedRelease { info, licence: &licence.expression, scenes: &files, paths, index: &index };
    top.add(croissant::NAME.into(), FileContent::json(&croissant::compose_croissant(&release)));
    top.add(index::NAME.into(), FileContent::Bytes(index));
    // Last, because it links to every other file.
    let others = [manifest::NAME, checksum::NAME, checksum::B3_NAME].map(str::to_owned);
    let linked = top.paths().map(str::to_owned).chain(others).collect();
    top.add(
        report::NAME.into(),
        FileContent::Bytes(report::compose_page(facts, linked, places).into_bytes()),
    );
    top
}

/// The holders of the owners' parts, sorted.
fn sorted_holders(scenes: &[PublishedScene]) -> Vec<String> {
    let licences = scenes.iter().filter_map(|scene| scene.recipe.licence.as_ref());
    let holders: BTreeSet<&String> = licences.map(|licence| &licence.holder).collect();
    holders.into_iter().cloned().collect()
}

fn index_of(scenes: &[PublishedScene]) -> Vec<u8> {
    let sources_of = |t: &PublishedTrajectory| index::IndexSources::from_files(&t.motion.report, &t.findings);
    let rows = scenes.iter().flat_map(|scene| {
        let sources: Vec<index::IndexSources> = scene.trajectories.iter().map(sources_of).collect();
        index::scene_rows(&scene.file, &sources)
    });
    index::compose_index(rows.collect())
}
