//! Trajectories or the sensor alone, read from a recipe or from a partial file. Single steps use
//! them.

mod chain;
mod sensor;

pub use chain::{ChainError, TrajectoryChain};
pub use sensor::{draw_sensor, read_sensor, sensor_from_text};

use super::fault::{RecipeFault, RecipeFaults};
use super::find::find_all;
use super::load::{DefaultsLibrary, RecipeParts};
use super::{TrajectoryRecipe, keys};
use gs2e_num::units::Hertz;
use gs2e_render::RenderChoice;
use gs2e_scene::camera::CameraChoice;
use gs2e_trajectory::sample::SummationRule;
use std::path::{Path, PathBuf};

/// The trajectories of a file, with the other settings that affect them.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryFragment {
    /// The camera, if it differs from the camera of the capture.
    pub camera: Option<CameraChoice>,
    /// The trajectories, in file order and with unique names.
    pub trajectories: Vec<TrajectoryRecipe>,
    /// Frame rate.
    pub rate: Hertz,
    /// Summation of the speed laws.
    pub law: SummationRule,
    /// Rendering.
    pub render: RenderChoice,
}

/// Keys of a recipe that affect trajectories. The others are ignored, present or not.
const OF_TRAJECTORIES: [&str; 9] =
    ["version", "scene", "preset", "seed", "group", "camera", "trajectories", "sampling", "render"];

/// Replacement for the other keys. A file without a scene id draws its key poses as a scene with this
/// name does.
const STAND_IN: &str = "scene: trajectories\nsource: { procedural: {} }\n";

/// Reads the trajectories of the one recipe at `path`, merged over its defaults. Source, sensor,
/// products and licence are ignored, so a file with trajectories alone is enough.
///
/// # Errors
/// The fragment has faults, or the path leads to no recipe or to several.
pub fn read_fragment(path: &Path) -> Result<TrajectoryFragment, RecipeFaults> {
    let files = find_all(&[PathBuf::from(path)])?;
    let [file] = &files[..] else {
        let message = format!("this folder has {} recipes, wanted one", files.len());
        let fault = RecipeFault::of_file(path, &message, Some("name one recipe file"));
        return Err(RecipeFaults::new(vec![fault]));
    };
    let read = || trajectories_of(DefaultsLibrary::read_defaults(&files).parts(file)?);
    read().map_err(RecipeFaults::new)
}

/// Reads trajectories from a text with the same content as a file of [`read_fragment`]. Faults name
/// the text as `display_path`.
///
/// # Errors
/// The fragment has faults.
pub fn fragment_from_text(text: String, display_path: &Path) -> Result<TrajectoryFragment, RecipeFaults> {
    let read = || trajectories_of(RecipeParts::of_text(display_path, text)?.with_presets());
    read().map_err(RecipeFaults::new)
}

/// The keys of a recipe without these.
fn all_but(kept: &[&str]) -> Vec<&'static str> {
    keys::recipe_keys().iter().copied().filter(|key| !kept.contains(key)).collect()
}

fn trajectories_of(parts: RecipeParts) -> Result<TrajectoryFragment, Vec<RecipeFault>> {
    let resolved = parts.standing_in(&all_but(&OF_TRAJECTORIES), STAND_IN).resolved()?;
    Ok(TrajectoryFragment {
        camera: resolved.camera,
        // Steps by themselves have no rig, which is not among the keys.
        trajectories: resolved.trajectories,
        rate: resolved.rate,
        law: resolved.law,
        render: resolved.render,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read_all;
    use gs2e_sensor::SensorChoice;

    /// Reads a fragment from a file with this text.
    fn fragment(text: &str) -> Result<TrajectoryFragment, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.yaml");
        std::fs::write(&path, text).unwrap();
        read_fragment(&path).map_err(|faults| faults.to_string().replace(path.to_str().unwrap(), "a.yaml"))
    }

    const TRAJECTORIES: &str = "version: 1\ntrajectories:\n  - { name: base, refine: { window: 3 } }\n";
    const CAMERA: &str = "camera: { width: 64, height: 48 }\nsampling: { rate: 1200 }\n";

    #[test]
    fn a_recipe_and_a_file_of_its_trajectories_are_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("whole.yaml");
        let rest =
            "scene: a/b\nsource: { colmap: { path: gone } }\nreconstruct: { given: { path: gone.ply } }\n";
        std::fs::write(&path, format!("{TRAJECTORIES}{CAMERA}{rest}")).unwrap();
        let recipe = read_all(&[path]).unwrap().remove(0);
        let found = fragment(&format!("{TRAJECTORIES}{CAMERA}")).unwrap();
        assert_eq!(found.trajectories, recipe.trajectories);
        assert_eq!((found.camera, found.rate, found.render), (recipe.camera, recipe.rate, recipe.render));
    }

    #[test]
    fn what_bears_on_no_trajectory_is_not_looked_at() {
        let rest = "source: 5\nsensor: { esim: {} }\noutputs: [gone]\nlicence: none\nsensors: ~\n";
        assert_eq!(fragment(&format!("{TRAJECTORIES}{rest}")), fragment(TRAJECTORIES));
    }

    #[test]
    fn faults_are_told_where_they_stand() {
        let t = |text: &str, wanted: &str| {
            let message = fragment(text).unwrap_err();
            assert!(message.contains(wanted), "{message}");
        };
        t("", "a.yaml: the file is empty");
        t(&TRAJECTORIES.replace("window", "windw"), "a.yaml:3:29: unknown field \"windw\"");
        t(&format!("{TRAJECTORIES}colour: red\n"), "a.yaml:4:1: unknown field \"colour\"");
        t(&TRAJECTORIES.replace("version: 1", "version: 2"), "a.yaml:1:10: \"version\" is 2");
        t("version: 1\n", "missing field \"trajectories\"");
        t("trajectories: [{ name: base, refine: {} }]\n", "missing field \"version\"");
    }

    #[test]
    fn a_text_is_read_like_a_file() {
        let read = |text: &str| {
            let read = fragment_from_text(text.to_owned(), Path::new("a.yaml"));
            read.map_err(|faults| faults.to_string())
        };
        let paper = format!("preset: paper\n{TRAJECTORIES}");
        for text in [TRAJECTORIES, &paper, &TRAJECTORIES.replace("window", "windw"), "version: 1\n"] {
            assert_eq!(read(text), fragment(text), "{text}");
        }
        let json = r#"{"version": 1, "trajectories": [{"name": "base", "refine": {"window": 3}}]}"#;
        assert_eq!(read(json), fragment(TRAJECTORIES), "JSON is YAML");
    }

    #[test]
    fn one_recipe_is_read() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a.yaml", "b.yaml"] {
            std::fs::write(dir.path().join(name), TRAJECTORIES).unwrap();
        }
        let message = read_fragment(dir.path()).unwrap_err().to_string();
        assert!(message.ends_with(": this folder has 2 recipes, wanted one"), "{message}");
        std::fs::remove_file(dir.path().join("b.yaml")).unwrap();
        assert!(read_fragment(dir.path()).is_ok());
    }

    /// Reads the sensor of a file with this text.
    fn sensor(text: &str) -> Result<SensorChoice, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.yaml");
        std::fs::write(&path, text).unwrap();
        read_sensor(&path, None)
            .map_err(|faults| faults.to_string().replace(path.to_str().unwrap(), "s.yaml"))
    }

    #[test]
    fn a_sensor_is_read_alone_or_out_of_a_recipe() {
        let alone = "voltmeter: { preset: dvs240, threshold: { on: 0.5 } }\n";
        let Ok(SensorChoice::Voltmeter(found)) = sensor(alone) else { panic!("it is one") };
        assert_eq!((found.k, found.threshold_on), (gs2e_sensor::voltmeter::VoltmeterPreset::Dvs240.k(), 0.5));
        let whole = format!("scene: 5\ntrajectories: gone\nsensor: {{ {} }}\n", alone.trim());
        assert_eq!(sensor(&whole), sensor(alone));
    }

    #[test]
    fn faults_of_a_sensor_are_told_where_they_stand() {
        let t = |text: &str, wanted: &str| {
            let message = sensor(text).unwrap_err();
            assert!(message.contains(wanted), "{message}");
        };
        t("voltmeter: { presett: dvs346 }\n", "s.yaml:1:14: unknown field \"presett\"");
        t("voltmeter: { preset: dvs347 }\n", "s.yaml:1:22: unknown preset \"dvs347\"");
        t("voltmeter:\n  k: [1, 1, 0, 0, 0, 0]\n", "s.yaml:2:3: missing field \"sensor.voltmeter.units\"");
        t("voltmetr: {}\n", "s.yaml:1:1");
        t("sensor: { voltmeter: {} }\ncolour: red\n", "s.yaml:2:1: unknown field \"colour\"");
        t("sensors: { a: { esim: {} }, b: { v2e: {} } }\n", "s.yaml: it has several sensors: a, b");
    }

    #[test]
    fn one_of_several_sensors_is_named() {
        let display_path = Path::new("dict");
        let read = |text: &str, name| {
            sensor_from_text(text.to_owned(), display_path, name).map_err(|f| f.to_string())
        };
        let several = "version: 1\nscene: 5\nsensors:\n  a: { esim: {} }\n  b: { v2e: { preset: noisy } }\n";
        assert_eq!(read(several, Some("b")), read("v2e: { preset: noisy }", None));
        assert_eq!(read(several, Some("a")), read("{\"esim\": {}}", None), "JSON is YAML");
        assert_eq!(read(several, Some("c")).unwrap_err(), "dict: it has no sensor c");
        let message = read("esim: {}", Some("a")).unwrap_err();
        assert_eq!(message, "dict: it has one sensor without a name, asked for is a");
        assert_eq!(read("esim: {\n", None).unwrap_err().split(':').next(), Some("dict"));
    }
}
