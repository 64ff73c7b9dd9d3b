//! The blurred frames of a course, exposed while its poses are rendered in order.

use super::{
    ExposureRecord, MAX_SUBFRAMES, ShutterSettings, SubframeRule, exposure_centres, open_us, shutter_times,
};
use gs2e_image::Image;
use gs2e_image::light::PictureSum;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation_spline::SplineDiverged;
use gs2e_render::lights::SceneLights;
use gs2e_render::{ChannelSet, RenderError, RenderWork, RenderedImages, Renderer};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::flow::{flow_of_objects, with_drift};
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_trajectory::sampled::SampledPath;

/// Time difference to a pose below which the pose is used itself, s: stamps are whole microseconds.
const SAME: f64 = 1e-9;

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
pub struct ExposureCourse {
    /// The camera.
    pub camera: Camera,
    /// Its pose at each dense frame.
    pub poses: Vec<Se3>,
    /// Times of the dense frames, s, strictly increasing.
    pub seconds: Vec<f64>,
}

/// A dense frame that was rendered at a pose.
pub struct DenseView<'a> {
    /// Index of the pose.
    pub pose: usize,
    /// The images that [`FrameExposer::want`] asked for.
    pub images: &'a RenderedImages,
    /// The work of the rendering.
    pub work: RenderWork,
    /// The renderer, for sub-frames.
    pub renderer: &'a mut dyn Renderer,
}

impl std::fmt::Debug for DenseView<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DenseView").field("pose", &self.pose).finish_non_exhaustive()
    }
}

/// Exposes the blurred frames of a course one after another, while its poses are rendered in order.
#[derive(Debug)]
pub struct FrameExposer {
    course: ExposureCourse,
    path: SampledPath,
    shutter: ShutterSettings,
    /// The centres of the exposures that are not finished, the next one last.
    centres: Vec<usize>,
    /// The light of the exposure that is open.
    light: Option<PictureSum>,
    /// Its largest flow, px/s.
    fastest: f32,
    /// Light that changes, if it does.
    lights: Option<SceneLights>,
    /// The work of the renderer so far.
    pub work: RenderWork,
}

impl FrameExposer {
    /// Prepares the exposures of a course.
    ///
    /// # Errors
    /// No smooth path leads through the poses.
    ///
    /// # Panics
    /// There are fewer than two poses, or there is not one strictly increasing time per pose.
    pub fn new(course: ExposureCourse, shutter: ShutterSettings) -> Result<Self, SplineDiverged> {
        let path = SampledPath::through_poses(&course.poses, course.seconds.clone())?;
        let mut centres = exposure_centres(course.poses.len(), shutter.frames);
        // The next exposure is popped off the end.
        centres.reverse();
        let (light, fastest, work) = (None, 0.0, RenderWork::default());
        Ok(Self { course, path, shutter, centres, light, fastest, lights: None, work })
    }

    /// Sets the light of the scene. Each sub-frame is shown in the light of its moment.
    #[must_use]
    pub fn lit_by(self, lights: Option<SceneLights>) -> Self {
        Self { lights, ..self }
    }

    /// The images that the exposures need at a pose. Poses are asked for in order. Where an exposure
    /// begins, the views of its dense frames are promised to the renderer.
    pub fn want(&mut self, pose: usize, renderer: &mut dyn Renderer) -> ChannelSet {
        let Some((centre, k)) = self.place(pose) else { return ChannelSet::NONE };
        if k == 0 {
            self.light = Some(PictureSum::empty_sum(self.course.camera.size, self.shutter.mean));
            self.fastest = 0.0;
            let dense = (0..self.shutter.frames).map(|k| self.at(self.moment(centre, k, 1)).0);
            renderer.keep_also(&self.course.camera, &dense.collect::<Vec<Se3>>());
        }
        match self.moment(centre, k, 1) {
            SubframeTime::Pose(_) => self.dense_channels(renderer),
            // The pose is not a dense frame of the exposure, which renders its own view.
            SubframeTime::Between(_) => ChannelSet::NONE,
        }
    }

    /// Takes the next pose, while `go_on` returns true. Returns the blurred frame at the last pose of
    /// an exposure.
    ///
    /// # Errors
    /// The renderer fails, or `go_on` returns false.
    pub fn see(
        &mut self,
        view: DenseView<'_>,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<ExposedFrame>, ExposeError> {
        let DenseView { pose, images, work, renderer } = view;
        let Some((centre, k)) = self.place(pose) else { return Ok(None) };
        let moment = self.moment(centre, k, 1);
        if let SubframeTime::Pose(_) = moment {
            self.work += renderer.work_within(work);
            self.add(moment, images, renderer);
        } else {
            self.render(&[moment], self.dense_channels(renderer), renderer, go_on)?;
        }
        let is_last = k + 1 == self.shutter.frames;
        is_last.then(|| self.close(centre, renderer, go_on)).transpose()
    }

    /// Adds the sub-frames between the dense frames, and ends the exposure.
    fn close(
        &mut self,
        pose: usize,
        renderer: &mut dyn Renderer,
        go_on: &dyn Fn() -> bool,
    ) -> Result<ExposedFrame, ExposeError> {
        let [start, end] = self.open(pose);
        let frames = self.shutter.frames;
        // The dense frames came first, because their flow determines the number of sub-frames.
        let moved = f64::from(self.fastest) * (end - start) / f64::from(frames);
        let lit = self.lights.as_ref().filter(|_| self.sees_motion());
        let flickers = lit.map_or(0.0, |lights| lights.subframes((end - start) / f64::from(frames)));
        let subframes = subframe_count(moved.max(flickers));
        // Each dense frame is in the middle of its sub-frames, because their number is odd.
        let between = (0..frames * subframes).filter(|k| k % subframes != subframes / 2);
        let between: Vec<SubframeTime> = between.map(|k| self.moment(pose, k, subframes)).collect();
        if !between.is_empty() {
            let poses: Vec<Se3> = between.iter().map(|moment| self.at(*moment).0).collect();
            renderer.keep_also(&self.course.camera, &poses);
            self.render(&between, ChannelSet { rgb: true, ..ChannelSet::NONE }, renderer, go_on)?;
        }
        #[expect(clippy::cast_possible_truncation, reason = "pixels, printed with a few digits")]
        let step_px = self.sees_motion().then_some((moved / f64::from(subframes)) as f32);
        let [start_us, end_us] = open_us(&self.course.seconds, pose, frames);
        let exposure = ExposureRecord { pose, start_us, end_us, subframes, step_px };
        self.centres.pop();
        let light = self.light.take().expect("the exposure is open");
        Ok(ExposedFrame { exposure, picture: light.mean() })
    }

    /// The centre of the exposure to which a pose belongs, and its number there.
    fn place(&self, pose: usize) -> Option<(usize, u32)> {
        let centre = *self.centres.last()?;
        let first = centre - self.shutter.frames as usize / 2;
        let k = u32::try_from(pose.checked_sub(first)?).ok()?;
        (k < self.shutter.frames).then_some((centre, k))
    }

    fn sees_motion(&self) -> bool {
        self.shutter.subframes == SubframeRule::Auto
    }

    /// The images of a dense frame.
    fn dense_channels(&self, renderer: &dyn Renderer) -> ChannelSet {
        let motion = if self.sees_motion() { renderer.motion_channels() } else { ChannelSet::NONE };
        ChannelSet { rgb: true, depth: self.sees_motion(), ..motion }
    }

    fn open(&self, pose: usize) -> [f64; 2] {
        shutter_times(&self.course.seconds, pose, self.shutter.frames)
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
        // The middles of equal parts of the open time, so that the mean of the pictures is a midpoint rule.
        let at = start + (f64::from(k) + 0.5) / all * (end - start);
        // The pose itself, because the spline meets it only up to rounding.
        if (self.course.seconds[frame] - at).abs() < SAME {
            SubframeTime::Pose(frame)
        } else {
            SubframeTime::Between(at)
        }
    }

    /// Renders and adds the pictures at these moments.
    fn render(
        &mut self,
        moments: &[SubframeTime],
        want: ChannelSet,
        renderer: &mut dyn Renderer,
        go_on: &dyn Fn() -> bool,
    ) -> Result<(), ExposeError> {
        let mut rendered = RenderedImages::default();
        for moment in moments {
            if !go_on() {
                return Err(ExposeError::Interrupted);
            }
            let work = renderer.render(&self.view(*moment), want, &mut rendered)?;
            self.work += renderer.work_within(work);
            self.add(*moment, &rendered, renderer);
        }
        Ok(())
    }

    /// Adds a picture, and the flow if there is a depth.
    fn add(&mut self, moment: SubframeTime, images: &RenderedImages, renderer: &dyn Renderer) {
        let lit = self.lights.as_ref().map(|lights| lights.at(self.seconds(moment)));
        let light = self.light.as_mut().expect("the exposure is open");
        let picture = images.rgb.as_ref().expect("colour was asked for");
        match lit {
            Some(lit) => light.add(&lit.lit(picture)),
            None => light.add(picture),
        }
        // Other readers of the same rendering may have asked for the depth.
        let Some(depth) = images.depth.as_ref().filter(|_| self.sees_motion()) else { return };
        let views = renderer.object_views(&self.view(moment));
        let flow = flow_of_objects(depth, images.segmentation.as_ref(), &views);
        let flow = with_drift(flow, depth, images.drift.as_ref(), &self.course.camera);
        // Pixels without a depth have no finite flow.
        let squares = flow.pixels().iter().map(|[u, v]| u * u + v * v).filter(|square| square.is_finite());
        self.fastest = self.fastest.max(squares.fold(0.0, f32::max).sqrt());
    }

    fn view(&self, moment: SubframeTime) -> CameraView {
        let (world_from_camera, velocity) = self.at(moment);
        let seconds = match moment {
            SubframeTime::Pose(j) => self.course.seconds[j],
            SubframeTime::Between(at) => at,
        };
        let still = CameraView::at_rest(self.course.camera, world_from_camera);
        CameraView { velocity, ..still.at_time(seconds - self.course.seconds[0]) }
    }

    /// Time after the first pose, s.
    fn seconds(&self, moment: SubframeTime) -> f64 {
        let seconds = &self.course.seconds;
        match moment {
            SubframeTime::Pose(j) => seconds[j] - seconds[0],
            SubframeTime::Between(at) => at - seconds[0],
        }
    }

    /// The camera's pose and motion.
    fn at(&self, moment: SubframeTime) -> (Se3, CameraVelocity) {
        let seconds = &self.course.seconds;
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
    use crate::exposure::ghost_warning;
    use glam::{DQuat, DVec3};
    use gs2e_image::light::MeanScale;
    use gs2e_image::{Size, srgb};

    const CAMERA: Camera =
        Camera { size: Size { width: 9, height: 5 }, fx: 10.0, fy: 10.0, cx: 4.5, cy: 2.5, lens: None };

    /// A world with light proportional to the camera's position along x, and with this flow. It
    /// records the poses of its views.
    struct Dawn {
        light: f64,
        px_s: f32,
        rendered_at: Vec<f64>,
        promised: Vec<Se3>,
    }

    impl Renderer for Dawn {
        fn fingerprint(&self) -> &'static str {
            "dawn"
        }

        fn keep_also(&mut self, _: &Camera, poses: &[Se3]) {
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
            self.rendered_at.push(x);
            let value = srgb::encode(self.light * x) as f32;
            out.rgb = Some(Image::filled(CAMERA.size, [value, 0.0, 2.0]));
            let depth = || {
                let mut depth = Image::filled(CAMERA.size, f32::NAN);
                // Along x at 1 unit per second, a point at this depth moves by the focal length over it.
                depth.pixels_mut()[7] = (CAMERA.fx / f64::from(self.px_s)) as f32;
                depth
            };
            out.depth = want.depth.then(depth);
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
        let mut dawn = Dawn { light: 2.0, px_s, rendered_at: Vec::new(), promised: Vec::new() };
        let course = ExposureCourse { camera: CAMERA, poses, seconds };
        let mut exposer = FrameExposer::new(course, shutter).unwrap();
        // Only the exposure around pose 20 is of interest.
        exposer.centres = vec![20];
        let frames = expose(&mut exposer, &mut dawn, &|| true).unwrap();
        let [exposed] = frames.try_into().expect("there is one exposure");
        (exposed, dawn, exposer.work)
    }

    /// Shows all poses of a course to an exposer, each rendered if it is wanted.
    fn expose(
        exposer: &mut FrameExposer,
        dawn: &mut Dawn,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Vec<ExposedFrame>, ExposeError> {
        let mut frames = Vec::new();
        for pose in 0..exposer.course.poses.len() {
            let (want, mut images) = (exposer.want(pose, dawn), RenderedImages::default());
            let mut work = RenderWork::default();
            if !want.is_empty() {
                let view = CameraView::at_rest(CAMERA, exposer.course.poses[pose]);
                work = dawn.render(&view, want, &mut images).unwrap();
            }
            frames.extend(exposer.see(DenseView { pose, images: &images, work, renderer: dawn }, go_on)?);
        }
        Ok(frames)
    }

    const SEVEN: ShutterSettings =
        ShutterSettings { frames: 7, subframes: SubframeRule::Auto, mean: MeanScale::Linear };

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
            let mut rendered_at = dawn.rendered_at;
            rendered_at.sort_by(f64::total_cmp);
            let all = 7 * subframes;
            assert_eq!((rendered_at.len(), work.gaussians), (all as usize, u64::from(all)));
            for (k, x) in (0..all).zip(&rendered_at) {
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
            assert_eq!(dawn.rendered_at[..7], wanted);
            if subframes == SubframeRule::Literal {
                assert_eq!((dawn.rendered_at.len(), exposure.subframes, exposure.step_px), (7, 1, None));
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
        // With steps that grow, the dense frames lie between the poses, and are rendered apart.
        let (poses, _) = walk(40);
        let mut dawn = Dawn { light: 1.0, px_s: 0.0, rendered_at: Vec::new(), promised: Vec::new() };
        let seconds = (0..40).map(|j| f64::from(j * j) / 100.0).collect();
        let course = ExposureCourse { camera: CAMERA, poses, seconds };
        let mut exposer = FrameExposer::new(course, SEVEN).unwrap();
        assert!(matches!(expose(&mut exposer, &mut dawn, &|| false), Err(ExposeError::Interrupted)));
    }
}
