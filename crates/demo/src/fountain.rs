//! A fountain on the table: drops that fly on parabolas, turn, and are there for a while.
//!
//! With `s` the time from the apex of a drop in seconds of the scene, its mean is `apex + v s + g s^2 / 2`
//! with a horizontal velocity `v`, and its opacity `o exp(-(s / w)^2)`: a [`SplatTrack`] of degree 2 about
//! the apex.

use super::draw::SceneDraws;
use super::{light, to_single};
use glam::DVec3;
use gs2e_scene::collector::{Gaussian, GaussianCollector};
use gs2e_scene::dynamic::{SceneSpan, SceneTime, SplatTrack};
use gs2e_scene::sh;
use serde::{Deserialize, Serialize};

/// Acceleration of a falling drop, scene units/s^2. Down is +y.
pub const GRAVITY: DVec3 = DVec3::new(0.0, 4.0, 0.0);
/// Position of the nozzle, on the table in front of the bowl.
const NOZZLE: DVec3 = DVec3::new(-0.35, -0.1, -0.75);
/// Time in which the opacity of a drop falls by a factor of e, s. Drops rise for 0.35 to 0.6 s.
const WIDTH_S: f64 = 0.3;
/// Stream of draws, beyond those of the primitives on the table.
const STREAM: u64 = 1 << 32;

/// Parameters of the fountain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Fountain {
    /// Number of drops, 1 to 1,000,000.
    pub drops: u32,
    /// Time of the scene; the span is its duration.
    pub time: SceneTime,
}

impl Default for Fountain {
    fn default() -> Self {
        Self { drops: 500, time: SceneTime::default() }
    }
}

/// Adds the drops. Returns their tracks.
pub(super) fn add_fountain(
    fountain: &Fountain,
    seed: u64,
    collector: &mut GaussianCollector,
) -> Vec<SplatTrack> {
    let (SceneSpan::Duration(unit_s) | SceneSpan::Rate(unit_s)) = fountain.time.span;
    let mut draws = SceneDraws::new(seed, STREAM);
    (0..fountain.drops).map(|_| add_drop(unit_s, &mut draws, collector)).collect()
}

fn add_drop(unit_s: f64, draws: &mut SceneDraws, collector: &mut GaussianCollector) -> SplatTrack {
    // Drops that pass their apex before the beginning or after the end are seen there too.
    let apex_s = draws.uniform(-0.6, unit_s + 0.6);
    // Every number of a drop is drawn in a fixed order; a new one would change all drops after it.
    let rise_s = draws.uniform(0.35, 0.6);
    let velocity = DVec3::new(draws.bell(0.3), 0.0, draws.bell(0.15));
    // From the nozzle to the apex in the time of the rise.
    let apex = NOZZLE + velocity * rise_s - GRAVITY * (0.5 * rise_s * rise_s);
    let long = draws.uniform(0.025, 0.05);
    let deviations = DVec3::new(0.4 * long, long, 0.4 * long);
    // Dark and bright ones, so that they are seen in front of anything.
    let shade = draws.uniform(0.1, 1.0);
    let colour = DVec3::new(0.75 * shade, 0.9 * shade, shade);
    let mut harmonics = [[0.0; 3]; sh::function_count(light::DEGREE)];
    harmonics[0] = to_single((colour - DVec3::splat(0.5)) / sh::C0);
    let opacity = draws.uniform(0.9, 0.99);
    collector.push(&Gaussian {
        position: to_single(apex),
        log_scale: to_single(DVec3::from_array(deviations.to_array().map(libm::log))),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: sh::Scalar::nearest(libm::log(opacity / (1.0 - opacity))),
        sh: &harmonics,
    });
    let mut turn = || sh::Scalar::nearest(draws.uniform(-1.5, 1.5) * unit_s);
    SplatTrack {
        motion: [to_single(velocity * unit_s), to_single(GRAVITY * (0.5 * unit_s * unit_s)), [0.0; 3]],
        omega: [0.0, turn(), turn(), turn()],
        centre: sh::Scalar::nearest(apex_s / unit_s),
        log_width: sh::Scalar::nearest(libm::log(WIDTH_S / unit_s)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{StillLife, still_life};

    /// The nozzle, the velocity there, and free fall decide where a drop is.
    #[test]
    fn drops_fly_from_the_nozzle_on_parabolas() {
        let time = SceneTime { start: 0.5, speed: 2.0, span: SceneSpan::Duration(3.0) };
        let life = StillLife {
            gaussians: 200,
            fountain: Some(Fountain { drops: 50, time }),
            ..StillLife::default()
        };
        let scene = still_life(&life);
        let dynamics = scene.dynamics().unwrap();
        assert_eq!((scene.len(), dynamics.end_s().to_bits()), (250, 3_f64.to_bits()));
        let place = |i: usize, seconds: f64| {
            let splat = scene.at(seconds).unwrap().splat(i);
            (DVec3::from_array(splat.position.map(|[value, _]| value)), DVec3::from_array(splat.velocity()))
        };
        for i in 200..250 {
            // Seconds of the trajectory pass at half the pace of the scene's.
            let [(a, u), (b, _), (c, v)] = [0.1, 0.5, 0.9].map(|t| place(i, t));
            let acceleration = (a - b * 2.0 + c) / 0.64;
            assert!((acceleration - GRAVITY).length() < 1e-5, "{i}: {acceleration}");
            // Velocities are per second of the trajectory.
            assert!(((v - u) / 1.6 - GRAVITY * 2.0).length() < 1e-5, "{i}");
            // Back along the parabola, the drop was at the nozzle; its time there is a root of a quadratic.
            let fall = u / 2.0;
            let horizontal = DVec3::new(fall.x, 0.0, fall.z);
            let back = (NOZZLE - a).dot(horizontal) / horizontal.length_squared();
            let wanted = a + fall * back + GRAVITY * (0.5 * back * back);
            assert!((wanted - NOZZLE).length() < 1e-3, "{i}: {wanted}");
        }
        // The table rests.
        let [(a, u), (b, _)] = [0.0, 1.2].map(|t| place(7, t));
        assert!(a == b && u == DVec3::ZERO);
        let rest = scene.at(1.2).unwrap().splat(7).opacity;
        let full = 1.0 / (1.0 + libm::exp(-f64::from(scene.opacity_logits[7])));
        assert!(rest[0].to_bits() == full.to_bits() && rest[1].abs() < 1e-20, "{rest:?}");
    }

    #[test]
    fn a_fountain_changes_nothing_of_the_table() {
        let life = StillLife { gaussians: 300, ..StillLife::default() };
        let table = still_life(&life);
        let scene =
            still_life(&StillLife { fountain: Some(Fountain { drops: 9, ..Fountain::default() }), ..life });
        assert_eq!((table.len(), scene.len()), (300, 309));
        assert!(scene.positions[..300] == table.positions[..] && scene.sh[..table.sh.len()] == table.sh[..]);
        assert!(table.motion.is_none());
    }
}
