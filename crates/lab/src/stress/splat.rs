//! The renderers at the edges of their arithmetic: needles, giants, stacks, ties, values that are
//! not finite, and whole pictures.

mod counting;
mod needles;
mod pictures;
mod sameness;
pub mod scenes;

pub use needles::judge_needles;

use super::{NotRun, Outcome, StressArea, StressCase};
use gs2e_render::backend::Backend;
use gs2e_render::reference::ReferenceRenderer;
use gs2e_render::{ChannelSet, RenderError, RenderStyle, RenderWork, RenderedImages};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;

/// The back ends and scenes for the cases of the renderers.
#[derive(Debug, Default)]
pub struct SplatBench {
    /// The back ends by name, or the reason why one is absent.
    pub backends: Vec<(&'static str, Result<Backend, NotRun>)>,
    /// A scene of the user, in addition to the embedded one.
    pub scene: Option<Arc<Gaussians>>,
}

/// Precision of a back end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FloatPrecision {
    /// 32 bits.
    Single,
    /// 64 bits.
    Double,
}

/// A renderer as used by cases.
#[derive(Debug, Clone, Copy)]
struct CaseRenderer<'a>(&'a Backend);

impl CaseRenderer<'_> {
    fn precision(self) -> FloatPrecision {
        match self.0 {
            Backend::Reference => FloatPrecision::Double,
            Backend::Cpu | Backend::Gpu(_) | Backend::Unopened(_) => FloatPrecision::Single,
        }
    }

    /// Selects scenes that this renderer can draw in seconds: a GPU takes a tenth of a second to
    /// set up a scene. Shapes that come in groups of five still occur in every direction.
    fn some<T>(self, all: Vec<T>) -> impl Iterator<Item = T> {
        all.into_iter().step_by(if self.0.takes_gpu() { 3 } else { 1 })
    }

    /// Renders one picture.
    fn picture(
        self,
        scene: &Arc<Gaussians>,
        style: RenderStyle,
        view: &CameraView,
        want: ChannelSet,
    ) -> Result<(RenderedImages, RenderWork), NotRun> {
        let mut out = RenderedImages::default();
        let work = self.0.renderer(scene.clone(), style).and_then(|mut r| r.render(view, want, &mut out));
        Ok((out, work.map_err(not_run)?))
    }
}

/// A GPU may be out of memory or lost. The scenes and views of cases are valid.
fn not_run(error: RenderError) -> NotRun {
    match error {
        RenderError::Gpu(error) => NotRun(error.to_string()),
        other => panic!("a case is rendered: {other}"),
    }
}

/// Luminance and rate of every pixel, by the reference in 64 bits.
fn exact_luminance(scene: &Arc<Gaussians>, style: RenderStyle, view: &CameraView) -> Vec<[f64; 2]> {
    let reference =
        ReferenceRenderer::new(scene.clone(), style).and_then(|reference| reference.luminance(view));
    reference.unwrap_or_else(|e| panic!("a case is rendered: {e}"))
}

/// Opacity of every pixel.
fn pixel_opacities(image: &RenderedImages) -> Vec<f64> {
    let plane = image.alpha.iter().flat_map(|plane| plane.pixels());
    plane.map(|&alpha| f64::from(alpha)).collect()
}

/// Every value of every image as bits, so that NaN equals itself.
fn image_bits(image: &RenderedImages) -> Vec<u32> {
    let planes = [&image.luminance, &image.alpha, &image.depth, &image.doubtful];
    let grey = planes.into_iter().flatten().flat_map(|plane| plane.pixels().iter());
    let colour = image.rgb.iter().flat_map(|plane| plane.pixels().as_flattened());
    grey.chain(colour).map(|v| v.to_bits()).collect()
}

type Run = fn(&SplatBench, CaseRenderer<'_>) -> Outcome;

/// All cases of each back end.
#[must_use]
pub(crate) fn splat_cases(stage: &SplatBench) -> Vec<StressCase<'_>> {
    let of = |(name, backend): &'_ (&'static str, Result<Backend, NotRun>)| {
        let precision =
            backend.as_ref().map_or(FloatPrecision::Single, |backend| CaseRenderer(backend).precision());
        let table = case_table(precision, stage.scene.is_some());
        let cases = table.into_iter().map(|(words, run)| make_case(stage, name, backend.clone(), words, run));
        cases.collect::<Vec<_>>()
    };
    stage.backends.iter().flat_map(of).collect()
}

fn make_case<'a>(
    stage: &'a SplatBench,
    name: &'static str,
    backend: Result<Backend, NotRun>,
    words: [&'static str; 3],
    run: Run,
) -> StressCase<'a> {
    let run = move || run(stage, CaseRenderer(backend.as_ref().map_err(Clone::clone)?));
    let [case, regime, unit] = words;
    StressCase { area: StressArea::Splat, name: case, regime, unit, backend: Some(name), run: Box::new(run) }
}

/// The cases of a back end with this precision.
fn case_table(precision: FloatPrecision, own_scene: bool) -> Vec<([&'static str; 3], Run)> {
    let mut table: Vec<([&'static str; 3], Run)> = vec![
        (["needles", "aspect 10 .. 1e6, long axis 10 .. 30,000 px; near the mean", "power"], |_, by| {
            needles::near_case(by)
        }),
        (["needles-from-afar", "long axis 300, 1000, 3000 px, half of it away; 99 %", "alpha"], |_, by| {
            needles::far_case(by)
        }),
        (["needles-undilated", "the determinants' ratio with and without d = .3", "rel"], |_, by| {
            needles::undilated_case(by)
        }),
        (["world-offset", "0, 1e2, 1e4, 1e6, where sums are exact", "values"], |_, by| {
            sameness::offset_case(by)
        }),
        (["world-offset-px", "1e2, 1e4, 1e6, where sums are rounded: position of a blob", "px"], |_, by| {
            sameness::offset_px(by)
        }),
        (["opaque-stack", "1,000 layers of alpha .004 .. .99999; layers, stops", "1"], |_, by| {
            counting::stack_case(by)
        }),
        (["ties", "equal depths, 1 .. 7 threads, in the order of the file", "values"], |_, by| {
            sameness::ties_case(by)
        }),
        (["no-numbers", "NaN, infinite, overflowing: same as without that Gaussian", "values"], |_, by| {
            sameness::unsound_case(by)
        }),
        (["quaternions", "scaled by 2^-20 .. 2^20, and zero", "values"], |_, by| {
            sameness::quaternion_case(by)
        }),
        (["counted", "giant, behind, faint, sigma_z/z .09 .. .5", "Gaussians"], |_, by| {
            counting::counted_case(by)
        }),
        (["near-plane", "z = .2 (gsplat .01) +- 1 ulp, 0, -1", "Gaussians"], |_, by| {
            counting::near_plane(by)
        }),
    ];
    table.extend(picture_cases(precision));
    if own_scene {
        table.extend(user_scene_pictures(precision));
    }
    table
}

/// The cases on the embedded scene.
fn picture_cases(precision: FloatPrecision) -> Vec<([&'static str; 3], Run)> {
    let grey = ["luminance-path", "one channel in place of three", "1"];
    let mut table: Vec<([&'static str; 3], Run)> =
        vec![(grey, |_, by| pictures::luminance_case(&pictures::embedded_setup(), by))];
    if precision == FloatPrecision::Single {
        let value = ["picture", "still life, 32 bits against 64: 99 % of values, and the rest", "1"];
        let rate = ["luminance-rate", "dL/dt in 32 bits against 64, 99 % of pixels", "of largest"];
        table.push((value, |_, by| pictures::value_case(&pictures::embedded_setup(), by)));
        table.push((rate, |_, by| pictures::rate_case(&pictures::embedded_setup(), by)));
    } else {
        let rate = ["luminance-rate", "dL/dt against differences, where nothing jumps", "of largest"];
        let jumps = ["luminance-jumps", "pixels in which something jumps within 0.2 us", "of all"];
        table.push((rate, |_, _| Ok(pictures::rate_by_differences(&pictures::embedded_setup()))));
        table.push((jumps, |_, _| Ok(pictures::jump_case(&pictures::embedded_setup()))));
    }
    table
}

/// The cases on the user's scene.
fn user_scene_pictures(precision: FloatPrecision) -> Vec<([&'static str; 3], Run)> {
    let grey = ["own-luminance-path", "the scene given: one channel in place of three", "1"];
    let mut table: Vec<([&'static str; 3], Run)> =
        vec![(grey, |stage, by| pictures::luminance_case(&pictures::user_setup(stage), by))];
    if precision == FloatPrecision::Single {
        let value = ["own-picture", "the scene given, 32 bits against 64: 99 %, and the rest", "1"];
        let rate = ["own-luminance-rate", "dL/dt in 32 bits against 64, 99 % of pixels", "of largest"];
        table.push((value, |stage, by| pictures::value_case(&pictures::user_setup(stage), by)));
        table.push((rate, |stage, by| pictures::rate_case(&pictures::user_setup(stage), by)));
    } else {
        let rate = ["own-luminance-rate", "dL/dt against differences, where nothing jumps", "of largest"];
        let jumps = ["own-luminance-jumps", "pixels in which something jumps within 0.2 us", "of all"];
        table.push((rate, |stage, _| Ok(pictures::rate_by_differences(&pictures::user_setup(stage)))));
        table.push((jumps, |stage, _| Ok(pictures::jump_case(&pictures::user_setup(stage)))));
    }
    table
}
