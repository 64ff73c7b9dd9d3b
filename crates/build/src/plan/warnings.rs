//! Recipes that can be built and hardly mean what they say: warnings, each with a remedy.

use super::forecast::PlanForecast;
use gs2e_files as files;
use gs2e_num::units::format_amount;
use gs2e_recipe::{Recipe, ReconstructMethod};
use gs2e_scene as scene;
use gs2e_scene::form;
use gs2e_scene::survey::SceneSurvey;
use gs2e_trajectory::path::CameraPath;

/// Bytes of a release above which the size is a warning.
const LARGE: f64 = 10e9;
/// Horizontal angle of view above which a focal length is hardly in pixels, degrees.
const WIDE_DEG: f64 = 170.0;
/// Distance from the centre of an orbit, units, from which on it is compared with the scene.
const FAR: f64 = 1000.0;
/// The same in radii of the scene, which then covers less than a hundredth of the picture's sides.
const FAR_RADII: f64 = 100.0;

/// A warning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlanWarning {
    /// Scene id; `None` for the whole plan.
    pub scene: Option<String>,
    /// Short name of its kind, for programs.
    pub code: &'static str,
    /// The finding.
    pub what: String,
    /// The remedy.
    pub help: String,
}

/// The warnings of one recipe.
#[must_use]
pub fn recipe_warnings(recipe: &Recipe) -> Vec<PlanWarning> {
    let found = unused_sections(recipe).into_iter().chain(contrasts(recipe)).chain(wide_view(recipe));
    found
        .chain(far_orbits(recipe))
        .map(|(code, what, help)| PlanWarning { scene: Some(recipe.scene.clone()), code, what, help })
        .collect()
}

/// The warning for a large release.
#[must_use]
pub fn size_warning(forecast: &PlanForecast) -> Option<PlanWarning> {
    let PlanForecast { poses, bytes, .. } = *forecast;
    let what = format!("the release takes about {:.0} GB for {poses:.0} poses", bytes * 1e-9);
    let help = "write fewer pictures, such as sharp: { fps: 30 }, or a shorter path".to_owned();
    (bytes > LARGE).then_some(PlanWarning { scene: None, code: "large-release", what, help })
}

/// The scene file of a recipe that has no format of a scene, if it has none.
#[must_use]
pub fn no_scene_file(recipe: &Recipe) -> Option<std::path::PathBuf> {
    match &recipe.reconstruct {
        Some(ReconstructMethod::Given(path) | ReconstructMethod::Changing(path, _)) => {
            // A missing file is reported with its place in the recipe.
            let is_none = files::is_there(path) && !form::has_scene_form(path).unwrap_or(true);
            is_none.then(|| path.clone())
        }
        _ => None,
    }
}

type FoundWarning = (&'static str, String, String);

fn unused_sections(recipe: &Recipe) -> Vec<FoundWarning> {
    let unused = |name: &String| {
        let help = format!("add {name} to outputs, or remove the section");
        ("unused-section", format!("the section {name} has no effect: outputs does not name {name}"), help)
    };
    recipe.meta.unused.iter().map(unused).collect()
}

fn contrasts(recipe: &Recipe) -> Vec<FoundWarning> {
    let mut found = Vec::new();
    for (name, sensor) in recipe.every_sensor() {
        let Ok(screening) = sensor.screen(recipe.rate) else { continue };
        let whose = name.map_or_else(|| "the sensor".to_owned(), |name| format!("the sensor {name}"));
        for warning in screening.warnings.iter().filter(|warning| warning.is_of_contrast()) {
            found.push(("contrast", format!("{whose}: {warning}"), "write contrast: 0.2".to_owned()));
        }
    }
    found
}

fn wide_view(recipe: &Recipe) -> Option<FoundWarning> {
    let camera = recipe.camera?.resolve(None)?;
    let degrees = 2.0 * libm::atan(0.5 * f64::from(camera.size.width) / camera.fx).to_degrees();
    let help = "fx is in pixels: about the width of the image; or write fov: 60".to_owned();
    let what = format!("the camera sees {degrees:.1} degrees across, with fx {}", camera.fx);
    (degrees > WIDE_DEG && camera.lens.is_none()).then_some(("wide-view", what, help))
}

/// Orbits from which the scene is a dot.
fn far_orbits(recipe: &Recipe) -> Option<FoundWarning> {
    let far = recipe.trajectories.iter().find_map(|trajectory| {
        let CameraPath::Orbit(orbit) = &trajectory.path else { return None };
        let distance = orbit.from?.distance(orbit.centre?);
        (distance > FAR).then_some((&trajectory.written, distance))
    });
    // The scene is read only now: a large file takes long, and few orbits are that far from their centre.
    let (name, distance) = far?;
    let Some(ReconstructMethod::Given(path)) = &recipe.reconstruct else { return None };
    let scene = scene::read_file(path).ok().filter(|scene| !scene.is_empty())?;
    let radius = SceneSurvey::measure_scene(&scene).radius;
    let what = format!(
        "the orbit {name} is {distance} units from its centre, and the scene has a radius of {radius:.3}: \
         the pictures will be empty"
    );
    let help = format!("`gs2e info {}` prints an orbit that shows the scene", path.display());
    (distance > FAR_RADII * radius).then_some(("far-orbit", what, help))
}

/// The forecast in words, for people.
#[must_use]
pub fn forecast_words(forecast: &PlanForecast) -> Vec<String> {
    let PlanForecast { trajectories, poses, seconds, files, bytes, event_bytes, unknown } = forecast;
    let mut lines = Vec::new();
    if *trajectories > 0.0 {
        lines.push(format!(
            "a release: {poses:.0} poses, {seconds:.2} s of motion, about {files:.0} files and {}, of which events {}",
            amount(*bytes),
            amount(*event_bytes)
        ));
    }
    if let Some(first) = unknown.first() {
        let others = match unknown.len() {
            1 => String::new(),
            count => format!(" and {} others", count - 1),
        };
        lines.push(format!("not counted: {first}{others}, whose length is known once its poses are built"));
    }
    lines
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast saturates")]
fn amount(bytes: f64) -> String {
    format_amount(bytes as u64, "B")
}
