//! One walk over the pictures of a trajectory: each is decoded once, and all comparisons see it.
//!
//! Some poses are decoded at a time, in parallel. Meanwhile the poses before them are compared: frames with
//! frames, and frames with events.

use super::RecheckError;
use super::crossings::CrossingWatch;
use super::pictures::ReleasedPictures;
use crate::check::flow_projection::FlowDifference;
use crate::check::geometry::watch::GeometryWatch;
use crate::check::geometry::{GeometryMeasures, Measured, PictureMeasures};
use crate::check::photometric::align::smooth_picture;
use crate::image::{GreyImage, Image};
use crate::render::CameraView;
use crate::render::flow::flow_rates;
use rayon::prelude::*;

/// Poses that are decoded at a time: enough for some cores, and little memory.
const AT_ONCE: usize = 4;

/// Numbers of the poses with pictures of each kind, ascending.
#[derive(Debug)]
pub(super) struct PicturesPresent {
    pub(super) sharp: Vec<usize>,
    depth: Vec<usize>,
    flow: Vec<usize>,
}

/// The pictures at a pose.
struct DecodedPose {
    pose: usize,
    frame: Option<GreyImage>,
    smoothed: Option<Image<f32>>,
    depth: Option<Image<f32>>,
    flow: Option<FlowDifference>,
}

impl PicturesPresent {
    pub(super) fn find(pictures: &ReleasedPictures<'_>) -> Result<Self, RecheckError> {
        Ok(Self {
            sharp: pictures.poses_with("sharp", "png")?,
            depth: pictures.poses_with("depth", "npy")?,
            flow: pictures.poses_with("flow", "npy")?,
        })
    }

    fn decode(
        &self,
        pictures: &ReleasedPictures<'_>,
        views: &[CameraView],
        pose: usize,
    ) -> Result<DecodedPose, RecheckError> {
        let is_in = |poses: &[usize]| poses.binary_search(&pose).is_ok();
        let frame = if is_in(&self.sharp) { Some(pictures.frame_with_form(pose)?) } else { None };
        let depth = if is_in(&self.depth) { pictures.still_depth(pose)? } else { None };
        let flow = match &depth {
            Some(depth) if is_in(&self.flow) => {
                FlowDifference::new(pose, &pictures.still_flow(pose)?, &flow_rates(depth, &views[pose]))
            }
            _ => None,
        };
        let unlit = frame.as_ref().and_then(|frame| pictures.unlit(pose, frame));
        let smoothed = unlit.as_ref().map(smooth_picture);
        Ok(DecodedPose { pose, frame, smoothed, depth, flow })
    }
}

/// Shows all pictures to the comparisons, in the order of the poses.
pub(super) fn walk_pictures(
    pictures: &ReleasedPictures<'_>,
    present: &PicturesPresent,
    streams: &mut [CrossingWatch],
) -> Result<GeometryMeasures, RecheckError> {
    let views = pictures.views();
    let mut geometry = GeometryWatch::new(pictures.camera, &pictures.motion.trajectory.world_from_camera);
    let mut differences = Vec::new();
    let poses: Vec<usize> = (0..pictures.poses()).collect();
    let decode = |poses: &[usize]| -> Result<Vec<DecodedPose>, RecheckError> {
        poses.par_iter().map(|pose| present.decode(pictures, &views, *pose)).collect()
    };
    // Decoding is the longest part, and independent per pose. The comparisons need the order of
    // time.
    let mut batches = poses.chunks(AT_ONCE);
    let mut decoded = decode(batches.next().unwrap_or_default())?;
    while !decoded.is_empty() {
        let (mut frames, mut compared) = (Vec::new(), Vec::new());
        for DecodedPose { pose, frame, smoothed, depth, flow } in decoded {
            differences.extend(flow);
            frames.extend(frame.map(|frame| (pose, frame)));
            compared.push((pose, smoothed, depth));
        }
        let mut following = Ok(Vec::new());
        // The readers of streams stay on this thread.
        rayon::in_place_scope(|scope| {
            scope.spawn(|_| {
                compared.into_iter().for_each(|(pose, smoothed, depth)| geometry.see(pose, smoothed, depth));
            });
            scope.spawn(|_| following = decode(batches.next().unwrap_or_default()));
            show_frames(pictures, &frames, streams)
        })?;
        decoded = following?;
    }
    let flows = present.flow_differences(differences);
    let moves = pictures.own_motion().map(str::to_owned);
    let PictureMeasures { pictures, order, depths } = geometry.finish(pictures)?;
    let order = moves.map_or(order, Err);
    Ok(GeometryMeasures { pictures, order, depths, flows })
}

impl PicturesPresent {
    fn flow_differences(&self, found: Vec<FlowDifference>) -> Measured<Vec<FlowDifference>> {
        let both = self.flow.iter().any(|pose| self.depth.binary_search(pose).is_ok());
        if both { Ok(found) } else { Err("no pose has both flow and depth".to_owned()) }
    }
}

fn show_frames(
    pictures: &ReleasedPictures<'_>,
    frames: &[(usize, GreyImage)],
    streams: &mut [CrossingWatch],
) -> Result<(), RecheckError> {
    streams.iter_mut().try_for_each(|stream| {
        frames.iter().try_for_each(|(pose, frame)| stream.see(pictures.stamp(*pose), frame))
    })
}
