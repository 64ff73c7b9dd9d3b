//! Properties of a capture.

use super::{PathFacts, short};
use crate::cli::{Console, VerbError, input};
use gs2e_scene::camera::Camera;
use gs2e_source::kind::CaptureKind;
use gs2e_source::{Capture, LensModel, SourceWarning};
use gs2e_trajectory::NamedPose;
use gs2e_trajectory::knots::{CaptureGap, GAP};
use gs2e_trajectory::walk::{CaptureEvenness, ViewDetour};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Maximum number of cameras shown to people; `--json` has all.
const MAX_CAMERAS: usize = 4;

/// The properties of the capture at a path; where several programs left one, of each.
pub(super) fn capture_facts(place: &Path, console: &Console) -> Result<PathFacts, VerbError> {
    let known = |error: VerbError| error.help("gs2e info --help lists the files and folders that are known");
    let kinds = CaptureKind::kinds_at(place).map_err(|e| known(input::no_source("path", &e, place)))?;
    let mut found =
        kinds.iter().map(|kind| kind_facts(*kind, place, console)).collect::<Result<Vec<_>, _>>()?;
    if found.len() == 1 {
        return Ok(found.remove(0));
    }
    let captures: Vec<&Value> = found.iter().map(|facts| &facts.value).collect();
    let value = json!({ "captures": captures });
    let rows = found.into_iter().flat_map(|facts| facts.rows).collect();
    let title = "several captures; a recipe names one of them";
    Ok(PathFacts { kind: "captures", title, rows, recipe: Vec::new(), value })
}

fn kind_facts(kind: CaptureKind, place: &Path, console: &Console) -> Result<PathFacts, VerbError> {
    let (capture, warnings) = kind.read(place).map_err(|e| input::unreadable_file("capture", &e))?;
    report_warnings(&warnings, console);
    let cameras = distinct_cameras(&capture);
    let missing: Vec<&str> =
        capture.views.iter().filter(|view| view.sha256.is_none()).map(|view| view.name.as_str()).collect();
    let evenness = capture_evenness(&capture);
    let value = json!({
        "capture": kind.name(), "views": capture.views.len(),
        "photos_missing": missing, "photos_unused": capture.unused.len(),
        "cameras": cameras.iter().map(CameraGroup::value).collect::<Vec<_>>(),
        "evenness": evenness.as_ref().ok().map(evenness_value),
        "warnings": warnings.iter().map(ToString::to_string).collect::<Vec<_>>(),
    });
    let mut rows = vec![
        ("form", kind.name().to_owned()),
        ("in a recipe", format!("source: {{ {}: {{ path: … }} }}", kind.name())),
        ("views", capture.views.len().to_string()),
        ("photos", photo_text(&capture, &missing)),
    ];
    rows.extend(cameras.iter().take(MAX_CAMERAS).map(|group| ("camera", group.text())));
    if cameras.len() > MAX_CAMERAS {
        rows.push(("cameras", format!("{} more; --json has all", cameras.len() - MAX_CAMERAS)));
    }
    rows.extend(evenness_rows(evenness.as_ref()));
    Ok(PathFacts { kind: "capture", title: "a capture", rows, recipe: Vec::new(), value })
}

fn report_warnings(warnings: &[SourceWarning], console: &Console) {
    warnings.iter().for_each(|warning| console.note(&format!("warning: {warning}")));
}

fn photo_text(capture: &Capture, missing: &[&str]) -> String {
    let present = capture.views.len() - missing.len();
    let missing = match missing {
        [] => String::new(),
        [first, ..] => format!(", {} missing, the first is `{first}`", missing.len()),
    };
    let unused = match capture.unused.len() {
        0 => String::new(),
        unused => format!(", {unused} without a pose"),
    };
    format!("{present} present{missing}{unused}")
}

/// The views of one camera.
struct CameraGroup<'a> {
    camera: Camera,
    lens: &'a LensModel,
    views: usize,
}

/// The different cameras of a capture, in the order of their first views.
fn distinct_cameras(capture: &Capture) -> Vec<CameraGroup<'_>> {
    let mut groups: Vec<CameraGroup<'_>> = Vec::new();
    let mut known: BTreeMap<String, usize> = BTreeMap::new();
    for view in &capture.views {
        // Debug forms of floats are exact, so equal texts are equal cameras.
        let group = *known.entry(format!("{:?} {:?}", view.camera, view.lens)).or_insert(groups.len());
        if group == groups.len() {
            groups.push(CameraGroup { camera: view.camera, lens: &view.lens, views: 0 });
        }
        groups[group].views += 1;
    }
    groups
}

impl CameraGroup<'_> {
    /// The model of the lens, by COLMAP's name.
    fn model(&self) -> String {
        match json!(self.lens) {
            Value::String(name) => name,
            Value::Object(fields) => fields.keys().next().cloned().unwrap_or_default(),
            _ => String::new(),
        }
    }

    fn text(&self) -> String {
        let Camera { size, fx, fy, .. } = self.camera;
        let (model, views) = (self.model(), self.views);
        let moved = self.lens.max_displacement_px(&self.camera);
        let moved =
            if moved > 0.0 { format!(", which moves pixels by up to {moved:.1} px") } else { String::new() };
        format!(
            "{size}, focal lengths {} and {} px, lens {model}{moved}, {views} views",
            short(fx),
            short(fy)
        )
    }

    fn value(&self) -> Value {
        let Camera { size, fx, fy, cx, cy, .. } = self.camera;
        json!({
            "width": size.width, "height": size.height, "fx": fx, "fy": fy, "cx": cx, "cy": cy,
            "lens": self.model(), "views": self.views,
        })
    }
}

/// The evenness of the capture, or the reason why it cannot be measured.
fn capture_evenness(capture: &Capture) -> Result<CaptureEvenness, String> {
    let poses = capture.views.iter();
    let views: Vec<NamedPose<'_>> =
        poses.map(|v| NamedPose { name: &v.name, world_from_camera: v.world_from_camera }).collect();
    let found = CaptureEvenness::measure_views(&views).map_err(|e| e.to_string())?;
    found.ok_or_else(|| "all views are at one place".to_owned())
}

fn evenness_rows(evenness: Result<&CaptureEvenness, &String>) -> Vec<(&'static str, String)> {
    let found = match evenness {
        Ok(found) => found,
        Err(because) => return vec![("steps", format!("not measured: {because}"))],
    };
    let what = if found.focused {
        "the median distance of the cameras to the point that they look at"
    } else {
        "the largest distance of two cameras, which look at no common point"
    };
    let mut rows = vec![("scale", format!("{} units, {what}", short(found.scale)))];
    if let Some(longest) = longest_step(found) {
        let (times, after, before) = (short(longest.times_median), &longest.after, &longest.before);
        rows.push(("longest step", format!("{times} median steps, from `{after}` to `{before}`")));
    }
    rows.push(("gaps", format!("{} steps of more than {GAP} median steps", gap_count(found))));
    if let Some(largest) = largest_detour(found) {
        let times = short(largest.times_median);
        rows.push(("detour", format!("at most {times} median steps, at `{}`", largest.name)));
    }
    rows
}

fn gap_count(found: &CaptureEvenness) -> usize {
    found.steps.iter().filter(|step| step.times_median > GAP).count()
}

fn longest_step(found: &CaptureEvenness) -> Option<&CaptureGap> {
    found.steps.iter().max_by(|a, b| a.times_median.total_cmp(&b.times_median))
}

fn largest_detour(found: &CaptureEvenness) -> Option<&ViewDetour> {
    found.detours.iter().max_by(|a, b| a.times_median.total_cmp(&b.times_median))
}

fn evenness_value(found: &CaptureEvenness) -> Value {
    json!({
        "scale": found.scale, "focused": found.focused, "gaps": gap_count(found),
        "longest_step": longest_step(found),
        "largest_detour": largest_detour(found).map(|detour| json!({
            "name": detour.name, "times_median": detour.times_median,
        })),
    })
}
