//! The place of a shared store, as users name it: a folder, or `s3://BUCKET/PREFIX`.

use super::folder::SharedFolder;
use super::medium::SharedMedium;
use crate::{BucketEnvironment, StoreAccess, StoreError, StoreOptions};
use std::path::Path;

/// How names of buckets begin.
const SCHEME: &str = "s3://";

/// Returns true if a shared store is in a bucket, and not in a folder.
#[must_use]
pub fn is_bucket(place: &Path) -> bool {
    place.to_str().is_some_and(|place| place.starts_with(SCHEME))
}

/// Opens the place. One that is opened for writing is created if it is absent.
pub(super) fn open(place: &Path, opening: &StoreOptions) -> Result<Box<dyn SharedMedium>, StoreError> {
    let write = opening.access != StoreAccess::Read;
    if is_bucket(place) {
        return open_bucket(place, &opening.bucket, write);
    }
    let fs = opening.fs.clone();
    Ok(Box::new(match write {
        true => SharedFolder::open(place, fs)?,
        false => SharedFolder::open_for_reading(place, fs)?,
    }))
}

#[cfg(feature = "s3")]
fn open_bucket(
    place: &Path,
    environment: &BucketEnvironment,
    write: bool,
) -> Result<Box<dyn SharedMedium>, StoreError> {
    let place = place.to_str().unwrap_or_default();
    let (bucket, prefix) = place[SCHEME.len()..].split_once('/').unwrap_or((&place[SCHEME.len()..], ""));
    let prefix = prefix.trim_end_matches('/');
    Ok(Box::new(super::bucket::SharedBucket::open(bucket, prefix, environment, write)?))
}

#[cfg(not(feature = "s3"))]
fn open_bucket(place: &Path, _: &BucketEnvironment, _: bool) -> Result<Box<dyn SharedMedium>, StoreError> {
    Err(StoreError::Unshareable {
        place: place.display().to_string(),
        because: "this gs2e was built without S3".to_owned(),
        help: "cargo install --path . --features s3",
    })
}
