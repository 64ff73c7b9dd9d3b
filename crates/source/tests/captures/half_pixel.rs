//! Half a pixel that is easily lost between conventions: the same camera as COLMAP and as
//! nerfstudio state it, compared in pictures.

use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, RenderStyle, RenderedImages, Renderer as _};
use gs2e_scene::Gaussians;
use gs2e_scene::blobs::{ColourBlob, blob_crowd, blob_scene};
use gs2e_scene::camera::view::CameraView;
use gs2e_source::{Capture, colmap, nerfstudio};
use gs2e_testing::planted::{Camera, Image, Planted};
use serde_json::{Value, json};

/// A camera with an off-centre principal point, turned by 10 degrees about y, 4 units back.
const SIZE: [u32; 2] = [96, 64];
const K: [f64; 4] = [80.0, 81.0, 45.3, 33.9];

/// The camera in COLMAP's form: world to camera.
fn of_colmap() -> Capture {
    let (sin, cos) = 5f64.to_radians().sin_cos();
    let camera = Camera { id: 1, model: (1, "PINHOLE"), size: SIZE.map(u64::from), parameters: K.to_vec() };
    let image = Image {
        id: 1,
        q: [cos, 0.0, sin, 0.0],
        t: [0.1, -0.2, 4.0],
        camera: 1,
        name: "1.png".into(),
        observations: Vec::new(),
    };
    let dir = tempfile::tempdir().unwrap();
    Planted { cameras: vec![camera], images: vec![image], points: Vec::new() }.write_text(dir.path());
    colmap::read_capture(dir.path()).unwrap().0
}

/// The camera as nerfstudio exports it, written by hand: camera to world, y up and z back, pixels
/// counted from the corner of the first.
fn of_nerfstudio(change: impl Fn(&mut Value)) -> Capture {
    let (sin, cos) = 10f64.to_radians().sin_cos();
    let t = [0.1, -0.2, 4.0];
    // Rows of R world to camera are (cos, 0, sin), (0, 1, 0), (-sin, 0, cos): the centre is -R^T t.
    let centre = [-(cos * t[0] - sin * t[2]), -t[1], -(sin * t[0] + cos * t[2])];
    let mut document = json!({
        "w": SIZE[0], "h": SIZE[1], "fl_x": K[0], "fl_y": K[1], "cx": K[2], "cy": K[3],
        "frames": [{ "file_path": "1.png", "transform_matrix": [
            [cos, 0.0, sin, centre[0]], [0.0, -1.0, 0.0, centre[1]], [sin, 0.0, -cos, centre[2]], [0.0, 0.0, 0.0, 1.0],
        ]}],
    });
    change(&mut document);
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("transforms.json"), document.to_string()).unwrap();
    nerfstudio::read_capture(dir.path()).unwrap().0
}

fn picture(of: Gaussians, capture: &Capture) -> RenderedImages {
    let view = &capture.views[0];
    let view = CameraView::at_rest(view.camera, view.world_from_camera);
    let mut out = RenderedImages::default();
    let mut renderer = CpuRenderer::new(of.into(), RenderStyle::OFFICIAL).unwrap();
    renderer.render(&view, ChannelSet::AT_REST, &mut out).unwrap();
    out
}

#[test]
fn colmaps_camera_and_its_export_see_the_same_picture() {
    let exports = [
        of_nerfstudio(|_| {}),
        // Pixels counted from the centre of the first.
        of_nerfstudio(|document| {
            document["pixel_center"] = json!(0);
            document["cx"] = json!(K[2] - 0.5);
            document["cy"] = json!(K[3] - 0.5);
        }),
    ];
    let wanted = picture(blob_scene(&blob_crowd(300, 1)), &of_colmap()).rgb.unwrap();
    assert!(wanted.pixels().iter().flatten().any(|v| *v > 0.5), "something is seen");
    let apart = |capture: &Capture| {
        let found = picture(blob_scene(&blob_crowd(300, 1)), capture).rgb.unwrap();
        let pairs = found.pixels().as_flattened().iter().zip(wanted.pixels().as_flattened());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    for export in &exports {
        assert!(apart(export) <= 1e-6, "{}", apart(export));
    }
    // The same camera with half a pixel lost gives another picture.
    let lost = of_nerfstudio(|document| document["cx"] = json!(K[2] - 0.5));
    assert!(apart(&lost) > 0.01, "{}", apart(&lost));
}

#[test]
fn a_point_is_seen_where_the_camera_equation_puts_it() {
    let blob = ColourBlob { position: [0.2, 0.1, 0.3], deviations: [0.01; 3], ..ColourBlob::default() };
    let capture = of_colmap();
    let alpha = picture(blob_scene(&[blob]), &capture).alpha.unwrap();
    let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
    for (i, a) in alpha.pixels().iter().enumerate() {
        let (column, row) = (i % SIZE[0] as usize, i / SIZE[0] as usize);
        let a = f64::from(*a);
        sum += a;
        // The pixel's centre.
        x += a * (column as f64 + 0.5);
        y += a * (row as f64 + 0.5);
    }
    let (sin, cos) = 10f64.to_radians().sin_cos();
    let p = [cos * 0.2 + sin * 0.3 + 0.1, 0.1 - 0.2, -sin * 0.2 + cos * 0.3 + 4.0];
    let wanted = [K[0] * p[0] / p[2] + K[2], K[1] * p[1] / p[2] + K[3]];
    // A spot of half a pixel's width, cut where alpha is below 1/255: its mean equals its centre
    // within a few hundredths.
    for (found, wanted) in [x / sum, y / sum].into_iter().zip(wanted) {
        assert!((found - wanted).abs() < 0.05, "{found} for {wanted}");
    }
}
