//! The canonical `.ply` form of a scene.

use super::position::to_absolute;
use super::{notes::PlyNotes, property_names};
use crate::Gaussians;
use glam::DVec3;
use std::fmt::Write as _;
use std::io::{self, BufWriter, Write};

/// Writes `scene` as 3DGS does (graphdeco-inria/gaussian-splatting, `GaussianModel.save_ply`):
/// binary little endian, `x y z nx ny nz f_dc f_rest opacity scale rot`, the other harmonics
/// channel by channel, zero normals. Positions are `double` if the scene has an origin, otherwise
/// `float`. [`super::read_ply`] returns the same scene, bit for bit.
///
/// # Errors
/// `out` fails.
pub fn write_ply(scene: &Gaussians, out: impl Write) -> io::Result<()> {
    write_rows(scene, &[], |_, _| (), out)
}

/// Writes a scene with more properties of 32 bits, whose numbers `more` appends to the row of each Gaussian.
pub(super) fn write_rows(
    scene: &Gaussians,
    names: &[String],
    more: impl Fn(usize, &mut Vec<u8>),
    out: impl Write,
) -> io::Result<()> {
    let mut out = BufWriter::new(out);
    out.write_all(header_text(scene, names).as_bytes())?;
    let mut row = Vec::new();
    for i in 0..scene.len() {
        row.clear();
        push_row(scene, i, &mut row);
        more(i, &mut row);
        out.write_all(&row)?;
    }
    out.flush()
}

fn header_text(scene: &Gaussians, more: &[String]) -> String {
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    let notes = PlyNotes::for_scene(scene);
    // Sums of a position and an origin need 64 bits.
    let (count, position) = (scene.len(), if notes.origin.is_some() { "double" } else { "float" });
    let _ = writeln!(text, "{notes}element vertex {count}");
    for (i, name) in property_names(scene.sh_degree).iter().chain(more).enumerate() {
        let number = if i < 3 { position } else { "float" };
        let _ = writeln!(text, "property {number} {name}");
    }
    text + "end_header\n"
}

fn push_row(scene: &Gaussians, i: usize, row: &mut Vec<u8>) {
    push_position(scene.positions[i], scene.origin, row);
    let mut push = |values: &[f32]| values.iter().for_each(|v| row.extend(v.to_le_bytes()));
    // Normals, which the format has and Gaussians lack.
    push(&[0.0; 3]);
    let (dc, rest) = scene.sh_of(i).split_at(1);
    push(&dc[0]);
    for channel in 0..3 {
        rest.iter().for_each(|c| push(&c[channel..=channel]));
    }
    push(&[scene.opacity_logits[i]]);
    push(&scene.log_scales[i]);
    push(&scene.rotations[i]);
}

fn push_position(position: [f32; 3], origin: DVec3, row: &mut Vec<u8>) {
    if origin == DVec3::ZERO {
        return position.iter().for_each(|p| row.extend(p.to_le_bytes()));
    }
    for (p, o) in position.into_iter().zip(origin.to_array()) {
        row.extend(to_absolute(p, o).to_le_bytes());
    }
}
