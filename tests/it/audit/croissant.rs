//! Each fault of `croissant.json` or `index.parquet` is found under the right name. Except for the
//! first two, the reference reader of Croissant accepts each case, or finds it only when records
//! are loaded.

use super::{INDEX, check_resealed, found};
use crate::release::small::{copy, edit, release, reseal};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const NAME: &str = "croissant.json";

/// Checks that a change of `croissant.json` is found as exactly these faults.
fn t(change: impl FnOnce(&mut Value), wanted: &[&str]) {
    let wanted: Vec<String> = wanted.iter().map(|code| format!("{code} {NAME}")).collect();
    let wanted: Vec<&str> = wanted.iter().map(String::as_str).collect();
    check_resealed(|f| edit(f, NAME, change), &wanted);
}

fn remove(file: &mut Value, name: &str) {
    file.as_object_mut().unwrap().remove(name).unwrap();
}

/// The node of the distribution with this id.
fn node<'v>(file: &'v mut Value, id: &str) -> &'v mut Value {
    file["distribution"].as_array_mut().unwrap().iter_mut().find(|node| node["@id"] == id).unwrap()
}

/// The field of this id.
fn field<'v>(file: &'v mut Value, id: &str) -> &'v mut Value {
    let sets = file["recordSet"].as_array_mut().unwrap().iter_mut();
    let mut fields = sets.flat_map(|set| set["field"].as_array_mut().unwrap());
    fields.find(|field| field["@id"] == id).unwrap()
}

#[test]
fn a_missing_required_field_is_found() {
    t(|v| remove(v, "conformsTo"), &["croissant-field"]);
    t(|v| remove(node(v, "index.parquet"), "sha256"), &["croissant-field"]);
    for name in [
        "@context",
        "license",
        "version",
        "citeAs",
        "datePublished",
        "name",
        "url",
        "creator",
        "description",
        "rai:dataLimitations",
        "rai:dataBiases",
        "rai:personalSensitiveInformation",
        "rai:dataUseCases",
        "rai:dataSocialImpact",
        "rai:hasSyntheticData",
        "prov:wasDerivedFrom",
        "prov:wasGeneratedBy",
        "recordSet",
    ] {
        t(|v| remove(v, name), &["croissant-field"]);
    }
    t(|v| v["description"] = " ".into(), &["croissant-field"]);
    t(|v| v["rai:hasSyntheticData"] = false.into(), &["croissant-field"]);
    t(|v| v["conformsTo"] = "http://mlcommons.org/croissant/1.0".into(), &["croissant-field"]);
}

#[test]
fn a_field_of_no_vocabulary_is_found() {
    t(|v| v["rai:dataMood"] = "sunny".into(), &["croissant-unknown"]);
}

#[test]
fn terms_and_names_of_another_release_are_found() {
    t(|v| v["license"] = "free as in beer".into(), &["croissant-licence"]);
    t(|v| v["license"] = "https://spdx.org/licenses/MIT.html".into(), &["croissant-licence"]);
    t(|v| v["version"] = "9.9.9".into(), &["claims-disagree"]);
    t(|v| v["name"] = "another".into(), &["claims-disagree"]);
}

#[test]
fn a_wrong_or_absent_file_is_found() {
    t(|v| node(v, "index.parquet")["sha256"] = "0".repeat(64).into(), &["croissant-sum"]);
    t(|v| node(v, "index.parquet")["contentSize"] = "1 B".into(), &["croissant-sum"]);
    t(|v| node(v, "index.parquet")["contentUrl"] = "index.csv".into(), &["croissant-sum"]);
}

#[test]
fn a_set_without_files_or_a_container_is_found() {
    t(|v| node(v, "pose-files")["includes"] = "**/poses.csv".into(), &["croissant-files"]);
    t(|v| node(v, "pose-files")["includes"] = json!(["**/poses.txt", "**/poses.csv"]), &["croissant-files"]);
    t(|v| remove(node(v, "pose-files"), "includes"), &["croissant-files"]);
    t(|v| node(v, "pose-files")["containedIn"] = json!({ "@id": "attic" }), &["croissant-reference"]);
}

#[test]
fn an_id_that_names_nothing_or_two_things_is_found() {
    t(|v| node(v, "pose-files")["@id"] = "event-files".into(), &["croissant-reference"]);
    t(|v| field(v, "index/events")["source"]["fileObject"]["@id"] = "attic".into(), &["croissant-reference"]);
    t(|v| v["recordSet"][0]["key"] = json!({ "@id": "index/number" }), &["croissant-reference"]);
}

#[test]
fn a_missing_column_or_path_or_a_wrong_type_is_found() {
    let column =
        |v: &mut Value, name: &str| field(v, "index/events")["source"]["extract"]["column"] = name.into();
    t(|v| column(v, "spikes"), &["croissant-column"]);
    t(|v| column(v, "rate"), &["croissant-column"]);
    t(|v| field(v, "index/events")["dataType"] = "sc:Text".into(), &["croissant-column"]);
    t(
        |v| field(v, "scenes/width")["source"]["extract"]["jsonPath"] = "$.camera.girth".into(),
        &["croissant-column"],
    );
    t(|v| field(v, "scenes/width")["dataType"] = "sc:Boolean".into(), &["croissant-column"]);
}

#[test]
fn a_release_without_croissant_json_is_faulty() {
    check_resealed(|f| fs::remove_file(f.join(NAME)).unwrap(), &[&format!("missing {NAME}")]);
    check_resealed(|f| fs::write(f.join(NAME), "{").unwrap(), &[&format!("unreadable {NAME}")]);
}

/// Updates the sum of the index in `croissant.json`, so that only the rows are at fault.
fn admit(folder: &Path) {
    reseal(folder);
    let sums = fs::read_to_string(folder.join("SHA256SUMS")).unwrap();
    let sum = sums.lines().find(|line| line.ends_with("  index.parquet")).unwrap()[..64].to_owned();
    let size = fs::metadata(folder.join("index.parquet")).unwrap().len();
    edit(folder, NAME, |v| {
        node(v, "index.parquet")["sha256"] = sum.into();
        node(v, "index.parquet")["contentSize"] = format!("{size} B").into();
    });
}

#[test]
fn an_index_that_contradicts_the_files_is_found() {
    const SCENE: &str = "small/one/scene.json";
    const COMPOSED: &str = "not-composed small/one/scene.json";
    // `croissant.json` has the sum of an index that does not follow from the scenes.
    const CATALOGUE: &str = "not-composed croissant.json";
    check_resealed(
        |f| edit(f, SCENE, |v| v["trajectories"][0]["statistics"]["rate_ev_px_s"] = 1.0.into()),
        &[INDEX, COMPOSED],
    );
    check_resealed(
        |f| edit(f, SCENE, |v| v["trajectories"][1]["sensor"]["c_on"] = 0.5.into()),
        &[INDEX, COMPOSED],
    );
    check_resealed(
        |f| edit(f, SCENE, |v| v["source"]["upstream_id"] = "1a2b".into()),
        &[INDEX, INDEX, COMPOSED],
    );
    check_resealed(
        |f| edit(f, "small/one/base/speed.json", |v| v["linear_unit_s"] = json!([1.0])),
        &[INDEX, "not-composed small/one/base/speed.json", COMPOSED, COMPOSED, COMPOSED],
    );
    check_resealed(
        |f| {
            fs::write(f.join("index.parquet"), "no table").unwrap();
            admit(f);
        },
        &[CATALOGUE, "unreadable index.parquet"],
    );
    // The index of another release, which is sound in itself.
    let folder = copy();
    let place = crate::support::workspace::Workspace::with_tiny();
    place.ok("release --to out tiny.yaml");
    fs::copy(place.path("out/index.parquet"), folder.path().join("index.parquet")).unwrap();
    admit(folder.path());
    reseal(folder.path());
    assert_eq!(found(folder.path()), [INDEX, CATALOGUE]);
    assert_eq!(found(release()), [""; 0]);
}
