//! The subject of the passes over a scene: its capture, and its agreement with the photos.

use super::Limits;
use gs2e_source::colmap::ReprojectionStats;
use gs2e_train::fidelity::PhotoFidelity;
use gs2e_trajectory::walk::CaptureEvenness;

/// One scene. Values that could not be measured carry the reason.
#[derive(Debug, Clone)]
pub struct SceneSubject<'a> {
    /// Scene id.
    pub name: &'a str,
    /// Reprojection errors of its points.
    pub reprojection: Result<ReprojectionStats, String>,
    /// Numbers of its photos.
    pub photos: Result<CapturePhotos, String>,
    /// Evenness of its views.
    pub walk: Result<CaptureEvenness, String>,
    /// Agreement of the scene with its photos, if there are Gaussians.
    pub fidelity: Option<&'a PhotoFidelity>,
    /// The recipe's limits.
    pub limits: &'a Limits,
}

/// The photos of a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CapturePhotos {
    /// Number of photos.
    pub there: usize,
    /// Number of photos with a pose.
    pub registered: usize,
    /// Number of views, with or without a photo.
    pub views: usize,
}
