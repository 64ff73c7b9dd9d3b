//! The scene and the views that are rendered.

use crate::Options;
use gs2e_demo::{StillLife, still_capture, still_life};
use gs2e_scene as scene;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_source::{CapturedView, nerfstudio};
use serde_json::json;
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// A scene with its views.
pub(super) struct BenchViews {
    pub(super) name: String,
    pub(super) scene: Arc<Gaussians>,
    /// Of a moving camera, for the rates.
    pub(super) views: Vec<CameraView>,
}

impl BenchViews {
    pub(super) fn new(options: &Options) -> Result<Self, String> {
        let (name, scene, captured) = match &options.scene {
            Some([scene, views]) => {
                let found = scene::read_any(scene).map_err(|e| e.to_string())?;
                let capture = nerfstudio::read_capture(views).map_err(|e| e.to_string())?.0;
                let name = scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
                (name, found, capture.views)
            }
            None => {
                let life = StillLife { gaussians: options.gaussians, ..StillLife::default() };
                ("still life".to_owned(), still_life(&life), still_capture(&life).views)
            }
        };
        let velocity = CameraVelocity {
            linear: glam::DVec3::new(0.5, 0.0, 0.2),
            angular: glam::DVec3::new(0.0, 0.5, 0.0),
        };
        let view = |view: CapturedView| CameraView {
            camera: view.camera.resized(options.size),
            world_from_camera: view.world_from_camera,
            velocity,
            seconds: 0.0,
        };
        let views: Vec<CameraView> = captured.into_iter().map(view).collect();
        if views.is_empty() {
            return Err(format!("{name} has no views"));
        }
        Ok(Self { name, scene: Arc::new(scene), views })
    }

    /// Writes `scene.ply`, and `views.json` with pinhole matrices and poses from world to camera.
    pub(super) fn export(&self, folder: &Path) -> Result<(), String> {
        let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
        fs::create_dir_all(folder).map_err(failed)?;
        let file = fs::File::create(folder.join("scene.ply")).map_err(failed)?;
        scene::ply::write_ply(&self.scene, file).map_err(failed)?;
        // The file has absolute positions, so the poses are those of the world too.
        let view = |view: &CameraView| {
            let camera = view.camera;
            let rotation = view.world_from_camera.rotation_matrix().transpose();
            let shift = -(rotation * view.world_from_camera.translation);
            let row = |k: usize| {
                let row = rotation.row(k);
                json!([row.x, row.y, row.z, shift[k]])
            };
            json!({
                "k": [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]],
                "camera_from_world": [row(0), row(1), row(2), json!([0.0, 0.0, 0.0, 1.0])],
            })
        };
        let size = self.views[0].camera.size;
        let views: Vec<_> = self.views.iter().map(view).collect();
        let text = json!({ "width": size.width, "height": size.height, "views": views }).to_string();
        fs::write(folder.join("views.json"), text).map_err(failed)
    }
}
