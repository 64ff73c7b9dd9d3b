//! Objects: their Gaussians and their paths.

use super::number::RealRange;
use super::trajectory::Triple;
use super::{Resolver, all};
use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::text::TextSpan;
use crate::{OutputKind, names, schema};
use glam::DVec3;
use gs2e_scene::motion::{MAX_OBJECTS, ObjectKeyframe, ObjectPath};
use gs2e_scene::objects::{ObjectSettings, ObjectSource};
use std::collections::BTreeSet;

/// Degrees, and degrees per second: a thousand turns.
const TURN: RealRange = RealRange::new(-360_000.0, 360_000.0);
/// Seconds: a day.
const SECONDS: RealRange = RealRange::new(0.0, 86_400.0);
/// Sizes and ratios of sizes.
const SIZE: RealRange = RealRange::above(0.0, 1e9);

const SOURCE: &str =
    "write select: { sphere: { centre: [0, 0, 0], radius: 0.5 } }, or scene: { path: cup.ply }";
const PATH: &str = "write path: { straight: { velocity: [1, 0, 0] } }, or orbit or keyframes";

impl Resolver<'_> {
    /// The objects. A segmentation of a scene without objects, and objects of a scene that changes with time,
    /// are refused.
    pub(super) fn objects_and_segmentation(
        &self,
        raw: &schema::RecipeSchema,
        outputs: Option<&BTreeSet<OutputKind>>,
        changes: bool,
    ) -> Option<Vec<ObjectSettings>> {
        if changes {
            self.refuse_in_changing_scene(raw);
        }
        let objects = self.objects(&raw.objects);
        self.refuse_segmentation_of_nothing(raw, outputs, objects.as_deref());
        objects
    }

    fn objects(&self, field: &Field<Vec<Field<schema::ObjectSection>>>) -> Option<Vec<ObjectSettings>> {
        let Some((list, place)) = field.given() else { return field.is_absent().then(Vec::new) };
        if list.len() > MAX_OBJECTS {
            let message = format!("has {} objects, wanted at most {MAX_OBJECTS}", list.len());
            return self.refuse(FieldProblem::of_field(message).at(place));
        }
        let mut seen = BTreeSet::new();
        for (name, place) in list.iter().filter_map(|item| item.given()?.0.name.given()) {
            if !seen.insert(name) {
                let message = format!("is {}, the name of an earlier object", quote_text(name));
                self.report(FieldProblem::of_field(message).at(place));
            }
        }
        all(list, |item| self.object(item))
    }

    fn refuse_segmentation_of_nothing(
        &self,
        raw: &schema::RecipeSchema,
        outputs: Option<&BTreeSet<OutputKind>>,
        objects: Option<&[ObjectSettings]>,
    ) {
        let is_wanted = outputs.into_iter().flatten().any(|output| output.shows_objects());
        if is_wanted && objects.is_some_and(<[_]>::is_empty) {
            let problem = FieldProblem::new(
                "the output segmentation needs objects: it shows which of them a pixel sees",
            );
            let help = "write objects: [{ name: ball, select: { … }, path: { … } }]";
            self.report(problem.help(help).at(raw.outputs.place().unwrap_or(self.root)));
        }
    }

    fn refuse_in_changing_scene(&self, raw: &schema::RecipeSchema) {
        if let Some((list, place)) = raw.objects.given().filter(|(list, _)| !list.is_empty()) {
            let message = format!("has {} objects in a scene that changes with time, wanted 0", list.len());
            let help = "remove `objects`, or the `time` or `fountain` of the scene";
            self.report(FieldProblem::of_field(message).help(help).at(place));
        }
    }

    fn object(&self, item: &Field<schema::ObjectSection>) -> Option<ObjectSettings> {
        let (raw, place) = item.given()?;
        let name = self.required(&raw.name, "name", place, "write name: ball");
        let name =
            name.and_then(|(name, at)| self.named(name, at, names::check_sensor(name), names::OBJECT_HELP));
        resolved!(ObjectSettings {
            name,
            from: self.object_source(raw, place),
            pivot: self.point(&raw.pivot),
            path: self.required(&raw.path, "path", place, PATH).and_then(|(path, _)| self.object_path(path)),
        })
    }

    fn object_source(&self, raw: &schema::ObjectSection, place: TextSpan) -> Option<ObjectSource> {
        match (&raw.select, &raw.scene) {
            (Field::Given(select, _), Field::Absent) => self.selection(select),
            (Field::Absent, Field::Given(scene, place)) => self.placed(scene, *place),
            (Field::Absent, Field::Absent) => {
                self.refuse(FieldProblem::missing_field("select").help(SOURCE).at(place))
            }
            (Field::Bad, _) | (_, Field::Bad) => None,
            (Field::Given(..), Field::Given(..)) => {
                let problem = FieldProblem::of_field("has both `select` and `scene`");
                self.refuse(problem.help("keep one of them: an object has one source").at(place))
            }
        }
    }

    fn selection(&self, raw: &schema::SelectSection) -> Option<ObjectSource> {
        match raw {
            schema::SelectSection::Box(field) => {
                let (raw, place) = field.given()?;
                let [low, high] = [(&raw.low, "low"), (&raw.high, "high")]
                    .map(|(corner, name)| self.needed_point(corner, name, place));
                let (low, high) = (low?, high?);
                if !low.cmple(high).all() {
                    let problem = FieldProblem::of_field("is empty: `low` is above `high`");
                    return self.refuse(problem.help("write the least corner first").at(place));
                }
                Some(ObjectSource::Box { low, high })
            }
            schema::SelectSection::Sphere(field) => {
                let (raw, place) = field.given()?;
                let centre = self.needed_point(&raw.centre, "centre", place);
                let radius = self.required(&raw.radius, "radius", place, "write its radius in scene units");
                let radius = radius.and_then(|_| self.real(&raw.radius, 1.0, SIZE));
                Some(ObjectSource::Sphere { centre: centre?, radius: radius? })
            }
            schema::SelectSection::Ids(field) => {
                self.path(field, self.root).map(|file| ObjectSource::Ids { file })
            }
        }
    }

    fn placed(&self, raw: &schema::PlacedSection, place: TextSpan) -> Option<ObjectSource> {
        let file = self.path(&raw.path, place);
        let (at, turn) = (self.point(&raw.at), self.turn(&raw.turn));
        let scale = self.real(&raw.scale, 1.0, SIZE);
        let file = file?;
        let splat = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("splat"));
        Some(ObjectSource::Scene { at: at?.unwrap_or_default(), turn: turn?, scale: scale?, splat, file })
    }

    fn object_path(&self, raw: &schema::ObjectPathSection) -> Option<ObjectPath> {
        match raw {
            schema::ObjectPathSection::Keyframes(field) => {
                let (list, place) = field.given()?;
                let path = ObjectPath::Keyframes(all(list, |item| self.object_key(item))?);
                match path.check() {
                    Ok(()) => Some(path),
                    Err(because) => {
                        self.refuse(FieldProblem::of_field(format!("make no path: {because}")).at(place))
                    }
                }
            }
            schema::ObjectPathSection::Orbit(field) => {
                let (raw, place) = field.given()?;
                let centre = self.needed_point(&raw.centre, "centre", place);
                self.required(&raw.axis, "axis", place, "write axis: [0, 1, 0]");
                let axis = self.direction(&raw.axis);
                let help = "write degrees_per_second: 90";
                let rate = self.required(&raw.degrees_per_second, "degrees_per_second", place, help);
                let rate = rate.and_then(|_| self.real(&raw.degrees_per_second, 0.0, TURN));
                Some(ObjectPath::Orbit { centre: centre?, axis: axis??, degrees_per_second: rate? })
            }
            schema::ObjectPathSection::Straight(field) => {
                let raw = field.or_default()?;
                let (velocity, spin) = (self.point(&raw.velocity), self.turn(&raw.spin));
                Some(ObjectPath::Straight { velocity: velocity?.unwrap_or_default(), spin: spin? })
            }
        }
    }

    fn object_key(&self, item: &Field<schema::ObjectKeySection>) -> Option<ObjectKeyframe> {
        let (raw, place) = item.given()?;
        let at = self.required(&raw.at, "at", place, "write its time in seconds, from the first pose");
        resolved!(ObjectKeyframe {
            at: at.and_then(|_| self.real(&raw.at, 0.0, SECONDS)),
            shift: self.point(&raw.shift).map(Option::unwrap_or_default),
            turn: self.turn(&raw.turn),
        })
    }

    fn needed_point(&self, field: &Triple, name: &str, within: TextSpan) -> Option<DVec3> {
        self.required(field, name, within, "write three coordinates of the world: [0, 0, 0]")?;
        self.point(field)?
    }

    /// An axis as long as an angle; no turn if it is absent.
    fn turn(&self, field: &Triple) -> Option<DVec3> {
        self.vector(field, TURN).map(Option::unwrap_or_default)
    }
}
