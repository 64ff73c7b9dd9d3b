//! Resolution of a written recipe: required fields, ranges, defaults, presets, and paths.

/// A structure from its parts, each an `Option` that is `None` if it is faulty; `None` if one of them is.
/// All parts are resolved before that is asked, so that all faults are reported. A part may use those
/// above it, and a part without a value is a variable of its name.
macro_rules! resolved {
    ($name:ident { $($part:ident $(: $value:expr)?),* $(, ..$rest:expr)? $(,)? }) => {{
        $($(let $part = $value;)?)*
        // In a closure, so that `?` ends the structure and not its caller.
        Some(()).and_then(|()| Some($name { $($part: $part?,)* $(..$rest)? }))
    }};
}
pub(super) use resolved;

mod imu;
mod licence;
mod lights;
mod number;
mod objects;
mod outputs;
mod picture;
mod reconstruct;
mod rig;
mod sampling;
mod sensor;
mod source;
pub(super) mod trajectory;

use super::field::{Field, UnsupportedField};
use super::problem::{FieldProblem, quote_text};
use super::reader::Problems;
use super::text::TextSpan;
use super::{
    OutputKind, Recipe, RecipeMeta, ReconstructMethod, SceneScale, SceneSource, TrajectoryRecipe, names,
    schema,
};
use gs2e_render::{RenderChoice, RenderRules};
use gs2e_scene::camera::CameraChoice;
use gs2e_trajectory::speed::SpeedChoice;
use reconstruct::ReconstructContext;
use rig::RigContext;
use std::collections::BTreeSet;
use std::path::PathBuf;
use trajectory::TrajectoryContext;

/// Resolves the content of a file and collects its faults.
pub(super) struct Resolver<'a> {
    /// The faults found so far.
    pub problems: &'a Problems,
    /// Folder of each file of the recipe. Relative paths start there.
    pub folders: &'a [PathBuf],
    /// Place of the whole file, for missing fields.
    pub root: TextSpan,
}

impl Resolver<'_> {
    /// Resolves a recipe without its meta data; `None` after reporting a fault.
    pub(super) fn recipe(&self, raw: &schema::RecipeSchema) -> Option<Recipe> {
        // Only a missing version is left: any other one ended the reading before.
        self.required(&raw.version, "version", self.root, "write version: 1");
        self.later(&raw.release, "this gs2e releases only the products");
        let between = self.between(&raw.sampling);
        let has_scene = !raw.reconstruct.is_absent();
        let recipe = resolved!(Recipe {
            meta: Some(RecipeMeta::default()),
            scene: self.scene(&raw.scene),
            seed: raw.seed.or(0),
            source: self.source(&raw.source),
            group: self.said(&raw.group),
            camera: self.recipe_camera(raw, source.as_ref()),
            rate: self.rate(&raw.sampling),
            law: self.summation(&raw.sampling),
            trajectories: {
                let (scene, source) = (scene.as_deref(), source.as_ref());
                let context = TrajectoryContext { scene, seed, source, rate, law, has_scene };
                self.trajectories(&raw.trajectories, context)
            },
            sensors: self.sensors(raw, between, rate),
            tolerance: self.tolerance(&raw.sampling, sensors.as_ref()),
            outputs: self.outputs(&raw.outputs),
            reconstruct: {
                let renders = renders(outputs.as_ref(), trajectories.as_deref());
                self.reconstruct(
                    &raw.reconstruct,
                    ReconstructContext { source: source.as_ref(), seed, renders },
                )
            },
            rig: {
                let (source, outputs) = (source.as_ref(), outputs.as_ref());
                self.rig(raw, RigContext { source, camera, between, rate, outputs })
            },
            every: self.spacing(raw, rate),
            readout_us: self.readout_us(&raw.sharp),
            shutter: self.shutter(&raw.blur, rate),
            scale: self.scene_scale(&raw.attributes),
            imu: self.imu(raw, source.as_ref(), outputs.as_ref(), trajectories.as_deref()),
            lights: self.lights(raw, rate, outputs.as_ref()),
            objects: self.objects_and_segmentation(
                raw,
                outputs.as_ref(),
                changes(source.as_ref(), &reconstruct)
            ),
            render: self.render_along(raw, source.as_ref(), &reconstruct),
            checks: raw.checks.or_default(),
            licence: self.licence(&raw.licence, source.as_ref()),
        })?;
        let recipe = rig::with_cameras(recipe);
        // After the cameras of a rig have their trajectories, because blurred frames belong to those.
        self.refuse_long_exposures(&raw.blur, &recipe)?;
        Some(recipe)
    }

    /// The rendering with the default plane of `near`: the renderer's own for a scene that is trained here,
    /// which may have Gaussians anywhere. A scene that changes with time has none.
    fn render_along(
        &self,
        raw: &schema::RecipeSchema,
        source: Option<&SceneSource>,
        reconstruct: &Option<Option<ReconstructMethod>>,
    ) -> Option<RenderChoice> {
        let render = self.render(&raw.render, default_rules(&raw.sampling))?;
        if render.near.is_some() && changes(source, reconstruct) {
            let place = raw.render.given().map_or(self.root, |(_, place)| place);
            let problem = FieldProblem::new("render.near needs a scene that does not change with time")
                .help("leave `near` out");
            return self.refuse(problem.at(place));
        }
        let is_trained = matches!(reconstruct, Some(Some(ReconstructMethod::Builtin(_))));
        Some(RenderChoice { near: render.near.or(is_trained.then_some(0.0)), ..render })
    }

    /// The camera of the recipe. Without views it is required, unless every camera of a rig has its own.
    fn recipe_camera(
        &self,
        raw: &schema::RecipeSchema,
        source: Option<&SceneSource>,
    ) -> Option<Option<CameraChoice>> {
        let cameras = raw.rig.given().and_then(|(rig, _)| rig.cameras.given());
        let has_own = |item: &Field<schema::RigCameraSection>| {
            item.given().is_some_and(|(camera, _)| !camera.camera.is_absent())
        };
        if raw.camera.is_absent() && cameras.is_some_and(|(list, _)| list.iter().all(has_own)) {
            return Some(None);
        }
        self.camera(&raw.camera, source)
    }

    fn scene_scale(&self, field: &Field<schema::AttributesSection>) -> Option<Option<SceneScale>> {
        field.or_default()?.scene_scale.optional(|scale| Some(*scale.given()?.0))
    }

    fn scene(&self, field: &Field<String>) -> Option<String> {
        let help = "write scene: my/scene, its id and its folder in the release";
        let (id, place) = self.required(field, "scene", self.root, help)?;
        self.named(id, place, names::scene_id(id), names::SCENE_HELP)
    }

    /// Returns a name if the verdict accepts it.
    fn named(&self, name: &str, place: TextSpan, verdict: Result<(), String>, help: &str) -> Option<String> {
        match verdict {
            Ok(()) => Some(name.to_owned()),
            Err(because) => {
                let problem = FieldProblem::of_field(format!("is {}, {because}", quote_text(name)));
                self.refuse(problem.help(help).at(place))
            }
        }
    }

    fn report(&self, problem: FieldProblem) {
        self.problems.borrow_mut().push(problem);
    }

    /// Reports a problem and returns no value.
    pub(super) fn refuse<T>(&self, problem: FieldProblem) -> Option<T> {
        self.report(problem);
        None
    }

    /// Refuses a field whose feature is not built yet; `instead` describes the existing
    /// alternative.
    pub(super) fn later(&self, field: &Field<UnsupportedField>, instead: &str) {
        if let Some(place) = field.place() {
            self.report(FieldProblem::of_key("is not supported yet").help(instead).at(place));
        }
    }

    /// Returns the value of a required field in the mapping at `within`.
    pub(super) fn required<'f, T>(
        &self,
        field: &'f Field<T>,
        name: &str,
        within: TextSpan,
        help: &str,
    ) -> Option<(&'f T, TextSpan)> {
        // A faulty field was reported when it was read.
        if field.is_absent() {
            self.report(FieldProblem::missing_field(name).help(help).at(within));
        }
        field.given()
    }

    /// Returns a text that is not blank.
    pub(super) fn filled(&self, text: &str, place: TextSpan) -> Option<String> {
        if text.trim().is_empty() {
            return self.refuse(FieldProblem::of_field("is empty").at(place));
        }
        Some(text.to_owned())
    }

    /// Returns an optional text that is not blank.
    pub(super) fn said(&self, field: &Field<String>) -> Option<Option<String>> {
        field.optional(|text| text.given().and_then(|(text, place)| self.filled(text, place)))
    }
}

/// Resolves all items of a list before the first faulty one ends it, so that all faults are reported.
pub(super) fn all<T, U, C: FromIterator<U>>(
    list: impl IntoIterator<Item = T>,
    resolve: impl FnMut(T) -> Option<U>,
) -> Option<C> {
    let items: Vec<Option<U>> = list.into_iter().map(resolve).collect();
    items.into_iter().collect()
}

/// Returns true if something is rendered. A speed in pixels needs the scene even without outputs.
fn renders(outputs: Option<&BTreeSet<OutputKind>>, trajectories: Option<&[TrajectoryRecipe]>) -> bool {
    let mut outputs = outputs.into_iter().flatten();
    let mut speeds = trajectories.into_iter().flatten().map(|trajectory| &trajectory.speed);
    outputs.any(|output| !output.is_measured()) || speeds.any(|speed| matches!(speed, SpeedChoice::Flow(_)))
}

/// Returns true if the scene changes with time.
fn changes(source: Option<&SceneSource>, reconstruct: &Option<Option<ReconstructMethod>>) -> bool {
    matches!(reconstruct, Some(Some(ReconstructMethod::Changing(..))))
        || matches!(source, Some(SceneSource::Procedural(scene)) if scene.fountain.is_some())
}

/// Default rules of rendering. If the recipe asks for an error, the rules have no jumps at cuts of
/// alpha (docs/design/numerics-path.md, "Jumps of the renderer"). Otherwise they are the rules
/// of the reference implementation.
fn default_rules(sampling: &Field<schema::SamplingSection>) -> RenderRules {
    let tolerant = sampling.given().is_some_and(|(raw, _)| !raw.tolerance.is_absent());
    if tolerant { RenderRules::Soft } else { RenderRules::Official }
}
