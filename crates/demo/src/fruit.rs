//! A bowl of fruit, and fruit that has rolled out of it.

use super::primitive::{
    ScenePrimitive, SurfaceFinish, TableArrangement, ball_sheet, display_colour, revolved_sheet, smooth_path,
    table_point, turn_sine,
};
use super::shape::SurfelSpot;
use super::texture::{blend_colours, cloud_noise, mix_values, smooth_step, stripe_share, value_noise};
use glam::DVec3;

/// Position of the bowl.
const BOWL: DVec3 = DVec3::new(0.34, -0.04, -0.02);
const BOWL_RADIUS: f64 = 0.64;
const BOWL_HEIGHT: f64 = 0.30;

pub(super) fn add_fruit(seed: u64, into: &mut TableArrangement) {
    add_bowl(into);
    add_apple("apple", BOWL + table_point(-0.27, 0.36, -0.16), 0.24, seed.wrapping_add(1), into);
    add_apple("apple", BOWL + table_point(0.04, 0.36, 0.28), 0.23, seed.wrapping_add(2), into);
    add_orange("orange", BOWL + table_point(0.25, 0.36, -0.10), 0.23, seed.wrapping_add(3), into);
    add_orange("orange", BOWL + table_point(-0.02, 0.62, -0.02), 0.20, seed.wrapping_add(4), into);
    add_lemon(table_point(-0.42, 0.145, -0.62), 0.15, seed.wrapping_add(5), into);
    add_grapes(into);
    add_cherries(into);
}

fn add_bowl(into: &mut TableArrangement) {
    // A foot ring, then a quarter of an ellipse.
    let outside = |v: f64| {
        if v < 0.12 {
            return (0.27, 0.05 * v / 0.12);
        }
        let (sin, cos) = turn_sine((v - 0.12) / 0.88 / 4.0);
        (mix_values(0.27, BOWL_RADIUS, sin), BOWL_HEIGHT - (BOWL_HEIGHT - 0.05) * cos)
    };
    let inside = |v: f64| {
        let (sin, cos) = turn_sine((1.0 - v) / 4.0);
        (0.96 * BOWL_RADIUS * sin, BOWL_HEIGHT - (BOWL_HEIGHT - 0.06) * cos)
    };
    let painted = |s: &SurfelSpot| {
        let height = (BOWL.y - s.position.y) / BOWL_HEIGHT;
        let rim = smooth_step(0.86, 0.90, height);
        let leaves = 0.5 + 0.5 * libm::sin(std::f64::consts::TAU * 22.0 * s.u + 9.0 * height);
        let frieze = smooth_step(0.50, 0.54, height)
            * (1.0 - smooth_step(0.76, 0.80, height))
            * smooth_step(0.45, 0.6, leaves);
        let white = display_colour(0xdc_dcd2);
        SurfaceFinish::glossy(blend_colours(white, display_colour(0x1f_4f7a), rim.max(frieze)), 0.34)
    };
    into.primitives
        .push(ScenePrimitive::sheet("bowl", revolved_sheet(BOWL, outside), Box::new(painted)).detail(1.5));
    let plain = |_: &SurfelSpot| SurfaceFinish::glossy(display_colour(0xb9_c4c4), 0.25);
    into.primitives
        .push(ScenePrimitive::sheet("bowl", revolved_sheet(BOWL, inside), Box::new(plain)).detail(0.5));
    let rim = |t: f64| {
        let (sin, cos) = turn_sine(t);
        BOWL + table_point(0.98 * BOWL_RADIUS * cos, BOWL_HEIGHT + 0.005, 0.98 * BOWL_RADIUS * sin)
    };
    let gold = |_: &SurfelSpot| SurfaceFinish::glossy(display_colour(0xb0_8a4a), 0.3);
    into.primitives.push(ScenePrimitive::strand("bowl", Box::new(rim), 0.018, Box::new(gold)).detail(1.2));
    for k in 0..6 {
        let (sin, cos) = turn_sine(f64::from(k) / 6.0);
        into.shadow("bowl", BOWL + table_point(0.36 * cos, 0.2, 0.36 * sin), 0.24);
    }
}

fn add_stem(item: &'static str, points: Vec<DVec3>, radius: f64, into: &mut TableArrangement) {
    let wood = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x4a_3218));
    into.primitives
        .push(ScenePrimitive::strand(item, smooth_path(points), radius, Box::new(wood)).detail(2.5));
}

fn add_apple(item: &'static str, centre: DVec3, radius: f64, seed: u64, into: &mut TableArrangement) {
    let swell = |_: f64, v: f64| {
        let dent = |d: f64| 0.22 * libm::exp(-d * d / 0.012);
        1.0 - dent(1.0 - v) - 0.5 * dent(v)
    };
    let skin = move |s: &SurfelSpot| {
        let streaks = cloud_noise(seed, 26.0 * s.u, 3.0 * s.v);
        let blush = smooth_step(0.30, 0.62, 0.55 * value_noise(seed, 2.0 * s.u, 1.5 * s.v) + 0.45 * streaks);
        let red = blend_colours(display_colour(0xb3_1f1f), display_colour(0x7d_1020), streaks);
        let skin = blend_colours(display_colour(0xd8_b03a), red, mix_values(0.35, 1.0, blush));
        let freckle = smooth_step(0.80, 0.90, value_noise(seed.wrapping_add(9), 60.0 * s.u, 34.0 * s.v));
        SurfaceFinish::glossy(blend_colours(skin, display_colour(0xe6_c070), 0.6 * freckle), 0.42)
    };
    into.primitives
        .push(ScenePrimitive::sheet(item, ball_sheet(centre, radius, swell), Box::new(skin)).detail(1.6));
    let top = centre + table_point(0.0, 0.72 * radius, 0.0);
    add_stem(
        item,
        vec![top, top + table_point(0.02, 0.08, 0.0), top + table_point(0.06, 0.16, -0.02)],
        0.012,
        into,
    );
    into.shadow(item, centre, 0.95 * radius);
}

fn add_orange(item: &'static str, centre: DVec3, radius: f64, seed: u64, into: &mut TableArrangement) {
    let peel = move |s: &SurfelSpot| {
        let pores = value_noise(seed, 46.0 * s.u, 26.0 * s.v);
        let tone = cloud_noise(seed.wrapping_add(5), 5.0 * s.u, 3.0 * s.v);
        let peel = blend_colours(display_colour(0xe8_8416), display_colour(0xc9_5c0c), tone);
        let navel = smooth_step(0.955, 0.985, s.v);
        SurfaceFinish::glossy(
            blend_colours(peel * mix_values(0.72, 1.12, pores), display_colour(0x3f_5a22), navel),
            0.26,
        )
    };
    into.primitives.push(
        ScenePrimitive::sheet(item, ball_sheet(centre, radius, |_, _| 1.0), Box::new(peel)).detail(1.6),
    );
    into.shadow(item, centre, 0.97 * radius);
}

/// A lemon on its side.
fn add_lemon(centre: DVec3, radius: f64, seed: u64, into: &mut TableArrangement) {
    let (sin, cos) = turn_sine(0.07);
    let sheet = Box::new(move |u: f64, v: f64| {
        let (s, c) = turn_sine(u);
        let along = 2.0 * v - 1.0;
        let (_, out) = turn_sine(along / 4.0);
        let nose = 0.10 * smooth_step(0.86, 1.0, along.abs()) * along.signum();
        let (a, r) = (1.35 * radius * along + nose * radius, radius * libm::pow(out.max(0.0), 0.62));
        centre + table_point(cos * a - sin * r * c, r * s, sin * a + cos * r * c)
    });
    let peel = move |s: &SurfelSpot| {
        let pores = value_noise(seed, 30.0 * s.u, 26.0 * s.v);
        let ends = smooth_step(0.42, 0.5, (s.v - 0.5).abs());
        let peel = blend_colours(display_colour(0xe2_bd2a), display_colour(0x9a_9a2e), 0.7 * ends);
        SurfaceFinish::glossy(peel * mix_values(0.78, 1.1, pores), 0.28)
    };
    into.primitives.push(ScenePrimitive::sheet("lemon", sheet, Box::new(peel)).detail(1.8));
    into.shadow("lemon", centre + table_point(0.06, 0.0, 0.03), 0.92 * radius);
    into.shadow("lemon", centre - table_point(0.06, 0.0, 0.03), 0.92 * radius);
}

/// Grapes that hang over the rim of the bowl and lie in front of it.
fn add_grapes(into: &mut TableArrangement) {
    const PLACES: [[f64; 3]; 17] = [
        [0.46, 0.40, -0.30],
        [0.55, 0.39, -0.16],
        [0.56, 0.36, -0.36],
        [0.66, 0.33, -0.24],
        [0.50, 0.30, -0.46],
        [0.64, 0.26, -0.42],
        [0.75, 0.25, -0.30],
        [0.58, 0.20, -0.56],
        [0.72, 0.17, -0.50],
        [0.84, 0.17, -0.36],
        [0.66, 0.08, -0.62],
        [0.80, 0.08, -0.54],
        [0.92, 0.08, -0.42],
        [0.56, 0.08, -0.68],
        [0.74, 0.08, -0.74],
        [0.90, 0.08, -0.66],
        [1.04, 0.08, -0.52],
    ];
    for (k, [x, h, z]) in PLACES.into_iter().enumerate() {
        let centre = table_point(BOWL.x + x, h + 0.02, z);
        // Multiples of the golden ratio spread evenly, so neighbours differ in tone.
        let tone = (k as f64 * 0.618).fract();
        let skin = move |s: &SurfelSpot| {
            let bloom = smooth_step(0.35, 0.75, value_noise(k as u64, 5.0 * s.u, 3.0 * s.v));
            let purple = blend_colours(display_colour(0x4d_1f4a), display_colour(0x6e_2f50), tone);
            SurfaceFinish::glossy(blend_colours(purple, display_colour(0x8c_7f9c), 0.35 * bloom), 0.5)
        };
        into.primitives.push(
            ScenePrimitive::sheet("grapes", ball_sheet(centre, 0.088, |_, _| 1.0), Box::new(skin))
                .detail(2.2),
        );
    }
    let vine = [[0.40, 0.50, -0.12], [0.56, 0.46, -0.28], [0.70, 0.32, -0.40], [0.78, 0.22, -0.46]];
    let points = vine.iter().map(|&[x, h, z]| table_point(BOWL.x + x, h, z)).collect();
    add_stem("grapes", points, 0.012, into);
    into.shadow("grapes", table_point(BOWL.x + 0.62, 0.22, -0.40), 0.2);
    into.shadow("grapes", table_point(BOWL.x + 0.80, 0.10, -0.55), 0.2);
}

fn add_cherries(into: &mut TableArrangement) {
    for (x, z, lean) in
        [(-0.86, -0.36, 0.10), (-0.70, -0.50, -0.04), (-0.16, -0.98, 0.12), (0.04, -1.02, -0.05)]
    {
        let centre = table_point(x, 0.075, z);
        let skin = |s: &SurfelSpot| {
            let light = stripe_share(s.u, 0.25, 0.08, s.spacing[0] / 0.4);
            SurfaceFinish::glossy(
                blend_colours(display_colour(0x86_0f1c), display_colour(0xa8_1a22), light),
                0.5,
            )
        };
        into.primitives.push(
            ScenePrimitive::sheet("cherry", ball_sheet(centre, 0.075, |_, _| 1.0), Box::new(skin))
                .detail(2.4),
        );
        let top = centre + table_point(0.0, 0.07, 0.0);
        let points =
            vec![top, top + table_point(0.4 * lean, 0.10, 0.02), top + table_point(lean, 0.21, 0.08)];
        let green = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x5c_7a2c));
        into.primitives
            .push(ScenePrimitive::strand("cherry", smooth_path(points), 0.008, Box::new(green)).detail(2.5));
        into.shadow("cherry", centre, 0.072);
    }
}
