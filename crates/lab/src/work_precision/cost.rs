//! The cost of rendering: time of all cores, elapsed time, and peak memory.

use super::lab::LabError;
use super::{FrameCost, TimeSpent};
use gs2e_image::{Image, luminance};
use gs2e_render::{ChannelSet, RenderWork, RenderedImages, Renderer};
use gs2e_scene::camera::view::CameraView;
use std::ops::ControlFlow;

/// Readings of this process. They come from outside, because a study reads no clock.
pub trait ProcessMeter {
    /// The time that the process has spent so far.
    fn time(&self) -> TimeSpent;

    /// Resets the peak memory. Where the system cannot do it, the peak stays that of the whole run.
    fn forget_peak(&self);

    /// Peak memory since the last reset, MB; `None` if the system does not state it.
    fn peak_mb(&self) -> Option<f64>;
}

/// The cost of a kind of frames, and the luminance of the frames that were kept.
pub(super) type KindCost = (FrameCost, Vec<Image<f32>>);

/// The frames to render of each view.
pub(super) struct CostSampling<'a> {
    /// The kinds of frames whose costs are compared.
    pub(super) kinds: &'a [ChannelSet],
    /// Number of pictures to keep of each kind, evenly spread.
    pub(super) keep: usize,
    /// Number of times that each view is rendered again for its time alone. The least time counts:
    /// it leaves out disturbances, and the work that the first frame does for all.
    pub(super) rounds: usize,
}

/// Renders each view for its cost, and keeps the luminance of some views, for each kind of frames.
///
/// Rounds are interleaved, kind by kind, so that a machine that is busy for a while slows all kinds
/// and not one.
pub(super) fn measure_views(
    renderer: &mut dyn Renderer,
    views: &[CameraView],
    sampling: &CostSampling<'_>,
    taps: Taps<'_>,
) -> Result<Vec<KindCost>, LabError> {
    let mut kinds: Vec<CostKind> = Vec::new();
    for want in sampling.kinds {
        kinds.push(CostKind::render_once(renderer, views, *want, sampling.keep, taps)?);
    }
    for _ in 0..sampling.rounds {
        kinds.iter_mut().try_for_each(|kind| kind.repeat(renderer, views, taps))?;
    }
    Ok(kinds.into_iter().map(|kind| (kind.cost(), kind.kept)).collect())
}

/// Readings of the process, and the way to stop.
#[derive(Clone, Copy)]
pub(super) struct Taps<'a> {
    pub(super) meter: &'a dyn ProcessMeter,
    pub(super) go_on: &'a dyn Fn() -> ControlFlow<()>,
}

/// One kind of frames.
struct CostKind {
    want: ChannelSet,
    rendered: RenderedImages,
    /// The least time of each view.
    least: Vec<TimeSpent>,
    /// Number of pairs in all views.
    blended: u64,
    peak_mb: Option<f64>,
    kept: Vec<Image<f32>>,
}

impl CostKind {
    /// Renders all views once.
    fn render_once(
        renderer: &mut dyn Renderer,
        views: &[CameraView],
        want: ChannelSet,
        keep: usize,
        taps: Taps<'_>,
    ) -> Result<Self, LabError> {
        let (rendered, least, kept) = (RenderedImages::default(), Vec::new(), Vec::new());
        let mut kind = Self { want, rendered, least, blended: 0, peak_mb: None, kept };
        taps.meter.forget_peak();
        for (number, view) in views.iter().enumerate() {
            let (took, work) = kind.render(renderer, view, taps)?;
            kind.least.push(took);
            kind.blended += work.blended;
            if kept_at(views.len(), keep).any(|at| at == number) {
                kind.kept.push(luminance_of(&kind.rendered));
            }
        }
        kind.peak_mb = taps.meter.peak_mb();
        Ok(kind)
    }

    fn repeat(
        &mut self,
        renderer: &mut dyn Renderer,
        views: &[CameraView],
        taps: Taps<'_>,
    ) -> Result<(), LabError> {
        for (number, view) in views.iter().enumerate() {
            let (took, _) = self.render(renderer, view, taps)?;
            // Core time decides, because elapsed time also depends on other processes.
            if took.core_s < self.least[number].core_s {
                self.least[number] = took;
            }
        }
        Ok(())
    }

    fn render(
        &mut self,
        renderer: &mut dyn Renderer,
        view: &CameraView,
        taps: Taps<'_>,
    ) -> Result<(TimeSpent, RenderWork), LabError> {
        let before = taps.meter.time();
        // The announcement starts work on a GPU, so it is part of the time.
        renderer.expect(view, self.want);
        let work = renderer.render(view, self.want, &mut self.rendered)?;
        let took = taps.meter.time() - before;
        if (taps.go_on)().is_break() { Err(LabError::Interrupted) } else { Ok((took, work)) }
    }

    fn cost(&self) -> FrameCost {
        let sample = self.least.len();
        let each = 1.0 / sample.max(1) as f64;
        let mut total = TimeSpent::default();
        self.least.iter().for_each(|least| total += *least);
        FrameCost { frame: total * each, pairs: self.blended as f64 * each, peak_mb: self.peak_mb, sample }
    }
}

/// The indices of the views that are kept: `keep` of `views`, each in the middle of its share.
pub(super) fn kept_at(views: usize, keep: usize) -> impl Iterator<Item = usize> {
    let keep = keep.min(views);
    (0..keep).map(move |k| (2 * k + 1) * views / (2 * keep))
}

fn luminance_of(rendered: &RenderedImages) -> Image<f32> {
    match (&rendered.luminance, &rendered.rgb) {
        (Some(image), _) => image.clone(),
        (None, Some(rgb)) => {
            Image::from_vec(rgb.size(), rgb.pixels().iter().map(|c| luminance(*c)).collect())
        }
        (None, None) => unreachable!("one of both is asked for"),
    }
}
