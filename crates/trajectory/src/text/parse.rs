//! Poses and stamps from lines of text.

use super::{FIELDS, TextError, UNIT};
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::canonical_sign;
use std::io::{self, BufRead};

/// Reads `timestamps_us.txt`: strictly increasing stamps in microseconds, the first 0.
///
/// # Errors
/// A line is not an integer, or does not follow the previous one.
pub fn read_stamps(input: impl BufRead) -> Result<Vec<i64>, TextError> {
    let mut stamps = Vec::new();
    for (line, text) in numbered_lines(input) {
        let t_us = parse_stamp(line, text?.trim())?;
        push_stamp(&mut stamps, line, t_us)?;
    }
    Ok(stamps)
}

pub(super) fn numbered_lines(
    input: impl BufRead,
) -> impl Iterator<Item = (usize, Result<String, TextError>)> {
    let number = |(i, text): (usize, io::Result<String>)| {
        let line = i + 1;
        (line, text.map_err(|source| TextError::Io { line, source }))
    };
    input.lines().enumerate().map(number)
}

pub(super) fn parse_pose(line: usize, text: &str) -> Result<(i64, Se3), TextError> {
    let fields: Vec<&str> = text.split_ascii_whitespace().collect();
    let Ok(fields) = <[&str; FIELDS.len()]>::try_from(fields.as_slice()) else {
        return Err(TextError::Fields { line, found: fields.len(), wanted: FIELDS.len() });
    };
    let mut numbers = [0.0; 7];
    for ((number, text), field) in numbers.iter_mut().zip(&fields[1..]).zip(&FIELDS[1..]) {
        *number = text.parse().ok().filter(|n: &f64| n.is_finite()).ok_or_else(|| TextError::Number {
            line,
            field,
            found: (*text).to_owned(),
            wanted: "a finite number",
        })?;
    }
    let [tx, ty, tz, qx, qy, qz, qw] = numbers;
    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
    let unit = (rotation.length_squared() - 1.0).abs() <= UNIT;
    // Both signs of a quaternion are the same rotation. Only one is valid, so that equal poses have
    // equal bytes.
    if !unit || canonical_sign(rotation) != rotation {
        return Err(TextError::Quaternion { line, found: rotation });
    }
    Ok((parse_stamp(line, fields[0])?, Se3 { rotation, translation: DVec3::new(tx, ty, tz) }))
}

fn parse_stamp(line: usize, text: &str) -> Result<i64, TextError> {
    text.parse().map_err(|_| TextError::Number {
        line,
        field: FIELDS[0],
        found: text.to_owned(),
        wanted: "a whole number of microseconds",
    })
}

pub(super) fn push_stamp(stamps: &mut Vec<i64>, line: usize, t_us: i64) -> Result<(), TextError> {
    let wanted = match stamps.last() {
        None if t_us != 0 => "0".to_owned(),
        Some(before) if t_us <= *before => format!("more than {before}"),
        _ => {
            stamps.push(t_us);
            return Ok(());
        }
    };
    Err(TextError::Stamp { line, found: t_us, wanted })
}
