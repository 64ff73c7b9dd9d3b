//! The documentation: references that the program writes, and examples that it reads. Links are a
//! rule of tidy.
//!
//! `cargo xtask docs` runs these tests with `WRITE_DOCS=1`, which rewrites the generated parts of
//! the pages instead of comparing them.

mod cli_page;
mod declared;
mod examples;
mod json_schema;
mod markdown;
mod probe;
mod recipe_page;

use crate::support::repository::{files_below, root, sources_below, text_of};
use declared::Crate;
use markdown::Page;
use recipe_page::{Reference, Words};

/// All pages, written by hand or by the program, as paths from the repository's root.
fn pages() -> Vec<String> {
    let top = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"].map(str::to_owned);
    let folders = ["docs", "crates/lab/results"];
    top.into_iter().chain(folders.into_iter().flat_map(|folder| files_below(folder, "md"))).collect()
}

/// Pages that a run of the program writes as a whole. Their lines may have any length.
const WRITTEN_BY_RUNS: [&str; 3] = [
    "crates/lab/results/work-precision.md",
    "crates/lab/results/tolerance.md",
    "crates/lab/results/stress.md",
];

const BEGIN: &str = "<!-- generated: `cargo xtask docs` writes the rest of this page -->\n";

/// Compares the part of a page below its mark with the program's text, or rewrites it.
fn generated(path: &str, wanted: &str) {
    let text = text_of(path);
    let (by_hand, found) =
        text.split_once(BEGIN).unwrap_or_else(|| panic!("{path} has no line `{}`", BEGIN.trim()));
    if found == wanted {
        return;
    }
    let rewrite = std::env::var_os("WRITE_DOCS").is_some_and(|value| value == "1");
    assert!(rewrite, "{path} is stale: run `cargo xtask docs` and look at the difference");
    std::fs::write(root().join(path), format!("{by_hand}{BEGIN}{wanted}")).unwrap();
}

#[test]
fn the_reference_of_the_recipe_is_current() {
    generated("docs/recipe.md", &Reference::of(&Crate::read()).markdown());
}

#[test]
fn the_list_of_ablations_is_current() {
    generated("docs/ablations.md", &Reference::of(&Crate::read()).ablations());
}

#[test]
fn the_reference_of_the_command_line_is_current() {
    generated("docs/cli.md", &cli_page::markdown());
}

/// What `gs2e schema` prints.
#[test]
fn the_reference_as_a_json_schema_is_current() {
    const PATH: &str = "crates/recipe/src/recipe.schema.json";
    let wanted = json_schema::text(&Crate::read());
    if gs2e_recipe::JSON_SCHEMA == wanted {
        return;
    }
    let rewrite = std::env::var_os("WRITE_DOCS").is_some_and(|value| value == "1");
    assert!(rewrite, "{PATH} is stale: run `cargo xtask docs` and look at the difference");
    std::fs::write(root().join(PATH), wanted).unwrap();
}

/// A default in backticks means the same as an absent key; a required key cannot be left out.
#[test]
fn stated_defaults_are_those_of_the_loader() {
    let krate = Crate::read();
    let mut verified = 0;
    for key in Reference::of(&krate).keys() {
        let Words { meaning, default, required, .. } = &key.words;
        assert!(!meaning.is_empty(), "{} has no meaning", key.place());
        assert!(
            *required == default.is_empty(),
            "{} has neither or both of Required and Default",
            key.place()
        );
        let context = probe::context(&key.path);
        let bare = probe::load(&context).unwrap_or_else(|e| panic!("{}: {e}", key.path));
        if let Some(without) = required.then(|| probe::without(context.clone(), &key.path)).flatten() {
            let faults = probe::load(&without).err().unwrap_or_default();
            assert!(faults.contains("missing field"), "{} is not required: {faults}", key.place());
            verified += 1;
        }
        if let Some(text) = key.words.yaml_default().filter(|_| !key.is_later()) {
            let value = probe::yaml(text).unwrap_or_else(|e| panic!("{}: {e}", key.place()));
            let said = probe::load(&probe::with(context, &key.path, value));
            let said = said.unwrap_or_else(|e| panic!("{}: {e}", key.place()));
            assert!(said == bare, "{} is not {text} by default", key.place());
            verified += 1;
        }
    }
    assert!(verified > 90, "only {verified} keys were verified");
}

/// Symbols of the numerics pages, which look like names of types.
const SYMBOLS: [&str; 4] = ["Phi", "Tdot", "Th", "Ti"];

/// The name of a type in a span of code, and its member: `Type` or `Type::member`.
fn type_and_member(span: &str) -> Option<(&str, Option<&str>)> {
    let (name, member) = span.split_once("::").map_or((span, None), |(name, member)| (name, Some(member)));
    let camel = name.starts_with(|c: char| c.is_ascii_uppercase())
        && name.chars().any(|c| c.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_alphanumeric());
    camel.then_some((name, member))
}

/// Returns true if the file declares or implements the type and names the member, where one is given.
fn is_in(text: &str, name: &str, member: Option<&str>) -> bool {
    let words = |line: &str| -> Vec<String> {
        line.split(|c: char| !c.is_alphanumeric() && c != '_').map(str::to_owned).collect()
    };
    let holds = |line: &str| {
        let kind = |pair: &[String]| {
            ["struct", "enum", "trait", "type", "impl", "class", "for"].contains(&pair[0].as_str())
        };
        words(line).windows(2).any(|pair| kind(pair) && pair[1] == name)
    };
    text.contains(name)
        && text.lines().any(holds)
        && member.is_none_or(|member| text.lines().any(|line| words(line).iter().any(|w| w == member)))
}

#[test]
fn types_in_the_glossary_and_the_design_exist() {
    let sources: Vec<String> = sources_below("crates").iter().map(|path| text_of(path)).collect();
    let mut missing = Vec::new();
    let mut found = 0;
    for page in
        pages().into_iter().filter(|page| page == "docs/glossary.md" || page.starts_with("docs/design/"))
    {
        let text = text_of(&page);
        for (name, member) in text.split('`').skip(1).step_by(2).filter_map(type_and_member) {
            let known = sources.iter().any(|source| is_in(source, name, member));
            found += usize::from(known);
            if !known && !SYMBOLS.contains(&name) {
                missing
                    .push(format!("{page}: {name}{}", member.map_or_else(String::new, |m| format!("::{m}"))));
            }
        }
    }
    assert!(missing.is_empty(), "no such type in crates/:\n{}", missing.join("\n"));
    assert!(found > 40, "only {found} types were recognised");
}

#[test]
fn lines_fit_and_the_readme_is_short() {
    assert!(text_of("README.md").len() <= 8000, "README.md has {} bytes", text_of("README.md").len());
    let mut faults = Vec::new();
    for path in pages().into_iter().filter(|path| !WRITTEN_BY_RUNS.contains(&path.as_str())) {
        let page = Page::parse(&text_of(&path));
        let long = |line: &str| line.chars().count() > 120 && !line.starts_with('|');
        let lines = page.prose.iter().filter(|(_, line)| long(line));
        faults.extend(lines.map(|(number, _)| format!("{path}:{number}: more than 120 columns")));
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_citation_and_the_changelog_name_this_version() {
    let version = env!("CARGO_PKG_VERSION");
    let citation = probe::yaml(&text_of("CITATION.cff")).unwrap();
    assert_eq!(citation["version"], version);
    assert_eq!(citation["references"][0]["identifiers"][0]["value"], "arXiv:2505.15287");
    assert!(text_of("CHANGELOG.md").contains(version));
}

/// The book lists every page exactly once.
#[test]
fn the_summary_lists_every_page() {
    let summary = Page::parse(&text_of("docs/SUMMARY.md"));
    let mut listed: Vec<String> = summary.links().into_iter().map(|(_, to)| format!("docs/{to}")).collect();
    listed.sort();
    let pages: Vec<String> =
        files_below("docs", "md").into_iter().filter(|p| p != "docs/SUMMARY.md").collect();
    assert_eq!(listed, pages);
}

/// Features that the README calls missing are refused by name, and every reserved key is on its
/// list.
#[test]
fn missing_features_are_refused_by_name() {
    let readme = text_of("README.md");
    let section = readme
        .split("\n## ")
        .find(|part| part.starts_with("Not there yet\n"))
        .expect("there is such a section");
    let named: Vec<&str> = section.split('`').skip(1).step_by(2).collect();
    assert!(!named.is_empty());
    for fragment in &named {
        let mut recipe = probe::context("reconstruct.given");
        probe::merge(&mut recipe, probe::yaml(fragment).unwrap_or_else(|e| panic!("{fragment}: {e}")));
        let faults = probe::load(&recipe).err().unwrap_or_default();
        assert!(faults.contains("is not supported yet"), "`{fragment}` is not refused as missing: {faults}");
    }
}
