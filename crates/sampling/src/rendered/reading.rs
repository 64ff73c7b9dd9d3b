//! Readers of the renderings of a path: one pass of the renderer serves the frames and products of the
//! same poses.

use super::RenderedFrames;
use gs2e_image::{Image, Size};
use gs2e_render::{ChannelSet, RenderWork, RenderedImages, Renderer};
use gs2e_sensor::frames::{DenseFrame, FrameError, FrameSequence};

/// A reader of renderings.
pub trait PoseReader {
    /// The images that it wants of the next pose; [`ChannelSet::NONE`] for no rendering. Called for
    /// each pose, in order.
    fn want(&mut self, index: usize, renderer: &mut dyn Renderer) -> ChannelSet;

    /// Takes the pose, after the rendering.
    fn read(&mut self, pose: RenderedPose<'_>);
}

/// A pose of a path after its rendering.
pub struct RenderedPose<'a> {
    /// Index of the pose.
    pub index: usize,
    /// The images, among them those that the reader wanted.
    pub images: &'a RenderedImages,
    /// The work of the rendering; zero if there was none.
    pub work: RenderWork,
    /// The duration of the rendering, s.
    pub seconds: f64,
    /// True if the pose was also rendered for frames.
    pub has_frame: bool,
    /// The renderer, for views between the poses.
    pub renderer: &'a mut dyn Renderer,
}

impl std::fmt::Debug for RenderedPose<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RenderedPose")
            .field("index", &self.index)
            .field("work", &self.work)
            .finish_non_exhaustive()
    }
}

/// Rendered frames whose renderings a reader takes too.
pub struct ReadFrames<'a> {
    frames: &'a mut RenderedFrames,
    reader: &'a mut dyn PoseReader,
    clock: fn() -> f64,
}

impl std::fmt::Debug for ReadFrames<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ReadFrames").field("frames", &self.frames).finish_non_exhaustive()
    }
}

impl<'a> ReadFrames<'a> {
    /// The frames, read by `reader`. `clock` gives seconds since some moment.
    #[must_use]
    pub fn new(frames: &'a mut RenderedFrames, reader: &'a mut dyn PoseReader, clock: fn() -> f64) -> Self {
        Self { frames, reader, clock }
    }
}

impl FrameSequence for ReadFrames<'_> {
    fn size(&self) -> Size {
        self.frames.size()
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let Self { frames, reader, clock } = self;
        let index = frames.done;
        // Nothing is announced: the channels of later poses are not known yet.
        let Some(view) = frames.view(index) else { return Ok(None) };
        let want = frames.want().with(reader.want(index, &mut *frames.renderer));
        let began = clock();
        let work = frames.render(index, &view, want)?;
        // Before the frame, which takes the images and scales them.
        reader.read(RenderedPose {
            index,
            images: &frames.rendered,
            work,
            seconds: clock() - began,
            has_frame: true,
            renderer: &mut *frames.renderer,
        });
        frames.take_frame(index).map(Some)
    }

    fn want_colour(&mut self) {
        self.frames.want_colour();
    }

    fn colour(&self) -> Option<&Image<[f32; 3]>> {
        self.frames.colour()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use gs2e_num::se3::Se3;
    use gs2e_render::RenderError;
    use gs2e_scene::camera::Camera;
    use gs2e_scene::camera::view::{CameraVelocity, CameraView};
    use gs2e_trajectory::Trajectory;

    const SIZE: Size = Size { width: 3, height: 2 };

    /// Paints every channel with the camera's x.
    #[derive(Default)]
    struct Painter {
        wanted: Vec<ChannelSet>,
    }

    impl Renderer for Painter {
        fn fingerprint(&self) -> &str {
            "painter/1"
        }

        #[expect(clippy::cast_possible_truncation, reason = "the test's values are small")]
        fn render(
            &mut self,
            view: &CameraView,
            want: ChannelSet,
            out: &mut RenderedImages,
        ) -> Result<RenderWork, RenderError> {
            self.wanted.push(want);
            let x = view.world_from_camera.translation.x as f32;
            out.luminance = want.luminance.then(|| Image::filled(SIZE, x));
            out.rgb = want.rgb.then(|| Image::filled(SIZE, [x; 3]));
            let velocity = view.velocity.linear.x as f32;
            out.flow = want.flow.then(|| Image::filled(SIZE, [velocity; 2]));
            Ok(RenderWork { blended: 1, ..RenderWork::default() })
        }
    }

    /// Wants colour at even poses, and the flow at the last one.
    #[derive(Default)]
    struct Reader {
        asked: Vec<usize>,
        read: Vec<(usize, Option<f32>, Option<f32>)>,
    }

    impl PoseReader for Reader {
        fn want(&mut self, index: usize, _: &mut dyn Renderer) -> ChannelSet {
            self.asked.push(index);
            ChannelSet { rgb: index.is_multiple_of(2), flow: index == 2, ..ChannelSet::NONE }
        }

        fn read(&mut self, pose: RenderedPose<'_>) {
            let RenderedPose { index, images, work, has_frame, .. } = pose;
            assert!(has_frame && work.blended == 1, "it is the work of one rendering");
            let rgb = images.rgb.as_ref().map(|image| image.pixels()[0][0]);
            self.read.push((index, rgb, images.flow.as_ref().map(|image| image.pixels()[0][0])));
        }
    }

    #[test]
    fn a_reader_takes_the_renderings_of_the_frames_before_they_are_scaled() {
        let pose = |x| Se3 { rotation: DQuat::IDENTITY, translation: DVec3::new(x, 0.0, 0.0) };
        let trajectory =
            Trajectory { world_from_camera: [0.25, 0.5, 1.0].map(pose).to_vec(), stamps_us: vec![0, 1, 2] };
        let camera = Camera { size: SIZE, fx: 2.0, fy: 2.0, cx: 1.5, cy: 1.0, lens: None };
        let moving = |x| CameraVelocity { linear: DVec3::new(x, 0.0, 0.0), angular: DVec3::ZERO };
        let frames = RenderedFrames::new(Box::new(Painter::default()), camera, trajectory);
        let mut frames = frames.with_velocities([3.0, 4.0, 5.0].map(moving).to_vec());
        let mut reader = Reader::default();
        let mut read = ReadFrames::new(&mut frames, &mut reader, || 0.0);
        read.want_colour();
        let mut greys = Vec::new();
        while let Some(frame) = read.next().unwrap() {
            greys.push((frame.luminance.pixels()[0], read.colour().unwrap().pixels()[0][0]));
        }
        assert_eq!(greys, [0.25, 0.5, 1.0].map(|x| (255.0 * x, 255.0 * x)));
        assert_eq!(reader.asked, [0, 1, 2]);
        // The frames asked for colour at every pose.
        assert_eq!(reader.read, [(0, Some(0.25), None), (1, Some(0.5), None), (2, Some(1.0), Some(5.0))]);
        assert_eq!(frames.work().blended, 3, "each pose is rendered once");
    }
}
