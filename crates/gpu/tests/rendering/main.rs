//! The GPU renderer, compared with the goldens and with the CPU renderer.
//!
//! Both follow the same rules in the same order over the same 32 bits. They differ in the rounding
//! of quotients, roots and powers (a few units of 6e-8 on a device that conforms to WebGPU). Where
//! that tips a decision at a threshold, one layer of one pixel differs: hence a mean of at most
//! 1e-5 and 99.9 % within 1e-3.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]
#![expect(clippy::print_stdout, reason = "the table of differences")]

#[path = "../../../render/tests/rendering/cases.rs"]
mod cases;
mod events;
mod features;
mod gpu;
mod gradients;

use cases::{Case, captured, difference, moving, npy, playbot, row, synthetic};
use glam::DVec3;
use gs2e_gpu::{DeviceChoice, GpuDevice, GpuRenderer, TimedStage};
use gs2e_image::{Image, Size, luminance, png};
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{
    ChannelSet, GpuError, RenderError, RenderRules, RenderStyle, RenderWork, RenderedImages, Renderer,
};
use gs2e_scene::Gaussians;
use gs2e_scene::blobs::{blob_crowd, blob_scene, view_ahead};
use gs2e_scene::camera::view::CameraView;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const ALL_RULES: [RenderRules; 4] =
    [RenderRules::Official, RenderRules::Exact, RenderRules::Gsplat, RenderRules::Soft];
/// All images of a camera at rest.
const ALL: ChannelSet = ChannelSet::AT_REST;
/// The published rules over a black background.
const OFFICIAL: RenderStyle = RenderStyle::OFFICIAL;
/// Every image of a moving camera.
const MOVING: ChannelSet = ChannelSet { flow: true, luminance_rate: true, ..ALL };

fn style(rules: RenderRules, antialiased: bool) -> RenderStyle {
    RenderStyle { rules, antialiased, background: [0.1, 0.3, 0.2], ..OFFICIAL }
}

fn by_gpu(
    device: &GpuDevice,
    scene: &Gaussians,
    style: RenderStyle,
    view: &CameraView,
) -> (RenderedImages, RenderWork) {
    let mut out = RenderedImages::default();
    let work =
        GpuRenderer::new(device.clone(), scene, style).unwrap().render(view, MOVING, &mut out).unwrap();
    (out, work)
}

fn by_cpu(scene: &Arc<Gaussians>, style: RenderStyle, view: &CameraView) -> (RenderedImages, RenderWork) {
    let mut out = RenderedImages::default();
    let work = CpuRenderer::new(scene.clone(), style).unwrap().render(view, MOVING, &mut out).unwrap();
    (out, work)
}

/// The images as rows of numbers, each with its name.
fn images(rendered: &RenderedImages) -> Vec<(&'static str, Vec<f32>)> {
    let flat = |image: &Option<Image<f32>>| image.as_ref().unwrap().pixels().to_vec();
    vec![
        ("rgb", rendered.rgb.as_ref().unwrap().pixels().as_flattened().to_vec()),
        ("luminance", flat(&rendered.luminance)),
        ("alpha", flat(&rendered.alpha)),
        ("doubtful", flat(&rendered.doubtful)),
        ("depth", flat(&rendered.depth)),
        ("rate", flat(&rendered.luminance_rate)),
        ("flow", rendered.flow.as_ref().unwrap().pixels().as_flattened().to_vec()),
    ]
}

/// Compares two images relative to `scale`, and writes a heat map if they differ too much.
fn close(name: &str, what: &str, found: &[f32], wanted: &[f32], size: Size) -> bool {
    // Depth and flow are undefined where opacity is below one half: at the same pixels, except for
    // roundings.
    let undefined = found.iter().zip(wanted).filter(|(a, b)| a.is_nan() != b.is_nan()).count();
    let mut defined = wanted.iter().copied().filter(|v| v.is_finite());
    // Opacity and colour are compared directly; images with a unit, relative to their largest
    // value.
    let scale = defined.by_ref().fold(1.0, |m: f32, v| m.max(v.abs()));
    let errors: Vec<f32> = found
        .iter()
        .zip(wanted)
        .map(|(a, b)| if a.is_nan() || b.is_nan() { 0.0 } else { (a - b).abs() / scale })
        .collect();
    let n = errors.len() as f64;
    let mean = errors.iter().map(|e| f64::from(*e)).sum::<f64>() / n;
    let largest = errors.iter().fold(0.0, |m: f32, e| m.max(*e));
    let share = errors.iter().filter(|e| **e > 1e-3).count() as f64 / n;
    let fine = mean <= 1e-5 && share <= 1e-3 && undefined as f64 <= 1e-3 * n;
    println!(
        "{name:28} {what:9} mean {mean:9.2e} max {largest:9.2e} > 1e-3 {share:9.2e} undefined {undefined}"
    );
    if !fine {
        heat(&format!("{name} {what}"), &errors, size);
    }
    fine
}

/// Draws the differences of two images: black is equal, red 1e-5, yellow 1e-3, white 1e-1.
fn heat(name: &str, errors: &[f32], size: Size) {
    let values = errors.len() / size.pixels();
    let colour = |errors: &[f32]| {
        let level = (errors.iter().fold(0.0, |m: f32, e| m.max(*e)).max(1e-7).log10() + 7.0) / 2.0;
        [0.0, 1.0, 2.0].map(|k| (level - k).clamp(0.0, 1.0))
    };
    let image = Image::from_vec(size, errors.chunks_exact(values).map(colour).collect());
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{}.png", name.replace(' ', "-")));
    png::write_image(&png::to_bytes(&image), std::fs::File::create(&path).unwrap()).unwrap();
    println!("  heat map: {}", path.display());
}

fn check(
    device: &GpuDevice,
    name: &str,
    scene: &Arc<Gaussians>,
    style: RenderStyle,
    view: &CameraView,
) -> bool {
    let (found, work) = by_gpu(device, scene, style, view);
    let (wanted, cpu) = by_cpu(scene, style, view);
    let pairs = images(&found).into_iter().zip(images(&wanted));
    let closely =
        pairs.map(|((what, a), (_, b))| close(name, what, &a, &b, view.camera.size)).collect::<Vec<_>>();
    // The counts are whole numbers, which decisions at a threshold may change.
    let near = |a: u64, b: u64| a.abs_diff(b) <= 2 + b / 10_000;
    let counts = |w: &RenderWork| {
        [
            w.gaussians,
            w.behind,
            w.degenerate,
            w.outside,
            w.blended,
            w.stopped,
            w.affine_doubtful,
            w.affine_invalid,
        ]
    };
    let counted = counts(&work).iter().zip(counts(&cpu)).all(|(a, b)| near(*a, b));
    if !counted {
        println!("{name}: {work:?}\n  by the cpu: {cpu:?}");
    }
    counted && closely.iter().all(|fine| *fine)
}

#[test]
fn every_golden_is_met_on_the_gpu() {
    let Some(device) = gpu::device() else { return };
    let (root, cases) = synthetic();
    all_met(&root, &cases, &device);
}

#[test]
fn every_golden_of_a_captured_scene_is_met_on_the_gpu() {
    let (Some((root, cases)), Some(device)) = (captured(), gpu::device()) else { return };
    all_met(&root, &cases, &device);
}

/// Without a feature, alone or with the others, the goldens are met as with all of them.
#[test]
fn every_golden_is_met_without_each_feature() {
    let (root, cases) = synthetic();
    for (features, device) in gpu::devices_without_features() {
        println!("without {features}");
        all_met(&root, &cases, &device);
    }
}

fn all_met(root: &Path, cases: &[Case], device: &GpuDevice) {
    println!("{}", device.fingerprint());
    let missed = cases.iter().filter(|case| !golden(root, case, device)).count();
    assert_eq!(missed, 0, "goldens are missed, see the table");
}

/// Renders a golden case within the limits of the CPU renderer.
fn golden(root: &Path, case: &Case, device: &GpuDevice) -> bool {
    let golden = case.same_as.as_ref().unwrap_or(&case.name);
    let (found, work) =
        case.render(&mut GpuRenderer::new(device.clone(), &case.scene(root), case.style()).unwrap());
    let rgb = found.rgb.as_ref().unwrap().pixels();
    let wanted = npy(&root.join(format!("{golden}.rgb.npy")));
    let mut fine = row(&case.name, "rgb", difference(rgb.as_flattened(), &wanted));
    let grey: Vec<f32> = wanted.as_chunks().0.iter().map(|&c| luminance(c)).collect();
    fine &= row(&case.name, "luminance", difference(found.luminance.as_ref().unwrap().pixels(), &grey));
    let alpha = npy(&root.join(format!("{golden}.alpha.npy")));
    fine &= row(&case.name, "alpha", difference(found.alpha.as_ref().unwrap().pixels(), &alpha));
    let near = |a: u64, b: u64| a.abs_diff(b) <= 2 + b / 100_000;
    let counted =
        near(work.blended, case.stats.blended_pixels) && near(work.stopped, case.stats.stopped_pixels);
    println!("  blended {}, stopped {}{}", work.blended, work.stopped, if counted { "" } else { "  OVER" });
    fine && counted
}

#[test]
fn a_crowd_is_as_on_the_cpu() {
    let Some(device) = gpu::device() else { return };
    let scene = Arc::new(blob_scene(&blob_crowd(3000, 1)));
    let view = moving(view_ahead(203, 150, 150.0));
    let mut fine = true;
    for rules in ALL_RULES {
        for antialiased in [false, true] {
            let name = format!("crowd {rules:?}{}", if antialiased { " aa" } else { "" });
            fine &= check(&device, &name, &scene, style(rules, antialiased), &view);
        }
    }
    assert!(fine, "the back ends differ, see the table");
}

/// Rendering at a distance where a unit in the last place of 32 bits is 0.06 units long.
#[test]
fn far_from_the_origin_nothing_is_lost() {
    let Some(device) = gpu::device() else { return };
    let far = DVec3::new(1e6 + 0.1, -2e6, 5e5 + 0.3);
    let mut scene = blob_scene(&blob_crowd(1000, 2));
    scene.origin = far;
    let mut view = moving(view_ahead(120, 90, 100.0));
    view.world_from_camera.translation = far + DVec3::new(0.013, -0.007, 0.021);
    assert!(check(&device, "far", &Arc::new(scene), style(RenderRules::Exact, true), &view));
}

#[test]
fn a_real_scene_is_as_on_the_cpu() {
    let (Some((scene, view)), Some(device)) = (playbot(Size { width: 320, height: 180 }), gpu::device())
    else {
        return;
    };
    let view = moving(view);
    let fine = ALL_RULES.map(|rules| {
        check(
            &device,
            &format!("playbot {rules:?}"),
            &scene,
            style(rules, rules == RenderRules::Exact),
            &view,
        )
    });
    assert!(fine.iter().all(|fine| *fine), "the back ends differ, see the table");
}

/// Data too large for a binding is divided: the scene into parts, the image into regions. The
/// picture is the same, bit for bit.
#[test]
fn small_bindings_change_nothing() {
    let Some(device) = gpu::device() else { return };
    let scene = blob_scene(&blob_crowd(3000, 3));
    let (style, view) = (style(RenderRules::Exact, false), moving(view_ahead(203, 150, 150.0)));
    let (wanted, work) = by_gpu(&device, &scene, style, &view);
    let bits = |rendered: &RenderedImages| -> Vec<u32> {
        images(rendered).into_iter().flat_map(|(_, values)| values).map(f32::to_bits).collect()
    };
    for limit in [1 << 18, 1 << 16] {
        let (found, counted) = by_gpu(&device.clone().with_limit(limit), &scene, style, &view);
        assert!(bits(&found) == bits(&wanted), "{limit}");
        assert_eq!(counted, work, "{limit}");
    }
    // One tile needs more than these bytes: an error names the tile, and no picture is made.
    let mut gpu = GpuRenderer::new(device.clone().with_limit(1 << 12), &scene, style).unwrap();
    let error = gpu.render(&view, MOVING, &mut RenderedImages::default()).unwrap_err();
    let RenderError::Gpu(GpuError::Tile { limit, .. }) = error else { panic!("{error}") };
    assert_eq!(limit, 1 << 12);
}

#[test]
fn views_in_flight_equal_views_made_one_by_one() {
    let Some(device) = gpu::device() else { return };
    let scene = blob_scene(&blob_crowd(1000, 4));
    let views: Vec<CameraView> = (0..5)
        .map(|k| {
            let mut view = moving(view_ahead(64, 48, 60.0));
            view.world_from_camera.translation.x = 0.2 * f64::from(k);
            view
        })
        .collect();
    let want = ChannelSet { luminance: true, luminance_rate: true, ..ChannelSet::default() };
    let mut gpu = GpuRenderer::new(device, &scene, OFFICIAL).unwrap();
    views.iter().for_each(|view| gpu.expect(view, want));
    let ahead: Vec<(RenderedImages, RenderWork)> = views
        .iter()
        .map(|view| {
            let mut out = RenderedImages::default();
            let work = gpu.render(view, want, &mut out).unwrap();
            (out, work)
        })
        .collect();
    for (view, (rendered, work)) in views.iter().zip(&ahead) {
        let mut alone = RenderedImages::default();
        assert_eq!(gpu.render(view, want, &mut alone).unwrap(), *work);
        assert!(alone.luminance == rendered.luminance && alone.luminance_rate == rendered.luminance_rate);
        assert!(alone.rgb.is_none() && alone.depth.is_none());
    }
    assert!(ahead.windows(2).all(|pair| pair[0].0.luminance != pair[1].0.luminance), "the views differ");
    if let Some(times) = gpu.times() {
        println!("{times:?} of {:?}", TimedStage::ALL);
        assert!(times[TimedStage::Raster as usize] > Duration::ZERO);
    }
    // An unexpected view is rendered all the same. Expecting a view that cannot be rendered is no
    // error; rendering it is.
    gpu.expect(&views[0], want);
    let mut other = RenderedImages::default();
    gpu.render(&views[1], want, &mut other).unwrap();
    assert!(other.luminance == ahead[1].0.luminance);
    let mut blind = views[0];
    blind.camera.fx = f64::NAN;
    gpu.expect(&blind, want);
    assert!(matches!(gpu.render(&blind, want, &mut other), Err(RenderError::View(_))));
}

#[test]
fn gaussians_that_are_not_finite_are_omitted_and_counted() {
    let Some(device) = gpu::device() else { return };
    let mut spoilt = blob_scene(&blob_crowd(400, 5));
    spoilt.positions[1][0] = f32::NAN;
    spoilt.log_scales[2][1] = f32::INFINITY;
    spoilt.rotations[3] = [f32::NAN; 4];
    spoilt.sh[4][2] = f32::NEG_INFINITY;
    spoilt.log_scales[5] = [80.0; 3];
    spoilt.positions[6] = [f32::INFINITY, 0.0, 3.0];
    let view = moving(view_ahead(64, 48, 60.0));
    assert!(check(&device, "spoilt", &Arc::new(spoilt), style(RenderRules::Exact, false), &view));
    // An empty scene shows the background.
    assert!(check(&device, "empty", &Arc::new(blob_scene(&[])), style(RenderRules::Exact, false), &view));
}

#[test]
fn a_gpu_that_is_lost_is_an_error() {
    let Some(device) = gpu::device() else { return };
    let mut gpu = GpuRenderer::new(device.clone(), &blob_scene(&blob_crowd(10, 6)), OFFICIAL).unwrap();
    let view = view_ahead(64, 48, 60.0);
    gpu.render(&view, ALL, &mut RenderedImages::default()).unwrap();
    device.destroy();
    let error = gpu.render(&view, ALL, &mut RenderedImages::default()).unwrap_err();
    let RenderError::Gpu(GpuError::Lost { adapter, .. }) = &error else { panic!("{error}") };
    assert_eq!(adapter, device.name());
}

#[test]
fn a_scene_without_room_is_an_error_that_states_the_sizes() {
    let Some(device) = gpu::device() else { return };
    let (crowd, view) = (blob_scene(&blob_crowd(1000, 6)), view_ahead(640, 480, 600.0));
    let message = |room: u64| {
        let device = device.clone().with_room(room);
        let rendered = GpuRenderer::new(device, &crowd, OFFICIAL)
            .and_then(|mut gpu| gpu.render(&view, ALL, &mut RenderedImages::default()));
        let error = rendered.unwrap_err();
        let RenderError::Gpu(GpuError::Memory { what, wanted, .. }) = &error else { panic!("{error}") };
        assert!(*wanted > room && error.to_string().ends_with(&format!("{what}: {room} bytes are free")));
        *what
    };
    assert_ne!(message(1000), message(16 << 20));
}

/// Pictures that a faulty driver spoils are found in the first frame, by name, with what to try.
#[test]
fn a_picture_that_is_not_finite_is_an_error() {
    let Some(device) = gpu::device() else { return };
    let (crowd, view) = (blob_scene(&blob_crowd(10, 6)), view_ahead(64, 48, 60.0));
    for want in [ALL, ChannelSet { luminance: true, ..ChannelSet::NONE }] {
        let mut gpu = GpuRenderer::new(device.clone().with_spoilt_pictures(), &crowd, OFFICIAL).unwrap();
        let error = gpu.render(&view, want, &mut RenderedImages::default()).unwrap_err();
        let RenderError::Gpu(because) = &error else { panic!("{error}") };
        assert!(matches!(because, GpuError::NotFinite { adapter } if adapter == device.name()), "{error}");
        assert!(because.help().contains("--gpu-without"), "{}", because.help());
    }
}

#[test]
fn a_missing_gpu_is_an_error_that_lists_the_others() {
    let Some(device) = gpu::device() else { return };
    for (choice, wanted) in [
        (DeviceChoice::Index(99), "no GPU is number 99; there is "),
        (DeviceChoice::Name("Voodoo 2".to_owned()), "no GPU is called `Voodoo 2`; there is "),
    ] {
        let message = GpuDevice::open(&choice).unwrap_err().to_string();
        assert!(message.starts_with(wanted) && message.contains(device.name()), "{message}");
    }
    let name: String = device.name().chars().take(5).collect();
    assert!(GpuDevice::open(&DeviceChoice::Name(name.to_uppercase())).is_ok());
}
