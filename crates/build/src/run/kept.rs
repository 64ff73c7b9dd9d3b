//! Frames that a step keeps for later ones, and shows again instead of rendering.

use super::job::StaleStep;
use crate::stage::AnyStep;
use gs2e_files as files;
use gs2e_files::Removal;
use gs2e_sampling::kept::{KeptFrames, KeptSummary};
use gs2e_store::{Digest, Store, StoreError};
use std::path::PathBuf;
use std::sync::Arc;

/// Share of the free disk space that frames may take.
const SPACE_SHARE: u64 = 4;

/// The kept frames of a step.
pub(super) struct KeptStep {
    name: Digest,
    pub(super) frames: Arc<KeptFrames>,
    /// The file of new frames.
    fresh: PathBuf,
    /// Bytes that the frames of all steps may take.
    limit: u64,
}

impl KeptStep {
    /// The frames of a step; `None` if none of it can be kept. A step that is made again for comparison does
    /// all of its work again.
    pub(super) fn open(
        step: &dyn AnyStep,
        stale: &StaleStep,
        store: &Store,
        limit: u64,
    ) -> Result<Option<Self>, StoreError> {
        let name = step.kept_name(&stale.files).filter(|_| stale.recheck.is_none());
        let Some(name) = name else { return Ok(None) };
        let (paths, fresh) = (store.frames_of(&name)?, store.fresh_frames());
        // A part of the free space, because the products of the steps that run need the rest.
        let free = store.space().map_or(limit, |space| space.free / SPACE_SHARE);
        let frames = Arc::new(KeptFrames::open(&paths, fresh.clone(), limit.min(free)));
        Ok(Some(Self { name, frames, fresh, limit }))
    }

    /// Ends the work with the frames, and keeps the new ones if the step was made. Returns a remark.
    pub(super) fn end(self, is_made: bool, store: &Store) -> Result<Option<String>, StoreError> {
        let Self { name, frames, fresh, limit } = &self;
        let KeptSummary { reused, rendered, bytes, refused } = frames.finish();
        if reused > 0 {
            store.use_frames(name)?;
        }
        if !is_made || bytes == 0 {
            return Ok(match refused {
                Some(because) => Some(format!("frames not kept: {because}")),
                None => (reused > 0 && rendered == 0).then(|| "from kept frames".to_owned()),
            });
        }
        store.keep_frames(name, fresh, *limit)?;
        Ok(Some(format!("{:.1} MB of frames kept", bytes as f64 * 1e-6)))
    }
}

impl Drop for KeptStep {
    fn drop(&mut self) {
        // The frames of a step that failed. If they cannot be removed, the store does it when it is opened
        // next.
        let _ = files::remove(&self.fresh, Removal::File);
    }
}
