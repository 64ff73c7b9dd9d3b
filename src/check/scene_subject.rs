//! What the passes over a whole scene see: its capture, and how true it is to its photos.

use super::subject::Judged;
use super::{Finding, Limits};
use crate::render::fidelity::Fidelity;
use crate::source::colmap::Reprojection;
use crate::trajectory::walk::Walk;

/// One scene. What could not be measured says why.
#[derive(Debug, Clone)]
pub struct SceneSubject<'a> {
    /// Scene id.
    pub name: &'a str,
    /// How far points fall from their key points.
    pub reprojection: Result<Reprojection, String>,
    /// How many photos there are.
    pub photos: Result<Photos, String>,
    /// How evenly the views follow one another.
    pub walk: Result<Walk, String>,
    /// How true the scene is to the photos, where there is one.
    pub fidelity: Option<&'a Fidelity>,
    /// The recipe's limits.
    pub limits: &'a Limits,
}

/// The photos of a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Photos {
    /// How many are there.
    pub there: usize,
    /// How many of them have a pose.
    pub registered: usize,
    /// How many views there are, with a photo or without.
    pub views: usize,
}

impl SceneSubject<'_> {
    /// A finding of `check`; `part` names the statement.
    pub(super) fn finding(&self, check: &str, part: &str, judged: Judged) -> Finding {
        judged.finding(self.name, check, part)
    }

    /// The finding of a statement that could not be measured.
    pub(super) fn not_run(&self, check: &str, part: &str, because: impl Into<String>) -> Finding {
        self.finding(check, part, Judged::not_run(because))
    }
}
