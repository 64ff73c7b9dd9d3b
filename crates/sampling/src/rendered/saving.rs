//! Measurement of the time that omissions save on a path: a few of its frames are rendered with
//! them and without them.

use super::RenderedFrames;
use gs2e_render::{ChannelSet, OmissionPolicy, RenderedImages};
use gs2e_sensor::frames::{FrameError, FrameSequence as _};
use serde::Serialize;

/// Frames of a path per sampled frame. All renderings of the samples then take less than a
/// hundredth of the time of the path.
const FRAMES_A_SAMPLE: usize = 500;

/// Minimum number of sampled frames. Fewer say nothing about a path.
const MIN_FRAMES: usize = 3;

/// Estimate of the time saved by omissions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TimeSaved {
    /// Total over all frames, s; negative if omissions took longer.
    pub seconds: f64,
    /// Number of frames that were rendered both ways.
    pub sampled: usize,
    /// Number of frames of the path.
    pub frames: usize,
}

impl RenderedFrames {
    /// Estimates the time saved by omissions, including colours that no output needs. `clock` gives
    /// seconds since some moment. Returns `None` for a path so short that the measurement would
    /// take a noticeable share of its time. Call this before the first frame: from then on needless
    /// work is omitted.
    ///
    /// # Errors
    /// A frame cannot be rendered.
    pub fn saving(&mut self, clock: fn() -> f64) -> Result<Option<TimeSaved>, FrameError> {
        let frames = self.len();
        let sampled = frames / FRAMES_A_SAMPLE;
        if sampled < MIN_FRAMES {
            return Ok(None);
        }
        // The middles of equal parts of the path.
        let sample: Vec<usize> = (0..sampled).map(|k| (2 * k + 1) * frames / (2 * sampled)).collect();
        self.renderer.omit(OmissionPolicy::Nothing);
        let whole = self.time(&sample, ChannelSet { rgb: true, ..self.want() }, clock)?;
        self.renderer.omit(OmissionPolicy::Needless);
        // Omitting nothing has brought back all that no pose sees, so the promise is made again.
        self.renderer.keep_to(&self.camera, &self.trajectory.world_from_camera);
        let part = self.time(&sample, self.want(), clock)?;
        let seconds = (whole - part) * frames as f64 / sampled as f64;
        Ok(Some(TimeSaved { seconds, sampled, frames }))
    }

    /// Seconds that these frames take. The first one is rendered once more beforehand, because it
    /// pays for work that all share.
    fn time(&mut self, sample: &[usize], want: ChannelSet, clock: fn() -> f64) -> Result<f64, FrameError> {
        let mut rendered = RenderedImages::default();
        let mut began = clock();
        for (number, &index) in sample.iter().take(1).chain(sample).enumerate() {
            if number == 1 {
                began = clock();
            }
            let view = self.view(index).expect("the sample is of the path");
            let work = self.renderer.render(&view, want, &mut rendered);
            work.map_err(|source| FrameError::Render { index, source: source.into() })?;
        }
        Ok(clock() - began)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;
    use gs2e_num::se3::Se3;
    use gs2e_render::{RenderError, RenderWork, Renderer};
    use gs2e_scene::camera::Camera;
    use gs2e_scene::camera::view::CameraView;
    use gs2e_trajectory::Trajectory;
    use std::cell::Cell;

    thread_local! {
        static NOW: Cell<f64> = const { Cell::new(0.0) };
    }

    fn now() -> f64 {
        NOW.get()
    }

    /// A frame takes 5 s with everything and 2 s of the kept work; the first of each kind takes a
    /// minute.
    #[derive(Default)]
    struct Slow {
        omit: OmissionPolicy,
        kept: bool,
        warm: bool,
    }

    impl Renderer for Slow {
        fn fingerprint(&self) -> &str {
            "slow/1"
        }

        fn omit(&mut self, omit: OmissionPolicy) {
            *self = Self { omit, kept: false, warm: false };
        }

        fn keep_to(&mut self, _: &Camera, poses: &[Se3]) {
            self.kept = !poses.is_empty();
        }

        fn render(
            &mut self,
            _: &CameraView,
            want: ChannelSet,
            _: &mut RenderedImages,
        ) -> Result<RenderWork, RenderError> {
            let seconds = match (self.warm, self.omit) {
                (false, _) => 60.0,
                (true, OmissionPolicy::Nothing) if want.rgb && want.luminance => 5.0,
                (true, OmissionPolicy::Needless) if self.kept && !want.rgb && want.luminance => 2.0,
                (true, omit) => panic!("{omit:?} {want:?}"),
            };
            self.warm = true;
            NOW.set(NOW.get() + seconds);
            Ok(RenderWork::default())
        }
    }

    fn path(poses: u32) -> RenderedFrames {
        let trajectory = Trajectory {
            world_from_camera: vec![Se3::IDENTITY; poses as usize],
            stamps_us: (0..i64::from(poses)).collect(),
        };
        let camera =
            Camera { size: Size { width: 3, height: 2 }, fx: 2.0, fy: 2.0, cx: 1.5, cy: 1.0, lens: None };
        RenderedFrames::new(Box::new(Slow::default()), camera, trajectory)
    }

    #[test]
    fn three_seconds_a_frame_are_found_and_what_is_needless_is_left_out_again() {
        let mut frames = path(2000);
        let found = frames.saving(now).unwrap().unwrap();
        assert_eq!((found.sampled, found.frames), (4, 2000));
        assert!((found.seconds - 6000.0).abs() < 1e-6, "{found:?}");
        assert_eq!(frames.work(), RenderWork::default(), "no frame of the path is counted");
    }

    #[test]
    fn a_short_path_pays_for_no_frame_but_its_own() {
        let before = now();
        assert_eq!(path(1499).saving(now).unwrap(), None);
        assert_eq!(now().to_bits(), before.to_bits());
    }
}
