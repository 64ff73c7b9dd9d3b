//! The bytes that recipes make. Their meaning is tested in `crates/recipe/tests/recipes`.

use crate::support::workspace::Workspace;

/// The paper's settings, written out.
const PAPERS: &str = r#"
version: 1
scene: procedural/still-life
seed: 20250521
source:
  procedural: { kind: still-life, gaussians: 300, views: 6, arc: 6, seed: 1 }
trajectories:
  - name: base
    refine: { window: 2, factor: 5 }
    speed: { function: "0.25*sin(t) + 1.1" }
sampling: { rate: 2400, between: linear }
render: { rules: official, antialiased: auto, background: [0, 0, 0] }
sensor:
  voltmeter: { preset: dvs346-paper, threshold: { on: 1.0, off: 1.0 } }
outputs: [events, sharp]
"#;

/// With the preset in the place of the paper's settings, every step is up to date: its keys, and so its
/// bytes, are the same.
#[test]
fn the_papers_preset_has_the_bytes_of_its_settings() {
    let demo = PAPERS;
    let place = Workspace::new();
    place.write("r/demo.yaml", format!("{demo}camera: {{ width: 64, height: 48 }}\n"));
    assert!(place.build("r/demo.yaml").len() >= 6);
    let is_set = |line: &&str| {
        ["speed:", "sampling:", "render:", "sensor:", "voltmeter:", "outputs:"]
            .iter()
            .any(|key| line.trim_start().starts_with(key))
    };
    let preset: Vec<&str> = demo.lines().filter(|line| !is_set(line)).collect();
    let preset = preset.join("\n").replace("refine: { window: 2, factor: 5 }", "refine: {}");
    assert!(!preset.contains("dvs346 ") && !preset.contains("0.25*sin"), "{preset}");
    place.write("r/demo.yaml", format!("{preset}\ncamera: {{ width: 64, height: 48 }}\npreset: paper\n"));
    assert_eq!(place.build("r/demo.yaml"), [""; 0]);
}
