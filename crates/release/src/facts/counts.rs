//! Contents of a release by number.

use super::ReleaseFacts;
use crate::products;
use crate::products::{FOLDERS, ReleaseProduct};
use crate::published::PublishedScene;
use crate::scene::{TrajectoryPart, TrajectoryStatistics};
use gs2e_recipe::OutputKind;
use std::collections::BTreeMap;

/// The streams of a trajectory, by their statistics.
fn streams(part: &TrajectoryPart) -> impl Iterator<Item = &TrajectoryStatistics> {
    let one = part.sensor.iter().map(|_| &part.statistics);
    one.chain(part.sensors.values().map(|sensor| &sensor.statistics))
}

/// Contents of the tree by number. Withheld files do not count.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct FileCounts {
    pub(crate) scenes: usize,
    pub(crate) trajectories: usize,
    pub(crate) poses: usize,
    pub(crate) events: u64,
    /// Files of each product: its event streams, or its pictures.
    files: BTreeMap<OutputKind, usize>,
    /// Scenes without any file that shows them, because the upstream forbids redistribution.
    pub(crate) withheld: usize,
}

impl FileCounts {
    /// Number of files of a product.
    pub(crate) fn files(&self, product: &ReleaseProduct) -> usize {
        self.files.get(&product.output).copied().unwrap_or_default()
    }

    /// Returns true if the release has files of a product.
    pub(crate) fn has(&self, product: &ReleaseProduct) -> bool {
        self.files(product) > 0
    }
}

impl ReleaseFacts<'_> {
    pub(crate) fn counts(&self) -> FileCounts {
        let included = || self.scenes.iter().filter(|scene| !scene.is_withheld());
        let streams = || included().flat_map(|scene| &scene.file.trajectories).flat_map(streams);
        // Of withheld scenes too: their poses are released, unlike their events and pictures.
        let paths = || self.scenes.iter().flat_map(|scene| &scene.file.trajectories);
        let pictures = |product: &ReleaseProduct| -> usize {
            let of = |scene: &PublishedScene| -> usize {
                let paths = scene.file.trajectories.iter();
                paths.map(|part| scene.in_folder(&part.name, product.name()).count()).sum()
            };
            included().map(of).sum()
        };
        let mut files: BTreeMap<OutputKind, usize> =
            FOLDERS.iter().map(|product| (product.output, pictures(product))).collect();
        files.insert(products::EVENTS.output, streams().count());
        FileCounts {
            scenes: self.scenes.len(),
            trajectories: paths().count(),
            poses: paths().map(|part| part.poses).sum(),
            events: streams().filter_map(|counted| counted.events).sum(),
            files,
            withheld: self.scenes.len() - included().count(),
        }
    }

    /// The contents in words, each kind with its number: `12 events, 3 sharp frames`.
    pub(crate) fn contents(&self) -> String {
        let counts = self.counts();
        let counted = |product: &ReleaseProduct| format!("{} {}", counts.files(product), product.noun);
        let streams = [&products::EVENTS].into_iter().filter(|product| counts.has(product));
        let pictures = FOLDERS.into_iter().filter(|product| counts.has(product));
        let mut words = vec![format!("{} poses", counts.poses)];
        words.extend(streams.map(|product| format!("{} events in {}", counts.events, counted(product))));
        words.extend(pictures.map(counted));
        words.join(", ")
    }
}
