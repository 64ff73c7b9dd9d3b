//! Gradients against the float64 reference, and their bits against each other.

#![expect(clippy::cast_possible_truncation, reason = "draws become 32-bit parameters")]

use super::*;
use crate::cpu::CpuRenderer;
use crate::reference::adjoint::{LayerSums, layer_sums};
use crate::reference::{GaussianRates, ReferenceRenderer};
use crate::{RenderedImages, Renderer as _};
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::seed::{CellDraws, DrawSpace, Seed, SeedCell};
use gs2e_scene::SceneScreening;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use std::array::from_fn;
use std::sync::Arc;

const SIZE: Size = Size { width: 37, height: 21 };

fn draws(scene: u64) -> CellDraws {
    Seed(20_261_123).draws(SeedCell { x: 0, y: 0, level: 0, index: scene }, DrawSpace::Choice)
}

/// A few Gaussians in front of a camera: small and large, round and thin, faint and opaque, some
/// behind others, some beyond the edges of the image.
fn planted(scene: u64) -> (Gaussians, CameraView) {
    let mut draws = draws(scene);
    let count = 2 + draws.index(13);
    let mut between = |low: f64, high: f64| low + (high - low) * draws.uniform();
    let mut gaussians = Gaussians {
        origin: DVec3::new(between(-9.0, 9.0), 4.0, -7.0),
        positions: Vec::new(),
        log_scales: Vec::new(),
        rotations: Vec::new(),
        opacity_logits: Vec::new(),
        sh: Vec::new(),
        sh_degree: (scene % 4) as u8,
        antialiased: None,
        screening: SceneScreening::default(),
        motion: None,
    };
    let turn = DQuat::from_xyzw(between(-0.3, 0.3), between(-0.3, 0.3), between(-0.3, 0.3), 1.0).normalize();
    let pose = Se3 { rotation: turn, translation: gaussians.origin + DVec3::new(0.5, -0.25, 0.125) };
    for _ in 0..count {
        let z = between(1.0, 6.0);
        // The image ends at slopes of about 0.7 and 0.4; the clamp of the slopes lies at 1.3 times
        // that.
        let point = DVec3::new(between(-1.1, 1.1) * z, between(-0.6, 0.6) * z, z);
        let place = turn * point + pose.translation - gaussians.origin;
        gaussians.positions.push(place.as_vec3().to_array());
        let size = between(-3.5, -0.5);
        gaussians.log_scales.push(from_fn(|_| (size + between(-1.2, 1.2)) as f32));
        gaussians.rotations.push(from_fn(|_| between(-1.0, 1.0) as f32));
        gaussians.opacity_logits.push(between(-4.0, 7.0) as f32);
        let functions = gaussians.sh_len();
        gaussians.sh.extend((0..functions).map(|_| from_fn::<f32, 3, _>(|_| between(-0.6, 0.6) as f32)));
    }
    let camera = Camera { size: SIZE, fx: 27.0, fy: 25.0, cx: 17.3, cy: 11.2, lens: None };
    (gaussians, CameraView::at_rest(camera, pose))
}

/// All rules, and true for the antialiased rule.
const STYLES: [(RenderRules, bool); 8] = [
    (RenderRules::Soft, false),
    (RenderRules::Soft, true),
    (RenderRules::Official, false),
    (RenderRules::Official, true),
    (RenderRules::Exact, false),
    (RenderRules::Exact, true),
    (RenderRules::Gsplat, false),
    (RenderRules::Gsplat, true),
];

/// Number of random scenes; `RUN_SLOW_TESTS=1` takes a thousand.
fn scene_count() -> u64 {
    if std::env::var("RUN_SLOW_TESTS").as_deref() == Ok("1") { 1000 } else { 60 }
}

fn styled((rules, antialiased): (RenderRules, bool)) -> RenderStyle {
    style(rules, antialiased)
}

fn style(rules: RenderRules, antialiased: bool) -> RenderStyle {
    RenderStyle { rules, order: LayerOrder::Depth, antialiased, background: [0.2, 0.5, 0.9] }
}

/// A gradient by pixel, and a score.
fn pixel_values(scene: u64) -> (Vec<[f32; 3]>, Vec<f32>) {
    let mut draws = draws(1 << 40 | scene);
    let by_pixel = (0..SIZE.pixels()).map(|_| from_fn(|_| (draws.uniform() - 0.5) as f32)).collect();
    (by_pixel, (0..SIZE.pixels()).map(|_| draws.uniform() as f32).collect())
}

/// The groups of parameters.
#[derive(Debug, Clone, Copy)]
enum Group {
    Position,
    LogScale,
    Rotation,
    Logit,
    Harmonics,
}

const GROUPS: [Group; 5] =
    [Group::Position, Group::LogScale, Group::Rotation, Group::Logit, Group::Harmonics];

impl Group {
    fn values(self, scene: &mut Gaussians) -> &mut [f32] {
        match self {
            Self::Position => scene.positions.as_flattened_mut(),
            Self::LogScale => scene.log_scales.as_flattened_mut(),
            Self::Rotation => scene.rotations.as_flattened_mut(),
            Self::Logit => &mut scene.opacity_logits,
            Self::Harmonics => scene.sh.as_flattened_mut(),
        }
    }

    /// The gradients of the group, for every Gaussian of the scene.
    fn gradients(self, scene: &Gaussians, found: &ViewGradients) -> Vec<f32> {
        let mut all = vec![0.0; self.values(&mut scene.clone()).len()];
        let width = all.len() / scene.len();
        for (&number, g) in found.numbers.iter().zip(&found.gradients) {
            let to = &mut all[number as usize * width..][..width];
            match self {
                Self::Position => to.copy_from_slice(&g.position),
                Self::LogScale => to.copy_from_slice(&g.log_scale),
                Self::Rotation => to.copy_from_slice(&g.rotation),
                Self::Logit => to[0] = g.logit,
                Self::Harmonics => {
                    let basis = g.harmonics(scene.sh_degree);
                    to.iter_mut().enumerate().for_each(|(k, to)| *to = basis[k / 3] * g.colour[k % 3]);
                }
            }
        }
        all
    }
}

/// The loss `sum gradient . colour` by the reference, and the counts that tell whether a cut moved.
fn reference_loss(
    scene: &Gaussians,
    view: &CameraView,
    style: RenderStyle,
    by_pixel: &[[f32; 3]],
) -> (f64, [u64; 3]) {
    let renderer = ReferenceRenderer::new(Arc::new(scene.clone()), style).unwrap();
    let (colours, work) = renderer.colours(view).unwrap();
    let pairs = colours.as_flattened().iter().zip(by_pixel.as_flattened());
    (pairs.map(|(c, g)| c * f64::from(*g)).sum(), [work.blended, work.stopped, work.drawn()])
}

fn found_gradients(scene: &Gaussians, view: &CameraView, style: RenderStyle, index: u64) -> ViewGradients {
    let (by_pixel, score) = pixel_values(index);
    let mut renderer = GradientRenderer::new(scene.clone(), style).unwrap();
    renderer.render(view).unwrap();
    let mut found = ViewGradients::default();
    renderer.gradients(&by_pixel, &score, &mut found);
    found
}

/// Moves one group along a random direction, and compares the difference of the reference's loss
/// with the gradient along it. Returns `None` if a cut moved between the two.
fn relative_error(index: u64, style: RenderStyle, group: Group) -> Option<f64> {
    let (mut scene, view) = planted(index);
    let (by_pixel, _) = pixel_values(index);
    let gradients = group.gradients(&scene, &found_gradients(&scene, &view, style, index));
    let mut draws = draws(1 << 41 | index);
    // Steps of 2e-5 of a scale of about 0.05 scene units: the third derivative adds less than 1e-6
    // of the difference. The rounding of the moved parameters is part of the steps.
    let before = group.values(&mut scene).to_vec();
    let directions: Vec<f64> = before.iter().map(|_| 4e-5 * (draws.uniform() - 0.5)).collect();
    let mut at = |sign: f64| {
        for ((value, before), step) in group.values(&mut scene).iter_mut().zip(&before).zip(&directions) {
            *value = (f64::from(*before) + sign * step) as f32;
        }
        let moved = group.values(&mut scene).to_vec();
        (moved, reference_loss(&scene, &view, style, &by_pixel))
    };
    let (low, (loss_low, cuts_low)) = at(-1.0);
    let (_, (_, cuts)) = at(0.0);
    let (high, (loss_high, cuts_high)) = at(1.0);
    if cuts_low != cuts || cuts_high != cuts {
        return None;
    }
    let parts: Vec<f64> = low
        .iter()
        .zip(&high)
        .zip(&gradients)
        .map(|((low, high), g)| f64::from(*g) * (f64::from(*high) - f64::from(*low)))
        .collect();
    let scale = parts.iter().map(|p| p * p).sum::<f64>().sqrt();
    let difference = loss_high - loss_low - parts.iter().sum::<f64>();
    (scale > 0.0).then(|| difference.abs() / scale)
}

/// The loss by the reference is a sum over a few hundred pixels in f64; the gradient is f32 with
/// some hundred roundings of 6e-8, which a needle's ratio of axes magnifies. The step has an error of
/// its own, which dual numbers have not: they take a thousand scenes, and other formulas than these.
#[test]
fn gradients_are_slopes_of_the_reference() {
    let scenes = 60;
    for (rules, antialiased) in STYLES {
        for group in GROUPS {
            let errors: Vec<(f64, u64)> = (0..scenes)
                .into_par_iter()
                .filter_map(|index| Some((relative_error(index, style(rules, antialiased), group)?, index)))
                .collect();
            let worst = errors.iter().copied().fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
            println!("{rules:?} {antialiased} {group:?}: {} scenes, worst {worst:?}", errors.len());
            // A scene without a drawn Gaussian, or with a cut in the step, says nothing.
            assert!(errors.len() as u64 > scenes / 2, "{rules:?} {group:?}: {} scenes", errors.len());
            assert!(worst.0 < 1e-4, "{rules:?} {antialiased} {group:?}: {worst:?}");
        }
    }
}

/// The gradients in f64: the raster of the reference backwards, then the projection backwards.
fn double_gradients(
    scene: &Gaussians,
    view: &CameraView,
    style: RenderStyle,
    index: u64,
) -> Vec<(usize, GaussianGradient<f64>)> {
    let (by_pixel, score) = pixel_values(index);
    let reference = ReferenceRenderer::new(Arc::new(scene.clone()), style).unwrap();
    let chain = ProjectionChain {
        scene,
        eye: ViewTransform::new(view, scene.origin, style.rules),
        sh_degree: scene.sh_degree,
        antialiased: style.antialiased,
    };
    let layers = layer_sums(&reference, view, &by_pixel, &score).unwrap();
    let each = |layer: &LayerSums| {
        let LayerSums { index, axes, opacity, w, lit, sums } = *layer;
        (index, chain.gradient(index, &DrawnGaussian { axes, opacity, w, lit }, &SplatMoments(sums)))
    };
    layers.iter().map(each).collect()
}

/// A random direction in every group of the parameters: one unit of length, of a quaternion, of a logarithm.
fn random_rates(index: u64, count: usize, group: Group) -> Vec<GaussianRates> {
    let mut draws = draws(1 << 42 | index);
    let mut draw = || draws.uniform() - 0.5;
    let mut one = || {
        let mut rates = GaussianRates::default();
        match group {
            Group::Position => rates.position = from_fn(|_| draw()),
            Group::LogScale => rates.log_scale = from_fn(|_| draw()),
            Group::Rotation => rates.rotation = from_fn(|_| draw()),
            Group::Logit => rates.logit = draw(),
            Group::Harmonics => rates.harmonics = from_fn(|_| from_fn(|_| draw())),
        }
        rates
    };
    (0..count).map(|_| one()).collect()
}

/// The parts of the rate of the loss, one per parameter of a Gaussian: gradients times rates.
fn rate_parts<S: Copy + Into<f64>>(g: &GaussianGradient<S>, rates: &GaussianRates, degree: u8) -> Vec<f64> {
    let harmonics = sh::basis_values(degree, g.direction.map(Into::into));
    let by_harmonics = (0..sh::function_count(degree))
        .flat_map(|k| [0, 1, 2].map(|c| harmonics[k] * g.colour[c].into() * rates.harmonics[k][c]));
    let pairs = |g: &[S], rates: &[f64]| -> Vec<f64> {
        g.iter().zip(rates).map(|(g, rate)| (*g).into() * rate).collect()
    };
    let mut parts = pairs(&g.position, &rates.position);
    parts.extend(pairs(&g.log_scale, &rates.log_scale));
    parts.extend(pairs(&g.rotation, &rates.rotation));
    parts.extend(pairs(&[g.logit], &[rates.logit]));
    parts.extend(by_harmonics);
    parts
}

/// `<w, J v> = <J^T w, v>`: differences of the rate of the loss by the reference's dual numbers and the
/// gradients along it, in f64 and f32, each over the norm of the parts of the latter. `None` if nothing
/// changes.
fn adjoint_errors(index: u64, style: RenderStyle, group: Group) -> Option<[f64; 2]> {
    let (scene, view) = planted(index);
    let (by_pixel, _) = pixel_values(index);
    let rates = random_rates(index, scene.len(), group);
    let reference = ReferenceRenderer::new(Arc::new(scene.clone()), style).unwrap();
    let colours = reference.colour_rates(&view, &rates).unwrap();
    let pairs = colours.as_flattened().iter().zip(by_pixel.as_flattened());
    let wanted: f64 = pairs.map(|([_, rate], g)| rate * f64::from(*g)).sum();
    let error = |parts: Vec<f64>| {
        let scale = parts.iter().map(|p| p * p).sum::<f64>().sqrt();
        (scale > 0.0).then(|| (wanted - parts.iter().sum::<f64>()).abs() / scale)
    };
    let double = double_gradients(&scene, &view, style, index);
    let double = double.iter().flat_map(|(i, g)| rate_parts(g, &rates[*i], scene.sh_degree));
    let single = found_gradients(&scene, &view, style, index);
    let single = single.numbers.iter().zip(&single.gradients);
    let single = single.flat_map(|(i, g)| rate_parts(g, &rates[*i as usize], scene.sh_degree));
    Some([error(double.collect())?, error(single.collect())?])
}

/// Dual numbers have no step: in f64, the two sides differ by some hundred roundings of 1e-16, which
/// needles magnify.
#[test]
fn gradients_along_a_direction_are_rates_by_dual_numbers() {
    for (style, group) in STYLES.iter().flat_map(|style| GROUPS.map(|group| (*style, group))) {
        let errors: Vec<[f64; 2]> = (0..scene_count())
            .into_par_iter()
            .filter_map(|index| adjoint_errors(index, styled(style), group))
            .collect();
        let worst = errors.iter().fold([0.0_f64; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
        println!("{style:?} {group:?}: {} scenes, worst {worst:?}", errors.len());
        assert!(errors.len() as u64 > scene_count() * 9 / 10, "{style:?} {group:?}: {}", errors.len());
        assert!(worst[0] < 1e-8 && worst[1] < 1e-4, "{style:?} {group:?}: {worst:?}");
    }
}

#[test]
fn gradients_have_the_same_bits_for_any_threads_lists_and_instructions() {
    let style = style(RenderRules::Soft, false);
    for index in 0..8 {
        let (scene, view) = planted(index);
        let wanted = found_gradients(&scene, &view, style, index);
        let (by_pixel, score) = pixel_values(index);
        let t = |threads: usize, pairs: usize, instructions: InstructionSet| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found = pool.install(|| {
                let mut renderer = GradientRenderer::new(scene.clone(), style).unwrap();
                renderer.set_instructions(instructions);
                renderer.set_list_budget(pairs);
                renderer.render(&view).unwrap();
                let mut found = ViewGradients::default();
                renderer.gradients(&by_pixel, &score, &mut found);
                found
            });
            assert_eq!(found.numbers, wanted.numbers);
            assert_eq!(
                found.gradients, wanted.gradients,
                "{threads} threads, {pairs} pairs, {instructions:?}"
            );
        };
        t(1, 1 << 20, InstructionSet::widest_set());
        t(3, 1 << 20, InstructionSet::widest_set());
        t(2, 7, InstructionSet::widest_set());
        InstructionSet::available_sets().into_iter().for_each(|set| t(2, 1 << 20, set));
    }
}

#[test]
fn traced_images_are_those_of_the_renderer() {
    for index in 0..12 {
        let (scene, view) = planted(index);
        let rules = [RenderRules::Soft, RenderRules::Official][index as usize % 2];
        let style = style(rules, false);
        let mut gradient = GradientRenderer::new(scene.clone(), style).unwrap();
        let (image, work) = gradient.render(&view).unwrap();
        let mut out = RenderedImages::default();
        let plain =
            CpuRenderer::new(Arc::new(scene), style).unwrap().render(&view, COLOUR, &mut out).unwrap();
        assert_eq!(image.pixels(), out.rgb.unwrap().pixels());
        assert_eq!(
            (work.blended, work.stopped, work.tile_pairs),
            (plain.blended, plain.stopped, plain.tile_pairs)
        );
    }
}

/// With a score of 1 at every pixel, the shares of all Gaussians add up to the opacity of the image.
#[test]
fn shares_of_the_score_add_up_to_the_opacity() {
    for index in 0..12 {
        let (scene, view) = planted(index);
        let style = style(RenderRules::Soft, false);
        let mut renderer = GradientRenderer::new(scene.clone(), style).unwrap();
        renderer.render(&view).unwrap();
        let mut found = ViewGradients::default();
        let ones = vec![1.0; SIZE.pixels()];
        renderer.gradients(&vec![[0.0; 3]; SIZE.pixels()], &ones, &mut found);
        let mut out = RenderedImages::default();
        let want = ChannelSet { alpha: true, ..ChannelSet::NONE };
        CpuRenderer::new(Arc::new(scene), style).unwrap().render(&view, want, &mut out).unwrap();
        let alpha: f64 = out.alpha.unwrap().pixels().iter().map(|a| f64::from(*a)).sum();
        let shares: f64 = found.gradients.iter().map(|g| f64::from(g.score)).sum();
        // Some hundred terms of at most 1, each rounded at 6e-8 a few times.
        assert!((alpha - shares).abs() <= 1e-5 * alpha.max(1.0), "{index}: {alpha}, {shares}");
    }
}

/// A change in place gives the bits of a new renderer.
#[test]
fn a_changed_scene_is_rendered_as_a_new_one() {
    let (mut scene, view) = planted(3);
    let style = style(RenderRules::Soft, false);
    let mut renderer = GradientRenderer::new(scene.clone(), style).unwrap();
    let change = |scene: &mut Gaussians| {
        scene.opacity_logits[1] -= 1.5;
        scene.log_scales[1][0] += 0.25;
        scene.positions[1][2] += 0.125;
    };
    renderer.change(&[1], change);
    change(&mut scene);
    let found = renderer.render(&view).unwrap().0.clone();
    assert_eq!(&found, GradientRenderer::new(scene, style).unwrap().render(&view).unwrap().0);
}
