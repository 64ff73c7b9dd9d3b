//! The place of a shared store, as users name it: a folder, or `s3://BUCKET/PREFIX`.

use super::folder::SharedFolder;
use super::medium::SharedMedium;
use crate::store::{BucketEnvironment, StoreError};
use std::path::Path;

/// How names of buckets begin.
const SCHEME: &str = "s3://";

/// Returns true if a shared store is in a bucket, and not in a folder.
#[must_use]
pub fn is_bucket(place: &Path) -> bool {
    place.to_str().is_some_and(|place| place.starts_with(SCHEME))
}

pub(super) fn open_for_reading(
    place: &Path,
    environment: &BucketEnvironment,
) -> Result<Box<dyn SharedMedium>, StoreError> {
    if is_bucket(place) {
        return open_bucket(place, environment, false);
    }
    Ok(Box::new(SharedFolder::open_for_reading(place)?))
}

pub(super) fn open(
    place: &Path,
    environment: &BucketEnvironment,
) -> Result<Box<dyn SharedMedium>, StoreError> {
    if is_bucket(place) {
        return open_bucket(place, environment, true);
    }
    Ok(Box::new(SharedFolder::open(place)?))
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
