//! The sharp frames that the counts of events are compared with: some of them, through the front ends
//! of the sensors. Their number is bounded, whatever the length of the trajectory.

use super::RecheckError;
use super::pictures::ReleasedPictures;
use crate::frames::DenseFrame;
use crate::frames::anchors::{AnchorChoice, AnchorFrames};
use crate::image::{GreyImage, Image};
use crate::recipe::OutputKind;
use crate::render::flow::{FlowQuantiles, nearest_ranks};
use crate::sensor::front_end::FrontEnd;
use crate::units::Timestamp;

/// Memory for the frames of one front end, bytes.
const FRAME_BYTES: usize = 256 << 20;
/// Bounds of the number of equal parts into which frames divide a trajectory.
const PARTS: [usize; 2] = [4, 64];
/// Image motion in one part, px: enough for a change of brightness, and little enough for a gap in
/// the events to show.
const PART_PX: f64 = 2.0;
/// Gradient from which on a pixel shows the motion of the image, greys per px.
const EDGE: f32 = 8.0;
/// Level of a channel at which a picture is clipped.
const FULL: f32 = 255.0;

/// The chosen frames, which come in turn.
#[derive(Debug)]
pub(super) struct AnchorWatch<'a> {
    front_ends: &'a [FrontEnd],
    /// Poses of the chosen frames, ascending.
    poses: Vec<usize>,
    anchors: Vec<AnchorFrames>,
}

impl<'a> AnchorWatch<'a> {
    /// Chooses frames for each front end: none if there are fewer than two sharp frames.
    pub(super) fn choose(
        pictures: &ReleasedPictures<'_>,
        front_ends: &'a [FrontEnd],
        steps_px: Option<FlowQuantiles>,
    ) -> Result<Self, RecheckError> {
        let there = pictures.kept_poses(OutputKind::Sharp, "png")?;
        if there.len() < 2 || front_ends.is_empty() {
            return Ok(Self { front_ends, poses: Vec::new(), anchors: Vec::new() });
        }
        let stamps: Vec<i64> = there.iter().map(|pose| pictures.stamp(*pose)).collect();
        let frame_px = frame_motion(pictures, &there, steps_px)?;
        let choice = choose_anchors(&stamps, frame_px, pictures.camera.size.pixels() * front_ends.len());
        let anchors = vec![AnchorFrames::without_frames(&choice); front_ends.len()];
        let poses = choice.frames.iter().map(|index| there[*index]).collect();
        Ok(Self { front_ends, poses, anchors })
    }

    /// Keeps the frame at a pose if it is one of the chosen. A pixel with a channel at full scale
    /// is NaN.
    pub(super) fn see(&mut self, pose: usize, t_us: i64, frame: &GreyImage) {
        let Ok(index) = self.poses.binary_search(&pose) else { return };
        let (luminance, colours) = (frame.luminance.clone(), frame.colours.as_ref());
        let dense = DenseFrame { index, t: Timestamp::from_micros(t_us), luminance, rate: None };
        for (front_end, anchors) in self.front_ends.iter().zip(&mut self.anchors) {
            let mut seen = front_end.see(&dense, colours);
            forget_clipped(&mut seen.luminance, colours, &dense.luminance);
            anchors.keep(&seen, t_us);
        }
    }

    /// The frames, the same for all front ends, as each front end shows them.
    pub(super) fn finish(self) -> Vec<AnchorFrames> {
        self.anchors
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded numbers of frames")]
fn choose_anchors(stamps: &[i64], frame_px: f64, values: usize) -> AnchorChoice {
    // Without motion, the quotient is infinite, and the choice of anchors clamps it.
    let apart = (1.0 / frame_px).round() as usize;
    // Anchors are kept for each sensor until the events are counted, so the choice bounds the
    // memory.
    let room = FRAME_BYTES / (4 * values).max(1);
    let wanted = (frame_px * stamps.len() as f64 / PART_PX) as usize;
    let parts = wanted.min(room).clamp(PARTS[0], PARTS[1]);
    AnchorChoice::in_parts(stamps, apart, parts as i64)
}

/// Median image motion between neighbouring kept frames, px: from the flow, or else from the frames.
fn frame_motion(
    pictures: &ReleasedPictures<'_>,
    there: &[usize],
    steps_px: Option<FlowQuantiles>,
) -> Result<f64, RecheckError> {
    let poses_per_frame = (there[there.len() - 1] - there[0]) as f64 / (there.len() - 1) as f64;
    if let Some(flow) = steps_px {
        return Ok(f64::from(flow.median) * poses_per_frame);
    }
    let start = there.len() / 2;
    let first = pictures.frame(there[start])?.luminance;
    let mut apart = 1;
    // The greys of a slow image must change by some steps before its motion can be read.
    loop {
        let Some(pose) = there.get(start + apart) else { return Ok(0.0) };
        let moved = edge_motion(&first, &pictures.frame(*pose)?.luminance);
        if moved > 0.5 {
            return Ok(f64::from(moved) / apart as f64);
        }
        // Doubled, so that a nearly still camera costs a few pictures and not all of them.
        apart *= 2;
    }
}

/// Makes the brightness of clipped pixels unknown.
fn forget_clipped(seen: &mut Image<f32>, colours: Option<&Image<[f32; 3]>>, grey: &Image<f32>) {
    for (i, seen) in seen.pixels_mut().iter_mut().enumerate() {
        let clipped = match colours {
            Some(colours) => colours.pixels()[i].iter().any(|channel| *channel >= FULL),
            None => grey.pixels()[i] >= FULL,
        };
        // Released frames end at white, and the sensor saw the light above it. NaN keeps the pixel
        // out of every comparison.
        if clipped {
            *seen = f32::NAN;
        }
    }
}

/// Median motion of the image along its gradient, px, over pixels with a clear gradient; 0 without
/// such pixels.
fn edge_motion(from: &Image<f32>, to: &Image<f32>) -> f32 {
    let width = from.size().width as usize;
    let (a, b) = (from.pixels(), to.pixels());
    let inner = (width + 1)..a.len().saturating_sub(width + 1);
    let moved = inner.filter_map(|i| {
        let [dx, dy] = [0.5 * (a[i + 1] - a[i - 1]), 0.5 * (a[i + width] - a[i - width])];
        // At an edge, the change of brightness over its slope is the motion. Elsewhere noise would
        // be divided by nearly nothing.
        let slope = (dx * dx + dy * dy).sqrt();
        (slope > EDGE).then(|| (b[i] - a[i]).abs() / slope)
    });
    nearest_ranks(moved.collect(), [50]).map_or(0.0, |[median]| median)
}
