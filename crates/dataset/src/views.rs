//! The pictures of a dataset with their poses: frames against frames by depth and poses, and the image
//! motion that events are compared with.
//!
//! A picture's pose is interpolated between the two poses around its stamp. Pictures outside of the
//! poses are left out.

use super::depth::read_depth;
use gs2e_check::geometry::watch::{GeometryWatch, PosedPictures};
use gs2e_check::geometry::{GeometryMeasures, PictureMeasures};
use gs2e_check::motion::warp::FlowAt;
use gs2e_check::photometric::align::smooth_picture;
use gs2e_image::Image;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::slerp;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::flow::flow_rates;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_sensor::frames::folder::read_luminance;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::twist::pose_twists;
use rayon::prelude::*;
use std::path::PathBuf;

/// Largest number of instants at which the image motion is measured.
const FLOWS: usize = 9;
/// Pictures that are read at a time.
const AT_ONCE: usize = 4;

/// One instant of a dataset, with its pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DatasetView {
    /// Stamp, us.
    pub t_us: i64,
    /// The frame, if it is a file of its own.
    pub frame: Option<PathBuf>,
    /// The depth image, if there is one.
    pub depth: Option<PathBuf>,
}

/// The pictures of a camera with poses.
#[derive(Debug)]
pub struct DatasetViews {
    camera: Camera,
    /// Steps per unit of length of depth images that are PNGs.
    depth_per_unit: Option<f64>,
    views: Vec<DatasetView>,
    /// The pose of each view, at its stamp.
    trajectory: Trajectory,
}

/// The measurements on the pictures of a dataset.
#[derive(Debug, Clone)]
pub struct ViewMeasures {
    /// The poses of the pictures.
    pub trajectory: Trajectory,
    /// Frames and depth images, by their poses.
    pub geometry: GeometryMeasures,
    /// The image motion at some instants.
    pub flows: Vec<FlowAt>,
}

impl DatasetViews {
    /// The views within the time of the poses. Their stamps must increase.
    #[must_use]
    pub fn new(
        camera: Camera,
        views: Vec<DatasetView>,
        poses: &Trajectory,
        depth_per_unit: Option<f64>,
    ) -> Self {
        let mut trajectory = Trajectory { world_from_camera: Vec::new(), stamps_us: Vec::new() };
        let mut kept = Vec::new();
        for view in views {
            if let Some(pose) = pose_at(poses, view.t_us) {
                trajectory.world_from_camera.push(pose);
                trajectory.stamps_us.push(view.t_us);
                kept.push(view);
            }
        }
        Self { camera, depth_per_unit, views: kept, trajectory }
    }

    /// Reads and compares all pictures.
    ///
    /// # Errors
    /// A picture cannot be read. The text names it, with the reason.
    pub fn measure(&self) -> Result<ViewMeasures, String> {
        let mut watch = GeometryWatch::new(self.camera, &self.trajectory.world_from_camera);
        let all: Vec<usize> = (0..self.views.len()).collect();
        for some in all.chunks(AT_ONCE) {
            let read = |view: &usize| -> Result<_, String> {
                let DatasetView { frame, depth, .. } = &self.views[*view];
                let smooth = |image: Image<f32>| smooth_picture(&image);
                let smoothed = frame.as_ref().map(|_| self.brightness(*view).map(smooth));
                let depth = depth.as_ref().map(|_| self.depth(*view));
                Ok((*view, smoothed.transpose()?, depth.transpose()?))
            };
            let pictures: Vec<_> = some.par_iter().map(read).collect::<Result<_, String>>()?;
            pictures.into_iter().for_each(|(view, smoothed, depth)| watch.see(view, smoothed, depth));
        }
        let PictureMeasures { pictures, order, depths } = watch.finish(self)?;
        let flows = Err("the dataset has no flow images that the checks read".to_owned());
        Ok(ViewMeasures {
            trajectory: self.trajectory.clone(),
            geometry: GeometryMeasures { pictures, order, depths, flows, objects: None },
            flows: self.flows()?,
        })
    }

    fn flows(&self) -> Result<Vec<FlowAt>, String> {
        let deep: Vec<usize> =
            (0..self.views.len()).filter(|view| self.views[*view].depth.is_some()).collect();
        let poses = &self.trajectory.world_from_camera;
        let seconds: Vec<f64> = self.trajectory.stamps_us.iter().map(|t| *t as f64 * 1e-6).collect();
        let twists = pose_twists(poses, &seconds);
        // The flow changes slowly along a path, and each image of it costs a decoded depth.
        let count = FLOWS.min(deep.len());
        let flow = |i: usize| {
            let view = deep[if count > 1 { i * (deep.len() - 1) / (count - 1) } else { 0 }];
            let (world_from_camera, twist) = (poses[view], twists[view]);
            // A twist has its linear rate in world axes, its angular rate in the camera's own.
            let linear = world_from_camera.rotation.conjugate() * twist.linear;
            let velocity = CameraVelocity { linear, angular: twist.angular };
            let at = CameraView { velocity, ..CameraView::at_rest(self.camera, world_from_camera) };
            Ok(FlowAt { t_us: self.views[view].t_us, px_s: flow_rates(&self.depth(view)?, &at) })
        };
        (0..count).into_par_iter().map(flow).collect()
    }
}

impl PosedPictures for DatasetViews {
    type Error = String;

    fn brightness(&self, pose: usize) -> Result<Image<f32>, String> {
        let path = self.views[pose].frame.as_ref().ok_or("a frame that is no file")?;
        read_luminance(path, self.camera.size).map_err(|e| e.to_string())
    }

    fn depth(&self, pose: usize) -> Result<Image<f32>, String> {
        let path = self.views[pose].depth.as_ref().ok_or("a view without depth")?;
        let read = read_depth(path, self.camera.size, self.depth_per_unit);
        read.map_err(|because| format!("{}: {because}", path.display()))
    }
}

/// The pose at a time; `None` outside of the poses.
fn pose_at(poses: &Trajectory, t_us: i64) -> Option<Se3> {
    let Trajectory { world_from_camera, stamps_us } = poses;
    let after = stamps_us.partition_point(|t| *t < t_us);
    // An exact pose stays exact: interpolation would round it.
    if stamps_us.get(after) == Some(&t_us) {
        return Some(world_from_camera[after]);
    }
    // No pose is extrapolated.
    let before = after.checked_sub(1)?;
    let (a, b) = (world_from_camera[before], world_from_camera.get(after)?);
    let share = (t_us - stamps_us[before]) as f64 / (stamps_us[after] - stamps_us[before]) as f64;
    Some(Se3 {
        rotation: slerp(a.rotation, b.rotation, share),
        translation: a.translation.lerp(b.translation, share),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn poses_are_interpolated_within_their_time() {
        let pose = |x: f64, angle: f64| Se3 {
            rotation: DQuat::from_rotation_z(angle),
            translation: DVec3::new(x, 0.0, 1.0),
        };
        let poses =
            Trajectory { world_from_camera: vec![pose(0.0, 0.0), pose(4.0, 0.4)], stamps_us: vec![100, 500] };
        for (t_us, wanted) in [(99, None), (100, Some(0.0)), (200, Some(0.25)), (500, Some(1.0)), (501, None)]
        {
            let found = pose_at(&poses, t_us);
            assert_eq!(found.map(|pose| pose.translation.x / 4.0), wanted, "{t_us}");
            if let (Some(pose), Some(share)) = (found, wanted) {
                let angle = 2.0 * pose.rotation.z.atan2(pose.rotation.w);
                assert!((angle - 0.4 * share).abs() < 1e-12, "{t_us}: {angle}");
            }
        }
    }
}
