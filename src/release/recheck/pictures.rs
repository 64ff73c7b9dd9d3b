//! The pictures of a trajectory as the checks see them: some sharp frames through the front ends of
//! the sensors, and the image motion at some instants. Their number is bounded, whatever the length
//! of the trajectory.

use super::{AuditedTree, RecheckError};
use crate::artifact::TrajectoryProduct;
use crate::camera::Camera;
use crate::check::coverage::ViewCoverage;
use crate::check::motion::warp::FlowAt;
use crate::frames::DenseFrame;
use crate::frames::anchors::{AnchorChoice, AnchorFrames};
use crate::image::{GreyImage, Image, Size, npy, png};
use crate::recipe::{OutputKind, Recipe};
use crate::render::CameraView;
use crate::render::flow::{FlowQuantiles, flow_displacement, flow_rates, nearest_ranks};
use crate::sampling::exposure;
use crate::sensor::front_end::FrontEnd;
use crate::units::Timestamp;
use std::io::BufReader;

/// Largest number of instants at which the image motion is read.
const FLOWS: usize = 9;
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

/// A trajectory's folder, and what its files say about its pictures.
#[derive(Debug, Clone, Copy)]
pub(super) struct PictureFolder<'a> {
    pub(super) tree: AuditedTree<'a>,
    /// Path of the folder in the tree.
    pub(super) path: &'a str,
    pub(super) recipe: &'a Recipe,
    pub(super) motion: &'a TrajectoryProduct,
    pub(super) camera: Camera,
}

/// The image motion along a trajectory.
#[derive(Debug, Default)]
pub(super) struct MeasuredMotion {
    pub(super) flows: Vec<FlowAt>,
    /// Between neighbouring poses.
    pub(super) steps_px: Option<FlowQuantiles>,
    pub(super) coverage: Option<ViewCoverage>,
}

impl PictureFolder<'_> {
    fn name(&self, kind: &str, pose: usize, end: &str) -> String {
        format!("{}/{kind}/{pose:06}{end}", self.path)
    }

    fn poses(&self) -> usize {
        self.motion.trajectory.world_from_camera.len()
    }

    fn asks(&self, output: OutputKind) -> bool {
        self.recipe.outputs.contains(&output)
    }

    /// The poses with a picture of this kind in the tree.
    fn present(&self, kind: &str, end: &str, every: u32) -> Result<Vec<usize>, RecheckError> {
        let exposed = (kind == "sharp" && self.asks(OutputKind::Blur)).then_some(self.recipe.shutter.frames);
        let mut there = Vec::new();
        for pose in exposure::kept_poses(self.poses(), every, exposed) {
            if self.tree.has(&self.name(kind, pose, end))? {
                there.push(pose);
            }
        }
        Ok(there)
    }

    /// The colours of a picture, if it is in the tree.
    pub(super) fn picture(&self, kind: &str, pose: usize) -> Result<Option<Image<[u8; 3]>>, RecheckError> {
        let name = self.name(kind, pose, ".png");
        let Some(file) = self.tree.open(&name)? else { return Ok(None) };
        let read = png::read_sized(BufReader::new(file), self.camera.size);
        read.map(Some).map_err(|e| self.tree.refusal(&name, e))
    }

    /// The grey of a sharp frame, as a sensor without a front end of its own sees it.
    fn grey(&self, pose: usize) -> Result<GreyImage, RecheckError> {
        let name = self.name("sharp", pose, ".png");
        let file = self.tree.open(&name)?.ok_or_else(|| self.tree.refusal(&name, "it is missing"))?;
        let read = png::read_colours(BufReader::new(file), Some(self.camera.size));
        read.map_err(|e| self.tree.refusal(&name, e))
    }

    /// Frames as each front end shows them, and the same for all front ends: none if there are
    /// fewer than two sharp frames. A pixel with a channel at full scale is NaN.
    pub(super) fn anchors(
        &self,
        front_ends: &[FrontEnd],
        steps_px: Option<FlowQuantiles>,
    ) -> Result<Vec<AnchorFrames>, RecheckError> {
        let there = self.present("sharp", ".png", self.recipe.every.poses(OutputKind::Sharp))?;
        if there.len() < 2 || front_ends.is_empty() {
            return Ok(Vec::new());
        }
        let stamps: Vec<i64> = there.iter().map(|pose| self.motion.trajectory.stamps_us[*pose]).collect();
        let frame_px = self.frame_motion(&there, steps_px)?;
        let choice = self.choose(&stamps, frame_px, front_ends.len());
        let mut anchors = vec![AnchorFrames::without_frames(&choice); front_ends.len()];
        for index in &choice.frames {
            let GreyImage { luminance, colours } = self.grey(there[*index])?;
            let t = Timestamp::from_micros(stamps[*index]);
            let frame = DenseFrame { index: *index, t, luminance, rate: None };
            for (front_end, anchors) in front_ends.iter().zip(&mut anchors) {
                let mut seen = front_end.see(&frame, colours.as_ref());
                forget_clipped(&mut seen.luminance, colours.as_ref(), &frame.luminance);
                anchors.keep(&seen, stamps[*index]);
            }
        }
        Ok(anchors)
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded numbers of frames")]
    fn choose(&self, stamps: &[i64], frame_px: f64, front_ends: usize) -> AnchorChoice {
        // Without motion, the quotient is infinite, and the choice of anchors clamps it.
        let apart = (1.0 / frame_px).round() as usize;
        let room = FRAME_BYTES / (4 * self.camera.size.pixels() * front_ends).max(1);
        let wanted = (frame_px * stamps.len() as f64 / PART_PX) as usize;
        let parts = wanted.min(room).clamp(PARTS[0], PARTS[1]);
        AnchorChoice::in_parts(stamps, apart, parts as i64)
    }

    /// Median image motion between neighbouring kept frames, px: from the flow, or else from the
    /// frames.
    fn frame_motion(&self, there: &[usize], steps_px: Option<FlowQuantiles>) -> Result<f64, RecheckError> {
        let poses_per_frame = (there[there.len() - 1] - there[0]) as f64 / (there.len() - 1) as f64;
        if let Some(flow) = steps_px {
            return Ok(f64::from(flow.median) * poses_per_frame);
        }
        let start = there.len() / 2;
        let first = self.grey(there[start])?.luminance;
        let mut apart = 1;
        // The greys of a slow image must change by some steps before its motion can be read.
        loop {
            let Some(pose) = there.get(start + apart) else { return Ok(0.0) };
            let moved = edge_motion(&first, &self.grey(*pose)?.luminance);
            if moved > 0.5 {
                return Ok(f64::from(moved) / apart as f64);
            }
            apart *= 2;
        }
    }

    /// The image motion at some instants: by `flow/`, or else by `depth/` and the poses.
    pub(super) fn measured_motion(&self) -> Result<MeasuredMotion, RecheckError> {
        let flows = self.present("flow", ".npy", self.recipe.every.poses(OutputKind::Flow))?;
        let depths = self.present("depth", ".npy", self.recipe.every.poses(OutputKind::Depth))?;
        let mut found = MeasuredMotion::default();
        let (mut moved_px, mut covered) = (Vec::new(), Vec::new());
        let seconds = self.motion.seconds();
        for pose in spread(&depths) {
            let depth = self.depth(pose)?;
            if flows.is_empty() {
                let view = self.view(pose);
                moved_px.extend(
                    self.neighbour(pose)
                        .into_iter()
                        .flat_map(|other| flow_displacement(&depth, &view, &self.view(other)).into_pixels()),
                );
                found.flows.push(FlowAt { t_us: self.stamp(pose), px_s: flow_rates(&depth, &view) });
            }
            covered.push((self.stamp(pose), depth));
        }
        for pose in spread(&flows) {
            let px_s = self.flow(pose)?;
            let step = self.neighbour(pose).map_or(0.0, |other| (seconds[other] - seconds[pose]).abs());
            #[expect(clippy::cast_possible_truncation, reason = "a duration for 32-bit speeds")]
            let step = step as f32;
            moved_px.extend(px_s.pixels().iter().map(|[u, v]| (u * u + v * v).sqrt() * step));
            if depths.is_empty() {
                // Flow is NaN where depth is.
                let along_x = px_s.pixels().iter().map(|[u, _]| *u).collect();
                covered.push((self.stamp(pose), Image::from_vec(self.camera.size, along_x)));
            }
            found.flows.push(FlowAt { t_us: self.stamp(pose), px_s });
        }
        found.steps_px = FlowQuantiles::from_values(moved_px);
        found.coverage = ViewCoverage::from_depths(covered.iter().map(|(t_us, depth)| (*t_us, depth)));
        Ok(found)
    }

    fn stamp(&self, pose: usize) -> i64 {
        self.motion.trajectory.stamps_us[pose]
    }

    /// The next pose, or the one before at the end.
    fn neighbour(&self, pose: usize) -> Option<usize> {
        if pose + 1 < self.poses() { Some(pose + 1) } else { pose.checked_sub(1) }
    }

    fn view(&self, pose: usize) -> CameraView {
        let world_from_camera = self.motion.trajectory.world_from_camera[pose];
        let velocity = self.motion.velocities()[pose];
        CameraView { camera: self.camera, world_from_camera, velocity }
    }

    fn depth(&self, pose: usize) -> Result<Image<f32>, RecheckError> {
        let values = self.values("depth", pose, &[])?;
        Ok(Image::from_vec(self.camera.size, values))
    }

    fn flow(&self, pose: usize) -> Result<Image<[f32; 2]>, RecheckError> {
        let values = self.values("flow", pose, &[2])?;
        Ok(Image::from_vec(self.camera.size, values.as_chunks().0.to_vec()))
    }

    fn values(&self, kind: &str, pose: usize, rest: &[u64]) -> Result<Vec<f32>, RecheckError> {
        let name = self.name(kind, pose, ".npy");
        let file = self.tree.open(&name)?.ok_or_else(|| self.tree.refusal(&name, "it is missing"))?;
        let Size { width, height } = self.camera.size;
        let shape = [&[u64::from(height), u64::from(width)], rest].concat();
        npy::read_values(&shape, &mut BufReader::new(file)).map_err(|e| self.tree.refusal(&name, e))
    }
}

/// At most [`FLOWS`] of these poses, evenly spread, with both ends.
fn spread(poses: &[usize]) -> impl Iterator<Item = usize> {
    let count = FLOWS.min(poses.len());
    (0..count).map(move |i| poses[if count > 1 { i * (poses.len() - 1) / (count - 1) } else { 0 }])
}

/// Makes the brightness of clipped pixels unknown.
fn forget_clipped(seen: &mut Image<f32>, colours: Option<&Image<[f32; 3]>>, grey: &Image<f32>) {
    for (i, seen) in seen.pixels_mut().iter_mut().enumerate() {
        let clipped = match colours {
            Some(colours) => colours.pixels()[i].iter().any(|channel| *channel >= FULL),
            None => grey.pixels()[i] >= FULL,
        };
        if clipped {
            *seen = f32::NAN;
        }
    }
}

/// Median motion of the image along its gradient, px, over pixels with a clear gradient; 0 if there
/// is none.
fn edge_motion(from: &Image<f32>, to: &Image<f32>) -> f32 {
    let width = from.size().width as usize;
    let (a, b) = (from.pixels(), to.pixels());
    let inner = (width + 1)..a.len().saturating_sub(width + 1);
    let moved = inner.filter_map(|i| {
        let [dx, dy] = [0.5 * (a[i + 1] - a[i - 1]), 0.5 * (a[i + width] - a[i - width])];
        let slope = (dx * dx + dy * dy).sqrt();
        (slope > EDGE).then(|| (b[i] - a[i]).abs() / slope)
    });
    nearest_ranks(moved.collect(), [50]).map_or(0.0, |[median]| median)
}
