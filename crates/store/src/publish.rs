//! Publication of a step's files as blobs and a record.

use super::blob::FinishedBlob;
use super::record::{StepRecord, StoredOutput};
use super::state::StateTable;
use super::{BlobState, OutputMismatch, Store, StoreError, TMP, unlike};
use std::path::{Path, PathBuf};

impl Store {
    /// Creates an empty folder for the files of a step.
    ///
    /// # Errors
    /// It cannot be created.
    pub fn workspace(&self) -> Result<StepWorkspace<'_>, StoreError> {
        let path = self.blobs.fresh(TMP);
        self.disk.create_dir(&path)?;
        Ok(StepWorkspace { path, store: self })
    }

    /// Publishes the files of a workspace as the outputs of `record`: blobs, then the record, then
    /// the index.
    ///
    /// # Errors
    /// A file cannot be read or written, or the key is recorded with other bytes. If those are
    /// intact, nothing is published; if they are lost, the new ones replace them.
    pub fn publish(
        &self,
        workspace: &StepWorkspace<'_>,
        record: StepRecord,
    ) -> Result<Vec<StoredOutput>, StoreError> {
        let files = self.blobs.finish(workspace.path())?;
        self.publish_files(workspace, &files, record)
    }

    /// Publishes the finished files of a workspace.
    pub(super) fn publish_files(
        &self,
        workspace: &StepWorkspace<'_>,
        files: &[FinishedBlob],
        mut record: StepRecord,
    ) -> Result<Vec<StoredOutput>, StoreError> {
        record.outputs = files.iter().map(|file| file.output.clone()).collect();
        // Before the files, which may be there and make room for others at this moment.
        self.hold(&record.key, &record.outputs);
        let before = self.full_record(&record.key)?.filter(|before| before.outputs != record.outputs);
        if let Some(before) = &before
            && before.outputs.iter().all(|o| matches!(self.examine(o), Ok(BlobState::Sound)))
        {
            // Intact bytes stay: keys of later steps contain their digest.
            return Err(self.nondeterministic(workspace, before.clone(), record, false));
        }
        // While the files of both are in place.
        let unlike = before.map(|before| self.nondeterministic(workspace, before, record.clone(), true));
        let ours = files.iter().map(|file| self.blobs.publish(file)).collect::<Result<Vec<bool>, _>>()?;
        // After the blobs, so that no record names bytes that are not there.
        record.write(&self.root, &self.disk)?;
        for (output, _) in record.outputs.iter().zip(ours).filter(|(_, is_ours)| *is_ours) {
            // Its name was new, so its stat fields are reliable at once. An existing blob keeps its
            // own state.
            self.settle(&output.digest)?;
        }
        // Last, because the index must not name a record that is not there.
        self.state().put(StateTable::Record, &record.key.to_string(), record.brief().row());
        unlike.map_or(Ok(record.outputs), Err)
    }

    /// Compares the files of a workspace with the record of a key, and publishes nothing.
    ///
    /// # Errors
    /// A file cannot be read, or the bytes differ.
    pub fn compare(&self, workspace: &StepWorkspace<'_>, mut record: StepRecord) -> Result<(), StoreError> {
        let files = self.blobs.finish(workspace.path())?;
        record.outputs = files.iter().map(|file| file.output.clone()).collect();
        match self.full_record(&record.key)?.filter(|before| before.outputs != record.outputs) {
            Some(before) => Err(self.nondeterministic(workspace, before, record, false)),
            None => Ok(()),
        }
    }

    fn nondeterministic(
        &self,
        workspace: &StepWorkspace<'_>,
        before: StepRecord,
        now: StepRecord,
        replaced: bool,
    ) -> StoreError {
        let first = unlike::first_difference(&before, &now, &|digest| self.path_of(digest), workspace.path());
        StoreError::Nondeterministic(Box::new(OutputMismatch { before, now, replaced, first }))
    }
}

/// A folder for the files of a step that is removed with its content when dropped.
#[derive(Debug)]
pub struct StepWorkspace<'s> {
    path: PathBuf,
    store: &'s Store,
}

impl StepWorkspace<'_> {
    /// Path of the workspace.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for StepWorkspace<'_> {
    fn drop(&mut self) {
        // Remaining files are removed when the store is next opened for writing. The failure is
        // reported at the next flush.
        if let Err(error) = self.store.disk.remove(&self.path) {
            self.store.failed.lock().expect("no holder panics").get_or_insert(error);
        }
    }
}
