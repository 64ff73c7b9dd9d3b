//! Blurred frames: the exposure of each, and its sub-frames.
//!
//! An exposure is the mean, in linear light, of `frames` pictures at equal steps of time, those of
//! the dense frames around a pose. If the image moves by more than a pixel per step, sub-frames are
//! added: a mean of frames that are ten pixels apart is a row of ghosts, not blur.

use super::path::SampledPath;
use crate::camera::Camera;
use crate::image::Image;
use crate::image::light::LinearLightSum;
use crate::render::{
    CameraVelocity, CameraView, ChannelSet, RenderError, RenderWork, RenderedImages, Renderer,
};
use crate::se3::Se3;
use crate::se3::rotation_spline::SplineDiverged;
use serde::{Deserialize, Serialize};

/// Parameters of blurred frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ShutterSettings {
    /// Dense frames per exposure. The number is odd, so that one is in the middle. Exposures follow
    /// one another without a gap.
    pub frames: u32,
    /// Number of sub-frames.
    pub subframes: SubframeRule,
}

/// The number of sub-frames per dense frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SubframeRule {
    /// An odd number per dense frame, at most 33, so that the picture moves by at most 1 px between
    /// two. Motion beyond that draws a warning. It is measured at pixels with a depth.
    Auto,
    /// No sub-frames.
    Literal,
}

/// Default number of dense frames per exposure.
pub const FRAMES: u32 = 15;

/// Maximum sub-frames per dense frame; bounds the cost of an exposure. Residual motion above 1 px
/// is reported as a warning.
const MAX_SUBFRAMES: u32 = 33;

/// Time difference to a pose below which the pose is used itself, s: stamps are whole microseconds.
const SAME: f64 = 1e-9;

/// Record of a blurred frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureRecord {
    /// Index of the pose in the middle.
    pub pose: usize,
    /// Opening time of the shutter.
    pub start_us: i64,
    /// Closing time of the shutter.
    pub end_us: i64,
    /// Sub-frames per dense frame; 1 for dense frames alone.
    pub subframes: u32,
    /// The largest motion between two neighbouring sub-frames, px, over pixels with a depth at the
    /// dense frames; `None` if it was not measured.
    pub step_px: Option<f32>,
}

impl ExposureRecord {
    /// The pose and the times of the shutter.
    #[must_use]
    pub fn times(&self) -> (usize, [i64; 2]) {
        (self.pose, [self.start_us, self.end_us])
    }
}

/// The poses at the centres of exposures of this many frames: back to back, each exposure within
/// the path.
#[must_use]
pub fn exposure_centres(poses: usize, frames: u32) -> Vec<usize> {
    let frames = frames as usize;
    // One frame beyond half an exposure: the shutter opens halfway to the frame before.
    let beyond = frames / 2 + 1;
    (beyond..poses.saturating_sub(beyond)).step_by(frames).collect()
}

/// Opening and closing time of the shutter around one of [`exposure_centres`], s: halfway between
/// the frames of the exposure and the frames beyond.
///
/// # Panics
/// There are no frames beyond.
#[must_use]
pub fn shutter_times(seconds: &[f64], pose: usize, frames: u32) -> [f64; 2] {
    let half = frames as usize / 2;
    let halfway = |i: usize| f64::midpoint(seconds[i], seconds[i + 1]);
    [halfway(pose - half - 1), halfway(pose + half)]
}

/// [`shutter_times`], in whole microseconds.
///
/// # Panics
/// There are no frames beyond.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "a trajectory lasts no 292,000 years")]
pub fn open_us(seconds: &[f64], pose: usize, frames: u32) -> [i64; 2] {
    shutter_times(seconds, pose, frames).map(|s| (s * 1e6).round() as i64)
}

/// Indices of the poses with a sharp frame that is kept, ascending: every `every`-th pose, and the
/// centres of exposures of `exposed` frames.
#[must_use]
pub fn kept_poses(poses: usize, every: u32, exposed: Option<u32>) -> Vec<usize> {
    let mut kept: Vec<usize> = (0..poses).step_by(every as usize).collect();
    kept.extend(exposed.iter().flat_map(|frames| exposure_centres(poses, *frames)));
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// The error for a trajectory that ends before a shutter closes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the trajectory has {poses} poses, but an exposure of {frames} frames needs {}; \
     lower `frames` in `blur`", u64::from(*frames) + 2
)]
pub struct TooShort {
    /// Number of poses of the trajectory.
    pub poses: usize,
    /// Number of frames of an exposure.
    pub frames: u32,
}

/// A warning for sub-frames that are so far apart that edges appear separately.
#[must_use]
pub fn ghost_warning(exposures: &[ExposureRecord]) -> Option<String> {
    let apart: Vec<(f32, usize)> =
        exposures.iter().filter_map(|e| Some((e.step_px?, e.pose))).filter(|(px, _)| *px > 1.0).collect();
    let (px, pose) = apart.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(format!(
        "{} of {} blurred frames average pictures more than 1 px apart; at pose {pose} a pixel moves by {px:.1} px \
         between two of them, though {MAX_SUBFRAMES} stand for a dense frame",
        apart.len(),
        exposures.len()
    ))
}

/// A blurred frame.
#[derive(Debug, Clone)]
pub struct ExposedFrame {
    /// The record of its exposure.
    pub exposure: ExposureRecord,
    /// The mean of its sub-frames, display-encoded, 0..1.
    pub picture: Image<[f32; 3]>,
}

/// The reason why a frame was not exposed.
#[derive(Debug, thiserror::Error)]
pub enum ExposeError {
    /// The frame cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The caller stopped.
    #[error("interrupted")]
    Interrupted,
}

/// The camera of an exposure and its motion.
#[derive(Debug)]
pub struct ExposureCourse<'a> {
    /// The camera.
    pub camera: Camera,
    /// Its pose at each dense frame.
    pub poses: &'a [Se3],
    /// Times of the dense frames, s, strictly increasing.
    pub seconds: &'a [f64],
}

/// Exposes the blurred frames of a course one after another.
pub struct FrameExposer<'a> {
    renderer: &'a mut dyn Renderer,
    course: ExposureCourse<'a>,
    path: SampledPath,
    shutter: ShutterSettings,
    rendered: RenderedImages,
    /// The work of the renderer so far.
    pub work: RenderWork,
}

impl std::fmt::Debug for FrameExposer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Exposer")
            .field("renderer", &self.renderer.fingerprint())
            .field("course", &self.course)
            .field("shutter", &self.shutter)
            .finish_non_exhaustive()
    }
}

impl<'a> FrameExposer<'a> {
    /// Prepares the exposure of a course as seen by a renderer.
    ///
    /// # Errors
    /// No smooth path leads through the poses.
    ///
    /// # Panics
    /// There are fewer than two poses, or there is not one strictly increasing time per pose.
    pub fn new(
        renderer: &'a mut dyn Renderer,
        course: ExposureCourse<'a>,
        shutter: ShutterSettings,
    ) -> Result<Self, SplineDiverged> {
        let path = SampledPath::through_poses(course.poses, course.seconds.to_vec())?;
        Ok(Self {
            renderer,
            course,
            path,
            shutter,
            rendered: RenderedImages::default(),
            work: RenderWork::default(),
        })
    }

    /// Exposes the frame around one of [`exposure_centres`], while `go_on` returns true.
    ///
    /// # Errors
    /// The renderer fails, or `go_on` returns false.
    pub fn expose(&mut self, pose: usize, go_on: &dyn Fn() -> bool) -> Result<ExposedFrame, ExposeError> {
        let [start, end] = self.open(pose);
        let frames = self.shutter.frames;
        let mut light = LinearLightSum::empty_sum(self.course.camera.size);
        let sees_motion = self.shutter.subframes == SubframeRule::Auto;
        // The dense frames come first, because their flow determines the number of sub-frames.
        let dense: Vec<SubframeTime> = (0..frames).map(|k| self.moment(pose, k, 1)).collect();
        let fastest = self.add(&dense, sees_motion, &mut light, go_on)?;
        let moved = f64::from(fastest) * (end - start) / f64::from(frames);
        let subframes = subframe_count(moved);
        // Each dense frame is in the middle of its sub-frames, because their number is odd.
        let between = (0..frames * subframes).filter(|k| k % subframes != subframes / 2);
        let between: Vec<SubframeTime> = between.map(|k| self.moment(pose, k, subframes)).collect();
        self.add(&between, false, &mut light, go_on)?;
        #[expect(clippy::cast_possible_truncation, reason = "pixels, printed with a few digits")]
        let step_px = sees_motion.then_some((moved / f64::from(subframes)) as f32);
        let [start_us, end_us] = open_us(self.course.seconds, pose, frames);
        let exposure = ExposureRecord { pose, start_us, end_us, subframes, step_px };
        Ok(ExposedFrame { exposure, picture: light.mean() })
    }

    fn open(&self, pose: usize) -> [f64; 2] {
        shutter_times(self.course.seconds, pose, self.shutter.frames)
    }

    /// Time of the `k`-th sub-frame of an exposure, at `subframes` per dense frame.
    fn moment(&self, pose: usize, k: u32, subframes: u32) -> SubframeTime {
        let first = pose - self.shutter.frames as usize / 2;
        let frame = first + (k / subframes) as usize;
        if self.shutter.subframes == SubframeRule::Literal {
            return SubframeTime::Pose(frame);
        }
        let [start, end] = self.open(pose);
        let all = f64::from(self.shutter.frames * subframes);
        let at = start + (f64::from(k) + 0.5) / all * (end - start);
        // The pose itself, because the spline meets it only up to rounding.
        if (self.course.seconds[frame] - at).abs() < SAME {
            SubframeTime::Pose(frame)
        } else {
            SubframeTime::Between(at)
        }
    }

    /// Adds the pictures at these moments. Returns the largest flow there, px/s, or 0 if it is not
    /// requested.
    fn add(
        &mut self,
        moments: &[SubframeTime],
        sees_motion: bool,
        light: &mut LinearLightSum,
        go_on: &dyn Fn() -> bool,
    ) -> Result<f32, ExposeError> {
        let (poses, velocities): (Vec<Se3>, Vec<CameraVelocity>) =
            moments.iter().map(|m| self.at(*m)).unzip();
        self.renderer.keep_to(&self.course.camera, &poses);
        let want = ChannelSet { rgb: true, flow: sees_motion, ..ChannelSet::default() };
        let mut fastest = 0.0_f32;
        for (world_from_camera, velocity) in poses.into_iter().zip(velocities) {
            if !go_on() {
                return Err(ExposeError::Interrupted);
            }
            let view = CameraView { camera: self.course.camera, world_from_camera, velocity };
            self.work += self.renderer.render(&view, want, &mut self.rendered)?;
            light.add(self.rendered.rgb.as_ref().expect("colour was asked for"));
            let flow = self.rendered.flow.iter().flat_map(Image::pixels);
            // Pixels without a depth have no finite flow.
            let squares = flow.map(|[u, v]| u * u + v * v).filter(|square| square.is_finite());
            fastest = fastest.max(squares.fold(0.0, f32::max).sqrt());
        }
        Ok(fastest)
    }

    /// The camera's pose and motion.
    fn at(&self, moment: SubframeTime) -> (Se3, CameraVelocity) {
        let seconds = self.course.seconds;
        match moment {
            SubframeTime::Pose(j) => (self.course.poses[j], self.path.at(seconds[j] - seconds[0]).1),
            SubframeTime::Between(at) => self.path.at(at - seconds[0]),
        }
    }
}

/// The time of a sub-frame.
#[derive(Debug, Clone, Copy, PartialEq)]
enum SubframeTime {
    /// At a pose.
    Pose(usize),
    /// At this time, s.
    Between(f64),
}

/// The smallest odd number of sub-frames, within bounds, for an image motion in px per dense frame.
fn subframe_count(moved_px: f64) -> u32 {
    (1..=MAX_SUBFRAMES).step_by(2).find(|n| moved_px <= f64::from(*n)).unwrap_or(MAX_SUBFRAMES)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Size, srgb};
    use glam::{DQuat, DVec3};

    const CAMERA: Camera =
        Camera { size: Size { width: 9, height: 5 }, fx: 10.0, fy: 10.0, cx: 4.5, cy: 2.5 };

    /// A world with light proportional to the camera's position along x, and with this flow. It
    /// records the poses of its views.
    struct Dawn {
        light: f64,
        px_s: f32,
        seen: Vec<f64>,
        promised: Vec<Se3>,
    }

    impl Renderer for Dawn {
        fn fingerprint(&self) -> &'static str {
            "dawn"
        }

        fn keep_to(&mut self, _: &Camera, poses: &[Se3]) {
            self.promised = poses.to_vec();
        }

        #[expect(clippy::cast_possible_truncation, reason = "colours have 32 bits")]
        fn render(
            &mut self,
            view: &CameraView,
            want: ChannelSet,
            out: &mut RenderedImages,
        ) -> Result<RenderWork, RenderError> {
            assert!(self.promised.contains(&view.world_from_camera), "it was promised to be seen from here");
            let x = view.world_from_camera.translation.x;
            self.seen.push(x);
            let value = srgb::encode(self.light * x) as f32;
            out.rgb = Some(Image::filled(CAMERA.size, [value, 0.0, 2.0]));
            let flow = || {
                let mut flow = Image::filled(CAMERA.size, [f32::NAN; 2]);
                flow.pixels_mut()[7] = [-0.6 * self.px_s, 0.8 * self.px_s];
                flow
            };
            out.flow = want.flow.then(flow);
            Ok(RenderWork { gaussians: 1, ..RenderWork::default() })
        }
    }

    /// Along x at 1 unit per second, 100 poses per second.
    fn walk(count: u32) -> (Vec<Se3>, Vec<f64>) {
        let seconds: Vec<f64> = (0..count).map(|j| f64::from(j) / 100.0).collect();
        let at = |t: &f64| Se3 { rotation: DQuat::IDENTITY, translation: DVec3::X * *t };
        (seconds.iter().map(at).collect(), seconds)
    }

    fn exposed(px_s: f32, shutter: ShutterSettings) -> (ExposedFrame, Dawn, RenderWork) {
        let (poses, seconds) = walk(40);
        let mut dawn = Dawn { light: 2.0, px_s, seen: Vec::new(), promised: Vec::new() };
        let course = ExposureCourse { camera: CAMERA, poses: &poses, seconds: &seconds };
        let mut exposer = FrameExposer::new(&mut dawn, course, shutter).unwrap();
        let exposed = exposer.expose(20, &|| true).unwrap();
        let work = exposer.work;
        (exposed, dawn, work)
    }

    const SEVEN: ShutterSettings = ShutterSettings { frames: 7, subframes: SubframeRule::Auto };

    /// A case like the paper's: 150 poses and 15 frames. The first centre is 8, then every 15th.
    #[test]
    fn exposures_follow_one_another_within_the_path() {
        assert_eq!(exposure_centres(150, 15), [8, 23, 38, 53, 68, 83, 98, 113, 128]);
        let t =
            |poses: usize, frames: u32, wanted: &[usize]| assert_eq!(exposure_centres(poses, frames), wanted);
        t(5, 3, &[2]);
        t(4, 3, &[]);
        t(3, 1, &[1]);
        t(0, 15, &[]);
        assert_eq!(kept_poses(12, 5, Some(3)), [0, 2, 5, 8, 10]);
        assert_eq!(kept_poses(12, 5, None), [0, 5, 10]);
    }

    /// Light that grows evenly has its mean at the middle of the exposure, for any number of
    /// sub-frames; 1e-7 is the rounding of the colours.
    #[test]
    fn the_mean_is_that_of_light_over_time() {
        for (px_s, subframes, step_px) in
            [(0.0, 1, 0.0), (99.0, 1, 0.99), (101.0, 3, 1.01 / 3.0), (640.0, 7, 6.4 / 7.0)]
        {
            let (ExposedFrame { exposure, picture }, dawn, work) = exposed(px_s, SEVEN);
            assert_eq!((exposure.pose, exposure.start_us, exposure.end_us), (20, 165_000, 235_000));
            assert_eq!(exposure.subframes, subframes, "{px_s} px/s");
            assert!((exposure.step_px.unwrap() - step_px).abs() < 1e-4, "{exposure:?}");
            for [r, g, b] in picture.pixels() {
                assert!((srgb::decode(f64::from(*r)) - 2.0 * 0.2).abs() < 1e-7, "{r}");
                assert_eq!((*g, *b), (0.0, 1.0));
            }
            // Equal steps of time, each sub-frame in the middle of its own step.
            let mut seen = dawn.seen;
            seen.sort_by(f64::total_cmp);
            let all = 7 * subframes;
            assert_eq!((seen.len(), work.gaussians), (all as usize, u64::from(all)));
            for (k, x) in (0..all).zip(&seen) {
                let wanted = 0.165 + 0.07 * (f64::from(k) + 0.5) / f64::from(all);
                assert!((x - wanted).abs() < 1e-12, "picture {k} of {all} is at {x}, wanted {wanted}");
            }
        }
    }

    #[test]
    fn dense_frames_are_seen_from_the_very_poses() {
        let (poses, _) = walk(40);
        for (px_s, subframes) in
            [(0.0, SubframeRule::Auto), (640.0, SubframeRule::Auto), (640.0, SubframeRule::Literal)]
        {
            let (ExposedFrame { exposure, .. }, dawn, _) =
                exposed(px_s, ShutterSettings { subframes, ..SEVEN });
            let wanted: Vec<f64> = poses[17..24].iter().map(|pose| pose.translation.x).collect();
            assert_eq!(dawn.seen[..7], wanted);
            if subframes == SubframeRule::Literal {
                assert_eq!((dawn.seen.len(), exposure.subframes, exposure.step_px), (7, 1, None));
            }
        }
    }

    #[test]
    fn motion_beyond_what_is_rendered_is_told() {
        let (ExposedFrame { exposure, .. }, ..) = exposed(5000.0, SEVEN);
        assert_eq!(exposure.subframes, MAX_SUBFRAMES);
        let message = ghost_warning(&[exposure, ExposureRecord { step_px: Some(0.5), ..exposure }]).unwrap();
        assert!(
            message.starts_with("1 of 2 blurred frames")
                && message.contains("at pose 20 a pixel moves by 1.5 px"),
            "{message}"
        );
        assert_eq!(
            ghost_warning(&[
                ExposureRecord { step_px: Some(1.0), ..exposure },
                ExposureRecord { step_px: None, ..exposure }
            ]),
            None
        );
    }

    #[test]
    fn a_shutter_can_be_closed_early() {
        let (poses, seconds) = walk(40);
        let mut dawn = Dawn { light: 1.0, px_s: 0.0, seen: Vec::new(), promised: Vec::new() };
        let course = ExposureCourse { camera: CAMERA, poses: &poses, seconds: &seconds };
        let mut exposer = FrameExposer::new(&mut dawn, course, SEVEN).unwrap();
        assert!(matches!(exposer.expose(20, &|| false), Err(ExposeError::Interrupted)));
    }
}
