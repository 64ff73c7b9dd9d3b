//! A stack of books and, on top of it, an armillary sphere of brass.

use super::primitive::{
    Look, ScenePrimitive, SurfaceFinish, TableArrangement, ball_sheet, display_colour, revolved_sheet,
    table_point, turn_sine,
};
use super::shape::{Sheet, SurfelSpot};
use super::texture::{blend_colours, cloud_noise, mix_values, smooth_step, stripe_share, value_noise};
use glam::DVec3;
use std::f64::consts::PI;

/// Middle of the stack's foot.
const STACK: DVec3 = DVec3::new(1.32, 0.0, 0.42);

pub(super) fn add_books(seed: u64, into: &mut TableArrangement) {
    let books = [
        ClosedBook {
            bottom: 0.0,
            height: 0.15,
            size: [0.56, 0.40],
            turned: 0.045,
            cover: 0x23_4a3c,
            foil: 0xc9_a24a,
        },
        ClosedBook {
            bottom: 0.15,
            height: 0.11,
            size: [0.50, 0.37],
            turned: 0.085,
            cover: 0x8a_2a22,
            foil: 0xe0_d2a8,
        },
        ClosedBook {
            bottom: 0.26,
            height: 0.13,
            size: [0.44, 0.33],
            turned: 0.015,
            cover: 0x28_3c6e,
            foil: 0xd2_c8b4,
        },
    ];
    for (k, book) in books.into_iter().enumerate() {
        book.add(seed.wrapping_add(k as u64), into);
    }
    for (x, height, radius) in [(-0.28, 0.12, 0.26), (0.28, 0.12, 0.26), (-0.2, 0.25, 0.2), (0.2, 0.25, 0.2)]
    {
        into.shadow("books", STACK + table_point(x, height, 0.0), radius);
    }
    add_armillary(STACK + table_point(0.0, 0.39, 0.0), into);
}

/// A closed book on its side, with its spine towards the viewer.
#[derive(Debug, Clone, Copy)]
struct ClosedBook {
    bottom: f64,
    height: f64,
    /// Half the length of the spine, half the width of the cover.
    size: [f64; 2],
    /// Rotation about the vertical, in turns.
    turned: f64,
    cover: u32,
    foil: u32,
}

impl ClosedBook {
    /// The point at `a` along the spine and `b` across the cover (both -1 to 1), at a fraction of
    /// the height.
    fn point(self, a: f64, b: f64, height: f64) -> DVec3 {
        let (sin, cos) = turn_sine(self.turned);
        let (x, z) = (a * self.size[0], b * self.size[1]);
        STACK + table_point(cos * x - sin * z, self.bottom + height * self.height, sin * x + cos * z)
    }

    fn add(self, seed: u64, into: &mut TableArrangement) {
        let mut side = |sheet: Sheet, look: Look| {
            into.primitives.push(ScenePrimitive::sheet("books", sheet, look).detail(1.9));
        };
        let (left_right, right_left) = (|u| mix_values(-1.0, 1.0, u), |u| mix_values(1.0, -1.0, u));
        side(Box::new(move |u, v| self.point(left_right(u), left_right(v), 1.0)), self.lid(seed));
        // The spine is round: it bulges in the middle of the height.
        let bulge = |v: f64| -1.0 - 0.06 * libm::sin(v * PI);
        side(Box::new(move |u, v| self.point(left_right(u), bulge(v), v)), self.spine(seed));
        side(Box::new(move |u, v| self.point(1.0, left_right(u), v)), page_look());
        side(Box::new(move |u, v| self.point(-1.0, right_left(u), v)), page_look());
        side(Box::new(move |u, v| self.point(right_left(u), 1.0, v)), page_look());
    }

    fn leather(self, seed: u64, s: &SurfelSpot) -> DVec3 {
        display_colour(self.cover) * mix_values(0.75, 1.2, cloud_noise(seed, 14.0 * s.u, 10.0 * s.v))
    }

    /// Leather with a frame of foil.
    fn lid(self, seed: u64) -> Look {
        Box::new(move |s| {
            let edge = (s.u - 0.5).abs().max((s.v - 0.5).abs());
            let frame = smooth_step(0.40, 0.415, edge) * (1.0 - smooth_step(0.435, 0.45, edge));
            SurfaceFinish::glossy(
                blend_colours(self.leather(seed, s), display_colour(self.foil), frame),
                0.12,
            )
        })
    }

    /// Leather with bands and a title in foil.
    fn spine(self, seed: u64) -> Look {
        Box::new(move |s| {
            let line = smooth_step(0.28, 0.34, s.v) * (1.0 - smooth_step(0.66, 0.72, s.v));
            let title = line * smooth_step(0.34, 0.36, s.u) * (1.0 - smooth_step(0.64, 0.66, s.u));
            let letters = title * smooth_step(0.42, 0.5, value_noise(seed.wrapping_add(40), 60.0 * s.u, 2.0));
            let bands = stripe_share(s.u - 0.08, 0.21, 0.018, s.spacing[0] / (2.0 * self.size[0]));
            SurfaceFinish::glossy(
                blend_colours(self.leather(seed, s), display_colour(self.foil), bands.max(letters)),
                0.12,
            )
        })
    }
}

/// The edges of the leaves between two boards.
fn page_look() -> Look {
    Box::new(|s| {
        let leaves = value_noise(5, 4.0 * s.u, 40.0 * s.v);
        let board = 1.0 - smooth_step(0.07, 0.10, s.v.min(1.0 - s.v));
        SurfaceFinish::matt(blend_colours(
            display_colour(0xdc_cfae) * mix_values(0.7, 1.0, leaves),
            display_colour(0x3a_2c20),
            board,
        ))
    })
}

/// Rings about a globe, on a turned stand.
fn add_armillary(foot: DVec3, into: &mut TableArrangement) {
    let middle = foot + table_point(0.0, 0.52, 0.0);
    add_rings(middle, into);
    let land = |s: &SurfelSpot| {
        let shore = smooth_step(0.48, 0.54, cloud_noise(31, 5.0 * s.u, 3.0 * s.v));
        SurfaceFinish::glossy(blend_colours(display_colour(0x2a_5a7e), display_colour(0xb8_a468), shore), 0.4)
    };
    into.primitives.push(
        ScenePrimitive::sheet("armillary", ball_sheet(middle, 0.10, |_, _| 1.0), Box::new(land)).detail(2.2),
    );
    let axis = Box::new(move |t: f64| middle + table_point(0.16, 0.36, 0.0) * mix_values(-1.0, 1.0, t));
    into.primitives.push(ScenePrimitive::strand("armillary", axis, 0.008, brass_look()).detail(1.5));
    let stand = |v: f64| {
        let knob = smooth_step(0.45, 0.55, v) * (1.0 - smooth_step(0.6, 0.7, v));
        (0.14 * (1.0 - smooth_step(0.05, 0.25, v)) + 0.022 + 0.028 * knob, 0.18 * v)
    };
    into.primitives
        .push(ScenePrimitive::sheet("armillary", revolved_sheet(foot, stand), brass_look()).detail(2.5));
    into.shadow("armillary", middle, 0.1);
}

/// Brass with degree marks.
fn brass_look() -> Look {
    Box::new(|s| {
        let marks = stripe_share(s.u, 1.0 / 120.0, 0.3 / 120.0, s.spacing[0] / 2.0);
        SurfaceFinish::glossy(
            blend_colours(display_colour(0xb0_8436), display_colour(0x5a_3c14), 0.4 * marks),
            0.4,
        )
    })
}

fn add_rings(middle: DVec3, into: &mut TableArrangement) {
    // Tilt and heading in turns, then the radius.
    let rings =
        [(0.0, 0.0, 0.34), (0.25, 0.02, 0.33), (0.065, 0.10, 0.31), (-0.11, 0.30, 0.29), (0.19, 0.62, 0.30)];
    for (tilt, heading, radius) in rings {
        let (a, b) = ring_plane(tilt, heading);
        let ring = Box::new(move |t: f64| {
            let (sin, cos) = turn_sine(t);
            middle + radius * (a * cos + b * sin)
        });
        into.primitives.push(ScenePrimitive::strand("armillary", ring, 0.0125, brass_look()).detail(1.8));
    }
}

/// Two unit vectors that span the plane of a ring: level, then tilted and turned about the vertical
/// (in turns).
fn ring_plane(tilt: f64, heading: f64) -> (DVec3, DVec3) {
    let ((st, ct), (sh, ch)) = (turn_sine(tilt), turn_sine(heading));
    (table_point(ch, 0.0, sh), table_point(-sh * ct, st, ch * ct))
}
