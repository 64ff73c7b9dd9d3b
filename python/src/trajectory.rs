//! Trajectories of a recipe for Python.

use crate::scene::SplatScene;
use crate::sensor::recipe_error;
use crate::threads::call_pool;
use gs2e_build::artifact::TrajectoryProduct;
use gs2e_recipe::{
    ChainError, RecipeFaults, TrajectoryChain, TrajectoryFragment, fragment_from_text, read_fragment,
};
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::flow::PixelFlowMeter;
use gs2e_scene::camera::{Camera, choose_camera};
use gs2e_source::Capture;
use gs2e_source::kind::CaptureKind;
use gs2e_trajectory::flow::FlowMeter;
use numpy::{IntoPyArray as _, PyArray1, PyArray2, PyArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// The fragment of a recipe, as a file or as a text, and the inputs of its paths.
#[derive(FromPyObject)]
pub(crate) struct TrajectoryRequest {
    path: Option<PathBuf>,
    text: Option<String>,
    name: Option<String>,
    capture: Option<PathBuf>,
    scene: Option<Py<SplatScene>>,
}

/// Name, stamps [M], poses [M, 7], velocities [M, 6], speed.json, warnings, and the camera.
type TrajectoryParts<'py> = (
    String,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    String,
    Vec<String>,
    Option<(u32, u32, f64, f64, f64, f64)>,
);

/// Makes one trajectory of a fragment.
#[pyfunction]
pub(crate) fn make_trajectory(py: Python<'_>, request: TrajectoryRequest) -> PyResult<TrajectoryParts<'_>> {
    let fragment = request.fragment().map_err(|faults| recipe_error(&faults))?;
    // Not the global pool: its threads do not survive a fork, and a child would wait for them forever.
    let pool = call_pool(0)?;
    let made = py.detach(|| pool.install(|| request.make(&fragment))).map_err(PyValueError::new_err)?;
    made.into_parts(py)
}

/// A trajectory with the camera that sees it.
struct FilmedTrajectory {
    name: String,
    product: TrajectoryProduct,
    camera: Option<Camera>,
    warnings: Vec<String>,
}

impl TrajectoryRequest {
    fn fragment(&self) -> Result<TrajectoryFragment, RecipeFaults> {
        match (&self.path, &self.text) {
            (Some(path), _) => read_fragment(path),
            (None, text) => fragment_from_text(text.clone().unwrap_or_default(), Path::new("recipe")),
        }
    }

    /// Makes the trajectory. An error is a sentence for users.
    fn make(&self, fragment: &TrajectoryFragment) -> Result<FilmedTrajectory, String> {
        let name = self.chosen(fragment)?;
        let chain = fragment.chain(&name).map_err(|error| in_words(&error))?;
        let mut warnings = Vec::new();
        let capture = self.captured(&chain, &mut warnings)?;
        let (own, noticed) = capture.as_ref().and_then(Capture::camera).unzip();
        warnings.extend(noticed.flatten().map(|warning| warning.to_string()));
        let camera = choose_camera(fragment.camera, own.as_ref());
        let mut meter = self.meter(fragment, &chain, camera)?;
        let meter = meter.as_mut().map(|meter| meter as &mut dyn FlowMeter);
        let views = capture.as_ref().map_or(&[][..], |capture| &capture.views);
        let (made, before) = chain.make(views, meter).map_err(|error| in_words(&error))?;
        warnings.extend(before);
        warnings.extend(made.report.warnings.iter().cloned());
        let product = TrajectoryProduct { trajectory: made.trajectory, report: made.report };
        Ok(FilmedTrajectory { name, product, camera, warnings })
    }

    /// The name that was asked for, or the only one.
    fn chosen(&self, fragment: &TrajectoryFragment) -> Result<String, String> {
        match (&self.name, &fragment.trajectories[..]) {
            (Some(name), _) => Ok(name.clone()),
            (None, [only]) => Ok(only.name.clone()),
            (None, several) => {
                let names: Vec<&str> = several.iter().map(|recipe| recipe.name.as_str()).collect();
                Err(format!("the recipe has the trajectories {}; name one of them", names.join(", ")))
            }
        }
    }

    fn captured(
        &self,
        chain: &TrajectoryChain<'_>,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Capture>, String> {
        let Some(place) = &self.capture else {
            return match chain.needs_views() {
                None => Ok(None),
                Some(name) => Err(format!(
                    "the trajectory `{name}` needs a capture; pass capture= with a COLMAP model, a \
                     transforms.json, or a 3DGS model folder"
                )),
            };
        };
        let read = CaptureKind::kind_of(place).and_then(|kind| kind.read(place));
        let (capture, noticed) = read.map_err(|error| format!("capture: {error}"))?;
        warnings.extend(noticed.iter().map(ToString::to_string));
        Ok(Some(capture))
    }

    /// The meter of the optical flow, if a speed is in pixels.
    fn meter(
        &self,
        fragment: &TrajectoryFragment,
        chain: &TrajectoryChain<'_>,
        camera: Option<Camera>,
    ) -> Result<Option<PixelFlowMeter>, String> {
        let Some(name) = chain.needs_meter() else { return Ok(None) };
        let missing = |help: &str| format!("the speed of `{name}` is in pixels per second; {help}");
        let scene =
            self.scene.as_ref().ok_or_else(|| missing("pass scene= with the scene to measure it in"))?;
        let camera = camera.ok_or_else(|| {
            missing("pass capture=, or write in the recipe camera: { width, height, fx, fy, cx, cy }")
        })?;
        let gaussians = scene.get().gaussians();
        let style = fragment.render.resolve(gaussians.antialiased);
        let renderer =
            CpuRenderer::new(gaussians, style).map_err(|error| format!("failed to render: {error}"))?;
        Ok(Some(PixelFlowMeter::new(Box::new(renderer), camera)))
    }
}

/// An error of a chain with its cause.
fn in_words(error: &ChainError) -> String {
    match error {
        ChainError::Unknown { names, .. } => format!("{error}; its trajectories: {}", names.join(", ")),
        ChainError::Circular { .. } => error.to_string(),
        ChainError::Make { source, .. } => format!("{error}: {source}"),
    }
}

impl FilmedTrajectory {
    fn into_parts(self, py: Python<'_>) -> PyResult<TrajectoryParts<'_>> {
        let TrajectoryProduct { trajectory, report } = &self.product;
        let poses = trajectory.world_from_camera.iter().flat_map(|pose| {
            let ([x, y, z], q) = (pose.translation.to_array(), pose.rotation);
            [x, y, z, q.x, q.y, q.z, q.w]
        });
        let poses: Vec<f64> = poses.collect();
        let velocities = self.product.velocities();
        let velocities = velocities.iter().flat_map(|v| [v.linear.to_array(), v.angular.to_array()]);
        let velocities: Vec<f64> = velocities.flatten().collect();
        let count = trajectory.stamps_us.len();
        let report =
            serde_json::to_string(report).map_err(|error| PyValueError::new_err(error.to_string()))?;
        let camera =
            self.camera.map(|Camera { size, fx, fy, cx, cy, .. }| (size.width, size.height, fx, fy, cx, cy));
        Ok((
            self.name,
            trajectory.stamps_us.clone().into_pyarray(py),
            poses.into_pyarray(py).reshape([count, 7])?,
            velocities.into_pyarray(py).reshape([count, 6])?,
            report,
            self.warnings,
            camera,
        ))
    }
}
