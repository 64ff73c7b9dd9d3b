//! Times of the frames: at the poses, or where a tolerance requires them.

use super::{EventsStage, SimulatedStreams};
use crate::artifact::{EventStream, TrajectoryProduct};
use crate::stage::{StageContext, StageError};
use gs2e_num::units::format_amount;
use gs2e_render::{LayerOrder, RenderRules, Renderer, lights};
use gs2e_sampling::SamplingChoice;
use gs2e_sampling::choose::{ChoiceQuestion, ChooseError};
use gs2e_sampling::flow::PathFlow;
use gs2e_sampling::jitter::lost_in_noise;
use gs2e_sampling::measure::SensorScale;
use gs2e_sampling::scout::{ScoutError, ScoutRenderer};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraVelocity;
use gs2e_sensor::SensorChoice;
use gs2e_sensor::voltmeter::{BetweenFrames, VoltmeterModel};
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::sampled::SampledPath;

/// Times of the frames, and their renderer.
pub(super) struct SampledFrames {
    pub(super) trajectory: Trajectory,
    pub(super) velocities: Vec<CameraVelocity>,
    /// `None` for frames at the poses.
    pub(super) chosen: Option<SamplingChoice>,
    pub(super) renderer: Box<dyn Renderer>,
}

impl EventsStage {
    pub(super) fn sample(
        &self,
        motion: TrajectoryProduct,
        camera: Camera,
        mut renderer: Box<dyn Renderer>,
        cx: &StageContext<'_>,
    ) -> Result<SampledFrames, StageError> {
        // A single pose has no interval to choose frames in.
        let Some(tolerance) = self.tolerance.filter(|_| motion.trajectory.stamps_us.len() > 1) else {
            let velocities = motion.velocities();
            return Ok(SampledFrames { trajectory: motion.trajectory, velocities, chosen: None, renderer });
        };
        let poses = &motion.trajectory.world_from_camera;
        let path = SampledPath::through_poses(poses, motion.seconds())
            .map_err(StageError::work_failed("follow the path"))?;
        let end_us = motion.trajectory.stamps_us[poses.len() - 1];
        let flow = PathFlow::measure_path(&path, poses.len() - 1, end_us, camera, &mut *renderer)
            .map_err(StageError::work_failed("measure the optical flow"))?
            .lit_by(self.lights.as_ref());
        let front_ends = self.front_ends();
        let scales: Vec<SensorScale> = self
            .voltmeters()
            .map(|sensor| {
                let behind = front_ends.iter().position(|front_end| *front_end == sensor.settings.front_end);
                SensorScale::for_sensor(sensor, behind.expect("it is one of theirs"))
            })
            .collect();
        let all = [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite];
        // Colours have no rate of change, which `hermite` needs.
        let rated = !front_ends.iter().any(|front_end| front_end.needs_colour());
        let known = all.into_iter().filter(|between| rated || *between != BetweenFrames::Hermite);
        let asked = known.filter(|between| tolerance.between.is_none_or(|asked| asked == *between));
        let question = ChoiceQuestion {
            tolerance,
            flow: &flow,
            size: camera.size,
            intervals: poses.len() - 1,
            scales: &scales,
            between: &asked.collect::<Vec<_>>(),
            seed: self.seed,
            advice: self.advice(),
        };
        let go_on = || cx.go_on().is_ok();
        let scout = ScoutRenderer::new(renderer, camera, &path, &front_ends, &go_on);
        let mut scout = scout.lit_by(self.lights.as_ref());
        let (chosen, moments) = question.answer(&mut scout).map_err(|error| match error {
            ChooseError::View(ScoutError::Interrupted) => StageError::Cancelled,
            error => StageError::work_failed("choose frames for sampling.tolerance")(error),
        })?;
        let (trajectory, velocities) = path.sampled(&moments);
        Ok(SampledFrames { trajectory, velocities, chosen: Some(chosen), renderer: scout.into_renderer() })
    }

    /// Returns these parameters with another interpolation of brightness.
    pub(super) fn between(&self, between: BetweenFrames) -> Self {
        let with = |sensor: &SensorChoice| sensor.with_between(between);
        Self {
            sensor: self.sensor.as_ref().map(with),
            sensors: self.sensors.iter().map(|(name, sensor)| (name.clone(), with(sensor))).collect(),
            shot: self.shot.clone(),
            lights: self.lights.clone(),
            ..*self
        }
    }

    /// Reports the numbers of events and frames, and warns of each sensor whose own noise exceeds
    /// the tolerance.
    pub(super) fn report(
        &self,
        trajectory: &Trajectory,
        chosen: Option<&SamplingChoice>,
        simulated: &SimulatedStreams,
        cx: &mut StageContext<'_>,
    ) {
        let SimulatedStreams { streams, anchors } = simulated;
        let events = format_amount(streams.iter().map(|stream| stream.account.events).sum(), "ev");
        cx.warnings.extend(self.flicker_warning(trajectory, chosen));
        let Some(chosen) = chosen else {
            cx.remark = Some(events);
            return;
        };
        cx.remark = Some(format!("{events}, {chosen}"));
        let front_ends = self.front_ends();
        let end_us = trajectory.stamps_us.last().copied().unwrap_or(0);
        let hidden = |stream: &EventStream| {
            let sensor = stream.sensor.as_voltmeter()?;
            let behind = front_ends.iter().position(|front_end| *front_end == sensor.settings.front_end)?;
            let first = anchors.get(behind)?.images.first()?;
            let warning = lost_in_noise(chosen.tolerance, sensor, first, &stream.account, end_us)?;
            let named = stream.name.as_ref().map(|name| format!("sensor {name}: "));
            Some(named.unwrap_or_default() + &warning)
        };
        cx.warnings.extend(streams.iter().filter_map(hidden));
    }

    /// A warning for a flicker that the frames hardly follow.
    fn flicker_warning(&self, trajectory: &Trajectory, chosen: Option<&SamplingChoice>) -> Option<String> {
        let lights = self.lights.as_ref().filter(|_| chosen.is_none())?;
        lights::sampling_warning(lights, &trajectory.stamps_us)
    }

    fn voltmeters(&self) -> impl Iterator<Item = &VoltmeterModel> {
        self.sensors().filter_map(|(_, sensor)| sensor.as_voltmeter())
    }

    /// A suggestion to reduce jumps.
    fn advice(&self) -> &'static str {
        match (self.shot.render.rules, self.shot.render.order) {
            (RenderRules::Soft, LayerOrder::Blended) => "",
            (RenderRules::Soft, LayerOrder::Depth) => "; render: { rules: soft, order: blended } has fewer",
            (RenderRules::Official | RenderRules::Exact | RenderRules::Gsplat, _) => {
                "; render: { rules: soft } has fewer"
            }
        }
    }
}
