//! The products of a trajectory that no other stage reads: inertial data and disparity.

use super::{CheckedPair, ChecksStage};
use crate::artifact::{DisparityPictures, EventStreams, ImuRecording, PictureSet, TrajectoryProduct};
use crate::stage::{StageContext, StageError, StepTarget};
use gs2e_check::Finding;
use gs2e_check::depth_consistency::disparity::DisparityDifference;
use gs2e_check::geometry::Measurement;
use gs2e_check::records::inertial::{InertialBytes, judge_inertial};
use gs2e_check::records::judge_agreement;
use gs2e_files as files;
use gs2e_image::{Image, Size, npy};
use gs2e_scene::camera::choose_camera;
use gs2e_scene::camera::stereo::Rectification;
use gs2e_source::Capture;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// The products that the checks look at, if the trajectory has them: inertial data, disparity, and depth and
/// the capture to compare the disparity with.
pub(crate) type CheckedProducts = (
    Option<StepTarget<ImuRecording>>,
    Option<StepTarget<DisparityPictures>>,
    Option<StepTarget<PictureSet>>,
    Option<StepTarget<Capture>>,
);

/// [`CheckedProducts`], opened.
pub(super) type OpenedProducts =
    (Option<ImuRecording>, Option<DisparityPictures>, Option<PictureSet>, Option<Capture>);

fn path_of<'f>(files: &'f [(String, PathBuf)], name: &str) -> Option<&'f Path> {
    files.iter().find(|(own, _)| own == name).map(|(_, path)| path.as_path())
}

fn read(path: &Path, most: u64) -> Result<Vec<u8>, StageError> {
    files::read(path, most).map_err(StageError::io_error(path))
}

impl ChecksStage {
    /// Compares inertial data with poses and recipe. `None` without such data.
    pub(super) fn judge_inertial(
        &self,
        recording: Option<&ImuRecording>,
        motion: &TrajectoryProduct,
    ) -> Result<Option<Finding>, StageError> {
        let (Some(model), Some(recording)) = (&self.imu, recording) else { return Ok(None) };
        let [samples, states, sensor] = InertialBytes::NAMES.map(|name| {
            // An absent file is judged like an empty one, so it becomes a finding and does not end the step.
            path_of(&recording.files, name).map_or(Ok(Vec::new()), |path| read(path, files::MAX_DOCUMENT))
        });
        let (samples, states, sensor) = (samples?, states?, sensor?);
        let files = InertialBytes([&samples, &states, &sensor]);
        let found = judge_inertial("", model, files, &motion.trajectory);
        Ok(Some(found.unwrap_or_else(|fault| {
            judge_agreement("", "imu", "imu/", &[format!("imu/{}: {}", fault.file, fault.because)])
        })))
    }

    /// Compares disparity images with depth images. `None` without disparity.
    pub(super) fn compare_disparities(
        &self,
        products: &OpenedProducts,
        motion: &TrajectoryProduct,
        events: Option<&EventStreams>,
        cx: &StageContext<'_>,
    ) -> Result<Option<Measurement<Vec<DisparityDifference>>>, StageError> {
        let (_, disparity, depth, capture) = products;
        let (Some(pair), Some(disparity), Some(capture)) = (&self.pair, disparity, capture) else {
            return Ok(None);
        };
        let (pair, size) = pair.rectify(capture)?;
        let depths =
            KnownDepths { pictures: depth.as_ref(), events, stamps_us: &motion.trajectory.stamps_us };
        let mut found = Vec::new();
        for (name, path) in &disparity.0.files {
            cx.go_on()?;
            let Some(KnownDepth { pose, image, is_whole }) = depths.at(name, size)? else { continue };
            let expected = pair.disparity_image(&image);
            let mut stated = read_picture(path, size)?;
            // A disparity without an expected one counts as a fault, and this image lacks the objects that
            // move.
            if !is_whole {
                let pixels = stated.pixels_mut().iter_mut().zip(expected.pixels());
                pixels.filter(|(_, expected)| expected.is_nan()).for_each(|(stated, _)| *stated = f32::NAN);
            }
            found.push(DisparityDifference::new(pose, &stated, &expected));
        }
        let none = || "no pose with a disparity has a depth: add `depth` to the outputs".to_owned();
        Ok(Some(if found.is_empty() { Err(none()) } else { Ok(found) }))
    }
}

impl CheckedPair {
    fn rectify(&self, capture: &Capture) -> Result<(Rectification, Size), StageError> {
        let own = capture.camera().map(|(own, _)| own);
        let camera = |choice| choose_camera(choice, own.as_ref());
        let first = camera(self.first).expect("a trajectory with pictures has a camera");
        let second = camera(self.second).unwrap_or(first);
        let pair = Rectification::new([first, second], &self.second_from_first);
        Ok((pair.map_err(StageError::work_failed("rectify the stereo pair"))?, first.size))
    }
}

fn read_picture(path: &Path, size: Size) -> Result<Image<f32>, StageError> {
    let bytes = read(path, files::MAX_PICTURE)?;
    let values = npy::read_values(&[size.height.into(), size.width.into()], &mut Cursor::new(bytes));
    values
        .map(|values| Image::from_vec(size, values))
        .map_err(StageError::work_failed(&format!("read {}", path.display())))
}

/// The depth images of a trajectory: its own product, or else those of the simulation.
struct KnownDepths<'a> {
    pictures: Option<&'a PictureSet>,
    events: Option<&'a EventStreams>,
    stamps_us: &'a [i64],
}

/// A depth image.
struct KnownDepth {
    pose: usize,
    image: Image<f32>,
    /// False for an image of the simulation, which lacks what moves by itself.
    is_whole: bool,
}

impl KnownDepths<'_> {
    /// The depth image of the pose that has this picture.
    fn at(&self, name: &str, size: Size) -> Result<Option<KnownDepth>, StageError> {
        let Some(pose) = name.split('.').next().and_then(|pose| pose.parse::<usize>().ok()) else {
            return Ok(None);
        };
        if let Some(path) = self.pictures.and_then(|pictures| path_of(&pictures.files, name)) {
            return Ok(Some(KnownDepth { pose, image: read_picture(path, size)?, is_whole: true }));
        }
        let (Some(events), Some(stamp)) = (self.events, self.stamps_us.get(pose)) else { return Ok(None) };
        let at = events.simulation.depth_stamps_us.iter().position(|t_us| t_us == stamp);
        Ok(at.map(|at| KnownDepth { pose, image: events.depths[at].clone(), is_whole: false }))
    }
}
