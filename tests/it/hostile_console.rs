//! Foreign names and texts, on the terminal and in the files for readers: no part of them acts,
//! hides, or starts a line of its own. And a reliable console: lost results are an error.

use crate::support::given::{self, sound};
use crate::support::workspace::{Ended, TINY, Workspace};
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// A name that colours, sets the terminal's title, rings, turns text around and fakes a line.
const WICKED: &str = "\u{1b}[31m\u{1b}]0;PWN\u{7}\u{9b}2J\u{202e}\nerror: FAKE";

/// Returns true for characters that no output may hold: Unicode's list of bidi controls (UAX 9),
/// and all control characters but line ends.
fn acts(c: char) -> bool {
    c != '\n' && c.is_control()
        || "\u{61c}\u{200e}\u{200f}\u{202a}\u{202b}\u{202c}\u{202d}\u{202e}\u{2066}\u{2067}\u{2068}\u{2069}\u{2028}\u{2029}"
            .contains(c)
}

/// Runs the program, whose output must be inert. Arguments are separated by spaces.
#[track_caller]
fn inert(place: &Workspace, arguments: &str) -> Ended {
    let ended = place.gs2e(arguments);
    for text in [&ended.stdout, &ended.stderr] {
        assert!(!text.contains(acts), "gs2e {arguments}: {text:?}");
        assert!(!text.lines().any(|line| line.starts_with("error: FAKE")), "gs2e {arguments}: {text}");
    }
    ended
}

/// A text quoted as in recipes.
fn quoted(text: &str) -> String {
    gs2e::escape::quoted(text)
}

/// The objects that were printed.
fn objects(ended: &Ended) -> Vec<Value> {
    ended
        .stdout
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}")))
        .collect()
}

/// A release of [`TINY`] in `out`, whose files the test may change.
fn released() -> Workspace {
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
    let told = objects(&inert(&place, "plan --json recipe.yaml"));
    assert!(told.iter().any(|fault| fault.to_string().contains("PWN")), "{told:?}");
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

/// All commands that print results, over a folder in which they succeed.
const RESULTS: [&str; 14] = [
    "--version",
    "--help",
    "build --help",
    "plan tiny.yaml",
    "plan --json tiny.yaml",
    "plan --json --estimate tiny.yaml",
    "build --json tiny.yaml",
    "why tiny --recipes tiny.yaml",
    "check --recipes tiny.yaml",
    "check --json --tree out",
    "audit --json out",
    "diff --json out out",
    "gc --json --dry-run tiny.yaml",
    "release --json --no-build --to out tiny.yaml",
];

#[test]
fn lost_results_are_an_error_in_every_verb() {
    let place = released();
    for arguments in RESULTS {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = place.command(arguments).stdout(full).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "gs2e {arguments}: {stderr}");
        assert_eq!(stderr.matches("error: failed to write results to stdout").count(), 1, "{stderr}");
        assert!(stderr.contains("No space left"), "{stderr}");
    }
}

#[test]
fn a_reader_may_close_the_pipe_early() {
    let place = released();
    for arguments in RESULTS {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = place.command(arguments).stdout(writer).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "gs2e {arguments}: {stderr}");
        assert!(!stderr.contains("error") && !stderr.contains("panicked"), "gs2e {arguments}: {stderr}");
    }
}

#[test]
fn a_lost_stderr_is_no_error() {
    let place = released();
    for arguments in RESULTS {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let status = place.command(arguments).stdout(Stdio::null()).stderr(full).status().unwrap();
        assert_eq!(status.code(), Some(0), "gs2e {arguments}");
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

#[test]
fn programs_get_an_object_for_every_wrong_command_line() {
    let place = Workspace::with_tiny();
    let verbs = [
        "build",
        "plan",
        "why",
        "check",
        "release",
        "audit",
        "diff",
        "convert",
        "init",
        "gc",
        "render",
        "simulate",
        "stress",
        "study",
        "trajectory",
    ];
    let mut lines: Vec<String> = verbs.iter().map(|verb| format!("{verb} --json --no-such-option")).collect();
    lines.extend(
        [
            "--json",
            "--json frobnicate",
            "build --json -j 0",
            "why --json",
            "check --json --tree nope",
            "audit --json nope",
            "diff --json nope nope",
            "plan --json nope",
            "gc --json nope",
            "build -C nope --json",
            "stress --json nope",
        ]
        .map(str::to_owned),
    );
    for arguments in lines {
        let ended = inert(&place, &arguments);
        assert_eq!(ended.code, 2, "gs2e {arguments}: {}", ended.stderr);
        let objects = objects(&ended);
        assert_eq!(objects.len(), 1, "gs2e {arguments}: {}", ended.stdout);
        let (level, exit) = (&objects[0]["level"], &objects[0]["exit"]);
        assert_eq!((level, exit), (&"error".into(), &2.into()), "gs2e {arguments}");
        assert!(objects[0]["code"].is_string(), "gs2e {arguments}");
        let message = objects[0]["message"].as_str().unwrap();
        assert!(!message.is_empty() && !message.starts_with("error"), "gs2e {arguments}: {message}");
        assert!(!ended.stderr.is_empty(), "people are told too: gs2e {arguments}");
    }
}

#[test]
fn names_of_failed_checks_are_on_stderr() {
    let place = Workspace::new();
    place.write("tiny.yaml", TINY.to_owned() + "checks: { event_rate: { max: 0.001 } }\n");
    place.ok("build -q tiny.yaml");
    for quiet in ["", "-q "] {
        let checked = place.gs2e(&format!("check {quiet}--recipes tiny.yaml"));
        assert_eq!(checked.code, 3, "{}", checked.stderr);
        assert!(checked.stderr.contains("event_rate failed"), "{}", checked.stderr);
        assert!(checked.stdout.contains("FAIL"), "the table is the result: {}", checked.stdout);
    }
    let refused = place.gs2e("release --to out tiny.yaml");
    assert_eq!((refused.code, refused.stdout.as_str()), (3, ""), "{}", refused.stderr);
    assert!(refused.stderr.contains("error: tiny/base#rate: event_rate: "), "{}", refused.stderr);
    let refused = place.gs2e("release --json --to out tiny.yaml");
    assert!(objects(&refused).iter().any(|object| object["check"] == "event_rate"), "{}", refused.stdout);
    assert!(refused.stderr.contains("error: tiny/base#rate: event_rate: "), "{}", refused.stderr);
}

#[test]
fn numbers_are_short_and_a_sign_is_no_option() {
    let place = Workspace::new();
    place.write("tiny.yaml", TINY.replace("on: 1.0", "on: 1e300"));
    let ended = place.gs2e("plan tiny.yaml");
    assert!(ended.code == 2 && ended.stderr.contains(" is 1e300, wanted"), "{}", ended.stderr);
    for (arguments, wanted) in [
        ("build -j -1", "-1"),
        ("init colmap x --to y --limit -1", "-1"),
        ("simulate --exposure -1", "--frames"),
        ("plan -1", "-1"),
    ] {
        let ended = place.gs2e(arguments);
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        assert!(
            ended.stderr.contains(wanted) && !ended.stderr.contains("use '--"),
            "gs2e {arguments}: {}",
            ended.stderr
        );
    }
}

#[test]
fn init_writes_no_recipe_that_other_verbs_miss() {
    let place = Workspace::new();
    let names = [".hid", "defaults", "release", "sources", "usual", "a/b", "a_b"];
    for (i, name) in names.iter().enumerate() {
        let frames = given::transforms(1.0).replace("images/000", &format!("images/{i}"));
        place.write(&format!("data/{name}/transforms.json"), frames);
        place.write(&format!("data/{name}/point_cloud.ply"), given::ply(|_, value| value));
    }
    let init = "init nerfstudio data --to recipes --min-views 1 --min-side 1 --json";
    let result: Value = serde_json::from_str(&place.ok(init).stdout).unwrap();
    assert_eq!(
        (result["written"].as_array().unwrap().len(), &result["rejected"]),
        (7, &Value::Array(Vec::new()))
    );
    let noticed = result["noticed"].to_string();
    for name in [".hid", "defaults", "release", "sources", "a_b"] {
        assert!(noticed.contains(&format!("nerfstudio/{name}\"")), "{name} is said: {noticed}");
    }
    let scenes: std::collections::BTreeSet<String> = place
        .plan("recipes")
        .into_iter()
        .filter_map(|(step, _)| Some(step.strip_suffix("/capture")?.to_owned()))
        .collect();
    assert_eq!(scenes, names.map(|name| format!("nerfstudio/{name}")).into());
    let again: Value = serde_json::from_str(&place.ok(init).stdout).unwrap();
    assert_eq!((&again["kept"], again["written"].as_array().unwrap().len()), (&7.into(), 0));
}

#[test]
fn the_list_of_rejected_scenes_has_four_columns() {
    let place = Workspace::new();
    for name in ["a\tb", "a\nb", "\u{1b}[31m", "\u{202e}x"] {
        place.write(&format!("data/{name}/transforms.json"), given::transforms(1.0));
    }
    inert(&place, "init nerfstudio data --to recipes");
    let list = fs::read_to_string(place.path("recipes/rejected.tsv")).unwrap();
    assert_eq!(list.lines().count(), 5, "{list}");
    assert!(list.lines().all(|line| line.split('\t').count() == 4), "{list:?}");
    assert!(!list.replace('\t', "").contains(acts), "{list:?}");
}
