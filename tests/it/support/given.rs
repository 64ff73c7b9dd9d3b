//! A captured scene in files, as a user has it: a recipe, a `.ply` and a `transforms.json`, sound
//! or with one fault.

use super::workspace::Workspace;
use std::io::Write as _;

/// A recipe over the files that [`sound`] writes.
pub(crate) const GIVEN: &str = "\
version: 1
scene: given
seed: 7
source: { nerfstudio: { path: transforms.json } }
reconstruct: { given: { path: scene.ply } }
camera: { width: 64, height: 48 }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"0.25*sin(t) + 1.1\" }
sampling: { rate: 2400, between: linear }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }
outputs: [events, sharp]
";

/// [`GIVEN`] as `recipe.yaml` with its scene and its poses, without faults.
pub(crate) fn sound() -> Workspace {
    let place = Workspace::new();
    place.write("recipe.yaml", GIVEN);
    place.write("scene.ply", ply(|_, value| value));
    place.write("transforms.json", transforms(1.0));
    place
}

/// A row of 40 Gaussians along x. `change` maps each value, given its column.
pub(crate) fn ply(change: impl Fn(usize, f32) -> f32) -> Vec<u8> {
    const PROPERTIES: [&str; 14] = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
        "rot_1", "rot_2", "rot_3",
    ];
    let mut file = b"ply\nformat binary_little_endian 1.0\nelement vertex 40\n".to_vec();
    for name in PROPERTIES {
        writeln!(file, "property float {name}").expect("memory can be written");
    }
    file.extend(b"end_header\n");
    for i in 0..40u8 {
        let x = (f32::from(i) - 20.0) / 10.0;
        let shade = f32::from(i % 5) - 2.0;
        let row = [x, 0.1 * shade, 0.0, shade, -shade, 0.5, 2.0, -2.5, -2.0, -2.5, 1.0, 0.0, 0.0, 0.0];
        let changed = row.iter().enumerate().flat_map(|(column, value)| change(column, *value).to_le_bytes());
        file.extend(changed);
    }
    file
}

/// Six views of the origin from a short arc. With a `stretch` other than 1 their matrices are no
/// rotations.
pub(crate) fn transforms(stretch: f64) -> String {
    let frame = |i: u32| {
        let (sin, cos) = (0.002 * f64::from(i)).sin_cos();
        let rows = [
            [cos, 0.0, sin, 4.0 * sin],
            [0.0, stretch, 0.0, 0.0],
            [-sin, 0.0, cos, 4.0 * cos],
            [0.0, 0.0, 0.0, 1.0],
        ];
        serde_json::json!({ "file_path": format!("images/{i:03}.png"), "transform_matrix": rows })
    };
    let frames: Vec<_> = (0..6).map(frame).collect();
    serde_json::json!({ "w": 64, "h": 48, "fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "frames": frames })
        .to_string()
}
