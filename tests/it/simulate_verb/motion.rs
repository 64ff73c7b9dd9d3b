//! Warnings about frames that are too far apart, or that repeat.

use super::npy;
use crate::support::workspace::Workspace;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

/// Waves of no common period, moved by `px` to the right and three quarters as far down, with a hundredth
/// of noise.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 3 to 253")]
fn picture(px: f64, noise: &mut u32) -> Vec<u8> {
    let mut grey = |i: usize| {
        let (x, y) = ((i % WIDTH) as f64 - px, (i / WIDTH) as f64 - 0.75 * px);
        let waves = [(0.31, 0.17, 0.3), (0.11, -0.29, 1.7), (-0.23, 0.07, 4.1), (0.05, 0.41, 2.2)];
        let sum: f64 = waves.iter().map(|(a, b, c)| (a * x + b * y + c).sin()).sum();
        *noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (128.0 + 30.0 * sum + f64::from(*noise >> 24) / 100.0).round() as u8
    };
    (0..WIDTH * HEIGHT).map(&mut grey).collect()
}

/// The messages of `simulate` for a clip whose frames move by `px`, each shown `times` times.
fn messages(px: f64, times: usize, fps: &str) -> String {
    let mut noise = 1;
    let pictures: Vec<Vec<u8>> =
        (0..24usize.div_ceil(times)).map(|i| picture(0.8 * px * i as f64, &mut noise)).collect();
    simulate(&pictures, times, fps)
}

/// The messages for these pictures, each shown `times` times.
fn simulate(pictures: &[Vec<u8>], times: usize, fps: &str) -> String {
    let place = Workspace::new();
    let frames: Vec<u8> = pictures.iter().flat_map(|picture| picture.repeat(times)).collect();
    let count = (pictures.len() * times) as u64;
    npy(&place.path("f.npy"), &[count, HEIGHT as u64, WIDTH as u64], &frames);
    place.ok(&format!("simulate --frames f.npy --fps {fps} --sensor esim --out e.h5")).stderr
}

#[test]
fn the_motion_that_is_stated_is_that_of_the_clip() {
    // A pan of 222 px/s at several frame rates; 0.8 (1, 0.75) is a unit vector.
    for (fps, px) in [(15, 14.8), (30, 7.4), (60, 3.7), (120, 1.85)] {
        let said = messages(px, 1, &fps.to_string());
        let stated = said.split("moves by ").nth(1).and_then(|rest| rest.split(' ').next());
        let stated: f64 = stated.unwrap_or_else(|| panic!("{px}: {said}")).parse().unwrap();
        // A tenth of a pixel in each direction, and the rounding of the message.
        assert!((stated - px).abs() < 0.2, "{px}: {said}");
        let times = f64::from(fps) * stated.ceil();
        assert!(said.contains(&format!("at least {:.0} times", stated.ceil())), "{said}");
        assert!(said.contains(&format!(" {times:.0} per second")), "{said}");
    }
    let said = messages(0.6, 1, "370");
    assert!(!said.contains("frame to frame"), "{said}");
    // Squares of 4x4 pixels, with greys of their own in each frame.
    let mixed = |n: u32| {
        let n = (n ^ (n >> 16)).wrapping_mul(0x85eb_ca6b);
        (n ^ (n >> 13)).wrapping_mul(0xc2b2_ae35)
    };
    let unrelated = |frame: u32| -> Vec<u8> {
        let square = |i: u32| frame * 10_000 + i / 160 / 4 * 100 + i % 160 / 4;
        (0..160 * 120).map(|i| 30 + mixed(square(i)).to_be_bytes()[0] / 2).collect()
    };
    let said = simulate(&(0..6).map(unrelated).collect::<Vec<_>>(), 1, "5");
    assert!(said.contains("too far apart") && said.contains("gs2e train"), "{said}");
}

#[test]
fn frames_that_repeat_are_counted() {
    let said = messages(3.0, 8, "240");
    assert!(said.contains("21 of 23 frames repeat the one before: was the clip sampled up?"), "{said}");
    // The clip has 30 pictures per second, 3 px apart.
    assert!(said.contains("at least 3 times the frames") || said.contains("at least 4 times"), "{said}");
    assert!(!messages(3.0, 1, "30").contains("repeat"), "all frames differ");
}

#[test]
fn every_input_is_named_where_none_is_given() {
    let said = Workspace::new().gs2e("simulate --sensor esim --out e.h5");
    assert_eq!(said.code, 2);
    assert!(said.stderr.contains("--frames") && said.stderr.contains("--video"), "{}", said.stderr);
}
