//! Sharp frames with a rolling shutter: each row at its own time, and so from its own pose.
//!
//! ```text
//! t(r) = t_pose + readout (r / (H - 1) - 1/2),   r = 0 .. H - 1
//! ```
//!
//! The middle row is at the time of the pose, and the readout is the time from the first row to the last.
//! Before the first pose and after the last, the camera rests. Rows are rendered in bands: a band shows whole
//! frames' rows from the pose at the time of its middle. A band is as high as the flow at the pose allows, so
//! that the image moves by at most [`MISS_PX`] from the time of the band to that of a row.

use super::exposure::{DenseView, ExposeError, ExposureCourse};
use gs2e_image::Image;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation_spline::SplineDiverged;
use gs2e_render::lights::SceneLights;
use gs2e_render::{ChannelSet, RenderWork, RenderedImages, Renderer};
use gs2e_scene::camera::flow::{flow_of_objects, with_drift};
use gs2e_scene::camera::view::CameraView;
use gs2e_trajectory::sampled::SampledPath;
use std::ops::Range;

/// Largest motion of the image from the time of a band to that of one of its rows, px, by the fastest flow at
/// the pose.
pub const MISS_PX: f64 = 0.05;

/// Time of a row after that of the pose, s.
fn row_seconds(readout_s: f64, row: f64, rows: u32) -> f64 {
    // A single row is the middle one.
    let last = f64::from(rows.max(2) - 1);
    if rows < 2 { 0.0 } else { readout_s * (row / last - 0.5) }
}

/// Number of rows of a band, for a flow in px/s.
fn band_rows(readout_s: f64, flow_px_s: f64, rows: u32) -> u32 {
    let px_a_row =
        flow_px_s * row_seconds(readout_s, 1.0, rows) - flow_px_s * row_seconds(readout_s, 0.0, rows);
    // The outer rows of a band of n are (n - 1) / 2 from its middle.
    let most = 1.0 + 2.0 * MISS_PX / px_a_row;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast saturates")]
    let most = most as u32;
    most.clamp(1, rows)
}

/// Renders the rows of frames, each in its own time.
#[derive(Debug)]
pub struct RowRoller {
    course: ExposureCourse,
    path: SampledPath,
    readout_s: f64,
    lights: Option<SceneLights>,
    /// Work of the bands so far.
    pub work: RenderWork,
    /// Largest number of bands of a frame so far.
    pub most_bands: usize,
    /// Rows before the first pose or after the last so far.
    pub resting_rows: u64,
}

impl RowRoller {
    /// Images that a frame needs at its pose.
    pub const WANT: ChannelSet = ChannelSet { rgb: true, depth: true, ..ChannelSet::NONE };

    /// A shutter that reads a frame in this time.
    ///
    /// # Errors
    /// No smooth path leads through the poses.
    ///
    /// # Panics
    /// There are fewer than two poses, or there is not one strictly increasing time per pose.
    pub fn new(course: ExposureCourse, readout_us: u32) -> Result<Self, SplineDiverged> {
        let path = SampledPath::through_poses(&course.poses, course.seconds.clone())?;
        let readout_s = 1e-6 * f64::from(readout_us);
        let work = RenderWork::default();
        Ok(Self { course, path, readout_s, lights: None, work, most_bands: 0, resting_rows: 0 })
    }

    /// Sets the light of the scene. Each row is shown in the light of its time.
    #[must_use]
    pub fn lit_by(self, lights: Option<SceneLights>) -> Self {
        Self { lights, ..self }
    }

    /// The frame at a pose, while `go_on` returns true. `view.images` are those of [`RowRoller::WANT`].
    ///
    /// # Errors
    /// The renderer fails, or `go_on` returns false.
    ///
    /// # Panics
    /// An image of [`RowRoller::WANT`] is missing.
    pub fn roll(
        &mut self,
        view: DenseView<'_>,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Image<[f32; 3]>, ExposeError> {
        let DenseView { pose, images, renderer, .. } = view;
        let mut picture = images.rgb.clone().expect("colour was asked for");
        let rows = self.course.camera.size.height;
        let bands = self.bands(pose, images, rows, &*renderer);
        self.most_bands = self.most_bands.max(bands.len());
        if bands.len() > 1 {
            let middles: Vec<f64> = bands.iter().map(|band| self.band_seconds(pose, band, rows)).collect();
            let poses: Vec<Se3> = middles.iter().map(|at| self.path.at(*at).0).collect();
            renderer.keep_also(&self.course.camera, &poses);
            let (width, mut rendered) = (self.course.camera.size.width as usize, RenderedImages::default());
            for ((band, world_from_camera), at) in bands.iter().zip(poses).zip(middles) {
                if !go_on() {
                    return Err(ExposeError::Interrupted);
                }
                let view = CameraView::at_rest(self.course.camera, world_from_camera).at_time(at);
                let want = ChannelSet { rgb: true, ..ChannelSet::NONE };
                let work = renderer.render(&view, want, &mut rendered)?;
                self.work += renderer.work_within(work);
                let colours = rendered.rgb.as_ref().expect("colour was asked for").pixels();
                let place = band.start as usize * width..band.end as usize * width;
                picture.pixels_mut()[place.clone()].copy_from_slice(&colours[place]);
            }
        }
        self.light(pose, &mut picture);
        Ok(picture)
    }

    /// Lights each row, and counts those outside the path.
    fn light(&mut self, pose: usize, picture: &mut Image<[f32; 3]>) {
        let size = self.course.camera.size;
        for row in 0..size.height {
            let at = self.row_time(pose, f64::from(row), size.height);
            self.resting_rows += u64::from(at < 0.0 || at > self.path.seconds());
            if let Some(lights) = &self.lights {
                let width = size.width as usize;
                let start = row as usize * width;
                lights.at(at).light_row(&mut picture.pixels_mut()[start..start + width]);
            }
        }
    }

    /// The rows of each band of a frame, from the flow at its pose.
    fn bands(
        &self,
        pose: usize,
        images: &RenderedImages,
        rows: u32,
        renderer: &dyn Renderer,
    ) -> Vec<Range<u32>> {
        let depth = images.depth.as_ref().expect("depth was asked for");
        let seconds = &self.course.seconds;
        let at = seconds[pose] - seconds[0];
        let (_, velocity) = self.path.at(at);
        let still = CameraView::at_rest(self.course.camera, self.course.poses[pose]).at_time(at);
        let views = renderer.object_views(&CameraView { velocity, ..still });
        let flow = flow_of_objects(depth, images.segmentation.as_ref(), &views);
        let flow = with_drift(flow, depth, images.drift.as_ref(), &self.course.camera);
        let squares = flow.pixels().iter().map(|[u, v]| u * u + v * v).filter(|square| square.is_finite());
        let fastest = f64::from(squares.fold(0.0, f32::max).sqrt());
        let height = band_rows(self.readout_s, fastest, rows);
        (0..rows).step_by(height as usize).map(|start| start..(start + height).min(rows)).collect()
    }

    /// Time of a row after the first pose, s.
    fn row_time(&self, pose: usize, row: f64, rows: u32) -> f64 {
        let seconds = &self.course.seconds;
        seconds[pose] - seconds[0] + row_seconds(self.readout_s, row, rows)
    }

    /// Time of the middle of a band after the first pose, within the path, s.
    fn band_seconds(&self, pose: usize, band: &Range<u32>, rows: u32) -> f64 {
        let middle = 0.5 * f64::from(band.start + band.end - 1);
        self.row_time(pose, middle, rows).clamp(0.0, self.path.seconds())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use gs2e_image::Size;
    use gs2e_render::RenderError;
    use gs2e_scene::camera::Camera;

    const CAMERA: Camera =
        Camera { size: Size { width: 4, height: 11 }, fx: 10.0, fy: 10.0, cx: 2.0, cy: 5.5, lens: None };

    /// Paints every pixel with the camera's position along x, at a depth that gives this flow.
    struct Walker {
        px_s: f64,
        rendered: usize,
    }

    impl Renderer for Walker {
        fn fingerprint(&self) -> &'static str {
            "walker"
        }

        #[expect(clippy::cast_possible_truncation, reason = "images have 32 bits")]
        fn render(
            &mut self,
            view: &CameraView,
            _: ChannelSet,
            out: &mut RenderedImages,
        ) -> Result<RenderWork, RenderError> {
            self.rendered += 1;
            out.rgb = Some(Image::filled(CAMERA.size, [view.world_from_camera.translation.x as f32; 3]));
            out.depth = Some(Image::filled(CAMERA.size, (CAMERA.fx / self.px_s) as f32));
            Ok(RenderWork { gaussians: 1, ..RenderWork::default() })
        }
    }

    /// A walk of 1 unit per second over 1 s, seen at a pose with this readout.
    fn rolled(px_s: f64, readout_us: u32, pose: usize) -> (Vec<f64>, RowRoller) {
        let seconds: Vec<f64> = (0..=10).map(|j| f64::from(j) / 10.0).collect();
        let at = |t: &f64| Se3 { rotation: DQuat::IDENTITY, translation: DVec3::X * *t };
        let course = ExposureCourse {
            camera: CAMERA,
            poses: seconds.iter().map(at).collect(),
            seconds: seconds.clone(),
        };
        let mut roller = RowRoller::new(course, readout_us).unwrap();
        let (mut walker, mut images) = (Walker { px_s, rendered: 0 }, RenderedImages::default());
        let view = CameraView::at_rest(CAMERA, at(&seconds[pose]));
        let work = walker.render(&view, RowRoller::WANT, &mut images).unwrap();
        let view = DenseView { pose, images: &images, work, renderer: &mut walker };
        let picture = roller.roll(view, &|| true).unwrap();
        let rows = picture.pixels().chunks(4).map(|row| f64::from(row[3][1])).collect();
        (rows, roller)
    }

    /// A fast image has a band for each row: 1e-7 is the rounding to 32 bits.
    #[test]
    fn each_row_is_seen_at_its_own_time() {
        let (rows, roller) = rolled(500.0, 100_000, 5);
        assert_eq!((roller.most_bands, roller.work.gaussians, roller.resting_rows), (11, 11, 0));
        for (r, x) in (0..11).zip(rows) {
            let wanted = 0.45 + 0.1 * f64::from(r) / 10.0;
            assert!((x - wanted).abs() < 1e-7, "row {r} is at {x}, wanted {wanted}");
        }
    }

    /// At 5 px/s and 10 ms from row to row, three rows make a band: the outer ones move by 0.05 px from its
    /// time.
    #[test]
    fn bands_are_as_high_as_the_flow_allows() {
        let (rows, roller) = rolled(5.0, 100_000, 5);
        assert_eq!(roller.most_bands, 4);
        for (r, x) in (0..11).zip(rows) {
            let off_px = 5.0 * (x - 0.45 - 0.1 * f64::from(r) / 10.0);
            assert!(off_px.abs() <= MISS_PX + 1e-6, "{r}: {off_px}");
        }
        // A slow image is one band: the rendering at the pose.
        let (rows, roller) = rolled(0.9, 100_000, 5);
        assert_eq!((roller.most_bands, roller.work.gaussians), (1, 0));
        assert!(rows.iter().all(|x| (x - 0.5).abs() < 1e-7), "{rows:?}");
    }

    #[test]
    fn the_camera_rests_before_the_path_and_after_it() {
        let (rows, roller) = rolled(500.0, 100_000, 0);
        assert_eq!(roller.resting_rows, 5);
        assert!(rows[..6].iter().all(|x| x.abs() < 1e-7) && (rows[10] - 0.05).abs() < 1e-7, "{rows:?}");
        let (rows, _) = rolled(500.0, 100_000, 10);
        assert!((rows[0] - 0.95).abs() < 1e-7 && (rows[10] - 1.0).abs() < 1e-7, "{rows:?}");
    }
}
