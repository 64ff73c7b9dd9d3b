//! Photos for training: undistorted, at the size of training and at its half and quarter.

use super::TrainingError;
use super::loss::TrainingPhoto;
use super::memory::READ_AT_ONCE;
use super::schedule::LEVELS;
use gs2e_files as files;
use gs2e_image::{Image, Size, photo, shrink};
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use gs2e_source::reconstruct::find_photo;
use gs2e_source::undistort::{covered_pixels, undistort_photo};
use gs2e_source::{Capture, CapturedView};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Smallest side of a photo that is trained on at half or quarter size, px: a few windows of the
/// loss.
const LEAST_SIDE: u32 = 40;

/// A view with its photo.
#[derive(Debug)]
pub(crate) struct TrainingView {
    /// Name of the view.
    pub(crate) name: String,
    /// Index in the capture.
    pub(crate) index: usize,
    /// Camera to world.
    pub(crate) world_from_camera: Se3,
    /// The photo, full size first. Small photos have fewer sizes.
    levels: Vec<(Camera, TrainingPhoto)>,
}

/// The views of a capture, split into those to train on and those held out.
#[derive(Debug)]
pub(crate) struct TrainingViews {
    /// Views to train on.
    pub training: Vec<TrainingView>,
    /// Views held out.
    pub(crate) held_out: Vec<TrainingView>,
    /// Number of views without a photo.
    pub(crate) without_photo: usize,
}

/// Smallest number of views to train on.
const MIN_VIEWS: usize = 3;

impl TrainingViews {
    /// Reads the photos. `files` are the files of the capture's source, by their names in the source.
    /// Photos wider than `width` are scaled down to it. Every `hold_out`-th view is held out, the
    /// first included; 0 holds out none.
    ///
    /// # Errors
    /// A photo cannot be read or has another size than its camera, or too few views are left.
    pub(crate) fn read(
        capture: &Capture,
        files: &[(String, PathBuf)],
        width: u32,
        hold_out: u32,
        goes_on: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, TrainingError> {
        let found: Vec<(usize, &CapturedView, &Path)> = capture
            .views
            .iter()
            .enumerate()
            .filter_map(|(i, view)| Some((i, view, find_photo(view, files)?)))
            .collect();
        let is_held = |index: usize| hold_out > 0 && index.is_multiple_of(hold_out as usize);
        let without_photo = capture.views.len() - found.len();
        let training = found.iter().filter(|(i, ..)| !is_held(*i)).count();
        // Counted before anything is read: photos take long.
        if training < MIN_VIEWS {
            let (views, held_out) = (capture.views.len(), found.len() - training);
            return Err(TrainingError::FewViews { views, without_photo, held_out, wanted: MIN_VIEWS });
        }
        let read = |&(index, view, photo): &(usize, &CapturedView, &Path)| {
            if goes_on() {
                TrainingView::read(index, view, photo, width)
            } else {
                Err(TrainingError::Stopped)
            }
        };
        let mut views = Vec::with_capacity(found.len());
        // A few at a time: a decoded photo is many times larger than what is kept of it.
        for group in found.chunks(READ_AT_ONCE) {
            let read: Vec<TrainingView> = group.par_iter().map(read).collect::<Result<_, _>>()?;
            views.extend(read);
        }
        let (held_out, training) = views.into_iter().partition(|view: &TrainingView| is_held(view.index));
        Ok(Self { training, held_out, without_photo })
    }
}

impl TrainingView {
    /// Reads the photo of a view.
    fn read(index: usize, view: &CapturedView, photo: &Path, width: u32) -> Result<Self, TrainingError> {
        let failed = |because: String| TrainingError::Photo { path: photo.to_owned(), because };
        let bytes = files::read(photo, files::MAX_PICTURE).map_err(|e| failed(e.to_string()))?;
        let taken = photo::read_photo(&bytes, view.camera.size).map_err(|e| failed(e.to_string()))?;
        // The renderer has no lens, so the photos must have none either.
        let straight = undistort_photo(&taken, &view.camera, &view.lens);
        let covered = covered_pixels(&view.camera, &view.lens);
        let mut levels = vec![scaled(&view.camera, &straight, covered.as_ref(), width)];
        for level in 1..LEVELS {
            let first: &(Camera, TrainingPhoto) = &levels[0];
            let Size { width, height } = first.0.size;
            // A smaller picture would be little more than the window of the similarity.
            if (width.min(height) >> level) < LEAST_SIDE {
                break;
            }
            levels.push(scaled(&first.0, &first.1.colours, first.1.counted.as_ref(), width >> level));
        }
        let name = view.name.clone();
        Ok(Self { name, index, world_from_camera: view.world_from_camera, levels })
    }

    /// The view and its photo at a level; the smallest one if there are fewer.
    #[must_use]
    pub(crate) fn at_level(&self, level: usize) -> (CameraView, &TrainingPhoto) {
        let (camera, photo) = &self.levels[level.min(self.levels.len() - 1)];
        (CameraView::at_rest(*camera, self.world_from_camera), photo)
    }

    /// The photo scaled down to a width, with the camera that sees it.
    pub(super) fn at_width(&self, width: u32) -> (Camera, TrainingPhoto) {
        let (camera, photo) = &self.levels[0];
        scaled(camera, &photo.colours, photo.counted.as_ref(), width)
    }
}

/// A photo scaled down to `width`, with the camera that sees it.
fn scaled(
    camera: &Camera,
    photo: &Image<[u8; 3]>,
    counted: Option<&Image<bool>>,
    width: u32,
) -> (Camera, TrainingPhoto) {
    let colours = shrink::to_width(photo, width);
    let size = colours.size();
    let counted = counted.map(|counted| shrunk_mask(counted, size));
    (rescaled(camera, size), TrainingPhoto { colours, counted })
}

/// The size at which a photo is trained on.
#[must_use]
pub fn trained_size(photo: Size, width: u32) -> Size {
    let width = width.min(photo.width);
    // As `shrink::to_width` has it: the height is rounded up.
    let height = (u64::from(photo.height) * u64::from(width)).div_ceil(u64::from(photo.width.max(1)));
    Size { width, height: u32::try_from(height).unwrap_or(u32::MAX) }
}

/// The camera of the same view at another size. The height of a smaller photo is rounded up, so both
/// axes have a factor of their own.
fn rescaled(camera: &Camera, size: Size) -> Camera {
    let x = f64::from(size.width) / f64::from(camera.size.width);
    let y = f64::from(size.height) / f64::from(camera.size.height);
    // Pixel centres are at half-integers, so the principal point scales without an offset.
    Camera { size, fx: camera.fx * x, fy: camera.fy * y, cx: camera.cx * x, cy: camera.cy * y, lens: None }
}

/// A smaller mask: a pixel counts if all that it covers counts.
fn shrunk_mask(counted: &Image<bool>, to: Size) -> Image<bool> {
    let from = counted.size();
    let range = |at: u32, to: u32, from: u32| {
        let [at, to, from] = [at, to, from].map(|n| n as usize);
        at * from / to..((at + 1) * from).div_ceil(to)
    };
    let all = |x: u32, y: u32| {
        // A shrunk pixel counts only if all of its pixels do: a single black one would darken the
        // mean.
        range(y, to.height, from.height).all(|row| {
            let row = &counted.pixels()[row * from.width as usize..][..from.width as usize];
            row[range(x, to.width, from.width)].iter().all(|counted| *counted)
        })
    };
    let pixels = (0..to.height).flat_map(|y| (0..to.width).map(move |x| (x, y)));
    Image::from_vec(to, pixels.map(|(x, y)| all(x, y)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smaller_camera_sees_the_same_rays() {
        let camera = Camera::pinhole(Size { width: 1080, height: 1919 }, [1000.0, 1010.0, 530.0, 960.0]);
        let small = rescaled(&camera, Size { width: 270, height: 480 });
        // The right and lower edges stay the edges.
        for (full, small, edges) in [
            ([camera.fx, camera.cx], [small.fx, small.cx], [1080.0, 270.0]),
            ([camera.fy, camera.cy], [small.fy, small.cy], [1919.0, 480.0]),
        ] {
            let slope = |[f, c]: [f64; 2], edge: f64| (edge - c) / f;
            assert!((slope(full, edges[0]) - slope(small, edges[1])).abs() < 1e-12);
            assert!((slope(full, 0.0) - slope(small, 0.0)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_pixel_counts_if_all_that_it_covers_counts() {
        let mut mask = Image::filled(Size { width: 6, height: 4 }, true);
        mask.pixels_mut()[2] = false;
        let found = shrunk_mask(&mask, Size { width: 3, height: 2 });
        assert_eq!(found.pixels(), [true, false, true, true, true, true]);
        // 6 to 4: the second pixel covers columns 1.5 to 3, the first 0 to 1.5.
        let found = shrunk_mask(&mask, Size { width: 4, height: 4 });
        assert_eq!(found.pixels()[..4], [true, false, true, true]);
    }
}
