//! Frames a second, and time and work by stage.

use crate::model::{CARDS, Card};
use crate::views::BenchViews;
use gs2e_gpu::{FrameWork, GpuDevice, GpuRenderer, TimedStage};
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use std::time::Instant;

/// Views that are announced before the first is read, as a build does.
const AHEAD: usize = 2;
const STAGES: usize = TimedStage::ALL.len();

pub(super) fn style(rules: RenderRules) -> RenderStyle {
    RenderStyle { rules, order: LayerOrder::Depth, antialiased: false, background: [0.0; 3] }
}

/// Means over the frames of a run.
struct RateFound {
    /// Of the wall clock, s.
    frame: f64,
    /// By the device's clock, s.
    stages: Option<[f64; STAGES]>,
    work: FrameWork,
}

pub(super) fn measure(device: &GpuDevice, bench: &BenchViews, frames: usize) -> Result<(), String> {
    let rgb = ChannelSet { rgb: true, ..ChannelSet::NONE };
    let luminance = ChannelSet { luminance: true, ..ChannelSet::NONE };
    let rate = ChannelSet { luminance_rate: true, ..luminance };
    let cases = [
        ("rgb, rules gsplat", RenderRules::Gsplat, rgb),
        ("rgb", RenderRules::Official, rgb),
        ("luminance", RenderRules::Official, luminance),
        ("luminance and rate", RenderRules::Official, rate),
        ("rgb and luminance", RenderRules::Official, ChannelSet { rgb: true, ..luminance }),
    ];
    let (size, count) = (bench.views[0].camera.size, bench.scene.len());
    println!(
        "{}: {count} Gaussians, {size}, {} views, {frames} frames a case\n",
        bench.name,
        bench.views.len()
    );
    let cards = CARDS.map(|card| format!(" {}, predicted |", card.name)).concat();
    println!("| channels | frames/s | ms a frame |{cards}\n|---|---|---|---|---|");
    let mut all = Vec::new();
    for (name, rules, want) in cases {
        let found = run(device, bench, (rules, want), frames)?;
        let predicted =
            CARDS.map(|card| format!(" {:.3} ms |", 1e3 * card.frame_seconds(&found.work))).concat();
        println!("| {name} | {:.1} | {:.3} |{predicted}", 1.0 / found.frame, 1e3 * found.frame);
        all.push((name, found));
    }
    all.iter().for_each(|(name, found)| found.print(name, device.name()));
    Ok(())
}

fn run(
    device: &GpuDevice,
    bench: &BenchViews,
    (rules, want): (RenderRules, ChannelSet),
    frames: usize,
) -> Result<RateFound, String> {
    let failed = |e: gs2e_render::RenderError| e.to_string();
    let mut gpu = GpuRenderer::new(device.clone(), &bench.scene, style(rules)).map_err(failed)?;
    let mut out = RenderedImages::default();
    let view = |frame: usize| &bench.views[frame % bench.views.len()];
    // The first round raises the capacities.
    for view in bench.views.iter().take(frames) {
        gpu.render(view, want, &mut out).map_err(failed)?;
    }
    let (mut stages, mut work) = ([0.0; STAGES], FrameWork::default());
    let mut has_clock = true;
    (0..AHEAD.min(frames)).for_each(|frame| gpu.expect(view(frame), want));
    let start = Instant::now();
    for frame in 0..frames {
        if frame + AHEAD < frames {
            gpu.expect(view(frame + AHEAD), want);
        }
        gpu.render(view(frame), want, &mut out).map_err(failed)?;
        match gpu.times() {
            None => has_clock = false,
            Some(times) => stages.iter_mut().zip(times).for_each(|(sum, time)| *sum += time.as_secs_f64()),
        }
        work.add(&gpu.frame_work());
    }
    let frame = start.elapsed().as_secs_f64() / frames as f64;
    let stages = has_clock.then(|| stages.map(|sum| sum / frames as f64));
    Ok(RateFound { frame, stages, work: mean(&work, frames as u64) })
}

/// Mean work of a frame.
fn mean(sum: &FrameWork, frames: u64) -> FrameWork {
    let mut mean = *sum;
    let counts = [&mut mean.splats, &mut mean.pairs, &mut mean.loaded, &mut mean.blended, &mut mean.transfer];
    counts.into_iter().for_each(|count| *count /= frames);
    for stage in &mut mean.stages {
        let counts = [&mut stage.dispatches, &mut stage.scan_rounds, &mut stage.bytes, &mut stage.operations];
        counts.into_iter().for_each(|count| *count /= frames);
    }
    mean
}

impl RateFound {
    /// The table by stage.
    fn print(&self, name: &str, device: &str) {
        let FrameWork { splats, pairs, loaded, blended, transfer, .. } = self.work;
        println!(
            "\n{name}: {splats} splats, {pairs} pairs, {loaded} of them loaded, {blended} layers blended, {:.1} MB read by \
             the host",
            transfer as f64 * 1e-6
        );
        let cards = CARDS.map(|card| format!(" {} |", card.name)).concat();
        println!(
            "| stage | dispatches | scan rounds | MB | Mop | measured | GB/s |{cards}\n|---|---|---|---|---|---|---|---|---|"
        );
        for stage in TimedStage::ALL {
            let work = &self.work.stages[stage as usize];
            let seconds = self.stages.map(|stages| stages[stage as usize]);
            let measured = seconds.map_or("no clock".to_owned(), |s| format!("{:.3} ms", 1e3 * s));
            let achieved = seconds.filter(|s| *s > 0.0).map_or("-".to_owned(), |s| {
                let rate = work.bytes as f64 / s;
                let share =
                    Card::named(device).map(|card| format!(", {:.0} %", 100.0 * rate / card.bandwidth));
                format!("{:.2}{}", 1e-9 * rate, share.unwrap_or_default())
            });
            let predicted = CARDS.map(|card| format!(" {:.3} ms |", 1e3 * card.stage_seconds(work))).concat();
            println!(
                "| {} | {} | {} | {:.1} | {:.0} | {measured} | {achieved} |{predicted}",
                stage.name(),
                work.dispatches,
                work.scan_rounds,
                work.bytes as f64 * 1e-6,
                work.operations as f64 * 1e-6
            );
        }
    }
}
