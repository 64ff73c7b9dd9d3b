//! The scenes of the golden renders.

use glam::DVec3;
use gs2e_scene::{Gaussians, SceneScreening};
use std::collections::BTreeMap;
use std::path::Path;

/// Reads a `.ply` whose properties are all little-endian floats.
pub(crate) fn read(path: &Path) -> Gaussians {
    let bytes = std::fs::read(path).unwrap();
    let marker = b"end_header\n";
    let body = bytes.windows(marker.len()).position(|w| w == marker).unwrap() + marker.len();
    let header = std::str::from_utf8(&bytes[..body]).unwrap();
    let count = header.lines().find_map(|l| l.strip_prefix("element vertex ")).unwrap().parse().unwrap();
    let names = header.lines().filter_map(|l| l.strip_prefix("property float "));
    let columns: BTreeMap<&str, usize> = names.enumerate().map(|(k, name)| (name, k)).collect();
    let table: Vec<f32> =
        bytes[body..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let value = |i: usize, name: &str| table[i * columns.len() + columns[name]];
    let rest = (0..45).filter(|k| columns.contains_key(format!("f_rest_{k}").as_str())).count() / 3;
    // channel-major: all of red, then green, then blue
    let sh = |i: usize, k: usize| {
        [0, 1, 2].map(|c| match k {
            0 => value(i, &format!("f_dc_{c}")),
            _ => value(i, &format!("f_rest_{}", c * rest + k - 1)),
        })
    };
    Gaussians {
        origin: DVec3::ZERO,
        positions: (0..count).map(|i| ["x", "y", "z"].map(|n| value(i, n))).collect(),
        log_scales: (0..count).map(|i| ["scale_0", "scale_1", "scale_2"].map(|n| value(i, n))).collect(),
        rotations: (0..count).map(|i| ["rot_0", "rot_1", "rot_2", "rot_3"].map(|n| value(i, n))).collect(),
        opacity_logits: (0..count).map(|i| value(i, "opacity")).collect(),
        sh: (0..count).flat_map(|i| (0..=rest).map(move |k| (i, k))).map(|(i, k)| sh(i, k)).collect(),
        sh_degree: match rest {
            0 => 0,
            3 => 1,
            8 => 2,
            15 => 3,
            n => panic!("{n} coefficients a channel"),
        },
        antialiased: None,
        screening: SceneScreening::default(),
        motion: None,
    }
}
