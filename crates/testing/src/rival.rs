//! Draws of our samplers against those of `rand_distr`, which shares no code with them: two-sample
//! Kolmogorov-Smirnov tests with fixed seeds, as one family.

use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng as _;
use rand_distr::Distribution;

/// Comparisons of the family, planted defects left out: 1 normal, 1 exponential, 4 Poisson, 6
/// bridges, 4 of the law `official`.
const FAMILY: usize = 16;

/// Draws of each side.
pub const N: usize = 40_000;

/// `N` draws of a distribution of `rand_distr`, from a generator that the program uses for no draw
/// of a sensor.
pub fn theirs(distribution: &impl Distribution<f64>) -> Vec<f64> {
    draws(distribution, 20_250_521).take(N).collect()
}

/// Draws of a distribution of `rand_distr`, without end.
pub fn draws(distribution: &impl Distribution<f64>, seed: u64) -> impl Iterator<Item = f64> {
    distribution.sample_iter(ChaCha12Rng::seed_from_u64(seed))
}

/// The critical value for alpha 1e-4 over the family (Bonferroni): `sqrt(-ln(alpha / 2) / 2)`
/// bounds the limit law of the scaled distance. For discrete laws the true level is lower.
#[must_use]
pub fn limit() -> f64 {
    (-(1e-4 / FAMILY as f64 / 2.0).ln() / 2.0).sqrt()
}

/// Largest distance between the distribution functions of two samples, times `sqrt(n m / (n + m))`.
/// Both functions are taken after all draws of a value, so that ties of a discrete law are no
/// distance.
#[must_use]
pub fn scaled_distance(mut a: Vec<f64>, mut b: Vec<f64>) -> f64 {
    a.sort_unstable_by(f64::total_cmp);
    b.sort_unstable_by(f64::total_cmp);
    let share = |sample: &[f64], x: f64| sample.partition_point(|y| *y <= x) as f64 / sample.len() as f64;
    let (n, m) = (a.len() as f64, b.len() as f64);
    let distances = a.iter().chain(&b).map(|x| (share(&a, *x) - share(&b, *x)).abs());
    distances.fold(0.0, f64::max) * (n * m / (n + m)).sqrt()
}

/// Asserts that our draws have the law of theirs, and that the same draws with a planted defect do
/// not.
///
/// # Panics
/// They have not, or the defect is not found.
#[expect(clippy::print_stdout, reason = "a test prints what it found")]
pub fn compare(name: &str, ours: &[f64], theirs: &[f64], defect: impl Fn(f64) -> f64) {
    let found = scaled_distance(ours.to_vec(), theirs.to_vec());
    let spoilt = scaled_distance(ours.iter().map(|x| defect(*x)).collect(), theirs.to_vec());
    println!(
        "{name}: KS {found:.3}, with a planted defect {spoilt:.2} (alpha 1e-4 over the family: {:.3})",
        limit()
    );
    assert!(found < limit(), "{name}: {found}");
    assert!(spoilt > limit(), "{name}: the planted defect is missed, {spoilt}");
}

#[test]
fn the_distance_of_small_samples_is_counted_by_hand() {
    // After 1: 1/2 against 1/4; after 2: 1 against 1/2; after 3: 1 against 3/4.
    let found = scaled_distance(vec![1.0, 2.0], vec![4.0, 2.0, 1.0, 3.0]);
    assert!((found - 0.5 * (8.0f64 / 6.0).sqrt()).abs() < 1e-15, "{found}");
    // -ln(1e-4 / 32) = 12.676..., half of it 6.338..., its root 2.5176.
    assert!((limit() - 2.5176).abs() < 1e-3, "{}", limit());
}
