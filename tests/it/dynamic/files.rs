//! Files of scenes that change with time, which this test writes number by number, with values by the
//! formulas of their formats.

use super::single;
use crate::support::workspace::Workspace;
use gs2e_scene::blobs::{ColourBlob, blob_scene};
use gs2e_scene::dynamic::file::read_dynamic;
use gs2e_scene::dynamic::{SceneSpan, SceneTime};
use gs2e_scene::{Gaussians, ply, sh};
use serde_json::{Value, json};
use std::path::Path;

/// The values of a Gaussian, by the names of published files.
fn planted(i: u8, name: &str) -> f64 {
    let i = f64::from(i);
    let k: f64 = name.rsplit('_').next().unwrap().parse().unwrap_or(0.0);
    match name.split('_').next().unwrap() {
        "x" => 0.5 * i - 0.25,
        "y" => 0.25 - 0.125 * i,
        "z" => 4.0 + 0.5 * i,
        "motion" => 0.125 * k - 0.25 * i,
        "omega" => 0.25 * k - 0.125 * i - 0.25,
        "trbf" if name == "trbf_center" => 0.25 + 0.25 * i,
        // Widths 1, 2 and 4, which a `.splatv` has as they are.
        "trbf" => i * std::f64::consts::LN_2,
        // Colours that are whole bytes.
        "f" => (51.0 + 51.0 * k + 17.0 * i) / 255.0,
        "opacity" => 0.5 - i,
        "scale" => (-2.0 - k) * std::f64::consts::LN_2,
        "rot" => 0.5 + 0.25 * k - 0.5 * i,
        _ => 7.0,
    }
}

const NAMES: &str = "x y z trbf_center trbf_scale nx ny nz motion_0 motion_1 motion_2 motion_3 motion_4 motion_5 motion_6 \
                     motion_7 motion_8 f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 \
                     omega_0 omega_1 omega_2 omega_3";

/// A file of three Gaussians with these properties, as Spacetime Gaussians writes them.
fn tracks_file(names: &str, value: impl Fn(u8, &str) -> f64) -> Vec<u8> {
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\n".to_vec();
    names.split_whitespace().for_each(|name| bytes.extend(format!("property float {name}\n").bytes()));
    bytes.extend(b"end_header\n");
    for i in 0..3 {
        names.split_whitespace().for_each(|name| bytes.extend(single(value(i, name)).to_le_bytes()));
    }
    bytes
}

/// The 16 bits of a number that has few digits.
fn half(value: f64) -> [u8; 2] {
    if value.abs() < 1e-300 {
        return [0; 2];
    }
    let exponent = value.abs().log2().floor();
    let fraction = value.abs() / exponent.exp2() - 1.0;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of 16 bits")]
    let bits = ((exponent + 15.0) * 1024.0 + fraction * 1024.0).round() as u16;
    (bits | u16::from(value < 0.0) << 15).to_le_bytes()
}

/// The same three Gaussians as splaTV's program packs them, in a texture with places for four.
fn splatv_file() -> Vec<u8> {
    let mut texture = Vec::new();
    for i in 0..3 {
        let v = |name: &str| planted(i, name);
        ["x", "y", "z"].map(v).iter().for_each(|v| texture.extend(single(*v).to_le_bytes()));
        let mut halves = |values: &[f64]| values.iter().for_each(|v| texture.extend(half(*v)));
        halves(&["rot_0", "rot_1", "rot_2", "rot_3"].map(v));
        halves(&["scale_0", "scale_1", "scale_2"].map(|name| v(name).exp()));
        halves(&[0.0]);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a byte")]
        let byte = |v: f64| (v * 255.0).round() as u8;
        texture.extend(["f_dc_0", "f_dc_1", "f_dc_2"].map(|name| byte(v(name))));
        texture.push(byte(1.0 / (1.0 + (-v("opacity")).exp())));
        let mut halves = |values: &[f64]| values.iter().for_each(|v| texture.extend(half(*v)));
        halves(&[0, 1, 2, 3, 4, 5, 6, 7, 8].map(|k| v(&format!("motion_{k}"))));
        halves(&[0.0]);
        halves(&[0, 1, 2, 3].map(|k| v(&format!("omega_{k}"))));
        halves(&[v("trbf_center"), v("trbf_scale").exp()]);
    }
    texture.resize(256, 0);
    let list = json!([
        { "type": "notes", "size": 5 },
        { "type": "splat", "size": 256, "texwidth": 4096, "texheight": 1, "cameras": [] },
    ]);
    let list = list.to_string();
    let length = u32::try_from(list.len()).unwrap().to_le_bytes();
    [&0x674b_u32.to_le_bytes()[..], &length, list.as_bytes(), b"notes", &texture].concat()
}

const TIME: SceneTime = SceneTime { start: 0.0, speed: 1.0, span: SceneSpan::Duration(2.0) };

/// Compares a scene with the formulas of the format, at some times. `opacity` is the largest error of
/// opacities.
fn check_tracks(scene: &Gaussians, opacity: f64) {
    let dynamics = scene.dynamics().unwrap();
    assert_eq!((scene.len(), dynamics.end_s().to_bits()), (3, 2_f64.to_bits()));
    for i in 0..3 {
        let v = |name: String| planted(i, &name);
        for c in 0..3 {
            let colour = 0.5 + sh::C0 * f64::from(scene.sh_of(i.into())[0][c]);
            assert!((colour - v(format!("f_dc_{c}"))).abs() < 1e-6);
        }
        for seconds in [0.0, 0.7, 2.0] {
            let splat = scene.at(seconds).unwrap().splat(i.into());
            let d = seconds / 2.0 - planted(i, "trbf_center");
            for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
                let m = |power: usize| v(format!("motion_{}", 3 * power + k));
                let wanted = planted(i, axis) + m(0) * d + m(1) * d.powi(2) + m(2) * d.powi(3);
                let rate = (m(0) + 2.0 * m(1) * d + 3.0 * m(2) * d.powi(2)) / 2.0;
                let [found, found_rate] = splat.position[k];
                assert!(
                    (found - wanted).abs() < 1e-9 && (found_rate - rate).abs() < 1e-9,
                    "{i} {axis} {seconds}"
                );
                assert!((splat.log_scale[k][0] - v(format!("scale_{k}"))).abs() < 1e-6);
            }
            for k in 0..4 {
                let omega = v(format!("omega_{k}"));
                let [found, rate] = splat.rotation[k];
                assert!(
                    (found - v(format!("rot_{k}")) - omega * d).abs() < 1e-9
                        && (rate - omega / 2.0).abs() < 1e-9
                );
            }
            let width = planted(i, "trbf_scale").exp();
            let wanted = (-(d / width).powi(2)).exp() / (1.0 + (-planted(i, "opacity")).exp());
            assert!((splat.opacity[0] - wanted).abs() < opacity, "{i} {seconds}: {:?}", splat.opacity);
        }
    }
}

#[test]
fn files_of_spacetime_gaussians_and_of_splatv_have_the_values_of_their_formulas() {
    let place = Workspace::new();
    place.write("planted.ply", tracks_file(NAMES, planted));
    check_tracks(&read_dynamic(&place.path("planted.ply"), TIME).unwrap(), 1e-7);
    // Opacities of 8 bits are off by half a step.
    place.write("planted.splatv", splatv_file());
    check_tracks(&read_dynamic(&place.path("planted.splatv"), TIME).unwrap(), 0.5 / 255.0);
}

/// A folder with three frames of a Gaussian that rests and one that moves.
fn sequence(place: &Workspace, change: impl Fn(usize, &mut Gaussians)) {
    for k in 0_u8..3 {
        let blob = |x: f64| ColourBlob {
            position: [single(x), 0.1, 4.0],
            deviations: [0.3; 3],
            opacity: 0.9,
            colour: [0.9, 0.4, 0.2],
            ..ColourBlob::default()
        };
        let mut scene = blob_scene(&[blob(-0.8), blob(0.4 * f64::from(k * k))]);
        change(k.into(), &mut scene);
        let mut bytes = Vec::new();
        ply::write_ply(&scene, &mut bytes).unwrap();
        // In natural order, 9 is before 10.
        place.write(&format!("frames/{}.ply", 9 + k), bytes);
    }
}

fn values(path: &Path) -> Vec<f32> {
    npyz::NpyFile::new(&std::fs::read(path).unwrap()[..]).unwrap().into_vec().unwrap()
}

const CAMERA: &str = r#"{ "W": 64, "H": 48, "fx": 60, "fy": 60, "cx": 32, "cy": 24, "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0,0,0] }"#;

#[test]
fn a_moment_of_a_sequence_is_its_frame_and_between_frames_a_parabola() {
    let place = Workspace::new();
    place.write("camera.json", CAMERA);
    sequence(&place, |_, _| ());
    let render = |options: &str, out: &str| {
        place.ok(&format!("render --view camera.json --out {out} --backend cpu {options}"));
        values(&place.path(out))
    };
    let middle = render("--scene frames --frame-rate 10 --at-time 0.1", "middle.npy");
    let frame = render("--scene frames/10.ply", "frame.npy");
    assert!(middle.iter().zip(&frame).all(|(a, b)| (a - b).abs() < 1e-6), "a frame is met");
    // The place of the second Gaussian is 0.4 k^2, which three frames continue exactly.
    let between = render("--scene frames --frame-rate 10 --at-time 0.15", "between.npy");
    let mut scene = ply::read_ply(&std::fs::read(place.path("frames/10.ply")).unwrap()).unwrap();
    scene.positions[1][0] = 0.9;
    let mut bytes = Vec::new();
    ply::write_ply(&scene, &mut bytes).unwrap();
    place.write("moved.ply", bytes);
    let moved = render("--scene moved.ply", "moved.npy");
    assert!(between.iter().zip(&moved).all(|(a, b)| (a - b).abs() < 1e-5), "the parabola is met");
    // Its velocity at 0.15 s is 0.8 * 1.5 units per frame, 12 units a second, on 60 px at a depth of 4.
    place.ok(
        "render --view camera.json --out flow.npy --backend cpu --scene frames --frame-rate 10 --at-time 0.15 --channel flow \
         --velocity 0,0,0,0,0,0",
    );
    let flow = values(&place.path("flow.npy"));
    let at = 2 * (25 * 64 + 45);
    assert!((flow[at] - 180.0).abs() < 0.1 && flow[at + 1].abs() < 0.1, "{:?}", &flow[at..at + 2]);
}

#[test]
fn info_says_what_changes_and_suggests_a_recipe() {
    let place = Workspace::new();
    place.write("planted.ply", tracks_file(NAMES, planted));
    place.write("planted.splatv", splatv_file());
    sequence(&place, |_, _| ());
    let t = |path: &str, wanted: &[&str]| {
        let said = place.ok(&format!("info {path}")).stdout;
        wanted.iter().for_each(|wanted| assert!(said.contains(wanted), "{wanted}: {said}"));
    };
    let tracks = "tracks of degree 3, from 0 to the `duration` of a recipe";
    t("planted.ply", &[".ply with tracks", tracks, "time: { duration: 1 }"]);
    t("planted.splatv", &[".splatv", tracks, "time: { duration: 1 }"]);
    t("frames", &["folder of scene files", "a sequence of 3 frames, 0.066667 s at 30", "time: { rate: 30 }"]);
    let said: Value = serde_json::from_str(&place.ok("--json info frames").stdout).unwrap();
    assert_eq!(
        (&said["change"]["frames"], &said["change"]["harmonics"]),
        (&json!(3), &json!(false)),
        "{said}"
    );
}

/// A rendering with these options fails, and says this.
fn refused(place: &Workspace, options: &str, wanted: &str) {
    place.write("camera.json", CAMERA);
    let ended = place.gs2e(&format!("render --view camera.json --out out.npy --backend cpu {options}"));
    assert_ne!(ended.code, 0, "{options}");
    assert!(ended.stderr.contains(wanted), "{wanted}: {}", ended.stderr);
}

#[test]
fn faulty_tracks_are_named() {
    let place = Workspace::new();
    let t = |options: &str, wanted: &str| refused(&place, options, wanted);
    place.write("camera.json", CAMERA);
    let without = |name: &str| tracks_file(&NAMES.replace(name, "other"), planted);
    place.write("planted.ply", tracks_file(NAMES, planted));
    place.write("still.ply", without("motion_4"));
    t("--scene still.ply --at-time 0", "found no property `motion_4`, wanted motion_0..8, omega_0..3");
    t(
        "--scene planted.ply",
        "a scene that changes with time, with trbf_center is not supported; say when it is seen",
    );
    place.write("network.ply", tracks_file(&format!("{NAMES} f_dc_3"), planted));
    t("--scene network.ply --at-time 0", "a network for colours, with f_dc_3 is not supported");
    let broken =
        tracks_file(NAMES, |i, name| if name == "omega_2" && i > 0 { f64::NAN } else { planted(i, name) });
    place.write("broken.ply", broken);
    let said = place
        .ok("render --view camera.json --out out.npy --backend cpu --scene broken.ply --at-time 0")
        .stderr;
    assert!(said.contains("2 of 3 Gaussians in the file hold a NaN or an infinity"), "{said}");
    place.write(
        "nothing.ply",
        tracks_file(NAMES, |_, name| if name == "omega_2" { f64::INFINITY } else { 1.0 }),
    );
    t("--scene nothing.ply --at-time 0", "of 3 in the scene, 3 hold a NaN or an infinity");
    t(
        "--scene planted.ply --at-time 2.5 --duration 2",
        "the scene lasts from 0 to 2 s, found a view at 2.5 s of it",
    );
    t("--scene planted.ply --at-time 0 --duration 1 --frame-rate 3", "cannot be used with");
    t("--scene planted.ply --duration 1", "--at-time");
    place.write("v.splatv", splatv_file());
    t("--scene v.splatv", "a scene that changes with time is not supported; say when it is seen");
}

#[test]
fn faulty_sequences_are_named() {
    let place = Workspace::new();
    let t = |options: &str, wanted: &str| refused(&place, options, wanted);
    sequence(&place, |k, scene| {
        if k == 2 {
            scene.positions.pop();
        }
    });
    t(
        "--scene frames --at-time 0 --frame-rate 10",
        "read the frames of `frames`: 11.ply: found 1 Gaussians, wanted 2 as in the first frame",
    );
    sequence(&place, |k, scene| {
        if k == 1 {
            scene.positions[0][1] = f32::NAN;
        }
    });
    t(
        "--scene frames --at-time 0 --frame-rate 10",
        "10.ply: 1 Gaussians hold a NaN or an infinity, wanted 0",
    );
    place.write("one/0.ply", tracks_file(NAMES, planted));
    t("--scene one --at-time 0 --frame-rate 10", "a scene that changes with time");
    place.write("empty/readme.txt", "");
    t(
        "--scene empty --at-time 0 --frame-rate 10",
        "read the frames of `empty`: found 0 frames, wanted at least 2",
    );
}
