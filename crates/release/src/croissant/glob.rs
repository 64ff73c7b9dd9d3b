//! Patterns of paths: `**` matches any number of folders, including none; `*` matches any
//! characters of a name.

/// Returns true if the pattern matches this `/`-separated path. The time is at most the product of the
/// lengths: patterns come from the releases of others.
pub fn glob_matches(pattern: &str, path: &str) -> bool {
    let [pattern, path] = [pattern, path].map(|text| text.split('/').collect::<Vec<_>>());
    match_with_stars(&pattern, &path, |folder| *folder == "**", |folder, name| match_name(folder, name))
}

fn match_name(pattern: &str, name: &str) -> bool {
    let [pattern, name] = [pattern, name].map(|text| text.chars().collect::<Vec<_>>());
    match_with_stars(&pattern, &name, |letter| *letter == '*', |letter, other| letter == other)
}

/// Matches a pattern in which a star covers any number of elements, and every other part one.
///
/// Only the last star is widened. An earlier one need not be: a wider one would leave less of the text
/// for the later star, which takes whatever is left.
fn match_with_stars<P, T>(
    pattern: &[P],
    text: &[T],
    is_star: impl Fn(&P) -> bool,
    matches: impl Fn(&P, &T) -> bool,
) -> bool {
    let (mut p, mut t) = (0, 0);
    // Place after the last star, and the first element that it does not cover yet.
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        if pattern.get(p).is_some_and(&is_star) {
            p += 1;
            star = Some((p, t));
        } else if pattern.get(p).is_some_and(|part| matches(part, &text[t])) {
            (p, t) = (p + 1, t + 1);
        } else if let Some((after, covered)) = star {
            (p, t) = (after, covered + 1);
            star = Some((after, t));
        } else {
            return false;
        }
    }
    pattern[p..].iter().all(is_star)
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
        t("**/a/**/b", &["a/b", "x/a/a/y/b", "a/b/b"], &["a", "b/a", "a/b/c"]);
        t("index.parquet", &["index.parquet"], &["a/index.parquet", "indexAparquet"]);
    }

    /// A pattern for which a matcher that tries every length of every star takes years.
    #[test]
    fn hostile_patterns_take_no_time() {
        let (letters, stars) = ("a".repeat(60_000), "a*".repeat(5_000));
        assert!(!glob_matches(&format!("{stars}b"), &letters));
        assert!(glob_matches(&stars, &letters));
        assert!(!glob_matches(&format!("{}b", "**/".repeat(5_000)), &"a/".repeat(5_000)));
    }
}
