//! Gradients on the GPU, compared with those of the CPU, which are compared with the float64 reference.
//!
//! Both backward passes take the same f32 steps over the same layers, and differ in the rounding of
//! quotients, roots and powers, and in the order of sums over the pixels of a tile. A gradient is a sum
//! over pixels of terms of both signs, so its error is relative to the terms and not to the sum: hence
//! norms, and for single values a part of the largest of their kind in the scene. WebGPU allows a power
//! of two some 20 units of 6e-8, and light recovered over 24 layers about 70: 6e-6 of the terms. The
//! terms of a value over the 777 pixels add up like random signs, to about 1/28 of their sum, which
//! makes 2e-4 of the value; axes of unlike lengths magnify that a few times. Hence 1e-3.

use super::OFFICIAL;
use super::gpu;
use glam::{DQuat, DVec3};
use gs2e_gpu::{GpuDevice, GpuGradientRenderer};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_render::cpu::backward::{GaussianGradient, GradientRenderer, ViewGradients};
use gs2e_render::differentiable::DifferentiableRenderer as _;
use gs2e_render::{LayerOrder, RenderError, RenderRules, RenderStyle, RenderWork};
use gs2e_scene::blobs::{ColourBlob, ScatterDraws, blob_scene, view_ahead};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::{Gaussians, SceneScreening};
use gs2e_testing::absent::is_thorough;
use std::array::from_fn;

fn style(rules: RenderRules, antialiased: bool) -> RenderStyle {
    RenderStyle { rules, antialiased, background: [0.2, 0.5, 0.9], ..OFFICIAL }
}

/// A scene in front of a camera: Gaussians small and large, round and thin, faint and opaque, in front
/// of each other and beyond the edges. The image has several tiles, the last ones cut.
fn planted(index: u64, sh_degree: u8) -> (Gaussians, CameraView) {
    let mut draws = ScatterDraws(index);
    let mut between = |low: f32, high: f32| low + (high - low) * draws.next();
    let drawn = between(2.0, 24.0);
    let count = (1..24_u8).take_while(|&count| f32::from(count) <= drawn).count();
    let origin = DVec3::new(f64::from(between(-9.0, 9.0)), 4.0, -7.0);
    let turn = [between(-0.3, 0.3), between(-0.3, 0.3), between(-0.3, 0.3), 1.0].map(f64::from);
    let turn = DQuat::from_array(turn).normalize();
    let eye = DVec3::new(0.5, -0.25, 0.125);
    let mut scene = Gaussians {
        origin,
        positions: Vec::new(),
        log_scales: Vec::new(),
        rotations: Vec::new(),
        opacity_logits: Vec::new(),
        sh: Vec::new(),
        sh_degree,
        antialiased: None,
        screening: SceneScreening::default(),
        motion: None,
    };
    for _ in 0..count {
        let z = between(1.0, 6.0);
        // The image ends at slopes of about 0.7 and 0.4; the clamp of the slopes lies at 1.3 times that.
        let point = [between(-1.1, 1.1) * z, between(-0.6, 0.6) * z, z].map(f64::from);
        scene.positions.push((turn * DVec3::from_array(point) + eye).as_vec3().to_array());
        let size = between(-3.5, -0.5);
        scene.log_scales.push(from_fn(|_| size + between(-1.2, 1.2)));
        scene.rotations.push(from_fn(|_| between(-1.0, 1.0)));
        scene.opacity_logits.push(between(-4.0, 7.0));
        let functions = scene.sh_len();
        scene.sh.extend((0..functions).map(|_| from_fn::<f32, 3, _>(|_| between(-0.6, 0.6))));
    }
    let camera =
        Camera { size: Size { width: 37, height: 21 }, fx: 27.0, fy: 25.0, cx: 17.3, cy: 11.2, lens: None };
    (scene, CameraView::at_rest(camera, Se3 { rotation: turn, translation: origin + eye }))
}

/// A gradient and a score for each pixel.
fn pixel_values(index: u64, size: Size) -> (Vec<[f32; 3]>, Vec<f32>) {
    let mut draws = ScatterDraws(index ^ 0xabcd);
    let by_pixel = (0..size.pixels()).map(|_| from_fn(|_| draws.next() - 0.5)).collect();
    (by_pixel, (0..size.pixels()).map(|_| draws.next()).collect())
}

fn by_cpu(scene: &Gaussians, view: &CameraView, style: RenderStyle) -> (ViewGradients, RenderWork) {
    let (by_pixel, score) = pixel_values(1, view.camera.size);
    let mut renderer = GradientRenderer::new(scene.clone(), style).unwrap();
    let work = renderer.render(view).unwrap().1;
    let mut found = ViewGradients::default();
    renderer.gradients(&by_pixel, &score, &mut found);
    (found, work)
}

/// The gradients of the scene that the renderer holds.
fn by_gpu(renderer: &mut GpuGradientRenderer, view: &CameraView) -> (ViewGradients, RenderWork) {
    let (by_pixel, score) = pixel_values(1, view.camera.size);
    let work = renderer.render(view).unwrap().1;
    let mut found = ViewGradients::default();
    renderer.gradients(&by_pixel, &score, &mut found).unwrap();
    (found, work)
}

const GROUPS: [&str; 7] = ["position", "log scale", "rotation", "logit", "colour", "direction", "score"];

/// The values of a group of parameters.
fn values<'a>(group: &str, g: &'a GaussianGradient) -> &'a [f32] {
    match group {
        "position" => &g.position,
        "log scale" => &g.log_scale,
        "rotation" => &g.rotation,
        "logit" => std::slice::from_ref(&g.logit),
        "colour" => &g.colour,
        "direction" => &g.direction,
        _ => std::slice::from_ref(&g.score),
    }
}

/// The error of each group: the norm of the difference over the norm, and the largest difference over
/// the largest value.
fn errors(found: &ViewGradients, wanted: &ViewGradients) -> [[f64; 2]; GROUPS.len()] {
    assert_eq!(found.numbers, wanted.numbers, "the Gaussians that are drawn");
    GROUPS.map(|group| {
        let flat = |gradients: &ViewGradients| -> Vec<f64> {
            gradients.gradients.iter().flat_map(|g| values(group, g)).map(|v| f64::from(*v)).collect()
        };
        let (found, wanted) = (flat(found), flat(wanted));
        let difference: Vec<f64> = found.iter().zip(&wanted).map(|(a, b)| a - b).collect();
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let largest = |v: &[f64]| v.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        // Where nothing is drawn, all gradients are 0 for both.
        let over = |a: f64, b: f64| if a == 0.0 { 0.0 } else { a / b };
        assert!(difference.iter().all(|d| d.is_finite()), "{group}: {found:?}");
        [over(norm(&difference), norm(&wanted)), over(largest(&difference), largest(&wanted))]
    })
}

/// Compares the gradients of one view.
fn assert_close(name: &str, found: &ViewGradients, wanted: &ViewGradients) {
    for (group, [norm, largest]) in GROUPS.iter().zip(errors(found, wanted)) {
        println!("{name:24} {group:10} norm {norm:9.2e} largest {largest:9.2e}");
        assert!(norm <= 1e-3 && largest <= 1e-3, "{name}: {group}: {norm:e}, {largest:e}");
    }
}

const STYLES: [(RenderRules, bool, u8); 6] = [
    (RenderRules::Soft, false, 3),
    (RenderRules::Soft, true, 1),
    (RenderRules::Official, false, 2),
    (RenderRules::Official, true, 0),
    (RenderRules::Exact, false, 3),
    (RenderRules::Gsplat, false, 1),
];

/// Compares `scenes` random scenes for each style. Both passes take the same layers for blended, except
/// where an opacity lies within rounding of a threshold: those scenes differ in the count of layers, are
/// few, and are not compared.
fn compare_styles(scenes: u64) {
    let Some(device) = gpu::device() else { return };
    for (rules, antialiased, degree) in STYLES {
        let style = style(rules, antialiased);
        let (first, _) = planted(0, degree);
        let mut gpu = GpuGradientRenderer::new(device.clone(), first, style).unwrap();
        let mut worst = [[0.0_f64; 2]; GROUPS.len()];
        let mut tipped = 0;
        for index in 0..scenes {
            let (scene, view) = planted(index, degree);
            gpu.rebuild(&mut |old| old.clone_from(&scene)).unwrap();
            let ((found, work), (wanted, cpu)) = (by_gpu(&mut gpu, &view), by_cpu(&scene, &view, style));
            if (work.blended, work.stopped) != (cpu.blended, cpu.stopped) {
                tipped += 1;
                continue;
            }
            for (worst, error) in worst.iter_mut().zip(errors(&found, &wanted)) {
                *worst = [worst[0].max(error[0]), worst[1].max(error[1])];
            }
        }
        println!("{rules:?} antialiased {antialiased} degree {degree}: {tipped} of {scenes} tipped");
        for (group, [norm, largest]) in GROUPS.iter().zip(worst) {
            println!("  {group:10} norm {norm:9.2e} largest {largest:9.2e}");
            assert!(
                norm <= 1e-3 && largest <= 1e-3,
                "{rules:?} {antialiased} {group}: {norm:e}, {largest:e}"
            );
        }
        assert!(tipped <= 1 + scenes / 50, "{rules:?}: {tipped} of {scenes} scenes");
    }
}

/// With `RUN_SLOW_TESTS=1`, more scenes.
#[test]
fn gradients_equal_those_of_the_cpu() {
    compare_styles(if is_thorough() { 200 } else { 12 });
}

/// Compares some scenes, each under every set of rules.
fn check(device: &GpuDevice, scenes: &[(&str, &Gaussians, CameraView)]) {
    for (rules, antialiased) in [
        (RenderRules::Soft, true),
        (RenderRules::Official, false),
        (RenderRules::Exact, false),
        (RenderRules::Gsplat, false),
    ] {
        let style = style(rules, antialiased);
        let mut gpu = GpuGradientRenderer::new(device.clone(), blob_scene(&[]), style).unwrap();
        for (name, scene, view) in scenes {
            gpu.rebuild(&mut |old| old.clone_from(scene)).unwrap();
            let (found, wanted) = (by_gpu(&mut gpu, view).0, by_cpu(scene, view, style).0);
            assert!(!wanted.numbers.is_empty(), "{name}: nothing is drawn");
            assert_close(&format!("{name} {rules:?}"), &found, &wanted);
        }
    }
}

#[test]
fn degenerate_gaussians_have_the_gradients_of_the_cpu() {
    let Some(device) = gpu::device() else { return };
    let seen = ColourBlob { position: [0.1, 0.0, 3.0], colour: [0.9, 0.4, 0.2], ..ColourBlob::default() };
    let blobs = [
        seen,
        ColourBlob { position: [0.0, 0.0, -2.0], ..seen },
        ColourBlob { position: [40.0, 0.0, 3.0], ..seen },
        // At the edge of the image, where the slope of the derivative is clamped.
        ColourBlob { position: [2.4, 0.3, 2.5], deviations: [0.6, 0.3, 0.2], ..seen },
        ColourBlob { opacity: 1.0 - 1e-6, position: [-0.6, 0.2, 4.0], ..seen },
        ColourBlob { opacity: 0.004, position: [-0.3, 0.1, 2.0], deviations: [0.5; 3], ..seen },
        ColourBlob { opacity: 1e-9, ..seen },
        // Needles, and a disc seen from its edge.
        ColourBlob { deviations: [1.0, 1e-3, 1e-3], rotation: [0.9, 0.1, 0.2, 0.5], ..seen },
        ColourBlob { deviations: [2.0, 1e-5, 0.02], rotation: [0.3, -0.4, 0.2, 0.5], ..seen },
        ColourBlob { deviations: [0.4, 0.4, 1e-6], rotation: [1.0, 1.0, 0.0, 0.0], ..seen },
        ColourBlob { rotation: [0.0; 4], ..seen },
        ColourBlob { rotation: [3e3, 1e3, 0.0, 0.0], deviations: [0.2, 0.05, 0.1], ..seen },
        // A colour below zero in one channel, which its clamp holds.
        ColourBlob { colour: [-0.2, 0.5, 1.3], position: [0.2, -0.3, 2.5], ..seen },
    ];
    let mut scene = blob_scene(&blobs);
    for _ in 0..3 {
        scene.positions.push([f32::NAN, 0.0, 3.0]);
        scene.log_scales.push([f32::INFINITY; 3]);
        scene.rotations.push([1.0, 0.0, 0.0, 0.0]);
        scene.opacity_logits.push(1.0);
        scene.sh.push([0.0; 3]);
    }
    scene.positions[13] = [0.0, 0.0, 3.0];
    // Tiles cut to one row and column, and to one pixel in all.
    let small = blob_scene(&blobs[..9]);
    check(
        &device,
        &[
            ("degenerate", &scene, view_ahead(75, 50, 60.0)),
            ("17 x 33", &small, view_ahead(17, 33, 20.0)),
            ("1 x 1", &small, view_ahead(1, 1, 10.0)),
        ],
    );
}

#[test]
fn a_view_of_nothing_has_no_gradients() {
    let Some(device) = gpu::device() else { return };
    let view = view_ahead(40, 30, 40.0);
    let behind = ColourBlob { position: [0.0, 0.0, -3.0], ..ColourBlob::default() };
    for scene in [blob_scene(&[]), blob_scene(&[behind; 3])] {
        let mut gpu = GpuGradientRenderer::new(device.clone(), scene, OFFICIAL).unwrap();
        // What an earlier view left is not found again.
        for _ in 0..2 {
            let (found, work) = by_gpu(&mut gpu, &view);
            assert_eq!((found.numbers.len(), found.gradients.len(), work.blended), (0, 0, 0));
        }
    }
}

/// Hundreds of faint layers over one another: a tile takes them away in several rounds.
fn deep_scene() -> Gaussians {
    let mut draws = ScatterDraws(77);
    let blobs: Vec<ColourBlob> = (0..500)
        .map(|_| ColourBlob {
            position: [draws.within(-1.0, 1.0), draws.within(-0.8, 0.8), draws.within(2.0, 5.0)],
            deviations: [(); 3].map(|()| draws.within(0.05, 0.5)),
            rotation: [(); 4].map(|()| draws.within(-1.0, 1.0)),
            opacity: f64::from(draws.within(0.01, 0.1)),
            colour: [(); 3].map(|()| f64::from(draws.within(0.0, 1.0))),
        })
        .collect();
    blob_scene(&blobs)
}

#[test]
fn long_lists_have_the_gradients_of_the_cpu() {
    let Some(device) = gpu::device() else { return };
    let (scene, view) = (deep_scene(), view_ahead(50, 40, 45.0));
    let (rules, _, _) = STYLES[0];
    let style = style(rules, false);
    let mut gpu = GpuGradientRenderer::new(device, scene.clone(), style).unwrap();
    let ((found, work), (wanted, _)) = (by_gpu(&mut gpu, &view), by_cpu(&scene, &view, style));
    // Twelve tiles: a workgroup has 64 threads, so they take more than two rounds in the mean.
    assert!(work.tile_pairs > 12 * 2 * 64, "{} pairs", work.tile_pairs);
    assert_close("deep", &found, &wanted);
}

/// A device that binds little renders a scene in parts and a view in regions.
#[test]
fn regions_and_parts_add_up_to_the_gradients_of_the_whole() {
    let Some(device) = gpu::device() else { return };
    let (deep, view) = (deep_scene(), view_ahead(50, 40, 45.0));
    // Two of three Gaussians are behind the camera, so that the scene has two parts although all
    // splats of a tile fit the device.
    let mut scene = blob_scene(&[ColourBlob { position: [0.0, 0.0, -3.0], ..ColourBlob::default() }; 1500]);
    for i in 0..deep.len() {
        let at = 3 * i + 1;
        scene.positions[at] = deep.positions[i];
        scene.log_scales[at] = deep.log_scales[i];
        scene.rotations[at] = deep.rotations[i];
        scene.opacity_logits[at] = deep.opacity_logits[i];
        scene.sh[at] = deep.sh[i];
    }
    let style = style(RenderRules::Soft, false);
    let whole = by_gpu(&mut GpuGradientRenderer::new(device.clone(), scene.clone(), style).unwrap(), &view).0;
    // 1222 Gaussians at 36 bytes, 550 splats at 80 bytes, and 1100 of the 2128 pairs at 40 bytes.
    let little = device.with_limit(44_000);
    let mut gpu = GpuGradientRenderer::new(little, scene, style).unwrap();
    let (found, _) = by_gpu(&mut gpu, &view);
    // Sums over tiles are added in another order: some roundings of 6e-8.
    for (group, [norm, largest]) in GROUPS.iter().zip(errors(&found, &whole)) {
        assert!(norm <= 1e-5 && largest <= 1e-5, "{group}: {norm:e}, {largest:e}");
    }
    assert_ne!(found.gradients, whole.gradients, "the view was not rendered in regions");
    assert!(by_gpu(&mut gpu, &view).0.gradients == found.gradients, "two runs differ");
}

#[test]
fn gradients_have_the_same_bits_in_every_run() {
    let Some(device) = gpu::device() else { return };
    for index in 0..2 {
        let (scene, view) = planted(index, 3);
        let style = style(RenderRules::Soft, false);
        let new = |scene: &Gaussians| GpuGradientRenderer::new(device.clone(), scene.clone(), style).unwrap();
        let mut renderer = new(&scene);
        let first = by_gpu(&mut renderer, &view).0;
        let same = |found: &ViewGradients, wanted: &ViewGradients| {
            found.numbers == wanted.numbers && found.gradients == wanted.gradients
        };
        assert!(same(&by_gpu(&mut renderer, &view).0, &first), "{index}: a second run");
        assert!(same(&by_gpu(&mut new(&scene), &view).0, &first), "{index}: another renderer");
        // A change in place gives the bits of a new renderer.
        let last = scene.len() - 1;
        let mut change = |scene: &mut Gaussians| {
            scene.opacity_logits[0] -= 0.5;
            scene.log_scales[last][0] += 0.25;
            scene.rotations[last][1] += 0.5;
            scene.positions[last][2] += 0.125;
        };
        let mut changed = scene.clone();
        change(&mut changed);
        renderer.change(&[0, u32::try_from(last).unwrap()], &mut change);
        assert!(same(&by_gpu(&mut renderer, &view).0, &by_gpu(&mut new(&changed), &view).0));
    }
}

/// Degrees above the set one count as zero.
#[test]
fn a_lower_degree_is_that_of_the_cpu() {
    let Some(device) = gpu::device() else { return };
    let (scene, view) = planted(5, 3);
    let style = style(RenderRules::Soft, false);
    let mut gpu = GpuGradientRenderer::new(device, scene.clone(), style).unwrap();
    let mut cpu = GradientRenderer::new(scene, style).unwrap();
    let (by_pixel, score) = pixel_values(1, view.camera.size);
    for degree in [1, 3, 0, 2] {
        gpu.set_degree(degree);
        cpu.set_degree(degree);
        assert_eq!((gpu.degree(), cpu.degree()), (degree, degree));
        cpu.render(&view).unwrap();
        let mut wanted = ViewGradients::default();
        cpu.gradients(&by_pixel, &score, &mut wanted);
        assert_close(&format!("degree {degree}"), &by_gpu(&mut gpu, &view).0, &wanted);
    }
}

#[test]
fn a_blended_order_has_no_gradients_on_a_gpu() {
    let Some(device) = gpu::device() else { return };
    let style = RenderStyle { order: LayerOrder::Blended, ..OFFICIAL };
    let refused = GpuGradientRenderer::new(device, blob_scene(&[]), style);
    assert!(matches!(refused, Err(RenderError::Style(_))));
}
