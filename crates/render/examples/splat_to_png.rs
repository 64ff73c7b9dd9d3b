//! A view of a scene of 3D Gaussians as a picture:
//! `cargo run --release --example splat_to_png -- scene.ply picture.png`

use gs2e_image::{Size, png};
use gs2e_num::se3::{Se3, look_at};
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use gs2e_scene::camera::{Camera, view::CameraView};
use gs2e_scene::survey::SceneSurvey;
use std::{env, error::Error, fs::File, io::BufWriter, path::Path, sync::Arc};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [scene, picture] = &arguments[..] else {
        return Err("usage: splat_to_png scene.ply picture.png".into());
    };
    let scene = Arc::new(gs2e_scene::read_any(Path::new(scene))?);
    let camera = Camera::pinhole(Size { width: 640, height: 480 }, [600.0, 600.0, 320.0, 240.0]);
    let orbit = SceneSurvey::measure_scene(&scene).orbit(&camera);
    let rotation = look_at(orbit.centre - orbit.from, orbit.up).ok_or("the scene has no extent")?;
    let view = CameraView::at_rest(camera, Se3 { rotation, translation: orbit.from });
    let (rules, antialiased) = (RenderRules::Exact, scene.antialiased == Some(true));
    let style = RenderStyle { rules, order: LayerOrder::Depth, antialiased, background: [0.0; 3] };
    let mut images = RenderedImages::default();
    let want = ChannelSet { rgb: true, ..ChannelSet::NONE };
    CpuRenderer::new(scene, style)?.render(&view, want, &mut images)?;
    let colours = images.rgb.ok_or("the renderer made no colours")?;
    png::write_image(&png::to_bytes(&colours), BufWriter::new(File::create(picture)?))?;
    Ok(())
}
