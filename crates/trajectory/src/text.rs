//! `poses.txt` and `timestamps_us.txt`: one line per pose, LF, and a final newline.
//!
//! A line of poses is `t_us tx ty tz qx qy qz qw`: microseconds, the camera's centre in scene
//! units, and the unit quaternion from camera (OpenCV axes) to world with `w >= 0`. Numbers have 17
//! significant digits in the form of C's `%.17g`, so that reading them gives back the same bits.

mod parse;

pub use parse::read_stamps;
use parse::{numbered_lines, parse_pose, push_stamp};

use super::Trajectory;
use glam::DQuat;
use gs2e_num::se3::rotation::canonical_sign;
use std::io::{self, BufRead, Write};

/// Names of the fields of a line of poses, for errors.
const FIELDS: [&str; 8] = ["t_us", "tx", "ty", "tz", "qx", "qy", "qz", "qw"];
/// Largest deviation of a quaternion's squared length from 1.
const UNIT: f64 = 1e-6;

/// The reason why a text is not a trajectory. Lines count from 1.
#[derive(Debug, thiserror::Error)]
pub enum TextError {
    /// Reading failed.
    #[error("line {line}: {source}")]
    Io {
        /// Line.
        line: usize,
        /// Cause.
        source: io::Error,
    },
    /// A line has too few or too many fields.
    #[error("line {line}: found {found} fields, wanted {wanted}")]
    Fields {
        /// Line.
        line: usize,
        /// Number of fields found.
        found: usize,
        /// Number of fields wanted.
        wanted: usize,
    },
    /// A field is not a finite number, or not an integer where one is wanted.
    #[error("line {line}: {field} is `{found}`, wanted {wanted}")]
    Number {
        /// Line.
        line: usize,
        /// Name of the field.
        field: &'static str,
        /// Text found.
        found: String,
        /// Value wanted.
        wanted: &'static str,
    },
    /// A stamp does not follow its predecessor.
    #[error("line {line}: found stamp {found} us, wanted {wanted}")]
    Stamp {
        /// Line.
        line: usize,
        /// The stamp.
        found: i64,
        /// Value wanted.
        wanted: String,
    },
    /// A quaternion is not of length 1, or has the other sign.
    #[error("line {line}: found quaternion {found}, wanted a unit quaternion with w >= 0")]
    Quaternion {
        /// Line.
        line: usize,
        /// Value found.
        found: DQuat,
    },
}

impl Trajectory {
    /// Writes `poses.txt`.
    ///
    /// # Errors
    /// Writing fails.
    pub fn write_poses(&self, mut out: impl Write) -> io::Result<()> {
        for (pose, t_us) in self.world_from_camera.iter().zip(&self.stamps_us) {
            let (c, q) = (pose.translation, canonical_sign(pose.rotation));
            write!(out, "{t_us}")?;
            for number in [c.x, c.y, c.z, q.x, q.y, q.z, q.w] {
                write!(out, " {}", significant_digits(number))?;
            }
            out.write_all(b"\n")?;
        }
        Ok(())
    }

    /// Reads `poses.txt`, bit for bit.
    ///
    /// # Errors
    /// A line is not a pose, or its stamp does not follow the previous one.
    pub fn read_poses(input: impl BufRead) -> Result<Self, TextError> {
        let mut read = Self { world_from_camera: Vec::new(), stamps_us: Vec::new() };
        for (line, text) in numbered_lines(input) {
            let (t_us, pose) = parse_pose(line, &text?)?;
            push_stamp(&mut read.stamps_us, line, t_us)?;
            read.world_from_camera.push(pose);
        }
        Ok(read)
    }

    /// Writes `timestamps_us.txt`.
    ///
    /// # Errors
    /// Writing fails.
    pub fn write_stamps(&self, mut out: impl Write) -> io::Result<()> {
        self.stamps_us.iter().try_for_each(|t_us| writeln!(out, "{t_us}"))
    }
}

/// A finite number with 17 significant digits, as C's `%.17g` writes it: without trailing zeros,
/// and with an exponent only below 1e-4 and from 1e17 on.
#[must_use]
pub fn significant_digits(number: f64) -> String {
    // 17 significant digits: one before the point, 16 after it.
    let scientific = format!("{number:.16e}");
    let Some((mantissa, exponent)) = scientific.split_once('e') else { return scientific };
    let Ok(power) = exponent.parse::<i32>() else { return scientific };
    if !(-4..17).contains(&power) {
        // C writes the sign of an exponent and at least two digits.
        let sign = if power < 0 { '-' } else { '+' };
        return format!("{}e{sign}{:02}", trim_zeros(mantissa), power.abs());
    }
    let (sign, mantissa) = mantissa.strip_prefix('-').map_or(("", mantissa), |m| ("-", m));
    let digits = mantissa.replace('.', "");
    let shown = match usize::try_from(power) {
        Ok(whole) => format!("{}.{}", &digits[..=whole], &digits[whole + 1..]),
        Err(_) => format!("0.{}{digits}", "0".repeat(power.unsigned_abs() as usize - 1)),
    };
    format!("{sign}{}", trim_zeros(&shown))
}

fn trim_zeros(decimal: &str) -> &str {
    decimal.trim_end_matches('0').trim_end_matches('.')
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use gs2e_num::se3::Se3;
    use proptest::prelude::*;

    #[test]
    fn numbers_are_written_as_c_does() {
        // From Python: '%.17g' % x.
        let t = |number: f64, want: &str| assert_eq!(significant_digits(number), want);
        t(0.0, "0");
        t(1.0, "1");
        t(-1.5, "-1.5");
        t(0.1, "0.10000000000000001");
        t(100.0, "100");
        t(1.0 / 3.0, "0.33333333333333331");
        t(-1234.5678, "-1234.5678");
        t(1e16, "10000000000000000");
        t(1e17, "1e+17");
        t(12345678901234567.0, "12345678901234568");
        t(1e-4, "0.0001");
        t(1e-5, "1.0000000000000001e-05");
        t(-2.5e-300, "-2.5e-300");
        t(5e-324, "4.9406564584124654e-324");
        t(f64::MAX, "1.7976931348623157e+308");
        t(0.001, "0.001");
    }

    proptest! {
        #[test]
        fn poses_are_read_back_bit_for_bit(
            numbers in prop::collection::vec((prop::array::uniform3(-1e6..1e6f64), prop::array::uniform4(-1.0..1.0f64)), 0..20),
            exponent in -300..90i32,
        ) {
            let scale = 10f64.powi(exponent);
            let poses = numbers.iter().filter(|(_, q)| DQuat::from_array(*q).length() > 1e-3);
            let world_from_camera: Vec<Se3> = poses
                .map(|(c, q)| Se3 {
                    rotation: canonical_sign(DQuat::from_array(*q).normalize()),
                    translation: DVec3::from_array(*c) * scale,
                })
                .collect();
            let stamps_us = (0..world_from_camera.len()).map(|j| j as i64 * 417).collect();
            let written = Trajectory { world_from_camera, stamps_us };
            let mut text = Vec::new();
            written.write_poses(&mut text).unwrap();
            let read = Trajectory::read_poses(&text[..]).unwrap();
            let bits = |t: &Trajectory| -> Vec<[u64; 7]> {
                let numbers = |p: &Se3| {
                    let (c, q) = (p.translation, p.rotation);
                    [c.x, c.y, c.z, q.x, q.y, q.z, q.w].map(f64::to_bits)
                };
                t.world_from_camera.iter().map(numbers).collect()
            };
            prop_assert_eq!(bits(&written), bits(&read));
            prop_assert_eq!(&written.stamps_us, &read.stamps_us);
            let mut again = Vec::new();
            read.write_poses(&mut again).unwrap();
            prop_assert_eq!(text, again);
        }
    }

    #[test]
    fn the_file_has_one_line_a_pose_and_the_sign_of_w() {
        let pose =
            Se3 { rotation: DQuat::from_xyzw(0.0, -0.6, 0.0, -0.8), translation: DVec3::new(1.0, -0.0, 2.5) };
        let t = Trajectory { world_from_camera: vec![pose, Se3::IDENTITY], stamps_us: vec![0, 417] };
        let (mut poses, mut stamps) = (Vec::new(), Vec::new());
        t.write_poses(&mut poses).unwrap();
        t.write_stamps(&mut stamps).unwrap();
        let poses = String::from_utf8(poses).unwrap();
        assert_eq!(poses, "0 1 -0 2.5 0 0.59999999999999998 0 0.80000000000000004\n417 0 0 0 0 0 0 1\n");
        assert_eq!(stamps, b"0\n417\n");
        assert_eq!(read_stamps(&stamps[..]).unwrap(), [0, 417]);
    }

    #[test]
    fn errors_name_the_line() {
        let t = |text: &str, want: &str| {
            let error = Trajectory::read_poses(text.as_bytes()).unwrap_err().to_string();
            assert_eq!(error, want, "{text}");
        };
        t("0 0 0 0 0 0 0 1\n1 2 3\n", "line 2: found 3 fields, wanted 8");
        t("0 0 0 0 0 0 0 1\n\n", "line 2: found 0 fields, wanted 8");
        t("0 0 nan 0 0 0 0 1\n", "line 1: ty is `nan`, wanted a finite number");
        t("0 0 1e999 0 0 0 0 1\n", "line 1: ty is `1e999`, wanted a finite number");
        t("0.5 0 0 0 0 0 0 1\n", "line 1: t_us is `0.5`, wanted a whole number of microseconds");
        t("3 0 0 0 0 0 0 1\n", "line 1: found stamp 3 us, wanted 0");
        t("0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", "line 2: found stamp 0 us, wanted more than 0");
        for bad in ["0 0 0 2", "0 0.6 0 -0.8", "0 0 0 0", "-1 0 0 0"] {
            let error = Trajectory::read_poses(format!("0 0 0 0 {bad}\n").as_bytes()).unwrap_err();
            assert!(matches!(error, TextError::Quaternion { line: 1, .. }), "{bad}");
        }
        assert!(matches!(Trajectory::read_poses(&[0xff, 0xfe][..]), Err(TextError::Io { line: 1, .. })));
        assert!(read_stamps(&b"0\n5\n5\n"[..]).is_err());
        assert!(read_stamps(&b"0\nx\n"[..]).is_err());
    }
}
