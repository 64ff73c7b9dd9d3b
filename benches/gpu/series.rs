//! Memory over many scenes in a row.

use crate::rates::style;
use gs2e_demo::{StillLife, still_capture, still_life};
use gs2e_gpu::{GpuDevice, GpuRenderer};
use gs2e_image::Size;
use gs2e_render::{ChannelSet, RenderRules, RenderedImages, Renderer as _};
use gs2e_scene::camera::view::CameraView;
use std::time::Instant;

/// Renders small scenes one after another on one device, as a build of many scenes does, and prints what
/// this process holds after each tenth of them.
pub(super) fn measure(device: &GpuDevice, scenes: u32) -> Result<(), String> {
    let failed = |e: gs2e_render::RenderError| e.to_string();
    let want = ChannelSet { rgb: true, luminance: true, ..ChannelSet::NONE };
    println!("\n{scenes} scenes in a row, of 1,000 to 4,000 Gaussians, two views of 320x180 each\n");
    println!(
        "| scenes | seconds | host, resident | device, in use | device, reserved |\n|---|---|---|---|---|"
    );
    let start = Instant::now();
    for k in 0..scenes {
        let life = StillLife { gaussians: 1000 + 1000 * (k % 4), seed: u64::from(k), ..StillLife::default() };
        let scene = still_life(&life);
        let mut gpu =
            GpuRenderer::new(device.clone(), &scene, style(RenderRules::Official)).map_err(failed)?;
        for photo in &still_capture(&life).views[..2] {
            let camera = photo.camera.resized(Size { width: 320, height: 180 });
            let view = CameraView::at_rest(camera, photo.world_from_camera);
            gpu.render(&view, want, &mut RenderedImages::default()).map_err(failed)?;
        }
        drop(gpu);
        if (k + 1) % scenes.div_ceil(10) == 0 || k + 1 == scenes {
            let megabytes = |bytes: Option<u64>| {
                bytes.map_or("unknown".to_owned(), |b| format!("{:.1} MB", b as f64 * 1e-6))
            };
            let held = device.memory_held();
            let [used, reserved] = [0, 1].map(|at| megabytes(held.map(|held| held[at])));
            let seconds = start.elapsed().as_secs_f64();
            println!("| {} | {seconds:.1} | {} | {used} | {reserved} |", k + 1, megabytes(resident()));
        }
    }
    Ok(())
}

/// Resident memory of this process, bytes, where Linux tells it.
fn resident() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(1024 * line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?)
}
