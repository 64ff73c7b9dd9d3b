//! Measurements on pictures by their poses: the input of the passes `photometric`,
//! `depth_consistency` and `flow_projection`.

pub mod readings;
pub mod watch;

use super::flow_projection::FlowDifference;
use super::flow_projection::objects::ObjectFlow;
use super::photometric::align::PairAlignment;
use super::photometric::order::FrameTriple;

/// A measurement, or the reason for its absence.
pub type Measurement<T> = Result<T, String>;

/// The measurements on the pictures of a trajectory.
#[derive(Debug, Clone)]
pub struct GeometryMeasures {
    /// Frames against frames.
    pub pictures: Measurement<AlignedPairs>,
    /// Differences of frames in a row.
    pub order: Measurement<Vec<FrameTriple>>,
    /// Depth images against depth images.
    pub depths: Measurement<AlignedPairs>,
    /// Flow images against the flow of depth and poses, one per image.
    pub flows: Measurement<Vec<FlowDifference>>,
    /// Flow images against the motion of objects; `None` if nothing moves by itself.
    pub objects: Option<Measurement<Vec<ObjectFlow>>>,
}

/// The measurements that need no flow images.
#[derive(Debug, Clone)]
pub struct PictureMeasures {
    /// Frames against frames.
    pub pictures: Measurement<AlignedPairs>,
    /// Differences of frames in a row.
    pub order: Measurement<Vec<FrameTriple>>,
    /// Depth images against depth images.
    pub depths: Measurement<AlignedPairs>,
}

/// Alignments of some pairs of pictures.
#[derive(Debug, Clone, Default)]
pub struct AlignedPairs {
    /// Pairs far enough apart for a motion of about a pixel, spread over the trajectory.
    pub apart: Vec<PairAlignment>,
    /// Neighbouring pictures.
    pub neighbours: Vec<PairAlignment>,
    /// The reading of the poses or depths that the pictures agree with, where they do not agree
    /// with the stated one; for example `poses from world to camera`.
    pub agrees_with: Option<String>,
}
