//! The renderers at the edges of their arithmetic (`numerics.md` 10, area splat), each case against a closed form, the
//! reference in 64 bits, or a twin without what is at the edge.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]
#![expect(clippy::cast_possible_truncation, reason = "the counts of these scenes fit every type")]

mod cases;

use crate::support::gaussians::{ALL, OFFICIAL};
use crate::support::{ply, shared};
use cases::{ALL_RULES, Counts, Needle};
use glam::DVec3;
use gs2e::image::Size;
use gs2e::render::cpu::Cpu;
use gs2e::render::reference::Reference;
use gs2e::render::{Channels, Rendered, Renderer, Rules, Style, Velocity, View, Work};
use gs2e::scene::Gaussians;
use gs2e::source::nerfstudio;
use std::sync::Arc;

const EXACT: Style = Style { rules: Rules::Exact, ..OFFICIAL };

fn cpu(scene: &Gaussians, style: Style) -> Cpu {
    Cpu::new(Arc::new(scene.clone()), style).unwrap()
}

/// Both back ends for a scene.
fn both(scene: &Gaussians, style: Style) -> [Box<dyn Renderer>; 2] {
    let scene = Arc::new(scene.clone());
    [Box::new(Cpu::new(scene.clone(), style).unwrap()), Box::new(Reference::new(scene, style).unwrap())]
}

fn image(renderer: &mut dyn Renderer, view: &View) -> (Rendered, Work) {
    let mut out = Rendered::default();
    let work = renderer.render(view, ALL, &mut out).unwrap();
    (out, work)
}

/// Every value of every image, as bits, so that NaN equals itself.
fn bits(image: &Rendered) -> Vec<u32> {
    let planes = [&image.luminance, &image.alpha, &image.depth, &image.doubtful];
    let grey = planes.into_iter().flatten().flat_map(|plane| plane.pixels().iter());
    let colour = image.rgb.iter().flat_map(|plane| plane.pixels().as_flattened());
    grey.chain(colour).map(|v| v.to_bits()).collect()
}

fn alphas(image: &Rendered) -> Vec<f64> {
    image.alpha.as_ref().unwrap().pixels().iter().map(|&v| f64::from(v)).collect()
}

fn counts(work: Work) -> Counts {
    let Work { gaussians, behind, degenerate, outside, affine_doubtful, affine_invalid, .. } = work;
    Counts { gaussians, behind, degenerate, outside, doubtful: affine_doubtful, invalid: affine_invalid }
}

/// The CPU's counts and the reference's: equal, but for Gaussians beside the picture. 32 bits widen an extent by 0.02 px
/// against rounding, and few are so near to it.
fn same_counts(cpu: Work, reference: Work, what: &str) {
    let outside = cpu.outside.abs_diff(reference.outside);
    assert!(outside <= cpu.gaussians / 1000, "{what}: {cpu:?}, {reference:?}");
    assert_eq!(counts(Work { outside: 0, ..cpu }), counts(Work { outside: 0, ..reference }), "{what}");
}

/// Near a needle's mean its power is the square of the distance across it over the smaller eigenvalue, which is the
/// determinant over the larger: what is lost in either shows there in full.
#[test]
fn needles_keep_their_determinant_and_their_smaller_eigenvalue() {
    let opacity = Needle::OPACITY;
    let mut worst = [0.0_f64; 2];
    for needle in cases::needles() {
        let wanted = needle.powers();
        let narrow = (needle.long_px / needle.aspect).powi(2) + 0.3;
        let found = alphas(&image(&mut cpu(&needle.scene(), EXACT), &needle.view()).0);
        let exact = Reference::new(Arc::new(needle.scene()), EXACT).unwrap();
        let exact = exact.luminance(&needle.view()).unwrap();
        let mut seen = 0;
        for (k, [distance, power]) in wanted.into_iter().enumerate() {
            if !(0.05..2.0).contains(&power) || distance > 8.0 {
                continue;
            }
            seen += 1;
            let across = (2.0 * power).sqrt();
            // 32 bits: 2e-6 of the determinant; w1 dx and w2 dy, each up to the distance over the smaller deviation and
            // rounded three times, enter with the distance across; alpha >= 0.13 is 1 - T, rounded at 6e-8, and 2^-q
            // errs by 2e-7.
            let bound = 2e-6 * power + 3.0 * 2.0 * 6e-8 * across * distance / narrow.sqrt() + 1e-6;
            let error = ((opacity / found[k]).ln() - power).abs();
            assert!(error <= bound, "{needle:?}: {error:e} of {power}, bound {bound:e}");
            // 64 bits: 1e-13, and the same roundings 2^-29 times as large, of the luminance itself
            let luminance = exact[k][0];
            let error64 = ((needle.luminance() / luminance).ln() - power).abs();
            let bound64 = 1e-13 * power + 6.0 * 1.2e-16 * across * distance / narrow.sqrt() + 2e-15;
            assert!(error64 <= bound64, "{needle:?}: {error64:e} of {power} in 64 bits, bound {bound64:e}");
            worst = [worst[0].max(error / bound), worst[1].max(error64 / bound64)];
        }
        // the widest have a power below 0.05 as far as 8 px
        assert!(seen > 5 || narrow > 400.0, "{needle:?}: {seen}");
    }
    println!("needles: at worst {:.2} and {:.2} of what rounding may do", worst[0], worst[1]);
}

/// As far from the mean as the needle is long: the table of `numerics.md` 7.2.
#[test]
fn needles_keep_their_shape_far_from_the_mean() {
    for (long_px, limit) in [(300.0, 8e-6), (1000.0, 4.7e-5), (3000.0, 7.5e-5)] {
        let mut errors = Vec::new();
        for aspect in [10.0, 100.0, 1e3, 1e4] {
            for angle in [0.1, 0.3, 0.7, 1.2, 1.5] {
                let needle = Needle { long_px, aspect, angle, offset: long_px / 2.0 };
                let found = alphas(&image(&mut cpu(&needle.scene(), EXACT), &needle.view()).0);
                let wanted = needle.powers().into_iter().map(|[_, power]| Needle::OPACITY * (-power).exp());
                let seen = found.iter().zip(wanted).filter(|(alpha, wanted)| **alpha > 0.0 && *wanted > 0.0);
                errors.extend(seen.map(|(alpha, wanted)| (alpha - wanted).abs()));
            }
        }
        errors.sort_by(f64::total_cmp);
        let [most, worst] = [errors[errors.len() * 99 / 100], errors[errors.len() - 1]];
        println!("{long_px} px: 99 % {most:.1e}, largest {worst:.1e} of {} pixels", errors.len());
        assert!(errors.len() > 1000 && most <= limit, "{long_px} px: {most:e}");
    }
}

/// A shift that 64 bits hold exactly beside the camera's centre changes no bit of either back end.
#[test]
fn the_origin_of_the_world() {
    let (scene, mut view) = cases::askew(2000);
    // rounded to 2^-30, so that adding the shift loses nothing
    let coarse = |v: f64| (v * f64::from(1 << 30)).round() / f64::from(1 << 30);
    view.world_from_camera.translation = view.world_from_camera.translation.map(coarse);
    let here = both(&scene, OFFICIAL).map(|mut r| image(&mut *r, &view));
    for shift in [1e2, 1e4, 1e6] {
        let shift = DVec3::new(shift, -shift, 0.5 * shift);
        let mut moved = view;
        moved.world_from_camera.translation += shift;
        let scene = Gaussians { origin: shift, ..scene.clone() };
        for (mut renderer, here) in both(&scene, OFFICIAL).into_iter().zip(&here) {
            let there = image(&mut *renderer, &moved);
            assert!((bits(&there.0), there.1) == (bits(&here.0), here.1), "{shift}");
        }
    }
}

/// Layers of equal opacity, capped at 0.99, are a geometric series until the one that would leave less than 1e-4.
#[test]
fn stacks_of_a_thousand_layers_are_geometric_series() {
    for opacity in [0.004, 0.009, 0.02, 0.5, 0.99, 0.99999_f64] {
        let alpha = opacity.min(0.99);
        // 0.01 squared is below 1e-4 in 32 bits, and by decree in 64
        let blended = (1..=1000).take_while(|n| (1.0 - alpha).powi(*n) >= 1.000_001e-4).count();
        let weight = |i: i32| alpha * (1.0 - alpha).powi(i);
        let sum = |first: usize| -> f64 { (first..blended).step_by(2).map(|i| weight(i as i32)).sum() };
        let wanted = [sum(0), sum(1), 0.0];
        let (scene, view) = cases::stack(1000, opacity);
        for mut renderer in both(&scene, OFFICIAL) {
            let (found, work) = image(&mut *renderer, &view);
            let rgb = found.rgb.unwrap().pixels()[0].map(f64::from);
            let error = (0..3).map(|c| (rgb[c] - wanted[c]).abs()).fold(0.0, f64::max);
            println!("1,000 x {opacity}: {} layers, error {error:.1e}", work.blended);
            assert!(error <= 1e-4, "{opacity}: {rgb:?} for {wanted:?}");
            assert_eq!(
                (work.blended as usize, work.stopped),
                (blended, u64::from(blended < 1000)),
                "{opacity}"
            );
        }
    }
}

#[test]
fn ties_follow_the_file_on_any_number_of_threads() {
    let (scene, view) = cases::ties(3000);
    for rules in ALL_RULES {
        let style = Style { rules, ..OFFICIAL };
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| both(&scene, style).map(|mut renderer| image(&mut *renderer, &view)))
        };
        let one = on(1).map(|(image, work)| (bits(&image), work));
        for threads in [2, 3, 7] {
            assert!(
                on(threads).map(|(image, work)| (bits(&image), work)) == one,
                "{threads} threads, {rules:?}"
            );
        }
        // That both have the same order shows in the colours: neighbours in the file differ by up to 1.9 in a channel.
        let [found, wanted] = on(2).map(|(image, _)| image.rgb.unwrap());
        let pairs = found.pixels().as_flattened().iter().zip(wanted.pixels().as_flattened());
        let off = pairs.filter(|(a, b)| (*a - *b).abs() > 1e-3).count();
        assert!(off * 1000 <= found.pixels().len(), "{off} values, {rules:?}");
    }
}

#[test]
fn what_is_unsound_paints_nothing() {
    let (scene, view) = cases::askew(200);
    // one that is seen
    let i = 40;
    for rules in ALL_RULES {
        let style = Style { rules, ..OFFICIAL };
        let clean = both(&cases::without(&scene, i), style).map(|mut r| image(&mut *r, &view));
        let whole = both(&scene, style).map(|mut r| image(&mut *r, &view));
        assert!(whole[0].0.rgb != clean[0].0.rgb, "Gaussian {i} is seen");
        for (what, spoil) in cases::UNSOUND {
            let mut twin = scene.clone();
            spoil(&mut twin, i);
            for (mut renderer, (clean, alone)) in both(&twin, style).into_iter().zip(&clean) {
                let (found, work) = image(&mut *renderer, &view);
                assert!(bits(&found) == bits(clean), "{what}, {rules:?}, {}", renderer.fingerprint());
                let left_out = |work: Work| work.behind + work.degenerate;
                assert_eq!(left_out(work), left_out(*alone) + 1, "{what}, {rules:?}");
            }
        }
    }
}

#[test]
fn quaternions_of_other_lengths_turn_alike() {
    let (mut scene, view) = cases::askew(300);
    let unturned = [1.0, 0.0, 0.0, 0.0];
    scene.rotations[7] = unturned;
    scene.rotations[40] = unturned;
    let mut twin = scene.clone();
    for (i, rotation) in twin.rotations.iter_mut().enumerate() {
        let power = 2.0_f32.powi(i as i32 % 41 - 20);
        *rotation = rotation.map(|v| v * power);
    }
    twin.rotations[7] = [0.0; 4];
    twin.rotations[40] = [0.0; 4];
    let [found, wanted] =
        [twin, scene].map(|s| both(&s, OFFICIAL).map(|mut r| bits(&image(&mut *r, &view).0)));
    assert!(found == wanted);
}

#[test]
fn what_is_left_out_or_doubtful_is_counted_alike() {
    let (scene, view, wanted) = cases::counted();
    for rules in ALL_RULES {
        for mut renderer in both(&scene, Style { rules, ..OFFICIAL }) {
            let (_, work) = image(&mut *renderer, &view);
            assert_eq!(counts(work), wanted, "{rules:?}, {}", renderer.fingerprint());
        }
    }
    // and in a crowd, of which some lie across every edge
    let (scene, mut view) = cases::askew(6000);
    view.world_from_camera.translation.z = 0.5;
    for rules in ALL_RULES {
        for antialiased in [false, true] {
            let style = Style { rules, antialiased, ..OFFICIAL };
            let [cpu, reference] = both(&scene, style).map(|mut r| image(&mut *r, &view).1);
            let tested = cpu.behind > 100 && cpu.outside > 100 && cpu.affine_doubtful > 100;
            assert!(tested, "the scene is a test: {cpu:?}");
            same_counts(cpu, reference, &format!("{rules:?}, antialiased {antialiased}"));
        }
    }
}

#[test]
fn gaussians_are_kept_just_beyond_the_near_plane() {
    for rules in ALL_RULES {
        // of gsplat at the plane itself too
        let (near, at) = if rules == Rules::Gsplat { (0.01_f32, 0) } else { (0.2, 1) };
        for (z, behind) in [(near.next_down(), 1), (near, at), (near.next_up(), 0), (-1.0, 1), (0.0, 1)] {
            let (scene, view) = cases::at_depth(z);
            for mut renderer in both(&scene, Style { rules, ..OFFICIAL }) {
                let (found, work) = image(&mut *renderer, &view);
                assert_eq!(work.behind, behind, "depth {z}, {rules:?}, {}", renderer.fingerprint());
                let seen = alphas(&found).iter().any(|alpha| *alpha > 0.0);
                assert_eq!(seen, behind == 0, "depth {z}, {rules:?}, {}", renderer.fingerprint());
            }
        }
    }
}

/// Both back ends on a real scene that moves: value, luminance alone, and its rate.
#[test]
fn a_real_scene_in_32_bits_is_that_in_64() {
    let Some(path) = shared::path("data/scenes/playbot_lod3.ply") else { return };
    let Some(views) = shared::path("data/scenes/playbot.transforms.json") else { return };
    let scene = ply::read(&path);
    let key = nerfstudio::read(&views).unwrap().0.views.swap_remove(3);
    let velocity = Velocity { linear: DVec3::new(0.6, -0.3, 0.8), angular: DVec3::new(0.2, 0.7, -0.5) };
    let still = View::still(key.camera.resized(Size { width: 160, height: 90 }), key.world_from_camera);
    let view = View { velocity, ..still };
    for rules in ALL_RULES {
        let style = Style { rules, ..OFFICIAL };
        let want = Channels { luminance_rate: true, ..ALL };
        let [(found, work), (wanted, counted)] = both(&scene, style).map(|mut renderer| {
            let mut out = Rendered::default();
            let work = renderer.render(&view, want, &mut out).unwrap();
            (out, work)
        });
        same_counts(work, counted, &format!("{rules:?}"));
        let errors = |plane: fn(&Rendered) -> Vec<f32>| {
            let wanted = plane(&wanted);
            let largest = wanted.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
            let mut errors: Vec<f32> =
                plane(&found).iter().zip(&wanted).map(|(a, b)| (a - b).abs()).collect();
            errors.sort_by(f32::total_cmp);
            ([50, 99, 100].map(|percent| errors[(errors.len() - 1) * percent / 100]), largest)
        };
        let (value, _) = errors(|image| image.rgb.as_ref().unwrap().pixels().as_flattened().to_vec());
        let (rate, largest) = errors(|image| image.luminance_rate.as_ref().unwrap().pixels().to_vec());
        let rate = rate.map(|error| error / largest);
        println!("{rules:?}: value {value:?}, rate {rate:?} of the largest (50, 99, 100 %)");
        // a layer at 1/255 that one of them leaves out, or two whose depths change places: few pixels, and little
        assert!(value[1] <= 1e-4 && value[2] <= 5e-2, "{rules:?}: {value:?}");
        assert!(rate[1] <= 1e-5, "{rules:?}: {rate:?}");
    }
}

/// Whatever the lists may hold at once, down to one entry: the same picture, and the same counts.
#[test]
fn lists_in_bands_give_the_same_bits() {
    let (scene, view) = cases::askew(3000);
    for rules in ALL_RULES {
        let style = Style { rules, ..OFFICIAL };
        let mut renderer = cpu(&scene, style);
        let whole = image(&mut renderer, &view);
        assert!(whole.1.tile_pairs > 10_000, "the scene is a test: {:?}", whole.1);
        for budget in [1, 100, 3000, whole.1.tile_pairs as usize - 1, whole.1.tile_pairs as usize] {
            renderer.set_list_budget(budget);
            // twice: what the frame before left is no part of this one
            for _ in 0..2 {
                let banded = image(&mut renderer, &view);
                assert!((bits(&banded.0), banded.1) == (bits(&whole.0), whole.1), "{budget}, {rules:?}");
            }
        }
    }
}

/// Giants over a large picture have ten times the entries of the budget. Each pixel shows the first two of them.
#[test]
fn giants_over_a_large_picture() {
    let (edge, n) = (2048, 6000);
    let (scene, view) = cases::giants(n, edge);
    let mut out = Rendered::default();
    let want = Channels { luminance: true, ..Channels::default() };
    let work = cpu(&scene, OFFICIAL).render(&view, want, &mut out).unwrap();
    assert_eq!(work.tile_pairs, n as u64 * u64::from(edge / 16).pow(2));
    let pixels = u64::from(edge).pow(2);
    // 0.1 cubed is above 1e-4, its fourth power is just there: three or four layers
    assert_eq!(work.stopped, pixels);
    let grey = out.luminance.unwrap();
    let middle = grey.pixels()[(edge / 2 * edge + edge / 2) as usize];
    // 0.9 of each layer's 0.587 x 0.5 + 0.114 and, of the later ones, a little red; the first is not red
    assert!((f64::from(middle) / (0.999 * 0.4075) - 1.0).abs() < 2e-3, "{middle}");
    assert!((3 * pixels..=4 * pixels).contains(&work.blended), "{}", work.blended);
}
