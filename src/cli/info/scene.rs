//! Properties of a scene, and a first recipe for it.

use super::{PathFacts, short};
use crate::cli::{VerbError, input, path};
use glam::DVec3;
use gs2e_files::escape;
use gs2e_image::Size;
use gs2e_num::units::brief;
use gs2e_scene::camera::Camera;
use gs2e_scene::dynamic::file::{default_time, read_dynamic};
use gs2e_scene::dynamic::{SceneSpan, SceneTime, SplatDynamics};
use gs2e_scene::form::{SceneFileForm, file_form};
use gs2e_scene::survey::{SceneOrbit, SceneSurvey, UpRule};
use gs2e_scene::{self as scene, Gaussians};
use serde_json::json;
use std::path::Path;

/// The camera of the suggested recipe: 60 degrees wide.
const CAMERA: Camera =
    Camera { size: Size { width: 640, height: 480 }, fx: 554.0, fy: 554.0, cx: 320.0, cy: 240.0, lens: None };

/// The properties of the scene at `place`, which a recipe names as `named`.
pub(super) fn scene_facts(place: &Path, named: &Path) -> Result<PathFacts, VerbError> {
    let unreadable = |e| input::unreadable_path(place, e);
    let form = file_form(place).map_err(unreadable)?;
    let time = default_time(place).map_err(unreadable)?.filter(|_| form.may_change);
    let read = time.map_or_else(|| scene::read_any(place), |time| read_dynamic(place, time));
    let gaussians = read.map_err(|e| {
        input::unreadable_file("file", &e).help("gs2e info --help lists the files and folders that are known")
    })?;
    let survey = SceneSurvey::measure_scene(&gaussians);
    let orbit = survey.orbit(&CAMERA).rounded();
    let recipe = suggested_recipe(named, time, &orbit);
    let mut value = json!({
        "format": form.format,
        "position_bits": form.position_bits,
        "gaussians": gaussians.len(),
        "screening": gaussians.screening,
        "sh_degree": gaussians.sh_degree,
        "antialiased": gaussians.antialiased,
        "survey": survey,
        "orbit": orbit,
        "recipe": recipe.join("\n") + "\n",
    });
    let mut rows = scene_rows(&form, &gaussians, &survey);
    if let Some(dynamics) = gaussians.dynamics() {
        rows.insert(1, ("change", change_words(dynamics)));
        value["change"] = json!({
            "degree": dynamics.degree(),
            "frames": dynamics.frames(),
            "harmonics": dynamics.has_harmonics(),
            "end_s": dynamics.end_s(),
        });
    }
    Ok(PathFacts { kind: "scene", title: "a scene", rows, recipe, value })
}

/// The change of a scene in words. The unit of its time is a guess.
fn change_words(dynamics: &SplatDynamics) -> String {
    let end = short(dynamics.end_s());
    match dynamics.frames() {
        Some(frames) => {
            let harmonics = if dynamics.has_harmonics() { "" } else { "; harmonics stay" };
            format!("a sequence of {frames} frames, {end} s at 30 frames per second{harmonics}")
        }
        None => format!("tracks of degree {}, from 0 to the `duration` of a recipe", dynamics.degree()),
    }
}

fn scene_rows(
    form: &SceneFileForm,
    gaussians: &Gaussians,
    survey: &SceneSurvey,
) -> Vec<(&'static str, String)> {
    let bits = form.position_bits.map(|bits| format!(", positions of {bits} bits")).unwrap_or_default();
    let dropped = match gaussians.screening.non_finite {
        0 => String::new(),
        dropped => format!(", and {dropped} dropped, with a NaN or an infinity"),
    };
    let rule = match survey.up.rule {
        UpRule::Layer => "the normal of the layer that the Gaussians form, on the side where things stand",
        UpRule::LayerAlike => "the normal of the layer that the Gaussians form, on the side of -y",
        UpRule::Colmap => "COLMAP's -y, since the Gaussians form no layer",
    };
    let bound = |(k, name)| format!("{name} {} to {}", short(survey.low[k]), short(survey.high[k]));
    let bounds: Vec<String> = ["x", "y", "z"].into_iter().enumerate().map(bound).collect();
    let mut rows = vec![
        ("format", format!("{}{bits}", form.format)),
        ("Gaussians", format!("{}{dropped}", gaussians.len())),
        ("harmonics", format!("degree {}", gaussians.sh_degree)),
        ("bounds", format!("{}; each holds 95 % of the opacity", bounds.join(", "))),
        ("centre", format!("{}, the median on each axis", vector(survey.centre, short))),
        ("radius", format!("{}, which holds 95 % of the opacity", short(survey.radius))),
        ("up", format!("{}, a guess: {rule}", vector(survey.up.direction, short))),
    ];
    if let Some(antialiased) = gaussians.antialiased {
        let trained = if antialiased { "with" } else { "without" };
        rows.insert(3, ("trained", format!("{trained} antialiasing")));
    }
    rows
}

fn vector(v: DVec3, number: impl Fn(f64) -> String) -> String {
    format!("[{}, {}, {}]", number(v.x), number(v.y), number(v.z))
}

/// A recipe with an orbit about the scene.
fn suggested_recipe(named: &Path, time: Option<SceneTime>, orbit: &SceneOrbit) -> Vec<String> {
    // `-0` is a number too, but an odd one.
    let [centre, from, up] = [orbit.centre, orbit.from, orbit.up].map(|v| vector(v + DVec3::ZERO, brief));
    let Camera { size, fx, .. } = CAMERA;
    let time = match time.map(|time| time.span) {
        Some(SceneSpan::Duration(seconds)) => format!(", time: {{ duration: {seconds} }}"),
        Some(SceneSpan::Rate(hertz)) => format!(", time: {{ rate: {hertz} }}"),
        None => String::new(),
    };
    vec![
        "# A first recipe. Paths are relative to its folder; `up` is a guess.".to_owned(),
        "version: 1".to_owned(),
        "scene: my-scene".to_owned(),
        "source: none".to_owned(),
        format!("reconstruct: {{ given: {{ path: {}{time} }} }}", escape::quoted(&path(named))),
        format!("camera: {{ width: {}, height: {}, fx: {fx} }}", size.width, size.height),
        "trajectories:".to_owned(),
        "  - name: orbit".to_owned(),
        format!("    orbit: {{ centre: {centre}, from: {from}, up: {up} }}"),
        "    speed: { flow: { px_s: 400 } }".to_owned(),
        "sampling: { tolerance: 0.1 }".to_owned(),
        "sharp: { fps: 30 }".to_owned(),
    ]
}
