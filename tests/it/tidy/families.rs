//! Families of sensors, captures, outputs and checks: the number of product files that a new member
//! has to touch.
//!
//! A file names a member if its code, without comments, literals and unit tests, has the variant
//! (`SensorChoice::Esim`, or its line in the enumeration) or the name in quotes (`"esim"`). Files of
//! the member itself do not count. A file that names every member is one that a new member must
//! touch: a table or a match over the family. Files that name some members only have a reason of
//! their own, and are listed here.

use super::source::{Source, crate_sources};
use gs2e_recipe::OutputKind;
use gs2e_sensor::SensorChoice;
use gs2e_source::kind::CaptureKind;
use std::collections::{BTreeMap, BTreeSet};

/// Files that a new member of a family has to touch, apart from its own and its `mod` line.
const MOST: usize = 3;

/// A closed family.
struct Family {
    name: &'static str,
    /// The enumerations whose variants are its members.
    enums: &'static [&'static str],
    /// Names of the members in recipes. The variants are these names in capitals.
    members: Vec<&'static str>,
    /// Folders and files of the member `{}`.
    own: &'static [&'static str],
    /// Places outside which a name in quotes means something else.
    quoted_in: &'static [&'static str],
    /// Files that every member is named in, with the work there.
    needed: &'static [(&'static str, &'static str)],
    /// Files that name some members, each with the reason.
    special: &'static [(&'static str, &'static str)],
}

fn families() -> [Family; 3] {
    [
        Family {
            name: "sensors",
            enums: &["SensorChoice", "SensorSection"],
            members: SensorChoice::FAMILY.map(|facts| facts.name).to_vec(),
            own: &["crates/sensor/src/{}.rs", "crates/recipe/src/schema/sensor/{}.rs"],
            quoted_in: &["crates", "src"],
            needed: &[
                ("crates/sensor/src/choice.rs", "the variant, and the matches over the family"),
                ("crates/recipe/src/schema/sensor.rs", "its keys in a recipe"),
                ("crates/recipe/src/resolve/sensor.rs", "defaults and ranges of the keys"),
                // The fourth. A law of drift is part of the check, which knows the sensor; the sensor
                // does not know checks. It goes when the law becomes an answer of the model.
                ("crates/check/src/drift.rs", "the drift that the check expects"),
            ],
            special: &[("crates/sensor/src/named.rs", "presets, and one model that needs none")],
        },
        Family {
            name: "captures",
            enums: &["CaptureKind", "SourceSection"],
            members: CaptureKind::ALL.map(CaptureKind::name).to_vec(),
            own: &["crates/source/src/{}.rs"],
            quoted_in: &["crates/recipe", "crates/source", "crates/release", "crates/build/src/plan"],
            needed: &[
                ("crates/source/src/kind.rs", "the variant, and the one match over the family"),
                ("crates/recipe/src/schema/source.rs", "its key in a recipe"),
            ],
            special: &[
                ("crates/source/src/dl3dv.rs", "folders of the dataset have the names of two kinds"),
                ("crates/recipe/src/context/include.rs", "`colmap` is also a format of exports"),
                ("crates/release/src", "`model` is also the model of a sensor"),
                ("crates/source/src/foreign", "`colmap` is also a program"),
                ("crates/source/src/licence", "terms of one dataset"),
            ],
        },
        Family {
            name: "outputs",
            enums: &["OutputKind"],
            members: OutputKind::ALL.map(OutputKind::name).to_vec(),
            own: &[],
            // `events` and `depth` are quantities elsewhere.
            quoted_in: &["crates/recipe/src", "crates/build/src/plan"],
            needed: &[
                // An output with settings has a key in `recipe/schema.rs` too, and `gs2e.py` has a
                // function that loads it; neither names a variant.
                ("crates/recipe/src/output.rs", "the variant, its name and its settings"),
                ("crates/build/src/plan/wire.rs", "its step"),
                ("crates/release/src/products/outputs.rs", "its row in the catalogue of a release"),
            ],
            special: &[
                ("crates/recipe/src/canonical/trajectory.rs", "`flow` is also a form of speed"),
                ("crates/recipe/src/resolve/lights.rs", "`depth` is also that of a modulation"),
                ("crates/build/src/stage", "a stage has the name of its output"),
                ("crates/build/src/plan/edits.rs", "the steps that more than their own section decides"),
                ("crates/audit/src/recheck", "checks of a release read its pictures"),
                (
                    "crates/audit/src/recompose/products.rs",
                    "these follow from the recipe, the poses and the depth",
                ),
            ],
        },
    ]
}

impl Family {
    /// The files that name each member.
    fn files(&self, sources: &[Source]) -> BTreeMap<&'static str, BTreeSet<String>> {
        let named = |member: &'static str| {
            let files = sources.iter().filter(|source| !self.is_own(source, member));
            let files = files.filter(|source| self.names(source, member));
            (member, files.map(|source| source.path.clone()).collect())
        };
        self.members.iter().copied().map(named).collect()
    }

    fn is_own(&self, source: &Source, member: &str) -> bool {
        let own: Vec<String> = self.own.iter().map(|pattern| pattern.replace("{}", member)).collect();
        source.is_in(&own.iter().map(String::as_str).collect::<Vec<_>>())
    }

    fn names(&self, source: &Source, member: &str) -> bool {
        let mut letters = member.chars();
        let first: String = letters.next().into_iter().flat_map(char::to_uppercase).collect();
        let variant = first + letters.as_str();
        let is_named = self.enums.iter().any(|name| names_variant(&source.code, name, &variant));
        let within = |place: &&str| source.path == **place || source.path.starts_with(&format!("{place}/"));
        is_named || self.quoted_in.iter().any(within) && quotes(source, member)
    }
}

/// Returns true if the code has `Name::Variant`, or declares the variant of the enumeration.
fn names_variant(code: &str, name: &str, variant: &str) -> bool {
    let is_end = |rest: &str| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_');
    let path = format!("{name}::{variant}");
    let has_path = code.match_indices(&path).any(|(at, _)| is_end(&code[at + path.len()..]));
    let declared = code.split_once(&format!("enum {name} {{")).is_some_and(|(_, rest)| {
        let body = rest.split_once("\n}").map_or(rest, |(body, _)| body);
        body.lines().map(str::trim).any(|line| line.strip_prefix(variant).is_some_and(is_end))
    });
    has_path || declared
}

/// Returns true if the text has the name in quotes, on a line of code.
fn quotes(source: &Source, member: &str) -> bool {
    let quoted = format!("\"{member}\"");
    let lines = source.code.lines().zip(source.text.lines());
    lines.filter(|(code, _)| !code.trim().is_empty()).any(|(_, text)| text.contains(&quoted))
}

#[test]
fn a_new_member_touches_few_files() {
    let sources = crate_sources();
    for family in families() {
        let files = family.files(&sources);
        let all: BTreeSet<&String> = files.values().flatten().collect();
        let in_every = |file: &&&String| files.values().all(|named| named.contains(**file));
        let needed: Vec<&str> = all.iter().filter(in_every).map(|file| file.as_str()).collect();
        let mut wanted: Vec<&str> = family.needed.iter().map(|(file, _)| *file).collect();
        wanted.sort_unstable();
        assert_eq!(needed, wanted, "files that a new member of the {} has to touch", family.name);
        let most = if family.name == "sensors" { MOST + 1 } else { MOST };
        assert!(needed.len() <= most, "{}: {needed:?}", family.name);
        let special = |file: &str| {
            family.special.iter().any(|(place, _)| file == *place || file.starts_with(&format!("{place}/")))
        };
        let others: Vec<(&&str, &String)> = files
            .iter()
            .flat_map(|(member, named)| named.iter().map(move |file| (member, file)))
            .filter(|(_, file)| !needed.contains(&file.as_str()) && !special(file))
            .collect();
        assert!(others.is_empty(), "{}: files that name some members only: {others:?}", family.name);
    }
}

/// A check is known by its module and its name in quotes. Outside its own file it is named in the
/// table of checks alone, and where another room has a reason to know one of them.
#[test]
fn a_new_check_touches_few_files() {
    let sources = crate_sources();
    let named = |source: &Source, check: &str| {
        let own = format!("crates/check/src/{check}.rs");
        !source.is_in(&[&own]) && (source.code.contains(&format!("mod {check};")) || quotes(source, check))
    };
    let in_every = |source: &&Source| gs2e_check::NAMES.iter().all(|check| named(source, check));
    let needed: Vec<&str> = sources.iter().filter(in_every).map(|source| source.path.as_str()).collect();
    assert!(!needed.is_empty() && needed.len() <= MOST, "{needed:?}");
}

#[test]
fn variants_are_found_in_code_alone() {
    let code = |text: &str| Source::new("crates/sensor/src/lib.rs", text);
    let t = |text: &str| names_variant(&code(text).code, "SensorChoice", "Esim");
    assert!(t("let a = SensorChoice::Esim(b);"));
    assert!(t("pub enum SensorChoice {\n    Voltmeter,\n    Esim(EsimModel),\n}"));
    assert!(!t("let a = SensorChoice::EsimLike;"));
    assert!(!t("// SensorChoice::Esim\nlet a = \"SensorChoice::Esim\";"));
    assert!(!t("enum SensorChoice {\n    Voltmeter,\n}\nenum Other {\n    Esim,\n}"));
    assert!(quotes(&code("let a = \"esim\";"), "esim"));
    assert!(!quotes(&code("// \"esim\"\nlet a = \"esims\";"), "esim"));
}
