//! The texts of a release, for readers and for programs: card, datasheet and REUSE.toml state its
//! contents, and users' texts stay plain text.

use crate::release::small::release;
use crate::sources::datasets::Generator;
use crate::support::absent::not_run;
use crate::support::given;
use crate::support::workspace::{TINY, Workspace};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;

fn text(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap()
}

/// One scene from an upstream, which the releaser may pass on, and one that the program makes.
fn gated() -> Workspace {
    let place = Workspace::new();
    Generator::new().mvimgnet(&place.path("data"), 0, 1, &given::ply(|_, value| value));
    let defaults =
        "camera: { width: 32, height: 18 }\ntrajectories: [{ name: base, refine: { factor: 2 } }]\n";
    place.write(
        "recipes/defaults.yaml",
        format!(
            "{defaults}outputs: [sharp]\nlicence: {{ expression: CC-BY-4.0, holder: \"A | lab <b>\" }}\n"
        ),
    );
    place.ok("init mvimgnet data --to recipes");
    place.write("recipes/own.yaml", TINY);
    place.write("recipes/sources.yaml", "mvimgnet: { redistribute: allowed, because: a letter }\n");
    place.write(
        "recipes/release.yaml",
        "name: Example\ncontact: data@example.org\npurpose: \"to `test`\"\n\
         description: \"Two scenes.\\n\\n## Licence\\n\\nall free\"\n",
    );
    place.ok("release --to tree recipes");
    place
}

/// The answer to a question.
fn answer(sheet: &str, question: &str) -> String {
    let (_, rest) =
        sheet.split_once(&format!("**{question}**\n\n")).unwrap_or_else(|| panic!("{question}: {sheet}"));
    rest.split("\n\n**").next().unwrap().split("\n\n## ").next().unwrap().to_owned()
}

#[test]
fn unknown_answers_are_stated_as_unknown() {
    let sheet = text(release(), "DATASHEET.md");
    // The questions of the seven sections of the paper's list, in its order.
    let sections: Vec<&str> = sheet.lines().filter_map(|line| line.strip_prefix("## ")).collect();
    assert_eq!(sections.len(), 7, "{sections:?}");
    let questions = sheet.lines().filter(|line| line.starts_with("**") && line.ends_with("?**")).count();
    assert!(questions >= 50, "{questions}");
    for question in [
        "For what purpose was the dataset created?",
        "Who funded its creation?",
        "Were there ethical reviews?",
        "How can the publisher be contacted?",
    ] {
        assert_eq!(answer(&sheet, question), "Not stated by the publisher.", "{question}");
    }
    let sensitive = answer(&sheet, "Does it hold sensitive data on persons?");
    assert_eq!(sensitive, "No persons: the scenes are procedural.");
    assert!(text(release(), "README.md").contains("No contact is stated"));
}

#[test]
fn numbers_are_those_of_the_tree() {
    let sheet = text(release(), "DATASHEET.md");
    let scene: Value = serde_json::from_str(&text(release(), "small/one/scene.json")).unwrap();
    let of = |part: &Value| part["statistics"]["events"].as_u64().unwrap();
    let events: u64 = scene["trajectories"].as_array().unwrap().iter().map(of).sum();
    let pictures = |kind: &str| {
        let entries = walkdir::WalkDir::new(release()).into_iter().map(Result::unwrap);
        entries.filter(|entry| entry.path().parent().is_some_and(|folder| folder.ends_with(kind))).count()
    };
    let wanted = format!(
        "1 scenes (1 procedural) with 2 trajectories: 60 poses, {events} events in 2 streams, {} sharp frames, {} blurred \
         frames, {} depth images, {} flow images.",
        pictures("sharp"),
        pictures("blur"),
        pictures("depth"),
        pictures("flow")
    );
    assert_eq!(answer(&sheet, "How many instances are there?"), wanted);
}

#[test]
fn terms_of_an_upstream_are_stated_and_requested() {
    let place = gated();
    place.ok("audit tree");
    let tree = place.path("tree");
    let card = text(&tree, "README.md");
    let head = card.split("---\n").nth(1).unwrap();
    for line in [
        "extra_gated_heading: ",
        "extra_gated_prompt: ",
        "extra_gated_fields:\n  Name: text\n",
        "  \"I do not use it commercially\": checkbox\n",
        "configs: [{ config_name: index, data_files: index.parquet }]\n",
        "license_name: \"CC-BY-4.0 AND CC-BY-NC-4.0 AND LicenseRef-MVImgNet-ToU\"\n",
    ] {
        assert!(head.contains(line), "{line}: {head}");
    }
    assert!(!head.contains("concerns a person"), "DL3DV-10K alone asks for that: {head}");
    let sheet = text(&tree, "DATASHEET.md");
    for message in [&card, &sheet] {
        let row = message.lines().find(|line| line.starts_with("| MVImgNet |")).unwrap();
        assert!(
            row.contains("<https://github.com/GAP-LAB-CUHK-SZ/MVImgNet#license>")
                && row.ends_with("| **no** |")
        );
        assert!(message.contains("data@example.org"));
    }
    let asked = answer(&sheet, "Have third parties imposed restrictions?");
    assert!(asked.ends_with("The terms of MVImgNet could not be verified in full."), "{asked}");
    // The publisher's texts become no headings, cells or tags.
    assert_eq!(card.matches("\n## Licence\n").count(), 1, "{card}");
    assert!(card.contains("Two scenes.  ## Licence  all free\n"), "{card}");
    assert!(card.contains("A \\| lab \\<b\\>") && !card.contains("<b>"), "{card}");
    assert_eq!(
        answer(&sheet, "For what purpose was the dataset created?"),
        "The publisher: \"to \\`test\\`\""
    );
}

/// An independent check of the licences. If the tool is absent, a message goes to stderr.
#[test]
fn reuse_finds_terms_for_every_file() {
    let place = gated();
    for tree in [release().to_owned(), place.path("tree")] {
        let Ok(output) = Command::new("reuse").arg("--root").arg(&tree).arg("lint").output() else {
            return not_run("reuse is absent");
        };
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    }
}
