//! The room: a tiled wall, a table of planks, and a chequered cloth.

use super::primitive::{
    ScenePrimitive, SurfaceFinish, TableArrangement, display_colour, table_point, turn_sine,
};
use super::shape::{SurfelCover, SurfelSpot};
use super::texture::{
    blend_colours, cloud_noise, lattice_value, mix_values, smooth_step, stripe_share, value_noise,
};
use glam::{DVec2, DVec3};

/// Side of a wall tile.
const TILE: f64 = 0.52;
/// Radius of the rings on the tiles, in tiles.
const RING: f64 = 0.35;
/// Position of the wall.
const WALL_Z: f64 = 1.55;
/// Width of the table's planks.
const PLANK: f64 = 0.45;
/// Height of the wall.
const TOP: f64 = 2.4;

pub(super) fn add_room(seed: u64, into: &mut TableArrangement) {
    add_wall(seed, into);
    add_table(seed.wrapping_add(100), into);
    add_cloth(into);
}

/// Half the width visible from the default arc, and from wide arcs. The wings begin behind the edge
/// of the sharp middle.
const NEAR: f64 = 3.4;
const INNER: f64 = 3.0;
const FAR: f64 = 9.0;

/// Sharp tiles where the default arc looks, a backing, and coarse wings beyond; rings and grout are
/// strands.
///
/// Surfels are blended in the order of their centres. The backing must be deep enough that none of
/// its wide surfels comes before the sharp ones.
fn add_wall(seed: u64, into: &mut TableArrangement) {
    let face = |left: f64, right: f64, z: f64| {
        Box::new(move |u: f64, v: f64| table_point(mix_values(left, right, u), mix_values(-0.06, TOP, v), z))
    };
    let look = move || Box::new(move |s: &SurfelSpot| tile_finish(seed, s));
    into.primitives.push(
        ScenePrimitive::covered("wall", face(-NEAR, NEAR, WALL_Z), SurfelCover::CRISP, look()).detail(0.8),
    );
    into.primitives.push(ScenePrimitive::sheet("wall", face(-NEAR, NEAR, WALL_Z + 0.1), look()).detail(0.08));
    for (left, right) in [(-FAR, -INNER), (INNER, FAR)] {
        into.primitives
            .push(ScenePrimitive::sheet("wall", face(left, right, WALL_Z + 0.3), look()).detail(0.02));
    }
    // Rings and grout lie slightly in front of the wall, because layers are blended in the order of
    // their centres.
    for i in -6..=6 {
        for j in 0..=4 {
            add_ring(table_point(f64::from(i) * TILE, f64::from(j) * TILE, WALL_Z - 0.005), into);
        }
    }
    for k in -6..=6 {
        let x = f64::from(k) * TILE;
        add_grout(table_point(x, -0.05, WALL_Z - 0.01), table_point(x, TOP, WALL_Z - 0.01), into);
    }
    for k in 0..5 {
        let height = f64::from(k) * TILE;
        add_grout(table_point(-NEAR, height, WALL_Z - 0.01), table_point(NEAR, height, WALL_Z - 0.01), into);
    }
}

/// The blue ring around a corner of tiles.
fn add_ring(centre: DVec3, into: &mut TableArrangement) {
    let circle = Box::new(move |t: f64| {
        let (sin, cos) = turn_sine(t);
        centre + RING * TILE * table_point(cos, sin, 0.0)
    });
    let blue = |_: &SurfelSpot| SurfaceFinish::glossy(display_colour(0x25_5684), 0.10);
    into.primitives.push(ScenePrimitive::strand("wall", circle, 0.055 * TILE, Box::new(blue)).detail(1.2));
}

fn add_grout(from: DVec3, to: DVec3, into: &mut TableArrangement) {
    let line = Box::new(move |t: f64| from.lerp(to, t));
    let grey = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x5a_554c));
    into.primitives.push(ScenePrimitive::strand("wall", line, 0.011, Box::new(grey)).detail(0.4));
}

/// Glazed tiles in the style of azulejos: a blue ring around each corner, and a diamond in each
/// centre.
#[expect(clippy::cast_possible_truncation, reason = "a wall of a few dozen tiles")]
fn tile_finish(seed: u64, s: &SurfelSpot) -> SurfaceFinish {
    let (a, b) = (s.position.x / TILE, -s.position.y / TILE);
    let (i, j) = (a.floor(), b.floor());
    let (x, y) = (a - i, b - j);
    let blur = s.spacing[0] / TILE;
    let corner = DVec2::new(x - x.round(), y - y.round()).length();
    let ring = smooth_band(corner, RING - 0.07, RING + 0.07, blur);
    let dot = 1.0 - smooth_step(0.13 - blur / 2.0, 0.13 + blur / 2.0, corner);
    let diamond = 1.0 - smooth_step(0.20 - blur / 2.0, 0.20 + blur / 2.0, (x - 0.5).abs() + (y - 0.5).abs());
    let tone = lattice_value(seed, i as i64, j as i64);
    let glaze = blend_colours(
        display_colour(0xe2_d6bc),
        display_colour(0xc8_baa0),
        0.6 * tone + 0.4 * cloud_noise(seed, 3.0 * a, 3.0 * b),
    );
    let blue = blend_colours(display_colour(0x1f_4a7c), display_colour(0x2f_6a92), tone);
    let painted = blend_colours(glaze, blue, ring);
    let painted = blend_colours(painted, display_colour(0xc7_7b2c), dot);
    SurfaceFinish::glossy(blend_colours(painted, display_colour(0xa8_3c28), diamond), 0.10)
}

/// 1 between `low` and `high`, 0 outside, with edges of width `blur`.
fn smooth_band(x: f64, low: f64, high: f64, blur: f64) -> f64 {
    let h = blur / 2.0;
    smooth_step(low - h, low + h, x) * (1.0 - smooth_step(high - h, high + h, x))
}

/// Sharp boards where the default arc looks, a backing, and coarse wings beyond; seams are strands.
fn add_table(seed: u64, into: &mut TableArrangement) {
    let top = |left: f64, right: f64, height: f64| {
        Box::new(move |u: f64, v: f64| {
            table_point(mix_values(left, right, u), height, mix_values(-1.8, WALL_Z, v))
        })
    };
    let look = move || Box::new(move |s: &SurfelSpot| plank_finish(seed, s));
    let grain = SurfelCover { aspect: 5.0, ..SurfelCover::CRISP };
    into.primitives.push(ScenePrimitive::covered("table", top(-NEAR, NEAR, 0.0), grain, look()).detail(0.75));
    into.primitives.push(ScenePrimitive::sheet("table", top(-NEAR, NEAR, -0.1), look()).detail(0.09));
    // The wings begin inside the edge of the sharp part, and lie deeper, so they leave no gap.
    for (left, right) in [(-FAR, -INNER), (INNER, FAR)] {
        into.primitives.push(ScenePrimitive::sheet("table", top(left, right, -0.2), look()).detail(0.02));
    }
    for k in -4..=3 {
        let z = f64::from(k) * PLANK;
        let seam = Box::new(move |t: f64| table_point(mix_values(-NEAR, NEAR, t), 0.004, z));
        let dark = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x2c_180c));
        into.primitives.push(ScenePrimitive::strand("table", seam, 0.012, Box::new(dark)).detail(0.6));
    }
}

/// Planks along x, each with its own tone and grain.
#[expect(clippy::cast_possible_truncation, reason = "a table of a dozen planks")]
fn plank_finish(seed: u64, s: &SurfelSpot) -> SurfaceFinish {
    let (x, z) = (s.position.x, s.position.z / PLANK);
    let board = z.floor();
    let own = seed.wrapping_add(1000).wrapping_add((board as i64).cast_unsigned());
    let tone = lattice_value(own, 0, 0);
    let warp = 2.2 * value_noise(own, 0.8 * x, 1.5 * z);
    let grain = cloud_noise(own, 0.9 * x + 7.0 * tone, 7.0 * z + 2.0 * warp);
    let rings = 0.5 + 0.5 * libm::sin(17.0 * (z + 0.25 * warp) + 9.0 * tone);
    let dark = smooth_step(0.2, 0.9, 0.45 * grain + 0.45 * rings + 0.25 * tone);
    SurfaceFinish::glossy(blend_colours(display_colour(0xb0_7442), display_colour(0x55_2d14), dark), 0.06)
}

/// A chequered cloth under the bowl, rotated on the table, with ripples and a hem.
fn add_cloth(into: &mut TableArrangement) {
    let look = Box::new(|s: &SurfelSpot| {
        let (a, b) = (1.96 * s.u, 1.42 * s.v);
        let (p, q) = (stripe_share(a, 0.36, 0.18, s.spacing[0]), stripe_share(b, 0.36, 0.18, s.spacing[1]));
        SurfaceFinish::matt(blend_colours(
            display_colour(0xe2_dbcc),
            display_colour(0xa0_1c1e),
            0.5 * (p + q),
        ))
    });
    into.primitives.push(ScenePrimitive::sheet("cloth", Box::new(linen_colour), look).detail(2.4).thin());
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
    for (from, to) in corners.iter().zip(&corners[1..]).map(|(&a, &b)| (a, b)) {
        let edge = Box::new(move |t: f64| {
            linen_colour(mix_values(from.0, to.0, t), mix_values(from.1, to.1, t))
                - table_point(0.0, 0.01, 0.0)
        });
        let red = |_: &SurfelSpot| SurfaceFinish::matt(display_colour(0x8c_1a1c));
        into.primitives.push(ScenePrimitive::strand("cloth", edge, 0.012, Box::new(red)).detail(1.0));
    }
}

/// The point of the cloth at `(u, v)`, with its ripples.
fn linen_colour(u: f64, v: f64) -> DVec3 {
    let (sin, cos) = turn_sine(-0.035);
    let (a, b) = (mix_values(-0.98, 0.98, u), mix_values(-0.80, 0.62, v));
    let ripple = 0.011 * libm::sin(5.0 * a + 3.5 * b) + 0.009 * libm::sin(11.0 * b - 4.0 * a);
    table_point(0.33 + cos * a - sin * b, 0.03 + ripple, -0.30 + sin * a + cos * b)
}
