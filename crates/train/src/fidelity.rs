//! Comparison of a scene with the photos of its capture: the scene is rendered from the pose of
//! each photo.
//!
//! The photo is undistorted, because renderings are those of a pinhole camera. The rendering is
//! clipped to 0..1, as images are. Pixels outside the undistorted photo are excluded from PSNR, and
//! made equal for SSIM.
//!
//! Views that the training did not see are *held out*: see [`HeldOutViews`].

pub mod sheet;

use gs2e_image::Image;
use gs2e_image::likeness::{mean_square, psnr_db, ssim};
use gs2e_render::{ChannelSet, RenderError, RenderedImages, Renderer};
use gs2e_scene::camera::view::CameraView;
use gs2e_source as source;
use gs2e_source::undistort::{covered_pixels, undistort_photo};
use serde::{Deserialize, Serialize};

/// Maximum number of compared views.
const MAX_VIEWS: usize = 100;
/// Distance between held-out views by convention.
const HELD_OUT: u32 = 8;

/// The views that the training of a scene did not see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HeldOutViews {
    /// Unknown. By the convention of the official trainer (GitHub
    /// graphdeco-inria/gaussian-splatting, `--eval`), every eighth view from the first counts.
    #[default]
    Unknown,
    /// None: the training saw all views.
    Nothing,
    /// Every n-th view, the first included.
    Every(u32),
}

impl HeldOutViews {
    /// The views that a training with this `hold_out` did not see; 0 holds out none.
    #[must_use]
    pub fn by_training(hold_out: u32) -> Self {
        if hold_out == 0 { Self::Nothing } else { Self::Every(hold_out) }
    }

    /// Returns true if the view at this index, in natural order of the names, is held out.
    #[must_use]
    pub fn holds_out(self, index: usize) -> bool {
        let every = match self {
            Self::Unknown => HELD_OUT,
            Self::Nothing => return false,
            Self::Every(every) => every,
        };
        index.is_multiple_of(every as usize)
    }
}

/// Result of the comparison.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotoFidelity {
    /// The rule by which views are held out.
    pub held_out: HeldOutViews,
    /// Compared views, in natural order of their names.
    pub views: Vec<ComparedView>,
    /// Views that could not be compared.
    pub not_compared: Vec<NotCompared>,
}

/// A compared view and its figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ComparedView {
    /// Name of the view.
    pub name: String,
    /// PSNR, dB.
    pub psnr: f64,
    /// SSIM.
    pub ssim: f64,
    /// True if the view is held out.
    pub held_out: bool,
}

/// A view that could not be compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NotCompared {
    /// Name of the view.
    pub name: String,
    /// The problem with its photo.
    pub because: String,
}

/// Figures over all compared views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PsnrFigures {
    /// Mean PSNR, dB.
    pub mean: f64,
    /// Smallest PSNR, dB.
    pub min: f64,
    /// Number of views.
    pub views: usize,
    /// Mean PSNR of the held-out views, dB; `None` if no view is held out.
    pub held_out: Option<f64>,
}

/// The error for a scene that does not match its photos.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "its mean PSNR over {views} views is {mean:.2} dB, wanted at least {least}; configure the trainer not to move, rotate or \
     scale the world"
)]
pub struct LowFidelity {
    /// Mean PSNR, dB.
    pub mean: f64,
    /// The limit, dB.
    pub least: f64,
    /// Number of compared views.
    pub views: usize,
}

impl PhotoFidelity {
    /// Compares the mean PSNR with a limit, dB.
    ///
    /// # Errors
    /// The mean is below the limit. Without compared views there is no error.
    pub fn hold(&self, least: f64) -> Result<(), LowFidelity> {
        match self.psnr() {
            Some(psnr) if psnr.mean < least => Err(LowFidelity { mean: psnr.mean, least, views: psnr.views }),
            _ => Ok(()),
        }
    }

    /// PSNR over the views; `None` without compared views.
    #[must_use]
    pub fn psnr(&self) -> Option<PsnrFigures> {
        let held_out = self.views.iter().filter(|view| view.held_out).map(|view| view.psnr);
        Some(PsnrFigures {
            mean: mean_value(self.views.iter().map(|view| view.psnr))?,
            min: self.worst()?.psnr,
            views: self.views.len(),
            held_out: mean_value(held_out),
        })
    }

    /// Mean SSIM; `None` without compared views.
    #[must_use]
    pub fn ssim(&self) -> Option<f64> {
        mean_value(self.views.iter().map(|view| view.ssim))
    }

    /// The view with the smallest PSNR.
    #[must_use]
    pub fn worst(&self) -> Option<&ComparedView> {
        self.views.iter().min_by(|a, b| a.psnr.total_cmp(&b.psnr))
    }

    /// The views that the training saw; all of them if it is unknown.
    #[must_use]
    pub fn trained_on(&self) -> Self {
        let is_kept = |view: &&ComparedView| self.held_out == HeldOutViews::Unknown || !view.held_out;
        Self { views: self.views.iter().filter(is_kept).cloned().collect(), ..self.clone() }
    }
}

fn mean_value(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// Indices of the compared photos: all photos if there are at most 100, otherwise 100 of them,
/// evenly spread.
#[must_use]
pub fn picked_indices(count: usize) -> Vec<usize> {
    spread_indices(count, MAX_VIEWS)
}

/// All indices if there are at most `most`, otherwise `most` of them, evenly spread:
/// `round(i (count - 1) / (most - 1))`. `most` is at least 2.
#[must_use]
pub fn spread_indices(count: usize, most: usize) -> Vec<usize> {
    let steps = most - 1;
    if count <= most {
        return (0..count).collect();
    }
    // Rounding to the nearest, in integers.
    (0..most).map(|i| (2 * i * (count - 1) + steps) / (2 * steps)).collect()
}

/// The rendering of a view, compared with its photo.
#[derive(Debug)]
pub struct ViewComparison {
    /// PSNR, dB.
    pub psnr: f64,
    /// SSIM.
    pub ssim: f64,
    /// The undistorted photo, black where the lens shows nothing.
    pub photo: Image<[f32; 3]>,
    /// The rendering, clipped to 0..1, black there too.
    pub rendering: Image<[f32; 3]>,
}

/// Compares the rendering of a view with its photo, which has the size of the view's camera.
///
/// # Errors
/// The view cannot be rendered.
pub fn compare_view(
    renderer: &mut dyn Renderer,
    view: &source::CapturedView,
    photo: &Image<[u8; 3]>,
) -> Result<ViewComparison, RenderError> {
    let mut rendered = RenderedImages::default();
    let want = ChannelSet { rgb: true, ..ChannelSet::default() };
    renderer.render(&CameraView::at_rest(view.camera, view.world_from_camera), want, &mut rendered)?;
    let mut clipped = rendered.rgb.expect("colour was asked for");
    let straight = undistort_photo(photo, &view.camera, &view.lens);
    let colours = straight.pixels().iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
    let mut wanted = Image::from_vec(photo.size(), colours);
    // A channel that is NaN becomes black, as in a file.
    let clip = |v: &mut f32| *v = if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) };
    clipped.pixels_mut().as_flattened_mut().iter_mut().for_each(clip);
    let mut counted = photo.size().pixels();
    if let Some(covered) = covered_pixels(&view.camera, &view.lens) {
        // A lens that covers no pixel leaves nothing to compare, and no error either.
        counted = covered.pixels().iter().filter(|is_covered| **is_covered).count().max(1);
        let pixels = clipped.pixels_mut().iter_mut().zip(wanted.pixels_mut());
        // Equal pixels add no error to the sum.
        for ((clipped, wanted), _) in pixels.zip(covered.pixels()).filter(|(_, is_covered)| !**is_covered) {
            (*clipped, *wanted) = ([0.0; 3], [0.0; 3]);
        }
    }
    // The mean counts pixels outside the photo, which have no error. The factor leaves them out.
    let part = photo.size().pixels() as f64 / counted as f64;
    let [psnr, ssim] = [psnr_db(part * mean_square(&clipped, &wanted)), ssim(&clipped, &wanted)];
    Ok(ViewComparison { psnr, ssim, photo: wanted, rendering: clipped })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use gs2e_image::Size;
    use gs2e_num::se3::Se3;
    use gs2e_render::RenderWork;
    use gs2e_scene::camera::Camera;
    use gs2e_source::LensModel;

    /// A renderer of one colour, for any view.
    struct Wall([f32; 3]);

    impl Renderer for Wall {
        fn fingerprint(&self) -> &'static str {
            "wall"
        }

        fn render(
            &mut self,
            view: &CameraView,
            _: ChannelSet,
            out: &mut RenderedImages,
        ) -> Result<RenderWork, RenderError> {
            out.rgb = Some(Image::filled(view.camera.size, self.0));
            Ok(RenderWork::default())
        }
    }

    const SIZE: Size = Size { width: 40, height: 30 };

    fn view(lens: LensModel) -> source::CapturedView {
        source::CapturedView {
            name: "a.jpg".into(),
            world_from_camera: Se3 { rotation: DQuat::IDENTITY, translation: DVec3::ZERO },
            camera: Camera { size: SIZE, fx: 30.0, fy: 30.0, cx: 20.0, cy: 15.0, lens: None },
            lens,
            sha256: None,
        }
    }

    fn compared(colour: [f32; 3], lens: LensModel, photo: [u8; 3]) -> [f64; 2] {
        let found = compare_view(&mut Wall(colour), &view(lens), &Image::filled(SIZE, photo)).unwrap();
        [found.psnr, found.ssim]
    }

    #[test]
    fn renderings_are_clipped_and_held_against_the_photo() {
        // Above white, and NaN: white and black.
        let [psnr, ssim] = compared([1.6, f32::NAN, -0.5], LensModel::Pinhole, [255, 0, 0]);
        assert!((psnr - 100.0).abs() < 1e-9 && (ssim - 1.0).abs() < 1e-9, "{psnr} {ssim}");
        // One of three channels differs by 51 of 255: a mean square of 0.04 / 3.
        let [psnr, ssim] = compared([0.2, 0.6, 0.6], LensModel::Pinhole, [102, 153, 153]);
        assert!((psnr - 18.750_612).abs() < 1e-4, "{psnr}");
        assert!(ssim < 1.0);
    }

    #[test]
    fn pixels_beyond_the_photo_do_not_count() {
        // The visible part of the border lies outside the photo.
        let lens = LensModel::SimpleRadial { k1: 0.3 };
        let outside = covered_pixels(&view(lens.clone()).camera, &lens).unwrap();
        assert!(outside.pixels().iter().filter(|is_covered| !**is_covered).count() > 100);
        let [psnr, ssim] = compared([1.0; 3], lens.clone(), [255; 3]);
        assert!((psnr - 100.0).abs() < 1e-9 && (ssim - 1.0).abs() < 1e-9, "{psnr} {ssim}");
        // 20 log10(255 / 51), to the rounding of bytes and of 32 bits, as without a lens.
        let [psnr, _] = compared([0.8; 3], lens, [255; 3]);
        assert!((psnr - 13.979_400).abs() < 1e-4, "{psnr}");
    }

    #[test]
    fn views_are_picked_evenly_and_held_out_by_eights() {
        assert_eq!(picked_indices(0), [0usize; 0]);
        assert_eq!(picked_indices(100).len(), 100);
        for count in [101, 250, 3000] {
            let picked = picked_indices(count);
            assert_eq!((picked.len(), picked[0], picked[99]), (100, 0, count - 1));
            assert!(picked.windows(2).all(|w| w[0] < w[1]));
        }
        // 17 (250 - 1) / 99 = 42.76.
        assert_eq!(picked_indices(250)[17], 43);
        let held = |by: HeldOutViews| (0..20).filter(|i| by.holds_out(*i)).collect::<Vec<usize>>();
        assert_eq!(held(HeldOutViews::Unknown), [0, 8, 16]);
        assert_eq!(held(HeldOutViews::by_training(6)), [0, 6, 12, 18]);
        assert_eq!(held(HeldOutViews::by_training(0)), [0; 0]);
    }

    #[test]
    fn figures_are_over_all_views_and_over_those_held_out() {
        let view =
            |name: &str, psnr, ssim, held_out| ComparedView { name: name.into(), psnr, ssim, held_out };
        let views = vec![view("a", 30.0, 0.9, true), view("b", 20.0, 0.5, false), view("c", 26.0, 0.7, true)];
        let mut fidelity = PhotoFidelity { views, ..PhotoFidelity::default() };
        let psnr = fidelity.psnr().unwrap();
        assert!((psnr.mean - 76.0 / 3.0).abs() < 1e-12 && (psnr.min - 20.0).abs() < 1e-12);
        assert!((psnr.held_out.unwrap() - 28.0).abs() < 1e-12 && psnr.views == 3);
        assert!((fidelity.ssim().unwrap() - 0.7).abs() < 1e-12);
        assert_eq!(fidelity.worst().unwrap().name, "b");
        assert_eq!(fidelity.trained_on(), fidelity);
        fidelity.held_out = HeldOutViews::Every(2);
        assert_eq!(fidelity.trained_on().views, fidelity.views[1..2]);
        assert_eq!(PhotoFidelity::default().psnr(), None);
    }
}
