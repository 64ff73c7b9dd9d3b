//! Optional features of a GPU change no bit, and the work of a frame is counted as it is.

use super::OFFICIAL;
use super::gpu;
use super::{ALL_RULES, by_gpu, images, moving, style};
use gs2e_gpu::{GpuFeature, GpuRenderer, TimedStage};
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, RenderedImages, Renderer as _};
use gs2e_scene::blobs::{blob_crowd, blob_scene, view_ahead};
use std::sync::Arc;

/// Enough for several blocks of each sort, and several groups of each scan.
const CROWD: usize = 9000;

fn bits(rendered: &RenderedImages) -> Vec<u32> {
    images(rendered).into_iter().flat_map(|(_, values)| values).map(f32::to_bits).collect()
}

#[test]
fn a_feature_that_is_left_out_changes_no_bit() {
    let Some(device) = gpu::device() else { return };
    println!("with {}", device.features());
    let crowd = blob_scene(&blob_crowd(CROWD, 8));
    let view = moving(view_ahead(320, 240, 230.0));
    let without = gpu::devices_without_features();
    assert!(!without.is_empty());
    for rules in ALL_RULES {
        let style = style(rules, false);
        let (wanted, work) = by_gpu(&device, &crowd, style, &view);
        assert!(work.tile_pairs > 4096 * 4, "{work:?}");
        for (features, other) in &without {
            assert_eq!(other.fingerprint(), device.fingerprint(), "a feature is not in the key");
            let (found, counted) = by_gpu(other, &crowd, style, &view);
            assert!(bits(&found) == bits(&wanted), "{rules:?} without {features}");
            assert_eq!(counted, work, "{rules:?} without {features}");
        }
    }
}

#[test]
fn a_device_without_a_clock_tells_no_time() {
    let Some(device) = gpu::device() else { return };
    let (crowd, view) = (blob_scene(&blob_crowd(100, 8)), view_ahead(64, 48, 60.0));
    let want = ChannelSet { rgb: true, ..ChannelSet::NONE };
    let mut devices = gpu::devices_without_features();
    devices.push(("nothing".to_owned(), device));
    for (without, device) in devices {
        let clock = device.features().has(GpuFeature::Timestamps);
        assert_eq!(clock, without == "nothing" || without == "subgroups", "{without}");
        let mut gpu = GpuRenderer::new(device, &crowd, OFFICIAL).unwrap();
        gpu.render(&view, want, &mut RenderedImages::default()).unwrap();
        assert_eq!(gpu.times().is_some(), clock, "{without}");
    }
}

/// The counts of a frame agree with those of the CPU, whose lists are the same.
#[test]
fn the_work_of_a_frame_is_counted() {
    let Some(device) = gpu::device() else { return };
    let crowd = Arc::new(blob_scene(&blob_crowd(CROWD, 8)));
    let view = view_ahead(320, 240, 230.0);
    let want = ChannelSet { rgb: true, ..ChannelSet::NONE };
    let mut out = RenderedImages::default();
    let mut whole = GpuRenderer::new(device.clone(), &crowd, OFFICIAL).unwrap();
    whole.render(&view, want, &mut out).unwrap();
    let work = whole.frame_work();
    let cpu = CpuRenderer::new(crowd.clone(), OFFICIAL).unwrap().render(&view, want, &mut out).unwrap();
    // Roundings move an edge of an extent across the edge of a tile.
    let near = |a: u64, b: u64| a.abs_diff(b) <= 2 + b / 1000;
    assert!(near(work.splats, cpu.gaussians - cpu.behind - cpu.degenerate - cpu.outside), "{work:?} {cpu:?}");
    assert!(near(work.blended, cpu.blended), "{work:?} {cpu:?}");
    // Tiles load whole batches, and stop when all their pixels are finished.
    assert!(0 < work.loaded && work.loaded <= work.pairs, "{work:?}");
    assert_eq!(work.transfer, 320 * 240 * 12);
    assert!(TimedStage::ALL.iter().all(|stage| work.stages[*stage as usize].bytes > 0), "{work:?}");
    // Regions add up: each projects the whole scene, and the splats on their border count twice.
    let mut parts = GpuRenderer::new(device.with_limit(1 << 18), &crowd, OFFICIAL).unwrap();
    parts.render(&view, want, &mut out).unwrap();
    let divided = parts.frame_work();
    assert_eq!((divided.pairs, divided.blended, divided.transfer), (work.pairs, work.blended, work.transfer));
    assert!(divided.splats > work.splats && divided.stages[0].bytes > work.stages[0].bytes, "{divided:?}");
}
