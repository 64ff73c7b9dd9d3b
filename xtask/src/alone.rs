//! The crates for other programs, each taken by a package outside of the workspace: its example is built
//! with path dependencies alone, and run.

use crate::command::{Outcome, cargo, program, root, say};
use crate::folder::Folder;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// A crate, its example, the features that it needs, and the arguments of a run in the folder of
/// [`write_inputs`].
struct CrateExample {
    name: &'static str,
    example: &'static str,
    features: &'static str,
    arguments: [&'static str; 3],
    /// The file that the run makes.
    makes: &'static str,
}

const TAKEN: [CrateExample; 7] = [
    taken("num", "draws", ["7 3 4", "", "draws.txt"]),
    taken("image", "luminance", ["picture.png", "", "luminance.npy"]),
    taken("event", "evt3_to_h5", ["recording.raw", "", "recording.h5"]),
    taken("sensor", "frames_to_events", ["frames.npy", "1000", "small.release/lab/base/events.h5"]),
    taken("scene", "convert_scene", ["scene.ply", "", "scene.spz"]),
    taken("render", "splat_to_png", ["scene.ply", "", "view.png"]),
    // After the sensor, which makes the events.
    taken("tree", "events_to_png", ["small.release", "0 5000", "events.png"]),
];

const fn taken(name: &'static str, example: &'static str, arguments: [&'static str; 3]) -> CrateExample {
    CrateExample { name, example, features: "hdf5", arguments, makes: arguments[2] }
}

/// Builds and runs every example as a package of its own.
pub(crate) fn run() -> Outcome {
    let folder = Folder::new("alone")?;
    write_inputs(folder.path()).map_err(|e| format!("{}: {e}", folder.path().display()))?;
    for of in &TAKEN {
        let package = folder.path().join(of.name);
        write_package(of, &package).map_err(|e| format!("{}: {e}", package.display()))?;
        let manifest = package.join("Cargo.toml").to_string_lossy().into_owned();
        let target = root().join("target/alone").to_string_lossy().into_owned();
        cargo(&["build", "--quiet", "--manifest-path", &manifest, "--target-dir", &target]).run()?;
        let built = Path::new(&target).join("debug").join(format!("takes-{}", of.name));
        let arguments = of.arguments.iter().flat_map(|text| text.split_whitespace());
        let arguments: Vec<String> = arguments
            .map(|text| match text.contains('.') {
                true => folder.path().join(text).to_string_lossy().into_owned(),
                false => text.to_owned(),
            })
            .collect();
        program(built.as_os_str(), &arguments).run()?;
        let made = fs::metadata(folder.path().join(of.makes)).map_err(|e| format!("{}: {e}", of.makes))?;
        say(&format!("gs2e-{}: {} made {} of {} bytes", of.name, of.example, of.makes, made.len()));
    }
    Ok(())
}

/// Writes a package with the example as its program. Its dependencies are the crates that the example names.
fn write_package(of: &CrateExample, package: &Path) -> std::io::Result<()> {
    let text = fs::read_to_string(root().join(format!("crates/{}/examples/{}.rs", of.name, of.example)))?;
    let mut manifest = format!(
        "[package]\nname = \"takes-{}\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\n",
        of.name
    );
    for entry in fs::read_dir(root().join("crates"))? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if !text.contains(&format!("gs2e_{name}::")) {
            continue;
        }
        let features =
            if name == "event" { format!(", features = [\"{}\"]", of.features) } else { String::new() };
        let path = entry.path();
        writeln!(manifest, "gs2e-{name} = {{ path = {:?}{features} }}", path.display().to_string())
            .expect("a string can be written to");
    }
    fs::create_dir_all(package.join("src"))?;
    fs::write(package.join("Cargo.toml"), manifest)?;
    fs::copy(root().join("Cargo.lock"), package.join("Cargo.lock"))?;
    fs::write(package.join("src/main.rs"), text)
}

/// Writes a scene, a picture, frames in which a bright bar moves, a recording of a few events, and a release
/// that waits for the events of the frames.
fn write_inputs(folder: &Path) -> std::io::Result<()> {
    let golden = root().join("tests/golden/scenes");
    fs::copy(golden.join("packed-coloured.expected.ply"), folder.join("scene.ply"))?;
    fs::copy(root().join("docs/demo.png"), folder.join("picture.png"))?;
    let (frames, height, width) = (20_usize, 16, 24);
    let header =
        format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({frames}, {height}, {width}), }}");
    let header = format!("{header:<117}\n");
    let mut array = b"\x93NUMPY\x01\x00".to_vec();
    // The length of the header.
    array.extend(118_u16.to_le_bytes());
    array.extend(header.as_bytes());
    for frame in 0..frames {
        for pixel in 0..height * width {
            array.push(if pixel % width / 3 == frame / 2 { 220 } else { 40 });
        }
    }
    fs::write(folder.join("frames.npy"), array)?;
    let mut recording = b"% evt 3.0\n% format EVT3;height=16;width=24\n% geometry 24x16\n% end\n".to_vec();
    // Words of 16 bits: time high 0, time low, row, then one event of column and polarity.
    for word in (0_u16..8).flat_map(|i| [0x8000, 0x6000 | (100 * i), i, 0x2800 | i]) {
        recording.extend(word.to_le_bytes());
    }
    fs::write(folder.join("recording.raw"), recording)?;
    let release = folder.join("small.release");
    fs::create_dir_all(release.join("lab/base"))?;
    fs::write(release.join("manifest.json"), r#"{ "format": 1, "scenes": [{ "id": "lab" }] }"#)?;
    let camera = r#"{ "width": 24, "height": 16, "fx": 20, "fy": 20, "cx": 12, "cy": 8 }"#;
    let trajectories = r#"[{ "name": "base", "sensor": {} }]"#;
    let scene =
        format!(r#"{{ "id": "lab", "recipe": {{}}, "camera": {camera}, "trajectories": {trajectories} }}"#);
    fs::write(release.join("lab/scene.json"), scene)
}
