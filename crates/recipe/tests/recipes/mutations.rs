//! A recipe of any bytes is either read or refused with a place, and never causes a panic.

use gs2e_recipe::{RecipeFaults, read_all};
use gs2e_testing::absent::is_thorough;
use proptest::prelude::{Just, Strategy, any, prop, prop_oneof};
use proptest::test_runner::{Config, TestRunner};
use std::ops::Range;
use std::path::PathBuf;

const DEMO: &str = include_str!("../../../../recipes/demo.yaml");

/// A scene without a capture, with every other path and speed.
const PATHS: &str = "\
version: 1
scene: a
source: none
reconstruct: { given: { path: a.ply } }
camera: { width: 64, height: 48, fx: 60 }
trajectories:
  - name: mini
    novel: { base: round, groups: 3, keyframes: 5, frames: 150, curve: { bezier: { degree: 3 } }, literal: false }
    speed: { list: { multipliers: [1, 0.5], blend: 0.1, meaning: frame-rate } }
  - name: round
    orbit: { centre: [0, 0, 0], from: [0, 3, 4], up: [0, 1, 0], arc: 360 }
    speed: { flow: { px_s: 400, function: 1 + t } }
  - name: hand
    keyframes:
      poses:
        - { position: [0, 0, 0], rotation: [0, 0, 0, 1] }
        - { position: [1, 0, 0], look_at: [0, 0, 9], up: [0, 1, 0] }
      factor: 5
      metric: { scale: 2 }
sampling: { rate: 2400, law: sum }
";

/// Texts that have upset YAML readers and number parsers.
const NASTY: [&str; 36] = [
    "",
    "~",
    "\t",
    "\n",
    "\r",
    " ",
    ":",
    ": ",
    "- ",
    "{",
    "}",
    "[",
    "]",
    ",",
    "&a ",
    "*a",
    "!t ",
    "|",
    ">",
    "'",
    "\"",
    "%",
    "@",
    "`",
    "#",
    "?",
    "<<: ",
    "---\n",
    "...\n",
    ".nan",
    "1e999",
    "0x",
    "\u{feff}",
    "\u{0}",
    "é",
    "\u{1f980}",
];

/// Replaces `len` bytes at `at` by `with`; both are taken modulo the available range.
type Edit = (usize, usize, Vec<u8>);

fn edits() -> impl Strategy<Value = Vec<Edit>> {
    let with = prop_oneof![
        any::<u8>().prop_map(|b| vec![b]),
        (0..NASTY.len()).prop_map(|i| NASTY[i].as_bytes().to_vec()),
        // A piece of the recipe itself: keys occur twice, values occur in the wrong place.
        (0..DEMO.len(), 1..60_usize)
            .prop_map(|(at, n)| DEMO.as_bytes()[at..(at + n).min(DEMO.len())].to_vec()),
        Just(Vec::new()),
    ];
    prop::collection::vec((any::<usize>(), 0..20_usize, with), 1..6)
}

fn edited(edits: &[Edit]) -> Vec<u8> {
    let mut bytes = DEMO.as_bytes().to_vec();
    for (at, len, with) in edits {
        let start = at % (bytes.len() + 1);
        let end = (start + len).min(bytes.len());
        bytes.splice(start..end, with.iter().copied());
    }
    bytes
}

fn has_places(faults: &RecipeFaults, bytes: &[u8]) {
    let lines = bytes.split(|b| matches!(b, b'\n' | b'\r')).count();
    assert!(!faults.listed().is_empty() && faults.listed().len() <= 20);
    assert_eq!(faults.to_json().len(), faults.listed().len());
    assert!(faults.render_text().starts_with("error: "));
    for fault in faults.listed() {
        let about_the_file = matches!(fault.message(), "the file is empty");
        let Some((line, column)) = fault.position() else {
            assert!(about_the_file, "no place: {fault}");
            continue;
        };
        assert!((1..=lines).contains(&line) && column >= 1, "{fault} of {lines} lines");
        assert!(!fault.render_lines().concat().contains(char::is_control), "{fault}");
    }
}

/// Words and numbers of a recipe, outside comments, by their bytes.
fn tokens(recipe: &str) -> Vec<Range<usize>> {
    let mut tokens: Vec<Range<usize>> = Vec::new();
    let mut in_comment = false;
    for (at, c) in recipe.char_indices() {
        in_comment = c != '\n' && (in_comment || c == '#');
        if in_comment || !(c.is_ascii_alphanumeric() || "._-/*+".contains(c)) {
            continue;
        }
        match tokens.last_mut() {
            Some(last) if last.end == at => last.end += 1,
            _ => tokens.push(at..at + 1),
        }
    }
    tokens
}

#[test]
fn every_token_may_be_anything() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("recipe.yaml");
    for recipe in [DEMO, PATHS] {
        std::fs::write(&file, recipe).unwrap();
        read_all(&[PathBuf::from(&file)]).unwrap_or_else(|faults| panic!("{}", faults.render_text()));
        let tokens = tokens(recipe);
        assert!(tokens.len() > 50, "{} tokens", tokens.len());
        for token in tokens {
            let usual = ["", "~", "[", "*a", ".nan", "1e999", "0", "-1e300"];
            for nasty in if is_thorough() { &NASTY[..] } else { &usual } {
                let text = [&recipe[..token.start], nasty, &recipe[token.end..]].concat();
                std::fs::write(&file, &text).unwrap();
                if let Err(faults) = read_all(&[PathBuf::from(&file)]) {
                    has_places(&faults, text.as_bytes());
                }
            }
        }
    }
}

#[test]
fn mutated_recipes_are_read_or_refused_with_a_place() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("recipe.yaml");
    let mut runner = TestRunner::new_with_rng(
        Config {
            cases: if is_thorough() { 20_000 } else { 500 },
            failure_persistence: None,
            ..Config::default()
        },
        proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha),
    );
    let result = runner.run(&edits(), |edits| {
        let bytes = edited(&edits);
        std::fs::write(&file, &bytes).unwrap();
        if let Err(faults) = read_all(&[PathBuf::from(&file)]) {
            has_places(&faults, &bytes);
        }
        Ok(())
    });
    result.unwrap_or_else(|failure| panic!("{failure}"));
}
