//! Frames rendered along a trajectory.

mod reading;
mod saving;
mod shares;

pub use reading::{PoseReader, ReadFrames, RenderedPose};
pub use saving::TimeSaved;
pub use shares::{ReaderSeconds, share_rest};

use gs2e_image::{Image, Size};
use gs2e_num::units::Timestamp;
use gs2e_render::lights::SceneLights;
use gs2e_render::sample::TileSample;
use gs2e_render::{ChannelSet, RenderWork, RenderedImages, Renderer};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_sensor::frames::{DenseFrame, FrameError, FrameSequence};
use gs2e_trajectory::Trajectory;
use rayon::prelude::*;
use std::sync::Arc;

/// Ratio of the scale of [`DenseFrame::luminance`] to that of [`RenderedImages::luminance`].
const GREY_SCALE: f32 = 255.0;

/// Number of views announced in advance: while one is read, the next is rendered, and one more
/// waits.
const AHEAD: usize = 2;

/// Channels rendered for each frame, without colours and rates.
const WANT: ChannelSet = ChannelSet { luminance: true, ..ChannelSet::NONE };

/// The luminance that a camera sees at each pose of a trajectory. Frame `j` is rendered at pose `j`
/// when it is requested.
pub struct RenderedFrames {
    renderer: Box<dyn Renderer>,
    camera: Camera,
    trajectory: Trajectory,
    /// Velocity of the camera at each pose, if rates or the flow are requested.
    velocities: Vec<CameraVelocity>,
    /// True if rates are requested.
    rated: bool,
    /// The pixels of each frame that are read; empty if all are.
    samples: Vec<Arc<TileSample>>,
    /// True if colours are requested.
    coloured: bool,
    /// Light that changes, if it does.
    lights: Option<SceneLights>,
    done: usize,
    /// Number of views announced so far.
    expected: usize,
    rendered: RenderedImages,
    work: RenderWork,
}

impl std::fmt::Debug for RenderedFrames {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RenderedFrames")
            .field("renderer", &self.renderer.fingerprint())
            .field("camera", &self.camera)
            .field("poses", &self.len())
            .field("done", &self.done)
            .field("work", &self.work)
            .finish_non_exhaustive()
    }
}

impl RenderedFrames {
    /// The frames of a trajectory.
    ///
    /// # Panics
    /// The number of stamps differs from that of poses.
    #[must_use]
    pub fn new(mut renderer: Box<dyn Renderer>, camera: Camera, trajectory: Trajectory) -> Self {
        let (poses, stamps) = (trajectory.world_from_camera.len(), trajectory.stamps_us.len());
        assert_eq!(poses, stamps, "a trajectory has one stamp a pose");
        renderer.keep_to(&camera, &trajectory.world_from_camera);
        let (rendered, work) = (RenderedImages::default(), RenderWork::default());
        Self {
            renderer,
            camera,
            trajectory,
            velocities: Vec::new(),
            rated: false,
            samples: Vec::new(),
            coloured: false,
            lights: None,
            done: 0,
            expected: 0,
            rendered,
            work,
        }
    }

    /// Adds the luminance's rate of change to every frame, for a camera with these velocities at
    /// the poses.
    ///
    /// # Panics
    /// The number of velocities differs from that of poses.
    #[must_use]
    pub fn with_rates(self, velocities: Vec<CameraVelocity>) -> Self {
        Self { rated: true, ..self.with_velocities(velocities) }
    }

    /// Sets the velocities of the camera at the poses, on which the flow that a [`PoseReader`] wants
    /// depends.
    ///
    /// # Panics
    /// The number of velocities differs from that of poses.
    #[must_use]
    pub fn with_velocities(self, velocities: Vec<CameraVelocity>) -> Self {
        assert_eq!(velocities.len(), self.len(), "one velocity a pose");
        Self { velocities, ..self }
    }

    /// Renders of each frame only the pixels of a sample. The others may have any finite value.
    ///
    /// # Panics
    /// The number of samples differs from that of poses.
    pub(crate) fn with_samples(self, samples: Vec<Arc<TileSample>>) -> Self {
        assert_eq!(samples.len(), self.len(), "one sample a pose");
        Self { samples, ..self }
    }

    /// Sets the light of the scene, in which the frames are shown. A [`PoseReader`] sees the renderings
    /// without it.
    #[must_use]
    pub fn lit_by(self, lights: Option<SceneLights>) -> Self {
        Self { lights, ..self }
    }

    /// Returns the renderer for other uses.
    #[must_use]
    pub fn into_renderer(mut self) -> Box<dyn Renderer> {
        if !self.samples.is_empty() {
            self.renderer.sample(None);
        }
        self.renderer
    }

    fn view(&self, index: usize) -> Option<CameraView> {
        let pose = self.trajectory.world_from_camera.get(index)?;
        // As in a pass without frames, so that both see moving objects at the same places.
        let seconds = self.trajectory.seconds(index);
        let still = CameraView::at_rest(self.camera, *pose).at_time(seconds);
        Some(self.velocities.get(index).map_or(still, |velocity| CameraView { velocity: *velocity, ..still }))
    }

    fn want(&self) -> ChannelSet {
        // Light changes colours, of which the luminance is made again.
        ChannelSet { rgb: self.coloured || self.lights.is_some(), luminance_rate: self.rated, ..WANT }
    }

    /// Converts an image to the grey scale.
    fn to_grey(image: Option<Image<f32>>, what: &str, index: usize) -> Result<Image<f32>, FrameError> {
        let mut image = image.expect("a renderer renders what it is asked for");
        image.pixels_mut().iter_mut().for_each(|v| *v *= GREY_SCALE);
        match image.pixels().iter().position(|v| !v.is_finite()) {
            None => Ok(image),
            Some(i) => {
                let because = format!("{what} of pixel {i} is {}, wanted a finite value", image.pixels()[i]);
                Err(FrameError::Invalid { index, because })
            }
        }
    }

    /// Converts the colours of a frame to the grey scale. They are kept until the next frame.
    fn scale_colours(&mut self, index: usize) -> Result<(), FrameError> {
        let Some(rgb) = self.rendered.rgb.as_mut().filter(|_| self.coloured) else { return Ok(()) };
        rgb.pixels_mut().par_iter_mut().for_each(|rgb| rgb.iter_mut().for_each(|v| *v *= GREY_SCALE));
        match rgb.pixels().iter().position(|rgb| !rgb.iter().all(|v| v.is_finite())) {
            None => Ok(()),
            Some(i) => {
                let because =
                    format!("the colour of pixel {i} is {:?}, wanted finite values", rgb.pixels()[i]);
                Err(FrameError::Invalid { index, because })
            }
        }
    }

    /// Renders a frame, and adds its work.
    fn render(
        &mut self,
        index: usize,
        view: &CameraView,
        want: ChannelSet,
    ) -> Result<RenderWork, FrameError> {
        let rendered = self.renderer.render(view, want, &mut self.rendered);
        let work = rendered.map_err(|source| FrameError::Render { index, source: source.into() })?;
        self.work += work;
        Ok(work)
    }

    /// Shows the rendering in the light of its moment.
    fn light(&mut self, index: usize) {
        let Some(lights) = &self.lights else { return };
        let light = lights.at_us(self.trajectory.stamps_us[index]);
        let RenderedImages { rgb, luminance, luminance_rate, .. } = &mut self.rendered;
        let colours = rgb.as_mut().expect("colour was asked for");
        let luminance = luminance.as_mut().expect("luminance was asked for");
        light.light_luminance(colours, luminance, luminance_rate.as_mut().filter(|_| self.rated));
        if self.coloured {
            light.light_colours(colours);
        }
    }

    /// The frame that was rendered last.
    fn take_frame(&mut self, index: usize) -> Result<DenseFrame, FrameError> {
        self.light(index);
        let luminance = Self::to_grey(self.rendered.luminance.take(), "luminance", index)?;
        self.scale_colours(index)?;
        let rate = self
            .rated
            .then(|| Self::to_grey(self.rendered.luminance_rate.take(), "the rate of luminance", index))
            .transpose()?;
        // Counted last: a frame that failed is not skipped by the next call.
        self.done += 1;
        let t = Timestamp::from_micros(self.trajectory.stamps_us[index]);
        Ok(DenseFrame { index, t, luminance, rate })
    }

    /// The summed work of the frames so far.
    #[must_use]
    pub fn work(&self) -> RenderWork {
        self.work
    }
}

impl FrameSequence for RenderedFrames {
    fn size(&self) -> Size {
        self.camera.size
    }

    fn len(&self) -> usize {
        self.trajectory.stamps_us.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let index = self.done;
        let Some(view) = self.view(index) else { return Ok(None) };
        let want = self.want();
        // Each view is announced once, in order, before it is rendered.
        while let Some(next) = self.view(self.expected).filter(|_| self.expected <= index + AHEAD) {
            self.renderer.expect(&next, want);
            self.expected += 1;
        }
        if let Some(sample) = self.samples.get(index) {
            self.renderer.sample(Some(sample.clone()));
        }
        self.render(index, &view, want)?;
        self.take_frame(index).map(Some)
    }

    fn want_colour(&mut self) {
        self.coloured = true;
    }

    fn colour(&self) -> Option<&Image<[f32; 3]>> {
        self.rendered.rgb.as_ref().filter(|_| self.coloured)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use gs2e_image::Image;
    use gs2e_num::se3::Se3;
    use gs2e_render::RenderError;

    const SIZE: Size = Size { width: 3, height: 2 };

    /// Paints every pixel with the camera's x, and requires that views were announced in order.
    #[derive(Default)]
    struct Flat {
        expected: std::collections::VecDeque<CameraView>,
    }

    impl Renderer for Flat {
        fn fingerprint(&self) -> &str {
            "flat/1"
        }

        fn expect(&mut self, view: &CameraView, _: ChannelSet) {
            self.expected.push_back(*view);
        }

        #[expect(clippy::cast_possible_truncation, reason = "the test's values are small")]
        fn render(
            &mut self,
            view: &CameraView,
            want: ChannelSet,
            out: &mut RenderedImages,
        ) -> Result<RenderWork, RenderError> {
            let rated = ChannelSet { luminance: true, luminance_rate: true, ..ChannelSet::default() };
            let plain = ChannelSet { rgb: false, ..want };
            assert!(plain == WANT || plain == rated, "no more is blended than is wanted");
            let x = view.world_from_camera.translation.x;
            let rgb = [x as f32, 0.5, -0.25];
            out.rgb = want.rgb.then(|| Image::filled(view.camera.size, rgb));
            out.luminance_rate =
                want.luminance_rate.then(|| Image::filled(view.camera.size, view.velocity.linear.x as f32));
            if !x.is_nan() {
                assert_eq!(self.expected.pop_front(), Some(*view));
                assert!(self.expected.len() <= AHEAD, "as many ahead as there is memory for");
            }
            if x > 8.0 {
                return Err(RenderError::View("too far".into()));
            }
            out.luminance = Some(Image::filled(view.camera.size, x as f32));
            Ok(RenderWork { gaussians: 5, blended: 7, ..RenderWork::default() })
        }
    }

    fn frames(xs: &[f64]) -> RenderedFrames {
        let pose = |&x| Se3 { rotation: DQuat::IDENTITY, translation: DVec3::new(x, 0.0, 0.0) };
        let trajectory = Trajectory {
            world_from_camera: xs.iter().map(pose).collect(),
            stamps_us: [0, 417, 833, 1250][..xs.len()].to_vec(),
        };
        let camera = Camera { size: SIZE, fx: 2.0, fy: 2.0, cx: 1.5, cy: 1.0, lens: None };
        RenderedFrames::new(Box::new(Flat::default()), camera, trajectory)
    }

    #[test]
    fn each_pose_has_its_frame_at_its_stamp_on_the_grey_scale() {
        let mut frames = frames(&[0.0, 0.5, 1.2]);
        assert_eq!((frames.size(), frames.len(), frames.is_empty()), (SIZE, 3, false));
        for (index, ns, grey) in [(0, 0, 0.0), (1, 417_000, 127.5), (2, 833_000, 306.0)] {
            let frame = frames.next().unwrap().unwrap();
            assert_eq!((frame.index, frame.t), (index, Timestamp(ns)));
            assert!(frame.luminance.pixels().iter().all(|v| (v - grey).abs() < 1e-4), "{index}");
        }
        assert!(frames.next().unwrap().is_none());
        assert_eq!(frames.work(), RenderWork { gaussians: 15, blended: 21, ..RenderWork::default() });
    }

    #[test]
    fn a_moving_camera_gives_the_rate_of_each_frame_on_the_grey_scale() {
        let velocity = |x| CameraVelocity { linear: DVec3::new(x, 0.0, 0.0), angular: DVec3::ZERO };
        let mut frames = frames(&[0.0, 0.5]).with_rates([2.0, -1.0].map(velocity).to_vec());
        for grey in [510.0, -255.0] {
            let rate = frames.next().unwrap().unwrap().rate.unwrap();
            assert!(rate.pixels().iter().all(|v| (v - grey).abs() < 1e-4), "{grey}");
        }
    }

    #[test]
    fn colours_come_on_the_grey_scale_where_they_are_wanted() {
        let mut plain = frames(&[0.2]);
        plain.next().unwrap();
        assert!(plain.colour().is_none());
        let mut coloured = frames(&[0.2, 1.2]);
        coloured.want_colour();
        for red in [51.0, 306.0] {
            coloured.next().unwrap().unwrap();
            let colour = coloured.colour().unwrap();
            assert_eq!(colour.size(), SIZE);
            assert!(colour.pixels().iter().all(|[r, g, b]| (r - red).abs() < 1e-4
                && g.to_bits() == 127.5_f32.to_bits()
                && b.to_bits() == (-63.75_f32).to_bits()));
        }
    }

    #[test]
    fn failures_name_the_frame() {
        let mut frames = frames(&[0.0, 9.0]);
        frames.next().unwrap();
        let error = frames.next().unwrap_err().to_string();
        assert_eq!(error, "frame 1: the view cannot be rendered: too far");
    }

    #[test]
    fn luminance_that_is_not_finite_is_refused() {
        let error = frames(&[f64::NAN]).next().unwrap_err().to_string();
        assert_eq!(error, "frame 0: luminance of pixel 0 is NaN, wanted a finite value");
    }
}
