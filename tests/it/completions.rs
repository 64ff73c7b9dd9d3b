//! `gs2e completions` and `gs2e schema`: texts for shells and editors.

use crate::support::workspace::Workspace;
use serde_json::Value;
use std::io::Write as _;
use std::process::{Command, Stdio};

#[test]
fn every_verb_is_completed() {
    let place = Workspace::new();
    let verbs: Vec<String> =
        gs2e::cli::command_line().get_subcommands().map(|verb| verb.get_name().to_owned()).collect();
    assert!(verbs.len() > 15);
    for shell in ["bash", "zsh", "fish"] {
        let script = place.ok(&format!("completions {shell}")).stdout;
        for verb in &verbs {
            assert!(script.contains(verb.as_str()), "{shell} does not know {verb}");
        }
    }
    assert_eq!(place.gs2e("completions tcsh").code, 2);
}

/// Bash parses its script; an editor that loads it must not fail.
#[test]
fn bash_reads_its_completions() {
    let script = Workspace::new().ok("completions bash").stdout;
    let bash = Command::new("bash").arg("-n").stdin(Stdio::piped()).spawn();
    let mut bash = bash.expect("bash is there, since CI is a script of it");
    bash.stdin.take().unwrap().write_all(script.as_bytes()).unwrap();
    assert!(bash.wait().unwrap().success());
}

#[test]
fn the_schema_has_the_words_of_the_reference() {
    let schema: Value = serde_json::from_str(&Workspace::new().ok("schema").stdout).unwrap();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    let width = &schema["$defs"]["CameraSection"]["properties"]["width"];
    assert_eq!(width["description"], "Width of the image. Unit: px. Default: required without `size`.");
    assert_eq!(schema["$defs"]["HotPixelsSection"]["required"][0], "share");
    assert_eq!(schema["properties"]["sampling"]["default"], serde_json::json!({}));
}
