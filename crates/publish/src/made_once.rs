//! Files that a release makes of a scene's files and keeps in the store, like the outputs of a step.

use super::ReleaseError;
use gs2e_release::composed::ReleaseTree;
use gs2e_release::manifest::KeyIngredients;
use gs2e_release::{TOOL, checksum};
use gs2e_store::description::DescribedValue;
use gs2e_store::record::{StepProvenance, StepRecord, StoredOutput};
use gs2e_store::{BlobState, Digest, Key, Store};
use std::collections::BTreeMap;
use std::path::Path;

/// Digest of the files of a scene, by their paths and contents.
pub(super) fn digest_of_files(files: &ReleaseTree) -> Digest {
    let listing = files.listing();
    let sums = listing.iter().map(|file| (file.path.as_str(), file.blake3.to_string()));
    Digest::of_bytes(checksum::sums_text(sums).as_bytes())
}

/// Everything that decides the bytes of the files that are made.
#[derive(Debug)]
pub(super) struct FileInputs {
    pub(super) stage: &'static str,
    pub(super) revision: u32,
    pub(super) parameters: DescribedValue,
    /// [`digest_of_files`] of the scene.
    pub(super) files: Digest,
}

impl FileInputs {
    /// The stored files and the key of their record. If they are not stored, `make` writes them to a
    /// workspace.
    pub(super) fn outputs(
        self,
        store: &Store,
        make: impl FnOnce(&Path) -> Result<(), ReleaseError>,
    ) -> Result<(Key, Vec<StoredOutput>), ReleaseError> {
        let Self { stage, revision, parameters, files } = self;
        let inputs = BTreeMap::from([("files of the scene".to_owned(), files)]);
        let made_of = KeyIngredients { revision, class: None, params: parameters, inputs };
        let description = made_of.description(stage);
        let key = Key::of_description(&description);
        if let Some(record) = store.record(&key)? {
            let sound = |output| store.examine(output).map(|state| state == BlobState::Sound);
            if record.outputs.iter().map(sound).collect::<Result<Vec<_>, _>>()?.into_iter().all(|is| is) {
                return Ok((key, record.outputs));
            }
        }
        let workspace = store.workspace()?;
        make(workspace.path())?;
        let provenance = StepProvenance { tool: TOOL.to_owned(), threads: 1, ..StepProvenance::default() };
        let record = StepRecord::new(key, stage, description.lines(), provenance);
        Ok((key, store.publish(&workspace, record)?))
    }
}
