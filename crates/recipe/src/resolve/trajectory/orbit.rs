//! Orbits.

use super::PathContext;
use super::count::PoseSpread;
use super::novel::DEFAULT_FRAMES;
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::resolve::Resolver;
use crate::resolve::number::RealRange;
use crate::schema;
use crate::text::TextSpan;
use gs2e_num::se3::look_at;
use gs2e_trajectory::orbit::OrbitPath;

/// Degrees: a hundred turns in either direction.
const ARC: RealRange = RealRange::new(-36_000.0, 36_000.0);

impl Resolver<'_> {
    pub(super) fn orbit(
        &self,
        raw: &schema::OrbitSection,
        place: TextSpan,
        context: PathContext<'_>,
    ) -> Option<OrbitPath> {
        let [centre, from] = [&raw.centre, &raw.from].map(|field| self.point(field));
        let up = self.direction(&raw.up);
        let arc = self.arc(&raw.arc);
        let spread = PoseSpread { factor: None, frames: &raw.frames, duration: &raw.duration, literal: None };
        let (count, _) = self.spread(spread, DEFAULT_FRAMES, place, context);
        let fields = [(&raw.centre, "centre"), (&raw.from, "from"), (&raw.up, "up")];
        if !context.setting.has_views() && !context.setting.has_scene {
            let help = "without a capture or a scene, an orbit needs centre, from and up";
            fields.into_iter().for_each(|(field, name)| {
                self.required(field, name, place, help);
            });
        }
        let (centre, from, up) = (centre?, from?, up?);
        if let (Some(centre), Some(from), Some(up)) = (centre, from, up)
            && look_at(centre - from, up).is_none()
        {
            let problem = FieldProblem::of_field("is not a circle: it starts at its centre, or on its axis");
            return self.refuse(problem.help("place from off the line through centre along up").at(place));
        }
        Some(OrbitPath { centre, from, up, arc: arc?, count: count? })
    }

    fn arc(&self, field: &Field<f64>) -> Option<f64> {
        let arc = self.real(field, 360.0, ARC)?;
        match field.place() {
            Some(place) if arc == 0.0 => {
                self.refuse(FieldProblem::of_field(format!("is 0, wanted {ARC} other than 0")).at(place))
            }
            _ => Some(arc),
        }
    }
}
