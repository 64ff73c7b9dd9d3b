//! Rigs: cameras on one body.

use super::number::RealRange;
use super::{Resolver, all};
use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::rig::{RigCamera, StereoPartner};
use crate::text::TextSpan;
use crate::{OutputKind, Recipe, SceneSource, names, schema};
use glam::{DMat3, DQuat, DVec3};
use gs2e_image::Size;
use gs2e_num::se3::{RotationError, Se3, rotation_from_matrix, rotation_from_quaternion};
use gs2e_num::units::Hertz;
use gs2e_scene::camera::stereo::Rectification;
use gs2e_scene::camera::{Camera, CameraChoice};
use gs2e_sensor::SensorSet;
use gs2e_sensor::voltmeter::BetweenFrames;
use gs2e_trajectory::mount::CameraMount;
use std::collections::BTreeSet;

/// Entries of matrices and quaternions. The range is wide, so that what is no rotation gets the message about
/// rotations.
const ENTRY: RealRange = RealRange::new(-1e6, 1e6);
/// Positions on the body, scene units.
const PLACE: RealRange = RealRange::new(-1e6, 1e6);

const CAMERAS: &str =
    "write rig: { cameras: [{ name: left }, { name: right, extrinsic: { position: [0.1, 0, 0] } }] }";

/// The parts of the recipe that the cameras of a rig share; a part with a fault is missing.
#[derive(Debug, Clone, Copy)]
pub(super) struct RigContext<'a> {
    pub(super) source: Option<&'a SceneSource>,
    pub(super) camera: Option<Option<CameraChoice>>,
    pub(super) between: Option<BetweenFrames>,
    pub(super) rate: Option<Hertz>,
    pub(super) outputs: Option<&'a BTreeSet<OutputKind>>,
}

impl Resolver<'_> {
    /// The cameras of the rig; empty without one.
    pub(super) fn rig(&self, raw: &schema::RecipeSchema, context: RigContext<'_>) -> Option<Vec<RigCamera>> {
        self.refuse_pairs_of_nothing(raw, context.outputs);
        let Some((rig, place)) = raw.rig.given() else { return raw.rig.is_absent().then(Vec::new) };
        let (list, place) = self.required(&rig.cameras, "cameras", place, CAMERAS)?;
        if list.is_empty() {
            let problem = FieldProblem::of_field("is an empty list, wanted at least one");
            return self.refuse(problem.help(CAMERAS).at(place));
        }
        self.refuse_repeated_cameras(list);
        let pairs = self.pairs(&rig.stereo, list);
        let camera = |item: &Field<schema::RigCameraSection>| {
            let name = item.given()?.0.name.given().map(|(name, _)| name);
            let is_first = pairs.iter().flatten().any(|(pair, _)| Some(&pair[0]) == name);
            self.rig_camera(item, is_first, context)
        };
        let mut cameras: Vec<RigCamera> = all(list, camera)?;
        for ([first, second], place) in pairs? {
            let find = |name: &String| cameras.iter().position(|camera| camera.name == *name);
            // A name without a camera was reported when the pairs were read.
            let (Some(first), Some(second)) = (find(&first), find(&second)) else { continue };
            let RigCamera { name, mount, camera, .. } = cameras[second].clone();
            cameras[first].second = Some(StereoPartner { name, mount, camera });
            self.refuse_no_pair(&cameras[first], place);
        }
        self.refuse_intolerant(&raw.sampling, &cameras);
        Some(cameras)
    }

    /// Refuses products of stereo pairs where there is no pair.
    fn refuse_pairs_of_nothing(&self, raw: &schema::RecipeSchema, outputs: Option<&BTreeSet<OutputKind>>) {
        let pairs = raw.rig.given().and_then(|(rig, _)| rig.stereo.given()).map_or(0, |(list, _)| list.len());
        let of_pairs = outputs.into_iter().flatten().find(|output| output.is_of_pair());
        if let Some(output) = of_pairs.filter(|_| pairs == 0) {
            let message = format!("the output {} needs a pair of cameras in rig.stereo", output.name());
            let help = "write rig: { cameras: [{ name: left }, …], stereo: [[left, right]] }";
            let place = raw.outputs.place().unwrap_or(self.root);
            self.report(FieldProblem::new(message).help(help).at(place));
        }
    }

    fn refuse_repeated_cameras(&self, list: &[Field<schema::RigCameraSection>]) {
        let mut seen = BTreeSet::new();
        for (name, place) in list.iter().filter_map(|item| item.given()?.0.name.given()) {
            if !seen.insert(name.to_lowercase()) {
                let message = format!("is {}, the name of an earlier camera", quote_text(name));
                let help = "names are folders, and some systems ignore case in them";
                self.report(FieldProblem::of_field(message).help(help).at(place));
            }
        }
    }

    /// The names of the pairs, with their places.
    fn pairs(
        &self,
        field: &Field<Vec<Field<[Field<String>; 2]>>>,
        cameras: &[Field<schema::RigCameraSection>],
    ) -> Option<Vec<([String; 2], TextSpan)>> {
        let Some((list, _)) = field.given() else { return field.is_absent().then(Vec::new) };
        let known = cameras.iter().filter_map(|item| Some(item.given()?.0.name.given()?.0.as_str()));
        let known: Vec<&str> = known.collect();
        let mut seen = BTreeSet::new();
        let mut pairs = Vec::new();
        for (pair, place) in list.iter().map(Field::given).collect::<Option<Vec<_>>>()? {
            for (name, at) in pair.iter().filter_map(Field::given) {
                if !known.contains(&name.as_str()) {
                    self.report(FieldProblem::unknown_name("camera", name, &known).at(at));
                } else if !seen.insert(name.as_str()) {
                    let message = format!("is {}, which is in a pair already", quote_text(name));
                    let help = "each camera has one rectification: write it in one pair";
                    self.report(FieldProblem::of_field(message).help(help).at(at));
                }
            }
            let [first, second] = pair.each_ref().map(|name| name.given().map(|(name, _)| name.clone()));
            pairs.push(([first?, second?], place));
        }
        Some(pairs)
    }

    /// Refuses a pair that has no rectification. Cameras of the source are not known here, and have one size.
    fn refuse_no_pair(&self, first: &RigCamera, place: TextSpan) {
        let (Some(second), Some(motion)) = (&first.second, first.second_from_first()) else { return };
        let pair =
            [first.camera, second.camera].map(|camera| camera.map(|camera| (camera.width, camera.height)));
        if let [Some(_), None] | [None, Some(_)] = pair {
            let message = "is no pair: one camera has the size of the source, and the other its own";
            return self.report(FieldProblem::of_field(message).help("write both, with one size").at(place));
        }
        // Of a camera whose focal length is the source's, only the size and the baseline are judged.
        let stand_in = Camera::pinhole(Size { width: 1, height: 1 }, [1e6, 1e6, 0.5, 0.5]);
        let judged = [first.camera, second.camera].map(|choice| {
            let of_size = |choice: CameraChoice| {
                let size = Size { width: choice.width, height: choice.height };
                let [cx, cy] = [choice.width, choice.height].map(|side| f64::from(side) / 2.0);
                Camera::pinhole(size, [1e9, 1e9, cx, cy])
            };
            choice.map_or(stand_in, |choice| choice.resolve(None).unwrap_or_else(|| of_size(choice)))
        });
        if let Err(error) = Rectification::new(judged, &motion) {
            let problem = FieldProblem::of_field(format!("is no stereo pair: {error}"));
            self.report(problem.help("write two cameras that see the same, apart from each other").at(place));
        }
    }

    fn rig_camera(
        &self,
        item: &Field<schema::RigCameraSection>,
        is_first: bool,
        context: RigContext<'_>,
    ) -> Option<RigCamera> {
        let (raw, place) = item.given()?;
        let name = self.required(&raw.name, "name", place, "write name: left, its folder in the release");
        let name =
            name.and_then(|(name, at)| self.named(name, at, names::check_camera(name), names::CAMERA_HELP));
        resolved!(RigCamera {
            name,
            mount: self.mount(&raw.extrinsic),
            camera: match &raw.camera {
                Field::Absent => context.camera,
                own => self.camera(own, context.source),
            },
            sensors: raw
                .sensor
                .optional(|own| self.sensor(own, context.between, context.rate).map(SensorSet::One)),
            outputs: self.camera_outputs(&raw.outputs, is_first, context.outputs),
            second: Some(None),
        })
    }

    /// The products of a camera: some of those of the recipe. Those of a pair belong to its first camera.
    fn camera_outputs(
        &self,
        field: &Field<Vec<Field<OutputKind>>>,
        is_first: bool,
        all: Option<&BTreeSet<OutputKind>>,
    ) -> Option<BTreeSet<OutputKind>> {
        let seen = |outputs: &BTreeSet<OutputKind>| -> BTreeSet<OutputKind> {
            let sees = |output: &OutputKind| !output.is_measured() && (is_first || !output.is_of_pair());
            outputs.iter().copied().filter(sees).collect()
        };
        let Some((list, _)) = field.given() else {
            return if field.is_absent() { all.map(seen) } else { None };
        };
        let (own, all) = (self.outputs(field)?, all?);
        for (output, place) in list.iter().filter_map(Field::given) {
            let message = if output.is_measured() {
                format!("names {}, which belongs to the body", output.name())
            } else if output.is_of_pair() && !is_first {
                format!("names {}, which belongs to the first camera of a stereo pair", output.name())
            } else if all.contains(output) {
                continue;
            } else {
                format!("names {}, which the recipe does not ask for", output.name())
            };
            let help = "leave it out here, or add it to the recipe's `outputs`";
            self.report(FieldProblem::of_field(message).help(help).at(place));
        }
        Some(own)
    }

    /// The place of a camera on the body, by position and rotation or by a matrix.
    fn mount(&self, field: &Field<schema::ExtrinsicSection>) -> Option<CameraMount> {
        let raw = field.or_default()?;
        let Some((rows, place)) = raw.camera_from_body.given() else {
            let (position, rotation) =
                (self.place_on_body(&raw.position), self.rotation_on_body(&raw.rotation));
            let (position, rotation) = (position?, rotation?);
            return raw.camera_from_body.is_absent().then(|| placed(position, rotation));
        };
        if !raw.position.is_absent() || !raw.rotation.is_absent() {
            let problem = FieldProblem::of_field("has both `camera_from_body` and `position` or `rotation`");
            return self.refuse(problem.help("keep one of them").at(place));
        }
        self.matrix(rows, place)
    }

    fn place_on_body(&self, field: &Field<[Field<f64>; 3]>) -> Option<DVec3> {
        self.vector(field, PLACE).map(Option::unwrap_or_default)
    }

    fn rotation_on_body(&self, field: &Field<[Field<f64>; 4]>) -> Option<DQuat> {
        let Some((list, place)) = field.given() else { return field.is_absent().then_some(DQuat::IDENTITY) };
        // Kept as written, so that the full form of a recipe is its own full form.
        let written = DQuat::from_array(self.numbers(list, ENTRY)?);
        match rotation_from_quaternion(written) {
            Ok(_) => Some(written),
            Err(error) => self.no_rotation(&error, "write qx, qy, qz, qw of length 1, camera to body", place),
        }
    }

    fn matrix(&self, rows: &[Field<[Field<f64>; 4]>; 4], place: TextSpan) -> Option<CameraMount> {
        let rows = rows.each_ref().map(|row| self.numbers(row.given()?.0, ENTRY));
        let [x, y, z, last] = rows;
        let ([x, y, z], last) = ([x?, y?, z?], last?);
        let exact = last.map(f64::to_bits) == [0.0f64, 0.0, 0.0, 1.0].map(f64::to_bits);
        if !exact {
            let problem = FieldProblem::of_field(format!("has the last row {last:?}, wanted [0, 0, 0, 1]"));
            return self.refuse(problem.help("write a rotation and a translation").at(place));
        }
        let columns = [0, 1, 2, 3].map(|k| DVec3::new(x[k], y[k], z[k]));
        match rotation_from_matrix(&DMat3::from_cols(columns[0], columns[1], columns[2])) {
            Ok(screened) => {
                let camera_from_body = Se3 { rotation: screened.rotation, translation: columns[3] };
                let Se3 { rotation, translation } = camera_from_body.inverse();
                Some(placed(translation, rotation))
            }
            Err(error) => {
                self.no_rotation(&error, "its first three columns are a rotation, body to camera", place)
            }
        }
    }

    fn no_rotation<T>(&self, error: &RotationError, help: &str, place: TextSpan) -> Option<T> {
        self.refuse(FieldProblem::of_field(format!("is invalid: {error}")).help(help).at(place))
    }
}

/// A place on a body. Zeros lose their sign, which the full form of a recipe does not keep.
fn placed(position: DVec3, rotation: DQuat) -> CameraMount {
    CameraMount { position: position + DVec3::ZERO, rotation: rotation + DQuat::from_array([0.0; 4]) }
}

/// The recipe with the trajectories of its rig's cameras, each after that of its body.
pub(super) fn with_cameras(recipe: Recipe) -> Recipe {
    let all = recipe.trajectories.into_iter().flat_map(|body| {
        let cameras: Vec<_> = recipe.rig.iter().map(|camera| body.of_camera(camera)).collect();
        std::iter::once(body).chain(cameras)
    });
    let trajectories = all.collect();
    // The first camera of a rig measures the speeds in pixels.
    let camera = recipe.rig.first().map_or(recipe.camera, |first| first.camera);
    Recipe { trajectories, camera, ..recipe }
}
