//! Objects that move: rates and flow against differences of pictures and places, harmonics against a scene
//! that was rotated by this test, segmentation against renderings of each object alone, and events against
//! the segmentation.

#![expect(clippy::cast_possible_truncation, reason = "scenes hold 32 bits")]

use crate::support::steps::{keys, recipe, steps};
use crate::support::workspace::Workspace;
use glam::{DMat3, DQuat, DVec3};
use gs2e_event::{EventSource as _, h5};
use gs2e_image::png;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::reference::ReferenceRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer};
use gs2e_scene::blobs::{ColourBlob, ScatterDraws, blob_scene, view_ahead};
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_scene::motion::{ObjectKeyframe, ObjectPath, ObjectRecord, SceneMotion};
use gs2e_scene::{Gaussians, sh};
use serde_json::{Value, json};
use std::sync::Arc;

pub(crate) fn style(rules: RenderRules) -> RenderStyle {
    RenderStyle { rules, order: LayerOrder::Depth, antialiased: false, background: [0.1, 0.3, 0.2] }
}

pub(crate) const ALL: ChannelSet = ChannelSet {
    luminance: true,
    luminance_rate: true,
    alpha: true,
    depth: true,
    flow: true,
    segmentation: true,
    ..ChannelSet::NONE
};

/// Overlapping Gaussians of all shapes with harmonics of degree 3.
pub(crate) fn crowd(count: usize) -> Gaussians {
    let mut draws = ScatterDraws(11);
    let mut draw = |low: f64, high: f64| low + (high - low) * f64::from(draws.next());
    let blobs: Vec<ColourBlob> = (0..count)
        .map(|_| ColourBlob {
            position: [draw(-2.0, 2.0), draw(-1.5, 1.5), draw(2.0, 8.0)].map(|v| v as f32),
            deviations: [0; 3].map(|_| libm::exp(draw(-4.0, -1.0)) as f32),
            rotation: [0; 4].map(|_| draw(-1.0, 1.0) as f32),
            opacity: draw(0.05, 0.99),
            colour: [0; 3].map(|_| draw(0.0, 1.2)),
        })
        .collect();
    let mut scene = blob_scene(&blobs);
    let rest = |c: &[f32; 3], draw: &mut dyn FnMut(f64, f64) -> f64| -> Vec<[f32; 3]> {
        let rest = (1..16).map(|_| [0; 3].map(|_| draw(-0.2, 0.2) as f32));
        std::iter::once(*c).chain(rest).collect()
    };
    scene.sh = scene.sh.clone().iter().flat_map(|c| rest(c, &mut draw)).collect();
    scene.sh_degree = 3;
    scene
}

fn record(name: &str, first: usize, path: ObjectPath) -> ObjectRecord {
    ObjectRecord {
        name: name.into(),
        first,
        shift: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
        pivot: DVec3::new(0.1, 0.0, 4.0),
        path,
    }
}

/// A third of the crowd is still, a third moves on keyframes, and a third turns and drifts.
fn moving_crowd() -> Gaussians {
    let key =
        |at, shift: [f64; 3], turn: [f64; 3]| ObjectKeyframe { at, shift: shift.into(), turn: turn.into() };
    let keyframes = ObjectPath::Keyframes(vec![
        key(0.0, [0.0; 3], [0.0; 3]),
        key(0.3, [0.2, 0.1, 0.3], [0.0, 40.0, 10.0]),
        key(0.8, [0.5, -0.2, 0.1], [20.0, 90.0, 0.0]),
    ]);
    let drift =
        ObjectPath::Straight { velocity: DVec3::new(0.5, -0.3, 0.4), spin: DVec3::new(30.0, 80.0, -50.0) };
    let mut scene = crowd(240);
    let records = vec![record("keyed", 80, keyframes), record("adrift", 160, drift)];
    scene.motion = Some(Arc::new(SceneMotion::prepare(records).unwrap()));
    scene
}

pub(crate) fn moving_view() -> CameraView {
    let velocity = CameraVelocity { linear: DVec3::new(0.3, -0.2, 0.4), angular: DVec3::new(0.1, 0.3, -0.2) };
    CameraView { velocity, ..view_ahead(96, 64, 80.0).at_time(0.37) }
}

/// The view after `seconds`, to the first order of its velocity.
pub(crate) fn after(view: &CameraView, seconds: f64) -> CameraView {
    let Se3 { rotation, translation } = view.world_from_camera;
    let world_from_camera = Se3 {
        rotation: rotation * exp_vector(view.velocity.angular * seconds),
        translation: translation + rotation * view.velocity.linear * seconds,
    };
    CameraView { world_from_camera, ..*view }.at_time(view.seconds + seconds)
}

/// Median and 99 % of the differences relative to the wanted value, or to 1e-3 of the largest.
pub(crate) fn errors(pairs: &[(f64, f64)]) -> [f64; 2] {
    let largest = pairs.iter().fold(0.0, |most: f64, (_, wanted)| most.max(wanted.abs()));
    let mut errors: Vec<f64> = pairs
        .iter()
        .map(|(found, wanted)| (found - wanted).abs() / wanted.abs().max(1e-3 * largest))
        .collect();
    errors.sort_by(f64::total_cmp);
    [50, 99].map(|percent| errors[(errors.len() - 1) * percent / 100])
}

#[test]
fn rates_are_differences_of_pictures_in_which_camera_and_objects_move() {
    let (scene, view) = (Arc::new(moving_crowd()), moving_view());
    for rules in [RenderRules::Official, RenderRules::Exact, RenderRules::Gsplat, RenderRules::Soft] {
        let reference = ReferenceRenderer::new(scene.clone(), style(rules)).unwrap();
        let grey = |seconds: f64| -> Vec<f64> {
            reference.luminance(&after(&view, seconds)).unwrap().iter().map(|[value, _]| *value).collect()
        };
        // As in `crates/render/tests/rendering/rates.rs`: within 2e-7 s nothing moves by 1e-4 px, and
        // pixels whose differences over h and h/2 disagree have a jump.
        let over = |h: f64| -> Vec<f64> {
            grey(h).iter().zip(grey(-h)).map(|(after, before)| (after - before) / (2.0 * h)).collect()
        };
        let (wide, narrow) = (over(1e-7), over(5e-8));
        let largest = wide.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        let smooth: Vec<usize> =
            (0..wide.len()).filter(|i| (wide[*i] - narrow[*i]).abs() <= 1e-5 * largest).collect();
        let exact: Vec<f64> = reference.luminance(&view).unwrap().iter().map(|[_, rate]| *rate).collect();
        let mut out = RenderedImages::default();
        CpuRenderer::new(scene.clone(), style(rules)).unwrap().render(&view, ALL, &mut out).unwrap();
        let cpu = out.luminance_rate.unwrap().into_pixels();
        let [exact, cpu] = [
            errors(&smooth.iter().map(|i| (exact[*i], narrow[*i])).collect::<Vec<_>>()),
            errors(&smooth.iter().map(|i| (f64::from(cpu[*i]), narrow[*i])).collect::<Vec<_>>()),
        ];
        println!("{rules:?}: reference {exact:?}, cpu {cpu:?}, smooth {} of {}", smooth.len(), wide.len());
        assert!(smooth.len() * 100 >= wide.len() * 99, "{rules:?}");
        assert!(exact[0] <= 1e-6 && exact[1] <= 1e-4, "{rules:?}: {exact:?}");
        assert!(cpu[0] <= 1e-4 && cpu[1] <= 1e-2, "{rules:?}: {cpu:?}");
    }
}

#[test]
fn flow_is_the_way_of_points_that_move_with_their_object() {
    let (scene, view) = (Arc::new(moving_crowd()), moving_view());
    let motion = scene.motion.clone().unwrap();
    let mut renderers: [Box<dyn Renderer>; 2] = [
        Box::new(CpuRenderer::new(scene.clone(), style(RenderRules::Exact)).unwrap()),
        Box::new(ReferenceRenderer::new(scene, style(RenderRules::Exact)).unwrap()),
    ];
    for renderer in &mut renderers {
        let mut out = RenderedImages::default();
        renderer.render(&view, ALL, &mut out).unwrap();
        let (depth, flow) = (out.depth.unwrap(), out.flow.unwrap());
        let segmentation = out.segmentation.unwrap();
        let mut counts = [0; 3];
        let mut pairs = Vec::new();
        for (i, number) in segmentation.pixels().iter().enumerate() {
            let z = f64::from(depth.pixels()[i]);
            if z.is_nan() {
                assert!(flow.pixels()[i][0].is_nan());
                continue;
            }
            counts[usize::from(*number)] += 1;
            let pixel = [(i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5];
            let Se3 { rotation, translation } = view.world_from_camera;
            let world = rotation * view.camera.unproject(pixel, z) + translation;
            // The point stays at its place in the axes of its object.
            let place = |seconds: f64| {
                let Some(object) = usize::from(*number).checked_sub(1) else { return world };
                let [now, then] =
                    [view.seconds, view.seconds + seconds].map(|t| motion.objects[object].at(t).pose);
                let own = now.inverse();
                then.rotation * (own.rotation * world + own.translation) + then.translation
            };
            let seen = |seconds: f64| {
                let own = after(&view, seconds).world_from_camera.inverse();
                view.camera.project(own.rotation * place(seconds) + own.translation).unwrap()
            };
            // Over 2e-5 s, the third derivative of a place on the picture, below 1e5 px/s^3, leaves 1e-5
            // px/s.
            let h = 1e-5;
            let (before, after) = (seen(-h), seen(h));
            let wanted = [0, 1].map(|k| (after[k] - before[k]) / (2.0 * h));
            pairs.extend([0, 1].map(|k| (f64::from(flow.pixels()[i][k]), wanted[k])));
        }
        let found = errors(&pairs);
        println!("flow of {}: {found:?}, pixels {counts:?}", renderer.fingerprint());
        assert!(counts.iter().all(|count| *count > 200), "every object is seen: {counts:?}");
        // Flow is rounded to 32 bits.
        assert!(found[0] < 1e-6 && found[1] < 1e-4, "{found:?}");
    }
}

/// Coefficients of the function that has the value of `coefficients` at `R^-1 d` in direction `d`, by least
/// squares over many directions. It knows nothing of how harmonics turn, only their values.
fn rotated_harmonics(coefficients: &[[f32; 3]], turn: DQuat) -> Vec<[f32; 3]> {
    const N: usize = 16;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let directions = (0..400).map(|k| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 400.0;
        let (s, c) = libm::sincos(golden * f64::from(k));
        DVec3::new(c, s, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
    });
    let (mut normal, mut right) = ([[0.0; N]; N], [[0.0; 3]; N]);
    for d in directions {
        let basis = sh::basis_values::<f64>(3, d.to_array());
        let before = sh::basis_values::<f64>(3, (turn.conjugate() * d).to_array());
        let value = [0, 1, 2].map(|c| (0..N).map(|n| before[n] * f64::from(coefficients[n][c])).sum::<f64>());
        for i in 0..N {
            (0..N).for_each(|j| normal[i][j] += basis[i] * basis[j]);
            (0..3).for_each(|c| right[i][c] += basis[i] * value[c]);
        }
    }
    // Gauss elimination; the matrix is nearly a multiple of the identity, so no pivot is small.
    for k in 0..N {
        for i in k + 1..N {
            let factor = normal[i][k] / normal[k][k];
            (k..N).for_each(|j| normal[i][j] -= factor * normal[k][j]);
            (0..3).for_each(|c| right[i][c] -= factor * right[k][c]);
        }
    }
    for k in (0..N).rev() {
        let below: [f64; 3] = [0, 1, 2].map(|c| (k + 1..N).map(|j| normal[k][j] * right[j][c]).sum());
        let row = right[k].iter_mut().zip(below);
        row.for_each(|(value, below)| *value = (*value - below) / normal[k][k]);
    }
    right.iter().map(|row| row.map(|v| v as f32)).collect()
}

/// The scene turned and shifted: every field of it, rounded to 32 bits.
fn rotated_scene(scene: &Gaussians, turn: DQuat, shift: DVec3) -> Gaussians {
    let mut made = Gaussians { motion: None, ..scene.clone() };
    for i in 0..scene.len() {
        made.positions[i] = (turn * scene.position(i) + shift).to_array().map(|v| v as f32);
        let [w, x, y, z] = scene.rotations[i].map(f64::from);
        let turned = turn * DQuat::from_xyzw(x, y, z, w).normalize();
        made.rotations[i] = [turned.w, turned.x, turned.y, turned.z].map(|v| v as f32);
        made.sh[16 * i..16 * (i + 1)].copy_from_slice(&rotated_harmonics(scene.sh_of(i), turn));
    }
    made
}

#[test]
fn an_object_that_turned_looks_like_a_scene_whose_harmonics_were_turned() {
    // A third of a turn about the diagonal exchanges the axes, so that positions stay exact in 32 bits.
    let third = DQuat::from_mat3(&DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X));
    let about = DVec3::new(0.0, 0.0, 4.5);
    for (turn, limit) in [
        // Quaternions and coefficients are rounded at 6e-8.
        (third, 1e-6),
        // Positions are rounded at 2.4e-7 as well, which moves the edge of a splat by 1e-5 px.
        (exp_vector(DVec3::new(0.4, -1.1, 0.7)), 1e-5),
    ] {
        let mut centred = crowd(120);
        centred.positions.iter_mut().for_each(|p| p[2] -= 4.5);
        let still = rotated_scene(&centred, turn, about);
        let mut moving = centred;
        let degrees = gs2e_num::se3::rotation::log_vector(turn) * 180.0 / std::f64::consts::PI;
        let path = ObjectPath::Keyframes(vec![
            ObjectKeyframe { at: 0.0, shift: DVec3::ZERO, turn: DVec3::ZERO },
            ObjectKeyframe { at: 1.0, shift: about, turn: degrees },
        ]);
        let object = ObjectRecord { pivot: DVec3::ZERO, ..record("all", 0, path) };
        moving.motion = Some(Arc::new(SceneMotion::prepare(vec![object]).unwrap()));
        let view = view_ahead(96, 64, 80.0).at_time(1.0);
        let colours = |scene: Gaussians| {
            ReferenceRenderer::new(Arc::new(scene), style(RenderRules::Soft))
                .unwrap()
                .colours(&view)
                .unwrap()
                .0
        };
        let pairs = colours(moving).into_iter().zip(colours(still));
        let off = pairs.map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f64::max));
        let mut off: Vec<f64> = off.collect();
        off.sort_by(f64::total_cmp);
        let (most, typical) = (off[off.len() - 1], off[off.len() / 2]);
        println!("turned harmonics: at most {most:.1e}, median {typical:.1e}, limit {limit:.0e}");
        assert!(most <= limit, "{most:e} above {limit:e}");
    }
}

#[test]
fn segmentations_follow_the_order_along_each_ray() {
    // Groups in ranges of depth of their own, front to back: what is still, an object, another object.
    let depths = [4.0, 3.0, 5.5];
    let mut draws = ScatterDraws(5);
    let mut draw = |low: f64, high: f64| low + (high - low) * f64::from(draws.next());
    let blobs: Vec<ColourBlob> = (0..90)
        .map(|i| ColourBlob {
            position: [draw(-1.5, 1.5), draw(-1.0, 1.0), depths[i / 30] + draw(-0.4, 0.4)].map(|v| v as f32),
            deviations: [0.12; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity: draw(0.3, 0.98),
            colour: [0.5; 3],
        })
        .collect();
    let mut scene = blob_scene(&blobs);
    let still = ObjectPath::Straight { velocity: DVec3::ZERO, spin: DVec3::ZERO };
    let alone: Vec<Vec<f32>> = (0..3)
        .map(|group| {
            let own = Arc::new(blob_scene(&blobs[30 * group..30 * (group + 1)]));
            let mut out = RenderedImages::default();
            let want = ChannelSet { alpha: true, ..ChannelSet::NONE };
            let mut renderer = CpuRenderer::new(own, style(RenderRules::Exact)).unwrap();
            renderer.render(&view_ahead(96, 64, 80.0), want, &mut out).unwrap();
            out.alpha.unwrap().into_pixels()
        })
        .collect();
    scene.motion = Some(Arc::new(
        SceneMotion::prepare(vec![record("near", 30, still.clone()), record("far", 60, still)]).unwrap(),
    ));
    let scene = Arc::new(scene);
    let mut renderers: [Box<dyn Renderer>; 2] = [
        Box::new(CpuRenderer::new(scene.clone(), style(RenderRules::Exact)).unwrap()),
        Box::new(ReferenceRenderer::new(scene, style(RenderRules::Exact)).unwrap()),
    ];
    for renderer in &mut renderers {
        let mut out = RenderedImages::default();
        renderer.render(&view_ahead(96, 64, 80.0), ALL, &mut out).unwrap();
        let segmentation = out.segmentation.unwrap();
        let mut counts = [0; 3];
        for (i, found) in segmentation.pixels().iter().enumerate() {
            let [still, near, far] = [0, 1, 2].map(|group| f64::from(alone[group][i]));
            // The near object is in front of all, the far one behind.
            let weights = [near, far * (1.0 - near) * (1.0 - still)];
            let rest = 1.0 - weights[0] - weights[1];
            let ordered = [rest, weights[0], weights[1]];
            let wanted = (0..3).fold(0, |most, k| if ordered[k] > ordered[most] { k } else { most });
            let mut sorted = ordered;
            sorted.sort_by(f64::total_cmp);
            // Where the stop of a pixel or 32 bits could decide, nothing is asked.
            if sorted[2] - sorted[1] > 1e-3 {
                assert_eq!(usize::from(*found), wanted, "pixel {i}: {ordered:?}");
                counts[wanted] += 1;
            }
        }
        println!("masks of {}: {counts:?}", renderer.fingerprint());
        assert!(counts.iter().all(|count| *count > 50) && counts.iter().sum::<usize>() > 6000, "{counts:?}");
    }
}

#[test]
fn a_scene_whose_objects_rest_has_the_pictures_of_the_scene() {
    // No two of these depths are equal, so the order of the file decides nothing.
    let scene = crowd(200);
    let mut resting = scene.clone();
    let still = ObjectPath::Straight { velocity: DVec3::ZERO, spin: DVec3::ZERO };
    resting.motion = Some(Arc::new(
        SceneMotion::prepare(vec![record("a", 70, still.clone()), record("b", 150, still)]).unwrap(),
    ));
    let render = |scene: Gaussians| {
        let mut out = RenderedImages::default();
        let mut renderer = CpuRenderer::new(Arc::new(scene), style(RenderRules::Official)).unwrap();
        renderer.keep_to(&moving_view().camera, &[moving_view().world_from_camera]);
        renderer.render(&moving_view(), ALL, &mut out).unwrap();
        let rate = out.luminance_rate.unwrap().into_pixels();
        let values = out.luminance.unwrap().into_pixels().into_iter().chain(rate);
        values.map(f32::to_bits).collect::<Vec<u32>>()
    };
    assert!(render(scene) == render(resting));
}

/// A still camera in front of the still life, of which the orange on top of the bowl moves.
fn with_objects(outputs: &[&str]) -> Value {
    let mut value = recipe("tiny");
    value["source"]["procedural"]["gaussians"] = json!(6000);
    value["camera"] = json!({ "width": 160, "height": 90 });
    value["outputs"] = json!(outputs);
    value["trajectories"] = json!([{
        "name": "base",
        "keyframes": {
            "poses": [{ "position": [0.1, -0.7, -4.0], "look_at": [0.1, -0.5, 0.0], "up": [0, -1, 0] }],
            "frames": 61,
        },
    }]);
    value["sampling"] = json!({ "rate": 1200 });
    value["objects"] = json!([{
        "name": "orange",
        "select": { "sphere": { "centre": [0.32, -0.66, -0.04], "radius": 0.24 } },
        "path": { "straight": { "velocity": [6, -4, 0], "spin": [0, 0, 500] } },
    }]);
    value
}

#[test]
fn events_of_an_object_in_front_of_a_still_camera_lie_in_its_mask() {
    let place = Workspace::new();
    let outputs = ["events", "sharp", "depth", "flow", "segmentation"];
    let mut value = with_objects(&outputs);
    // With a tenth of them, splats have soft edges of two pixels, and 96 % of the events are within one.
    value["source"]["procedural"]["gaussians"] = json!(60_000);
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("release --to out");
    place.ok("audit out");
    place.ok("check --tree out");
    let folder = place.path("out/tiny/base");
    let masks: Vec<Vec<bool>> = (0..61)
        .map(|pose| {
            let file = std::fs::File::open(folder.join(format!("segmentation/{pose:06}.png"))).unwrap();
            let mask = png::read_rgb(std::io::BufReader::new(file)).unwrap();
            assert!(mask.pixels().iter().all(|[number, ..]| *number <= 1));
            grown(&mask.pixels().iter().map(|[number, ..]| *number == 1).collect::<Vec<_>>())
        })
        .collect();
    let stamps: Vec<i64> = std::fs::read_to_string(folder.join("timestamps_us.txt"))
        .unwrap()
        .lines()
        .map(|line| line.trim().parse().unwrap())
        .collect();
    let mut reader = h5::Reader::open(&folder.join("events.h5")).unwrap();
    let (mut chunk, mut inside, mut all) = (Vec::new(), 0_u32, 0_u32);
    while reader.next_chunk(&mut chunk).unwrap() {
        for event in &chunk {
            let pixel = usize::from(event.y) * 160 + usize::from(event.x);
            // Between two frames, the masks of both count.
            let next = stamps.partition_point(|stamp| *stamp < event.t.0 / 1000).min(60);
            inside += u32::from(masks[next][pixel] || masks[next.saturating_sub(1)][pixel]);
            all += 1;
        }
    }
    println!("{inside} of {all} events are in the mask");
    assert!(all > 1000 && f64::from(inside) >= 0.99 * f64::from(all), "{inside} of {all}");
    let places = std::fs::read_to_string(folder.join("segmentation/objects.csv")).unwrap();
    assert_eq!(places.lines().count(), 62);
    let last: Vec<&str> = places.lines().last().unwrap().split(',').collect();
    let numbers: Vec<f64> = last[3..].iter().map(|v| v.parse().unwrap()).collect();
    // Its axes turn about its middle, and move with it at the end: 6 units a second to the right.
    assert_eq!((last[0], last[1], last[2]), ("50000", "1", "orange"));
    assert!((numbers[12] - 500f64.to_radians()).abs() < 1e-9, "{last:?}");
    let report = std::fs::read_to_string(place.path("out/report.html")).unwrap();
    assert!(report.contains("objects at 25.0 ms: orange red"), "the report shows the masks");
    let card = std::fs::read_to_string(place.path("out/README.md")).unwrap();
    assert!(card.contains("segmentation/objects.csv") && card.contains("scene.segmentation(0)"));
}

/// A mask with all neighbours of its pixels.
fn grown(mask: &[bool]) -> Vec<bool> {
    let at = |x: i64, y: i64| {
        (0..160).contains(&x) && (0..90).contains(&y) && mask[usize::try_from(y * 160 + x).unwrap()]
    };
    let near = |i: i64| (-1..=1).any(|dy| (-1..=1).any(|dx| at(i % 160 + dx, i / 160 + dy)));
    (0..160 * 90).map(near).collect()
}

#[test]
fn objects_change_renderings_alone_and_absent_ones_nothing() {
    let place = Workspace::new();
    let mut value = recipe("tiny");
    value["outputs"] = json!(["events", "blur"]);
    value["blur"] = json!({ "frames": 3 });
    value["trajectories"] = json!([{ "name": "base", "refine": { "factor": 2 } }]);
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("build");
    let plain = keys(&place, "recipes");
    value["objects"] = json!([]);
    place.write("recipes/tiny.yaml", value.to_string());
    assert_eq!(keys(&place, "recipes"), plain);
    value["objects"] = json!([{
        "name": "bowl",
        "select": { "box": { "low": [-0.3, -0.7, -0.7], "high": [1, 0, 0.7] } },
        "path": { "orbit": { "centre": [0.34, 0, 0], "axis": [0, -1, 0], "degrees_per_second": 90 } },
    }]);
    place.write("recipes/tiny.yaml", value.to_string());
    let stale: Vec<String> = steps(&place, "recipes")
        .into_iter()
        .filter(|(_, step)| step.action != "keep")
        .map(|(name, _)| name)
        .collect();
    assert_eq!(stale, ["tiny/base/blur", "tiny/base/checks", "tiny/base/events", "tiny/objects"]);
    place.ok("build");
    value["objects"][0]["path"]["orbit"]["degrees_per_second"] = json!(45);
    place.write("recipes/tiny.yaml", value.to_string());
    let why = place.ok("why tiny/objects").stdout;
    assert!(why.contains("degrees_per_second"), "{why}");
}

#[test]
fn frames_of_a_tolerance_follow_objects_too() {
    let place = Workspace::new();
    let frames = |objects: Value| {
        let mut value = with_objects(&["events"]);
        value["objects"] = objects;
        value["sampling"] = json!({ "rate": 200, "tolerance": 0.05 });
        value["trajectories"][0]["keyframes"]["frames"] = json!(11);
        place.write("recipes/tiny.yaml", value.to_string());
        place.ok("build");
        let simulation = &steps(&place, "recipes")["tiny/base/events"].outputs["simulation.json"];
        let record: Value = serde_json::from_str(&std::fs::read_to_string(simulation).unwrap()).unwrap();
        println!("{} frames, achieved {}", record["chosen"]["frames"], record["chosen"]["achieved"]);
        assert!(record["chosen"]["achieved"].as_f64().unwrap() <= 0.05);
        record["chosen"]["frames"].as_u64().unwrap()
    };
    // The camera rests, so the fewest frames will do, unless a large part of the picture moves.
    let still = frames(json!([]));
    let moving = frames(json!([{
        "name": "table",
        "select": { "box": { "low": [-2, -2, -1], "high": [2, 0.2, 1] } },
        "path": { "straight": { "velocity": [6, -4, 0], "spin": [0, 0, 200] } },
    }]));
    assert!(still <= 9 && moving >= 3 * still, "{still}, {moving}");
}

#[test]
fn an_object_that_passes_through_the_near_plane_is_reported() {
    let place = Workspace::new();
    let mut value = with_objects(&["sharp"]);
    // It passes the camera, 4 units away, in 49 ms.
    value["objects"][0]["path"] = json!({ "straight": { "velocity": [-4, 0, -80] } });
    place.write("recipes/tiny.yaml", value.to_string());
    let said = place.ok("build").stderr;
    let told = "object orange reaches the near plane, 0.20 units before the camera, at ";
    let count: usize =
        said.split_once(told).and_then(|(_, rest)| rest.split(' ').next()?.parse().ok()).unwrap_or_default();
    // Its radius of 0.2 units and the plane meet for about 5 ms, at 1,200 poses a second.
    assert!((3..=9).contains(&count), "{said}");
}

#[test]
fn checks_of_a_release_explain_what_is_still_and_leave_objects_out() {
    let place = Workspace::new();
    let mut value = with_objects(&["events", "sharp", "depth", "flow", "segmentation"]);
    value["trajectories"] = json!([{ "name": "base", "refine": { "factor": 8 } }]);
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("release --to out");
    let said = place.ok("check --tree out").stdout;
    let sheet = std::fs::read_to_string(place.path("out/DATASHEET.md")).unwrap();
    assert!(sheet.contains("Camera trajectories through scenes of 3D Gaussians"), "{sheet}");
    assert!(sheet.contains("Some scenes move or change, and one camera moves through them"), "{sheet}");
    let found = |name: &str| said.lines().find(|line| line.contains(name)).unwrap_or_default().to_owned();
    assert!(found("flow_projection").starts_with("pass"), "{said}");
    assert!(found("base#order: objects move on paths of their own").starts_with("not run"), "{said}");
    // Without masks nothing tells the pixels of the object from the others.
    value["outputs"] = json!(["events", "sharp", "depth", "flow"]);
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("release --to out");
    let said = place.ok("check --tree out").stdout;
    assert!(said.lines().any(|l| l.starts_with("not run") && l.contains("flow_projection")), "{said}");
}

#[test]
fn faulty_objects_are_named() {
    let place = Workspace::new();
    let refused = |change: &dyn Fn(&mut Value), verb: &str, code: i32, because: &str| {
        let mut value = with_objects(&["sharp"]);
        change(&mut value);
        place.write("recipes/tiny.yaml", value.to_string());
        let ended = place.gs2e(verb);
        assert_eq!(ended.code, code, "{because}: {}", ended.stderr);
        assert!(ended.stderr.contains(because), "{because}: {}", ended.stderr);
    };
    let plan = |change: &dyn Fn(&mut Value), because: &str| refused(change, "plan", 2, because);
    plan(&|v| v["objects"][0]["name"] = json!("a/b"), "which has more than one part");
    plan(&|v| v["objects"][0]["slect"] = json!({}), "did you mean \"select\"?");
    plan(&|v| v["objects"][0]["scene"] = json!({ "path": "cup.ply" }), "has both `select` and `scene`");
    plan(
        &|v| {
            let one = v["objects"][0].clone();
            v["objects"].as_array_mut().unwrap().push(one);
        },
        "is \"orange\", the name of an earlier object",
    );
    plan(
        &|v| v["objects"][0]["select"] = json!({ "box": { "low": [0, 0, 0], "high": [1, -1, 1] } }),
        "is empty: `low` is above `high`",
    );
    plan(
        &|v| v["objects"][0]["path"] = json!({ "keyframes": [{ "at": 0 }, { "at": 0 }] }),
        "a keyframe at 0 s follows one at 0 s, wanted a later one",
    );
    plan(
        &|v| {
            v["outputs"] = json!(["segmentation"]);
            v["objects"] = json!([]);
        },
        "the output segmentation needs objects",
    );
    let build = |change: &dyn Fn(&mut Value), because: &str| refused(change, "build", 1, because);
    build(
        &|v| v["objects"][0]["select"]["sphere"]["centre"] = json!([90, 0, 0]),
        "object orange selects none of the 6000 Gaussians of the scene",
    );
    build(
        &|v| {
            let mut other = v["objects"][0].clone();
            other["name"] = json!("fruit");
            v["objects"].as_array_mut().unwrap().push(other);
        },
        "objects orange and fruit share",
    );
    build(
        &|v| {
            v["objects"][0]["path"] =
                json!({ "keyframes": [{ "at": 0 }, { "at": 0.01, "shift": [1, 0, 0] }] })
        },
        "object orange has keyframes from 0 to 0.01 s, found a view at",
    );
    place.write("recipes/ids.txt", "5\n6000\n");
    build(
        &|v| v["objects"][0]["select"] = json!({ "ids": "ids.txt" }),
        "ids.txt: line 2: found `6000`, wanted a number from 0 to 5999",
    );
}
