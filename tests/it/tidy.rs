//! The house rules, checked on the project's own sources. Checks of rustc and clippy are not
//! repeated.

mod crates;
mod families;
mod references;
mod removal;
mod source;
mod words;

use source::{Source, committed_texts, crate_sources, root};
use std::collections::BTreeMap;
use std::fmt;
use std::io::Write as _;

/// A place where a rule is broken.
#[derive(Clone)]
struct Fault {
    place: String,
    what: String,
}

impl Fault {
    fn new(source: &Source, line: usize, what: impl Into<String>) -> Self {
        Self { place: format!("{}:{line}", source.path), what: what.into() }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.what)
    }
}

fn none(faults: &[Fault]) {
    let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), lines.join("\n"));
}

#[test]
fn banned_words_are_absent() {
    none(&words::banned_words(&crate_sources()));
}

#[test]
fn only_listed_places_delete_and_replace() {
    none(&removal::deletions_and_replacements(&crate_sources()));
}

#[test]
fn stages_hold_no_arithmetic() {
    none(&words::stages_hold_no_arithmetic(&crate_sources()));
}

#[test]
fn files_begin_with_their_subject() {
    none(&heads(&crate_sources()));
}

#[test]
fn files_hold_one_concept() {
    let sources = crate_sources();
    for long in lengths(&sources, LONG) {
        // Written directly, past the captured output, so that it is seen although the test passes.
        drop(std::io::stderr().write_all(format!("note: {long}\n").as_bytes()));
    }
    none(&lengths(&sources, TOO_LONG));
}

#[test]
fn constants_are_defined_in_one_place() {
    none(&constants(&crate_sources()));
}

#[test]
fn no_machine_is_named() {
    none(&machine_paths(&committed_texts()));
}

#[test]
fn references_lead_somewhere() {
    none(&references::references_hold(&committed_texts()));
}

#[test]
fn the_readme_starts_with_two_commands() {
    let text = std::fs::read_to_string(root().join("README.md")).expect("there is a README.md");
    none(&quick_start(&[Source::new("README.md", &text)]));
}

/// Checks that a rule finds its fault exactly once, and accepts the sound twin.
fn bites(rule: fn(&[Source]) -> Vec<Fault>, path: &str, bad: &str, good: &str) {
    assert_eq!(rule(&[Source::new(path, bad)]).len(), 1, "missed in {path}: {bad}");
    let faults = rule(&[Source::new(path, good)]);
    assert!(faults.is_empty(), "false alarm in {path}: {good}: {}", faults[0]);
}

#[test]
fn the_rule_of_deletions_bites() {
    let t = |path, bad, good| bites(removal::faults_of_one, path, bad, good);
    t("crates/scene/src/ply.rs", "std::fs::remove_file(path)?;", "files::open(path)?;");
    t("crates/scene/src/ply.rs", "files::remove(&path, Removal::File)?;", "set.remove(&path);");
    t("crates/export/src/tree.rs", "fs::remove_dir_all(&folder)", "files::remove(&folder, Removal::Tree)");
    t("crates/scene/src/ply.rs", "File::create(path)?", "File::create_new(path)?");
    t("crates/scene/src/ply.rs", "fs::write(path, text)?", "fs::write_all(path)?");
    t("crates/recipe/src/lib.rs", "fs::rename(&from, &to)?", "store.rename(&from, &to)?");
}

#[test]
fn the_rule_of_words_bites() {
    let t = |path, bad, good| bites(words::banned_words, path, bad, good);
    t("crates/render/src/cpu.rs", "println!(\"{x}\");", "writeln!(out, \"println!\")?; // println!");
    t("crates/store/src/lib.rs", "let t = Instant::now();", "fn f(now: Instant) {}");
    t(
        "crates/build/src/run.rs",
        "let home = std::env::var(\"HOME\");",
        "let version = env!(\"CARGO_PKG_VERSION\");",
    );
    t("crates/build/src/plan.rs", "use std::collections::HashMap;", "use std::collections::BTreeMap;");
    t("crates/num/src/se3.rs", "let s = angle.sin();", "let s = libm::sin(angle).sqrt();");
    t("crates/num/src/se3.rs", "let q = DQuat::from_axis_angle(a, w);", "let twist = pose.log();");
    t("crates/image/src/lib.rs", "#[allow(dead_code)]", "#[expect(dead_code, reason = \"…\")]");
    t("crates/image/src/lib.rs", "unsafe { f() }", "#![forbid(unsafe_code)]");
    t(
        "crates/num/src/seed.rs",
        "let x = f(&mut rand::rng());",
        "#[cfg(test)]\nmod tests { fn f() { rand::rng() } }",
    );
    bites(
        words::stages_hold_no_arithmetic,
        "crates/build/src/stage/events.rs",
        "x as f64",
        "model.start(size)",
    );
}

#[test]
fn the_rule_of_references_bites() {
    let t = |path, bad, good| bites(references::references_hold, path, bad, good);
    t(
        "crates/image/src/lib.rs",
        "//! See `docs/absent.md`.",
        "//! See `docs/checks.md`, crates/num/src/seed.rs:7 and https://a.org/docs/b.md.",
    );
    t(
        "crates/image/src/lib.rs",
        "// absent.md, section 2",
        "// README.md and DATASHEET.md; tests/it/{a,b}.rs",
    );
    t("docs/a.md", "[text](checks.md#nowhere)", "[text](../README.md#quick-start), [text](design/README.md)");
    let citation = |heading: &str| format!("//! (docs/design/pipeline.md,\n//! \"{heading}\")");
    t("crates/image/src/lib.rs", &citation("Nowhere"), &citation("Licences"));
}

#[test]
fn the_rules_of_form_bite() {
    bites(heads, "crates/image/src/lib.rs", "use std::fmt;", "//! Images.");
    assert_eq!(heads(&[Source::new("crates/scene/src/mod.rs", "//! A scene of Gaussians.")]).len(), 1);
    let (code, test) = ("fn f() {}\n", "#[cfg(test)]\nmod tests {\n");
    bites(
        |sources| lengths(sources, TOO_LONG),
        "crates/image/src/lib.rs",
        &code.repeat(601),
        &(code.repeat(600) + test + &code.repeat(99)),
    );
    let [colour, harmonics] =
        ["crates/image/src/lib.rs", "crates/scene/src/sh.rs"].map(|path| move |text| Source::new(path, text));
    let twice = [colour("28209479e-8f32 + 0.25"), harmonics("[0.282_094_79, 0.28209479]")];
    assert_eq!(constants(&twice).len(), 2);
    let once = [colour("0.25 * 1_000_000.0"), harmonics("[0.25, 1_000_000, 7.654_321, 7.654_321]")];
    assert_eq!(constants(&once).len(), 0);
    let home = ["see /ho", "me/ada/x"].concat();
    bites(machine_paths, "README.md", &home, "see docs/home/x and https://a.org/home/");
    let commands = QUICK_START.join("\n");
    let readme = |commands: &str| format!("# x\n\n## Quick start\n\n```sh\n{commands}\n```\n");
    bites(quick_start, "README.md", &readme(QUICK_START[0]), &readme(&commands));
    bites(quick_start, "README.md", &readme(&commands).repeat(2), &readme(&commands));
}

/// Every file states its subject in its first line, and no file is called `mod.rs`.
fn heads(sources: &[Source]) -> Vec<Fault> {
    let faults = |source: &Source| {
        let first = source.text.lines().next().unwrap_or_default();
        let headless = !first.starts_with("//! ") || first.trim_end().len() < 10;
        let missing =
            headless.then(|| Fault::new(source, 1, "the first line should say what the file is (`//! …`)"));
        let forest = source
            .path
            .ends_with("/mod.rs")
            .then(|| Fault::new(source, 1, "`foo.rs` next to `foo/`, no `mod.rs`"));
        [missing, forest]
    };
    sources.iter().flat_map(faults).flatten().collect()
}

/// Lines of code, without unit tests, above which a file is named, and above which it is refused.
const LONG: usize = 500;
const TOO_LONG: usize = 600;

/// Files with more lines than `limit`: they are likely to hold more than one concept.
fn lengths(sources: &[Source], limit: usize) -> Vec<Fault> {
    // Blank lines and comments within the code count, since they are read too; the tests at the end
    // do not.
    let last_code = |source: &Source| {
        let lines = source.lines().filter(|(_, line)| !line.trim().is_empty());
        lines.map(|(number, _)| number).last().unwrap_or(0)
    };
    let long = sources.iter().map(|source| (source, last_code(source))).filter(|(_, lines)| *lines > limit);
    long.map(|(source, n)| Fault::new(source, n, format!("more than {limit} lines without tests"))).collect()
}

/// Numbers of seven or more significant digits that occur in two files. Within a file a table may
/// repeat one.
fn constants(sources: &[Source]) -> Vec<Fault> {
    let mut homes: BTreeMap<String, &str> = BTreeMap::new();
    let mut faults = Vec::new();
    for source in sources {
        for (number, line) in source.lines() {
            for digits in long_numbers(line) {
                let home = *homes.entry(digits.clone()).or_insert(&source.path);
                if home != source.path {
                    faults.push(Fault::new(source, number, format!("{digits} stands in {home} too")));
                }
            }
        }
    }
    faults
}

/// The numbers of a line that are too long to occur twice by chance: their digits, without point,
/// sign and exponent.
fn long_numbers(line: &str) -> Vec<String> {
    let parts = line.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == '.'));
    let numbers = parts.filter(|part| part.starts_with(|c: char| c.is_ascii_digit()));
    let mantissas = numbers.map(|number| match number.strip_prefix("0x") {
        Some(hex) => hex.to_owned(),
        None => number.split(['e', 'E', 'f', 'u', 'i']).next().unwrap_or_default().to_owned(),
    });
    let digits = mantissas.map(|text| text.replace(['_', '.'], "").trim_matches('0').to_owned());
    digits.filter(|text| text.len() >= 7).collect()
}

/// Absolute paths of the machine on which a text was written.
fn machine_paths(sources: &[Source]) -> Vec<Fault> {
    // In halves, so that this file does not find itself.
    let homes = [["/ho", "me/"], ["/ro", "ot/"], ["/Us", "ers/"], ["/wo", "rk/"], ["C:", "\\"]]
        .map(|half| half.concat());
    let mut faults = Vec::new();
    for source in sources {
        for (i, line) in source.text.lines().enumerate() {
            let named = homes.iter().find(|home| begins_path(line, home));
            faults
                .extend(named.map(|home| {
                    Fault::new(source, i + 1, format!("names a path of one machine: `{home}…`"))
                }));
        }
    }
    faults
}

/// Returns true if `line` holds `home`, except as the tail of a longer path or address.
fn begins_path(line: &str, home: &str) -> bool {
    let is_tail = |before: Option<char>| before.is_some_and(|c| c.is_alphanumeric() || "._-~/}".contains(c));
    line.match_indices(home).any(|(at, _)| !is_tail(line[..at].chars().next_back()))
}

/// The two commands that a newcomer needs. Each does all of its own set-up.
const QUICK_START: [&str; 2] =
    ["cargo run --release -- release --to out recipes/demo.yaml", "cargo run --release -- check --tree out"];

/// The README must have one section `Quick start`, with exactly these two commands.
fn quick_start(readme: &[Source]) -> Vec<Fault> {
    let text = &readme[0].text;
    let sections: Vec<&str> = text.split("\n## ").filter(|part| part.starts_with("Quick start\n")).collect();
    let [section] = sections.as_slice() else {
        return vec![Fault::new(
            &readme[0],
            1,
            format!("{} sections `## Quick start`, wanted one", sections.len()),
        )];
    };
    // The text between the fences of its code blocks: every second part.
    let blocks = section.split("```").skip(1).step_by(2);
    let commands: Vec<&str> =
        blocks.flat_map(|block| block.lines().skip(1)).filter(|line| !line.is_empty()).collect();
    if commands == QUICK_START {
        return Vec::new();
    }
    vec![Fault::new(&readme[0], 1, format!("the quick start has {commands:?}, wanted {QUICK_START:?}"))]
}
