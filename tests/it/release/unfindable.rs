//! Changes that an audit cannot find from a tree, as `docs/publish.md` lists them: values that no
//! other file of the tree repeats, and data that only a rebuilt scene can confirm.

use serde_json::Value;

/// File name, and pointers below which any value is accepted; `*` matches any key.
pub(crate) const VALUES: [(&str, &[&str]); 3] = [
    (
        "scene.json",
        &[
            "/gs2e_version",
            "/images",
            "/camera",
            "/reconstruction/scene_sha256",
            "/reconstruction/dropped",
            "/reconstruction/antialiased",
            "/reconstruction/ssim",
            "/reconstruction/lpips",
            "/reconstruction/psnr",
            "/trajectories/*/sampling/tolerance",
            "/trajectories/*/render_rules/antialiased",
            "/trajectories/*/blur/subframes",
            "/trajectories/*/statistics/depth_unit",
        ],
    ),
    (
        "speed.json",
        &[
            "/curve",
            "/degree_drawn",
            "/degree_used",
            "/literal",
            "/alpha",
            "/beta",
            "/gamma",
            "/S",
            "/length_ratio",
            "/knot_distance",
            "/knot_jumps",
            "/flow",
            "/merged",
            "/gaps",
            "/mixed_ratio",
            "/mixed_chord_ratio",
            "/linear_ratio",
            "/angular_ratio",
            "/warnings",
        ],
    ),
    ("manifest.json", &["/scenes/*/steps", "/scenes/*/left_out", "/tool"]),
];

/// Data files that the audit reads for their form and their counts; no other file repeats their
/// values.
pub(crate) const DATA: [&str; 7] = [
    "events.h5",
    "sharp/*.png",
    "blur/*.png",
    "depth/*.npy",
    "flow/*.npy",
    "disparity/*.npy",
    "segmentation/*.png",
];

/// Returns true if a file of this path is one of [`DATA`].
pub(crate) fn is_data(path: &str) -> bool {
    let in_folder = |folder: &str, end: &str| path.ends_with(end) && path.rsplit('/').nth(1) == Some(folder);
    path.ends_with("/events.h5")
        || in_folder("events", ".h5")
        || DATA[1..].iter().any(|glob| {
            let (folder, end) = glob.split_once("/*").expect("a folder and an end");
            in_folder(folder, end)
        })
}

/// Returns true if two versions of a JSON file differ only in values that no other file repeats.
pub(crate) fn is_unfindable(path: &str, old: &[u8], new: &[u8]) -> bool {
    let name = path.rsplit('/').next().unwrap_or(path);
    let Some((_, pointers)) = VALUES.iter().find(|(file, _)| *file == name) else { return false };
    let [Ok(old), Ok(new)] = [old, new].map(serde_json::from_slice::<Value>) else { return false };
    let mut places = Vec::new();
    differ("", &old, &new, &mut places);
    places.iter().all(|place| pointers.iter().any(|pointer| is_below(place, pointer)))
}

fn differ(place: &str, old: &Value, new: &Value, out: &mut Vec<String>) {
    match (old, new) {
        (old, new) if old == new => {}
        (Value::Object(a), Value::Object(b)) => {
            let null = Value::Null;
            let keys: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for key in keys {
                differ(
                    &format!("{place}/{key}"),
                    a.get(key).unwrap_or(&null),
                    b.get(key).unwrap_or(&null),
                    out,
                );
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                differ(&format!("{place}/{i}"), a, b, out);
            }
        }
        _ => out.push(place.to_owned()),
    }
}

fn is_below(place: &str, pointer: &str) -> bool {
    let (mut place, mut pointer) = (place.split('/'), pointer.split('/'));
    pointer.all(|wanted| place.next().is_some_and(|found| wanted == "*" || wanted == found))
}
