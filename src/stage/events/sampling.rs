//! Times of the frames: at the poses, or where a tolerance requires them.

use super::Simulating;
use crate::artifact::{Motion, Stream};
use crate::camera::Camera;
use crate::frames::anchors::Anchors;
use crate::render::{Layering, Renderer, Rules, Velocity};
use crate::sampling::choose::{ChooseError, Question};
use crate::sampling::flow::Flow;
use crate::sampling::jitter::lost_in_noise;
use crate::sampling::measure::Scale;
use crate::sampling::path::Path;
use crate::sampling::scout::{Scout, ScoutError};
use crate::sampling::{Chosen, Tolerance};
use crate::sensor::Sensor;
use crate::sensor::voltmeter::{Between, Voltmeter};
use crate::stage::{Context, StageError};
use crate::trajectory::Trajectory;
use crate::units::format_amount;

/// Times of the frames, and their renderer.
pub(super) struct Sampled {
    pub(super) trajectory: Trajectory,
    pub(super) velocities: Vec<Velocity>,
    /// `None` for frames at the poses.
    pub(super) chosen: Option<Chosen>,
    pub(super) renderer: Box<dyn Renderer>,
}

impl Simulating {
    pub(super) fn sample(
        &self,
        motion: Motion,
        camera: Camera,
        renderer: Box<dyn Renderer>,
        cx: &Context<'_>,
    ) -> Result<Sampled, StageError> {
        match self.tolerance {
            Some(tolerance) if motion.trajectory.stamps_us.len() > 1 => {
                self.choose(tolerance, &motion, camera, renderer, cx)
            }
            _ => {
                let velocities = motion.velocities();
                Ok(Sampled { trajectory: motion.trajectory, velocities, chosen: None, renderer })
            }
        }
    }

    fn choose(
        &self,
        tolerance: Tolerance,
        motion: &Motion,
        camera: Camera,
        mut renderer: Box<dyn Renderer>,
        cx: &Context<'_>,
    ) -> Result<Sampled, StageError> {
        let poses = &motion.trajectory.world_from_camera;
        let path = Path::through_poses(poses, motion.seconds())
            .map_err(StageError::work_failed("follow the path"))?;
        let end_us = motion.trajectory.stamps_us[poses.len() - 1];
        let flow = Flow::measure_path(&path, (poses.len() - 1, end_us), camera, &mut *renderer)
            .map_err(StageError::work_failed("measure the optical flow"))?;
        let front_ends = self.front_ends();
        let scales: Vec<Scale> = self
            .voltmeters()
            .map(|sensor| {
                let behind = front_ends.iter().position(|front_end| *front_end == sensor.front_end);
                Scale::for_sensor(sensor, behind.expect("it is one of theirs"))
            })
            .collect();
        let all = [Between::Linear, Between::Catmull, Between::Hermite];
        let rated = !front_ends.iter().any(|front_end| front_end.needs_colour());
        let known = all.into_iter().filter(|between| rated || *between != Between::Hermite);
        let asked = known.filter(|between| tolerance.between.is_none_or(|asked| asked == *between));
        let question = Question {
            tolerance,
            flow: &flow,
            intervals: poses.len() - 1,
            scales: &scales,
            between: &asked.collect::<Vec<_>>(),
            seed: self.seed,
            advice: self.advice(),
        };
        let go_on = || cx.go_on().is_ok();
        let mut scout = Scout::new(renderer, camera, &path, &front_ends, &go_on);
        let (chosen, moments) = question.answer(&mut scout).map_err(|error| match error {
            ChooseError::View(ScoutError::Interrupted) => StageError::Cancelled,
            error => StageError::work_failed("choose frames for sampling.tolerance")(error),
        })?;
        let (trajectory, velocities) = path.sampled(&moments);
        Ok(Sampled { trajectory, velocities, chosen: Some(chosen), renderer: scout.into_renderer() })
    }

    /// The same parameters with another interpolation of brightness.
    pub(super) fn between(&self, between: Between) -> Self {
        let with = |sensor: &Sensor| match sensor {
            Sensor::Voltmeter(sensor) => Sensor::Voltmeter(Voltmeter { between, ..sensor.clone() }),
            other => other.clone(),
        };
        Self {
            sensor: self.sensor.as_ref().map(with),
            sensors: self.sensors.iter().map(|(name, sensor)| (name.clone(), with(sensor))).collect(),
            backend: self.backend.clone(),
            ..*self
        }
    }

    /// Reports the numbers of events and frames, and warns of each sensor whose own noise exceeds
    /// the tolerance.
    pub(super) fn tell(
        &self,
        trajectory: &Trajectory,
        chosen: Option<&Chosen>,
        (streams, anchors): (&[Stream], &[Anchors]),
        cx: &mut Context<'_>,
    ) {
        let events = format_amount(streams.iter().map(|stream| stream.account.events).sum(), "ev");
        let Some(chosen) = chosen else {
            cx.remark = Some(events);
            return;
        };
        cx.remark = Some(format!("{events}, {chosen}"));
        let front_ends = self.front_ends();
        let end_us = trajectory.stamps_us.last().copied().unwrap_or(0);
        let hidden = |stream: &Stream| {
            let Sensor::Voltmeter(sensor) = &stream.sensor else { return None };
            let behind = front_ends.iter().position(|front_end| *front_end == sensor.front_end)?;
            let first = anchors.get(behind)?.images.first()?;
            let warning = lost_in_noise(chosen.tolerance, sensor, first, &stream.account, end_us)?;
            let named = stream.name.as_ref().map(|name| format!("sensor {name}: "));
            Some(named.unwrap_or_default() + &warning)
        };
        cx.warnings.extend(streams.iter().filter_map(hidden));
    }

    fn voltmeters(&self) -> impl Iterator<Item = &Voltmeter> {
        self.sensors().filter_map(|(_, sensor)| match sensor {
            Sensor::Voltmeter(sensor) => Some(sensor),
            Sensor::Esim(_) | Sensor::V2e(_) => None,
        })
    }

    /// A suggestion to reduce jumps.
    fn advice(&self) -> &'static str {
        match (self.render.rules, self.render.order) {
            (Rules::Soft, Layering::Blended) => "",
            (Rules::Soft, Layering::Depth) => "; render: { rules: soft, order: blended } has fewer",
            (Rules::Official | Rules::Exact | Rules::Gsplat, _) => "; render: { rules: soft } has fewer",
        }
    }
}
