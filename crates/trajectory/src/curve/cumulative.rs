//! The curve `cumulative`: a uniform cumulative cubic B-spline on R^3 x SO(3).
//!
//! `R = R_k exp(b1 W1) exp(b2 W2) exp(b3 W3)` with the cumulative basis `b` and the turns `W`
//! between neighbouring rotations (Kim, Kim and Shin 1995, "A general construction scheme for unit
//! quaternion curves"). Centres have the same form. The curve is C2 and passes near the knots, not
//! through them. Both end knots count threefold, so the curve starts and ends in them, at rest in
//! its parameter, which is the index of the knot.

use super::PoseCurve;
use glam::{DQuat, DVec3};
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::se3::rotation_spline::turn_between;
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::{Se3, Twist};

/// Multiplicity of an end knot.
const MULTIPLICITY: usize = 3;

/// A cumulative B-spline near its knots.
#[derive(Debug, Clone, PartialEq)]
pub struct CumulativeSpline {
    steps: Vec<f64>,
    /// The knots, with threefold ends.
    control: Vec<Se3>,
    /// Displacement and turn from each knot to the next.
    moves: Vec<Twist>,
}

/// The three moves of a segment, weighted with the basis.
struct SegmentMoves([f64; 3]);

impl SegmentMoves {
    /// The cumulative basis at `u` in [0, 1].
    fn basis_value(u: f64) -> Self {
        // Each value is the sum of the uniform B-spline's basis from its move on; the sum for the start is 1.
        let (u2, u3) = (u * u, u * u * u);
        Self([(5.0 + 3.0 * u - 3.0 * u2 + u3) / 6.0, (1.0 + 3.0 * u + 3.0 * u2 - 2.0 * u3) / 6.0, u3 / 6.0])
    }

    /// Its derivative.
    fn basis_slope(u: f64) -> Self {
        let rest = 1.0 - u;
        Self([rest * rest / 2.0, 0.5 + u - u * u, u * u / 2.0])
    }

    /// Its second derivative.
    fn basis_bend(u: f64) -> Self {
        Self([u - 1.0, 1.0 - 2.0 * u, u])
    }
}

impl CumulativeSpline {
    /// The curve near `knots`.
    ///
    /// # Panics
    /// There are fewer than two knots.
    #[must_use]
    pub(crate) fn near_knots(knots: &[Se3]) -> Self {
        let [first, .., last] = knots else { panic!("a curve needs two knots") };
        let more = MULTIPLICITY - 1;
        let mut control = vec![*first; more];
        control.extend_from_slice(knots);
        control.extend(std::iter::repeat_n(*last, more));
        let step = |w: &[Se3]| Twist {
            linear: w[1].translation - w[0].translation,
            angular: turn_between(w[0].rotation, w[1].rotation).0,
        };
        let moves: Vec<Twist> = control.windows(2).map(step).collect();
        // A segment takes three moves, so there are two segments fewer than moves.
        Self { steps: vec![1.0; moves.len() - more], control, moves }
    }

    fn moves(&self, at: CurvePlace) -> &[Twist] {
        &self.moves[at.segment..at.segment + 3]
    }

    fn linear(&self, at: CurvePlace, weights: &SegmentMoves) -> DVec3 {
        self.moves(at).iter().zip(weights.0).map(|(step, weight)| step.linear * weight).sum()
    }

    /// Rotations of the three moves, and their weighted rates `b' W`.
    fn turns(&self, at: CurvePlace) -> ([DQuat; 3], [DVec3; 3]) {
        let (moves, value, slope) =
            (self.moves(at), SegmentMoves::basis_value(at.x).0, SegmentMoves::basis_slope(at.x).0);
        let each = |k: usize| moves[k].angular;
        ([0, 1, 2].map(|k| exp_vector(each(k) * value[k])), [0, 1, 2].map(|k| each(k) * slope[k]))
    }
}

impl PoseCurve for CumulativeSpline {
    fn steps(&self) -> &[f64] {
        &self.steps
    }

    fn pose(&self, at: CurvePlace) -> Se3 {
        let start = &self.control[at.segment];
        let ([a, b, c], _) = self.turns(at);
        let rotation = (start.rotation * a * b * c).normalize();
        Se3 { rotation, translation: start.translation + self.linear(at, &SegmentMoves::basis_value(at.x)) }
    }

    fn twist(&self, at: CurvePlace) -> Twist {
        let ([_, b, c], [ra, rb, rc]) = self.turns(at);
        // The rates are in the axes of their own moves. Each later turn carries them into its axes.
        let angular = c.conjugate() * (b.conjugate() * ra + rb) + rc;
        Twist { linear: self.linear(at, &SegmentMoves::basis_slope(at.x)), angular }
    }

    fn acceleration(&self, at: CurvePlace) -> Twist {
        let ([_, b, c], [ra, rb, rc]) = self.turns(at);
        let bends = SegmentMoves::basis_bend(at.x);
        let [ba, bb, bc] = [0, 1, 2].map(|k| self.moves(at)[k].angular * bends.0[k]);
        // A vector in a body that turns at rate w: d/du (exp(-B) v) = exp(-B) v' + (exp(-B) v) x w.
        let carried = b.conjugate() * ra;
        let (inner, inner_slope) = (carried + rb, b.conjugate() * ba + carried.cross(rb) + bb);
        let carried = c.conjugate() * inner;
        let angular = c.conjugate() * inner_slope + carried.cross(rc) + bc;
        Twist { linear: self.linear(at, &bends), angular }
    }

    fn knot(&self, number: usize) -> CurvePlace {
        // A segment starts nearest to the second of its four control poses. The outer knots lie on
        // the ends.
        let last = self.steps.len() - 2;
        match number {
            0 => CurvePlace { segment: 0, x: 0.0 },
            _ if number < last => CurvePlace { segment: number + 1, x: 0.0 },
            _ => CurvePlace { segment: self.steps.len() - 1, x: 1.0 },
        }
    }
}
