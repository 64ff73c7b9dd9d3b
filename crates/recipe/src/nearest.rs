//! "Did you mean": the known word nearest to an unknown word.

/// Returns the word nearest to `word` by edit distance, if it is near enough to be a typing error.
/// The first of equal words wins.
pub(super) fn nearest_word<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    // One typing error per three letters, but at least one and at most three.
    let reach = (word.chars().count() / 3).clamp(1, 3);
    let ranked = known.iter().map(|k| (edit_distance(&word.to_lowercase(), &k.to_lowercase()), *k));
    ranked.filter(|(d, _)| *d <= reach).min_by_key(|(d, _)| *d).map(|(_, k)| k)
}

/// Returns the number of insertions, deletions, substitutions and swaps of neighbours that turn one
/// word into the other (optimal string alignment).
fn edit_distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for (i, row) in rows.iter_mut().enumerate() {
        row[0] = i;
    }
    rows[0] = (0..=b.len()).collect();
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let change = usize::from(a[i - 1] != b[j - 1]);
            let mut best = (rows[i - 1][j] + 1).min(rows[i][j - 1] + 1).min(rows[i - 1][j - 1] + change);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            rows[i][j] = best;
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_known_pairs() {
        let t = |a, b, d| assert_eq!((edit_distance(a, b), edit_distance(b, a)), (d, d), "{a} {b}");
        t("", "", 0);
        t("", "abc", 3);
        t("kitten", "sitting", 3);
        t("treshold", "threshold", 1);
        t("sclae", "scale", 1);
    }

    #[test]
    fn slips_are_recognised_and_other_words_are_not() {
        let fields = ["preset", "k", "units", "threshold"];
        assert_eq!(nearest_word("treshold", &fields), Some("threshold"));
        assert_eq!(nearest_word("Units", &fields), Some("units"));
        assert_eq!(nearest_word("contrast", &fields), None);
        assert_eq!(nearest_word("", &[]), None);
    }
}
