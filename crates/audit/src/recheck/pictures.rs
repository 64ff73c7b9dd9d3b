//! The pictures of a trajectory in a release tree. They are read here and nowhere else.

use super::{AuditedTree, RecheckError};
use gs2e_build::artifact::{OBJECT_PLACES, TrajectoryProduct};
use gs2e_check::geometry::watch::PosedPictures;
use gs2e_image::{GreyImage, Image, npy, png};
use gs2e_recipe::{OutputKind, Recipe};
use gs2e_sampling::exposure;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::flow::leave_out_parts;
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::motion::{PlaceLine, read_places};
use std::io::Cursor;

/// A trajectory's folder, and what its files say about its pictures.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReleasedPictures<'a> {
    pub(super) tree: AuditedTree<'a>,
    /// Path of the folder in the tree.
    pub(super) folder: &'a str,
    pub(super) recipe: &'a Recipe,
    pub(super) motion: &'a TrajectoryProduct,
    pub(super) camera: Camera,
}

impl ReleasedPictures<'_> {
    /// Returns true if the rows of a sharp frame have times of their own. Such frames are not compared with poses,
    /// events and exposures.
    pub(super) fn is_rolling(&self) -> bool {
        self.recipe.readout_us.is_some()
    }

    pub(super) fn poses(&self) -> usize {
        self.motion.trajectory.world_from_camera.len()
    }

    /// Numbers of the poses that have a picture of this kind.
    pub(super) fn poses_with(&self, kind: &str, extension: &str) -> Result<Vec<usize>, RecheckError> {
        let mut found = Vec::new();
        if kind == "sharp" && self.is_rolling() {
            return Ok(found);
        }
        for pose in 0..self.poses() {
            if self.tree.has(&self.name(kind, pose, extension))? {
                found.push(pose);
            }
        }
        Ok(found)
    }

    /// The poses with a picture, among those that a release of this recipe has.
    pub(super) fn kept_poses(&self, kind: OutputKind, extension: &str) -> Result<Vec<usize>, RecheckError> {
        let blurred = kind == OutputKind::Sharp && self.recipe.outputs.contains(&OutputKind::Blur);
        let exposed = blurred.then_some(self.recipe.shutter.frames);
        let mut found = Vec::new();
        if kind == OutputKind::Sharp && self.is_rolling() {
            return Ok(found);
        }
        for pose in exposure::kept_poses(self.poses(), self.recipe.every.poses(kind), exposed) {
            if self.tree.has(&self.name(kind.name(), pose, extension))? {
                found.push(pose);
            }
        }
        Ok(found)
    }

    /// The bytes of a colour picture, if it is in the tree.
    pub(super) fn colours(&self, kind: &str, pose: usize) -> Result<Option<Image<[u8; 3]>>, RecheckError> {
        let name = self.name(kind, pose, "png");
        let Some(bytes) = self.tree.picture(&name)? else { return Ok(None) };
        let read = png::read_sized(Cursor::new(bytes), self.camera.size);
        read.map(Some).map_err(|e| self.tree.refusal(&name, e))
    }

    /// The sharp frame at a pose, as a sensor without a front end of its own sees it.
    pub(super) fn frame(&self, pose: usize) -> Result<GreyImage, RecheckError> {
        let name = self.name("sharp", pose, "png");
        let read = png::read_colours(Cursor::new(self.bytes(&name)?), Some(self.camera.size));
        read.map_err(|e| self.tree.refusal(&name, e))
    }

    /// Brightness of a frame without the changes of the light, for comparisons with frames at other times. `None`
    /// where the light was too low.
    pub(super) fn unlit(&self, pose: usize, frame: &GreyImage) -> Option<Image<f32>> {
        let Some(lights) = &self.recipe.lights else { return Some(frame.luminance.clone()) };
        let undone = lights.undone_at_us(self.stamp(pose))?;
        let grey =
            || Image::from_vec(self.camera.size, frame.luminance.pixels().iter().map(|v| [*v; 3]).collect());
        let colours = frame.colours.clone().unwrap_or_else(grey);
        Some(undone.grey_in(colours))
    }

    /// [`Self::frame`], which also notes the form of its file.
    pub(super) fn frame_with_form(&self, pose: usize) -> Result<GreyImage, RecheckError> {
        let name = self.name("sharp", pose, "png");
        let read = png::read_composed(&self.bytes(&name)?, Some(self.camera.size));
        let (frame, is_composed) = read.map_err(|e| self.tree.refusal(&name, e))?;
        if is_composed {
            self.tree.note_composed(name);
        }
        Ok(frame)
    }

    /// The flow at a pose, px/s.
    pub(super) fn flow(&self, pose: usize) -> Result<Image<[f32; 2]>, RecheckError> {
        let values = self.values("flow", pose, &[2])?;
        Ok(Image::from_vec(self.camera.size, values.as_chunks().0.to_vec()))
    }

    /// The depth at a pose, that of objects too, scene units.
    pub(super) fn whole_depth(&self, pose: usize) -> Result<Image<f32>, RecheckError> {
        Ok(Image::from_vec(self.camera.size, self.values("depth", pose, &[])?))
    }

    /// The disparity at a pose, px.
    pub(super) fn disparity(&self, pose: usize) -> Result<Image<f32>, RecheckError> {
        Ok(Image::from_vec(self.camera.size, self.values("disparity", pose, &[])?))
    }

    /// The places of the objects, if the recipe has some and the tree has their file.
    pub(super) fn places(&self) -> Result<Option<Vec<PlaceLine>>, RecheckError> {
        let name = format!("{}/segmentation/{OBJECT_PLACES}", self.folder);
        if !self.has_objects() || !self.tree.has(&name)? {
            return Ok(None);
        }
        read_places(&self.tree.read(&name)?).map(Some).map_err(|e| self.tree.refusal(&name, e))
    }

    /// Returns true if things move on paths of their own.
    pub(super) fn has_objects(&self) -> bool {
        !self.recipe.objects.is_empty()
    }

    /// Returns true if the scene changes with time.
    pub(super) fn changes(&self) -> bool {
        self.recipe.scene_time().is_some()
    }

    /// The words for a motion that is not that of the camera; `None` without one.
    pub(super) fn own_motion(&self) -> Option<&'static str> {
        if self.changes() {
            return Some("the scene changes with time");
        }
        self.has_objects().then_some("objects move on paths of their own")
    }

    /// The mask at a pose, if objects move and the tree has one.
    pub(super) fn mask(&self, pose: usize) -> Result<Option<Image<u8>>, RecheckError> {
        if !self.has_objects() {
            return Ok(None);
        }
        let Some(mask) = self.colours("segmentation", pose)? else { return Ok(None) };
        Ok(Some(Image::from_vec(mask.size(), mask.pixels().iter().map(|[number, ..]| *number).collect())))
    }

    pub(super) fn stamp(&self, pose: usize) -> i64 {
        self.motion.trajectory.stamps_us[pose]
    }

    /// The views at all poses.
    pub(super) fn views(&self) -> Vec<CameraView> {
        let poses = self.motion.trajectory.world_from_camera.iter().zip(self.motion.velocities());
        let camera = self.camera;
        poses.map(|(pose, velocity)| CameraView { velocity, ..CameraView::at_rest(camera, *pose) }).collect()
    }

    fn values(&self, kind: &str, pose: usize, rest: &[u64]) -> Result<Vec<f32>, RecheckError> {
        let name = self.name(kind, pose, "npy");
        let size = self.camera.size;
        let shape = [&[size.height.into(), size.width.into()], rest].concat();
        npy::read_values(&shape, &mut Cursor::new(self.bytes(&name)?))
            .map_err(|e| self.tree.refusal(&name, e))
    }

    fn bytes(&self, name: &str) -> Result<Vec<u8>, RecheckError> {
        self.tree.picture(name)?.ok_or_else(|| self.tree.refusal(name, "it is missing"))
    }

    fn name(&self, kind: &str, pose: usize, extension: &str) -> String {
        format!("{}/{kind}/{pose:06}.{extension}", self.folder)
    }
}

impl PosedPictures for ReleasedPictures<'_> {
    type Error = RecheckError;

    fn brightness(&self, pose: usize) -> Result<Image<f32>, RecheckError> {
        let frame = self.frame(pose)?;
        Ok(self.unlit(pose, &frame).unwrap_or(frame.luminance))
    }

    fn depth(&self, pose: usize) -> Result<Image<f32>, RecheckError> {
        // Pixels of objects have a depth that the poses of the camera do not explain.
        let mut depth = self.whole_depth(pose)?;
        let mask = self.mask(pose)?;
        mask.iter().for_each(|mask| leave_out_parts(&mut depth, mask));
        Ok(depth)
    }
}
