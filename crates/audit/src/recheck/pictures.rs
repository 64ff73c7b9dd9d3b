//! The pictures of a trajectory in a release tree. They are read here and nowhere else.

use gs2e_build::artifact::{OBJECT_PLACES, TrajectoryProduct};
use gs2e_check::geometry::watch::PosedPictures;
use gs2e_image::{GreyImage, Image, png};
use gs2e_recipe::{OutputKind, Recipe};
use gs2e_sampling::exposure;
use gs2e_scene::camera::flow::leave_out_objects;
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::motion::{PlaceLine, read_places};
use gs2e_tree::{PictureKind, TrajectoryFiles, TreeError};
use std::collections::BTreeSet;
use std::io::Cursor;
use std::sync::Mutex;

/// Paths of the pictures whose files are what this program writes for them. Each was decoded for the passes,
/// and need not be decoded again for its form.
pub(super) type ComposedPictures = Mutex<BTreeSet<String>>;

/// A trajectory's files, and what they say about its pictures.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReleasedPictures<'a> {
    pub(super) files: &'a TrajectoryFiles<'a>,
    pub(super) composed: &'a ComposedPictures,
    pub(super) recipe: &'a Recipe,
    pub(super) motion: &'a TrajectoryProduct,
}

impl ReleasedPictures<'_> {
    /// Returns true if the rows of a sharp frame have times of their own. Such frames are not compared with
    /// poses, events and exposures.
    pub(super) fn is_rolling(&self) -> bool {
        self.recipe.readout_us.is_some()
    }

    pub(super) fn poses(&self) -> usize {
        self.motion.trajectory.world_from_camera.len()
    }

    /// Numbers of the poses that have a picture of this kind.
    pub(super) fn poses_with(&self, kind: PictureKind) -> Result<Vec<usize>, TreeError> {
        let poses = if kind == PictureKind::Sharp && self.is_rolling() { 0 } else { self.poses() };
        self.files.poses_with(kind, 0..poses)
    }

    /// The poses with a picture, among those that a release of this recipe has.
    pub(super) fn kept_poses(&self, kind: PictureKind, output: OutputKind) -> Result<Vec<usize>, TreeError> {
        let is_sharp = output == OutputKind::Sharp;
        if is_sharp && self.is_rolling() {
            return Ok(Vec::new());
        }
        let blurred = is_sharp && self.recipe.outputs.contains(&OutputKind::Blur);
        let exposed = blurred.then_some(self.recipe.shutter.frames);
        let kept = exposure::kept_poses(self.poses(), self.recipe.every.poses(output), exposed);
        self.files.poses_with(kind, kept)
    }

    /// A colour picture, if it is in the tree.
    pub(super) fn colours(
        &self,
        kind: PictureKind,
        pose: usize,
    ) -> Result<Option<Image<[u8; 3]>>, TreeError> {
        let is_there = self.files.has(&kind.name(pose))?;
        is_there.then(|| self.files.colours(kind, pose)).transpose()
    }

    /// The sharp frame at a pose, as a sensor without a front end of its own sees it.
    pub(super) fn frame(&self, pose: usize) -> Result<GreyImage, TreeError> {
        let file = self.files.picture(PictureKind::Sharp, pose)?;
        png::read_colours(Cursor::new(file), Some(self.files.camera.size)).map_err(|e| self.no_frame(pose, e))
    }

    fn no_frame(&self, pose: usize, because: png::PngError) -> TreeError {
        self.files.refusal(&PictureKind::Sharp.name(pose), because)
    }

    /// Brightness of a frame without the changes of the light, for comparisons with frames at other times.
    /// `None` where the light was too low.
    pub(super) fn unlit(&self, pose: usize, frame: &GreyImage) -> Option<Image<f32>> {
        let Some(lights) = &self.recipe.lights else { return Some(frame.luminance.clone()) };
        let undone = lights.undone_at_us(self.stamp(pose))?;
        let grey = || {
            Image::from_vec(
                self.files.camera.size,
                frame.luminance.pixels().iter().map(|v| [*v; 3]).collect(),
            )
        };
        let colours = frame.colours.clone().unwrap_or_else(grey);
        Some(undone.grey_in(colours))
    }

    /// [`Self::frame`], which also notes the form of its file.
    pub(super) fn frame_with_form(&self, pose: usize) -> Result<GreyImage, TreeError> {
        let file = self.files.picture(PictureKind::Sharp, pose)?;
        let read = png::read_composed(&file, Some(self.files.camera.size));
        let (frame, is_composed) = read.map_err(|e| self.no_frame(pose, e))?;
        if is_composed {
            let path = self.files.path(&PictureKind::Sharp.name(pose));
            self.composed.lock().expect("no thread panics while it holds the names").insert(path);
        }
        Ok(frame)
    }

    /// The places of the objects, if the recipe has some and the tree has their file.
    pub(super) fn places(&self) -> Result<Option<Vec<PlaceLine>>, TreeError> {
        let name = format!("segmentation/{OBJECT_PLACES}");
        if !self.has_objects() || !self.files.has(&name)? {
            return Ok(None);
        }
        read_places(&self.files.read(&name)?).map(Some).map_err(|e| self.files.refusal(&name, e))
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
    pub(super) fn other_motion(&self) -> Option<&'static str> {
        if self.changes() {
            return Some("the scene changes with time");
        }
        self.has_objects().then_some("objects move on paths of their own")
    }

    /// The segmentation at a pose, if objects move and the tree has one.
    pub(super) fn segmentation(&self, pose: usize) -> Result<Option<Image<u8>>, TreeError> {
        if !self.has_objects() {
            return Ok(None);
        }
        let Some(segmentation) = self.colours(PictureKind::Segmentation, pose)? else { return Ok(None) };
        Ok(Some(Image::from_vec(
            segmentation.size(),
            segmentation.pixels().iter().map(|[number, ..]| *number).collect(),
        )))
    }

    pub(super) fn stamp(&self, pose: usize) -> i64 {
        self.motion.trajectory.stamps_us[pose]
    }

    /// The views at all poses.
    pub(super) fn views(&self) -> Vec<CameraView> {
        let poses = self.motion.trajectory.world_from_camera.iter().zip(self.motion.velocities());
        let camera = self.files.camera;
        poses.map(|(pose, velocity)| CameraView { velocity, ..CameraView::at_rest(camera, *pose) }).collect()
    }
}

impl PosedPictures for ReleasedPictures<'_> {
    type Error = TreeError;

    fn brightness(&self, pose: usize) -> Result<Image<f32>, TreeError> {
        let frame = self.frame(pose)?;
        Ok(self.unlit(pose, &frame).unwrap_or(frame.luminance))
    }

    fn depth(&self, pose: usize) -> Result<Image<f32>, TreeError> {
        // Pixels of objects have a depth that the poses of the camera do not explain.
        let mut depth = self.files.values(PictureKind::Depth, pose)?;
        let segmentation = self.segmentation(pose)?;
        segmentation.iter().for_each(|segmentation| leave_out_objects(&mut depth, segmentation));
        Ok(depth)
    }
}
