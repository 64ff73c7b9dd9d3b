//! Scenes of Gaussians as Python sees them: read from a file, and rendered on the CPU.

use crate::threads::call_pool;
use glam::{DMat3, DVec3};
use gs2e_image::{Image, MAX_PIXELS, Size};
use gs2e_num::se3;
use gs2e_num::se3::Se3;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{
    AntialiasMode, ChannelSet, LayerOrder, RenderChoice, RenderError, RenderRules, RenderStyle,
    RenderedImages, Renderer,
};
use gs2e_scene as scene;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use numpy::{IntoPyArray as _, PyArrayMethods as _};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// A scene. Its last renderer is kept, because preparing one walks through all Gaussians.
#[pyclass(frozen, module = "gs2e._native")]
pub(crate) struct SplatScene {
    scene: Arc<Gaussians>,
    prepared: Mutex<Option<(RenderStyle, CpuRenderer)>>,
}

/// A view: width, height, focal lengths and principal point in px; the matrix from camera to world; and
/// the velocity in camera axes, linear and angular.
#[derive(FromPyObject)]
struct RequestedView {
    camera: (u32, u32, f64, f64, f64, f64),
    pose: [[f64; 4]; 4],
    velocity: Option<[f64; 6]>,
}

#[pymethods]
impl SplatScene {
    /// Reads a scene file.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let read = py.detach(|| scene::read_file(&path));
        let read = read.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(Self { scene: Arc::new(read), prepared: Mutex::new(None) })
    }

    /// The number of Gaussians.
    fn __len__(&self) -> usize {
        self.scene.len()
    }

    /// The largest degree of the spherical harmonics.
    #[getter]
    fn sh_degree(&self) -> u8 {
        self.scene.sh_degree
    }

    /// One channel of a view: float32 [H, W], [H, W, 2] or [H, W, 3].
    fn render<'py>(
        &self,
        py: Python<'py>,
        view: RequestedView,
        channel: &str,
        style: (String, Option<bool>, [f64; 3]),
    ) -> PyResult<Bound<'py, PyAny>> {
        let want = wanted_channel(channel, view.velocity.is_some())?;
        let (rules, antialiased, background) = style;
        let choice = RenderChoice {
            rules: named_rules(&rules)?,
            order: LayerOrder::Depth,
            antialiased: match antialiased {
                None => AntialiasMode::Auto,
                Some(true) => AntialiasMode::On,
                Some(false) => AntialiasMode::Off,
            },
            background,
            near: None,
        };
        let style = choice.resolve(self.scene.antialiased);
        let view = view.checked()?;
        let pool = call_pool(0)?;
        let rendered = py.detach(|| pool.install(|| self.rendered(style, &view, want)));
        let rendered = rendered.map_err(|error| match error {
            RenderError::View(_) | RenderError::Style(_) => PyValueError::new_err(error.to_string()),
            _ => PyRuntimeError::new_err(error.to_string()),
        })?;
        let RenderedImages { rgb, luminance, alpha, depth, flow, luminance_rate, doubtful, .. } = rendered;
        if let Some(rgb) = rgb {
            return as_array(py, rgb.size(), rgb.pixels().as_flattened().to_vec(), 3);
        }
        if let Some(flow) = flow {
            return as_array(py, flow.size(), flow.pixels().as_flattened().to_vec(), 2);
        }
        let plane: Option<Image<f32>> = luminance.or(alpha).or(depth).or(luminance_rate).or(doubtful);
        let plane = plane.ok_or_else(|| PyRuntimeError::new_err("the renderer made no image"))?;
        as_array(py, plane.size(), plane.pixels().to_vec(), 1)
    }
}

impl SplatScene {
    /// The Gaussians.
    pub(crate) fn gaussians(&self) -> Arc<Gaussians> {
        self.scene.clone()
    }

    fn rendered(
        &self,
        style: RenderStyle,
        view: &CameraView,
        want: ChannelSet,
    ) -> Result<RenderedImages, RenderError> {
        // A renderer that panicked is not used again: a new one replaces it.
        let mut prepared = self.prepared.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = prepared.take().filter(|(of, _)| *of == style);
        let mut renderer = match kept {
            Some((_, renderer)) => renderer,
            None => CpuRenderer::new(self.scene.clone(), style)?,
        };
        let mut images = RenderedImages::default();
        renderer.render(view, want, &mut images)?;
        *prepared = Some((style, renderer));
        Ok(images)
    }
}

impl RequestedView {
    fn checked(self) -> PyResult<CameraView> {
        let (width, height, fx, fy, cx, cy) = self.camera;
        let size = Size { width, height };
        if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS as u64 {
            let what = format!("camera: a picture of {size}, wanted 1 to {MAX_PIXELS} pixels");
            return Err(PyValueError::new_err(what));
        }
        let [a, b, c, last] = self.pose;
        if last != [0.0, 0.0, 0.0, 1.0] {
            return Err(PyValueError::new_err(format!("pose: the last row is {last:?}, wanted 0, 0, 0, 1")));
        }
        // Rows of the matrix as given; glam keeps columns.
        let matrix = DMat3::from_cols(row(a), row(b), row(c)).transpose();
        let rotation = se3::rotation_from_matrix(&matrix);
        let rotation = rotation.map_err(|error| PyValueError::new_err(format!("pose: {error}")))?;
        let translation = DVec3::new(a[3], b[3], c[3]);
        let velocity = self.velocity.map_or_else(CameraVelocity::default, |[x, y, z, u, v, w]| {
            CameraVelocity { linear: DVec3::new(x, y, z), angular: DVec3::new(u, v, w) }
        });
        let world_from_camera = Se3 { rotation: rotation.rotation, translation };
        let still = CameraView::at_rest(Camera::pinhole(size, [fx, fy, cx, cy]), world_from_camera);
        Ok(CameraView { velocity, ..still })
    }
}

fn row([x, y, z, _]: [f64; 4]) -> DVec3 {
    DVec3::new(x, y, z)
}

fn named_rules(name: &str) -> PyResult<RenderRules> {
    match name {
        "official" => Ok(RenderRules::Official),
        "exact" => Ok(RenderRules::Exact),
        "gsplat" => Ok(RenderRules::Gsplat),
        "soft" => Ok(RenderRules::Soft),
        _ => {
            let what = format!("rules is {name:?}, wanted \"official\", \"exact\", \"gsplat\" or \"soft\"");
            Err(PyValueError::new_err(what))
        }
    }
}

/// The channel with this name; those of motion need a velocity.
fn wanted_channel(name: &str, moves: bool) -> PyResult<ChannelSet> {
    let none = ChannelSet::NONE;
    let (want, needs_motion) = match name {
        "rgb" => (ChannelSet { rgb: true, ..none }, false),
        "alpha" => (ChannelSet { alpha: true, ..none }, false),
        "luminance" => (ChannelSet { luminance: true, ..none }, false),
        "depth" => (ChannelSet { depth: true, ..none }, false),
        "doubtful" => (ChannelSet { doubtful: true, ..none }, false),
        "luminance-rate" => (ChannelSet { luminance_rate: true, ..none }, true),
        "flow" => (ChannelSet { flow: true, ..none }, true),
        _ => {
            let what = format!(
                "channel is {name:?}, wanted \"rgb\", \"alpha\", \"luminance\", \"depth\", \"doubtful\", \"luminance-rate\" or \"flow\""
            );
            return Err(PyValueError::new_err(what));
        }
    };
    if needs_motion && !moves {
        return Err(PyValueError::new_err(format!("channel {name:?} needs the velocity of the camera")));
    }
    Ok(want)
}

fn as_array(py: Python<'_>, size: Size, values: Vec<f32>, parts: usize) -> PyResult<Bound<'_, PyAny>> {
    let (height, width) = (size.height as usize, size.width as usize);
    let flat = values.into_pyarray(py);
    if parts == 1 {
        return Ok(flat.reshape([height, width])?.into_any());
    }
    Ok(flat.reshape([height, width, parts])?.into_any())
}
