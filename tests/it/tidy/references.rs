//! Every file of the repository that a text names exists, and so does every cited heading.

use super::Fault;
use super::source::{Source, root};
use std::path::Path;

/// Folders whose files are named by their path from the repository's root.
const FOLDERS: [&str; 7] = ["crates/", "docs/", "src/", "tests/", "benches/", "xtask/", "manifests/"];

/// Kinds of text that are read.
const KINDS: [&str; 7] = [".rs", ".md", ".wgsl", ".py", ".toml", ".yaml", ".ci/run"];

/// Texts whose names refer to other places: recordings, inputs of tests, and the examples of these
/// rules.
const UNREAD: [&str; 6] = [
    "tests/snapshots/",
    "crates/recipe/tests/snapshots/",
    "crates/recipe/tests/fixtures/",
    "tests/fuzz/corpus/",
    "tests/it/tidy/",
    "tests/it/tidy.rs",
];

/// Names that are not files of the repository.
const ELSEWHERE: [(&str, &str); 11] = [
    ("DATASHEET.md", "a file of a release"),
    ("summary.md", "a file that a study writes"),
    ("LICENSE.md", "a file of the repositories of trainers"),
    ("readme.md", "a name that a scene must not have"),
    ("datasheet.md", "a name that a scene must not have"),
    ("t.md", "a file that a test writes"),
    ("tests/fixtures/recipes", "a folder of crates/recipe, where its tests run"),
    ("tests/snapshots/recipes", "the same"),
    ("src/simulator_utils.py", "a file of Lynn0306/DVS-Voltmeter"),
    ("src/colmap/sensor/models.h", "a file of colmap/colmap"),
    ("src/colmap/scene/reconstruction_io_binary.cc", "a file of colmap/colmap"),
];

/// Faults of every text that is read: names of absent files, broken links, absent headings.
pub(super) fn references_hold(sources: &[Source]) -> Vec<Fault> {
    let is_read = |source: &&Source| {
        KINDS.iter().any(|kind| source.path.ends_with(kind))
            && !UNREAD.iter().any(|path| source.path.starts_with(path))
    };
    let read = sources.iter().filter(is_read);
    read.flat_map(|source| [absent_files(source), broken_links(source), absent_headings(source)].concat())
        .collect()
}

/// Paths from the root, and bare names of Markdown files, whose file does not exist.
fn absent_files(source: &Source) -> Vec<Fault> {
    let folder = Path::new(&source.path).parent().unwrap_or(Path::new(""));
    let is_absent = |name: &str| {
        if ELSEWHERE.iter().any(|(other, _)| *other == name) {
            return false;
        }
        if FOLDERS.iter().any(|folder| name.starts_with(folder) && name.len() > folder.len()) {
            return !root().join(name).exists();
        }
        let homes = ["", "docs", "docs/design", "crates/lab/results"].map(Path::new);
        is_bare_page(name) && !homes.iter().chain([&folder]).any(|home| root().join(home).join(name).exists())
    };
    let mut faults = Vec::new();
    for (i, line) in source.text.lines().enumerate() {
        let absent =
            line.split(|c: char| c.is_whitespace() || "`\"'()<>[],;|".contains(c)).filter_map(name_in);
        let absent = absent.filter(|name| is_absent(name));
        faults.extend(absent.map(|name| Fault::new(source, i + 1, format!("`{name}` is not there"))));
    }
    faults
}

/// The path that a word may be, without an anchor, a line number and the end of a sentence. `None`
/// for addresses and patterns.
fn name_in(word: &str) -> Option<&str> {
    if word.contains("://") || word.contains(|c| "{}*…$=\\".contains(c)) {
        return None;
    }
    word.split(['#', ':']).next().map(|name| name.trim_end_matches(['.', '!', '?']))
}

fn is_bare_page(name: &str) -> bool {
    let stem = name.strip_suffix(".md").unwrap_or_default();
    !stem.is_empty() && stem.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c))
}

/// Links of a Markdown file whose file or heading does not exist.
fn broken_links(source: &Source) -> Vec<Fault> {
    if !source.path.ends_with(".md") {
        return Vec::new();
    }
    let folder = root().join(&source.path).parent().expect("a file lies in a folder").to_owned();
    let is_broken = |target: &str| {
        let (path, anchor) = target.split_once('#').unwrap_or((target, ""));
        let page = if path.is_empty() { root().join(&source.path) } else { folder.join(path) };
        let text = if anchor.is_empty() { String::new() } else { read(&page) };
        !page.exists() || !anchor.is_empty() && !headings(&text).any(|heading| slug(heading) == anchor)
    };
    let mut faults = Vec::new();
    for (i, line) in source.text.lines().enumerate() {
        let targets = line.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
        let targets = targets.map(|(target, _)| target).filter(|target| !target.contains("://"));
        let broken = targets.filter(|target| is_broken(target));
        faults.extend(
            broken.map(|target| Fault::new(source, i + 1, format!("the link `{target}` leads nowhere"))),
        );
    }
    faults
}

/// Citations `docs/PAGE.md, "Heading"` of a heading, or of the first cell of a table's row, that
/// the page does not have.
fn absent_headings(source: &Source) -> Vec<Fault> {
    let mut faults = Vec::new();
    let text = without_margins(&source.text);
    for (at, _) in text.match_indices(".md, \"") {
        let Some(start) = text[..at].rfind("docs/") else { continue };
        let (page, rest) = (&text[start..at + 3], &text[at + 6..]);
        let heading = rest.split('"').next().unwrap_or_default();
        let known = read(&root().join(page));
        let row = format!("| {heading} |");
        if !headings(&known).any(|other| other == heading)
            && !known.lines().any(|line| line.starts_with(&row))
        {
            faults.push(Fault::new(source, 1, format!("{page} has no heading \"{heading}\"")));
        }
    }
    faults
}

/// The text as one line, with each line's margin and comment mark removed: a citation may begin on
/// one line and end on the next.
fn without_margins(text: &str) -> String {
    let lines = text.lines().map(|line| {
        let line = line.trim();
        ["//!", "///", "//"].iter().find_map(|mark| line.strip_prefix(mark)).unwrap_or(line).trim()
    });
    lines.collect::<Vec<_>>().join(" ")
}

/// Headings of a Markdown text.
fn headings(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim())
}

/// A heading as the anchor of a link, by GitHub's rule.
fn slug(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() }).collect()
}

/// The text of a page; empty if it is absent.
fn read(page: &Path) -> String {
    std::fs::read_to_string(page).unwrap_or_default()
}

#[test]
fn exceptions_are_needed() {
    let stale = ELSEWHERE.iter().filter(|(name, _)| root().join(name).exists());
    let stale: Vec<&str> = stale.map(|(name, _)| *name).collect();
    assert!(stale.is_empty(), "files of the repository after all: {stale:?}");
}

#[test]
fn anchors_follow_githubs_rule() {
    assert_eq!(slug("Clock, order and caps"), "clock-order-and-caps");
    assert_eq!(slug("Why YAML, and why this library?"), "why-yaml-and-why-this-library");
}
