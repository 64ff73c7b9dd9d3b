//! Reader of `.ply` scenes that shares no code with the crates under test.

use std::collections::BTreeMap;
use std::path::Path;

/// The columns of a scene of 3D Gaussians, as the file has them.
#[derive(Debug, Clone, PartialEq)]
pub struct PlyScene {
    /// Means.
    pub positions: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations.
    pub log_scales: Vec<[f32; 3]>,
    /// Quaternions w, x, y, z.
    pub rotations: Vec<[f32; 4]>,
    /// Logits of the opacities.
    pub opacity_logits: Vec<f32>,
    /// Red, green and blue of each basis function, by Gaussian.
    pub sh: Vec<[f32; 3]>,
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
}

/// Reads a `.ply` whose properties are all little-endian floats.
///
/// # Panics
/// The file is absent, or in another form.
#[must_use]
pub fn read(path: &Path) -> PlyScene {
    let bytes = std::fs::read(path).expect("the scene can be read");
    let marker = b"end_header\n";
    let body = bytes.windows(marker.len()).position(|w| w == marker);
    let body = body.expect("the header ends") + marker.len();
    let header = std::str::from_utf8(&bytes[..body]).expect("the header is text");
    let count = header.lines().find_map(|l| l.strip_prefix("element vertex ")).expect("there are Gaussians");
    let count: usize = count.parse().expect("their number");
    let names = header.lines().filter_map(|l| l.strip_prefix("property float "));
    let columns: BTreeMap<&str, usize> = names.enumerate().map(|(k, name)| (name, k)).collect();
    let table: Vec<f32> = bytes[body..].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let value = |i: usize, name: &str| table[i * columns.len() + columns[name]];
    let rest = (0..45).filter(|k| columns.contains_key(format!("f_rest_{k}").as_str())).count() / 3;
    // Channel-major: all of red, then green, then blue.
    let sh = |i: usize, k: usize| {
        [0, 1, 2].map(|c| match k {
            0 => value(i, &format!("f_dc_{c}")),
            _ => value(i, &format!("f_rest_{}", c * rest + k - 1)),
        })
    };
    PlyScene {
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
    }
}
