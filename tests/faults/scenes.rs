//! Scenes that cost a millisecond per step: a recipe over a tiny capture and forty Gaussians in
//! files.

use crate::place::Place;
use serde_json::{Value, json};
use std::io::Write;

/// Outputs of the scenes that render. One pass of the renderer can make both.
pub(crate) const EVENT_OUTPUTS: [&str; 2] = ["events", "sharp"];

/// The recipe of a scene over the files `sources/<number>.{json,ply}`: six steps, or more with
/// outputs.
pub(crate) fn recipe(scene: &str, number: u32, outputs: &[&str]) -> Value {
    json!({
        "version": 1,
        "scene": scene,
        "seed": number,
        "source": { "nerfstudio": { "path": format!("../sources/{number}.json") } },
        "reconstruct": { "given": { "path": format!("../sources/{number}.ply") } },
        "camera": { "width": 16, "height": 12 },
        "trajectories": [{ "name": "base", "refine": { "factor": 2 } }],
        "outputs": outputs,
        "licence": { "expression": "CC0-1.0", "holder": "Nobody" }
    })
}

/// Writes the files of a number. No two numbers share a step.
pub(crate) fn sources(place: &Place, number: u32) {
    place.write(&format!("sources/{number}.json"), transforms(number).to_string());
    place.write(&format!("sources/{number}.ply"), ply(number));
}

/// Writes scenes `s0`, `s1`, … of six steps each. Every `with_events`-th scene has two more.
pub(crate) fn write(place: &Place, scenes: u32, with_events: u32) {
    for number in 0..scenes {
        sources(place, number);
        let outputs: &[&str] = if number % with_events == with_events - 1 { &EVENT_OUTPUTS } else { &[] };
        let recipe = recipe(&format!("s{number}"), number, outputs);
        place.write(&format!("recipes/{number}.yaml"), recipe.to_string());
    }
}

/// Six views of the origin on a short arc, camera to world in OpenGL axes.
fn transforms(number: u32) -> Value {
    let frame = |i: u32| {
        let (sin, cos) = (0.002 * f64::from(i)).sin_cos();
        let away = 4.0 + 0.001 * f64::from(number);
        let rows = [
            [cos, 0.0, sin, away * sin],
            [0.0, 1.0, 0.0, 0.0],
            [-sin, 0.0, cos, away * cos],
            [0.0, 0.0, 0.0, 1.0],
        ];
        json!({ "file_path": format!("{i}.png"), "transform_matrix": rows })
    };
    let frames: Vec<Value> = (0..6).map(frame).collect();
    json!({ "w": 16, "h": 12, "fl_x": 15, "fl_y": 15, "cx": 8, "cy": 6, "frames": frames })
}

/// A row of forty Gaussians along x.
fn ply(number: u32) -> Vec<u8> {
    const PROPERTIES: [&str; 14] = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
        "rot_1", "rot_2", "rot_3",
    ];
    let mut file = b"ply\nformat binary_little_endian 1.0\nelement vertex 40\n".to_vec();
    for name in PROPERTIES {
        writeln!(file, "property float {name}").unwrap();
    }
    file.extend(b"end_header\n");
    for i in 0..40u8 {
        let (x, shade) = ((f32::from(i) - 20.0) / 10.0, f32::from(i % 5) - 2.0);
        let own = f32::from(u16::try_from(number).unwrap()) / 64.0;
        let row = [x, 0.1 * shade, own, shade, -shade, 0.5, 2.0, -2.5, -2.0, -2.5, 1.0, 0.0, 0.0, 0.0];
        file.extend(row.iter().flat_map(|value: &f32| value.to_le_bytes()));
    }
    file
}
