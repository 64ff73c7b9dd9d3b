//! The sharp frames that the counts of events are compared with: some of them, through the front ends
//! of the sensors. Their number is bounded, whatever the length of the trajectory.

use super::pictures::ReleasedPictures;
use gs2e_image::{GreyImage, Image};
use gs2e_num::stats::nearest_ranks;
use gs2e_num::units::Timestamp;
use gs2e_recipe::OutputKind;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::frames::anchors::{AnchorChoice, AnchorFrames};
use gs2e_sensor::front_end::FrontEnd;
use gs2e_trajectory::flow::FlowQuantiles;
use gs2e_tree::{PictureKind, TreeError};
use rayon::prelude::*;

/// Memory for the frames of one front end, bytes.
const FRAME_BYTES: usize = 256 << 20;
/// Bounds of the number of equal intervals into which frames divide a trajectory.
const INTERVALS: [usize; 2] = [4, 64];
/// Image motion in one interval, px: enough for a change of brightness, and little enough for a gap in
/// the events to show.
const INTERVAL_PX: f64 = 2.0;
/// Largest image motion between the frames of a span, px. Within a span, pixels change steadily.
const SPAN_PX: f64 = 2.0;
/// Gradient from which on a pixel shows the motion of the image, greys per px.
const EDGE: f32 = 8.0;
/// Level of a channel at which a picture is clipped.
const FULL: f32 = 255.0;

/// Chooses frames and reads them: the same for all front ends, as each shows them. None if there are fewer
/// than two sharp frames. A pixel with a channel at full scale is NaN.
///
/// The walk over all pictures decodes these again. That costs less than to count the events after the walk
/// instead of at the same time.
pub(super) fn read_anchors(
    pictures: &ReleasedPictures<'_>,
    front_ends: &[FrontEnd],
    steps_px: Option<FlowQuantiles>,
) -> Result<Vec<AnchorFrames>, TreeError> {
    let there = pictures.kept_poses(PictureKind::Sharp, OutputKind::Sharp)?;
    if there.len() < 2 || front_ends.is_empty() {
        return Ok(Vec::new());
    }
    let stamps: Vec<i64> = there.iter().map(|pose| pictures.stamp(*pose)).collect();
    let frame_px = frame_motion(pictures, &there, steps_px)?;
    let choice = choose_anchors(&stamps, frame_px, pictures.files.camera.size.pixels() * front_ends.len());
    let read = |index: &usize| read_anchor_frame(pictures, front_ends, there[*index]);
    let frames: Vec<Vec<DenseFrame>> = choice.frames.par_iter().map(read).collect::<Result<_, _>>()?;
    let mut anchors = vec![AnchorFrames::without_frames(&choice); front_ends.len()];
    for views in frames {
        for (anchors, frame) in anchors.iter_mut().zip(views) {
            anchors.stamps_us.push(frame.t.floor_micros());
            anchors.images.push(frame.luminance);
        }
    }
    Ok(anchors)
}

/// The frame at a pose, as each front end shows it.
fn read_anchor_frame(
    pictures: &ReleasedPictures<'_>,
    front_ends: &[FrontEnd],
    pose: usize,
) -> Result<Vec<DenseFrame>, TreeError> {
    let GreyImage { luminance, colours } = pictures.frame(pose)?;
    let t = Timestamp::from_micros(pictures.stamp(pose));
    let dense = DenseFrame { index: pose, t, luminance, rate: None };
    let see = |front_end: &FrontEnd| {
        let mut view = front_end.see(&dense, colours.as_ref());
        forget_clipped(&mut view.luminance, colours.as_ref(), &dense.luminance);
        view
    };
    Ok(front_ends.iter().map(see).collect())
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded numbers of frames")]
fn choose_anchors(stamps: &[i64], frame_px: f64, values: usize) -> AnchorChoice {
    // Without motion, the quotient is infinite, and the choice of anchors clamps it.
    let apart = (1.0 / frame_px).round() as usize;
    // Anchors are kept for each sensor until the events are counted, so the choice bounds the
    // memory.
    let room = FRAME_BYTES / (4 * values).max(1);
    let wanted = (frame_px * stamps.len() as f64 / INTERVAL_PX) as usize;
    let intervals = wanted.min(room).clamp(INTERVALS[0], INTERVALS[1]);
    let mut choice = AnchorChoice::in_intervals(stamps, apart, intervals as i64);
    if frame_px > SPAN_PX {
        // The image moves too far between any two frames.
        choice.spans.clear();
    }
    choice
}

/// Median image motion between neighbouring kept frames, px: from the flow, or else from the frames.
fn frame_motion(
    pictures: &ReleasedPictures<'_>,
    there: &[usize],
    steps_px: Option<FlowQuantiles>,
) -> Result<f64, TreeError> {
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
fn forget_clipped(brightness: &mut Image<f32>, colours: Option<&Image<[f32; 3]>>, grey: &Image<f32>) {
    for (i, value) in brightness.pixels_mut().iter_mut().enumerate() {
        let clipped = match colours {
            Some(colours) => colours.pixels()[i].iter().any(|channel| *channel >= FULL),
            None => grey.pixels()[i] >= FULL,
        };
        // Released frames end at white, and the sensor saw the light above it. NaN keeps the pixel
        // out of every comparison.
        if clipped {
            *value = f32::NAN;
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
