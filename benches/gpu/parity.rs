//! Likeness of the GPU's pictures and events to those of the CPU.

use crate::rates::style;
use crate::views::BenchViews;
use gs2e_demo::{StillLife, still_capture, still_life};
use gs2e_event::Event;
use gs2e_gpu::{GpuDevice, GpuRenderer};
use gs2e_image::{Size, likeness};
use gs2e_num::se3::Se3;
use gs2e_num::seed::Seed;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, RenderRules, RenderedImages, Renderer};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_sensor::simulate_one;
use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use gs2e_trajectory::Trajectory;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Views that are compared.
const VIEWS: usize = 4;

pub(super) fn measure(device: &GpuDevice, bench: &BenchViews) -> Result<(), String> {
    println!("\nlikeness to the CPU\n");
    println!(
        "| pictures | PSNR rgb | largest error, rgb | luminance | rate, of the largest |\n|---|---|---|---|---|"
    );
    for (name, rules) in [
        ("official", RenderRules::Official),
        ("exact", RenderRules::Exact),
        ("gsplat", RenderRules::Gsplat),
        ("soft", RenderRules::Soft),
    ] {
        pictures(device, bench, name, rules)?;
    }
    events(device)
}

fn pictures(device: &GpuDevice, bench: &BenchViews, name: &str, rules: RenderRules) -> Result<(), String> {
    let failed = |e: gs2e_render::RenderError| e.to_string();
    let want = ChannelSet { rgb: true, luminance: true, luminance_rate: true, ..ChannelSet::NONE };
    let mut gpu = GpuRenderer::new(device.clone(), &bench.scene, style(rules)).map_err(failed)?;
    let mut cpu = CpuRenderer::new(bench.scene.clone(), style(rules)).map_err(failed)?;
    let (mut square, mut largest) = (0.0, [0.0_f32; 3]);
    let views = &bench.views[..VIEWS.min(bench.views.len())];
    for view in views {
        let [mut a, mut b] = [RenderedImages::default(), RenderedImages::default()];
        gpu.render(view, want, &mut a).map_err(failed)?;
        cpu.render(view, want, &mut b).map_err(failed)?;
        let missing = "an image is missing";
        let (rgb_a, rgb_b) = a.rgb.as_ref().zip(b.rgb.as_ref()).ok_or(missing)?;
        square += likeness::mean_square(rgb_a, rgb_b) / views.len() as f64;
        largest[0] = largest[0].max(apart(rgb_a.pixels().as_flattened(), rgb_b.pixels().as_flattened()));
        let (a_grey, b_grey) = a.luminance.as_ref().zip(b.luminance.as_ref()).ok_or(missing)?;
        largest[1] = largest[1].max(apart(a_grey.pixels(), b_grey.pixels()));
        let (a_rate, b_rate) = a.luminance_rate.as_ref().zip(b.luminance_rate.as_ref()).ok_or(missing)?;
        let scale = b_rate.pixels().iter().fold(f32::MIN_POSITIVE, |m, v| m.max(v.abs()));
        largest[2] = largest[2].max(apart(a_rate.pixels(), b_rate.pixels()) / scale);
    }
    let [rgb, grey, rate] = largest;
    println!(
        "| {}, {name} | {:.1} dB | {rgb:.1e} | {grey:.1e} | {rate:.1e} |",
        bench.name,
        likeness::psnr_db(square)
    );
    Ok(())
}

/// Largest difference of two images.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

const SIZE: Size = Size { width: 240, height: 180 };
const FRAMES: u32 = 80;
/// Time between frames, us.
const STEP_US: i64 = 417;

/// Events of a still life, with the noise of one seed, by pixel and polarity, in order of time, ns.
type Events = BTreeMap<(u16, u16, bool), Vec<i64>>;

fn events(device: &GpuDevice) -> Result<(), String> {
    let life = StillLife { gaussians: 2000, views: 6, arc: 40.0, seed: 1, fountain: None };
    let scene = Arc::new(still_life(&life));
    let failed = |e: gs2e_render::RenderError| e.to_string();
    let official = style(RenderRules::Official);
    let gpu = GpuRenderer::new(device.clone(), &scene, official).map_err(failed)?;
    let by_gpu = sensed(Box::new(gpu), &life)?;
    let by_cpu = sensed(Box::new(CpuRenderer::new(scene, official).map_err(failed)?), &life)?;
    let count = |events: &Events| events.values().map(Vec::len).sum::<usize>();
    let mut gaps: Vec<i64> =
        by_cpu.iter().flat_map(|(at, cpu)| matched(cpu, by_gpu.get(at).map_or(&[], Vec::as_slice))).collect();
    gaps.sort_unstable();
    let at = |share: usize| gaps.get((gaps.len() * share / 1000).min(gaps.len().saturating_sub(1))).copied();
    let gap = |share: usize| at(share).map_or("-".to_owned(), |ns| format!("{ns} ns"));
    let common = 100.0 * gaps.len() as f64 / count(&by_cpu).max(1) as f64;
    println!(
        "\n| events | GPU | CPU | in common | apart, median | 99 % | 99.9 % | largest |\n|---|---|---|---|---|---|---|---|"
    );
    println!(
        "| still life, {SIZE}, {FRAMES} frames | {} | {} | {common:.3} % | {} | {} | {} | {} |",
        count(&by_gpu),
        count(&by_cpu),
        gap(500),
        gap(990),
        gap(999),
        gap(1000)
    );
    Ok(())
}

/// Times between the events of one pixel and polarity that both streams have: neighbours in time within
/// half a step of the frames, each event once.
fn matched(a: &[i64], b: &[i64]) -> Vec<i64> {
    let (mut i, mut j, mut gaps) = (0, 0, Vec::new());
    while let (Some(x), Some(y)) = (a.get(i), b.get(j)) {
        if (x - y).abs() <= 500 * STEP_US {
            gaps.push((x - y).abs());
            (i, j) = (i + 1, j + 1);
        } else if x < y {
            i += 1;
        } else {
            j += 1;
        }
    }
    gaps
}

fn sensed(renderer: Box<dyn Renderer>, life: &StillLife) -> Result<Events, String> {
    let capture = still_capture(life);
    let [from, to] = [&capture.views[0], &capture.views[5]].map(|view| view.world_from_camera);
    let pose = |k: u32| Se3 {
        rotation: from.rotation,
        translation: from.translation.lerp(to.translation, f64::from(k) / f64::from(FRAMES)),
    };
    let trajectory = Trajectory {
        world_from_camera: (0..FRAMES).map(pose).collect(),
        stamps_us: (0..i64::from(FRAMES)).map(|k| k * STEP_US).collect(),
    };
    let mut frames = RenderedFrames::new(renderer, capture.views[0].camera.resized(SIZE), trajectory);
    let mut all: Vec<Event> = Vec::new();
    let mut go_on = |_: &_| ControlFlow::Continue(());
    let model = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
    simulate_one(&mut frames, &model, Seed(7), &mut all, &mut go_on).map_err(|e| e.to_string())?;
    let mut events = Events::new();
    for event in all {
        let is_on = event.polarity == gs2e_event::Polarity::On;
        events.entry((event.x, event.y, is_on)).or_default().push(event.t.0);
    }
    events.values_mut().for_each(|times| times.sort_unstable());
    Ok(events)
}
