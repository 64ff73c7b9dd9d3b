//! The store of a build: how it is opened, and its notices.

use super::{SyncArg, TrustOptions};
use crate::cli::environment::Environment;
use crate::cli::{CommonArgs, Console, UserMessage, VerbError, clock};
use gs2e_build::run::backends::RendererChoice;
use gs2e_files::stat::FileStat;
use gs2e_store::space::DiskSpace;
use gs2e_store::{Digest, LockClaim, Store, StoreAccess, StoreError, StoreOptions};
use std::path::{Path, PathBuf};

/// Names this program, its options that may change a key, and the shared store: a scene that was settled
/// without it has not been offered to it.
pub(in crate::cli) fn option_tag(chosen: &RendererChoice, shared: Option<&Path>) -> Digest {
    // The stat fields identify a build of the program: a rebuilt program may compute other keys.
    let program =
        std::env::current_exe().and_then(|path| path.metadata()).map(|about| FileStat::from(&about));
    Digest::of_bytes(format!("{:?} {} {shared:?}", program.ok(), chosen.name()).as_bytes())
}

/// Opens the store for writing, and waits while another process holds it.
pub(in crate::cli) fn open_store(
    common: &CommonArgs,
    trust: &TrustOptions,
    console: &Console,
) -> Result<Store, VerbError> {
    open_cache(common, trust, None, console)
}

/// Opens the store as [`open_store`], with a bound on its size in bytes.
pub(super) fn open_cache(
    common: &CommonArgs,
    trust: &TrustOptions,
    cache_size: Option<u64>,
    console: &Console,
) -> Result<Store, VerbError> {
    let access = if common.no_wait { StoreAccess::WriteNow } else { StoreAccess::Write };
    let opening = StoreOptions {
        verify: trust.verify,
        sync_each: trust.sync == SyncArg::Always,
        claim: lock_claim(common),
        shared: trust.shared_store.clone(),
        cache_size,
        ..store_options(common, access)
    };
    let store = Store::open(&common.store, opening, &mut |holder| {
        let what = format!("{} is in use by {holder}", common.store.display());
        console.report(&UserMessage::waiting("locked", what));
    })?;
    report_notices(&store, console);
    Ok(store)
}

/// The description of this process for those that wait for it.
pub(in crate::cli) fn lock_claim(common: &CommonArgs) -> LockClaim {
    LockClaim { command: common.command.clone(), since: clock::utc_now(), ..LockClaim::default() }
}

/// Opens the store for reading.
pub(in crate::cli) fn read_store(common: &CommonArgs) -> Result<Store, StoreError> {
    Store::open(&common.store, store_options(common, StoreAccess::Read), &mut |_| {})
}

/// The options with which this user opens the store.
pub(in crate::cli) fn store_options(common: &CommonArgs, access: StoreAccess) -> StoreOptions {
    let CommonArgs { store, environment, .. } = common;
    let bucket = environment.bucket.clone();
    StoreOptions { index: index_of(store, environment), bucket, ..access.into() }
}

/// The folder for the database of a store on a remote disk: in the user's cache, named after the
/// store's path. `None` for a local store.
fn index_of(store: &Path, environment: &Environment) -> Option<PathBuf> {
    let path = std::path::absolute(store).ok()?;
    // The store may not exist yet; its nearest existing ancestor is on the same file system.
    let there = path.ancestors().find(|path| path.is_dir())?;
    // A database in WAL mode needs shared memory on one host, which a remote disk does not give.
    DiskSpace::holding_path(there).ok().filter(DiskSpace::is_remote)?;
    let name = Digest::of_bytes(path.as_os_str().as_encoded_bytes()).short();
    Some(environment.cache_folder()?.join("gs2e").join(name))
}

/// Prints the repairs of the store since the last call.
pub(in crate::cli) fn report_notices(store: &Store, console: &Console) {
    for notice in store.take_notices() {
        console.report(&UserMessage::warning("state-rebuilt", notice));
    }
}
