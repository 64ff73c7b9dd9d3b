//! Pictures through a lens: planted points lie where OpenCV's formulae put them, what is undistorted is the
//! pinhole picture, and flow is that of the distorted picture.

mod recipes;

use crate::support::absent::absent;
use crate::support::workspace::Workspace;
use glam::{DQuat, DVec2, DVec3};
use gs2e_image::{Image, Size, png};
use gs2e_num::se3::Se3;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::lens::LensRenderer;
use gs2e_render::sample::TileSample;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer};
use gs2e_scene::blobs::{ColourBlob, blob_scene};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::lens::Distortion;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_scene::{Gaussians, ply};
use gs2e_source::LensModel;
use gs2e_source::undistort::undistort_photo;
use serde_json::json;
use std::process::Command;
use std::sync::Arc;

const SIZE: Size = Size { width: 320, height: 240 };
const CAMERA: Camera = Camera { size: SIZE, fx: 200.0, fy: 210.0, cx: 163.0, cy: 118.0, lens: None };
const RADIAL: [f64; 5] = [-0.28, 0.09, 0.001, -0.0015, -0.012];
const FISHEYE: [f64; 4] = [0.03, -0.012, 0.004, -0.001];

/// OpenCV's models, from its documentation, as the test's own code: the image of a ray at focal length 1.
fn radial(x: f64, y: f64) -> [f64; 2] {
    let [k1, k2, p1, p2, k3] = RADIAL;
    let r = libm::hypot(x, y);
    let gain = 1.0 + k1 * r.powi(2) + k2 * r.powi(4) + k3 * r.powi(6);
    [
        x * gain + 2.0 * p1 * x * y + p2 * (r.powi(2) + 2.0 * x.powi(2)),
        y * gain + p1 * (r.powi(2) + 2.0 * y.powi(2)) + 2.0 * p2 * x * y,
    ]
}

fn fisheye(x: f64, y: f64) -> [f64; 2] {
    let [k1, k2, k3, k4] = FISHEYE;
    let r = libm::hypot(x, y);
    if r < 1e-12 {
        return [x, y];
    }
    let a = libm::atan2(r, 1.0);
    let bent = a + k1 * a.powi(3) + k2 * a.powi(5) + k3 * a.powi(7) + k4 * a.powi(9);
    [x / r * bent, y / r * bent]
}

type Model = fn(f64, f64) -> [f64; 2];

fn lenses() -> [(Distortion, Model); 2] {
    let text = |k: &[f64]| k.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
    [
        (format!("opencv:{}", text(&RADIAL)).parse().unwrap(), radial),
        (format!("fisheye:{}", text(&FISHEYE)).parse().unwrap(), fisheye),
    ]
}

fn project(model: Model, point: DVec3) -> [f64; 2] {
    let [x, y] = model(point.x / point.z, point.y / point.z);
    [CAMERA.fx * x + CAMERA.cx, CAMERA.fy * y + CAMERA.cy]
}

/// Points over the whole picture, at different depths, as far from each other as they are from the next
/// blob's light.
fn points() -> Vec<[f32; 3]> {
    let place = |i: u16| {
        let (column, row) = (f32::from(i % 9) - 4.0, f32::from(i / 9) - 3.0);
        let depth = 3.0 + 0.37 * f32::from(i % 4);
        [0.17 * column * depth, 0.16 * row * depth, depth]
    };
    (0..63).map(place).collect()
}

/// White blobs with a deviation of 1.9 px. Of smaller ones, which the lens makes smaller still towards the
/// border, the cubic between pixels moves the centroid: by 0.02 px at 1.3 px.
fn dots() -> Gaussians {
    let blob = |position: [f32; 3]| ColourBlob {
        position,
        deviations: [position[2] * 0.009; 3],
        opacity: 0.9,
        ..ColourBlob::default()
    };
    blob_scene(&points().into_iter().map(blob).collect::<Vec<_>>())
}

fn renderer(scene: Gaussians) -> Box<dyn Renderer> {
    let (rules, order) = (RenderRules::Soft, LayerOrder::Depth);
    let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
    Box::new(LensRenderer::new(Box::new(CpuRenderer::new(Arc::new(scene), style).unwrap())))
}

fn rendered(
    renderer: &mut dyn Renderer,
    lens: Option<Distortion>,
    velocity: CameraVelocity,
    want: ChannelSet,
) -> RenderedImages {
    let pose = Se3 { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };
    let view = CameraView { velocity, ..CameraView::at_rest(Camera { lens, ..CAMERA }, pose) };
    let mut out = RenderedImages::default();
    renderer.render(&view, want, &mut out).unwrap();
    out
}

/// The ray of a pixel by fixed-point steps, and the area of rays that a unit of area of the picture shows.
fn ray_of(model: Model, [u, v]: [f64; 2]) -> ([f64; 2], f64) {
    let wanted = [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy];
    let [mut x, mut y] = wanted;
    for _ in 0..200 {
        let found = model(x, y);
        (x, y) = (x + wanted[0] - found[0], y + wanted[1] - found[1]);
    }
    let h = 1e-5;
    let [[a, b], [c, d]] = [[model(x + h, y), model(x - h, y)], [model(x, y + h), model(x, y - h)]]
        .map(|[after, before]| [0, 1].map(|k| (after[k] - before[k]) / (2.0 * h)));
    ([x, y], 1.0 / (a * d - b * c))
}

/// Where the model puts the centroid of the rays of the light within 7 px of a place; `None` near the border.
/// A blob is symmetric among rays. In the picture it is not: the lens makes its outer half smaller, by 0.03
/// px of centroid.
fn centroid(image: &Image<f32>, model: Model, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
    let near = 8.0;
    let inside = |at: f64, side: u32| (near..=f64::from(side) - near).contains(&at);
    if !(inside(u, SIZE.width) && inside(v, SIZE.height)) {
        return None;
    }
    let mut sums = [0.0; 3];
    for (i, value) in image.pixels().iter().enumerate() {
        let [x, y] = [i % SIZE.width as usize, i / SIZE.width as usize].map(|k| k as f64 + 0.5);
        if (x - u).abs() <= 7.0 && (y - v).abs() <= 7.0 {
            let ([x, y], area) = ray_of(model, [x, y]);
            let value = f64::from(*value) * area;
            sums = [sums[0] + value * x, sums[1] + value * y, sums[2] + value];
        }
    }
    Some(project(model, DVec3::new(sums[0] / sums[2], sums[1] / sums[2], 1.0)))
}

#[test]
fn points_lie_where_the_models_put_them() {
    for (lens, model) in lenses() {
        let mut through = renderer(dots());
        let want = ChannelSet { luminance: true, ..ChannelSet::NONE };
        let image = rendered(&mut *through, Some(lens), CameraVelocity::default(), want).luminance.unwrap();
        let (mut count, mut worst) = (0, 0.0f64);
        for point in points() {
            let wanted = project(model, DVec3::from(point.map(f64::from)));
            let Some(found) = centroid(&image, model, wanted) else { continue };
            count += 1;
            worst = worst.max(libm::hypot(found[0] - wanted[0], found[1] - wanted[1]));
        }
        assert!(count > 35 && worst <= 0.02, "{lens}: {worst} px over {count} points");
    }
}

#[test]
fn flow_is_that_of_the_distorted_picture() {
    let velocity =
        CameraVelocity { linear: DVec3::new(0.3, -0.2, 0.5), angular: DVec3::new(0.1, -0.15, 0.2) };
    let wall = ColourBlob {
        position: [0.0, 0.0, 6.0],
        deviations: [9.0, 9.0, 0.01],
        opacity: 0.99,
        ..ColourBlob::default()
    };
    for (lens, model) in lenses() {
        let mut through = renderer(blob_scene(&[wall]));
        let want = ChannelSet { depth: true, flow: true, ..ChannelSet::NONE };
        let images = rendered(&mut *through, Some(lens), velocity, want);
        let (depth, flow) = (images.depth.unwrap(), images.flow.unwrap());
        let mut count = 0;
        for (i, found) in flow.pixels().iter().enumerate().step_by(97) {
            let [u, v] = [i % SIZE.width as usize, i / SIZE.width as usize].map(|k| k as f64 + 0.5);
            let z = f64::from(depth.pixels()[i]);
            if z.is_nan() {
                continue;
            }
            // The ray of the pixel by a fixed point of the model, which contracts here.
            let wanted = [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy];
            let mut ray = wanted;
            for _ in 0..200 {
                let image = model(ray[0], ray[1]);
                ray = [ray[0] + 0.7 * (wanted[0] - image[0]), ray[1] + 0.7 * (wanted[1] - image[1])];
            }
            // The point as the camera sees it a moment later and a moment before.
            let point = DVec3::new(ray[0], ray[1], 1.0) * z;
            let h = 1e-5;
            let at = |t: f64| {
                let turn = DQuat::from_scaled_axis(velocity.angular * t);
                project(model, turn.conjugate() * (point - velocity.linear * t))
            };
            let (before, after) = (at(-h), at(h));
            for axis in [0, 1] {
                let difference = (after[axis] - before[axis]) / (2.0 * h);
                let off = (difference - f64::from(found[axis])).abs();
                assert!(
                    off < 1e-4 * (1.0 + difference.abs()),
                    "{lens} at ({u}, {v}): {difference} {found:?}"
                );
            }
            count += 1;
        }
        assert!(count > 300, "{count}");
    }
}

/// Why pictures are resampled: a splat that is projected by the derivatives of the lens at its mean is bent
/// by `3 k1 r s^2 / f` at `s` px from it, for a ray `r`.
#[test]
fn a_splat_projected_by_derivatives_misses_by_the_square_of_its_size() {
    let (k1, focal, ray) = (-0.28, 420.0, DVec2::new(0.7, 0.0));
    let lens: Distortion = format!("opencv:{k1},0,0,0").parse().unwrap();
    let (image, slopes) = lens.distort(ray);
    for px in [3.0, 10.0, 30.0] {
        let off = DVec2::new(px / focal, 0.0);
        let missed = (lens.distort(ray + off).0 - (image + slopes * off)).length() * focal;
        let wanted = (3.0 * k1 * ray.x * px * px / focal).abs();
        println!("{px} px from the mean: off by {missed:.4} px");
        // The third order is px / (3 r f) of the second.
        assert!((missed / wanted - 1.0).abs() <= 1.01 * px / (3.0 * ray.x * focal), "{missed} {wanted}");
    }
}

/// A quarter of the tiles of the distorted picture, and those of the wide picture under them.
#[test]
fn a_sample_of_tiles_has_the_pixels_of_the_whole_picture() {
    let want = ChannelSet { luminance: true, ..ChannelSet::NONE };
    for (lens, _) in lenses() {
        let mut through = renderer(clouds());
        let mut see = |sample: Option<Arc<TileSample>>| {
            through.sample(sample);
            rendered(&mut *through, Some(lens), CameraVelocity::default(), want).luminance.unwrap()
        };
        let mut draw = 0.0f64;
        let sample = Arc::new(TileSample::spread(SIZE, || {
            draw = (draw + 0.618_033_988_749_895).fract();
            draw
        }));
        // The sample is promised before the first picture, and again when the map of the lens is known.
        let found = [see(Some(sample.clone())), see(None), see(Some(sample.clone()))];
        let pixels = sample.pixels();
        assert!(pixels.len() * 3 < SIZE.pixels(), "{}", pixels.len());
        for i in &pixels {
            let [first, whole, again] = found.each_ref().map(|image| image.pixels()[*i].to_bits());
            assert!(first == whole && again == whole, "{lens}: pixel {i}");
        }
        assert_ne!(found[0].pixels(), found[1].pixels(), "the rest is left out");
    }
}

/// Wide blobs in many colours, which a bilinear resampling reproduces to a byte or two.
fn clouds() -> Gaussians {
    let blob = |i: u16| {
        let k = f32::from(i);
        ColourBlob {
            position: [4.0 * libm::sinf(2.1 * k), 3.2 * libm::sinf(1.3 * k + 1.0), 6.0 + libm::sinf(k)],
            deviations: [0.5 + 0.3 * libm::sinf(0.7 * k).abs(); 3],
            opacity: 0.7,
            colour: [0.2, 0.5, 0.9].map(|c| 0.5 + 0.5 * libm::sin(f64::from(k) * (1.0 + c))),
            ..ColourBlob::default()
        }
    };
    blob_scene(&(0..60).map(blob).collect::<Vec<_>>())
}

/// Differences of two pictures away from the border: the mean, and the 99 % quantile, in bytes.
fn differences(a: &[[u8; 3]], b: &[[u8; 3]]) -> (f64, u8) {
    let (width, height) = (SIZE.width as usize, SIZE.height as usize);
    let inside =
        |i: &usize| (20..width - 20).contains(&(i % width)) && (20..height - 20).contains(&(i / width));
    let pixels = (0..width * height).filter(inside);
    let mut all: Vec<u8> = pixels.flat_map(|i| [0, 1, 2].map(|c| a[i][c].abs_diff(b[i][c]))).collect();
    all.sort_unstable();
    let mean = all.iter().map(|v| f64::from(*v)).sum::<f64>() / all.len() as f64;
    (mean, all[all.len() * 99 / 100])
}

#[test]
fn what_is_undistorted_is_the_pinhole_picture() {
    let want = ChannelSet { rgb: true, ..ChannelSet::NONE };
    let picture = |lens: Option<Distortion>| {
        let seen = rendered(&mut *renderer(clouds()), lens, CameraVelocity::default(), want);
        png::to_bytes(&seen.rgb.unwrap())
    };
    let straight = picture(None);
    let bent = picture(Some(lenses()[0].0));
    let (apart, _) = differences(straight.pixels(), bent.pixels());
    assert!(apart > 2.0, "the lens bends the picture: {apart}");
    let [k1, k2, p1, p2, k3] = RADIAL;
    let model = LensModel::FullOpenCv { k: [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0] };
    let undone = undistort_photo(&bent, &CAMERA, &model);
    let (mean, most) = differences(straight.pixels(), undone.pixels());
    assert!(mean < 0.6 && most <= 2, "{mean} {most}");
}

const CV2: &str = r#"
import json, sys
import cv2, numpy as np
asked = json.load(open(sys.argv[1]))
# OpenCV has pixel centres at integers.
K = np.array([[asked["fx"], 0, asked["cx"] - 0.5], [0, asked["fy"], asked["cy"] - 0.5], [0, 0, 1]])
points = np.array(asked["points"], np.float64).reshape(-1, 1, 3)
zero = np.zeros(3)
for name, project in (("opencv", cv2.projectPoints), ("fisheye", cv2.fisheye.projectPoints)):
    found = project(points, zero, zero, K, np.array(asked[name]))[0].reshape(-1, 2) + 0.5
    off = np.abs(found - np.array(asked["seen_" + name])).max()
    assert off < 1e-9, (name, off)
straight, bent = cv2.imread(asked["straight"]), cv2.imread(asked["bent"])
undone = cv2.undistort(bent, K, np.array(asked["opencv"]))
off = np.abs(undone.astype(int) - straight)[20:-20, 20:-20]
assert off.mean() < 0.7 and np.quantile(off, 0.99) <= 2, (off.mean(), np.quantile(off, 0.99))
assert np.abs(bent.astype(int) - straight)[20:-20, 20:-20].mean() > 2
"#;

/// The same two statements by OpenCV itself, for pictures that the program writes.
#[test]
fn opencv_agrees() {
    let ready = Command::new("python3").args(["-c", "import cv2, numpy"]).output();
    if !ready.is_ok_and(|ended| ended.status.success()) {
        return absent("REQUIRE_READERS", "python3 with numpy and cv2 is absent");
    }
    let place = Workspace::new();
    let mut file = Vec::new();
    ply::write_ply(&clouds(), &mut file).unwrap();
    place.write("scene.ply", &file);
    let Camera { fx, fy, cx, cy, .. } = CAMERA;
    let view = json!({ "W": 320, "H": 240, "fx": fx, "fy": fy, "cx": cx, "cy": cy,
        "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 0] });
    place.write("view.json", view.to_string());
    let render = "render --backend cpu --rules soft --scene scene.ply --view view.json";
    place.ok(&format!("{render} --out straight.png"));
    let said = place.ok(&format!("{render} --json --lens {} --out bent.png", lenses()[0].0)).stdout;
    assert!(said.contains("\"lens\":\"opencv:-0.28,"), "{said}");
    let positions = points().into_iter().map(|p| DVec3::from(p.map(f64::from)));
    let asked = json!({
        "fx": fx, "fy": fy, "cx": cx, "cy": cy, "opencv": RADIAL, "fisheye": FISHEYE,
        "points": positions.clone().map(|p| p.to_array()).collect::<Vec<_>>(),
        "seen_opencv": positions.clone().map(|p| project(radial, p)).collect::<Vec<_>>(),
        "seen_fisheye": positions.map(|p| project(fisheye, p)).collect::<Vec<_>>(),
        "straight": place.path("straight.png"), "bent": place.path("bent.png"),
    });
    place.write("asked.json", asked.to_string());
    let asked = place.path("asked.json");
    let ended = Command::new("python3").args(["-c", CV2, asked.to_str().unwrap()]).output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
}

#[test]
fn lenses_are_refused_by_name() {
    let place = Workspace::new();
    let mut file = Vec::new();
    ply::write_ply(&clouds(), &mut file).unwrap();
    place.write("scene.ply", &file);
    let view = json!({ "W": 64, "H": 48, "fx": 30, "fy": 30, "cx": 32, "cy": 24,
        "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 0] });
    place.write("view.json", view.to_string());
    for (lens, code, because) in [
        ("opencv:1,2,3", 2, "found 3 numbers"),
        ("thin:1,2", 2, "is no model"),
        ("opencv:-0.9,0,0,0", 1, "shows no ray"),
        ("fisheye:-0.35,0,0,0", 1, "shows no ray"),
    ] {
        let ended = place.gs2e(&format!(
            "render --backend cpu --scene scene.ply --view view.json --lens {lens} --out a.png"
        ));
        assert_eq!(ended.code, code, "{lens}: {}", ended.stderr);
        assert!(ended.stderr.contains(because), "{lens}: {}", ended.stderr);
    }
}
