//! The time of day, for people. Nothing read here enters a key or a release.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Now, as `YYYY-MM-DDThh:mm:ssZ`.
pub(super) fn utc_now() -> String {
    utc_before(Duration::ZERO)
}

/// The moment this long before now, as [`utc_now`]. Such texts are in the order of their moments.
pub(super) fn utc_before(age: Duration) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    format_utc(now.saturating_sub(age).as_secs())
}

/// Seconds since 1970, as `YYYY-MM-DDThh:mm:ssZ`.
fn format_utc(seconds: u64) -> String {
    let (mut days, second) = (seconds / 86_400, seconds % 86_400);
    let mut year = 1970;
    while days >= year_days(year) {
        days -= year_days(year);
        year += 1;
    }
    // The other eleven months have 337 days.
    let february = year_days(year) - 337;
    let mut month = 0;
    for days_of_month in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        month += 1;
        if days < days_of_month {
            break;
        }
        days -= days_of_month;
    }
    let (day, hour, minute, second) = (days + 1, second / 3600, second / 60 % 60, second % 60);
    format!("{year}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Days in a year of the Gregorian calendar.
fn year_days(year: u64) -> u64 {
    let leap = year.is_multiple_of(4) && !year.is_multiple_of(100) || year.is_multiple_of(400);
    365 + u64::from(leap)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments by `date -u -d @N`.
    #[test]
    fn moments_are_told_by_the_calendar() {
        let t = |seconds, wanted| assert_eq!(format_utc(seconds), wanted);
        t(0, "1970-01-01T00:00:00Z");
        t(951_782_399, "2000-02-28T23:59:59Z");
        t(951_782_400, "2000-02-29T00:00:00Z");
        t(951_868_800, "2000-03-01T00:00:00Z");
        t(1_709_164_800, "2024-02-29T00:00:00Z");
        t(1_735_689_599, "2024-12-31T23:59:59Z");
        t(4_107_542_400, "2100-03-01T00:00:00Z");
    }
}
