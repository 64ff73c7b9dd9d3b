//! Names of recipe files: one per scene, visible to every walk over recipes, and equal in every
//! run.

use gs2e_files as files;
use gs2e_recipe::draft;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Names with a special meaning in a folder of recipes.
const MEANT: [&str; 3] = ["defaults", "release", "sources"];

/// A recipe file. `because` is the reason if its name is not that of the scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct FileName {
    pub(super) path: PathBuf,
    pub(super) because: Option<String>,
}

/// Assigns recipe files in `folder` to scenes, which are given as (id, id below the prefix). If
/// several scenes would share a file, the scene that the file on disk names keeps it; without a
/// file, the first scene gets it.
pub(super) fn assign(folder: &Path, scenes: &[(&str, &str)]) -> Vec<FileName> {
    let mut groups: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (i, (_, name)) in scenes.iter().enumerate() {
        // Some file systems do not distinguish `A.yaml` from `a.yaml`.
        groups.entry(stem(name).to_ascii_lowercase()).or_default().push(i);
    }
    let plain = |i: usize| folder.join(format!("{}.yaml", stem(scenes[i].1)));
    let names_it = |i: &&usize| draft::scene_of(&plain(**i)).as_deref() == Some(scenes[**i].0);
    let mut files = vec![None; scenes.len()];
    for (stem, group) in &groups {
        let because = unsafe_because(stem);
        let owners = if because.is_some() {
            Vec::new()
        } else if group.len() == 1 || group.iter().all(|i| !files::is_there(&plain(*i))) {
            // A scene without a rival keeps its file, whatever a person wrote into it.
            vec![group[0]]
        } else {
            // A file that exists and names none of these scenes has no owner: all of them get
            // marked names.
            group.iter().filter(names_it).copied().collect()
        };
        for i in group {
            let because = (!owners.contains(i))
                .then(|| format!("{stem}.yaml {}", because.unwrap_or("belongs to another scene")));
            let (scene, name) = scenes[*i];
            let path = if because.is_some() { marked(folder, scene, name) } else { plain(*i) };
            files[*i] = Some(FileName { path, because });
        }
    }
    files.into_iter().flatten().collect()
}

/// The name of a recipe file. Recipes lie in one folder, so that its defaults apply to all of them,
/// however `build` is called.
fn stem(name: &str) -> String {
    name.replace('/', "_")
}

fn unsafe_because(stem: &str) -> Option<&'static str> {
    if stem.starts_with('.') {
        Some("would be hidden from all verbs")
    } else if MEANT.contains(&stem) {
        Some("is a reserved file name")
    } else {
        None
    }
}

/// A file marked with digits of the scene: the first 8 of the SHA-256 of its id.
fn marked(folder: &Path, scene: &str, name: &str) -> PathBuf {
    let digest = Sha256::digest(scene);
    let digits: String = digest.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
    folder.join(format!("{}-{digits}.yaml", stem(name).trim_start_matches('.')))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn names(folder: &Path, scenes: &[(&str, &str)]) -> Vec<String> {
        let files = assign(folder, scenes);
        files.iter().map(|file| file.path.file_name().unwrap().to_str().unwrap().to_owned()).collect()
    }

    #[test]
    fn usual_names_are_the_scenes_own() {
        let folder = Path::new("r");
        let files = assign(folder, &[("c/one", "one"), ("c/more/two", "more/two")]);
        let paths: Vec<&Path> = files.iter().map(|file| file.path.as_path()).collect();
        assert_eq!(paths, [Path::new("r/one.yaml"), Path::new("r/more_two.yaml")]);
        assert!(files.iter().all(|file| file.because.is_none()));
    }

    /// `printf c/.hid | sha256sum`, and so on.
    #[test]
    fn names_with_a_meaning_are_marked() {
        let scenes = [("c/.hid", ".hid"), ("c/defaults", "defaults"), ("c/Release", "Release")];
        let files = assign(Path::new("r"), &scenes);
        let found = names(Path::new("r"), &scenes);
        assert_eq!(found, ["hid-16e070ed.yaml", "defaults-1f03d7b6.yaml", "Release-5182808e.yaml"]);
        assert!(files[0].because.as_ref().unwrap().contains("hidden"), "{files:?}");
    }

    #[test]
    fn two_scenes_never_share_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let scenes = [("c/a/b", "a/b"), ("c/a_b", "a_b"), ("c/A_b", "A_b")];
        let fresh = names(folder.path(), &scenes);
        assert_eq!(fresh[0], "a_b.yaml");
        let lower: BTreeSet<String> = fresh.iter().map(|name| name.to_ascii_lowercase()).collect();
        assert_eq!(lower.len(), 3, "{fresh:?}");
        // An existing file stays with the scene that it names, whichever scene comes first.
        std::fs::write(folder.path().join("a_b.yaml"), "version: 1\nscene: \"c/a_b\"\n").unwrap();
        let again = names(folder.path(), &scenes);
        assert_eq!(again[1], "a_b.yaml");
        assert_ne!(again[0], "a_b.yaml");
        assert_eq!(again[2], fresh[2]);
        // A file that names neither scene stays as it is.
        std::fs::write(folder.path().join("a_b.yaml"), "version: 1\nscene: other\n").unwrap();
        assert!(!names(folder.path(), &scenes).contains(&"a_b.yaml".to_owned()));
    }
}
