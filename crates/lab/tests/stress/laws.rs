//! The laws of growth of `cargo xtask bench growth`.

#[path = "../../../../benches/throughput/laws.rs"]
mod fitted;

use fitted::{GrowthLaws, fit_slope};

const SIZES: [f64; 5] = [1e3, 2e3, 4e3, 8e3, 16e3];

fn through(law: impl Fn(f64) -> f64) -> GrowthLaws {
    GrowthLaws::fit_points(&SIZES.map(|x| (x, law(x)))).unwrap()
}

#[test]
fn planted_laws_are_found() {
    let quadratic = through(|x| 3e-9 * x * x);
    assert!((quadratic.exponent - 2.0).abs() < 1e-12 && quadratic.standard_error < 1e-12, "{quadratic:?}");
    // A parabola is not a line; the best line has a negative intercept.
    assert!(quadratic.fixed < 0.0 && quadratic.worst > 0.2, "{quadratic:?}");
    let linear = through(|x| 0.25 + 1e-4 * x);
    assert!((linear.fixed - 0.25).abs() < 1e-9 && (linear.marginal - 1e-4).abs() < 1e-12, "{linear:?}");
    assert!(linear.worst < 1e-9 && (linear.fixed_share(2500.0) - 0.5).abs() < 1e-6);
    // A fixed cost makes the exponent less than 1, and bends the curve.
    assert!((0.5..1.0).contains(&linear.exponent) && linear.standard_error > 1e-3, "{linear:?}");
}

/// For three points at -1, 0 and 1 with ordinates 0, 3 and 0, the slope is 0, the residuals are
/// -1, 2 and -1, and the variance of the slope is 6 / (3 - 2) / 2.
#[test]
fn the_standard_error_is_that_of_the_textbook() {
    let (slope, error) = fit_slope(&[(-1.0, 0.0), (0.0, 3.0), (1.0, 0.0)]).unwrap();
    assert!(slope.abs() < 1e-15 && (error - 3f64.sqrt()).abs() < 1e-12, "{slope} {error}");
}

#[test]
fn too_little_is_no_law() {
    assert_eq!(GrowthLaws::fit_points(&[(1.0, 1.0), (2.0, 2.0)]), None);
    assert_eq!(GrowthLaws::fit_points(&[(1.0, 1.0), (1.0, 2.0), (1.0, 3.0)]), None);
    assert_eq!(GrowthLaws::fit_points(&[(1.0, 1.0), (2.0, 2.0), (3.0, 0.0)]), None);
}
