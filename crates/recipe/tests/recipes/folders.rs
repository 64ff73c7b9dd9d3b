//! The files that are read, their order, and their defaults.

use gs2e_recipe::{OutputKind, Recipe, read_all, read_named, read_release, read_sources};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn folder(files: &[(&str, &str)]) -> TempDir {
    let root = tempfile::tempdir().expect("a folder");
    for (name, text) in files {
        let file = root.path().join(name);
        let written = std::fs::create_dir_all(file.parent().unwrap_or(root.path()))
            .and_then(|()| std::fs::write(file, text));
        written.expect("the folder can be written");
    }
    root
}

fn scene(id: &str) -> String {
    format!(
        "version: 1\nscene: {id}\nsource: {{ procedural: {{}} }}\ntrajectories: [{{ name: base, refine: {{}} }}]\n"
    )
}

fn read(root: &Path, names: &[&str]) -> Vec<Recipe> {
    let paths: Vec<PathBuf> = names.iter().map(|name| root.join(name)).collect();
    read_all(&paths).unwrap_or_else(|faults| panic!("{}", faults.render_text()))
}

/// Scene ids and seeds; the seeds show which defaults were read.
fn seeds(recipes: &[Recipe]) -> Vec<(&str, u64)> {
    recipes.iter().map(|r| (r.scene.as_str(), r.seed)).collect()
}

#[test]
fn a_recipe_takes_the_nearest_defaults_within_the_given_folder() {
    let root = folder(&[
        ("defaults.yaml", "seed: 1\n"),
        ("x.yaml", &scene("x")),
        ("sub/defaults.yaml", "sharp: { every: 2 }\n"),
        ("sub/y.yaml", &scene("y")),
        ("sub/deep/z.yaml", &scene("z")),
        ("other/w.yaml", &scene("w")),
    ]);
    let all = read(root.path(), &[""]);
    assert_eq!(seeds(&all), [("w", 1), ("x", 1), ("y", 0), ("z", 0)]);
    let every: Vec<u32> = all.iter().map(|r| r.every.poses(OutputKind::Sharp)).collect();
    assert_eq!(every, [1, 1, 2, 2]);
    // No defaults are read above the given folder; for a given file, only those in its own folder.
    assert_eq!(seeds(&read(root.path(), &["other"])), [("w", 0)]);
    assert_eq!(seeds(&read(root.path(), &["x.yaml", "other/w.yaml"])), [("w", 0), ("x", 1)]);
    assert_eq!(read(root.path(), &["sub/deep/z.yaml"])[0].every.poses(OutputKind::Sharp), 1);
}

#[test]
fn a_named_scene_is_read_without_the_others() {
    let quoted = scene("x").replace("scene: x", "scene: \"x/y\" # quoted");
    let one_line = format!("{{ {} }}", scene("x/y/z").trim_end().replace('\n', ", "));
    let root = folder(&[
        ("a.yaml", &scene("x")),
        ("b.yaml", &quoted),
        ("c.yaml", &one_line),
        ("d.yaml", &scene("w").replace("seed", "sead")),
        ("e.yaml", "version: 1\nscene: wrong\nsead: 1\n"),
    ]);
    let t = |name: &str, wanted: &[&str]| {
        let recipes = read_named(&[root.path().to_owned()], name).expect("the fault is in another recipe");
        assert_eq!(recipes.iter().map(|recipe| recipe.scene.as_str()).collect::<Vec<_>>(), wanted, "{name}");
    };
    // Only a line that states an id plainly leaves its recipe out.
    t("x", &["x", "x/y", "x/y/z"]);
    t("x/base/events", &["x", "x/y", "x/y/z"]);
    t("w/base", &["w", "x/y", "x/y/z"]);
    // The faults of all recipes are reported if no scene has the name.
    for name in ["v", "xx", "wrong"] {
        let faults = read_named(&[root.path().to_owned()], name).expect_err(name);
        assert!(faults.render_text().contains("sead"), "{name}");
    }
}

#[test]
fn order_and_names_of_files_do_not_matter() {
    let root = folder(&[("a.yaml", &scene("2")), ("b.yml", &scene("1")), ("c/d.yaml", &scene("3"))]);
    let wanted = [("1", 0), ("2", 0), ("3", 0)];
    for names in [&[""][..], &["c", "b.yml", "a.yaml"], &["a.yaml", "", "./a.yaml", "c/../c"]] {
        assert_eq!(seeds(&read(root.path(), names)), wanted, "{names:?}");
    }
}

#[test]
fn other_files_are_ignored() {
    let root = folder(&[
        ("a.yaml", &scene("a")),
        ("defaults.yaml", "seed: 5\n"),
        ("release.yaml", "name: x\n"),
        ("sources.yaml", "nonsense"),
        ("sub/release.yaml", "nonsense"),
        (".hidden.yaml", "nonsense"),
        (".git/config.yaml", "nonsense"),
        ("notes.txt", "nonsense"),
        ("x.yaml.bak", "nonsense"),
    ]);
    assert_eq!(seeds(&read(root.path(), &[""])), [("a", 5)]);
}

#[test]
fn missing_files_are_reported() {
    let root = folder(&[("empty/notes.txt", ""), ("defaults.yaml", "seed: 1\n"), ("folder.yaml/x.txt", "")]);
    let t = |name: &str, wanted: &str| {
        let faults = read_all(&[root.path().join(name)]).unwrap_err();
        let text = faults.render_text();
        assert!(text.contains(wanted) && text.contains(name), "{name}: {text}");
        assert_eq!(faults.listed()[0].position(), None);
    };
    t("absent.yaml", "cannot be read: no such file or directory");
    t("absent", "cannot be read: no such file or directory");
    t("empty", "this folder has no recipe");
    t("folder.yaml", "this folder has no recipe");
    t("defaults.yaml", "this file is not a recipe");
}

#[test]
fn a_file_too_large_is_not_read() {
    let large = format!("{}# {}\n", scene("a"), "x".repeat(1 << 20));
    let root = folder(&[("a.yaml", &large)]);
    let text = read_all(&[root.path().to_owned()]).unwrap_err().render_text();
    assert!(text.contains("wanted at most 1048576"), "{text}");
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_loops_are_refused() {
    let root = folder(&[("real/a.yaml", &scene("a"))]);
    std::os::unix::fs::symlink(root.path().join("real"), root.path().join("link")).unwrap();
    assert_eq!(seeds(&read(root.path(), &["link"])), [("a", 0)]);
    // The recipe is read once, although two paths lead to it.
    assert_eq!(seeds(&read(root.path(), &[""])), [("a", 0)]);
    std::os::unix::fs::symlink(root.path(), root.path().join("real/up")).unwrap();
    let text = read_all(&[root.path().to_owned()]).unwrap_err().render_text();
    assert!(text.contains("a link leads back"), "{text}");
}

#[test]
fn files_next_to_the_recipes_are_read() {
    let release = "name: Example\nversion: 1.2.0\nurl: https://example.org/data\ncreator: Example Lab\n\
                   date_published: 2025-05-21\ncite_as: Example (2025)\ndescription: Events.\n";
    let sources = "mvimgnet: { redistribute: allowed, because: a letter of 2025-01-01 }\n";
    let root = folder(&[("a.yaml", &scene("a")), ("release.yaml", release), ("sources.yaml", sources)]);
    for name in ["", "a.yaml"] {
        let paths = [root.path().join(name)];
        let info = read_release(&paths).unwrap();
        assert_eq!((info.name.as_str(), info.version.as_str()), ("Example", "1.2.0"));
        assert_eq!((info.creator.as_str(), info.date_published.as_str()), ("Example Lab", "2025-05-21"));
        let terms = read_sources(&paths).unwrap();
        assert_eq!(terms["mvimgnet"].because, "a letter of 2025-01-01");
        assert_eq!(terms.len(), 1);
    }
}

#[test]
fn a_release_has_default_metadata() {
    let root = folder(&[("a.yaml", &scene("a"))]);
    let info = read_release(&[root.path().to_owned()]).unwrap();
    assert_eq!((info.version.as_str(), info.date_published.as_str()), ("0.0.0", "1970-01-01"));
    assert!(read_sources(&[root.path().to_owned()]).unwrap().is_empty());
}

#[test]
fn files_of_comments_have_no_effect() {
    let nothing = "# name: later\n";
    let names = ["defaults.yaml", "release.yaml", "sources.yaml"];
    let mut files: Vec<(&str, &str)> = names.iter().map(|name| (*name, nothing)).collect();
    let a = scene("a");
    files.push(("a.yaml", &a));
    let root = folder(&files);
    let paths = [root.path().to_owned()];
    assert_eq!(seeds(&read(root.path(), &[""])), [("a", 0)]);
    assert_eq!(read_release(&paths).unwrap(), gs2e_recipe::ReleaseInfo::default());
    assert!(read_sources(&paths).unwrap().is_empty());
}

#[test]
fn one_release_has_one_name() {
    let root = folder(&[("a/release.yaml", "name: A\n"), ("b/release.yaml", "name: B\n")]);
    let paths = [root.path().join("a"), root.path().join("b")];
    let text = read_release(&paths).unwrap_err().render_text();
    assert!(text.contains("there is another one") && text.contains("a/release.yaml"), "{text}");
    assert_eq!(read_release(&[paths[0].clone(), paths[0].clone()]).unwrap().name, "A");
}
