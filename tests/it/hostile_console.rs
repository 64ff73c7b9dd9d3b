//! Foreign names and texts, on the terminal and in the files for readers: no part of them acts,
//! hides, or starts a line of its own.

use crate::support::given::{self, sound};
use crate::support::workspace::{RunOutcome, TINY, Workspace};
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// A name that colours, sets the terminal's title, rings, turns text around and fakes a line.
const WICKED: &str = "\u{1b}[31m\u{1b}]0;PWN\u{7}\u{9b}2J\u{202e}\nerror: FAKE";

/// Returns true for characters that no output may hold: Unicode's list of bidi controls (UAX 9),
/// and all control characters but line ends.
pub(crate) fn acts(c: char) -> bool {
    c != '\n' && c.is_control()
        || "\u{61c}\u{200e}\u{200f}\u{202a}\u{202b}\u{202c}\u{202d}\u{202e}\u{2066}\u{2067}\u{2068}\u{2069}\u{2028}\u{2029}"
            .contains(c)
}

/// Runs the program, whose output must be inert. Arguments are separated by spaces.
#[track_caller]
pub(crate) fn inert(place: &Workspace, arguments: &str) -> RunOutcome {
    let ended = place.gs2e(arguments);
    for text in [&ended.stdout, &ended.stderr] {
        assert!(!text.contains(acts), "gs2e {arguments}: {text:?}");
        assert!(!text.lines().any(|line| line.starts_with("error: FAKE")), "gs2e {arguments}: {text}");
    }
    ended
}

/// A text quoted as in recipes.
fn quoted(text: &str) -> String {
    gs2e_files::escape::quoted(text)
}

/// The objects that were printed.
pub(crate) fn objects(ended: &RunOutcome) -> Vec<Value> {
    ended
        .stdout
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}")))
        .collect()
}

/// A release of [`TINY`] in `out`, whose files the test may change.
pub(crate) fn released() -> Workspace {
    let place = Workspace::with_tiny();
    place.ok("release -q --copy --to out tiny.yaml");
    place
}

#[test]
fn paths_and_texts_of_recipes_are_shown_and_do_not_act() {
    let place = sound();
    let quoted = quoted(WICKED);
    let edited = given::GIVEN.replace("path: scene.ply", &format!("path: {quoted}"));
    place.write("recipe.yaml", &edited);
    for verb in ["plan", "plan --json", "build", "build --json", "why given", "release --to out"] {
        let ended = inert(
            &place,
            &format!(
                "{verb} {}",
                if verb.starts_with("why") { "--recipes recipe.yaml" } else { "recipe.yaml" }
            ),
        );
        assert_eq!(ended.code, 2, "{verb}: {}", ended.stderr);
        assert!(ended.stderr.contains(r"\u{1b}[31m"), "the name is shown: {}", ended.stderr);
    }
    // Programs get the name itself.
    let message = objects(&inert(&place, "plan --json recipe.yaml"));
    assert!(message.iter().any(|fault| fault.to_string().contains("PWN")), "{message:?}");
    for (from, to) in [
        ("scene: given", "scene: WICKED"),
        ("preset: dvs346", "preset: WICKED"),
        ("name: base", "WICKED: base"),
    ] {
        place.write("recipe.yaml", given::GIVEN.replace(from, to).replace("WICKED", &quoted));
        assert_eq!(inert(&place, "plan recipe.yaml").code, 2, "{to}");
        assert!(!objects(&inert(&place, "plan --json recipe.yaml")).is_empty());
    }
}

#[test]
fn photos_files_and_recipes_may_have_any_name() {
    let place = sound();
    let transforms = given::transforms(1.0);
    let name = serde_json::Value::from(format!("images/{WICKED}.png")).to_string();
    place.write("transforms.json", transforms.replace("\"images/000.png\"", &name));
    inert(&place, "build recipe.yaml");
    inert(&place, "check --recipes recipe.yaml");
    place.write("transforms.json", transforms);
    for kind in ["yaml", "csv", "ply"] {
        let file = format!("{WICKED}.{kind}");
        place.write(&format!("data/{file}"), "not what it says");
        for before in [
            vec!["plan"],
            vec!["plan", "--json"],
            vec!["convert", "--json"],
            vec!["audit"],
            vec!["diff", "x"],
        ] {
            let after = if before[0] == "convert" { vec!["out.h5"] } else { Vec::new() };
            let mut command = place.command("");
            command.args(before).arg(place.path("data").join(&file)).args(after);
            let output = command.output().unwrap();
            for text in [output.stdout, output.stderr] {
                let text = String::from_utf8(text).unwrap();
                assert!(!text.contains(acts) && !text.contains("\nerror: FAKE"), "{text:?}");
            }
        }
    }
    assert_eq!(inert(&place, "plan data").code, 2);
}

#[test]
fn foreign_releases_are_shown_and_do_not_act() {
    let place = released();
    fs::write(place.path("out").join(WICKED.replace('/', "_")), "x").unwrap();
    let audited = inert(&place, "audit out");
    assert_eq!(audited.code, 3);
    assert!(audited.stderr.contains(r"\nerror: FAKE"), "{}", audited.stderr);
    assert!(objects(&inert(&place, "audit --json out")).len() > 1);
    // An id in the other manifest.
    place.ok("release -q --copy --to other tiny.yaml");
    for file in ["manifest.json", "tiny/scene.json"] {
        let text = fs::read_to_string(place.path("other").join(file)).unwrap();
        let wicked = serde_json::Value::from(WICKED).to_string();
        fs::write(place.path("other").join(file), text.replace("\"tiny\"", &wicked)).unwrap();
    }
    for verb in
        ["diff out other", "diff --json out other", "check --tree other", "audit other", "audit --json other"]
    {
        inert(&place, verb);
    }
    // Texts of checks.
    let checks = place.path("out/tiny/base/checks.json");
    let text = fs::read_to_string(&checks).unwrap();
    let because = serde_json::from_str::<Value>(&text)
        .unwrap()
        .to_string()
        .replace("pass", &WICKED.escape_default().to_string());
    fs::write(&checks, because).unwrap();
    for verb in ["check --tree out", "audit out"] {
        inert(&place, verb);
    }
}

#[test]
fn words_of_the_command_line_do_not_act() {
    let place = Workspace::new();
    for words in [
        vec![WICKED],
        vec!["build", "--WICKED"],
        vec!["build", "-j", WICKED],
        vec!["gc", "--min-age", WICKED],
        vec!["why", WICKED],
    ] {
        for json in [false, true] {
            let mut command = place.command("");
            command.args(words.iter().map(|word| word.replace("WICKED", WICKED)));
            if json {
                command.arg("--json");
            }
            let output = command.output().unwrap();
            assert_eq!(output.status.code(), Some(2));
            for text in [output.stdout, output.stderr] {
                let text = String::from_utf8(text).unwrap();
                assert!(!text.contains(acts) && !text.contains("\nerror: FAKE"), "{words:?}: {text:?}");
            }
        }
    }
}

#[test]
fn the_card_holds_only_our_markup() {
    let place = Workspace::with_tiny();
    place.ok("release -q --to plain tiny.yaml");
    let outline = |card: &str| -> Vec<String> {
        let marks = ["#", "~~~", "```", "---", "===", "|---"];
        card.lines()
            .filter(|line| marks.iter().any(|mark| line.starts_with(mark)))
            .map(str::to_owned)
            .collect()
    };
    let usual = fs::read_to_string(place.path("plain/README.md")).unwrap();
    for wicked in [
        "~~~",
        "```",
        "# X",
        "## Licence",
        "- x",
        "1. x",
        "=== x",
        "--- ",
        "<!--",
        "a\r# X\r\n# Y",
        "\u{1b}[31m\u{202e}\u{9b}x\u{7f}\u{2028}# Z",
    ] {
        let quoted = quoted(wicked);
        place.write("release.yaml", format!("description: {quoted}\ncite_as: {quoted}\nname: {quoted}\ncreator: {quoted}\ncontact: {quoted}\npurpose: {quoted}\n"));
        place.ok("release -q --to out tiny.yaml");
        place.ok("audit -q out");
        for (name, text) in ["README.md", "DATASHEET.md", "REUSE.toml", "report.html"]
            .map(|name| (name, fs::read_to_string(place.path("out").join(name)).unwrap()))
        {
            let acting: String = text.chars().filter(|c| acts(*c)).collect();
            assert_eq!(acting, "", "{name} of {wicked:?}");
        }
        let card = fs::read_to_string(place.path("out/README.md")).unwrap();
        let (before, after) = (outline(&usual), outline(&card));
        assert_eq!(before.len(), after.len(), "{wicked:?}: {after:?}");
        let differing: Vec<_> = before.iter().zip(&after).filter(|(a, b)| a != b).collect();
        assert!(differing.len() <= 1, "only the title differs: {differing:?}");
        // A YAML reader finds the written text in the card's head.
        let head = card.split("---\n").nth(1).unwrap();
        let head: Value = serde_saphyr::from_str(head).unwrap_or_else(|e| panic!("{wicked:?}: {e}\n{head}"));
        assert_eq!(head["pretty_name"], wicked);
    }
}

#[test]
fn addresses_of_other_schemes_are_refused() {
    let place = Workspace::with_tiny();
    for url in
        ["javascript:alert(1)", "data:text/html,x", "https://a>b", "https://a\u{202e}b", "file:///etc/passwd"]
    {
        place.write("release.yaml", format!("url: {}\n", quoted(url)));
        let ended = inert(&place, "release --to out tiny.yaml");
        assert_eq!(ended.code, 2, "{url}: {}", ended.stderr);
        assert!(ended.stderr.contains("wanted an address (http, https or doi)"), "{}", ended.stderr);
    }
}

/// Runs the program in `folder`. In `words`, `\xff` means this byte.
fn run_in(folder: &Path, words: &str) -> (Option<i32>, String, String) {
    let words = words.split(' ').map(|word| OsString::from(OsStr::from_bytes(&unescaped(word))));
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
    let output = command.args(words).current_dir(folder).stdin(Stdio::null()).output().unwrap();
    let [stdout, stderr] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    (output.status.code(), stdout, stderr)
}

fn unescaped(word: &str) -> Vec<u8> {
    let mut parts = word.split(r"\xff");
    let first = parts.next().unwrap().as_bytes().to_vec();
    parts.fold(first, |mut bytes, part| {
        bytes.push(0xff);
        bytes.extend(part.as_bytes());
        bytes
    })
}

#[test]
fn paths_that_are_not_utf8_work_in_every_verb() {
    let place = sound();
    let odd = place.path("").join(OsStr::from_bytes(b"x\xff"));
    fs::create_dir_all(odd.join("data/one")).unwrap();
    place.write("tiny.yaml", TINY);
    for file in ["tiny.yaml", "recipe.yaml", "scene.ply", "transforms.json"] {
        fs::copy(place.path(file), odd.join(file)).unwrap();
    }
    fs::copy(place.path("transforms.json"), odd.join("data/one/transforms.json")).unwrap();
    fs::write(odd.join("few.csv"), "t,x,y,p\n1,0,0,1\n").unwrap();
    let view = serde_json::json!({ "W": 8, "H": 8, "fx": 8.0, "fy": 8.0, "cx": 4.0, "cy": 4.0, "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0, 0, 4] });
    fs::write(odd.join("view.json"), view.to_string()).unwrap();
    for json in ["", " --json"] {
        for words in [
            r"plan --store x\xff/.gs2e x\xff/tiny.yaml",
            r"build --store x\xff/.gs2e x\xff/tiny.yaml",
            r"build -C x\xff tiny.yaml",
            r"why tiny --store x\xff/.gs2e --recipes x\xff/tiny.yaml",
            r"check --store x\xff/.gs2e --recipes x\xff/tiny.yaml",
            r"release --store x\xff/.gs2e --to x\xff/out x\xff/tiny.yaml",
            r"release -C x\xff --to other tiny.yaml",
            r"audit x\xff/out",
            r"check --tree x\xff/out",
            r"diff x\xff/out x\xff/out",
            r"gc --store x\xff/.gs2e x\xff/tiny.yaml",
            r"convert --lossy --size 8x8 x\xff/few.csv x\xff/few.h5",
            r"convert --size 8x8 x\xff/few.csv x\xff/few.png",
            r"convert --lossy x\xff/scene.ply x\xff/scene.splat",
            r"render --scene x\xff/scene.ply --view x\xff/view.json --out x\xff/seen.png",
            r"trajectory --capture x\xff/transforms.json --recipe x\xff/recipe.yaml --name base --out x\xff/poses.txt --report x\xff/speed.json",
            r"simulate --frames x\xff/other/tiny/base/sharp --fps 2400 --sensor dvs346 --out x\xff/sim.h5",
            r"init nerfstudio x\xff/data --to x\xff/recipes --min-views 1 --min-side 1",
        ] {
            let (code, stdout, stderr) = run_in(&place.path(""), &format!("{words}{json}"));
            assert_eq!(code, Some(0), "gs2e {words}{json}: {stderr}");
            for line in stdout.lines().filter(|_| !json.is_empty()) {
                serde_json::from_str::<Value>(line).unwrap_or_else(|e| panic!("{words}: {e}: {line}"));
            }
        }
    }
    // The paths are printed byte for byte.
    let (_, stdout, _) = run_in(&place.path(""), r"plan --json --store x\xff/.gs2e x\xff/tiny.yaml");
    assert!(stdout.contains(r"x\\xff/.gs2e/"), "{stdout}");
    let (_, _, stderr) = run_in(&place.path(""), r"plan x\xff/gone.yaml");
    assert!(stderr.contains(r"x\xff/gone.yaml"), "{stderr}");
    // `gc` keeps the inputs of the release, and deletes them when the release is gone.
    let gc = r"gc --json --min-age 0 --store x\xff/.gs2e recipe.yaml";
    let other = TINY.replace("gaussians: 500, views: 6", "gaussians: 400, views: 7");
    place.write("recipe.yaml", other.replace("scene: tiny", "scene: other"));
    let kept = |gc: &str| -> Value {
        let (code, stdout, stderr) = run_in(&place.path(""), gc);
        assert_eq!(code, Some(0), "{stderr}");
        serde_json::from_str(&stdout).unwrap()
    };
    assert_ne!(kept(gc)["kept_blobs"], 0);
    fs::remove_dir_all(odd.join("out")).unwrap();
    fs::remove_dir_all(odd.join("other")).unwrap();
    assert_eq!(kept(gc)["kept_blobs"], 0);
}
