//! Settings for a source without poses: which frames of a video are used, and how COLMAP finds the
//! poses.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Settings of the search for poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PoseSolving {
    /// Camera model that is fitted.
    pub lens: SolvedLens,
    /// Number of key points per photo, at most.
    pub features: u32,
    /// Choice of the pairs that are matched; `None` chooses by the number of photos.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pairs: Option<PairRule>,
    /// Vocabulary tree with which COLMAP looks for places that are seen again. Its content enters
    /// the key.
    #[serde(skip)]
    pub vocabulary: Option<PathBuf>,
    /// Minimum share of the photos in the model. It refuses a result and changes none, so it enters
    /// no key.
    #[serde(skip)]
    pub registered: f64,
    /// The frames to use, if the source is a video. They are the input of this search.
    #[serde(skip)]
    pub frames: Option<FramePicking>,
}

impl Default for PoseSolving {
    fn default() -> Self {
        Self {
            lens: SolvedLens::Opencv,
            features: 4096,
            pairs: None,
            vocabulary: None,
            registered: 0.5,
            frames: None,
        }
    }
}

/// Camera models that are fitted, and that this program can undistort.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SolvedLens {
    /// No distortion, two focal lengths.
    Pinhole,
    /// One focal length and one radial coefficient: COLMAP's default.
    SimpleRadial,
    /// One focal length and two radial coefficients.
    Radial,
    /// Two focal lengths, two radial and two tangential coefficients.
    Opencv,
}

impl SolvedLens {
    /// COLMAP's name of the model.
    #[must_use]
    pub(crate) fn colmap_name(self) -> &'static str {
        match self {
            Self::Pinhole => "PINHOLE",
            Self::SimpleRadial => "SIMPLE_RADIAL",
            Self::Radial => "RADIAL",
            Self::Opencv => "OPENCV",
        }
    }
}

/// The pairs of photos that are matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PairRule {
    /// All pairs.
    Exhaustive,
    /// Each photo with those that follow it.
    Sequential,
}

/// Number of photos from which pairs are sequential by default. 200 photos have 19,900 pairs.
const MANY_PHOTOS: usize = 200;
/// Number of photos that a photo is matched with: the next ones, and as many at distances that
/// double. COLMAP's default, `SequentialMatching.overlap`.
const OVERLAP: usize = 10;

impl PairRule {
    /// The default rule for this number of photos.
    #[must_use]
    pub(crate) fn for_count(photos: usize) -> Self {
        if photos < MANY_PHOTOS { Self::Exhaustive } else { Self::Sequential }
    }

    /// The pairs among `count` photos, sorted, the smaller index first.
    #[must_use]
    pub fn pairs(self, count: usize) -> Vec<(usize, usize)> {
        let steps: Vec<usize> = match self {
            Self::Exhaustive => (1..count).collect(),
            Self::Sequential => {
                let far = (0..OVERLAP).map(|k| 1 << k).filter(|step| *step > OVERLAP);
                (1..=OVERLAP).chain(far).collect()
            }
        };
        let from = |i: usize| steps.iter().map(move |step| (i, i + step));
        (0..count).flat_map(from).filter(|(_, j)| *j < count).collect()
    }
}

/// The frames of a video that are used.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FramePicking {
    /// Every n-th frame is a candidate.
    pub every: u32,
    /// A candidate is dropped if its sharpness is below this share of the median of its
    /// neighbours; 0 drops none.
    pub sharpness: f64,
}

impl Default for FramePicking {
    fn default() -> Self {
        Self { every: 10, sharpness: 0.5 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_all_or_those_that_follow() {
        let all = PairRule::Exhaustive.pairs(4);
        assert_eq!(all, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]);
        assert_eq!(PairRule::Exhaustive.pairs(1), []);
        let sequential = PairRule::Sequential.pairs(1000);
        let of_first: Vec<usize> = sequential.iter().filter(|(i, _)| *i == 0).map(|(_, j)| *j).collect();
        assert_eq!(of_first, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 16, 32, 64, 128, 256, 512]);
        assert_eq!(sequential.last(), Some(&(998, 999)));
        assert_eq!(PairRule::Sequential.pairs(5), PairRule::Exhaustive.pairs(5));
    }
}
