//! Stored quaternions as rotations.

/// The unit quaternion of a stored one, in 64 bits. A zero quaternion gives the identity, as in the
/// renderer.
pub(super) fn unit_quaternion(stored: [f32; 4]) -> [f64; 4] {
    let wide = stored.map(f64::from);
    let norm = wide.iter().map(|c| c * c).sum::<f64>().sqrt();
    if norm > 0.0 { wide.map(|c| c / norm) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// The angle between two rotations, radians; zero only if the stored quaternions are equal or
/// opposite.
#[expect(clippy::float_cmp, reason = "whether they are the same numbers is asked")]
pub(super) fn rotation_angle(a: [f32; 4], b: [f32; 4]) -> f64 {
    if a == b || a == b.map(|c| -c) {
        return 0.0;
    }
    let (a, b) = (unit_quaternion(a), unit_quaternion(b));
    // By the chord, which keeps its digits for small angles, where an arc cosine loses them.
    let chord = |sign: f64| a.iter().zip(b).map(|(a, b)| (a - sign * b).powi(2)).sum::<f64>().sqrt();
    // A chord of `2 sin(a/2)` belongs to quaternions at the angle `a`, and rotations differ by twice that.
    4.0 * libm::asin((chord(1.0).min(chord(-1.0)) / 2.0).min(1.0))
}
