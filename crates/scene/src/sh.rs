//! Real spherical harmonics of degree 0 to 3, as trained splat scenes use them.
//!
//! Basis, order and signs are those of Kerbl et al. 2023 (graphdeco-inria/gaussian-splatting,
//! `utils/sh_utils.py`; graphdeco-inria/diff-gaussian-rasterization, `auxiliary.h`), which follow
//! Sloan, "Efficient Spherical Harmonic Evaluation", JCGT 2(2), 2013, appendix A2: function
//! `l^2 + l + m` for order `m = -l..=l` of degree `l`. They are orthonormal over the unit sphere. A
//! colour is `max(0, 0.5 + sum of coefficient x function)`, without an upper clamp, in the
//! direction from the camera's centre to that of the Gaussian.
//!
//! # Examples
//!
//! ```
//! use gs2e_scene::sh;
//!
//! let direction = [0.0, 0.0, 1.0];
//! let basis = sh::basis_values(1, direction);
//! // The function of degree 0 is the same in all directions.
//! assert_eq!(basis[0], sh::C0);
//! // Red has half of the range more than the middle grey, and the others have nothing more.
//! let coefficients = [[0.5 / sh::C0, 0.0, 0.0]];
//! let [red, green, blue] = sh::sum_colour(&coefficients, &basis);
//! assert!((red - 1.0).abs() < 1e-12);
//! assert_eq!([green, blue], [0.5; 2]);
//! ```

use std::ops::{Add, Mul, Sub};

/// Maximum degree.
pub const MAX_DEGREE: u8 = 3;
/// Number of functions of degree 0 to [`MAX_DEGREE`].
pub const MAX_LEN: usize = 16;

/// The function of degree 0: `sqrt(1 / (4 pi))`.
pub const C0: f64 = 0.28209479177387814;
/// Magnitude of the functions of degree 1: `sqrt(3 / (4 pi))`.
pub const C1: f64 = 0.4886025119029199;
/// Factors of the functions of degree 2.
pub const C2: [f64; 5] =
    [1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396];
/// Factors of the functions of degree 3.
pub const C3: [f64; 7] = [
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
];

/// The floating-point types in which the basis is evaluated.
pub trait Scalar: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The value nearest to `x`.
    fn nearest(x: f64) -> Self;
}

impl Scalar for f64 {
    #[inline(always)]
    fn nearest(x: f64) -> Self {
        x
    }
}

impl Scalar for f32 {
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "rounding to 32 bits is what is asked for")]
    fn nearest(x: f64) -> Self {
        x as f32
    }
}

/// Number of functions up to `degree`: `(degree + 1)^2`.
#[must_use]
pub const fn function_count(degree: u8) -> usize {
    (degree as usize + 1).pow(2)
}

/// The functions of degree 0 to `degree` in the unit direction `[x, y, z]`. Entries from
/// [`function_count`] of `degree` on are zero.
///
/// A degree above [`MAX_DEGREE`] gives the functions up to [`MAX_DEGREE`].
#[must_use]
#[inline(always)]
pub fn basis_values<T: Scalar>(degree: u8, dir: [T; 3]) -> [T; MAX_LEN] {
    let mut b = [T::nearest(0.0); MAX_LEN];
    b[0] = T::nearest(C0);
    // Degree by degree: most time of the functions goes into the third, and a scene without it
    // skips it.
    if degree >= 1 {
        let [x, y, z] = dir;
        let c = T::nearest(C1);
        b[1..4].copy_from_slice(&[T::nearest(-C1) * y, c * z, T::nearest(-C1) * x]);
    }
    if degree >= 2 {
        b[4..9].copy_from_slice(&second_degree(dir));
    }
    if degree >= 3 {
        b[9..16].copy_from_slice(&third_degree(dir));
    }
    b
}

#[inline(always)]
fn second_degree<T: Scalar>([x, y, z]: [T; 3]) -> [T; 5] {
    // The products are named, so that both precisions and the gradient round the same ones.
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let c = |k: usize| T::nearest(C2[k]);
    [c(0) * (x * y), c(1) * (y * z), c(2) * (zz + zz - xx - yy), c(3) * (x * z), c(4) * (xx - yy)]
}

#[inline(always)]
fn third_degree<T: Scalar>([x, y, z]: [T; 3]) -> [T; 7] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let three = T::nearest(3.0);
    // Homogeneous: `5 zz - 1` has the same values on the sphere, but another gradient off it, and
    // rounding leaves every direction a little off it.
    let ring = T::nearest(4.0) * zz - xx - yy;
    let c = |k: usize| T::nearest(C3[k]);
    [
        c(0) * y * (three * xx - yy),
        c(1) * (x * y) * z,
        c(2) * y * ring,
        c(3) * z * (zz + zz - three * (xx + yy)),
        c(4) * x * ring,
        c(5) * z * (xx - yy),
        c(6) * x * (xx - three * yy),
    ]
}

/// The gradient, by the direction `[x, y, z]`, of the sum of `weights` times the functions of
/// [`basis_values`]. The functions are taken as the polynomials that they are, also off the unit
/// sphere; a caller that turns a unit direction uses the component across it.
#[must_use]
#[inline(always)]
pub fn direction_gradient<T: Scalar>(degree: u8, dir: [T; 3], weights: &[T; MAX_LEN]) -> [T; 3] {
    let mut sum = [T::nearest(0.0); 3];
    let mut add = |more: [T; 3]| sum = [sum[0] + more[0], sum[1] + more[1], sum[2] + more[2]];
    let c = T::nearest;
    if degree >= 1 {
        add([c(-C1) * weights[3], c(-C1) * weights[1], c(C1) * weights[2]]);
    }
    if degree >= 2 {
        add(second_gradient(dir, std::array::from_fn(|k| c(C2[k]) * weights[4 + k])));
    }
    if degree >= 3 {
        add(third_gradient(dir, std::array::from_fn(|k| c(C3[k]) * weights[9 + k])));
    }
    sum
}

#[inline(always)]
fn second_gradient<T: Scalar>([x, y, z]: [T; 3], w: [T; 5]) -> [T; 3] {
    let (two, four) = (T::nearest(2.0), T::nearest(4.0));
    [
        w[0] * y - two * w[2] * x + w[3] * z + two * w[4] * x,
        w[0] * x + w[1] * z - two * w[2] * y - two * w[4] * y,
        w[1] * y + four * w[2] * z + w[3] * x,
    ]
}

#[inline(always)]
fn third_gradient<T: Scalar>([x, y, z]: [T; 3], w: [T; 7]) -> [T; 3] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (xy, yz, zx) = (x * y, y * z, z * x);
    let [two, three, four, six, eight] = [2.0, 3.0, 4.0, 6.0, 8.0].map(T::nearest);
    [
        six * w[0] * xy + w[1] * yz - two * w[2] * xy - six * w[3] * zx
            + w[4] * (four * zz - three * xx - yy)
            + two * w[5] * zx
            + three * w[6] * (xx - yy),
        three * w[0] * (xx - yy) + w[1] * zx + w[2] * (four * zz - xx - three * yy)
            - six * w[3] * yz
            - two * w[4] * xy
            - two * w[5] * yz
            - six * w[6] * xy,
        w[1] * xy
            + eight * w[2] * yz
            + three * w[3] * (two * zz - xx - yy)
            + eight * w[4] * zx
            + w[5] * (xx - yy),
    ]
}

/// The colour `max(0, 0.5 + sum)` of coefficients `[r, g, b]` with the values of [`basis_values`],
/// summed in the order of the functions. The shorter of the two ends the sum.
#[must_use]
#[inline(always)]
pub fn sum_colour<T: Scalar + PartialOrd, C: Copy + Into<f64>>(
    coefficients: &[[C; 3]],
    basis: &[T],
) -> [T; 3] {
    let zero = T::nearest(0.0);
    // From +0, so that functions with zero coefficients change no bit of the sum.
    let mut sum = [zero; 3];
    for (c, &b) in coefficients.iter().zip(basis) {
        for (s, &c) in sum.iter_mut().zip(c) {
            *s = *s + T::nearest(c.into()) * b;
        }
    }
    sum.map(|s| {
        let v = s + T::nearest(0.5);
        if v > zero { v } else { zero }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Exact for polynomials up to degree 7 over the sphere: 4 Gauss-Legendre nodes in z, 8 angles
    /// around it.
    fn sphere() -> Vec<([f64; 3], f64)> {
        let nodes = [
            (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        ];
        let mut points = Vec::new();
        for (z, w) in nodes {
            for k in 0..8 {
                let a = f64::from(k) * PI / 4.0;
                let r = (1.0_f64 - z * z).sqrt();
                let weight = w * PI / 4.0;
                points.push(([r * a.cos(), r * a.sin(), z], weight));
                points.push(([r * a.cos(), r * a.sin(), -z], weight));
            }
        }
        points
    }

    #[test]
    fn the_functions_are_orthonormal() {
        let mut gram = [[0.0; MAX_LEN]; MAX_LEN];
        for (dir, weight) in sphere() {
            let b = basis_values(3, dir);
            for i in 0..MAX_LEN {
                for j in 0..MAX_LEN {
                    gram[i][j] += weight * b[i] * b[j];
                }
            }
        }
        for (i, row) in gram.iter().enumerate() {
            for (j, &v) in row.iter().enumerate() {
                let wanted = f64::from(u8::from(i == j));
                // 32 terms of magnitude about 1, each rounded a few times at 1.1e-16.
                assert!((v - wanted).abs() < 2e-14, "<{i}, {j}> = {v}");
            }
        }
    }

    /// The sign of each function in a direction in the octant where all factors are positive (the
    /// polynomials evaluated by hand at (2, 1, 2) / 3).
    #[test]
    fn signs_and_order_are_the_published_ones() {
        let b = basis_values::<f64>(3, [2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0]);
        let wanted = [
            0.282094792,
            -0.488602512 / 3.0,
            0.488602512 * 2.0 / 3.0,
            -0.488602512 * 2.0 / 3.0,
            1.09254843 * 2.0 / 9.0,
            -1.09254843 * 2.0 / 9.0,
            0.315391565 * 3.0 / 9.0,
            -1.09254843 * 4.0 / 9.0,
            0.546274215 * 3.0 / 9.0,
            -0.59004359 * 11.0 / 27.0,
            2.89061144 * 4.0 / 27.0,
            -0.457045799 * 11.0 / 27.0,
            0.373176333 * 2.0 * (8.0 - 12.0 - 3.0) / 27.0,
            -0.457045799 * 22.0 / 27.0,
            1.44530572 * 6.0 / 27.0,
            -0.59004359 * 2.0 / 27.0,
        ];
        for (i, (got, wanted)) in b.iter().zip(wanted).enumerate() {
            // The constants above have nine digits.
            assert!((got - wanted).abs() < 2e-9, "function {i}: {got} for {wanted}");
        }
    }

    /// Central differences in 64 bits of polynomials of degree 3: exact up to `h^2` times a third
    /// derivative below 20, and the rounding of 32 bits.
    #[test]
    fn gradients_by_the_direction_are_slopes() {
        let dir = [0.48_f32, -0.6, 0.64];
        let h = 1e-4;
        for degree in 0..=3 {
            for k in 0..MAX_LEN {
                let mut weights = [0.0; MAX_LEN];
                weights[k] = 1.0;
                let found = direction_gradient(degree, dir, &weights);
                for axis in 0..3 {
                    let at = |step: f64| {
                        let mut dir = dir.map(f64::from);
                        dir[axis] += step;
                        basis_values(degree, dir)[k]
                    };
                    let wanted = (at(h) - at(-h)) / (2.0 * h);
                    assert!(
                        (f64::from(found[axis]) - wanted).abs() < 2e-6,
                        "{degree}, {k}, {axis}: {found:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn lower_degrees_are_prefixes() {
        let dir = [0.48_f32, -0.6, 0.64];
        let full = basis_values(3, dir);
        for degree in 0..=3 {
            let b = basis_values(degree, dir);
            assert_eq!(b[..function_count(degree)], full[..function_count(degree)]);
            assert!(b[function_count(degree)..].iter().all(|&v| v.to_bits() == 0));
        }
    }

    #[test]
    fn colours_are_clamped_below_and_not_above() {
        let b = basis_values::<f32>(0, [0.0, 0.0, 1.0]);
        let [low, mid, high] = sum_colour(&[[-4.0, 0.0, 4.0]], &b);
        assert_eq!((low, mid), (0.0, 0.5));
        assert!((high - 1.628_379_2).abs() < 1e-6);
    }
}
