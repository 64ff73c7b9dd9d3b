//! `croissant.json`: the release as catalogues and search engines read it.
//!
//! The format is Croissant 1.1 (MLCommons), with context and terms as its reader `mlcroissant`
//! expects them, and with the fields of its vocabulary for responsible AI that dataset submissions
//! must have. Everything that can be computed is computed. The rest comes from `release.yaml`, or
//! is true of every release.

mod glob;
mod records;

pub use glob::glob_matches;
pub use records::{SPLITS, data_type};

use super::products::{self, FileSet, products};
use super::provenance::Provenance;
use super::scene::SceneRecord;
use super::{checksum, index};
use gs2e_recipe::{ReleaseInfo, SplitPlan};
use gs2e_source::kind::SourceKind;
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;

/// Name of the file.
pub const NAME: &str = "croissant.json";

/// The version of Croissant.
pub const CONFORMS_TO: &str = "http://mlcommons.org/croissant/1.1";

/// Required fields, each with a value: those of Croissant, and those that dataset submissions must
/// have.
pub const REQUIRED: [&str; 18] = [
    "@context",
    "name",
    "description",
    "version",
    "url",
    "license",
    "creator",
    "datePublished",
    "citeAs",
    "rai:dataLimitations",
    "rai:dataBiases",
    "rai:personalSensitiveInformation",
    "rai:dataUseCases",
    "rai:dataSocialImpact",
    "prov:wasDerivedFrom",
    "prov:wasGeneratedBy",
    "distribution",
    "recordSet",
];

/// The fields for responsible AI that are written. Others are not part of this format.
pub const RESPONSIBLE: [&str; 7] = [
    "rai:dataCollection",
    "rai:dataLimitations",
    "rai:dataBiases",
    "rai:personalSensitiveInformation",
    "rai:dataUseCases",
    "rai:dataSocialImpact",
    SYNTHETIC,
];

/// Name of the field that marks synthetic data. Releases always contain synthetic data.
pub const SYNTHETIC: &str = "rai:hasSyntheticData";

/// Id of the release folder.
pub const ROOT: &str = "root";

/// Replacement for a checksum of the release folder. `mlcroissant` reads a local folder like a
/// repository, marked by a media type of its own and this address.
const ROOT_SUM: &str = "https://github.com/mlcommons/croissant/issues/80";

/// Input of the file.
#[derive(Debug)]
pub(super) struct DescribedRelease<'a> {
    pub(super) info: &'a ReleaseInfo,
    /// SPDX expression of the whole release.
    pub(super) licence: &'a str,
    pub(super) scenes: &'a [&'a SceneRecord],
    /// Paths of the files of all scenes but for exports.
    pub(super) paths: Vec<String>,
    /// The bytes of the index.
    pub(super) index: &'a [u8],
}

/// Composes the file.
pub(super) fn compose_croissant(of: &DescribedRelease<'_>) -> Value {
    let info = of.info;
    let mut file = json!({
        "@context": json_context(), "@type": "sc:Dataset", "conformsTo": CONFORMS_TO,
        "name": info.name, "description": info.description, "version": info.version, "url": info.url,
        "license": licence_address(of.licence), "creator": { "@type": "Organization", "name": info.creator },
        "datePublished": info.date_published, "citeAs": info.cite_as, "isLiveDataset": false,
        "prov:wasDerivedFrom": source_entries(of.scenes),
        "prov:wasGeneratedBy": [{ "@type": "prov:Activity", "name": super::TOOL, "description": Provenance::of(of.scenes.iter().copied()).collection() }],
        "distribution": distribution_entries(of),
        "recordSet": record_sets(info.splits.as_ref()),
    });
    for (name, text) in RESPONSIBLE.into_iter().zip(responsible_texts(of.scenes)) {
        file[name] = text;
    }
    file
}

fn record_sets(splits: Option<&SplitPlan>) -> Vec<Value> {
    let sets = [records::index_records(splits), records::scene_records(products::SCENE_FILES)];
    sets.into_iter().chain(splits.map(records::split_records)).collect()
}

/// Address of a licence in the SPDX list, as Croissant recommends. Other expressions are returned
/// unchanged.
pub fn licence_address(expression: &str) -> String {
    if gs2e_source::licence::is_listed(expression) {
        format!("https://spdx.org/licenses/{expression}.html")
    } else {
        expression.to_owned()
    }
}

const IMPACT: &str = "No impact is known beyond that of the sources and of methods trained on the data. Licences of the sources \
    bind receivers: see licence and gated in index.parquet.";

/// The texts of [`RESPONSIBLE`], in the same order.
fn responsible_texts(scenes: &[&SceneRecord]) -> [Value; RESPONSIBLE.len()] {
    let made_up =
        |scene: &&SceneRecord| SourceKind::by_name(&scene.source.kind).is_some_and(SourceKind::is_made_up);
    let provenance = Provenance::of(scenes.iter().copied());
    let personal = personal_words(scenes.iter().all(made_up));
    [
        // In the order of `RESPONSIBLE`, because the texts are joined with the names by place.
        provenance.collection().into(),
        provenance.limits().into(),
        provenance.biases().into(),
        personal.into(),
        provenance.uses().into(),
        IMPACT.into(),
        true.into(),
    ]
}

/// Statement on persons in the scenes, which are all procedural or not.
pub(super) fn personal_words(made_up: bool) -> &'static str {
    if made_up {
        "No persons: the scenes are procedural."
    } else {
        "Not examined: renderings of captured scenes may show the content of their photos, including faces and text."
    }
}

/// The sources of the scenes: each upstream dataset, or else each kind of source, once.
fn source_entries(scenes: &[&SceneRecord]) -> Vec<Value> {
    // Scenes of one source give one entry, and the order does not depend on that of the scenes.
    let named: BTreeSet<(&str, Option<&str>, Option<&str>)> = scenes
        .iter()
        .map(|scene| &scene.source)
        .map(|source| (source.kind.as_str(), source.upstream_id.as_deref(), source.upstream_url.as_deref()))
        .collect();
    let source = |(kind, id, url): (&str, Option<&str>, Option<&str>)| {
        let mut source = json!({ "@type": "Dataset", "name": id.unwrap_or(kind) });
        if let Some(url) = url {
            source["url"] = url.into();
        }
        source
    };
    named.into_iter().map(source).collect()
}

fn distribution_entries(of: &DescribedRelease<'_>) -> Vec<Value> {
    let mut nodes = vec![
        json!({
            "@type": "cr:FileObject", "@id": index::NAME, "name": index::NAME, "contentUrl": index::NAME,
            "description": "one row per trajectory", "contentSize": content_size(of.index.len() as u64),
            "encodingFormat": "application/x-parquet", "sha256": checksum::sha256_hex(of.index),
        }),
        json!({
            "@type": "cr:FileObject", "@id": ROOT, "name": ROOT, "description": "the release folder",
            "contentUrl": ".", "encodingFormat": "git+https", "sha256": ROOT_SUM,
        }),
    ];
    for FileSet { id, media, glob, description } in file_sets() {
        if of.paths.iter().any(|path| glob_matches(glob, path)) {
            let mut set = json!({
                "@type": "cr:FileSet", "@id": id, "name": id, "description": description, "encodingFormat": media,
                "containedIn": { "@id": ROOT }, "includes": glob,
            });
            // Exports have files of the same names in other layouts. The prefix stands because the
            // context, which is that of `mlcroissant`, lacks the word.
            if !of.info.include.is_empty() {
                set["cr:excludes"] = "**/exports/**".into();
            }
            nodes.push(set);
        }
    }
    nodes
}

/// The sets of files that a release can have.
fn file_sets() -> impl Iterator<Item = &'static FileSet> {
    let made = products().flat_map(|product| product.files);
    let others =
        products::PATH.iter().chain(&products::CALIBRATION).chain(&products::CHECKS).chain(&products::SCENE);
    made.chain(others).filter_map(|row| row.set.as_ref())
}

/// A length in the form that Croissant uses.
pub fn content_size(bytes: u64) -> String {
    format!("{bytes} B")
}

/// Terms of Croissant that are written without its prefix.
const TERMS: [&str; 26] = [
    "citeAs",
    "column",
    "equivalentProperty",
    "extract",
    "field",
    "fileProperty",
    "fileObject",
    "fileSet",
    "format",
    "includes",
    "isLiveDataset",
    "jsonPath",
    "key",
    "md5",
    "parentField",
    "path",
    "recordSet",
    "references",
    "regex",
    "repeated",
    "replace",
    "samplingRate",
    "separator",
    "source",
    "subField",
    "transform",
];

/// The JSON-LD context. `mlcroissant` warns of any other one.
fn json_context() -> Value {
    let mut context = json!({
        "@language": "en", "@vocab": "https://schema.org/", "sc": "https://schema.org/",
        "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/",
        "prov": "http://www.w3.org/ns/prov#", "dct": "http://purl.org/dc/terms/",
        "conformsTo": "dct:conformsTo", "dataType": { "@id": "cr:dataType", "@type": "@vocab" },
        "data": { "@id": "cr:data", "@type": "@json" }, "examples": { "@id": "cr:examples", "@type": "@json" },
    });
    let terms: Map<String, Value> =
        TERMS.iter().map(|term| ((*term).to_owned(), format!("cr:{term}").into())).collect();
    context.as_object_mut().expect("it was written as one").extend(terms);
    context
}
