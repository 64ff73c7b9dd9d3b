//! The embedded scene `still-life`: a scene and a capture of it that need no download.
//!
//! Fruit, flowers, books and brass on a table before a tiled wall, as surfels: flattened Gaussians that follow the
//! surfaces, their size set by their number. Light is computed once and stored as colour; glossy things keep the
//! lamp's reflection in their harmonics. The same parameters give the same bits on every machine: all arithmetic
//! is in 64 bits, transcendental functions come from `libm`, and every draw from ChaCha12.

mod books;
mod bouquet;
mod capture;
mod draw;
mod fruit;
mod light;
mod object;
mod room;
mod shape;

use super::Gaussians;
use super::collector::{Collector, Gaussian};
use super::sh;
use crate::source::Capture;
use draw::Draws;
use glam::DVec3;
use light::Lit;
use object::{Arrangement, Finish, Part};
use serde::{Deserialize, Serialize};
use shape::{Shape, Spot};

/// Parameters of the still life.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StillLife {
    /// Number of Gaussians, 100 to 10,000,000.
    pub gaussians: u32,
    /// Number of key views, 2 to 10,000.
    pub views: u32,
    /// Extent of the capture's arc in degrees, above 0 to 360.
    pub arc: f64,
    /// Seed of the scene and of the capture's unevenness.
    pub seed: u64,
}

impl Default for StillLife {
    fn default() -> Self {
        Self { gaussians: 20_000, views: 30, arc: 20.0, seed: 1 }
    }
}

/// A parameter out of its range.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{field}` is {found}, wanted {wanted}")]
pub struct OutOfRange {
    /// The parameter's name.
    pub field: &'static str,
    /// Its value.
    pub found: String,
    /// Its range.
    pub wanted: &'static str,
}

impl StillLife {
    /// Whether every parameter is within its range.
    ///
    /// # Errors
    /// The first that is not.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let check = |ok: bool, field, found: String, wanted| {
            if ok { Ok(()) } else { Err(OutOfRange { field, found, wanted }) }
        };
        let Self { gaussians, views, arc, .. } = *self;
        let counts = (100..=10_000_000).contains(&gaussians);
        check(counts, "gaussians", gaussians.to_string(), "100 to 10,000,000")?;
        check((2..=10_000).contains(&views), "views", views.to_string(), "2 to 10,000")?;
        check(arc > 0.0 && arc <= 360.0, "arc", arc.to_string(), "above 0 and at most 360 degrees")
    }
}

/// The scene: exactly `gaussians` of them, harmonics of degree 2.
///
/// # Panics
/// If the parameters are not [valid](StillLife::validate).
#[must_use]
pub fn gaussians(life: &StillLife) -> Gaussians {
    life.validate().expect("the parameters were validated where they were read");
    let arrangement = arrange(life.seed);
    let weights: Vec<f64> = arrangement.parts.iter().map(|p| p.detail * p.shape.area()).collect();
    let counts = shape::shares(life.gaussians as usize, &weights);
    let mut collector = Collector::new(light::DEGREE, life.gaussians as usize);
    for (stream, (part, count)) in (0_u64..).zip(arrangement.parts.iter().zip(counts)) {
        let mut draws = Draws::new(life.seed, stream);
        part.shape.spots(count, &mut draws, |spot| paint(part, spot, &arrangement, &mut collector));
    }
    collector.finish(DVec3::ZERO, None).expect("a valid still life has Gaussians, all of them finite")
}

/// The capture: `views` poses along an arc about the table, 640x360 pixels, not distorted.
///
/// # Panics
/// If the parameters are not [valid](StillLife::validate).
#[must_use]
pub fn capture(life: &StillLife) -> Capture {
    life.validate().expect("the parameters were validated where they were read");
    capture::capture(life)
}

fn arrange(seed: u64) -> Arrangement {
    let mut arrangement = Arrangement::default();
    room::add(seed, &mut arrangement);
    fruit::add(seed.wrapping_add(200), &mut arrangement);
    bouquet::add(seed.wrapping_add(300), &mut arrangement);
    books::add(seed.wrapping_add(400), &mut arrangement);
    arrangement.parts.push(dust());
    arrangement
}

/// Floaters: faint blobs in the air before the table, as every captured scene has them.
fn dust() -> Part {
    let shape =
        Shape::Blobs { low: DVec3::new(-1.8, -1.5, -1.3), high: DVec3::new(1.9, -0.3, 1.2), share: 0.05 };
    let look = |s: &Spot| {
        let warm = DVec3::new(0.62, 0.58, 0.50);
        Finish { albedo: warm * (0.4 + 0.6 * s.u), gloss: 0.0, opacity: 0.05 + 0.13 * s.v }
    };
    Part { object: "dust", shape, look: Box::new(look), detail: 1.0, thin: true }
}

/// Lights a spot and hands it on as a Gaussian.
fn paint(part: &Part, spot: &Spot, arrangement: &Arrangement, collector: &mut Collector) {
    let finish = (part.look)(spot);
    let away = part.thin && spot.normal.dot(DVec3::new(0.1, -0.5, -0.85)) < 0.0;
    let normal = if away { -spot.normal } else { spot.normal };
    let lit = Lit { object: part.object, position: spot.position, normal };
    let colour = light::display(light::shade(lit, finish.albedo, &arrangement.occluders));
    let mut coefficients = [DVec3::ZERO; sh::len(light::DEGREE)];
    coefficients[0] = (colour - DVec3::splat(0.5)) / sh::C0;
    light::add_gloss(lit, finish.gloss, &arrangement.occluders, &mut coefficients);
    let opacity = finish.opacity;
    let rotation = spot.rotation;
    collector.push(&Gaussian {
        position: narrow(spot.position),
        log_scale: narrow(DVec3::from_array(spot.deviations.to_array().map(libm::log))),
        rotation: [rotation.w, rotation.x, rotation.y, rotation.z].map(sh::Scalar::nearest),
        opacity_logit: sh::Scalar::nearest(libm::log(opacity / (1.0 - opacity))),
        sh: &coefficients.map(narrow),
    });
}

fn narrow(v: DVec3) -> [f32; 3] {
    v.to_array().map(sh::Scalar::nearest)
}
