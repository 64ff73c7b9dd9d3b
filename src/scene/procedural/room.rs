//! The room: a tiled wall, a table of planks, and a chequered cloth.

use super::draw::{clouds, lattice, mix, noise, step, stripes};
use super::light::blend;
use super::object::{Arrangement, Finish, Part, at, rgb};
use super::shape::Spot;
use glam::DVec2;

/// Side of a wall tile.
const TILE: f64 = 0.46;
/// Where the wall stands.
const WALL_Z: f64 = 1.55;

pub(super) fn add(seed: u64, into: &mut Arrangement) {
    wall(seed, into);
    table(seed.wrapping_add(100), into);
    cloth(into);
}

fn wall(seed: u64, into: &mut Arrangement) {
    let face = Box::new(|u: f64, v: f64| at(mix(-4.6, 4.6, u), mix(-0.1, 2.5, v), WALL_Z));
    into.parts.push(Part::sheet("wall", face, Box::new(move |s| tile(seed, s))).detail(0.62));
    let grout = rgb(0x4a_4640);
    for k in -10..=10 {
        let x = f64::from(k) * TILE;
        let path = Box::new(move |t: f64| at(x, mix(-0.05, 2.5, t), WALL_Z - 0.012));
        into.parts
            .push(Part::strand("wall", path, 0.011, Box::new(move |_| Finish::matt(grout))).detail(0.9));
    }
    for k in 0..6 {
        let height = f64::from(k) * TILE;
        let path = Box::new(move |t: f64| at(mix(-4.6, 4.6, t), height, WALL_Z - 0.012));
        into.parts
            .push(Part::strand("wall", path, 0.011, Box::new(move |_| Finish::matt(grout))).detail(0.9));
    }
}

/// Glazed tiles in the manner of azulejos: a blue ring about each corner, a diamond in each middle.
#[expect(clippy::cast_possible_truncation, reason = "a wall of a few dozen tiles")]
fn tile(seed: u64, s: &Spot) -> Finish {
    let (a, b) = (s.position.x / TILE, -s.position.y / TILE);
    let (i, j) = (a.floor(), b.floor());
    let (x, y) = (a - i, b - j);
    let blur = s.spacing[0] / TILE;
    let corner = DVec2::new(x - x.round(), y - y.round()).length();
    let ring = band(corner, 0.30, 0.44, blur);
    let dot = 1.0 - step(0.13 - blur / 2.0, 0.13 + blur / 2.0, corner);
    let diamond = 1.0 - step(0.19 - blur / 2.0, 0.19 + blur / 2.0, (x - 0.5).abs() + (y - 0.5).abs());
    let tone = lattice(seed, i as i64, j as i64);
    let glaze = blend(rgb(0xe6_dcc4), rgb(0xcf_c2a4), 0.7 * tone + 0.3 * clouds(seed, 3.0 * a, 3.0 * b));
    let blue = blend(rgb(0x2c_5b8c), rgb(0x3f_7a9e), tone);
    let painted = blend(glaze, blue, ring);
    let painted = blend(painted, rgb(0xc7_7b2c), dot);
    Finish::glossy(blend(painted, rgb(0xb5_4a32), diamond), 0.10)
}

/// One between `low` and `high`, zero outside, with edges as wide as `blur`.
fn band(x: f64, low: f64, high: f64, blur: f64) -> f64 {
    let h = blur / 2.0;
    step(low - h, low + h, x) * (1.0 - step(high - h, high + h, x))
}

fn table(seed: u64, into: &mut Arrangement) {
    let top = Box::new(|u: f64, v: f64| at(mix(-4.2, 4.2, u), 0.0, mix(-1.9, WALL_Z, v)));
    into.parts.push(Part::sheet("table", top, Box::new(move |s| plank(seed, s))).detail(0.75));
}

/// Planks along x, each with its own tone and grain.
#[expect(clippy::cast_possible_truncation, reason = "a table of a dozen planks")]
fn plank(seed: u64, s: &Spot) -> Finish {
    const WIDTH: f64 = 0.5;
    let (x, z) = (s.position.x, s.position.z / WIDTH);
    let board = z.floor();
    let own = seed.wrapping_add(1000).wrapping_add((board as i64).cast_unsigned());
    let tone = lattice(own, 0, 0);
    let warp = 2.2 * noise(own, 0.8 * x, 1.5 * z);
    let grain = clouds(own, 1.1 * x + 7.0 * tone, 9.0 * z + 3.0 * warp);
    let rings = 0.5 + 0.5 * libm::sin(22.0 * (z + 0.22 * warp) + 9.0 * tone);
    let wood = blend(rgb(0x9c_6436), rgb(0x5e_3419), 0.55 * grain + 0.30 * rings + 0.25 * tone);
    let seam = stripes(z + 0.03, 1.0, 0.06, s.spacing[1] / WIDTH);
    Finish::glossy(blend(wood, rgb(0x24_130a), 0.85 * seam), 0.06)
}

/// A cloth under the bowl, turned on the table, with ripples.
fn cloth(into: &mut Arrangement) {
    let (sin, cos) = super::object::turn(-0.035);
    let sheet = Box::new(move |u: f64, v: f64| {
        let (a, b) = (mix(-0.98, 0.98, u), mix(-0.80, 0.62, v));
        let ripple = 0.011 * libm::sin(5.0 * a + 3.5 * b) + 0.009 * libm::sin(11.0 * b - 4.0 * a);
        at(0.33 + cos * a - sin * b, 0.03 + ripple, -0.30 + sin * a + cos * b)
    });
    let look = Box::new(|s: &Spot| {
        let (a, b) = (1.96 * s.u, 1.42 * s.v);
        let (p, q) = (stripes(a, 0.28, 0.14, s.spacing[0]), stripes(b, 0.28, 0.14, s.spacing[1]));
        let (linen, red) = (rgb(0xe8_e2d6), rgb(0xa8_2424));
        Finish::matt(blend(linen, red, 0.5 * (p + q) * 1.0))
    });
    into.parts.push(Part::sheet("cloth", sheet, look).detail(1.15).thin());
}
