//! Scenes that change with time: rates and flow against differences of pictures and places, closed forms,
//! files that this test writes, builds, and what is refused.

mod builds;
mod files;

use crate::objects::{ALL, after, crowd, errors, moving_view, style};
use glam::DVec3;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::reference::ReferenceRenderer;
use gs2e_render::{ChannelSet, RenderRules, RenderedImages, Renderer};
use gs2e_scene::Gaussians;
use gs2e_scene::blobs::{ColourBlob, ScatterDraws, blob_scene, view_ahead};
use gs2e_scene::camera::view::CameraView;
use gs2e_scene::dynamic::{SceneSpan, SceneTime, SplatCourse, SplatFrames, SplatTrack};
use std::sync::Arc;

/// The scene's time passes 1.3 times as fast as the trajectory's; at 0.37 s, `u` is 0.2905.
const TIME: SceneTime = SceneTime { start: 0.1, speed: 1.3, span: SceneSpan::Duration(2.0) };

fn draws(seed: u64) -> impl FnMut(f64, f64) -> f64 {
    let mut draws = ScatterDraws(seed);
    move |low, high| low + (high - low) * f64::from(draws.next())
}

#[expect(clippy::cast_possible_truncation, reason = "scenes hold 32 bits")]
fn single(value: f64) -> f32 {
    value as f32
}

/// Tracks of all degrees about moments within and outside of the scene.
fn tracks(count: usize) -> Vec<SplatTrack> {
    let mut draw = draws(23);
    (0..count)
        .map(|_| SplatTrack {
            motion: [[0; 3]; 3].map(|power| power.map(|_| single(draw(-0.8, 0.8)))),
            omega: [0; 4].map(|_| single(draw(-2.0, 2.0))),
            centre: single(draw(-0.3, 1.1)),
            log_width: single(draw(-1.5, 0.5)),
        })
        .collect()
}

/// Overlapping Gaussians of all shapes that move, turn and fade.
fn tracked_crowd() -> Gaussians {
    crowd(240).with_dynamics(TIME, SplatCourse::Tracks(tracks(240)))
}

/// The same as a sequence of five frames in which every value changes.
fn framed_crowd() -> Gaussians {
    let mut draw = draws(31);
    let base = crowd(240);
    let frames = (0..5).map(|_| {
        let mut frame = base.clone();
        let mut shift = |value: &mut f32, by: f64| *value += single(draw(-by, by));
        frame.positions.iter_mut().flatten().for_each(|v| shift(v, 0.15));
        frame.log_scales.iter_mut().flatten().for_each(|v| shift(v, 0.3));
        frame.rotations.iter_mut().flatten().for_each(|v| shift(v, 0.3));
        frame.opacity_logits.iter_mut().for_each(|v| shift(v, 0.7));
        frame.sh.iter_mut().flatten().for_each(|v| shift(v, 0.1));
        frame
    });
    let frames = SplatFrames::new(frames.collect()).unwrap();
    let time = SceneTime { span: SceneSpan::Rate(4.0), ..TIME };
    frames.frames()[0].clone().with_dynamics(time, SplatCourse::Frames(frames))
}

#[test]
fn rates_are_differences_of_pictures_in_which_camera_and_gaussians_move() {
    let view = moving_view();
    for (name, scene) in [("tracks", tracked_crowd()), ("sequence", framed_crowd())] {
        let scene = Arc::new(scene);
        for (rules, antialiased) in [
            (RenderRules::Official, false),
            (RenderRules::Exact, false),
            (RenderRules::Gsplat, true),
            (RenderRules::Soft, false),
        ] {
            let style = gs2e_render::RenderStyle { antialiased, ..style(rules) };
            let reference = ReferenceRenderer::new(scene.clone(), style).unwrap();
            let grey = |seconds: f64| -> Vec<f64> {
                reference.luminance(&after(&view, seconds)).unwrap().iter().map(|[value, _]| *value).collect()
            };
            // As for objects: within 2e-7 s nothing moves by 1e-4 px, and pixels whose differences over h and
            // h/2 disagree have a jump.
            let over = |h: f64| -> Vec<f64> {
                grey(h).iter().zip(grey(-h)).map(|(after, before)| (after - before) / (2.0 * h)).collect()
            };
            let (wide, narrow) = (over(1e-7), over(5e-8));
            let largest = wide.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
            let smooth: Vec<usize> =
                (0..wide.len()).filter(|i| (wide[*i] - narrow[*i]).abs() <= 1e-5 * largest).collect();
            let exact: Vec<f64> = reference.luminance(&view).unwrap().iter().map(|[_, rate]| *rate).collect();
            let mut out = RenderedImages::default();
            CpuRenderer::new(scene.clone(), style).unwrap().render(&view, ALL, &mut out).unwrap();
            let cpu = out.luminance_rate.unwrap().into_pixels();
            let [exact, cpu] = [
                errors(&smooth.iter().map(|i| (exact[*i], narrow[*i])).collect::<Vec<_>>()),
                errors(&smooth.iter().map(|i| (f64::from(cpu[*i]), narrow[*i])).collect::<Vec<_>>()),
            ];
            println!(
                "{name}, {rules:?}: reference {exact:?}, cpu {cpu:?}, smooth {} of {}",
                smooth.len(),
                wide.len()
            );
            assert!(smooth.len() * 100 >= wide.len() * 99, "{name} {rules:?}");
            assert!(exact[0] <= 1e-6 && exact[1] <= 1e-4, "{name} {rules:?}: {exact:?}");
            assert!(cpu[0] <= 1e-4 && cpu[1] <= 1e-2, "{name} {rules:?}: {cpu:?}");
        }
    }
}

/// The pictures of the CPU are those of the reference, in whatever order moments are rendered.
#[test]
fn pictures_of_a_moment_do_not_depend_on_those_before() {
    for scene in [tracked_crowd(), framed_crowd()] {
        let scene = Arc::new(scene);
        let mut cpu = CpuRenderer::new(scene.clone(), style(RenderRules::Exact)).unwrap();
        let want = ChannelSet { rgb: true, ..ALL };
        let picture = |renderer: &mut dyn Renderer, seconds: f64| {
            let mut out = RenderedImages::default();
            renderer.render(&moving_view().at_time(seconds), want, &mut out).unwrap();
            out.rgb.unwrap().into_pixels()
        };
        let first: Vec<_> = [0.0, 0.5].map(|t| picture(&mut cpu, t)).to_vec();
        assert!(first[0] != first[1]);
        // A promise of poses says nothing of when, so it leaves nothing out.
        cpu.keep_to(&moving_view().camera, &[moving_view().world_from_camera]);
        let again: Vec<_> = [0.5, 0.0].map(|t| picture(&mut cpu, t)).to_vec();
        assert!(first[0] == again[1] && first[1] == again[0]);
        let mut reference = ReferenceRenderer::new(scene, style(RenderRules::Exact)).unwrap();
        let wanted = picture(&mut reference, 0.5);
        let off = first[1]
            .iter()
            .zip(&wanted)
            .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max));
        let mut off: Vec<f32> = off.collect();
        off.sort_by(f32::total_cmp);
        println!("cpu and reference: at most {:e}, median {:e}", off[off.len() - 1], off[off.len() / 2]);
        // 32 bits of a position of 8 units move a splat by 1e-5 px; a pixel at a cut of alpha jumps by a grey
        // step.
        assert!(off[off.len() * 99 / 100] < 1e-4 && off[off.len() - 1] < 0.03);
    }
}

/// Blobs far apart, each with a track of its own.
fn scattered() -> (Gaussians, Vec<SplatTrack>) {
    let mut draw = draws(5);
    let blobs: Vec<ColourBlob> = (0..12)
        .map(|i| ColourBlob {
            position: [
                single(-1.6 + f64::from(i % 4) * 1.05),
                single(-1.0 + f64::from(i / 4)),
                single(draw(3.5, 4.5)),
            ],
            deviations: [0.1; 3],
            opacity: 0.9,
            colour: [0.8, 0.6, 0.4],
            ..ColourBlob::default()
        })
        .collect();
    let tracks = (0..12)
        .map(|_| SplatTrack {
            motion: [[0; 3]; 3].map(|power| power.map(|_| single(draw(-0.2, 0.2)))),
            centre: single(draw(0.2, 0.4)),
            ..SplatTrack::STILL
        })
        .collect();
    (blob_scene(&blobs), tracks)
}

#[test]
fn flow_is_the_way_of_points_that_move_with_their_gaussian() {
    let (scene, tracks) = scattered();
    let view = moving_view();
    let changing = Arc::new(scene.clone().with_dynamics(TIME, SplatCourse::Tracks(tracks.clone())));
    // The place of Gaussian `i`, from its file's numbers alone.
    let place = |i: usize, seconds: f64| {
        let d = (0.1 + 1.3 * seconds) / 2.0 - f64::from(tracks[i].centre);
        let power = |k: usize| DVec3::from_array(tracks[i].motion[k].map(f64::from)) * d.powi([1, 2, 3][k]);
        scene.position(i) + power(0) + power(1) + power(2)
    };
    let mut renderers: [Box<dyn Renderer>; 2] = [
        Box::new(CpuRenderer::new(changing.clone(), style(RenderRules::Exact)).unwrap()),
        Box::new(ReferenceRenderer::new(changing, style(RenderRules::Exact)).unwrap()),
    ];
    for renderer in &mut renderers {
        let mut out = RenderedImages::default();
        renderer.render(&view, ChannelSet { drift: true, ..ALL }, &mut out).unwrap();
        let (depth, flow, drift) = (out.depth.unwrap(), out.flow.unwrap(), out.drift.unwrap());
        let mut pairs = Vec::new();
        let seen_from = |view: &CameraView, point: DVec3| {
            let own = view.world_from_camera.inverse();
            view.camera.project(own.rotation * point + own.translation)
        };
        for i in 0..12 {
            let Some([x, y]) = seen_from(&view, place(i, view.seconds)) else { continue };
            if !(2.0..94.0).contains(&x) || !(2.0..62.0).contains(&y) {
                continue;
            }
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "it is within the picture"
            )]
            let index = y as usize * 96 + x as usize;
            let pixel = [x.floor() + 0.5, y.floor() + 0.5];
            let z = f64::from(depth.pixels()[index]);
            let world = view.world_from_camera.rotation * view.camera.unproject(pixel, z)
                + view.world_from_camera.translation;
            // The point of the pixel keeps its place beside the mean.
            let seen = |seconds: f64| {
                let moved = place(i, view.seconds + seconds) - place(i, view.seconds);
                seen_from(&after(&view, seconds), world + moved).unwrap()
            };
            // Over 2e-5 s, the third derivative of a place on the picture, below 1e5 px/s^3, leaves 1e-5
            // px/s.
            let h = 1e-5;
            let (before, after) = (seen(-h), seen(h));
            let found = flow.pixels()[index];
            pairs.extend([0, 1].map(|k| (f64::from(found[k]), (after[k] - before[k]) / (2.0 * h))));
            assert!(drift.pixels()[index].iter().any(|v| v.abs() > 0.0));
        }
        let found = errors(&pairs);
        println!("flow of {}: {found:?} of {} numbers", renderer.fingerprint(), pairs.len());
        assert!(pairs.len() >= 16, "most blobs are seen: {}", pairs.len());
        // Flow, and the velocities that it is made of, are rounded to 32 bits.
        assert!(found[0] < 1e-6 && found[1] < 1e-4, "{found:?}");
    }
}

/// A round Gaussian on the optical axis that moves sideways, with the picture by the formula of the
/// projection.
#[test]
fn a_moving_gaussian_is_where_its_track_says() {
    let blob = ColourBlob {
        position: [0.0, 0.0, 4.0],
        deviations: [0.2; 3],
        opacity: 0.8,
        colour: [0.9, 0.5, 0.1],
        ..ColourBlob::default()
    };
    let track =
        SplatTrack { motion: [[0.5, 0.0, 0.0], [-0.75, 0.0, 0.0], [0.25, 0.0, 0.0]], ..SplatTrack::STILL };
    let scene = Arc::new(blob_scene(&[blob]).with_dynamics(TIME, SplatCourse::Tracks(vec![track])));
    for seconds in [0.0, 0.6, 1.4] {
        let view = view_ahead(96, 64, 80.0).at_time(seconds);
        let d = (0.1 + 1.3 * seconds) / 2.0;
        let x = 0.5 * d - 0.75 * d * d + 0.25 * d * d * d;
        let slope = x / 4.0;
        let spread = (80.0 * 0.2 / 4.0_f64).powi(2);
        // `J J^T` of the projection at slope `u` is diagonal, as the other slope is 0.
        let variance = [spread * (1.0 + slope * slope) + 0.3, spread + 0.3];
        let mean = [view.camera.cx + 80.0 * slope, view.camera.cy];
        let wanted = |i: usize| {
            let at = [(i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5];
            let power: f64 = (0..2).map(|k| (at[k] - mean[k]).powi(2) / variance[k]).sum();
            let alpha = 0.8 * (-0.5 * power).exp();
            let alpha = if alpha < 1.0 / 255.0 { 0.0 } else { alpha };
            let grey = |[r, g, b]: [f64; 3]| 0.299 * r + 0.587 * g + 0.114 * b;
            alpha * grey([0.9, 0.5, 0.1]) + (1.0 - alpha) * grey([0.1, 0.3, 0.2])
        };
        let exact = ReferenceRenderer::new(scene.clone(), style(RenderRules::Exact)).unwrap();
        let exact = exact.luminance(&view).unwrap();
        let mut out = RenderedImages::default();
        let want = ChannelSet { luminance: true, ..ChannelSet::NONE };
        CpuRenderer::new(scene.clone(), style(RenderRules::Exact))
            .unwrap()
            .render(&view, want, &mut out)
            .unwrap();
        let cpu = out.luminance.unwrap().into_pixels();
        // A pixel at the cut of alpha may be on either side of it. Colours and scales are stored in 32 bits.
        let off = |found: &dyn Fn(usize) -> f64| {
            let mut off: Vec<f64> = (0..96 * 64).map(|i| (found(i) - wanted(i)).abs()).collect();
            off.sort_by(f64::total_cmp);
            off[off.len() - 5]
        };
        let (exact, cpu) = (off(&|i| exact[i][0]), off(&|i| f64::from(cpu[i])));
        println!("a moving Gaussian at {seconds} s: reference {exact:e}, cpu {cpu:e}");
        assert!(exact < 1e-6 && cpu < 1e-5, "{exact:e} {cpu:e}");
    }
}

/// In the middle of a fading Gaussian, the luminance is `o(t) c + (1 - o(t)) b`.
#[test]
fn a_fading_gaussian_has_the_opacity_and_the_rate_of_the_closed_form() {
    let blob = ColourBlob {
        // The middle of pixel (48, 32) at depth 4.
        position: [0.5 / 80.0 * 4.0, 0.5 / 80.0 * 4.0, 4.0],
        deviations: [0.2; 3],
        opacity: 0.8,
        colour: [0.9, 0.5, 0.1],
        ..ColourBlob::default()
    };
    let track = SplatTrack { centre: 0.5, log_width: single(libm::log(0.25)), ..SplatTrack::STILL };
    let scene = Arc::new(blob_scene(&[blob]).with_dynamics(TIME, SplatCourse::Tracks(vec![track])));
    let grey = |[r, g, b]: [f64; 3]| 0.299 * r + 0.587 * g + 0.114 * b;
    let contrast = grey([0.9, 0.5, 0.1]) - grey([0.1, 0.3, 0.2]);
    for seconds in [0.2, 0.5, 0.9, 1.2] {
        let view = view_ahead(96, 64, 80.0).at_time(seconds);
        assert!((view.camera.cx - 48.0).abs() < 1e-12 && (view.camera.cy - 32.0).abs() < 1e-12);
        let share = ((0.1 + 1.3 * seconds) / 2.0 - 0.5) / 0.25;
        let opacity = 0.8 * (-share * share).exp();
        let wanted = [
            grey([0.1, 0.3, 0.2]) + opacity * contrast,
            // The scene's own time passes at 1.3 / 2 per second.
            -2.0 * share / 0.25 * opacity * contrast * 0.65,
        ];
        let pixel = 32 * 96 + 48;
        let exact = ReferenceRenderer::new(scene.clone(), style(RenderRules::Exact)).unwrap();
        let exact = exact.luminance(&view).unwrap()[pixel];
        let mut out = RenderedImages::default();
        CpuRenderer::new(scene.clone(), style(RenderRules::Exact))
            .unwrap()
            .render(&view, ALL, &mut out)
            .unwrap();
        let cpu = [out.luminance.unwrap(), out.luminance_rate.unwrap()]
            .map(|image| f64::from(image.pixels()[pixel]));
        for k in 0..2 {
            // The stored numbers are rounded at 6e-8, and the width enters twice.
            assert!(
                (exact[k] - wanted[k]).abs() < 1e-6 * wanted[k].abs().max(0.1),
                "{exact:?} for {wanted:?}"
            );
            assert!((cpu[k] - wanted[k]).abs() < 1e-5 * wanted[k].abs().max(0.1), "{cpu:?} for {wanted:?}");
        }
    }
}

#[test]
fn views_outside_of_the_scenes_time_are_named() {
    let scene = Arc::new(tracked_crowd());
    let mut renderers: [Box<dyn Renderer>; 2] = [
        Box::new(CpuRenderer::new(scene.clone(), style(RenderRules::Exact)).unwrap()),
        Box::new(ReferenceRenderer::new(scene, style(RenderRules::Exact)).unwrap()),
    ];
    for renderer in &mut renderers {
        let mut out = RenderedImages::default();
        let mut at =
            |seconds: f64| renderer.render(&view_ahead(96, 64, 80.0).at_time(seconds), ALL, &mut out);
        assert!(at(1.9 / 1.3).is_ok());
        let late = at(1.5).unwrap_err().to_string();
        assert!(
            late.contains("the scene lasts from 0 to 2 s, found a view at 2.05")
                && late.contains("at a speed of 1.3"),
            "{late}"
        );
    }
}
