//! Work that the renderer omits changes no bit: Gaussians that no promised view can see, harmonics
//! that are zero.

use super::{ALL, OFFICIAL};
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{
    ChannelSet, OmissionPolicy, RenderRules, RenderStyle, RenderWork, RenderedImages, Renderer,
};
use gs2e_scene::blobs::{ColourBlob, ScatterDraws, blob_crowd, blob_scene, view_ahead};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_scene::{Gaussians, sh};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::sync::Arc;

const EVERYTHING: ChannelSet = ChannelSet { flow: true, luminance_rate: true, ..ALL };
const ALL_RULES: [RenderRules; 4] =
    [RenderRules::Official, RenderRules::Exact, RenderRules::Gsplat, RenderRules::Soft];

/// Bits of every image, so that NaN equals itself.
fn bits(out: &RenderedImages) -> Vec<u32> {
    let planes = [&out.luminance, &out.alpha, &out.depth, &out.luminance_rate, &out.doubtful];
    let grey = planes.into_iter().flat_map(|plane| plane.as_ref().unwrap().pixels().iter());
    let colour = out.rgb.as_ref().unwrap().pixels().as_flattened().iter();
    let flow = out.flow.as_ref().unwrap().pixels().as_flattened().iter();
    grey.chain(colour).chain(flow).map(|v| v.to_bits()).collect()
}

fn frame(cpu: &mut CpuRenderer, camera: Camera, world_from_camera: Se3) -> (Vec<u32>, RenderWork) {
    let velocity = CameraVelocity { linear: DVec3::new(0.3, -0.1, 0.5), angular: DVec3::new(0.1, 0.4, -0.2) };
    let mut out = RenderedImages::default();
    let view = CameraView { velocity, ..CameraView::at_rest(camera, world_from_camera) };
    let work = cpu.render(&view, EVERYTHING, &mut out).unwrap();
    (bits(&out), work)
}

/// Number of Gaussians not drawn, for any reason.
fn left_out(work: &RenderWork) -> u64 {
    work.unseen + work.behind + work.degenerate + work.outside
}

/// Dots, needles, discs and giants on all sides.
fn blobs() -> impl Strategy<Value = Vec<ColourBlob>> {
    let position = prop::array::uniform3(prop_oneof![4 => -8.0..8.0_f32, 1 => -300.0..300.0_f32]);
    let deviations = prop::array::uniform3((-7.0..1.0_f32).prop_map(f32::exp));
    let size = prop_oneof![6 => Just(1.0_f32), 1 => 1.0..60.0_f32];
    let rotation = prop::array::uniform4(-1.0..1.0_f32);
    let opacity = prop_oneof![1 => 0.001..0.006_f64, 4 => 0.006..0.9999_f64];
    let blob = (position, deviations, size, rotation, opacity).prop_map(
        |(position, deviations, size, rotation, opacity)| ColourBlob {
            position,
            deviations: deviations.map(|v| v * size),
            rotation,
            opacity,
            colour: [0.9, 0.2, 0.4],
        },
    );
    prop::collection::vec(blob, 1..80)
}

/// Cameras of all fields of view, with the principal point on the image or far off it.
fn cameras() -> impl Strategy<Value = Camera> {
    let off = || prop_oneof![2 => Just(0.0_f64), 1 => -150.0..150.0_f64];
    (20.0..200.0_f64, 20.0..200.0_f64, off(), off()).prop_map(|(fx, fy, right, down)| {
        let camera = view_ahead(48, 36, fx).camera;
        Camera { fy, cx: camera.cx + right, cy: camera.cy + down, ..camera }
    })
}

/// Walks that turn a little at each step, or spin.
fn paths() -> impl Strategy<Value = Vec<Se3>> {
    let vector = |most: f64| prop::array::uniform3(-most..most).prop_map(DVec3::from_array);
    let turn = prop_oneof![3 => vector(0.05), 1 => vector(2.0)];
    (vector(3.0), vector(3.0), vector(0.2), turn, 1..100_usize).prop_map(|(at, facing, step, turn, len)| {
        (0..len)
            .map(|j| Se3 {
                rotation: exp_vector(facing) * exp_vector(turn * j as f64),
                translation: at + step * j as f64,
            })
            .collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 200,
        rng_seed: RngSeed::Fixed(17),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Renderings for several readers count for each of them as if it had a renderer of its own.
    #[test]
    fn each_promise_has_its_own_counts(
        blobs in blobs(),
        camera in cameras(),
        poses in paths(),
        others in paths(),
        rules in prop::sample::select(&ALL_RULES[..]),
    ) {
        let scene = Arc::new(blob_scene(&blobs));
        let new = || CpuRenderer::new(scene.clone(), RenderStyle { rules, ..OFFICIAL }).unwrap();
        let promised = |poses: &[Se3]| {
            let mut cpu = new();
            cpu.keep_to(&camera, poses);
            cpu
        };
        let (mut whole, mut both) = (promised(&poses), promised(&poses));
        // A part of the path, views elsewhere, and the part again.
        let part = &poses[poses.len() / 3..];
        for reader in [part, &others[..], part] {
            both.keep_also(&camera, reader);
            let mut own = promised(reader);
            let (wanted, alone) = frame(&mut own, camera, reader[0]);
            let (found, work) = frame(&mut both, camera, reader[0]);
            prop_assert!(found == wanted, "{alone:?} {work:?}");
            prop_assert_eq!(both.work_within(work), alone);
            // The promise of all frames still has its own counts.
            let (wanted, alone) = frame(&mut whole, camera, poses[0]);
            let (found, work) = frame(&mut both, camera, poses[0]);
            prop_assert!(found == wanted);
            prop_assert_eq!(work, alone);
        }
        // A new promise of all frames replaces both.
        both.keep_to(&camera, &others[..]);
        let (_, alone) = frame(&mut promised(&others), camera, others[0]);
        let (_, work) = frame(&mut both, camera, others[0]);
        prop_assert_eq!((work, both.work_within(work)), (alone, alone));
    }

    #[test]
    fn unseen_gaussians_change_no_bit(
        blobs in blobs(),
        camera in cameras(),
        poses in paths(),
        rules in prop::sample::select(&ALL_RULES[..]),
        antialiased: bool,
        origin in prop_oneof![Just(DVec3::ZERO), Just(DVec3::new(3e5, -4e6, 120.0))],
    ) {
        let scene = Arc::new(Gaussians { origin, ..blob_scene(&blobs) });
        let poses: Vec<Se3> =
            poses.iter().map(|pose| Se3 { translation: pose.translation + origin, ..*pose }).collect();
        let style = RenderStyle { rules, antialiased, ..OFFICIAL };
        let new = || CpuRenderer::new(scene.clone(), style).unwrap();
        let [mut whole, mut kept, mut all_of_it] = [new(), new(), new()];
        all_of_it.omit(OmissionPolicy::Nothing);
        kept.keep_to(&camera, &poses);
        all_of_it.keep_to(&camera, &poses);
        for &pose in poses.iter().step_by(7) {
            let (wanted, all) = frame(&mut whole, camera, pose);
            let (found, work) = frame(&mut kept, camera, pose);
            prop_assert!(found == wanted, "{all:?} {work:?}");
            prop_assert_eq!(all.unseen, 0);
            prop_assert_eq!(left_out(&work), left_out(&all));
            let counts = |w: RenderWork| (w.gaussians, w.tile_pairs, w.blended, w.stopped, w.affine_doubtful);
            prop_assert_eq!(counts(work), counts(all));
            let (found, all_work) = frame(&mut all_of_it, camera, pose);
            prop_assert!(found == wanted, "{all:?} {all_work:?}");
            prop_assert_eq!(all_work, RenderWork { hidden: 0, zero_harmonics: 0, ..all });
        }
    }
}

/// A walk of 300 steps along z, looking ahead and swaying.
fn walk() -> Vec<Se3> {
    let pose = |j: u32| {
        let s = f64::from(j) / 300.0;
        Se3 {
            rotation: DQuat::from_rotation_y(0.2 * libm::sin(9.0 * s)),
            translation: DVec3::new(0.3 * libm::sin(5.0 * s), 0.0, 2.0 * s),
        }
    };
    (0..300).map(pose).collect()
}

#[test]
fn nearly_all_unseen_gaussians_are_found() {
    let mut draws = ScatterDraws(5);
    let mut within = |least, most| draws.within(least, most);
    let blobs: Vec<ColourBlob> = (0..400)
        .map(|_| ColourBlob {
            position: [within(-6.0, 6.0), within(-4.0, 4.0), within(-8.0, 8.0)],
            deviations: [(); 3].map(|()| within(-6.0, -2.0).exp()),
            opacity: 0.8,
            ..ColourBlob::default()
        })
        .collect();
    let (camera, poses) = (view_ahead(256, 192, 240.0).camera, walk());
    let mut cpu = CpuRenderer::new(Arc::new(blob_scene(&blobs)), OFFICIAL).unwrap();
    cpu.keep_to(&camera, &poses);
    let found = frame(&mut cpu, camera, poses[0]).1.unseen;
    // each alone, at every twentieth pose: a Gaussian that touches no tile of any pose is unseen
    let is_unseen = |blob: &&ColourBlob| {
        let mut cpu = CpuRenderer::new(Arc::new(blob_scene(&[**blob])), OFFICIAL).unwrap();
        let mut out = RenderedImages::default();
        let want = ChannelSet { alpha: true, ..ChannelSet::default() };
        poses.iter().step_by(20).all(|&pose| {
            cpu.render(&CameraView::at_rest(camera, pose), want, &mut out).unwrap().tile_pairs == 0
        })
    };
    let unseen = blobs.iter().filter(is_unseen).count() as u64;
    println!("{found} of {unseen} unseen ones of {}", blobs.len());
    // a Gaussian that touches a pixel is never omitted, so `found` counts truly unseen ones; one in
    // fifty may be too near
    assert!(found <= unseen && unseen > 250, "the scene is a test: {unseen}");
    assert!(found * 50 >= unseen * 49, "{found} of {unseen}");
}

#[test]
fn promises_are_replaced_and_an_empty_one_keeps_all() {
    let (camera, walk) = (view_ahead(64, 48, 60.0).camera, walk());
    // no Gaussian too faint for every view
    let blobs: Vec<ColourBlob> =
        blob_crowd(3000, 4).iter().map(|blob| ColourBlob { opacity: 0.7, ..*blob }).collect();
    let mut cpu = CpuRenderer::new(Arc::new(blob_scene(&blobs)), OFFICIAL).unwrap();
    let whole = frame(&mut cpu, camera, walk[0]);
    let mut unseen = |poses: &[Se3]| {
        cpu.keep_to(&camera, poses);
        let (found, work) = frame(&mut cpu, camera, walk[0]);
        assert!(found == whole.0);
        work.unseen
    };
    let (one, all) = (unseen(&walk[..1]), unseen(&walk));
    assert!(one > all && all > 0, "{one} {all}");
    assert_eq!(unseen(&walk[..1]), one);
    assert_eq!(unseen(&[]), 0);
    let lost = Se3 { translation: DVec3::NAN, ..walk[0] };
    assert_eq!(unseen(&[walk[0], lost]), 0, "a pose that is not finite excludes nothing");
}

/// A crowd with harmonics up to `degree`, stored with those up to `stored`: the rest are zeros of
/// both signs.
fn harmonics(degree: u8, stored: u8) -> Gaussians {
    let mut draws = ScatterDraws(3);
    let mut scene = blob_scene(&blob_crowd(2000, 2));
    let triple = |draws: &mut ScatterDraws| [(); 3].map(|()| draws.within(-0.3, 0.3));
    scene.sh = scene
        .sh
        .iter()
        .flat_map(|&first| {
            let drawn: Vec<_> = (1..sh::function_count(degree)).map(|_| triple(&mut draws)).collect();
            let zeros = (sh::function_count(degree)..sh::function_count(stored))
                .map(|n| [if n % 2 == 0 { 0.0 } else { -0.0 }; 3]);
            std::iter::once(first).chain(drawn).chain(zeros).collect::<Vec<_>>()
        })
        .collect();
    scene.sh_degree = stored;
    scene
}

#[test]
fn harmonics_that_are_zero_in_the_whole_scene_change_no_bit() {
    let CameraView { camera, world_from_camera, .. } = view_ahead(96, 64, 80.0);
    let draw = |scene: Gaussians| {
        frame(&mut CpuRenderer::new(Arc::new(scene), OFFICIAL).unwrap(), camera, world_from_camera)
    };
    for degree in 0..=3 {
        let (wanted, plain) = draw(harmonics(degree, degree));
        assert_eq!(plain.zero_harmonics, 0);
        let drawn = plain.gaussians - left_out(&plain);
        for stored in degree..=3 {
            let (found, work) = draw(harmonics(degree, stored));
            assert!(found == wanted, "degree {degree} stored as {stored}");
            let spared = drawn * (sh::function_count(stored) - sh::function_count(degree)) as u64;
            assert_eq!(work, RenderWork { zero_harmonics: spared, ..plain });
        }
    }
}

/// 250 opaque layers behind a crowd, with harmonics of degree 3; those of the highest degree are
/// zero.
fn opaque() -> Gaussians {
    let layer = |k: u8| ColourBlob {
        position: [0.0, 0.0, 7.0 + 0.01 * f32::from(k)],
        deviations: [90.0, 90.0, 0.01],
        opacity: 0.95,
        colour: [0.1, 0.002 * f64::from(k), 1.4],
        ..ColourBlob::default()
    };
    let mut both = harmonics(1, 3);
    let wall = blob_scene(&(0..250).map(layer).collect::<Vec<_>>());
    let zeros = vec![[0.0; 3]; sh::function_count(3) - 1];
    both.positions.extend(wall.positions);
    both.log_scales.extend(wall.log_scales);
    both.rotations.extend(wall.rotations);
    both.opacity_logits.extend(wall.opacity_logits);
    both.sh.extend(wall.sh.iter().flat_map(|first| std::iter::once(*first).chain(zeros.clone())));
    both
}

#[test]
fn omitted_work_can_be_done_and_changes_no_bit() {
    let CameraView { camera, world_from_camera, .. } = view_ahead(90, 70, 80.0);
    let scene = Arc::new(opaque());
    for rules in ALL_RULES {
        let mut cpu = CpuRenderer::new(scene.clone(), RenderStyle { rules, ..OFFICIAL }).unwrap();
        cpu.keep_to(&camera, &[world_from_camera]);
        let (wanted, work) = frame(&mut cpu, camera, world_from_camera);
        assert!(work.unseen > 0 && work.hidden > 0 && work.zero_harmonics > 0, "{rules:?} {work:?}");
        cpu.omit(OmissionPolicy::Nothing);
        let (found, whole) = frame(&mut cpu, camera, world_from_camera);
        assert!(found == wanted, "{rules:?}");
        assert_eq!((whole.unseen, whole.hidden, whole.zero_harmonics), (0, 0, 0), "{rules:?}");
        assert_eq!((whole.drawn(), whole.tile_pairs), (work.drawn(), work.tile_pairs), "{rules:?}");
        assert_eq!((whole.blended, whole.stopped), (work.blended, work.stopped), "{rules:?}");
        cpu.keep_to(&camera, &[world_from_camera]);
        assert_eq!(frame(&mut cpu, camera, world_from_camera).1, whole, "a promise changes nothing");
        cpu.omit(OmissionPolicy::Needless);
        cpu.keep_to(&camera, &[world_from_camera]);
        assert_eq!(frame(&mut cpu, camera, world_from_camera), (wanted, work), "{rules:?}");
    }
}

#[test]
fn one_harmonic_that_is_not_zero_is_evaluated() {
    let CameraView { camera, world_from_camera, .. } = view_ahead(96, 64, 80.0);
    let mut scene = harmonics(0, 3);
    *scene.sh.last_mut().unwrap() = [0.0, 0.0, f32::MIN_POSITIVE];
    let work = frame(&mut CpuRenderer::new(Arc::new(scene), OFFICIAL).unwrap(), camera, world_from_camera).1;
    assert_eq!(work.zero_harmonics, 0);
}
