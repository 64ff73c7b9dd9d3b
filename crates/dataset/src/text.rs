//! Stamps and poses as other programs write them: one line each, `#` for comments.
//!
//! A time with a decimal point is in seconds. A whole number is in microseconds, or in nanoseconds
//! from 1e17 on, which would be the year 5138 in microseconds.

use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_trajectory::Trajectory;

/// Whole numbers from here on are nanoseconds.
const NANOSECONDS: i64 = 100_000_000_000_000_000;
/// Largest difference of the length of a quaternion from 1: three decimals are common.
const UNIT: f64 = 2e-3;

/// A line that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {because}")]
pub struct LineError {
    /// Number of the line, from 1.
    pub line: usize,
    /// The fault.
    pub because: String,
}

/// The lines with content, with their numbers.
fn content_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = (1..).zip(text.lines().map(str::trim));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// A time in microseconds.
#[expect(clippy::cast_possible_truncation, reason = "compared with the largest integer before")]
fn parse_time(word: &str) -> Option<i64> {
    if let Ok(whole) = word.parse::<i64>() {
        return Some(if whole.unsigned_abs() >= NANOSECONDS.unsigned_abs() {
            whole.div_euclid(1000)
        } else {
            whole
        });
    }
    let seconds: f64 = word.parse().ok()?;
    let micros = (seconds * 1e6).round();
    // The cast would turn larger ones into the last stamp that there is. NaN is not below either.
    (micros.abs() < i64::MAX as f64).then_some(micros as i64)
}

/// Reads the first word of each line as a stamp, in microseconds.
///
/// # Errors
/// A line does not begin with a time, or the stamps do not increase.
pub fn parse_stamps(text: &str) -> Result<Vec<i64>, LineError> {
    let mut stamps: Vec<i64> = Vec::new();
    for (line, content) in content_lines(text) {
        let word = content.split([' ', '\t', ',']).next().unwrap_or_default();
        let stamp = parse_time(word)
            .ok_or_else(|| LineError { line, because: format!("found `{word}`, wanted a time") })?;
        push_stamp(&mut stamps, line, stamp)?;
    }
    Ok(stamps)
}

/// Reads poses: `time x y z qx qy qz qw`, world from camera, with OpenCV's axes.
///
/// # Errors
/// A line has other fields, a quaternion is not of length 1, or the times do not increase.
pub fn parse_poses(text: &str) -> Result<Trajectory, LineError> {
    let mut found = Trajectory { world_from_camera: Vec::new(), stamps_us: Vec::new() };
    for (line, content) in content_lines(text) {
        let words: Vec<&str> = content.split([' ', '\t', ',']).filter(|word| !word.is_empty()).collect();
        let refuse = |because: String| LineError { line, because };
        let numbers: Option<Vec<f64>> =
            words.iter().skip(1).map(|word| word.parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let time = words.first().and_then(|word| parse_time(word));
        let (Some(time), Some(&[x, y, z, qx, qy, qz, qw])) = (time, numbers.as_deref()) else {
            // The header of some datasets has no `#`.
            if found.stamps_us.is_empty() && time.is_none() {
                continue;
            }
            let because = format!("found {} fields, wanted `time x y z qx qy qz qw`", words.len());
            return Err(refuse(because));
        };
        let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
        if (rotation.length() - 1.0).abs() > UNIT {
            return Err(refuse(format!("a quaternion of length {:.4}, wanted 1", rotation.length())));
        }
        push_stamp(&mut found.stamps_us, line, time)?;
        let pose = Se3 { rotation: rotation.normalize(), translation: DVec3::new(x, y, z) };
        found.world_from_camera.push(pose);
    }
    Ok(found)
}

fn push_stamp(stamps: &mut Vec<i64>, line: usize, stamp: i64) -> Result<(), LineError> {
    match stamps.last() {
        Some(before) if stamp <= *before => {
            let because = format!("{stamp} us is not later than the time before, {before} us");
            Err(LineError { line, because })
        }
        _ => {
            stamps.push(stamp);
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_the_unit_that_their_form_shows() {
        assert_eq!(parse_stamps("# t\n0.5\n1.25 images/1.png\n"), Ok(vec![500_000, 1_250_000]));
        assert_eq!(parse_stamps("7\n8,x\n"), Ok(vec![7, 8]));
        assert_eq!(
            parse_stamps("1468940293924830000\n1468940293957500000\n").unwrap()[1] % 1_000_000,
            957_500
        );
        // The smallest number has no absolute value.
        assert_eq!(parse_stamps(&i64::MIN.to_string()).unwrap(), [i64::MIN.div_euclid(1000)]);
        assert_eq!(parse_stamps("3\n3\n").unwrap_err().line, 2);
        assert_eq!(parse_stamps("a\n").unwrap_err().line, 1);
    }

    #[test]
    fn poses_are_read_with_and_without_a_header() {
        let found =
            parse_poses("time px py pz qx qy qz qw\n0.1 1 2 3 0 0 0 1\n0.2 1 2 4 0 0 1 0.001\n").unwrap();
        assert_eq!(found.stamps_us, [100_000, 200_000]);
        assert_eq!(found.world_from_camera[1].translation, DVec3::new(1.0, 2.0, 4.0));
        assert!((found.world_from_camera[1].rotation.length() - 1.0).abs() < 1e-12);
        assert!(parse_poses("0.1 1 2 3 0 0 0 2\n").unwrap_err().because.contains("length 2"));
        assert!(parse_poses("0.1 1 2 3 0 0 0 1\n0.2 1 2\n").unwrap_err().because.contains("3 fields"));
        assert_eq!(parse_poses("0.1 1 2 3 0 0 0 1\n0.1 1 2 3 0 0 0 1\n").unwrap_err().line, 2);
    }
}
