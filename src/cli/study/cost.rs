//! What rendering costs: time of all cores, time on the wall, and memory at its peak.

use super::interrupted;
use super::not_rendered;
use crate::cli::problem::Problem;
use crate::image::{Image, luminance};
use crate::render::{Channels, Rendered, Renderer, View};
use crate::study::work_precision::{Cost, Spent};
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::fs;
use std::ops::ControlFlow;

/// What this process has spent so far.
pub(super) fn spent() -> Spent {
    let seconds = |at: Timespec| at.tv_sec as f64 + at.tv_nsec as f64 * 1e-9;
    let [core_s, wall_s] = [ClockId::ProcessCPUTime, ClockId::Monotonic].map(|id| seconds(clock_gettime(id)));
    Spent { core_s, wall_s }
}

/// Times that each view is rendered: what disturbs one of them is left out.
const ROUNDS: usize = 2;

/// Renders each view for its cost, and keeps the luminance of `keep` of them, evenly spread. The first is rendered once
/// more before, since it pays for what all share.
pub(super) fn measure(
    renderer: &mut dyn Renderer,
    views: &[View],
    (want, keep): (Channels, usize),
    tap: &dyn Fn() -> ControlFlow<()>,
) -> Result<(Cost, Vec<Image<f32>>), Problem> {
    let mut rendered = Rendered::default();
    let (mut total, mut blended, mut kept) = (Spent::default(), 0, Vec::new());
    forget_peak();
    for (number, view) in views.iter().enumerate() {
        let mut least: Option<Spent> = None;
        for round in 0..ROUNDS + usize::from(number == 0) {
            let before = spent();
            renderer.expect(view, want);
            let work = renderer.render(view, want, &mut rendered).map_err(|e| not_rendered(&e))?;
            let took = spent() - before;
            if round == 0 {
                blended += work.blended;
            }
            if number > 0 || round > 0 {
                least = Some(least.filter(|least| least.core_s <= took.core_s).unwrap_or(took));
            }
        }
        total += least.unwrap_or_default();
        if kept_at(views.len(), keep).any(|at| at == number) {
            kept.push(luminance_of(&rendered));
        }
        if tap().is_break() {
            return Err(interrupted());
        }
    }
    let each = 1.0 / views.len().max(1) as f64;
    let cost =
        Cost { frame: total * each, pairs: blended as f64 * each, peak_mb: peak_mb(), sample: views.len() };
    Ok((cost, kept))
}

/// Which of `views` are kept.
pub(super) fn kept_at(views: usize, keep: usize) -> impl Iterator<Item = usize> {
    let keep = keep.min(views);
    (0..keep).map(move |k| (2 * k + 1) * views / (2 * keep))
}

fn luminance_of(rendered: &Rendered) -> Image<f32> {
    match (&rendered.luminance, &rendered.rgb) {
        (Some(image), _) => image.clone(),
        (None, Some(rgb)) => {
            Image::from_vec(rgb.size(), rgb.pixels().iter().map(|c| luminance(*c)).collect())
        }
        (None, None) => unreachable!("one of both is asked for"),
    }
}

/// From now on the peak is that of what follows; where the system cannot do it, the whole program's.
fn forget_peak() {
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// Memory of this process at its peak, MB.
fn peak_mb() -> Option<f64> {
    let text = fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()? * 1024e-6)
}
