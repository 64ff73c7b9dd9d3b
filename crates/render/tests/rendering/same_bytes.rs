//! Circumstances that must not change a rendered bit: threads, earlier frames, other requested
//! images.

use super::{ALL, OFFICIAL, render};
use glam::{DQuat, DVec3};
use gs2e_image::luminance;
use gs2e_render::cpu::{CpuRenderer, InstructionSet};
use gs2e_render::{ChannelSet, RenderRules, RenderStyle, RenderWork, RenderedImages, Renderer};
use gs2e_scene::blobs::{ColourBlob, blob_crowd, blob_scene, view_ahead};
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use std::sync::Arc;

const GAUSSIANS: usize = 6000;

/// Sizes that are no multiple of a tile, and a pose without zeros.
fn askew() -> CameraView {
    let mut view = view_ahead(203, 117, 150.0);
    view.world_from_camera.rotation = DQuat::from_xyzw(0.02, -0.05, 0.01, 1.0).normalize();
    view.world_from_camera.translation = DVec3::new(0.3, -0.2, -1.5);
    view
}

/// Bits, so that NaN equals itself.
fn bits(image: &RenderedImages) -> Vec<u32> {
    let planes = [&image.luminance, &image.alpha, &image.depth];
    let grey = planes.into_iter().flatten().flat_map(|plane| plane.pixels().iter());
    let colour = image.rgb.iter().flat_map(|plane| plane.pixels().as_flattened());
    grey.chain(colour).map(|v| v.to_bits()).collect()
}

fn on_threads(threads: usize) -> (Vec<u32>, RenderWork) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let (image, work) = render(blob_scene(&blob_crowd(GAUSSIANS, 1)), OFFICIAL, &askew());
        (bits(&image), work)
    })
}

#[test]
fn the_number_of_threads() {
    let (one, four) = (on_threads(1), on_threads(4));
    assert!(one.1.blended > 100_000 && one.1.stopped > 1000, "the scene is a test: {:?}", one.1);
    assert_eq!(one, four);
}

/// Compares every channel of a moving camera under all rules, between all instruction sets of this
/// machine.
#[test]
fn the_instruction_set() {
    let scene = Arc::new(blob_scene(&blob_crowd(GAUSSIANS, 1)));
    let velocity = CameraVelocity { linear: DVec3::new(0.3, -0.1, 0.5), angular: DVec3::new(0.1, 0.4, -0.2) };
    let view = CameraView { velocity, ..askew() };
    let sets = InstructionSet::available_sets();
    println!("{:?}", sets.iter().map(InstructionSet::name).collect::<Vec<_>>());
    for rules in [RenderRules::Official, RenderRules::Exact, RenderRules::Gsplat, RenderRules::Soft] {
        let by = |set: &InstructionSet| {
            let mut cpu = CpuRenderer::new(scene.clone(), RenderStyle { rules, ..OFFICIAL }).unwrap();
            cpu.set_instructions(*set);
            let mut out = RenderedImages::default();
            let want = ChannelSet { flow: true, luminance_rate: true, ..ALL };
            let work = cpu.render(&view, want, &mut out).unwrap();
            let rate: Vec<u32> =
                out.luminance_rate.as_ref().unwrap().pixels().iter().map(|v| v.to_bits()).collect();
            (bits(&out), rate, work)
        };
        let first = by(&sets[0]);
        assert!(sets[1..].iter().all(|set| by(set) == first), "{rules:?}");
    }
}

#[test]
fn frames_rendered_before() {
    let mut cpu = CpuRenderer::new(Arc::new(blob_scene(&blob_crowd(GAUSSIANS, 1))), OFFICIAL).unwrap();
    let mut out = RenderedImages::default();
    let first = (cpu.render(&askew(), ALL, &mut out).unwrap(), bits(&out));
    let small = ChannelSet { depth: true, ..ChannelSet::default() };
    cpu.render(&view_ahead(64, 300, 90.0), small, &mut out).unwrap();
    assert_eq!((cpu.render(&askew(), ALL, &mut out).unwrap(), bits(&out)), first);
}

#[test]
fn other_images_asked_for() {
    let mut cpu = CpuRenderer::new(Arc::new(blob_scene(&blob_crowd(GAUSSIANS, 1))), OFFICIAL).unwrap();
    let none = ChannelSet::default();
    let [mut all, mut one] = [RenderedImages::default(), RenderedImages::default()];
    let work = cpu.render(&askew(), ALL, &mut all).unwrap();
    let mut t = |want: ChannelSet, pick: fn(&mut RenderedImages) -> RenderedImages| {
        assert_eq!(cpu.render(&askew(), want, &mut one).unwrap(), work, "{want:?}");
        assert_eq!(bits(&one), bits(&pick(&mut all)), "{want:?}");
    };
    t(ChannelSet { luminance: true, ..none }, |r| RenderedImages {
        luminance: r.luminance.take(),
        ..RenderedImages::default()
    });
    t(ChannelSet { alpha: true, ..none }, |r| RenderedImages {
        alpha: r.alpha.take(),
        ..RenderedImages::default()
    });
    t(ChannelSet { depth: true, ..none }, |r| RenderedImages {
        depth: r.depth.take(),
        ..RenderedImages::default()
    });
    t(ChannelSet { rgb: true, ..none }, |r| RenderedImages {
        rgb: r.rgb.take(),
        ..RenderedImages::default()
    });
}

#[test]
fn a_shuffled_file_without_equal_depths() {
    let blobs = blob_crowd(GAUSSIANS, 1);
    let shuffled: Vec<_> = (0..GAUSSIANS).map(|i| blobs[i * 1009 % GAUSSIANS]).collect();
    let [a, b] = [blobs, shuffled].map(|blobs| render(blob_scene(&blobs), OFFICIAL, &askew()));
    assert_eq!((bits(&a.0), a.1), (bits(&b.0), b.1));
}

#[test]
fn luminance_is_that_of_the_colour_up_to_rounding() {
    for rules in [RenderRules::Official, RenderRules::Exact] {
        let style = RenderStyle { rules, background: [0.3, 0.1, 0.9], ..OFFICIAL };
        let (found, _) = render(blob_scene(&blob_crowd(GAUSSIANS, 2)), style, &askew());
        let pairs =
            found.luminance.as_ref().unwrap().pixels().iter().zip(found.rgb.as_ref().unwrap().pixels());
        let worst = pairs.map(|(y, &rgb)| (y - luminance(rgb)).abs()).fold(0.0, f32::max);
        // the limit of docs/design/numerics-rendering.md, "Luminance channel"
        assert!(worst <= 2e-6, "{worst:e}");
    }
}

/// Tiles are checked after every 64 of their splats. A wall of opacity 0.95 leaves 0.05, 0.0025 and
/// 0.000125 of the light; its fourth layer would leave less than 0.0001, so that every pixel is
/// finished there.
#[test]
fn layers_behind_finished_tiles() {
    const LAYERS: usize = 200;
    const LOOK: usize = 64;
    // the wall's deviation is 80 * 100 / 4 = 2000 px, so that its opacity falls by a share of 1e-4
    // towards the corners
    let layer = |k: usize, x: f32, deviation: f32| ColourBlob {
        position: [x, 0.0, 4.0 + 0.01 * k as f32],
        deviations: [deviation; 3],
        opacity: 0.95,
        colour: [0.1 + 0.004 * k as f64; 3],
        ..ColourBlob::default()
    };
    let view = view_ahead(32, 16, 100.0);
    let wall: Vec<ColourBlob> = (0..LAYERS).map(|k| layer(k, 0.0, 80.0)).collect();
    let (image, work) = render(blob_scene(&wall), OFFICIAL, &view);
    assert_eq!((work.tile_pairs, work.hidden), (2 * LAYERS as u64, 2 * (LAYERS - LOOK) as u64));
    assert_eq!((work.blended, work.stopped), (3 * 32 * 16, 32 * 16));
    let (seen, rest) = render(blob_scene(&wall[..LOOK]), OFFICIAL, &view);
    assert_eq!((bits(&image), rest.hidden), (bits(&seen), 0));

    // dots of 2 px about (8, 8): the left tile keeps its light at the edges, and nothing is hidden
    // there
    let dots: Vec<ColourBlob> =
        (0..LAYERS).map(|k| layer(k, -8.0 * (4.0 + 0.01 * k as f32) / 100.0, 0.08)).collect();
    let (_, work) = render(blob_scene(&dots), RenderStyle { rules: RenderRules::Exact, ..OFFICIAL }, &view);
    assert_eq!((work.tile_pairs, work.hidden), (LAYERS as u64, 0));
}
