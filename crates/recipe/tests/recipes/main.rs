//! Recipes: their meaning, and the messages about faulty ones.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod folders;
mod meaning;
mod mutations;
mod paths;

use gs2e_recipe::{Recipe, RecipeFaults, RecipeMeta, read_all, read_release, read_sources};
use std::path::{Path, PathBuf};

const FIXTURES: &str = "tests/fixtures/recipes";

/// Reads a file of the crate, where tests run. Messages show its path as given.
fn read(path: &str) -> Result<Vec<Recipe>, RecipeFaults> {
    read_all(&[PathBuf::from(path)])
}

/// Reads the only recipe of a text, from a folder of its own.
fn recipe(yaml: &str) -> Result<Recipe, RecipeFaults> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("recipe.yaml");
    std::fs::write(&file, yaml).expect("the folder can be written");
    let mut recipes = read_all(&[file])?;
    assert_eq!(recipes.len(), 1, "one file is one recipe");
    Ok(recipes.remove(0))
}

/// A sound recipe, with the lines `more` appended.
fn sound(more: &str) -> Recipe {
    let yaml = format!(
        "version: 1\nscene: test\nsource: {{ procedural: {{}} }}\n\
         trajectories: [{{ name: base, refine: {{}} }}]\n{more}\n"
    );
    recipe(&yaml).unwrap_or_else(|faults| panic!("{}", faults.render_text()))
}

/// The recipe without its file names, so that recipes can be compared by meaning.
fn said(recipe: Recipe) -> Recipe {
    let meta = RecipeMeta { merged: recipe.meta.merged.clone(), ..RecipeMeta::default() };
    Recipe { meta, ..recipe }
}

fn snapshot(name: &str, text: &str) {
    let mut settings = insta::Settings::clone_current();
    settings.set_snapshot_path(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/snapshots/recipes"));
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| insta::assert_snapshot!(name, text));
}

/// The names in a folder, sorted.
fn names(folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{folder}: {e}"));
    let names = entries.map(|entry| entry.expect("the folder can be read").file_name());
    let mut names: Vec<String> = names.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn each_broken_recipe_has_its_message() {
    for name in names(FIXTURES).iter().filter(|name| *name != "beside-bad") {
        let faults = match read(&format!("{FIXTURES}/{name}")) {
            Ok(_) => panic!("{name} is not refused"),
            Err(faults) => faults,
        };
        snapshot(name.trim_end_matches(".yaml"), &faults.render_text());
    }
}

#[test]
fn broken_files_next_to_recipes_have_their_messages() {
    let paths = [PathBuf::from(format!("{FIXTURES}/beside-bad"))];
    let [release, sources] = [read_release(&paths).unwrap_err(), read_sources(&paths).unwrap_err()];
    snapshot("beside-bad", &format!("{}\n{}", release.render_text(), sources.render_text()));
}

#[test]
fn the_example_of_the_specification_has_its_message() {
    // The first row of the table of messages: position, caret, and help.
    let faults = read(&format!("{FIXTURES}/unknown-field.yaml")).unwrap_err();
    let first = faults.listed()[0].render_lines().join("\n");
    let wanted = "error: unknown field \"treshold\"\n tests/fixtures/recipes/unknown-field.yaml:14:5\n\
                  14 │     treshold: { on: 1.0 }\n   │     ^^^^^^^^\n\
                  help: did you mean \"threshold\"? fields here: preset, k, units, threshold";
    assert!(first.starts_with(wanted), "{first}");
}

#[test]
fn faults_as_json_match_the_text() {
    let faults = read(&format!("{FIXTURES}/unknown-field-top.yaml")).unwrap_err();
    let lines: Vec<String> = faults.to_json().iter().map(ToString::to_string).collect();
    snapshot("json", &lines.join("\n"));
    for fault in faults.listed() {
        let (line, column) = fault.position().unwrap();
        assert_eq!(fault.to_json()["line"], line);
        assert_eq!(fault.to_json()["column"], column);
    }
}

#[test]
fn a_long_list_is_cut_and_counted() {
    let faults = read(&format!("{FIXTURES}/many.yaml")).unwrap_err();
    assert_eq!((faults.listed().len(), faults.more()), (20, 5));
}
