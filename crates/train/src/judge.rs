//! Held-out views: renderings against the photos that the training does not see.

use super::TrainingError;
use super::loss::TrainingPhoto;
use super::photos::TrainingView;
use super::record::HeldOutView;
use super::renderer::TrainingRenderer;
use gs2e_image::Image;
use gs2e_image::likeness::{mean_square, psnr_db, ssim};

/// Mean PSNR of views, dB; `None` without views.
pub(super) fn mean_psnr(
    renderer: &mut TrainingRenderer,
    views: &[TrainingView],
) -> Result<Option<f64>, TrainingError> {
    let mut sum = 0.0;
    for view in views {
        sum += PicturePair::new(renderer, view)?.psnr();
    }
    Ok((!views.is_empty()).then(|| sum / views.len() as f64))
}

/// PSNR and SSIM of every view.
pub(super) fn held_out_figures(
    renderer: &mut TrainingRenderer,
    views: &[TrainingView],
) -> Result<Vec<HeldOutView>, TrainingError> {
    let mut figures = Vec::with_capacity(views.len());
    for view in views {
        let pair = PicturePair::new(renderer, view)?;
        let (psnr, ssim) = (pair.psnr(), ssim(&pair.rendering, &pair.wanted));
        figures.push(HeldOutView { name: view.name.clone(), psnr, ssim });
    }
    Ok(figures)
}

/// The rendering of a view, clipped to 0..1, and its photo; both are black where the photo does not
/// count.
struct PicturePair {
    rendering: Image<[f32; 3]>,
    wanted: Image<[f32; 3]>,
    /// Number of all pixels per pixel that counts.
    part: f64,
}

impl PicturePair {
    fn new(renderer: &mut TrainingRenderer, view: &TrainingView) -> Result<Self, TrainingError> {
        let (at, TrainingPhoto { colours, counted }) = view.at_level(0);
        let rendered = renderer.render(&at);
        let failed = |cause| TrainingError::Render { view: view.name.clone(), cause };
        let mut rendering = rendered.map_err(failed)?.0.clone();
        let clip = |v: &mut f32| *v = if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) };
        rendering.pixels_mut().as_flattened_mut().iter_mut().for_each(clip);
        let wanted = colours.pixels().iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
        let mut wanted = Image::from_vec(colours.size(), wanted);
        let mut pixels = colours.size().pixels();
        if let Some(counted) = counted {
            pixels = counted.pixels().iter().filter(|counted| **counted).count().max(1);
            let both = rendering.pixels_mut().iter_mut().zip(wanted.pixels_mut());
            for ((rendering, wanted), _) in both.zip(counted.pixels()).filter(|(_, counted)| !**counted) {
                (*rendering, *wanted) = ([0.0; 3], [0.0; 3]);
            }
        }
        Ok(Self { rendering, wanted, part: colours.size().pixels() as f64 / pixels as f64 })
    }

    /// PSNR over the pixels that count, dB.
    fn psnr(&self) -> f64 {
        psnr_db(self.part * mean_square(&self.rendering, &self.wanted))
    }
}
