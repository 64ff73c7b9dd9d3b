//! Patterns of paths: `**` matches any number of folders, including none; `*` matches any
//! characters of a name.

/// Returns true if the pattern matches this `/`-separated path.
pub(in crate::release) fn glob_matches(pattern: &str, path: &str) -> bool {
    let [pattern, path] = [pattern, path].map(|text| text.split('/').collect::<Vec<_>>());
    match_folders(&pattern, &path)
}

fn match_folders(pattern: &[&str], path: &[&str]) -> bool {
    match (pattern, path) {
        ([], []) => true,
        (["**", rest @ ..], _) => (0..=path.len()).any(|skipped| match_folders(rest, &path[skipped..])),
        ([first, rest @ ..], [name, below @ ..]) => match_letters(first, name) && match_folders(rest, below),
        _ => false,
    }
}

fn match_letters(pattern: &str, name: &str) -> bool {
    let Some((head, tail)) = pattern.split_once('*') else { return pattern == name };
    let Some(rest) = name.strip_prefix(head) else { return false };
    let mut starts = rest.char_indices().map(|(at, _)| at).chain([rest.len()]);
    starts.any(|at| match_letters(tail, &rest[at..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_of_whole_paths() {
        let t = |pattern: &str, good: &[&str], bad: &[&str]| {
            good.iter().for_each(|path| assert!(glob_matches(pattern, path), "{pattern} {path}"));
            bad.iter().for_each(|path| assert!(!glob_matches(pattern, path), "{pattern} {path}"));
        };
        t(
            "**/events.h5",
            &["events.h5", "a/events.h5", "a/b/c/events.h5"],
            &["a/xevents.h5", "events.h5/a", ""],
        );
        t("**/sharp/*.png", &["sharp/0.png", "a/b/sharp/.png"], &["a/sharp/b/0.png", "sharp/0.npy", "sharp"]);
        t("a*b*c", &["abc", "a1b2c", "abbcc", "aébc"], &["ab", "abcd", "a/b/c"]);
        t("index.parquet", &["index.parquet"], &["a/index.parquet", "indexAparquet"]);
    }
}
