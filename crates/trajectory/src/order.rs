//! The order of views along the path.

use super::metric::MixedMetric;
use super::refine::ViewOrder;
use super::{NamedPose, TrajectoryError};
use std::cmp::Ordering;

/// Natural order of file names: runs of digits compare as numbers, everything else byte by byte.
/// Names that differ only in leading zeros compare by their bytes, so the order is total.
#[must_use]
pub(crate) fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let (Some(p), Some(q)) = (x.first(), y.first()) {
        let order = if p.is_ascii_digit() && q.is_ascii_digit() {
            compare_numbers(take_digits(&mut x), take_digits(&mut y))
        } else {
            (x, y) = (&x[1..], &y[1..]);
            p.cmp(q)
        };
        if order.is_ne() {
            return order;
        }
    }
    // A name that is a prefix of the other comes first. Here the names are equal except for leading
    // zeros, so the bytes decide.
    x.len().cmp(&y.len()).then_with(|| a.cmp(b))
}

fn take_digits<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(|b| !b.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    digits
}

fn compare_numbers(a: &[u8], b: &[u8]) -> Ordering {
    let significant =
        |digits: &[u8]| digits.iter().position(|d| *d != b'0').map_or(0, |zeros| digits.len() - zeros);
    let (n, m) = (significant(a), significant(b));
    // Without leading zeros the longer number is the larger one. Comparing digits needs no parse
    // that could overflow.
    n.cmp(&m).then_with(|| a[a.len() - n..].cmp(&b[b.len() - m..]))
}

/// The views in the natural order of their names.
///
/// # Errors
/// Two views have the same name.
pub(super) fn by_name<'a>(views: &[NamedPose<'a>]) -> Result<Vec<NamedPose<'a>>, TrajectoryError> {
    let mut sorted = views.to_vec();
    sorted.sort_by(|a, b| natural_order(a.name, b.name));
    // Equal names are neighbours after the sort.
    match sorted.windows(2).find(|w| w[0].name == w[1].name) {
        Some(w) => Err(TrajectoryError::SameName { name: w[0].name.to_owned() }),
        None => Ok(sorted),
    }
}

/// Rearranges views that are sorted by name. `Nearest` is greedy from the first name, and ties go
/// to the earlier name; its time is quadratic in the number of views.
pub(super) fn arrange_views(views: &mut [NamedPose<'_>], order: ViewOrder, metric: MixedMetric) {
    if order == ViewOrder::Name {
        return;
    }
    for i in 1..views.len() {
        let here = views[i - 1].world_from_camera;
        let distance = |v: &NamedPose<'_>| metric.distance(&here, &v.world_from_camera);
        // The swap below leaves the rest out of order, so a tie is decided by name and not by
        // index.
        let nearest = (i..views.len()).min_by(|a, b| {
            distance(&views[*a])
                .total_cmp(&distance(&views[*b]))
                .then_with(|| natural_order(views[*a].name, views[*b].name))
        });
        views.swap(i, nearest.unwrap_or(i));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digit_runs_compare_as_numbers() {
        let t = |names: &[&str]| {
            for (i, a) in names.iter().enumerate() {
                for (j, b) in names.iter().enumerate() {
                    assert_eq!(natural_order(a, b), i.cmp(&j), "{a} {b}");
                }
            }
        };
        t(&["1.jpg", "2.jpg", "10.jpg", "100.jpg"]);
        t(&["", "a", "a1", "a1b", "a2", "a10", "b"]);
        t(&["001.jpg", "01.jpg", "1.jpg", "2.jpg"]);
        t(&["frame_00009.png", "frame_00010.png", "frame_99999.png", "frame_100000.png"]);
        t(&[
            "f9999999999999999999999999999998",
            "f9999999999999999999999999999999",
            "f10000000000000000000000000000000",
        ]);
        t(&["a/2.png", "a/10.png", "b/1.png"]);
        t(&["x0", "x00", "x0a"]);
    }
}
