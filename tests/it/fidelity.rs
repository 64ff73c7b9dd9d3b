//! Scenes compared with their photos, and captures with themselves, through the program. The photos
//! are the scene's own renderings, except for planted changes.

use crate::support::given::{self, GIVEN};
use crate::support::workspace::Workspace;
use gs2e_image::{Size, png};
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use gs2e_scene as scene;
use gs2e_scene::camera::view::CameraView;
use gs2e_source as source;
use gs2e_testing::planted::{Camera, Image as Photographed, Planted};
use serde_json::Value;
use std::fs;
use std::sync::Arc;

const LICENCE: &str = "licence: { expression: CC0-1.0, holder: a test }\n";

/// The sound scene with a photo of each view, `images/000.png` and so on: its own rendering in 8
/// bits, with each byte passed through `change` together with the number of the view.
pub(crate) fn photographed(change: impl Fn(usize, u8) -> u8) -> Workspace {
    let place = given::sound();
    let recipe = GIVEN.replace("outputs: [events, sharp]", "outputs: []");
    place.write("recipe.yaml", recipe + LICENCE);
    let (capture, _) = source::nerfstudio::read_capture(&place.path("transforms.json")).unwrap();
    let gaussians = Arc::new(scene::read_file(&place.path("scene.ply")).unwrap());
    let style = RenderStyle {
        rules: RenderRules::Official,
        order: LayerOrder::Depth,
        antialiased: false,
        background: [0.0; 3],
    };
    let mut renderer = CpuRenderer::new(gaussians, style).unwrap();
    for (i, view) in capture.views.iter().enumerate() {
        let mut rendered = RenderedImages::default();
        let want = ChannelSet { rgb: true, ..ChannelSet::default() };
        renderer
            .render(&CameraView::at_rest(view.camera, view.world_from_camera), want, &mut rendered)
            .unwrap();
        let mut photo = png::to_bytes(&rendered.rgb.unwrap());
        photo.pixels_mut().as_flattened_mut().iter_mut().for_each(|v| *v = change(i, *v));
        let mut bytes = Vec::new();
        png::write_image(&photo, &mut bytes).unwrap();
        place.write(&view.name, bytes);
    }
    place
}

/// The records of `gs2e check` on the scene itself, by statement.
fn finding(place: &Workspace, part: &str) -> Value {
    let message = place.gs2e("check --json --recipes recipe.yaml").stdout;
    let findings = message.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let subject = format!("given#{part}");
    findings.into_iter().find(|f| f["subject"] == subject).unwrap_or_else(|| panic!("{part}: {message}"))
}

fn measured(place: &Workspace, part: &str) -> f64 {
    finding(place, part)["measured"].as_f64().unwrap()
}

#[test]
fn a_scene_scores_high_on_photos_of_its_own() {
    let place = photographed(|_, v| v);
    place.ok("release --to tree recipe.yaml");
    place.ok("audit tree");
    // Rounding to 8 bits alone gives 20 log10(255 sqrt(12)) = 58.92 dB, and less where colours are
    // whole numbers or clipped.
    let mean = measured(&place, "mean");
    assert!((58.5..75.0).contains(&mean), "{mean}");
    assert!(measured(&place, "ssim") > 0.999);
    for part in ["drop", "mean", "ssim", "gap", "outlier"] {
        assert_eq!(finding(&place, part)["verdict"], "pass", "{part}");
    }
    let found = finding(&place, "reprojection");
    assert_eq!((found["check"].as_str(), found["verdict"].as_str()), (Some("capture"), Some("not-run")));
    assert_eq!(found["because"], "the source is not a COLMAP model");

    let reconstruction = &place.json("tree/given/scene.json")["reconstruction"];
    assert_eq!(
        (&reconstruction["psnr"]["mean"], &reconstruction["psnr"]["views"]),
        (&mean.into(), &6.into())
    );
    assert_eq!(reconstruction["ssim"], finding(&place, "ssim")["measured"]);
    // Of six views the first is held out by convention: photo, rendering, and no difference but that
    // of rounding, four times as large.
    let bytes = fs::read(place.path("tree/given/held_out.png")).unwrap();
    let sheet = png::read_rgb(std::io::Cursor::new(bytes)).unwrap();
    assert_eq!(sheet.size(), Size { width: 3 * 64 + 4, height: 48 });
    let columns = |from: usize| sheet.pixels().chunks(196).flat_map(move |row| &row[from..from + 64]);
    assert!(columns(0).any(|rgb| rgb[0] > 60), "the photo is not black");
    assert!(columns(132).all(|rgb| rgb.iter().all(|v| *v <= 4)));
    let page = fs::read_to_string(place.path("tree/report.html")).unwrap();
    assert!(page.contains("difference x 4") && page.contains("given/held_out.png"));
    let findings = place.json("tree/given/checks.json");
    assert_eq!(findings.as_array().unwrap().len(), 8);
    let card = fs::read_to_string(place.path("tree/README.md")).unwrap();
    assert!(
        card.contains("- not-run `capture` given#reprojection: the source is not a COLMAP model"),
        "{card}"
    );

    // Another program trained the scene, which may be the official one.
    assert!(card.contains("LicenseRef-Inria-MPII-3DGS"), "{card}");

    // The scene's claims are compared with the files in the tree.
    let altered = |from: &str, to: &str| {
        let text = fs::read_to_string(place.path("tree/given/checks.json")).unwrap();
        assert!(text.contains(from));
        place.write("tree/given/checks.json", text.replacen(from, to, 1));
        crate::release::small::reseal(&place.path("tree"));
        let found = place.gs2e("audit tree");
        place.write("tree/given/checks.json", text);
        (found.code, found.stdout + &found.stderr)
    };
    let (code, found) = altered(&mean.to_string(), "12.5");
    assert!(
        code == 3 && found.contains(&format!("its mean PSNR is 12.5, scene.json says {mean}")),
        "{found}"
    );
    let (code, found) = altered("\"pass\"", "\"fail\"");
    assert!(code == 3 && found.contains("checks.json: capture failed: "), "{found}");
}

#[test]
fn one_bad_view_warns_and_stops_a_release_by_the_limit_of_a_recipe() {
    // Every byte is off by 60, and no byte is clipped: 20 log10(255 / 60) = 12.57 dB.
    let other = |v: u8| if v < 128 { v + 60 } else { v - 60 };
    let place = photographed(|i, v| if i == 3 { other(v) } else { v });
    place.ok("build recipe.yaml");
    let found = finding(&place, "drop");
    assert_eq!((found["check"].as_str(), found["verdict"].as_str()), (Some("recon_psnr"), Some("warn")));
    assert!(found["because"].as_str().unwrap().starts_with("`images/003.png` has 12.57 dB"), "{found}");
    assert_eq!(place.gs2e("check --recipes recipe.yaml").code, 0);
    place.ok("release --to tree recipe.yaml");
    let recipe = fs::read_to_string(place.path("recipe.yaml")).unwrap();
    let limit = |more: &str| format!("{recipe}checks: {{ recon_psnr: {{ drop: 3 }}{more} }}\n");
    place.write("recipe.yaml", limit(""));
    let ended = place.gs2e("release --to tree recipe.yaml");
    assert!(ended.code == 3 && ended.stderr.contains("recon_psnr of given"), "{}", ended.stderr);
    place.write("recipe.yaml", limit(", waive: [{ check: recon_psnr, because: a lamp was on }]"));
    assert_eq!(place.build("recipe.yaml"), ["given/checks"], "the trajectory has no part in it");
    place.ok("release --to tree recipe.yaml");
    place.ok("audit tree");
    assert_eq!(finding(&place, "drop")["verdict"], "waived");
}

#[test]
fn a_changed_photo_is_compared_again_and_an_invalid_one_is_reported() {
    let place = photographed(|_, v| v);
    place.ok("build recipe.yaml");
    let other = fs::read(place.path("images/000.png")).unwrap();
    place.write("images/005.png", other);
    assert!(place.stale("recipe.yaml").contains(&"given/fidelity".to_owned()));
    place.write("images/004.png", "no photo");
    place.ok("build recipe.yaml");
    let message = finding(&place, "mean")["because"].as_str().unwrap().to_owned();
    assert!(
        message.starts_with("5 views have") && message.ends_with("`images/004.png`: neither JPEG nor PNG"),
        "{message}"
    );
    assert!(measured(&place, "drop") > 10.0, "the last view has the first one's photo");
}

#[test]
fn nothing_is_compared_without_photos() {
    let place = given::sound();
    place.ok("build recipe.yaml");
    let found = finding(&place, "drop");
    assert_eq!((&found["verdict"], &found["because"]), (&"not-run".into(), &"there are no photos".into()));
}

/// A COLMAP model of 20 images one step apart along x, which see one point one pixel off, and its
/// photos, two more than images.
#[test]
fn a_model_is_compared_with_its_points_and_its_folder() {
    let image = |i: u32| Photographed {
        id: i + 1,
        q: [1.0, 0.0, 0.0, 0.0],
        t: [-0.1 * f64::from(i), 0.0, 4.0],
        camera: 1,
        name: format!("{i}.jpg"),
        observations: vec![(320.0 - 10.0 * f64::from(i), 181.0, 7)],
    };
    let parameters = vec![500.0, 500.0, 320.0, 180.0];
    let mut planted = Planted {
        cameras: vec![Camera { id: 1, model: (1, "PINHOLE"), size: [640, 360], parameters }],
        images: (0..20).map(image).collect(),
        points: vec![(7, [0.0, 0.0, 1.0], 9.0)],
    };
    let place = given::sound();
    let recipe = GIVEN.replace("nerfstudio: { path: transforms.json }", "mvimgnet: { path: capture }");
    place.write("recipe.yaml", recipe.replace("outputs: [events, sharp]", "outputs: []") + LICENCE);
    planted.write_binary(&place.path("capture/sparse/0"));
    for i in 0..22 {
        place.write(&format!("capture/images/{i}.jpg"), format!("photo {i}"));
    }
    place.write("capture/images/3_bg_removed.png", "left over");
    place.write("capture/images/notes.txt", "no photo");
    place.ok("build recipe.yaml");
    let close = |part: &str, wanted: f64, verdict: &str| {
        let seen = finding(&place, part);
        let found = seen["measured"].as_f64().unwrap();
        assert!(
            (found - wanted).abs() < 1e-9 && seen["verdict"] == verdict,
            "{part}: {seen}, wanted {wanted}"
        );
    };
    close("reprojection", 1.0, "pass");
    close("reprojection-observations", 1.0, "pass");
    close("registered", 20.0 / 22.0, "pass");
    close("gap", 1.0, "pass");
    close("outlier", 0.0, "pass");
    let seen = finding(&place, "mean");
    let because = "no photo can be compared; `0.jpg`: neither JPEG nor PNG";
    assert_eq!((&seen["verdict"], &seen["because"]), (&"not-run".into(), &because.into()));

    // A run of views is missing, and another view is six steps off the path, far from its point.
    planted.images.drain(5..14);
    planted.images[8].t[1] = 0.6;
    planted.write_binary(&place.path("capture/sparse/0"));
    place.ok("build recipe.yaml");
    close("gap", 10.0, "warn");
    close("outlier", 37f64.sqrt() - 1.0, "warn");
    // 500 * 0.6 / 5 = 60 px lower, one of which is the key point's own offset.
    close("reprojection", (10.0 + 59.0) / 11.0, "warn");
    close("registered", 11.0 / 22.0, "warn");
}
