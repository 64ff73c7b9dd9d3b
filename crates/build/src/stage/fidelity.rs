//! Stage `fidelity`: compares renderings of a scene with the photos of its capture. Without photos,
//! it does nothing and creates no renderer.

use super::capture::{CaptureStage, SolvingInputs};
use super::{OpenedInputs, SourceFile, Stage, StageContext, StageError, StageFacts, StepNeed, StepTarget};
use crate::artifact::{ArtifactFiles, HELD_OUT_PICTURE};
use gs2e_files as files;
use gs2e_image::{photo, png};
use gs2e_render::RenderChoice;
use gs2e_render::backend::Backend;
use gs2e_scene::Gaussians;
use gs2e_source::{Capture, CapturedView};
use gs2e_train::fidelity::sheet::{ComparisonSheet, MAX_ROWS};
use gs2e_train::fidelity::{
    ComparedView, HeldOutViews, NotCompared, PhotoFidelity, ViewComparison, compare_view, picked_indices,
    spread_indices,
};
use serde::Serialize;
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::sync::Arc;

/// Parameters: the rendering, and the views that the training did not see. The camera is that of
/// each photo.
#[derive(Debug, Serialize)]
pub(crate) struct FidelityStage {
    /// The rendering.
    pub render: RenderChoice,
    /// The views that the training did not see.
    pub held_out: HeldOutViews,
    /// The photos.
    #[serde(skip)]
    pub capturing: CaptureStage,
    /// The back end.
    #[serde(skip)]
    pub backend: Backend,
}

/// Bytes per pixel: the original photo, the undistorted photo in 32 bits, the rendering, and the
/// decoder.
const BYTES_A_PIXEL: u64 = 48;

impl StageFacts for FidelityStage {
    fn class(&self) -> Option<String> {
        Some(self.backend.class())
    }

    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        self.capturing.photos()
    }

    fn source_folders(&self) -> Vec<PathBuf> {
        self.capturing.source_folders()
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        super::rendering_need(&self.backend, None, files, BYTES_A_PIXEL)
    }
}

impl Stage for FidelityStage {
    const NAME: &'static str = "fidelity";
    const REVISION: u32 = 2;
    type Inputs = (StepTarget<Capture>, StepTarget<Gaussians>, SolvingInputs);
    type Output = PhotoFidelity;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let (capture, gaussians, solved) = inputs;
        let photos = self.capturing.all_photos(&solved)?;
        let taken = views_taken(&capture, &photos);
        let picked: Vec<PhotoView<'_>> = picked_indices(taken.len()).into_iter().map(|k| taken[k]).collect();
        let mut sheet = ComparisonSheet::default();
        let fidelity = self.measure(&Arc::new(gaussians), &picked, &mut sheet, cx)?;
        if let Some(image) = sheet.into_image() {
            let out = cx.out.join(HELD_OUT_PICTURE);
            let write = |file| png::write_image(&image, BufWriter::new(file));
            File::create(&out).and_then(write).map_err(StageError::io_error(&out))?;
        }
        cx.write_record("fidelity.json", &fidelity)
    }
}

/// A view with its index and its photo.
pub(super) type PhotoView<'a> = (usize, &'a CapturedView, &'a SourceFile);

/// The views with a photo.
pub(super) fn views_taken<'a>(capture: &'a Capture, photos: &'a [SourceFile]) -> Vec<PhotoView<'a>> {
    let views = capture.views.iter().enumerate();
    views.filter_map(|(i, view)| Some((i, view, photo_of(view, photos)?))).collect()
}

impl FidelityStage {
    /// Compares a scene with these photos. Without photos, no renderer is created. `sheet` gets some of
    /// the held-out views.
    pub(super) fn measure(
        &self,
        gaussians: &Arc<Gaussians>,
        taken: &[PhotoView<'_>],
        sheet: &mut ComparisonSheet,
        cx: &StageContext<'_>,
    ) -> Result<PhotoFidelity, StageError> {
        let held_out = self.held_out;
        let mut fidelity = PhotoFidelity { held_out, ..PhotoFidelity::default() };
        if taken.is_empty() {
            return Ok(fidelity);
        }
        let style = self.render.resolve(gaussians.antialiased);
        let mut renderer =
            self.backend.renderer(gaussians.clone(), style).map_err(StageError::work_failed("render"))?;
        let held: Vec<usize> = taken.iter().map(|(i, ..)| *i).filter(|i| held_out.holds_out(*i)).collect();
        let pictured: Vec<usize> =
            spread_indices(held.len(), MAX_ROWS).into_iter().map(|k| held[k]).collect();
        for &(i, view, photo) in taken {
            cx.go_on()?;
            let name = view.name.clone();
            match read_photo(view, photo)? {
                Ok(photo) => {
                    let found = compare_view(renderer.as_mut(), view, &photo)
                        .map_err(StageError::work_failed("render"))?;
                    if pictured.contains(&i) {
                        sheet.push(&png::to_bytes(&found.photo), &png::to_bytes(&found.rendering));
                    }
                    let ViewComparison { psnr, ssim, .. } = found;
                    fidelity.views.push(ComparedView { name, psnr, ssim, held_out: held_out.holds_out(i) });
                }
                // A photo that cannot be compared is a result, not a failure of the step.
                Err(because) => fidelity.not_compared.push(NotCompared { name, because }),
            }
        }
        Ok(fidelity)
    }
}

/// The file of a view's photo: sources name it like the view, or by its place among `images`.
fn photo_of<'a>(view: &CapturedView, photos: &'a [SourceFile]) -> Option<&'a SourceFile> {
    photos.iter().find(|photo| {
        let name = photo.name.strip_prefix("images/");
        photo.name == view.name || name == Some(&view.name)
    })
}

type Photo = gs2e_image::Image<[u8; 3]>;

/// The photo of a view, or the problem with it.
fn read_photo(view: &CapturedView, photo: &SourceFile) -> Result<Result<Photo, String>, StageError> {
    let bytes = files::read(&photo.path, files::MAX_PICTURE).map_err(StageError::io_error(&photo.path))?;
    Ok(photo::read_photo(&bytes, view.camera.size).map_err(|because| because.to_string()))
}
