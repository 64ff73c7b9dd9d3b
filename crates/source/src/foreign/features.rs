//! Matching of key points: COLMAP's descriptors and COLMAP's own rule, applied to all pairs.
//!
//! COLMAP 3.8 searches for neighbours with randomised trees whose seed cannot be set, so its
//! matches differ from run to run. Here the two nearest descriptors are found exactly. The angle
//! between descriptors is at most 0.7 rad and at most 0.8 times the angle to the second nearest,
//! and both key points choose each other.

use rayon::prelude::*;
use rusqlite::{Connection, OpenFlags};
use std::fmt::Write as _;
use std::path::Path;

/// Number of elements of a descriptor.
const LENGTH: usize = 128;
/// Square of the length to which descriptors are scaled before rounding.
const SQUARE: f64 = 512.0 * 512.0;
/// COLMAP's defaults, `SiftMatching.max_distance` and `SiftMatching.max_ratio`.
const MAX_ANGLE: f64 = 0.7;
const MAX_RATIO: f64 = 0.8;

/// The key points of a picture.
pub(super) struct DescribedKeyPoints {
    name: String,
    /// Elements have 16 bits, because processors multiply and add pairs of them in one instruction.
    descriptors: Vec<[i16; LENGTH]>,
}

/// Reads the pictures of a database, in the order of their names.
pub(super) fn read_database(database: &Path) -> rusqlite::Result<Vec<DescribedKeyPoints>> {
    let database = Connection::open_with_flags(database, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
    let mut statement = database.prepare(
        "SELECT images.name, descriptors.data FROM images JOIN descriptors USING (image_id) ORDER BY images.name",
    )?;
    let rows = statement.query_map([], |row| {
        // The column is null for a picture without key points.
        let data = row.get::<_, Option<Vec<u8>>>(1)?.unwrap_or_default();
        let descriptors = data.as_chunks::<LENGTH>().0.iter().map(|d| d.map(i16::from)).collect();
        Ok(DescribedKeyPoints { name: row.get(0)?, descriptors })
    })?;
    rows.collect()
}

/// Returns the matches of these pairs of pictures, in the format of COLMAP's `matches_importer`, and
/// the number of pairs with matches; `None` if `goes_on` returned false.
pub(super) fn match_pairs(
    pictures: &[DescribedKeyPoints],
    pairs: &[(usize, usize)],
    goes_on: &(dyn Fn() -> bool + Sync),
) -> Option<(String, usize)> {
    let matched = |(i, j): &(usize, usize)| {
        // One pair takes a fraction of a second, and there may be thousands.
        goes_on().then(|| mutual_pairs(&pictures[*i].descriptors, &pictures[*j].descriptors))
    };
    let found: Vec<Vec<(usize, usize)>> = pairs.par_iter().map(matched).collect::<Option<_>>()?;
    let mut text = String::new();
    let mut any = 0;
    for ((i, j), found) in pairs.iter().zip(&found).filter(|(_, found)| !found.is_empty()) {
        any += 1;
        let write = |text: &mut String| {
            writeln!(text, "{} {}", pictures[*i].name, pictures[*j].name)?;
            found.iter().try_for_each(|(a, b)| writeln!(text, "{a} {b}"))?;
            writeln!(text)
        };
        write(&mut text).expect("a text takes what is written");
    }
    Some((text, any))
}

/// The two nearest candidates of a key point, by dot product.
#[derive(Clone, Copy, Default)]
struct NearestPair {
    at: usize,
    first: i32,
    second: i32,
}

impl NearestPair {
    fn see(&mut self, at: usize, product: i32) {
        // An equal product becomes the second, so that a tie chooses neither.
        if product > self.first {
            *self = Self { at, first: product, second: self.first };
        } else if product > self.second {
            self.second = product;
        }
    }

    /// Returns the nearest, if it is near enough and clearly nearer than the second.
    fn chosen(self) -> Option<usize> {
        // Rounding may make a descriptor longer than the scale, for which `acos` is NaN.
        let angle = |product: i32| libm::acos((f64::from(product) / SQUARE).min(1.0));
        let (first, second) = (angle(self.first), angle(self.second));
        (first <= MAX_ANGLE && first < MAX_RATIO * second).then_some(self.at)
    }
}

/// Returns the pairs of key points that choose each other, in the order of the first.
fn mutual_pairs(a: &[[i16; LENGTH]], b: &[[i16; LENGTH]]) -> Vec<(usize, usize)> {
    // One pass over the products finds the nearest in both directions.
    let mut of_b = vec![NearestPair::default(); b.len()];
    let of_a = a.iter().enumerate().map(|(i, x)| {
        // Elements are not negative, so the product 0, a right angle, stands for no candidate.
        let mut nearest = NearestPair::default();
        for (j, (y, back)) in b.iter().zip(&mut of_b).enumerate() {
            let product = dot_product(x, y);
            nearest.see(j, product);
            back.see(i, product);
        }
        nearest
    });
    let of_a: Vec<NearestPair> = of_a.collect();
    let chosen = of_a.into_iter().enumerate().filter_map(|(i, nearest)| Some((i, nearest.chosen()?)));
    chosen.filter(|(i, j)| of_b[*j].chosen() == Some(*i)).collect()
}

fn dot_product(a: &[i16; LENGTH], b: &[i16; LENGTH]) -> i32 {
    // The sum is at most 128 * 255^2, which 32 bits hold.
    a.iter().zip(b).map(|(a, b)| i32::from(*a) * i32::from(*b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A descriptor in the plane of these two of its elements.
    fn along(k: usize, l: usize, share: f64) -> [i16; LENGTH] {
        #[expect(clippy::cast_possible_truncation, reason = "lengths up to 512")]
        let part = |x: f64| (512.0 * x).round() as i16;
        let mut descriptor = [0; LENGTH];
        descriptor[k] = part(share);
        descriptor[l] = part((1.0 - share * share).sqrt());
        descriptor
    }

    #[test]
    fn what_chooses_each_other_and_is_alone_is_a_match() {
        let one = |k| along(k, k + 1, 1.0);
        let t = |a: &[[i16; LENGTH]], b: &[[i16; LENGTH]], wanted: &[(usize, usize)]| {
            assert_eq!(mutual_pairs(a, b), wanted);
        };
        t(&[one(0), one(5), one(9)], &[one(9), one(0)], &[(0, 1), (2, 0)]);
        t(&[one(0)], &[one(0), one(0)], &[]);
        // The only one of b is nearer to the second of a.
        t(&[one(0), along(0, 1, 0.99)], &[along(0, 1, 0.995)], &[(1, 0)]);
        // cos(0.7) = 0.765.
        t(&[one(0)], &[along(0, 1, 0.77)], &[(0, 0)]);
        t(&[one(0)], &[along(0, 1, 0.76)], &[]);
        // An angle of 0.5 against an angle of 0.6: the ratio is above 0.8.
        t(&[one(0)], &[along(0, 1, 0.8776), along(0, 2, 0.8253)], &[]);
        t(&[one(0)], &[along(0, 1, 0.8776), along(0, 2, 0.7648)], &[(0, 0)]);
        t(&[], &[one(0)], &[]);
    }

    #[test]
    fn matches_are_written_pair_by_pair() {
        let described = |name: &str, k: usize| DescribedKeyPoints {
            name: name.into(),
            descriptors: vec![along(k, k + 1, 1.0)],
        };
        let pictures = [described("a.png", 0), described("b.png", 0), described("c.png", 9)];
        let t = |pairs: &[(usize, usize)], goes_on: bool, wanted: Option<(&str, usize)>| {
            let found = match_pairs(&pictures, pairs, &|| goes_on);
            assert_eq!(found.as_ref().map(|(text, any)| (text.as_str(), *any)), wanted);
        };
        t(&[(0, 1), (0, 2), (1, 2)], true, Some(("a.png b.png\n0 0\n\n", 1)));
        t(&[(1, 2)], true, Some(("", 0)));
        t(&[(0, 1)], false, None);
    }
}
