//! What is written is read back as near as the form allows, and a second time unchanged.

use super::*;
use crate::{SceneScreening, read_by_content};
use glam::DVec3;
use proptest::prelude::*;

/// A scene within what every form holds: positions up to `extent`, scales of the 8-bit range,
/// colours of 0 to 1.
fn scenes(extent: f64) -> impl Strategy<Value = Gaussians> {
    let fields = (0_u8..=3, 1_usize..5, prop::option::of(any::<bool>()));
    fields.prop_flat_map(move |(degree, n, antialiased)| {
        let numbers = |low: f32, high: f32, len: usize| prop::collection::vec(low..high, n * len);
        let rotation = prop_oneof![numbers(-1.0, 1.0, 4), Just(vec![0.5; 4 * n]), Just(vec![0.0; 4 * n])];
        let rest = sh::function_count(degree) - 1;
        let drawn = (
            prop::collection::vec(-1.0..1.0_f64, 3 * n),
            numbers(-10.0, 5.9, 3),
            rotation,
            numbers(-6.0, 6.0, 1),
            numbers(-1.7, 1.7, 3),
            numbers(-0.99, 0.99, 3 * rest),
            prop_oneof![Just(0.0), Just(1000.0)],
        );
        drawn.prop_map(move |(positions, scales, rotations, opacities, colours, harmonics, origin)| {
            let three = |f: &[f32]| [f[0], f[1], f[2]];
            let mut sh = Vec::new();
            for i in 0..n {
                sh.push(three(&colours[3 * i..]));
                sh.extend(harmonics[3 * rest * i..3 * rest * (i + 1)].chunks_exact(3).map(three));
            }
            let near = |x: &f64| <f32 as sh::Scalar>::nearest(x * extent);
            Gaussians {
                origin: DVec3::new(origin, 0.0, 0.0),
                positions: positions
                    .chunks_exact(3)
                    .map(|p| [near(&p[0]), near(&p[1]), near(&p[2])])
                    .collect(),
                log_scales: scales.chunks_exact(3).map(three).collect(),
                rotations: rotations.chunks_exact(4).map(|q| [q[0], q[1], q[2], q[3]]).collect(),
                opacity_logits: opacities,
                sh,
                sh_degree: degree,
                antialiased,
                screening: SceneScreening { read: n as u64, ..SceneScreening::default() },
                motion: None,
            }
        })
    })
}

fn read(form: SceneFormat, bytes: &[u8]) -> Gaussians {
    if form == SceneFormat::Splat {
        splat::read_splat(bytes).unwrap()
    } else {
        read_by_content(bytes).unwrap()
    }
}

fn largest(losses: &[FormatLoss], field: &str) -> f64 {
    losses.iter().filter(|l| l.field == field).filter_map(|l| l.largest).fold(0.0, f64::max)
}

/// No number is farther off than half a step, and a hair of 32-bit rounding.
fn check_steps(losses: &[FormatLoss], steps: &[(&str, f64)]) -> Result<(), TestCaseError> {
    for (field, step) in steps {
        let off = largest(losses, field);
        prop_assert!(off <= step / 2.0 + 1e-5 * step.max(0.01), "{field}: {off}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn spz_is_off_by_half_a_step_at_most(scene in scenes(20.0)) {
        let (bytes, losses) = SceneFormat::Spz.write(&scene).unwrap();
        let position = 2_f64.powi(-i32::from(spz::fractional_bits(&scene).unwrap()));
        // Opacity: the ends count as half a step. Colours: C0 of 1/255/0.15.
        let steps = [("positions", position), ("log scales", 0.0625), ("opacities", 1.0 / 255.0),
            ("colours", sh::C0 / 0.15 / 255.0), ("harmonics", 1.0 / 128.0)];
        check_steps(&losses, &steps)?;
        // Three components are off by sqrt(1/2)/1022 each; the fourth, at least 1/2, by at most
        // that times the sum of the others over it, 3 at most: a chord of 12^(1/2) of it, and an
        // angle of twice the chord.
        prop_assert!(largest(&losses, "rotations") < 2.0 * 12_f64.sqrt() * 0.000_692 + 1e-6);
        let back = read(SceneFormat::Spz, &bytes);
        prop_assert_eq!(back.antialiased, Some(scene.antialiased == Some(true)));
        prop_assert!(losses.iter().all(|l| l.largest.is_some()), "{losses:?}");
        let (again, losses) = SceneFormat::Spz.write(&back).unwrap();
        // What was read is written as it is, except where the two largest components of a rotation
        // nearly tie: then the other one is left out, and computed by the reader.
        prop_assert!(losses.iter().all(|l| l.field == "rotations" && l.largest < Some(1e-3)), "{losses:?}");
        if losses.is_empty() {
            prop_assert_eq!(read(SceneFormat::Spz, &again), back);
        }
    }

    #[test]
    fn splat_is_off_by_half_a_step_at_most(scene in scenes(20.0)) {
        let (bytes, losses) = SceneFormat::Splat.write(&scene).unwrap();
        // Positions: an ulp of 32 bits at 1,020 is 2^-13. Scales: exp and log of 32 bits, an ulp of
        // 10 each.
        let steps = [("positions", 2_f64.powi(-13)), ("log scales", 4e-6), ("opacities", 1.0 / 255.0),
            ("colours", 1.0 / 255.0)];
        check_steps(&losses, &steps)?;
        let back = read(SceneFormat::Splat, &bytes);
        prop_assert_eq!((back.len(), back.sh_degree, back.antialiased), (scene.len(), 0, None));
        // A component of 1 is cut to 127/128, a step; four components off by a step: a chord of
        // 2/128, twice that.
        prop_assert!(largest(&losses, "rotations") < 4.0 / 128.0);
        let fields: Vec<&str> = losses.iter().filter(|l| l.largest.is_none()).map(|l| l.field).collect();
        prop_assert_eq!(fields.contains(&"harmonics"), scene.sh_degree > 0);
        prop_assert_eq!(fields.contains(&"antialiased"), scene.antialiased == Some(true));
    }

    #[test]
    fn ply_loses_nothing(scene in scenes(20.0)) {
        let (bytes, losses) = SceneFormat::Ply.write(&scene).unwrap();
        prop_assert_eq!(losses, []);
        prop_assert_eq!(read(SceneFormat::Ply, &bytes).len(), scene.len());
    }
}

fn one(position: [f32; 3]) -> Gaussians {
    Gaussians {
        origin: DVec3::ZERO,
        positions: vec![position],
        log_scales: vec![[-4.0, 30.0, -30.0]],
        rotations: vec![[0.0, -2.0, 0.0, 0.0]],
        opacity_logits: vec![20.0],
        sh: vec![[0.0; 3], [0.5, -0.25, 3.0], [0.5; 3], [0.5; 3]],
        sh_degree: 1,
        antialiased: Some(true),
        screening: SceneScreening::default(),
        motion: None,
    }
}

#[test]
fn positions_have_as_many_bits_as_fit() {
    let t = |x: f32, bits: u8| {
        let (bytes, losses) = SceneFormat::Spz.write(&one([0.0, x, 0.0])).unwrap();
        assert_eq!(spz::fractional_bits(&one([0.0, x, 0.0])).unwrap(), bits, "{x}");
        let back = read(SceneFormat::Spz, &bytes).positions[0][1];
        assert!((back - x).abs() <= 0.5 / (1_u32 << bits) as f32, "{x}: {back}");
        assert_eq!((back + 0.0).to_bits() == x.to_bits(), largest(&losses, "positions") == 0.0, "{x}");
    };
    t(0.0, 24);
    t(-0.4, 24);
    t(1.0, 22);
    t(2_047.999_8, 12);
    t(-2048.0, 11);
    t(8_388_607.0, 0);
    let error = SceneFormat::Spz.write(&one([8_388_608.0, 0.0, 0.0])).unwrap_err().to_string();
    assert_eq!(error, "write .spz: found a coordinate of 8.388608e6, wanted less than 2^23");
    let error =
        SceneFormat::Splat.write(&Gaussians { log_scales: vec![[100.0; 3]], ..one([0.0; 3]) }).unwrap_err();
    assert!(error.to_string().contains("1 Gaussians have a position or a scale out of"), "{error}");
}

/// Values out of range go to the nearest end, and the losses name them.
#[test]
fn losses_are_named_with_their_size() {
    let (bytes, losses) = SceneFormat::Spz.write(&one([1.0; 3])).unwrap();
    let back = read(SceneFormat::Spz, &bytes);
    assert_eq!(back.log_scales, [[-4.0, 5.9375, -10.0]]);
    // A function that is odd in y turns its sign on the way, and 1 lies beyond 127/128.
    assert_eq!(back.sh[1..], [[0.5, -0.25, 1.0], [0.5; 3], [0.5; 3]]);
    assert_eq!(back.rotations, [[0.0, 1.0, 0.0, 0.0]]);
    let found: Vec<(&str, &str)> = losses.iter().map(|l| (l.field, l.what.as_str())).collect();
    assert_eq!(found[0], ("log scales", "rounded to steps of 1/16 from -10 to 5.9375, at most 2.41e1 off"));
    // A colour of 1/2 lies between two bytes, an opacity of 1 beyond 254.5/255.
    let fields: Vec<&str> = found.iter().map(|(field, _)| *field).collect();
    assert_eq!(fields, ["log scales", "opacities", "colours", "harmonics"]);
    assert_eq!(found[3].1, "rounded to steps of 1/128 within 127/128, at most 2.00e0 off");
    let (_, losses) = SceneFormat::Splat.write(&one([1.0; 3])).unwrap();
    let dropped: Vec<&str> = losses.iter().filter(|l| l.largest.is_none()).map(|l| l.what.as_str()).collect();
    assert_eq!(
        dropped,
        ["dropped above degree 0; the input has degree 1", "dropped: the reader must be set to antialiased"]
    );
}
