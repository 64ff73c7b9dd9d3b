//! Inertial sensor, and the size of the scene's unit.

use super::Resolver;
use super::number::RealRange;
use super::trajectory::Triple;
use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::{OutputKind, SceneSource, TrajectoryRecipe, schema};
use gs2e_num::units::{Hertz, brief};
use gs2e_trajectory::imu::{AxisModel, GRAVITY, ImuModel};
use gs2e_trajectory::speed::SpeedFault;
use std::collections::BTreeSet;

/// Samples per second. A stamp of a file has nanoseconds, so no two are equal.
const RATE: RealRange = RealRange::new(1.0, 1e5);
/// Errors of sensors.
const ERROR: RealRange = RealRange::new(0.0, 1e3);

impl Resolver<'_> {
    /// The inertial sensor, if an output asks for it.
    pub(super) fn imu(
        &self,
        raw: &schema::RecipeSchema,
        source: Option<&SceneSource>,
        outputs: Option<&BTreeSet<OutputKind>>,
        trajectories: Option<&[TrajectoryRecipe]>,
    ) -> Option<Option<ImuModel>> {
        let section = raw.imu.or_default()?;
        let metres = raw.scale.optional(|scale| self.metres_per_unit(scale));
        let [gyroscope, accelerometer] = section.preset.or_default()?.axes();
        let rate = self.ratio(&section.rate, 1000, RATE).map(Hertz);
        let up = section.up.optional(|up| self.up(up));
        let gravity = self.real(&section.gravity, GRAVITY, RealRange::new(0.0, 1e3));
        let gyroscope = self.axes(&section.gyroscope, gyroscope);
        let accelerometer = self.axes(&section.accelerometer, accelerometer);
        if !outputs.into_iter().flatten().any(|output| output.is_measured()) {
            // Faults are reported all the same.
            return Some(None);
        }
        let (metres, up) = (metres?, up?);
        let place = raw.outputs.place().unwrap_or(self.root);
        let Some(metres_per_unit) = metres else {
            let problem = FieldProblem::new(
                "the output imu needs scale: accelerations are in m/s², and the scene has no unit",
            );
            return self.refuse(
                problem.help("write scale: { metres_per_unit: 0.4 }, with the size of your scene").at(place),
            );
        };
        if up.is_none() && source.is_some_and(|source| !source.has_views()) {
            let problem =
                FieldProblem::new("the output imu needs imu.up: without captured views, no direction is up");
            let up = orbit_up(raw).unwrap_or([0.0, 0.0, 1.0]).map(brief).join(", ");
            return self.refuse(problem.help(format!("write imu: {{ up: [{up}] }}")).at(place));
        }
        self.refuse_rough_speeds(raw, trajectories?)?;
        Some(Some(ImuModel {
            rate: rate?,
            gyroscope: gyroscope?,
            accelerometer: accelerometer?,
            gravity: gravity?,
            up,
            metres_per_unit,
        }))
    }

    /// Refuses inertial data along a speed that is not twice differentiable: an accelerometer would show its
    /// corners.
    fn refuse_rough_speeds(
        &self,
        raw: &schema::RecipeSchema,
        trajectories: &[TrajectoryRecipe],
    ) -> Option<()> {
        let place = raw.outputs.place().unwrap_or(self.root);
        let corners = || SpeedFault {
            because: "`curve: slerp-lerp` has corners".to_owned(),
            instead: "write curve: cubic in the path",
        };
        let fault = |own: &TrajectoryRecipe| {
            own.speed.accelerometer_fault().or_else(|| own.path.has_corners().then(corners))
        };
        let rough = trajectories.iter().find_map(|own| Some((own, fault(own)?)));
        let Some((trajectory, SpeedFault { because, instead })) = rough else { return Some(()) };
        let found = format!(
            "the output imu needs a smooth speed, and that of {} is not: {because}",
            quote_text(&trajectory.written)
        );
        self.refuse(FieldProblem::new(found).help(instead).at(place))
    }

    fn metres_per_unit(&self, field: &Field<schema::ScaleSection>) -> Option<f64> {
        let (raw, place) = field.given()?;
        let help = "write the metres of one unit of the scene";
        self.required(&raw.metres_per_unit, "metres_per_unit", place, help)?;
        self.real(&raw.metres_per_unit, 1.0, RealRange::above(0.0, 1e9))
    }

    fn up(&self, field: &Triple) -> Option<[f64; 3]> {
        let (up, place) = field.given()?;
        let up = self.numbers(up, RealRange::new(-1e6, 1e6))?;
        if up.iter().all(|value| value.abs() < 1e-6) {
            return self.refuse(FieldProblem::of_field("is no direction: its length is 0").at(place));
        }
        Some(up)
    }

    fn axes(&self, field: &Field<schema::ImuAxisSection>, preset: AxisModel) -> Option<AxisModel> {
        let raw = field.or_default()?;
        let range = raw.range.optional(|range| self.real(range, 1.0, RealRange::above(0.0, 1e6)));
        resolved!(AxisModel {
            noise: self.real(&raw.noise, preset.noise, ERROR),
            walk: self.real(&raw.walk, preset.walk, ERROR),
            bias: self.real(&raw.bias, preset.bias, ERROR),
            range: range.map(|range| range.or(preset.range)),
        })
    }
}

/// The up direction of the first orbit that states one.
fn orbit_up(raw: &schema::RecipeSchema) -> Option<[f64; 3]> {
    let (list, _) = raw.trajectories.given()?;
    list.iter().find_map(|item| {
        let [x, y, z] = item.given()?.0.orbit.given()?.0.up.given()?.0;
        Some([*x.given()?.0, *y.given()?.0, *z.given()?.0])
    })
}
