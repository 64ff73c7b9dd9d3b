//! The time of day, for people. Nothing read here enters a key or a release.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Now in UTC, as `YYYY-MM-DDThh:mm:ssZ`.
pub(super) fn utc_now() -> String {
    utc_before(Duration::ZERO)
}

/// The moment this long before now, as [`utc_now`]. Such texts are in the order of their moments.
pub(super) fn utc_before(age: Duration) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    humantime::format_rfc3339_seconds(UNIX_EPOCH + now.saturating_sub(age)).to_string()
}
