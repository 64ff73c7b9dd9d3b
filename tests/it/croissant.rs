//! `croissant.json` agrees with `release.yaml` and the files, and its reference reader accepts all
//! of it.

use crate::support::absent::absent;
use crate::support::foreign::python;
use crate::support::workspace::{TINY, Workspace, tiny_with};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use std::fs;
use std::path::Path;

const RELEASE: &str = "\
name: Example Events
version: 1.2.0
url: https://example.org/data
creator: Example Lab
date_published: \"2025-05-21\"
cite_as: \"@misc{example, title={Example}}\"
description: Two scenes of a test.
";

/// A release of two scenes under different licences, one of them with two sensors, the other
/// without events.
fn released() -> Workspace {
    let place = Workspace::new();
    place.write("recipes/release.yaml", RELEASE);
    let sensors = "sensors: { fine: { esim: {} }, usual: { voltmeter: {} } }\n";
    let owned = "licence: { expression: MIT OR Apache-2.0, holder: Example Lab }\n";
    let several = tiny_with(sensors) + owned;
    place.write("recipes/several.yaml", several.replace("scene: tiny", "scene: a/tiny"));
    place.write("recipes/none.yaml", TINY.replace("outputs: [events, sharp]", "outputs: [sharp]"));
    place.ok("release --to out recipes");
    place
}

fn described(release: &Path) -> Value {
    serde_json::from_slice(&fs::read(release.join("croissant.json")).unwrap()).unwrap()
}

#[test]
fn the_description_agrees_with_the_release() {
    let place = released();
    let out = place.path("out");
    let file = described(&out);
    let found = [
        ("name", "Example Events"),
        ("version", "1.2.0"),
        ("url", "https://example.org/data"),
        ("datePublished", "2025-05-21"),
        ("citeAs", "@misc{example, title={Example}}"),
        ("description", "Two scenes of a test."),
        ("conformsTo", "http://mlcommons.org/croissant/1.1"),
        ("license", "(Apache-2.0 OR MIT) AND CC0-1.0"),
    ];
    found.iter().for_each(|(name, wanted)| assert_eq!(file[name], *wanted));
    assert_eq!(file["creator"]["name"], "Example Lab");
    assert_eq!(file["prov:wasDerivedFrom"], json!([{ "@type": "Dataset", "name": "procedural" }]));
    let nodes = file["distribution"].as_array().unwrap();
    let index = fs::read(out.join("index.parquet")).unwrap();
    let sum: String = Sha256::digest(&index).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(nodes[0]["sha256"], sum);
    assert_eq!(nodes[0]["contentSize"], format!("{} B", index.len()));
    let sets: Vec<&str> = nodes[2..].iter().map(|node| node["includes"].as_str().unwrap()).collect();
    let wanted = [
        "events/*.h5",
        "sharp/*.png",
        "poses.txt",
        "transforms.json",
        "speed.json",
        "checks.json",
        "checks/*.png",
        "scene.json",
    ];
    assert_eq!(sets, wanted.map(|name| format!("**/{name}")));
}

#[test]
fn one_listed_licence_is_given_by_its_address() {
    let file = described(crate::release::small::release());
    assert_eq!(file["license"], "https://spdx.org/licenses/CC0-1.0.html");
    assert_eq!(file["name"], "gs2e release");
}

/// Reads the release with an independent reader. If Python lacks it, a message goes to stderr; with
/// `REQUIRE_CROISSANT=1` that is a failure.
#[test]
fn the_reference_reader_loads_every_record() {
    if !python(&["-c", "import mlcroissant, pyarrow.parquet"]).is_some_and(|output| output.status.success()) {
        return absent("REQUIRE_CROISSANT", "python3 with mlcroissant and pyarrow is absent");
    }
    let place = released();
    for folder in [place.path("out"), crate::release::small::release().to_owned()] {
        let output =
            python(&["-c", include_str!("croissant/read_back.py"), folder.to_str().unwrap()]).unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}
