//! Stage `disparity`: disparity of a stereo pair as seen by its first camera, one `.npy` per pose.

use super::pass::{PassGround, PoseProduct, PoseStage, PoseTaker};
use super::shot::{FileTaker, PoseFileForm, ShotParameters};
use super::{ExpectedSize, PathLength, StageError};
use crate::artifact::DisparityPictures;
use gs2e_image::npy;
use gs2e_num::se3::Se3;
use gs2e_recipe::OutputKind;
use gs2e_render::ChannelSet;
use gs2e_sampling::exposure;
use gs2e_scene::camera;
use gs2e_scene::camera::stereo::Rectification;
use gs2e_scene::camera::{Camera, CameraChoice};
use gs2e_trajectory::mount::CameraMount;
use serde::Serialize;

/// Parameters: the first camera, its rendering, the second camera, both places on the body, and the spacing
/// of images.
#[derive(Debug, Serialize)]
pub struct DisparityStage {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: ShotParameters,
    /// Spacing of images, in poses.
    pub every: u32,
    /// The second camera, if it differs from that of the source.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second: Option<CameraChoice>,
    /// Places of the first and the second camera.
    pub mounts: [CameraMount; 2],
    /// The motion between them.
    #[serde(skip)]
    pub second_from_first: Se3,
}

/// Memory per pixel of an image and its copy, bytes, as for depth.
const BYTES_A_PIXEL: u64 = 8;

/// Bytes per pixel of an image: a number of 32 bits.
const BYTES_OF_IMAGE: f64 = 4.0;

impl PoseProduct for DisparityStage {
    const NAME: &'static str = OutputKind::Disparity.name();
    const REVISION: u32 = 1;
    type Output = DisparityPictures;

    fn size_along(&self, path: PathLength) -> ExpectedSize {
        ExpectedSize::of_pictures(path.pictures(self.every), self.shot.camera, BYTES_OF_IMAGE)
    }
}

impl PoseStage for DisparityStage {
    fn shot(&self) -> &ShotParameters {
        &self.shot
    }

    fn bytes_a_pixel(&self) -> u64 {
        BYTES_A_PIXEL
    }

    fn taker(&self, ground: &PassGround, first: Camera) -> Result<Box<dyn PoseTaker>, StageError> {
        let own = ground.capture.camera().map(|(own, _)| own);
        let second = camera::choose_camera(self.second, own.as_ref()).unwrap_or(first);
        let pair = Rectification::new([first, second], &self.second_from_first);
        let pair = pair.map_err(StageError::work_failed("rectify the stereo pair"))?;
        let kept = exposure::kept_poses(ground.poses(), self.every, None);
        let form = PoseFileForm {
            extension: "npy",
            keep: Box::new(move |images, _| {
                pair.disparity_image(images.depth.as_ref().expect("depth was asked for"))
            }),
            write: |image, file| npy::write_image(image, file),
            is_encoded: false,
        };
        let channels = ChannelSet { depth: true, ..ChannelSet::NONE };
        Ok(Box::new(FileTaker::new(kept, channels, form)))
    }
}
