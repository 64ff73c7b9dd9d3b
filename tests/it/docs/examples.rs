//! Examples of the pages: the loader reads the recipes, and the command line parses the commands.

use super::markdown::{Page, commands};
use super::{pages, probe};
use crate::support::repository::text_of;
use crate::support::workspace::Workspace;
use gs2e_recipe as recipe;
use serde_json::{Value, json};

/// Keys of `release.yaml` that no recipe has.
const OF_A_RELEASE: [&str; 3] = ["splits", "creator", "include"];
/// Kinds of source, the keys of `sources.yaml`.
const SOURCES: [&str; 5] = ["colmap", "mvimgnet", "dl3dv", "nerfstudio", "model"];

#[test]
fn every_block_of_yaml_is_read() {
    let mut count = 0;
    for path in pages() {
        let page = Page::parse(&text_of(&path));
        for block in page.blocks_in(&["yaml"]) {
            read(&block.text).unwrap_or_else(|e| panic!("{path}:{}: {e}", block.line));
            count += 1;
        }
    }
    assert!(count > 10, "only {count} blocks of YAML were found");
}

fn read(text: &str) -> Result<(), String> {
    let value = probe::yaml(text)?;
    let has = |key: &str| value.get(key).is_some();
    let place = Workspace::new();
    if OF_A_RELEASE.iter().any(|key| has(key)) {
        place.write("release.yaml", text);
        return recipe::read_release(&[place.path("")]).map(drop).map_err(|faults| faults.render_text());
    }
    if SOURCES.iter().any(|key| has(key)) {
        place.write("sources.yaml", text);
        return recipe::read_sources(&[place.path("")]).map(drop).map_err(|faults| faults.render_text());
    }
    // A whole recipe is read verbatim, so that a fault shows its own line.
    let text = if has("version") && has("scene") { text.to_owned() } else { completed(value).to_string() };
    place.write("recipe.yaml", text);
    recipe::read_all(&[place.path("recipe.yaml")]).map(drop).map_err(|faults| faults.render_text())
}

/// Completes a fragment with the smallest recipe that it can be part of.
fn completed(fragment: Value) -> Value {
    let trains = fragment.get("reconstruct").is_some();
    let captured = fragment.get("source").is_some_and(Value::is_object);
    let upstream = fragment.pointer("/licence/upstream").is_some();
    let mut recipe = probe::context("");
    if trains {
        recipe["source"] = json!({ "colmap": { "path": "capture" } });
    }
    if upstream {
        recipe["source"] = json!({ "mvimgnet": { "path": "capture" } });
    }
    if (captured || upstream) && !trains {
        recipe["reconstruct"] = json!({ "given": { "path": "scene.ply" } });
    }
    probe::merge(&mut recipe, fragment);
    recipe
}

#[test]
fn every_command_is_parsed() {
    let mut count = 0;
    for path in pages() {
        let page = Page::parse(&text_of(&path));
        for block in page.blocks_in(&["sh"]) {
            for words in commands(&block.text).into_iter().filter(|words| words[0] == "gs2e") {
                let parsed = gs2e::cli::command_line().try_get_matches_from(&words);
                assert!(
                    parsed.is_ok(),
                    "{path}:{}: {}\n{}",
                    block.line,
                    words.join(" "),
                    parsed.unwrap_err()
                );
                count += 1;
            }
        }
    }
    assert!(count > 15, "only {count} commands were found");
}
