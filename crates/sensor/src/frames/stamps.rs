//! Stamps of a sequence: strictly increasing integer microseconds with any first value.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::frames::stamps::relative_stamps;
//!
//! // Microseconds become nanoseconds since the first.
//! assert_eq!(relative_stamps(&[1_000_000, 1_000_417])?, [0, 417_000]);
//! // A stamp that is not later than the one before is named.
//! let error = relative_stamps(&[0, 5, 5]).err().ok_or("it was accepted")?;
//! assert_eq!(error.index(), 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

/// The reason why stamps are not valid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StampError {
    /// Stamps do not increase.
    #[error("stamp {index} is {found} us, not later than the previous one, {before} us")]
    Order {
        /// Index of the stamp.
        index: usize,
        /// Its value.
        found: i64,
        /// The previous value.
        before: i64,
    },
    /// Stamps are further apart than 64-bit nanoseconds can express.
    #[error("stamp {index} is {found} us, too far from the first, {first} us")]
    Span {
        /// Index of the stamp.
        index: usize,
        /// Its value.
        found: i64,
        /// The first value.
        first: i64,
    },
}

impl StampError {
    /// Index of the invalid stamp.
    #[must_use]
    pub fn index(&self) -> usize {
        match *self {
            Self::Order { index, .. } | Self::Span { index, .. } => index,
        }
    }
}

/// Nanoseconds since the first of strictly increasing stamps.
///
/// # Errors
/// A stamp is not later than the one before, or too far from the first.
pub fn relative_stamps(stamps_us: &[i64]) -> Result<Vec<i64>, StampError> {
    for (index, pair) in stamps_us.windows(2).enumerate() {
        if pair[1] <= pair[0] {
            return Err(StampError::Order { index: index + 1, found: pair[1], before: pair[0] });
        }
    }
    let since_first = |(index, &found): (usize, &i64)| {
        let first = stamps_us[0];
        // Stamps may start anywhere: the difference may overflow as well as its nanoseconds.
        let ns = found.checked_sub(first).and_then(|us| us.checked_mul(1000));
        ns.ok_or(StampError::Span { index, found, first })
    };
    stamps_us.iter().enumerate().map(since_first).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_from_zero_only_the_differences_count() {
        let far = 1_000_000_000_000_000;
        assert_eq!(relative_stamps(&[far, far + 1, far + 417]), Ok(vec![0, 1000, 417_000]));
        assert_eq!(relative_stamps(&[-7]), Ok(vec![0]));
        assert_eq!(relative_stamps(&[]), Ok(vec![]));
    }

    #[test]
    fn what_does_not_increase_is_named() {
        let t = |stamps: &[i64], index: usize, message: &str| {
            let error = relative_stamps(stamps).unwrap_err();
            assert_eq!((error.index(), error.to_string().as_str()), (index, message));
        };
        t(&[0, 5, 5], 2, "stamp 2 is 5 us, not later than the previous one, 5 us");
        t(&[i64::MIN, 0], 1, "stamp 1 is 0 us, too far from the first, -9223372036854775808 us");
    }
}
