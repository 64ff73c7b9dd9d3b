//! Light on the still life: a lamp, a sky, shadows of spheres, and gloss as harmonics.

use super::texture::smooth_step;
use glam::DVec3;
use gs2e_image::srgb;
use gs2e_scene::sh;

/// An occluder of light: a sphere that belongs to the item with this name.
#[derive(Debug, Clone, Copy)]
pub(super) struct SphereOccluder {
    pub(super) item: &'static str,
    pub(super) centre: DVec3,
    pub(super) radius: f64,
}

/// A point of a surface, with the properties that lighting needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct LitPoint {
    pub(super) item: &'static str,
    pub(super) position: DVec3,
    /// Unit normal, outwards.
    pub(super) normal: DVec3,
}

/// Linear light of the lamp and the sky (above) and the table's reflection (below).
const LAMP: DVec3 = DVec3::new(1.95, 1.72, 1.38);
const SKY: DVec3 = DVec3::new(0.36, 0.41, 0.49);
const BOUNCE: DVec3 = DVec3::new(0.20, 0.14, 0.10);
/// Position of the lamp: above, left of and in front of the table.
const LAMP_PLACE: DVec3 = DVec3::new(-2.6, -4.2, -2.6);
/// Apparent size of the lamp, which softens its shadows: radius divided by distance.
const LAMP_SIZE: f64 = 0.12;

/// The direction from `point` to the lamp as a unit vector, and the distance.
fn to_lamp(point: DVec3) -> (DVec3, f64) {
    let way = LAMP_PLACE - point;
    let distance = way.length();
    (way / distance, distance)
}

/// Linear light that leaves a matt surface of this albedo.
pub(super) fn shade_point(lit: LitPoint, albedo: DVec3, occluders: &[SphereOccluder]) -> DVec3 {
    let (direction, distance) = to_lamp(lit.position);
    let facing = lit.normal.dot(direction).max(0.0);
    let falloff = 30.0 / (distance * distance);
    // The spheres of an item would cast shadows on its own surface.
    let strangers = || occluders.iter().filter(|o| o.item != lit.item);
    let shadow: f64 = strangers().map(|o| lamp_share(lit.position, direction, o)).product();
    let open: f64 = strangers().map(|o| sky_share(lit, o)).product();
    let up = 0.5 - 0.5 * lit.normal.y;
    albedo * (LAMP * (facing * falloff * shadow) + (BOUNCE + (SKY - BOUNCE) * up) * open)
}

/// Visible share of the lamp past a sphere: from 1 down to 0 as the ray to its centre approaches
/// the sphere's centre.
fn lamp_share(point: DVec3, direction: DVec3, o: &SphereOccluder) -> f64 {
    let to = o.centre - point;
    let along = to.dot(direction);
    if along <= 0.0 {
        return 1.0;
    }
    let miss = (to - direction * along).length();
    // Never 0, because the step divides by it.
    let penumbra = (LAMP_SIZE * along).max(0.02);
    smooth_step(o.radius - penumbra, o.radius + penumbra, miss)
}

/// Share of the sky that a sphere leaves visible: one minus its solid angle, weighted by the cosine
/// at its centre (Quilez, "Sphere ambient occlusion").
fn sky_share(lit: LitPoint, o: &SphereOccluder) -> f64 {
    let to = o.centre - lit.position;
    // Points inside the sphere count as touching it.
    let squared = to.length_squared().max(o.radius * o.radius);
    let cosine = lit.normal.dot(to) / squared.sqrt();
    1.0 - cosine.max(0.0) * o.radius * o.radius / squared
}

/// The display value of linear light: a shoulder that keeps highlights below white, then the sRGB
/// curve.
pub(super) fn display_light(light: DVec3) -> DVec3 {
    DVec3::from_array(light.to_array().map(|v| srgb::encode(1.0 - libm::exp(-v.max(0.0)))))
}

/// Degree of the harmonics of the still life.
pub(super) const DEGREE: u8 = 2;
/// Exponent of the glossy lobe.
const SHARPNESS: f64 = 9.0;

/// Adds the reflection of the lamp on a glossy surface to coefficients of degree [`DEGREE`]: a lobe
/// about the mirrored direction, seen along `-mirrored`, with the height `strength` as far as the
/// series reaches it.
///
/// The lobe is `((1 + t) / 2)^n`, with `t` the cosine to its axis. By the Funk-Hecke theorem, the
/// coefficient of function `Y_lm` is `k_l Y_lm(axis)`, with `k_0 = 4 pi / (n + 1)` and
/// `k_l = k_(l-1) (n + 1 - l) / (n + 1 + l)`.
pub(super) fn add_gloss(
    lit: LitPoint,
    strength: f64,
    occluders: &[SphereOccluder],
    coefficients: &mut [DVec3],
) {
    let (direction, _) = to_lamp(lit.position);
    let facing = lit.normal.dot(direction);
    if strength <= 0.0 || facing <= 0.0 {
        return;
    }
    let strangers = occluders.iter().filter(|o| o.item != lit.item);
    let visible: f64 = strangers.map(|o| lamp_share(lit.position, direction, o)).product();
    let mirrored = lit.normal * (2.0 * facing) - direction;
    // The reflection fades out towards grazing light, where it ends.
    let strength = strength * visible * smooth_step(0.0, 0.15, facing);
    for (c, y) in coefficients.iter_mut().zip(lobe_coefficients((-mirrored).to_array())) {
        *c += DVec3::splat(strength * y);
    }
}

/// Coefficients of the lobe about `axis`.
fn lobe_coefficients(axis: [f64; 3]) -> [f64; sh::MAX_LEN] {
    let mut functions = sh::basis_values(DEGREE, axis);
    let mut k = 4.0 * std::f64::consts::PI / (SHARPNESS + 1.0);
    for l in 0..=DEGREE {
        if l > 0 {
            let l = f64::from(l);
            k *= (SHARPNESS + 1.0 - l) / (SHARPNESS + 1.0 + l);
        }
        let from = usize::from(l).pow(2);
        functions[from..sh::function_count(l)].iter_mut().for_each(|y| *y *= k);
    }
    functions
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed form against Simpson's rule: `integral over the sphere of f Y_l0`, axis along z.
    #[test]
    fn the_lobe_is_projected_exactly() {
        let got = lobe_coefficients([0.0, 0.0, 1.0]);
        let steps = 2000;
        for (l, index) in [(0_u8, 0), (1, 2), (2, 6)] {
            let f = |t: f64| {
                let r = (1.0 - t * t).max(0.0).sqrt();
                ((1.0 + t) / 2.0).powf(SHARPNESS) * sh::basis_values(DEGREE, [r, 0.0, t])[index]
            };
            let h = 2.0 / f64::from(steps);
            let sum: f64 = (0..=steps)
                .map(|i| {
                    let weight = if i == 0 || i == steps { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
                    weight * f(-1.0 + h * f64::from(i))
                })
                .sum();
            let wanted = 2.0 * std::f64::consts::PI * sum * h / 3.0;
            // Simpson's error: h^4 / 180 of the fourth derivative, below 1e3: 1e-11.
            assert!((got[index] - wanted).abs() < 1e-10, "degree {l}: {} for {wanted}", got[index]);
        }
        for index in [1, 3, 4, 5, 7, 8] {
            assert!(got[index].abs() < 1e-15);
        }
    }
}
