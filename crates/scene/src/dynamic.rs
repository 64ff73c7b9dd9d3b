//! Scenes whose Gaussians change with time by themselves.
//!
//! A scene has a time `u` of its own: from 0 to 1 for [`SplatTrack`]s, and the number of a frame for a
//! sequence. A [`SceneTime`] gives the `u` at each time of a trajectory. Each value of a Gaussian is a
//! function of `u` with an exact derivative.
//!
//! ```text
//! tracks:    d = u - c
//!            position   x + m1 d + m2 d^2 + m3 d^3
//!            quaternion q + w d, which the renderer normalises
//!            opacity    sigmoid(logit) exp(-(d / e^s)^2)
//! sequence:  the cubic between two frames whose slope at each frame is half the difference of its neighbours
//! ```
//! Tracks are those of Li et al., "Spacetime Gaussian Feature Splatting", CVPR 2024, equations 2 to 6, as
//! their program has them (`renderer/__init__.py`, `train_ours_lite`).
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! use gs2e_scene::dynamic::{SceneSpan, SceneTime, SplatCourse, SplatTrack};
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0; 3], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! // The only Gaussian of `scene` begins at the origin, and goes 4 units along x in 2 s.
//! let track = SplatTrack { motion: [[4.0, 0.0, 0.0], [0.0; 3], [0.0; 3]], ..SplatTrack::STILL };
//! let time = SceneTime { span: SceneSpan::Duration(2.0), ..SceneTime::default() };
//! let scene = scene.with_dynamics(time, SplatCourse::Tracks(vec![track]));
//! let splat = scene.at(0.5).ok_or("a scene at rest")?.splat(0);
//! // A position of 1 unit after half a second, and a velocity of 2 units per second.
//! assert_eq!(splat.position[0], [1.0, 2.0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod file;
mod frames;
pub mod splatv;

pub use frames::SplatFrames;

use super::{Gaussians, sh};
use serde::{Deserialize, Serialize};

/// Excess over the end of a scene that a rounded stamp may have, s.
const SLACK: f64 = 1e-6;

/// Remedy for a scene that changes with time where one at rest is read.
pub const HINT: &str =
    "say when it is seen: `time` next to its path in a recipe, or --at-time of gs2e render";

/// The time of a scene at each time of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneTime {
    /// Moment of the scene at the first pose, s.
    pub start: f64,
    /// Seconds of the scene in a second of the trajectory.
    pub speed: f64,
    /// The unit of the scene's own time.
    pub span: SceneSpan,
}

/// The unit of a scene's own time, and so the kind of scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneSpan {
    /// Seconds from the beginning to the end of a scene with tracks.
    Duration(f64),
    /// Frames per second of a sequence.
    Rate(f64),
}

impl Default for SceneTime {
    fn default() -> Self {
        Self { start: 0.0, speed: 1.0, span: SceneSpan::Duration(1.0) }
    }
}

impl SceneTime {
    /// Seconds in a unit of the scene's own time.
    fn unit_s(&self) -> f64 {
        match self.span {
            SceneSpan::Duration(seconds) => seconds,
            SceneSpan::Rate(hertz) => 1.0 / hertz,
        }
    }

    /// Returns true for a sequence of scene files.
    #[must_use]
    pub fn is_sequence(&self) -> bool {
        matches!(self.span, SceneSpan::Rate(_))
    }
}

/// The change of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SplatDynamics {
    /// Its time.
    pub time: SceneTime,
    /// The course of its Gaussians.
    pub course: SplatCourse,
}

/// The course of all Gaussians of a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum SplatCourse {
    /// One track per Gaussian.
    Tracks(Vec<SplatTrack>),
    /// Values at frames.
    Frames(SplatFrames),
}

/// The track of one Gaussian about its stored values, in the scene's own time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplatTrack {
    /// Coefficients of the first, second and third power, scene units.
    pub motion: [[f32; 3]; 3],
    /// Change of the stored quaternion, `w x y z`.
    pub omega: [f32; 4],
    /// Moment at which the Gaussian has its stored values.
    pub centre: f32,
    /// Natural logarithm of the time in which its opacity falls by a factor of e.
    pub log_width: f32,
}

impl SplatTrack {
    /// The track of a Gaussian that rests and is always there: the width is 10^13 of the whole time.
    pub const STILL: Self = Self { motion: [[0.0; 3]; 3], omega: [0.0; 4], centre: 0.0, log_width: 30.0 };

    /// Returns true if no value is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let Self { motion, omega, centre, log_width } = self;
        motion.as_flattened().iter().chain(omega).chain([centre, log_width]).all(|v| v.is_finite())
    }
}

/// A moment of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneMoment {
    /// The scene's own time.
    pub u: f64,
    /// Its rate, per second of the trajectory.
    pub rate: f64,
}

/// A number and its rate per second of the trajectory.
pub type Rated = [f64; 2];

/// The values of a Gaussian at a moment, each with its rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MomentSplat {
    /// Mean relative to the origin of the scene, scene units.
    pub position: [Rated; 3],
    /// Natural logarithms of the standard deviations.
    pub log_scale: [Rated; 3],
    /// Quaternion `w x y z` of any length.
    pub rotation: [Rated; 4],
    /// Opacity, 0..1.
    pub opacity: Rated,
}

impl MomentSplat {
    /// The velocity of the mean, scene units per second.
    #[must_use]
    pub fn velocity(&self) -> [f64; 3] {
        self.position.map(|[_, rate]| rate)
    }
}

/// A moment at which the scene is not known.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the scene lasts from 0 to {end} s, found a view at {found} s of it: {seconds} s after the first pose, from a start at \
     {start} s and at a speed of {speed}; shorten the trajectory, or change `start`, `speed` or the length of the scene"
)]
pub struct OutsideTime {
    /// End of the scene, s.
    pub end: f64,
    /// The moment of the scene, s.
    pub found: f64,
    /// Time of the view after the first pose, s.
    pub seconds: f64,
    /// As in [`SceneTime`].
    pub start: f64,
    /// As in [`SceneTime`].
    pub speed: f64,
}

impl SplatDynamics {
    /// The end of the scene, s.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.last() * self.time.unit_s()
    }

    /// The last moment of the scene's own time.
    fn last(&self) -> f64 {
        match &self.course {
            SplatCourse::Tracks(_) => 1.0,
            SplatCourse::Frames(frames) => frames.last(),
        }
    }

    /// The highest power of a track with a coefficient that is not 0; 3 for a sequence.
    #[must_use]
    pub fn degree(&self) -> u8 {
        let SplatCourse::Tracks(tracks) = &self.course else { return 3 };
        let uses =
            |power: usize| tracks.iter().any(|track| track.motion[power].iter().any(|v| v.abs() > 0.0));
        [(2, 3), (1, 2), (0, 1)]
            .into_iter()
            .find_map(|(power, degree)| uses(power).then_some(degree))
            .unwrap_or(0)
    }

    /// Number of the frames of a sequence.
    #[must_use]
    pub fn frames(&self) -> Option<usize> {
        match &self.course {
            SplatCourse::Tracks(_) => None,
            SplatCourse::Frames(frames) => Some(frames.frames().len()),
        }
    }

    /// Checks that the scene is known at this time after the first pose, s.
    ///
    /// # Errors
    /// The scene ends before.
    pub fn check(&self, seconds: f64) -> Result<(), OutsideTime> {
        let SceneTime { start, speed, .. } = self.time;
        let (found, end) = (start + speed * seconds, self.end_s());
        if (-SLACK..=end + SLACK).contains(&found) {
            return Ok(());
        }
        Err(OutsideTime { end, found, seconds, start, speed })
    }

    /// The moment at this time after the first pose, s. Beyond its ends, the scene stays as it is there.
    fn moment(&self, seconds: f64) -> SceneMoment {
        let (SceneTime { start, speed, .. }, unit) = (self.time, self.time.unit_s());
        SceneMoment { u: ((start + speed * seconds) / unit).clamp(0.0, self.last()), rate: speed / unit }
    }

    /// Returns true if harmonics change.
    #[must_use]
    pub fn has_harmonics(&self) -> bool {
        matches!(&self.course, SplatCourse::Frames(frames) if frames.has_harmonics())
    }
}

/// A scene that changes, at a moment.
#[derive(Debug, Clone, Copy)]
pub struct SceneAt<'a> {
    scene: &'a Gaussians,
    course: &'a SplatCourse,
    /// The moment.
    pub moment: SceneMoment,
}

impl SceneAt<'_> {
    /// The values of Gaussian `i`.
    #[must_use]
    pub fn splat(&self, i: usize) -> MomentSplat {
        match self.course {
            SplatCourse::Tracks(tracks) => tracks[i].splat(self.scene, i, self.moment),
            SplatCourse::Frames(frames) => frames.splat(i, self.moment),
        }
    }

    /// The harmonics of Gaussian `i` and their rates, if they change. Functions that the scene lacks are 0.
    #[must_use]
    pub fn harmonics(&self, i: usize) -> Option<Box<[[Rated; 3]; sh::MAX_LEN]>> {
        match self.course {
            SplatCourse::Frames(frames) if frames.has_harmonics() => Some(frames.harmonics(i, self.moment)),
            SplatCourse::Tracks(_) | SplatCourse::Frames(_) => None,
        }
    }
}

impl SplatTrack {
    fn splat(&self, scene: &Gaussians, i: usize, moment: SceneMoment) -> MomentSplat {
        let Self { motion: [m1, m2, m3], omega, centre, log_width } = self;
        let d = moment.u - f64::from(*centre);
        let along = |k: usize| {
            let [a, b, c] = [m1[k], m2[k], m3[k]].map(f64::from);
            let value = f64::from(scene.positions[i][k]) + d * (a + d * (b + d * c));
            [value, (a + d * (2.0 * b + d * (3.0 * c))) * moment.rate]
        };
        let turned = |k: usize| {
            let omega = f64::from(omega[k]);
            [f64::from(scene.rotations[i][k]) + omega * d, omega * moment.rate]
        };
        let narrow = libm::exp(-f64::from(*log_width));
        let share = d * narrow;
        let full = 1.0 / (1.0 + libm::exp(-f64::from(scene.opacity_logits[i])));
        let opacity = full * libm::exp(-share * share);
        MomentSplat {
            position: [along(0), along(1), along(2)],
            log_scale: scene.log_scales[i].map(|v| [f64::from(v), 0.0]),
            rotation: [turned(0), turned(1), turned(2), turned(3)],
            opacity: [opacity, -2.0 * share * narrow * opacity * moment.rate],
        }
    }
}

impl Gaussians {
    /// The change of the Gaussians; `None` if they are still, or move as rigid objects alone.
    #[must_use]
    pub fn dynamics(&self) -> Option<&SplatDynamics> {
        self.motion.as_ref()?.dynamics.as_ref()
    }

    /// The scene at this time after the first pose, s, if its Gaussians change. Beyond its ends, it stays as
    /// it is there.
    #[must_use]
    pub fn at(&self, seconds: f64) -> Option<SceneAt<'_>> {
        let SplatDynamics { course, .. } = self.dynamics()?;
        Some(SceneAt { scene: self, course, moment: self.dynamics()?.moment(seconds) })
    }
}
