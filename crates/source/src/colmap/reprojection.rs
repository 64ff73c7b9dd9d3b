//! Reprojection error of a model: distances between its points and the key points that they were
//! triangulated from.
//!
//! The distances are measured from cameras, images and points through the whole lens. The stored
//! `error` of the points is not used, because it is COLMAP's own claim.

use super::{ColmapImage, ColmapModel, ColmapPoint, ModelCamera};
use crate::SourceError;
use gs2e_files::is_there;
use std::collections::BTreeMap;

/// Distances between key points and the projections of their points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReprojectionStats {
    /// Number of points that an image sees.
    pub points: usize,
    /// Number of key points with a point.
    pub observations: usize,
    /// Mean over points of the mean over each point's key points, px: COLMAP's mean reprojection
    /// error.
    pub over_points_px: f64,
    /// Mean over key points, px.
    pub over_observations_px: f64,
    /// Number of key points whose point is not in front of the camera. They enter no mean.
    pub behind: usize,
}

/// Sum of the distances of a point's key points, px, and their number.
#[derive(Debug, Clone, Copy, Default)]
struct DistanceSum {
    sum_px: f64,
    count: f64,
}

impl ColmapModel {
    /// Measures the model; `None` if it has no points or no image sees a point.
    ///
    /// # Errors
    /// A file is damaged, or refers to a camera or point that does not exist.
    pub fn reprojection(&self) -> Result<Option<ReprojectionStats>, SourceError> {
        if !is_there(&self.file("points3D")) {
            return Ok(None);
        }
        let (cameras, points) = (self.cameras()?, self.points()?);
        // Kept by point, because COLMAP's mean gives each point the same weight.
        let mut of_points = BTreeMap::<u64, DistanceSum>::new();
        let mut behind = 0;
        for image in self.images()? {
            let fault = |because| SourceError::Content {
                path: self.file("images"),
                place: image.place.clone(),
                because,
            };
            let camera = cameras.get(&image.camera_id);
            let camera =
                camera.ok_or_else(|| fault(format!("camera {} is not in the model", image.camera_id)))?;
            for observation in &image.observations {
                let Some(id) = observation.point else { continue };
                let point =
                    points.get(&id).ok_or_else(|| fault(format!("point {id} is not in the model")))?;
                match project_point(&image, camera, point) {
                    Some([u, v]) => {
                        let (x, y) = (u - observation.xy[0], v - observation.xy[1]);
                        let distances = of_points.entry(id).or_default();
                        distances.sum_px += (x * x + y * y).sqrt();
                        distances.count += 1.0;
                    }
                    None => behind += 1,
                }
            }
        }
        Ok(ReprojectionStats::from_distances(&of_points, behind))
    }
}

/// Projects a point into the photo, px; `None` if it is not in front of the camera.
fn project_point(image: &ColmapImage, taken: &ModelCamera, point: &ColmapPoint) -> Option<[f64; 2]> {
    let at = image.rotation.rotation * point.xyz + image.translation;
    // Behind the camera these values mean nothing. They are dropped below.
    let [x, y] = taken.lens.distort([at.x / at.z, at.y / at.z]);
    let camera = taken.camera;
    (at.z > 0.0).then_some([camera.fx * x + camera.cx, camera.fy * y + camera.cy])
}

impl ReprojectionStats {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a sum of ones")]
    fn from_distances(of_points: &BTreeMap<u64, DistanceSum>, behind: usize) -> Option<Self> {
        let all = of_points.values();
        let count: f64 = all.clone().map(|d| d.count).sum();
        let means: f64 = all.clone().map(|d| d.sum_px / d.count).sum();
        (count > 0.0).then(|| Self {
            points: of_points.len(),
            observations: count as usize,
            over_points_px: means / of_points.len() as f64,
            over_observations_px: all.map(|d| d.sum_px).sum::<f64>() / count,
            behind,
        })
    }
}
