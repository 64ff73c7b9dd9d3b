//! Names that become folders and files: scene ids, trajectory names, sensors.

use super::OutputKind;

/// Help text for scene ids.
pub(super) const SCENE_HELP: &str =
    "a scene id is made of letters, digits, \".\", \"_\" and \"-\", in parts separated by \"/\"";

/// Help text for trajectory names.
pub(super) const TRAJECTORY_HELP: &str =
    "a trajectory name is made of letters, digits, \".\", \"_\" and \"-\"";

/// Help text for names of several sensors.
pub(super) const SENSOR_HELP: &str = "a sensor's name is made of letters, digits, \".\", \"_\" and \"-\"";

/// Help text for names of the cameras of a rig.
pub(super) const CAMERA_HELP: &str = "a camera's name is made of letters, digits, \".\", \"_\" and \"-\"";

/// Help text for names of objects.
pub(super) const OBJECT_HELP: &str = "an object's name is made of letters, digits, \".\", \"_\" and \"-\"";

/// Names reserved at the top of a release.
const TAKEN_AT_TOP: [&str; 13] = [
    "b3sums",
    "croissant.json",
    "datasheet.md",
    "gs2e.py",
    "index.parquet",
    "licenses",
    "manifest.json",
    "readme.md",
    "report.html",
    "reuse.toml",
    "sha256sums",
    "sha256sums.minisig",
    "takedown.txt",
];

/// Names reserved in a scene's folder.
const TAKEN_IN_SCENE: [&str; 2] = ["scene.json", "checks.json"];

/// Names reserved in a trajectory's folder, apart from those of the outputs.
const TAKEN_IN_TRAJECTORY: [&str; 10] = [
    "calibration",
    "checks",
    "checks.json",
    "events.h5",
    "exports",
    "poses.txt",
    "speed.json",
    "timestamps_us.txt",
    "trajectory.png",
    "trajectory.svg",
];

/// Device names that Windows reserves in every folder.
const RESERVED: [&str; 4] = ["con", "prn", "aux", "nul"];

/// Checks that an id stays inside the release folder on every system. The error names the fault.
pub(super) fn scene_id(id: &str) -> Result<(), String> {
    id_parts(id)?;
    id.split('/').enumerate().try_for_each(|(depth, name)| {
        not_taken(name, if depth == 0 { &TAKEN_AT_TOP } else { &TAKEN_IN_SCENE })
    })
}

/// Checks the form of the id of a scene, here or upstream; the error follows "an id".
pub(super) fn id_parts(id: &str) -> Result<(), String> {
    if id.len() > 200 {
        return Err(format!("which has {} bytes, wanted at most 200", id.len()));
    }
    if id.starts_with('/') {
        return Err("which starts with \"/\"".into());
    }
    id.split('/').try_for_each(check_part)
}

/// Checks that a trajectory name is one folder inside its scene's folder. The error says what is
/// wrong.
pub(super) fn check_trajectory(name: &str) -> Result<(), String> {
    check_sensor(name)?;
    not_taken(name, &TAKEN_IN_SCENE)
}

/// Checks the name of a camera of a rig, which is a folder inside that of a trajectory. The error says what
/// is wrong.
pub(super) fn check_camera(name: &str) -> Result<(), String> {
    check_trajectory(name)?;
    let outputs = OutputKind::ALL.map(OutputKind::name);
    not_taken(name, &outputs).and_then(|()| not_taken(name, &TAKEN_IN_TRAJECTORY))
}

/// Checks the name of a sensor, which becomes a file name in the release.
pub(super) fn check_sensor(name: &str) -> Result<(), String> {
    if name.len() > 100 {
        return Err(format!("which has {} bytes, wanted at most 100", name.len()));
    }
    if name.contains('/') {
        return Err("which has more than one part".into());
    }
    check_part(name)
}

fn check_part(part: &str) -> Result<(), String> {
    if part.is_empty() {
        return Err("which has an empty part".into());
    }
    if part == "." || part == ".." {
        return Err(format!("whose part \"{part}\" leads out of its folder"));
    }
    if let Some(c) = part.chars().find(|c| !c.is_ascii_alphanumeric() && !"._-".contains(*c)) {
        return Err(format!("which holds {}", super::problem::quote_text(&c.to_string())));
    }
    if part.ends_with('.') {
        return Err("with a part that ends in \".\", which Windows removes".into());
    }
    if is_reserved(part) {
        return Err(format!("whose part \"{part}\" is a reserved device name on Windows"));
    }
    Ok(())
}

fn is_reserved(part: &str) -> bool {
    // Windows reserves `con.txt` as well as `con`.
    let stem = part.split('.').next().unwrap_or(part).to_ascii_lowercase();
    let numbered = stem.strip_prefix("com").or_else(|| stem.strip_prefix("lpt"));
    RESERVED.contains(&stem.as_str())
        || numbered.is_some_and(|n| n.len() == 1 && n.as_bytes()[0].is_ascii_digit())
}

fn not_taken(name: &str, taken: &[&str]) -> Result<(), String> {
    // Some file systems ignore case.
    if taken.contains(&name.to_ascii_lowercase().as_str()) {
        return Err(format!("and \"{name}\" is a file of the release"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_that_stay_in_the_release_are_taken() {
        for id in
            ["demo", "mvimgnet/11/16009258", "a.b/c_d-e", "dl3dv/0e12", "...x", "-", "COM", "com10", "conx"]
        {
            assert_eq!(scene_id(id), Ok(()), "{id}");
        }
    }

    #[test]
    fn ids_that_lead_out_or_clash_are_refused() {
        let t = |id: &str, wanted: &str| {
            let found = scene_id(id).unwrap_err();
            assert!(found.contains(wanted), "{id}: {found}");
        };
        t("", "empty part");
        t("/etc/passwd", "starts with \"/\"");
        t("../x", "\"..\" leads out");
        t("a/./b", "\".\" leads out");
        t("a//b", "empty part");
        t("a/", "empty part");
        t("a\\b", "holds");
        t("C:x", "holds \":\"");
        t("a b", "holds \" \"");
        t("é", "holds");
        t("a\u{202e}b", "holds");
        t("a.", "Windows removes");
        t("x/NUL.txt", "device");
        t("com1", "device");
        t("LICENSES/x", "file of the release");
        t("readme.md", "file of the release");
        t("a/scene.json/b", "file of the release");
        t(&"x".repeat(201), "201 bytes");
    }

    #[test]
    fn trajectory_names_are_one_part() {
        assert_eq!(check_trajectory("base-0"), Ok(()));
        for bad in ["", "a/b", "..", "scene.json", "Scene.JSON", "aux", "a*"] {
            assert!(check_trajectory(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn cameras_are_no_files_of_a_trajectory() {
        assert_eq!(check_camera("left"), Ok(()));
        for bad in ["", "a/b", "scene.json", "depth", "Events", "imu", "events.h5", "exports", "poses.txt"] {
            assert!(check_camera(bad).is_err(), "{bad}");
        }
    }
}
