//! Real scene files, described by the README of the optional test data, and synthetic scenes of
//! `tests/golden/render`.

#![expect(clippy::unwrap_used, reason = "a test panics to fail")]

use gs2e_scene as scene;
use gs2e_scene::Gaussians;
use gs2e_testing::ply::PlyScene;
use gs2e_testing::{golden, ply, shared};

/// Reads a scene of `count` Gaussians of this degree. Nine tenths of them lie within `radius` of
/// the origin along each axis, and scales and quaternions are those of a trained scene.
fn check(name: &str, count: usize, degree: u8, radius: f32) -> Option<Gaussians> {
    let scene = scene::read_file(&shared::path(&format!("data/{name}"))?).unwrap();
    assert_eq!((scene.len(), scene.sh_degree), (count, degree), "{name}");
    assert_eq!((scene.screening.read, scene.screening.non_finite), (count as u64, 0), "{name}");
    for axis in 0..3 {
        let (low, high) = (quantile(&scene, axis, 0.05), quantile(&scene, axis, 0.95));
        let within = -radius < low && high < radius && high - low > radius / 2.0;
        assert!(within, "{name}: axis {axis}, {low} to {high}");
    }
    assert!(scene.sh.as_flattened().iter().all(|c| c.abs() < 20.0), "{name}");
    assert!(scene.opacity_logits.iter().all(|o| o.abs() < 25.0), "{name}");
    let norms = scene.rotations.iter().map(|q| q.iter().map(|c| c * c).sum::<f32>());
    // Quaternions of 8 bits are off by up to half a step, 1/256, in each of four components.
    assert!(norms.into_iter().all(|n| (n - 1.0).abs() < 0.05), "{name}");
    Some(scene)
}

fn quantile(scene: &Gaussians, axis: usize, share: f64) -> f32 {
    let mut values: Vec<f32> = scene.positions.iter().map(|p| p[axis]).collect();
    values.sort_by(f32::total_cmp);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of an index")]
    let index = (share * (values.len() - 1) as f64) as usize;
    values[index]
}

/// Mean coefficient of a basis function over all Gaussians and channels.
fn mean_harmonic(scene: &Gaussians, function: usize) -> f64 {
    let sum: f64 = (0..scene.len()).flat_map(|i| scene.sh_of(i)[function]).map(f64::from).sum();
    sum / (3 * scene.len()) as f64
}

#[test]
fn a_splat_file_is_read() {
    check("scenes/plant.splat", 113_648, 0, 0.5);
}

#[test]
fn an_spz_file_of_a_garden_is_read() {
    check("scenes/flowers.spz", 542_104, 2, 0.35);
}

/// Compares the scene as `.ply` at a coarse level and as `.spz`, each in its own axes: positions,
/// and the harmonic that is odd in y, must agree in value and sign.
#[test]
fn ply_and_spz_agree_on_axes() {
    let Some(ply) = check("scenes/playbot_lod3.ply", 31_000, 2, 1.0) else { return };
    let Some(spz) = check("scenes/playbot.spz", 500_000, 2, 1.0) else { return };
    for axis in 0..3 {
        let (a, b) = (quantile(&ply, axis, 0.5), quantile(&spz, axis, 0.5));
        assert!((a - b).abs() < 0.01, "axis {axis}: median {a} and {b}");
    }
    // Up is -y: the ground is near 0, and the robot reaches to about -1.
    for (share, tolerance) in [(0.001, 0.05), (0.98, 0.01)] {
        let (a, b) = (quantile(&ply, 1, share), quantile(&spz, 1, share));
        assert!((a - b).abs() < tolerance, "height at {share}: {a} and {b}");
    }
    let (a, b) = (mean_harmonic(&ply, 1), mean_harmonic(&spz, 1));
    assert!(a < -0.02 && (a - b).abs() < 0.02, "harmonic in y: {a} and {b}");
}

/// A scene of the golden renders.
fn synthetic(name: &str) -> Gaussians {
    scene::read_file(&golden::folder("render").join(name)).unwrap()
}

/// Positions of 32 bits stay unchanged, also at a million units. The twin's positions lie on a grid
/// that both can represent.
#[test]
fn a_far_scene_of_32_bits_is_not_recentred() {
    let [near, far] = ["s_offset0.ply", "s_offset1e6.ply"].map(synthetic);
    assert_eq!((near.origin, far.origin), (glam::DVec3::ZERO, glam::DVec3::ZERO));
    let moved: Vec<[f32; 3]> = near.positions.iter().map(|p| p.map(|x| x + 1e6)).collect();
    assert_eq!(far.positions, moved);
}

/// NaN fields are dropped; the rest equals the twin without them.
#[test]
fn a_scene_with_nan_equals_its_twin() {
    let [nan, twin] = ["s_nan.ply", "s_nan_twin.ply"].map(synthetic);
    assert_eq!(nan.screening.non_finite, 12);
    assert_eq!(Gaussians { screening: twin.screening, ..nan }, twin);
}

/// Reads a golden scene in a compressed form, and an independent decoder's result.
fn decoded(name: &str) -> (Gaussians, PlyScene) {
    let folder = golden::folder("scenes");
    let expected = folder.join(name).with_extension("expected.ply");
    (scene::read_file(&folder.join(name)).unwrap(), ply::read(&expected))
}

/// Both sides compute in 64 bits and round once to 32. Where their formulas differ, the last bit
/// may differ: an ulp is at most 2^-23 of the value. Three components give the fourth of a unit
/// quaternion: with an error of 64-bit arithmetic below 1e-15 in its square, its root is off by
/// less than 4e-8, even at zero.
#[test]
fn compressed_forms_are_read_as_an_independent_decoder_reads_them() {
    let close = |what: &str, got: &[f32], wanted: &[f32], floor: f32| {
        assert_eq!(got.len(), wanted.len(), "{what}");
        for (i, (g, w)) in got.iter().zip(wanted).enumerate() {
            assert!((g - w).abs() <= f32::EPSILON * w.abs() + floor, "{what} {i}: {g} for {w}");
        }
    };
    let t = |name: &str, count: usize, degree: u8, antialiased: Option<bool>| {
        let (got, wanted) = decoded(name);
        assert_eq!((got.len(), got.sh_degree, got.antialiased), (count, degree, antialiased), "{name}");
        assert_eq!((got.screening.read, got.screening.non_finite), (count as u64, 0), "{name}");
        close(name, got.positions.as_flattened(), wanted.positions.as_flattened(), 0.0);
        close(name, got.log_scales.as_flattened(), wanted.log_scales.as_flattened(), 0.0);
        close(name, got.rotations.as_flattened(), wanted.rotations.as_flattened(), 4e-8);
        close(name, &got.opacity_logits, &wanted.opacity_logits, 0.0);
        close(name, got.sh.as_flattened(), wanted.sh.as_flattened(), 0.0);
    };
    t("packed-coloured.ply", 300, 1, None);
    t("packed-plain.ply", 7, 0, None);
    t("packed-third-degree.ply", 5, 3, None);
    t("palette.sog", 90, 2, Some(true));
    t("third-degree.sog", 20, 3, None);
    t("flat.sog", 10, 0, Some(false));
}
