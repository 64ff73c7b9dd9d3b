//! The pictures of a trajectory in a release tree, read one by one.

use super::{AuditedTree, RecheckError, unreadable_file};
use crate::artifact::TrajectoryProduct;
use crate::camera::Camera;
use crate::files;
use crate::image::{GreyImage, Image, npy, png};
use std::io::Cursor;
use std::path::Path;

/// A trajectory's folder, with what its pictures are read by.
#[derive(Clone, Copy)]
pub(super) struct ReleasedPictures<'a> {
    pub(super) tree: AuditedTree<'a>,
    pub(super) folder: &'a str,
    pub(super) camera: Camera,
    pub(super) motion: &'a TrajectoryProduct,
}

impl ReleasedPictures<'_> {
    /// Numbers of the poses that have a picture of this kind.
    pub(super) fn poses_with(&self, kind: &str, extension: &str) -> Result<Vec<usize>, RecheckError> {
        let mut found = Vec::new();
        for pose in 0..self.motion.trajectory.world_from_camera.len() {
            if self.tree.has(&self.name(kind, pose, extension))? {
                found.push(pose);
            }
        }
        Ok(found)
    }

    /// The sharp frame at a pose.
    pub(super) fn frame(&self, pose: usize) -> Result<GreyImage, RecheckError> {
        let name = self.name("sharp", pose, "png");
        let size = Some(self.camera.size);
        png::read_colours(Cursor::new(self.read(&name)?), size).map_err(|e| self.fault(&name, e))
    }

    /// The depth at a pose.
    pub(super) fn depth(&self, pose: usize) -> Result<Image<f32>, RecheckError> {
        let (width, height) = (self.camera.size.width.into(), self.camera.size.height.into());
        Ok(Image::from_vec(self.camera.size, self.array("depth", pose, &[height, width])?))
    }

    /// The flow at a pose, px/s.
    pub(super) fn flow(&self, pose: usize) -> Result<Image<[f32; 2]>, RecheckError> {
        let (width, height) = (self.camera.size.width.into(), self.camera.size.height.into());
        let values = self.array("flow", pose, &[height, width, 2])?;
        Ok(Image::from_vec(self.camera.size, values.as_chunks().0.to_vec()))
    }

    fn array(&self, kind: &str, pose: usize, shape: &[u64]) -> Result<Vec<f32>, RecheckError> {
        let name = self.name(kind, pose, "npy");
        npy::read_values(shape, &mut Cursor::new(self.read(&name)?)).map_err(|e| self.fault(&name, e))
    }

    fn name(&self, kind: &str, pose: usize, extension: &str) -> String {
        format!("{}/{kind}/{pose:06}.{extension}", self.folder)
    }

    fn read(&self, name: &str) -> Result<Vec<u8>, RecheckError> {
        files::read_below(self.tree.dir, Path::new(name), files::MAX_PICTURE).map_err(|e| self.fault(name, e))
    }

    fn fault(&self, name: &str, because: impl std::fmt::Display) -> RecheckError {
        unreadable_file(&self.tree.path_of(name), because)
    }
}
