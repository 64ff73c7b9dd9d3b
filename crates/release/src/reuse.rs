//! `REUSE.toml`: holders and terms of every file, in the form of the REUSE specification, version
//! 3.3, so that `reuse lint` passes. It is composed from `scene.json` alone, and an audit composes
//! it again.

use super::loader;
use super::scene::SceneRecord;
use gs2e_files::escape::quoted;
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// Name of the file.
pub const NAME: &str = "REUSE.toml";

/// Holder of a scene that states none.
const NOT_STATED: &str = "not stated";

/// Composes the file. If several entries match a file, the last one counts. What files say of
/// themselves never counts, since texts of users stand in them.
pub fn compose_reuse(scenes: &[&SceneRecord], whole: &str) -> String {
    let mut text = String::from("version = 1\n");
    let everybody: BTreeSet<&str> = scenes.iter().flat_map(|scene| scene_holders(scene)).collect();
    // From the whole to the parts, since the last match counts.
    write_annotation(&mut text, "**", &everybody, whole);
    for scene in scenes {
        write_annotation(
            &mut text,
            &format!("{}/**", scene.id),
            &scene_holders(scene).collect(),
            &scene.licence.expression,
        );
    }
    write_annotation(&mut text, loader::NAME, &BTreeSet::from([loader::HOLDER]), loader::LICENCE);
    text
}

fn scene_holders(scene: &SceneRecord) -> impl Iterator<Item = &str> {
    scene.licence.parts.iter().map(|part| part.attribution.as_str()).filter(|name| !name.is_empty())
}

fn write_annotation(text: &mut String, path: &str, holders: &BTreeSet<&str>, expression: &str) {
    let unstated = BTreeSet::from([NOT_STATED]);
    let holders = if holders.is_empty() { &unstated } else { holders };
    let holders: Vec<String> = holders.iter().map(|holder| quoted(holder)).collect();
    let _ = write!(
        text,
        "\n[[annotations]]\npath = {}\nprecedence = \"override\"\nSPDX-FileCopyrightText = [{}]\n\
         SPDX-License-Identifier = {}\n",
        quoted(path),
        holders.join(", "),
        quoted(expression)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_users_stay_texts() {
        assert_eq!(quoted("a \"lab\"\n\u{7f}"), r#""a \"lab\"\n\u007f""#);
        let mut text = String::new();
        write_annotation(&mut text, "a/**", &BTreeSet::new(), "MIT");
        assert!(text.contains("SPDX-FileCopyrightText = [\"not stated\"]\n"), "{text}");
    }
}
