//! Notes: information that the `.ply` format has no place for, in comments of our own. Other
//! readers skip them; ours reads them back.
//!
//! ```text
//! comment gs2e antialiased true
//! comment gs2e screening read 31000 non_finite 2 zero_quaternions 0
//! comment gs2e origin 4.5e5 -1.25e3 0e0
//! ```

use crate::cursor::ByteCursor;
use crate::{Gaussians, SceneError, SceneScreening};
use glam::DVec3;
use std::fmt;

/// The notes of one file; each may be absent.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct PlyNotes {
    pub(super) antialiased: Option<bool>,
    pub(super) screening: Option<SceneScreening>,
    pub(super) origin: Option<DVec3>,
}

impl PlyNotes {
    /// First word of a comment with a note.
    pub(super) const MARK: &str = "gs2e";

    /// The notes of `scene`.
    pub(super) fn for_scene(scene: &Gaussians) -> Self {
        Self {
            antialiased: scene.antialiased,
            screening: Some(scene.screening),
            // A zero origin stays out: positions are then written in 32 bits.
            origin: (scene.origin != DVec3::ZERO).then_some(scene.origin),
        }
    }

    /// Parses the words of a note after the prefix.
    pub(super) fn read(&mut self, words: &[&str], at: &ByteCursor) -> Result<(), SceneError> {
        let known = match *words {
            ["antialiased", flag] => flag.parse().is_ok_and(|flag| {
                self.antialiased = Some(flag);
                true
            }),
            ["screening", "read", read, "non_finite", non_finite, "zero_quaternions", zero] => {
                self.screening = parse_screening([read, non_finite, zero]);
                self.screening.is_some()
            }
            ["origin", x, y, z] => {
                self.origin = parse_origin([x, y, z]);
                self.origin.is_some()
            }
            _ => false,
        };
        if known {
            return Ok(());
        }
        Err(at.malformed(
            format!("the note `{}`", words.join(" ")),
            "antialiased BOOL, screening read N non_finite N zero_quaternions N, or origin X Y Z",
        ))
    }
}

fn parse_screening([read, non_finite, zero]: [&str; 3]) -> Option<SceneScreening> {
    Some(SceneScreening {
        read: read.parse().ok()?,
        non_finite: non_finite.parse().ok()?,
        zero_quaternions: zero.parse().ok()?,
    })
}

fn parse_origin([x, y, z]: [&str; 3]) -> Option<DVec3> {
    let origin = DVec3::new(x.parse().ok()?, y.parse().ok()?, z.parse().ok()?);
    // All positions are relative to it.
    origin.is_finite().then_some(origin)
}

/// The notes as header lines. `{:e}` prints the shortest digits that parse to the same number.
impl fmt::Display for PlyNotes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(flag) = self.antialiased {
            writeln!(f, "comment {} antialiased {flag}", Self::MARK)?;
        }
        if let Some(SceneScreening { read, non_finite, zero_quaternions }) = self.screening {
            writeln!(
                f,
                "comment {} screening read {read} non_finite {non_finite} zero_quaternions {zero_quaternions}",
                Self::MARK
            )?;
        }
        if let Some(DVec3 { x, y, z }) = self.origin {
            writeln!(f, "comment {} origin {x:e} {y:e} {z:e}", Self::MARK)?;
        }
        Ok(())
    }
}
