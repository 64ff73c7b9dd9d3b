//! A striped vase with flowers, leaves and bare twigs.

use super::draw::SceneDraws;
use super::primitive::{
    ScenePrimitive, SurfaceFinish, TableArrangement, ball_sheet, display_colour, revolved_sheet, smooth_path,
    table_point, turn_sine,
};
use super::shape::SurfelSpot;
use super::texture::{blend_colours, mix_values, smooth_step, stripe_share, value_noise};
use glam::DVec3;

/// Position and height of the vase.
const FOOT: DVec3 = DVec3::new(-0.98, 0.0, 0.30);
const HEIGHT: f64 = 0.78;

/// Stream of the draws for the arrangement of the flowers.
const STREAM: u64 = 1 << 32;

pub(super) fn add_bouquet(seed: u64, into: &mut TableArrangement) {
    add_vase(into);
    let mut draws = SceneDraws::new(seed, STREAM);
    let heads = [
        (-0.42, 1.18, -0.06),
        (-0.16, 1.36, 0.10),
        (0.12, 1.22, -0.16),
        (0.36, 1.30, 0.06),
        (-0.62, 0.98, 0.10),
        (0.50, 1.04, -0.10),
        (-0.05, 1.06, -0.30),
    ];
    for (k, (x, h, z)) in heads.into_iter().enumerate() {
        let head = FOOT + table_point(x, h, z);
        let lean = DVec3::new(0.5 * x, -0.45, -0.75).normalize();
        add_stalk(head, into);
        if k % 3 == 1 {
            add_poppy(head, lean, &mut draws, into)
        } else {
            add_daisy(head, lean, &mut draws, into)
        }
    }
    for (x, h, z) in [(-0.74, 1.24, 0.16), (0.62, 1.44, 0.14), (0.10, 1.52, 0.2), (-0.40, 1.48, 0.16)] {
        add_twig(FOOT + table_point(x, h, z), &mut draws, into);
    }
    for (x, h, z) in [
        (-0.52, 0.80, -0.20),
        (0.46, 0.82, -0.22),
        (-0.30, 0.98, 0.2),
        (0.26, 1.00, 0.2),
        (0.64, 0.70, 0.1),
        (-0.70, 0.74, 0.0),
    ] {
        add_leaf(
            FOOT + table_point(0.10 * x, HEIGHT - 0.02, 0.2 * z),
            FOOT + table_point(x, h, z),
            seed,
            into,
        );
    }
    into.shadow("flowers", FOOT + table_point(0.0, 1.2, 0.0), 0.22);
    into.shadow("flowers", FOOT + table_point(-0.32, 1.08, 0.0), 0.16);
    into.shadow("flowers", FOOT + table_point(0.32, 1.12, 0.0), 0.16);
}

/// Foot, belly, neck and lip.
fn vase_profile(v: f64) -> (f64, f64) {
    let belly = smooth_step(0.0, 0.45, v) * (1.0 - smooth_step(0.40, 0.86, v));
    let lip = smooth_step(0.86, 1.0, v);
    (0.135 + 0.155 * belly - 0.02 * smooth_step(0.5, 0.9, v) + 0.05 * lip, HEIGHT * v)
}

fn add_vase(into: &mut TableArrangement) {
    let glaze = |s: &SurfelSpot| {
        let blur = s.spacing[1] / HEIGHT;
        let bands = stripe_share(s.v, 0.16, 0.065, blur);
        let zigzag = (s.u * 10.0 - (s.u * 10.0).round()).abs() * 2.0;
        let middle = smooth_step(0.38, 0.40, s.v) * (1.0 - smooth_step(0.60, 0.62, s.v));
        let tooth = middle * smooth_step(-0.08, 0.08, (s.v - 0.39) / 0.22 - 0.15 - 0.7 * zigzag);
        let clay = blend_colours(
            display_colour(0xd9_d3c6),
            display_colour(0x1e_5a5e),
            mix_values(bands, tooth, middle),
        );
        SurfaceFinish::glossy(clay, 0.36)
    };
    into.primitives
        .push(ScenePrimitive::sheet("vase", revolved_sheet(FOOT, vase_profile), Box::new(glaze)).detail(2.4));
    let dark = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x2a_2622));
    let inside = revolved_sheet(FOOT, |v| (0.13 + 0.03 * v, HEIGHT - 0.12 * (1.0 - v) - 0.01));
    into.primitives.push(ScenePrimitive::sheet("vase", inside, Box::new(dark)).detail(0.5));
    for (height, radius) in [(0.14, 0.18), (0.34, 0.27), (0.52, 0.2), (0.68, 0.15)] {
        into.shadow("vase", FOOT + table_point(0.0, height, 0.0), radius);
    }
}

/// A stalk from the vase's mouth to a flower's head.
fn add_stalk(head: DVec3, into: &mut TableArrangement) {
    let mouth = FOOT + table_point(0.0, HEIGHT - 0.05, 0.0);
    let way = head - mouth;
    let points = vec![
        mouth + way * DVec3::new(0.10, 0.0, 0.10),
        mouth + way * DVec3::new(0.22, 0.36, 0.22),
        mouth + way * DVec3::new(0.58, 0.72, 0.58),
        head,
    ];
    let green = |s: &SurfelSpot| {
        SurfaceFinish::matt(blend_colours(display_colour(0x3c_5a26), display_colour(0x6d_8f3c), s.u))
    };
    into.primitives
        .push(ScenePrimitive::strand("flowers", smooth_path(points), 0.010, Box::new(green)).detail(1.5));
}

/// The axes along and across a petal of a flower facing `lean`, at `turns` around it.
fn petal_axes(lean: DVec3, turns: f64) -> (DVec3, DVec3) {
    // A flower that faces straight up or down has no such axis, and any will do.
    let a = lean.cross(DVec3::Y).normalize_or(DVec3::X);
    let (sin, cos) = turn_sine(turns);
    let out = a * cos + lean.cross(a) * sin;
    (out, lean.cross(out))
}

fn add_daisy(head: DVec3, lean: DVec3, draws: &mut SceneDraws, into: &mut TableArrangement) {
    let (size, phase) = (draws.uniform(0.15, 0.19), draws.uniform(0.0, 1.0));
    for k in 0..13 {
        let (out, side) = petal_axes(lean, (f64::from(k) + phase + draws.bell(0.1)) / 13.0);
        let length = size * draws.uniform(0.9, 1.05);
        let petal = Box::new(move |u: f64, v: f64| {
            let width = 0.058 * (v * (1.25 - v)).sqrt();
            let droop = 0.25 * length * v * v - 0.04 * v;
            head + out * (0.03 + length * v) + side * (width * (2.0 * u - 1.0)) - lean * droop
        });
        let tone = draws.uniform(0.72, 1.0);
        let white = move |s: &SurfelSpot| {
            SurfaceFinish::matt(
                tone * blend_colours(
                    display_colour(0xb8_a870),
                    display_colour(0xe0_ded6),
                    smooth_step(0.0, 0.45, s.v),
                ),
            )
        };
        into.primitives.push(ScenePrimitive::sheet("flowers", petal, Box::new(white)).detail(2.2).thin());
    }
    let yolk = |s: &SurfelSpot| {
        SurfaceFinish::matt(
            display_colour(0xd8_9a14) * mix_values(0.6, 1.1, value_noise(3, 20.0 * s.u, 9.0 * s.v)),
        )
    };
    let disc = ball_sheet(head + lean * 0.012, 0.05, |_, _| 1.0);
    into.primitives.push(ScenePrimitive::sheet("flowers", disc, Box::new(yolk)).detail(2.5));
}

/// Five wide petals as a cup, dark in the middle.
fn add_poppy(head: DVec3, lean: DVec3, draws: &mut SceneDraws, into: &mut TableArrangement) {
    let phase = draws.uniform(0.0, 1.0);
    for k in 0..5 {
        let (out, side) = petal_axes(lean, (f64::from(k) + phase) / 5.0);
        let petal = Box::new(move |u: f64, v: f64| {
            let w = 2.0 * u - 1.0;
            let width = 0.255 * (v * (1.15 - v)).sqrt();
            let wave = 0.018 * libm::sin(9.0 * w + 2.0 * phase) * v;
            head + out * (0.02 + 0.17 * v) + side * (width * w) + lean * (0.11 * v * v + wave - 0.03 * w * w)
        });
        let silk = |s: &SurfelSpot| {
            let veins = value_noise(77, 16.0 * s.u, 2.0 * s.v);
            let red = blend_colours(display_colour(0xc8_2f12), display_colour(0xe0_5a1e), veins);
            SurfaceFinish::matt(blend_colours(display_colour(0x20_1018), red, smooth_step(0.10, 0.34, s.v)))
        };
        into.primitives.push(ScenePrimitive::sheet("flowers", petal, Box::new(silk)).detail(1.8).thin());
    }
    let heart = ball_sheet(head + lean * 0.03, 0.035, |_, _| 1.0);
    let dark = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x1c_1a14));
    into.primitives.push(ScenePrimitive::sheet("flowers", heart, Box::new(dark)).detail(2.5));
}

/// A bare twig with buds: the thinnest item of the scene.
fn add_twig(tip: DVec3, draws: &mut SceneDraws, into: &mut TableArrangement) {
    let mouth = FOOT + table_point(0.0, HEIGHT - 0.05, 0.0);
    let way = tip - mouth;
    let mut points = vec![mouth];
    for k in 1..5 {
        let t = f64::from(k) / 5.0;
        let crook = DVec3::new(draws.bell(0.02), draws.bell(0.015), draws.bell(0.02));
        points.push(mouth + way * t + crook);
    }
    points.push(tip);
    let bark = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x5a_4230));
    for &fork in &points[2..5] {
        let bud = fork + DVec3::new(draws.bell(0.03), -0.03 + draws.bell(0.02), draws.bell(0.03));
        let twiglet = smooth_path(vec![fork, (fork + bud) * 0.5 + table_point(0.01, 0.01, 0.0), bud]);
        into.primitives.push(ScenePrimitive::strand("flowers", twiglet, 0.005, Box::new(bark)).detail(2.0));
        let red = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x9c_3a3a));
        into.primitives.push(
            ScenePrimitive::sheet("flowers", ball_sheet(bud, 0.017, |_, _| 1.0), Box::new(red)).detail(4.0),
        );
    }
    into.primitives
        .push(ScenePrimitive::strand("flowers", smooth_path(points), 0.007, Box::new(bark)).detail(2.0));
}

/// A long leaf that bends from the vase's mouth to its tip.
fn add_leaf(from: DVec3, tip: DVec3, seed: u64, into: &mut TableArrangement) {
    let way = tip - from;
    let flat = DVec3::new(-way.z, 0.0, way.x).normalize_or(DVec3::X);
    let blade = move |u: f64, v: f64| {
        let w = 2.0 * u - 1.0;
        let width = 0.075 * libm::sin(std::f64::consts::PI * libm::pow(v.max(0.0), 0.7));
        let arch = table_point(0.0, 0.22, 0.0) * (v * (1.0 - v) * 2.0);
        from + way * v + arch + flat * (width * w) + table_point(0.0, 0.02 * w.abs(), 0.0)
    };
    let green = move |s: &SurfelSpot| {
        let rib = 1.0 - smooth_step(0.02, 0.10, (s.u - 0.5).abs());
        let veins = value_noise(seed, 3.0 * s.u, 18.0 * s.v);
        let tone = blend_colours(display_colour(0x2c_5220), display_colour(0x5f_8a38), veins);
        SurfaceFinish::glossy(blend_colours(tone, display_colour(0x9f_b96a), 0.7 * rib), 0.12)
    };
    into.primitives
        .push(ScenePrimitive::sheet("flowers", Box::new(blade), Box::new(green)).detail(1.8).thin());
}
