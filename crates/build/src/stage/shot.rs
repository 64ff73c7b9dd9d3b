//! Common part of the stages that render pictures for a release: camera, rules, and one file per pose.

use super::near::hide_near_along;
use super::pass::{PassGround, PoseTaker};
use super::{StageContext, StageError, StepNeed};
use crate::artifact::ArtifactFiles;
use gs2e_render::backend::Backend;
use gs2e_render::{ChannelSet, OmissionPolicy, RenderChoice, RenderWork, RenderedImages, Renderer};
use gs2e_sampling::rendered::RenderedPose;
use gs2e_scene::camera::{Camera, CameraChoice};
use rayon::prelude::*;
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter};

/// Parameters: the camera and the rendering.
#[derive(Debug, Clone, Serialize)]
pub struct ShotParameters {
    /// The camera, if it differs from the source's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraChoice>,
    /// The rendering.
    pub render: RenderChoice,
    /// Work that the renderer leaves out. The stored counts depend on it; pictures do not.
    #[serde(skip_serializing_if = "OmissionPolicy::is_needless")]
    pub omit: OmissionPolicy,
    /// The back end.
    #[serde(skip)]
    pub backend: Backend,
}

impl ShotParameters {
    pub(super) fn need(&self, files: &[ArtifactFiles], bytes_a_pixel: u64) -> StepNeed {
        super::rendering_need(&self.backend, self.camera, files, bytes_a_pixel)
    }

    /// A renderer that was promised the poses.
    pub(super) fn renderer(
        &self,
        ground: &PassGround,
        camera: Camera,
    ) -> Result<Box<dyn Renderer>, StageError> {
        let style = self.render.resolve(ground.gaussians.antialiased);
        let (visible, _) = hide_near_along(&ground.gaussians, &ground.motion, &camera, &self.render);
        let renderer = self.backend.renderer(visible, style);
        let mut renderer = renderer.map_err(StageError::work_failed("render"))?;
        // The policy comes first: under another one, the renderer ignores the promise.
        renderer.omit(self.omit);
        renderer.keep_to(&camera, &ground.motion.trajectory.world_from_camera);
        Ok(renderer)
    }
}

/// Number of pictures that wait for their encoder, which uses one core per picture.
const BATCH: usize = 8;

/// A taker that writes one file per pose.
pub(super) struct FileTaker<K> {
    /// The poses with a file, ascending.
    poses: Vec<usize>,
    want: ChannelSet,
    form: PoseFileForm<K>,
    /// Images that wait to be written, with their pose.
    kept: Vec<(usize, K)>,
    pub(super) work: RenderWork,
}

/// Takes the part of a pose's images that is kept; the number is that of the pose.
pub(super) type KeptPart<K> = Box<dyn Fn(&RenderedImages, usize) -> K>;

/// The form of a pose's file. `keep` takes the number of the pose.
pub(super) struct PoseFileForm<K> {
    /// The extension of its name.
    pub(super) extension: &'static str,
    /// The part of the images that is kept until the file is written.
    pub(super) keep: KeptPart<K>,
    /// Writes the file.
    pub(super) write: fn(&K, BufWriter<File>) -> io::Result<()>,
    /// True if writing costs more than a copy, so that several cores should write at once.
    pub(super) is_encoded: bool,
}

impl<K: Sync> FileTaker<K> {
    /// Files of these poses, ascending.
    pub(super) fn new(poses: Vec<usize>, want: ChannelSet, form: PoseFileForm<K>) -> Self {
        Self { poses, want, form, kept: Vec::new(), work: RenderWork::default() }
    }

    pub(super) fn has(&self, pose: usize) -> bool {
        self.poses.binary_search(&pose).is_ok()
    }

    /// Writes what waits.
    fn flush(&mut self, cx: &StageContext<'_>) -> Result<(), StageError> {
        let PoseFileForm { extension, write, .. } = self.form;
        let out = cx.out;
        let written = self.kept.par_iter().try_for_each(|(pose, kept)| {
            let path = out.join(format!("{pose:06}.{extension}"));
            let written = File::create(&path).and_then(|file| write(kept, BufWriter::new(file)));
            written.map_err(StageError::io_error(&path))
        });
        self.kept.clear();
        written
    }
}

impl<K: Sync> PoseTaker for FileTaker<K> {
    fn want(&mut self, pose: usize, _: &mut dyn Renderer) -> ChannelSet {
        if self.has(pose) { self.want } else { ChannelSet::NONE }
    }

    fn take(&mut self, pose: RenderedPose<'_>, cx: &StageContext<'_>) -> Result<(), StageError> {
        if !self.has(pose.index) {
            return Ok(());
        }
        self.work += pose.work;
        self.kept.push((pose.index, (self.form.keep)(pose.images, pose.index)));
        let most = if self.form.is_encoded { BATCH } else { 1 };
        if self.kept.len() < most { Ok(()) } else { self.flush(cx) }
    }

    fn finish(mut self: Box<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        self.flush(cx)?;
        record_work(&self.work, cx)
    }
}

/// Writes the counts of the rendering.
pub(super) fn record_work(work: &RenderWork, cx: &StageContext<'_>) -> Result<(), StageError> {
    cx.write_record("work.json", work)
}
