//! A scene as a sequence of frames: the same Gaussians in the same order, with values of their own in each.
//!
//! Between two frames, each value follows the cubic of Catmull and Rom (1974): it meets the frames, and its
//! slope at a frame is half the difference of the frames around. At both ends, the parabola through the
//! nearest three frames continues the sequence. With two frames, values are linear. What is interpolated is
//! what a file stores: positions, logarithms of scales, quaternions of unit length with the signs of their
//! predecessors, logits, and harmonics.

use super::{MomentSplat, Rated, SceneMoment};
use crate::{Gaussians, sh};
use std::array::from_fn;

/// Frames of a sequence, at least two.
#[derive(Debug, Clone, PartialEq)]
pub struct SplatFrames {
    frames: Vec<Gaussians>,
    has_harmonics: bool,
}

/// Weights of frames at a moment: of values, and of rates.
struct FrameWeights {
    /// The first of the frames.
    first: usize,
    weights: Vec<Rated>,
}

impl SplatFrames {
    /// Takes frames that have the same number of Gaussians and the same degree.
    ///
    /// # Errors
    /// The number of the first frame that differs, what was found and what was wanted. The number is 0 if
    /// there are fewer than two frames.
    pub fn new(mut frames: Vec<Gaussians>) -> Result<Self, (usize, String)> {
        if frames.len() < 2 {
            return Err((0, format!("found {} frames, wanted at least 2", frames.len())));
        }
        let (count, degree, origin) = (frames[0].len(), frames[0].sh_degree, frames[0].origin);
        for (number, frame) in frames.iter_mut().enumerate() {
            if frame.len() != count {
                let found = frame.len();
                return Err((
                    number,
                    format!("found {found} Gaussians, wanted {count} as in the first frame"),
                ));
            }
            if frame.sh_degree != degree {
                let found = frame.sh_degree;
                return Err((
                    number,
                    format!("found harmonics of degree {found}, wanted {degree} as in the first frame"),
                ));
            }
            frame.move_origin(origin);
        }
        align_rotations(&mut frames);
        // Harmonics that never change need no interpolation between frames.
        let has_harmonics = frames.iter().any(|frame| frame.sh != frames[0].sh);
        Ok(Self { frames, has_harmonics })
    }

    /// The frames.
    #[must_use]
    pub fn frames(&self) -> &[Gaussians] {
        &self.frames
    }

    /// The number of the last frame.
    pub(super) fn last(&self) -> f64 {
        (self.frames.len() - 1) as f64
    }

    pub(super) fn has_harmonics(&self) -> bool {
        self.has_harmonics
    }

    pub(super) fn splat(&self, i: usize, moment: SceneMoment) -> MomentSplat {
        let at = self.weights(moment);
        let [logit, logit_rate] = self.sum(&at, |frame| frame.opacity_logits[i]);
        let opacity = 1.0 / (1.0 + libm::exp(-logit));
        MomentSplat {
            position: from_fn(|k| self.sum(&at, |frame| frame.positions[i][k])),
            log_scale: from_fn(|k| self.sum(&at, |frame| frame.log_scales[i][k])),
            rotation: from_fn(|k| self.sum(&at, |frame| frame.rotations[i][k])),
            opacity: [opacity, opacity * (1.0 - opacity) * logit_rate],
        }
    }

    pub(super) fn harmonics(&self, i: usize, moment: SceneMoment) -> Box<[[Rated; 3]; sh::MAX_LEN]> {
        let (at, n) = (self.weights(moment), self.frames[0].sh_len());
        let mut out = Box::new([[[0.0; 2]; 3]; sh::MAX_LEN]);
        for (k, to) in out.iter_mut().take(n).enumerate() {
            *to = from_fn(|c| self.sum(&at, |frame| frame.sh[i * n + k][c]));
        }
        out
    }

    fn sum(&self, at: &FrameWeights, value: impl Fn(&Gaussians) -> f32) -> Rated {
        let frames = self.frames[at.first..].iter().zip(&at.weights);
        frames.fold([0.0; 2], |[sum, rate], (frame, [weight, slope])| {
            let value = f64::from(value(frame));
            [sum + weight * value, rate + slope * value]
        })
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the frames")]
    fn weights(&self, SceneMoment { u, rate }: SceneMoment) -> FrameWeights {
        let last = self.frames.len() - 1;
        // At the last frame, `s` is 1 in the last interval: no other interval begins there.
        let k = (u.max(0.0) as usize).min(last - 1);
        let s = u - k as f64;
        if last == 1 {
            return FrameWeights { first: 0, weights: vec![[1.0 - s, -rate], [s, rate]] };
        }
        let mut four = catmull_rom(s);
        // A frame before the first is `3 f0 - 3 f1 + f2`, where third differences are 0; one after the last
        // alike.
        let (first, weights) = if k == 0 {
            let before = four[0];
            [3.0, -3.0, 1.0].into_iter().zip(&mut four[1..]).for_each(|(share, to)| add(to, share, before));
            (0, &four[1..])
        } else {
            (k - 1, &four[..])
        };
        let mut weights = weights.to_vec();
        if k + 1 == last
            && let Some(after) = weights.pop()
        {
            let n = weights.len();
            [1.0, -3.0, 3.0]
                .into_iter()
                .zip(&mut weights[n - 3..])
                .for_each(|(share, to)| add(to, share, after));
        }
        weights.iter_mut().for_each(|[_, slope]| *slope *= rate);
        FrameWeights { first, weights }
    }
}

fn add(to: &mut Rated, share: f64, from: Rated) {
    to[0] += share * from[0];
    to[1] += share * from[1];
}

/// Weights and their derivatives of the four frames around; the second of them is `s` before the moment.
fn catmull_rom(s: f64) -> [Rated; 4] {
    let (s2, s3) = (s * s, s * s * s);
    [
        [0.5 * (-s + 2.0 * s2 - s3), 0.5 * (-1.0 + 4.0 * s - 3.0 * s2)],
        [0.5 * (2.0 - 5.0 * s2 + 3.0 * s3), 0.5 * (-10.0 * s + 9.0 * s2)],
        [0.5 * (s + 4.0 * s2 - 3.0 * s3), 0.5 * (1.0 + 8.0 * s - 9.0 * s2)],
        [0.5 * (s3 - s2), 0.5 * (3.0 * s2 - 2.0 * s)],
    ]
}

/// Makes quaternions unit ones, of the sign that is nearer to the frame before. A zero quaternion is no
/// rotation.
#[expect(clippy::cast_possible_truncation, reason = "scenes hold 32 bits")]
fn align_rotations(frames: &mut [Gaussians]) {
    let mut before: Option<Vec<[f32; 4]>> = None;
    for frame in frames {
        for (i, rotation) in frame.rotations.iter_mut().enumerate() {
            let wide = rotation.map(f64::from);
            let norm = wide.iter().map(|v| v * v).sum::<f64>().sqrt();
            let unit = if norm > 0.0 { wide.map(|v| v / norm) } else { [1.0, 0.0, 0.0, 0.0] };
            // A quaternion and its negative are one rotation, but a cubic between them passes near 0.
            let along = before.as_ref().map_or(1.0, |before| {
                before[i].iter().zip(unit).map(|(a, b)| f64::from(*a) * b).sum::<f64>()
            });
            *rotation = unit.map(|v| if along < 0.0 { -v as f32 } else { v as f32 });
        }
        before = Some(frame.rotations.clone());
    }
}

impl Gaussians {
    /// Takes the positions relative to another origin.
    #[expect(clippy::cast_possible_truncation, reason = "scenes hold 32 bits")]
    fn move_origin(&mut self, origin: glam::DVec3) {
        let shift = self.origin - origin;
        if shift == glam::DVec3::ZERO {
            return;
        }
        let shift = shift.to_array();
        for position in &mut self.positions {
            *position = from_fn(|k| (f64::from(position[k]) + shift[k]) as f32);
        }
        self.origin = origin;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneScreening;
    use glam::DVec3;

    /// A frame of one Gaussian with these numbers for position and logit.
    fn frame(x: f32, rotation: [f32; 4]) -> Gaussians {
        Gaussians {
            origin: DVec3::ZERO,
            positions: vec![[x, -x, 2.0]],
            log_scales: vec![[x; 3]],
            rotations: vec![rotation],
            opacity_logits: vec![x],
            sh: vec![[x; 3]],
            sh_degree: 0,
            antialiased: None,
            screening: SceneScreening::default(),
            motion: None,
        }
    }

    const ONE: [f32; 4] = [1.0, 0.0, 0.0, 0.0];

    fn sequence(values: &[f32]) -> SplatFrames {
        SplatFrames::new(values.iter().map(|x| frame(*x, ONE)).collect()).unwrap()
    }

    fn x(frames: &SplatFrames, u: f64) -> Rated {
        frames.splat(0, SceneMoment { u, rate: 1.0 }).position[0]
    }

    /// A parabola is met exactly, also at the ends, by any number of frames from three on.
    #[test]
    fn parabolas_are_met_exactly() {
        let f = |u: f64| [0.5 * u * u - 0.75 * u + 2.0, u - 0.75];
        for count in [3_u8, 4, 5, 8] {
            let values: Vec<f32> = (0..count).map(f32::from).map(|k| 0.5 * k * k - 0.75 * k + 2.0).collect();
            let frames = sequence(&values);
            for step in 0..=4 * (u32::from(count) - 1) {
                let u = f64::from(step) / 4.0;
                let (found, wanted) = (x(&frames, u), f(u));
                let off = (found[0] - wanted[0]).abs().max((found[1] - wanted[1]).abs());
                assert!(off < 1e-13, "{count} frames at {u}: {found:?} for {wanted:?}");
            }
        }
        let bits = |values: Rated| values.map(f64::to_bits);
        assert_eq!(bits(x(&sequence(&[1.0, 3.0]), 0.25)), bits([1.5, 2.0]));
    }

    /// Value and slope agree from both sides of a frame; rates are derivatives.
    #[test]
    fn frames_are_met_without_a_jump_of_the_slope() {
        let frames = sequence(&[0.0, 1.0, -2.0, 0.5, 4.0]);
        for (k, value) in [0.0_f32, 1.0, -2.0, 0.5, 4.0].into_iter().enumerate() {
            let found = x(&frames, k as f64)[0];
            assert_eq!(found.to_bits(), f64::from(value).to_bits(), "{found}");
        }
        for k in 1..4 {
            let [left, right] = [-1e-9, 1e-9].map(|h| x(&frames, f64::from(k) + h)[1]);
            assert!((left - right).abs() < 1e-7, "{k}: {left} {right}");
        }
        for u in [0.3, 1.6, 2.5, 3.9] {
            let h = 1e-5;
            let wanted = (x(&frames, u + h)[0] - x(&frames, u - h)[0]) / (2.0 * h);
            // A third derivative below 100 times h^2 / 6, and rounding at 1e-16 / h.
            assert!((x(&frames, u)[1] - wanted).abs() < 1e-8, "{u}");
        }
    }

    #[test]
    fn quaternions_keep_the_sign_of_their_predecessor() {
        let frames =
            vec![frame(0.0, [2.0, 0.0, 0.0, 0.0]), frame(0.0, [-0.6, 0.0, -0.8, 0.0]), frame(0.0, [0.0; 4])];
        let frames = SplatFrames::new(frames).unwrap();
        let found: Vec<[f32; 4]> = frames.frames().iter().map(|frame| frame.rotations[0]).collect();
        let bits = |rotations: &[[f32; 4]]| {
            rotations.as_flattened().iter().map(|v| v.to_bits()).collect::<Vec<u32>>()
        };
        // Without -0, which has other bits.
        let found: Vec<[f32; 4]> = found.iter().map(|q| q.map(|v| v + 0.0)).collect();
        assert_eq!(bits(&found), bits(&[ONE, [0.6, 0.0, 0.8, 0.0], ONE]));
    }

    #[test]
    fn frames_that_differ_are_named() {
        let mut two = frame(0.0, ONE);
        two.positions.push([0.0; 3]);
        let t = |frames: Vec<Gaussians>, wanted: (usize, &str)| {
            let (number, because) = SplatFrames::new(frames).unwrap_err();
            assert_eq!((number, because.as_str()), wanted);
        };
        t(vec![frame(0.0, ONE)], (0, "found 1 frames, wanted at least 2"));
        t(
            vec![frame(0.0, ONE), frame(0.0, ONE), two],
            (2, "found 2 Gaussians, wanted 1 as in the first frame"),
        );
        let first = Gaussians { sh_degree: 1, ..frame(0.0, ONE) };
        t(vec![frame(0.0, ONE), first], (1, "found harmonics of degree 1, wanted 0 as in the first frame"));
    }

    #[test]
    fn harmonics_change_only_where_they_differ() {
        assert!(sequence(&[0.0, 1.0]).has_harmonics());
        let still = SplatFrames::new(vec![frame(2.0, ONE), frame(2.0, ONE)]).unwrap();
        assert!(!still.has_harmonics());
        let [value, rate] = sequence(&[0.0, 1.0, 4.0]).harmonics(0, SceneMoment { u: 1.5, rate: 2.0 })[0][1];
        assert!((value - 2.25).abs() < 1e-14 && (rate - 6.0).abs() < 1e-14, "{value} {rate}");
    }
}
