//! The cost of rendering: time of all cores, elapsed time, and peak memory.

use super::interrupted_problem;
use super::not_rendered;
use crate::cli::problem::VerbError;
use crate::files;
use crate::image::{Image, luminance};
use crate::render::{CameraView, ChannelSet, RenderWork, RenderedImages, Renderer};
use crate::study::work_precision::{FrameCost, TimeSpent};
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

/// The time that this process has spent so far.
pub(super) fn process_time() -> TimeSpent {
    let seconds = |at: Timespec| at.tv_sec as f64 + at.tv_nsec as f64 * 1e-9;
    let [core_s, wall_s] = [ClockId::ProcessCPUTime, ClockId::Monotonic].map(|id| seconds(clock_gettime(id)));
    TimeSpent { core_s, wall_s }
}

/// The cost of a kind of frames, and the luminance of the frames that were kept.
pub(super) type Measured = (FrameCost, Vec<Image<f32>>);

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
    tap: &dyn Fn() -> ControlFlow<()>,
) -> Result<Vec<Measured>, VerbError> {
    let mut kinds: Vec<CostKind> = Vec::new();
    for want in sampling.kinds {
        kinds.push(CostKind::render_once(renderer, views, (*want, sampling.keep), tap)?);
    }
    for _ in 0..sampling.rounds {
        kinds.iter_mut().try_for_each(|kind| kind.again(renderer, views, tap))?;
    }
    Ok(kinds.into_iter().map(|kind| (kind.cost(), kind.kept)).collect())
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
        (want, keep): (ChannelSet, usize),
        tap: &dyn Fn() -> ControlFlow<()>,
    ) -> Result<Self, VerbError> {
        let (rendered, least, kept) = (RenderedImages::default(), Vec::new(), Vec::new());
        let mut kind = Self { want, rendered, least, blended: 0, peak_mb: None, kept };
        forget_peak();
        for (number, view) in views.iter().enumerate() {
            let (took, work) = kind.render(renderer, view, tap)?;
            kind.least.push(took);
            kind.blended += work.blended;
            if kept_at(views.len(), keep).any(|at| at == number) {
                kind.kept.push(luminance_of(&kind.rendered));
            }
        }
        kind.peak_mb = peak_mb();
        Ok(kind)
    }

    fn again(
        &mut self,
        renderer: &mut dyn Renderer,
        views: &[CameraView],
        tap: &dyn Fn() -> ControlFlow<()>,
    ) -> Result<(), VerbError> {
        for (number, view) in views.iter().enumerate() {
            let (took, _) = self.render(renderer, view, tap)?;
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
        tap: &dyn Fn() -> ControlFlow<()>,
    ) -> Result<(TimeSpent, RenderWork), VerbError> {
        let before = process_time();
        // The announcement starts work on a GPU, so it is part of the time.
        renderer.expect(view, self.want);
        let work = renderer.render(view, self.want, &mut self.rendered).map_err(|e| not_rendered(&e))?;
        let took = process_time() - before;
        if tap().is_break() { Err(interrupted_problem()) } else { Ok((took, work)) }
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

/// Resets the peak memory of this process. Where the system cannot do it, the peak stays that of
/// the whole run.
fn forget_peak() {
    // 5 resets the peak of the resident memory, and nothing else (proc(5)).
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// Peak memory of this process, MB.
fn peak_mb() -> Option<f64> {
    let text = files::read_text(Path::new("/proc/self/status"), files::MAX_TEXT).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    // `/proc` states KiB.
    Some(line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()? * 1024e-6)
}
