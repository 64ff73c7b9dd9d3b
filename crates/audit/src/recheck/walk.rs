//! One walk over the pictures of a trajectory: each is decoded once, and all comparisons see it.
//!
//! Some poses are decoded at a time, in parallel. Meanwhile the poses before them are compared: frames with
//! frames, and frames with events.

use super::crossings::CrossingWatch;
use super::pictures::ReleasedPictures;
use gs2e_check::depth_consistency::disparity::DisparityDifference;
use gs2e_check::flash::blocks::FrameBlocks;
use gs2e_check::flow_projection::FlowDifference;
use gs2e_check::flow_projection::objects::ObjectFlow;
use gs2e_check::geometry::watch::GeometryWatch;
use gs2e_check::geometry::{GeometryMeasures, Measurement, PictureMeasures};
use gs2e_check::photometric::align::smooth_picture;
use gs2e_image::{GreyImage, Image};
use gs2e_render::objects::views_of_motions;
use gs2e_scene::camera::flow::{flow_rates, leave_out_objects};
use gs2e_scene::camera::stereo::Rectification;
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::motion::ObjectMotion;
use gs2e_tree::{PictureKind, TreeError};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Poses that are decoded at a time: enough for some cores, and little memory.
const AT_ONCE: usize = 4;

/// Numbers of the poses with pictures of each kind, ascending.
#[derive(Debug)]
pub(super) struct PicturesPresent {
    pub(super) sharp: Vec<usize>,
    depth: Vec<usize>,
    flow: Vec<usize>,
    disparity: Vec<usize>,
}

/// The motion of the objects and the second camera of the pair, by which pictures are compared with each
/// other.
pub(super) struct PictureGround<'a> {
    /// Motions of the objects by the stamp of the pose, us; `None` without a file of places.
    pub(super) motions: Option<BTreeMap<i64, Vec<ObjectMotion>>>,
    pub(super) pair: Option<&'a Rectification>,
}

/// The pictures at a pose.
struct DecodedPose {
    pose: usize,
    frame: Option<GreyImage>,
    smoothed: Option<Image<f32>>,
    depth: Option<Image<f32>>,
    flow: Option<FlowDifference>,
    objects: Option<ObjectFlow>,
    disparity: Option<DisparityDifference>,
}

/// What a walk measures.
pub(super) struct WalkedPictures {
    pub(super) geometry: GeometryMeasures,
    /// Brightness of the blocks of the sharp frames, without the changes of the light.
    pub(super) blocks: Vec<FrameBlocks>,
    /// `None` if the trajectory has no disparity images.
    pub(super) disparities: Option<Measurement<Vec<DisparityDifference>>>,
}

impl PicturesPresent {
    pub(super) fn find(pictures: &ReleasedPictures<'_>) -> Result<Self, TreeError> {
        Ok(Self {
            sharp: pictures.poses_with(PictureKind::Sharp)?,
            depth: pictures.poses_with(PictureKind::Depth)?,
            flow: pictures.poses_with(PictureKind::Flow)?,
            disparity: pictures.poses_with(PictureKind::Disparity)?,
        })
    }

    fn decode(
        &self,
        pictures: &ReleasedPictures<'_>,
        ground: &PictureGround<'_>,
        view: &CameraView,
        pose: usize,
    ) -> Result<DecodedPose, TreeError> {
        let is_in = |poses: &[usize]| poses.binary_search(&pose).is_ok();
        let frame = if is_in(&self.sharp) { Some(pictures.frame_with_form(pose)?) } else { None };
        let unlit = frame.as_ref().and_then(|frame| pictures.unlit(pose, frame));
        let smoothed = unlit.as_ref().map(smooth_picture);
        let mut found =
            DecodedPose { pose, frame, smoothed, depth: None, flow: None, objects: None, disparity: None };
        if !is_in(&self.depth) {
            return Ok(found);
        }
        let mut depth = pictures.files.values(PictureKind::Depth, pose)?;
        if let Some(pair) = ground.pair.filter(|_| is_in(&self.disparity)) {
            let stated = pictures.files.values(PictureKind::Disparity, pose)?;
            found.disparity = Some(DisparityDifference::new(pose, &stated, &pair.disparity_image(&depth)));
        }
        // Nothing says which pixels are still if the scene changes, or if objects move and there is no
        // segmentation.
        let segmentation = pictures.segmentation(pose)?;
        if pictures.changes() || (pictures.has_objects() && segmentation.is_none()) {
            return Ok(found);
        }
        let mut flow = if is_in(&self.flow) { Some(pictures.files.flow(pose)?) } else { None };
        if let Some(segmentation) = &segmentation {
            let motions = ground.motions.as_ref().and_then(|motions| motions.get(&pictures.stamp(pose)));
            if let (Some(flow), Some(motions)) = (&flow, motions) {
                let views = views_of_motions(motions, view);
                found.objects = Some(ObjectFlow::new(pose, flow, &depth, segmentation, &views));
            }
            flow.iter_mut().for_each(|flow| leave_out_objects(flow, segmentation));
            leave_out_objects(&mut depth, segmentation);
        }
        found.flow = flow.and_then(|flow| FlowDifference::new(pose, &flow, &flow_rates(&depth, view)));
        found.depth = Some(depth);
        Ok(found)
    }
}

/// Shows all pictures to the comparisons, in the order of the poses.
pub(super) fn walk_pictures(
    pictures: &ReleasedPictures<'_>,
    present: &PicturesPresent,
    ground: &PictureGround<'_>,
    streams: &mut [CrossingWatch],
) -> Result<WalkedPictures, TreeError> {
    let views = pictures.views();
    let mut geometry =
        GeometryWatch::new(pictures.files.camera, &pictures.motion.trajectory.world_from_camera);
    let (mut differences, mut objects, mut disparities) = (Vec::new(), Vec::new(), Vec::new());
    let mut blocks = Vec::new();
    let poses: Vec<usize> = (0..pictures.poses()).collect();
    let decode = |poses: &[usize]| -> Result<Vec<DecodedPose>, TreeError> {
        poses.par_iter().map(|pose| present.decode(pictures, ground, &views[*pose], *pose)).collect()
    };
    // Decoding is the longest part, and independent per pose. The comparisons need the order of
    // time.
    let mut batches = poses.chunks(AT_ONCE);
    let mut decoded = decode(batches.next().unwrap_or_default())?;
    while !decoded.is_empty() {
        let (mut frames, mut compared) = (Vec::new(), Vec::new());
        for found in decoded {
            let pose = found.pose;
            differences.extend(found.flow);
            objects.extend(found.objects);
            disparities.extend(found.disparity);
            blocks.extend(found.smoothed.as_ref().map(|smoothed| FrameBlocks::new(pose, smoothed)));
            frames.extend(found.frame.map(|frame| (pose, frame)));
            compared.push((pose, found.smoothed, found.depth));
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
    let moves_in_flow = pictures.has_objects() && !present.flow.is_empty();
    let objects = moves_in_flow.then(|| some_found(objects, NO_OBJECTS));
    let disparities = (!present.disparity.is_empty()).then(|| some_found(disparities, NO_DISPARITIES));
    let moves = pictures.other_motion().map(str::to_owned);
    let PictureMeasures { pictures, order, depths } = geometry.finish(pictures)?;
    let order = moves.map_or(order, Err);
    let geometry = GeometryMeasures { pictures, order, depths, flows, objects };
    Ok(WalkedPictures { geometry, blocks, disparities })
}

const NO_OBJECTS: &str = "no pose has flow, depth and a mask with the places of its objects";
const NO_DISPARITIES: &str = "no pose has both disparity and depth";

fn some_found<T>(found: Vec<T>, none: &str) -> Measurement<Vec<T>> {
    if found.is_empty() { Err(none.to_owned()) } else { Ok(found) }
}

impl PicturesPresent {
    fn flow_differences(&self, found: Vec<FlowDifference>) -> Measurement<Vec<FlowDifference>> {
        let both = self.flow.iter().any(|pose| self.depth.binary_search(pose).is_ok());
        if both { Ok(found) } else { Err("no pose has both flow and depth".to_owned()) }
    }
}

fn show_frames(
    pictures: &ReleasedPictures<'_>,
    frames: &[(usize, GreyImage)],
    streams: &mut [CrossingWatch],
) -> Result<(), TreeError> {
    streams.iter_mut().try_for_each(|stream| {
        frames.iter().try_for_each(|(pose, frame)| stream.see(pictures.stamp(*pose), frame))
    })
}
