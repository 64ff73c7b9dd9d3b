//! Lenses that distort, with the models and coefficients of OpenCV.
//!
//! # Examples
//!
//! ```
//! use glam::DVec2;
//! use gs2e_scene::camera::lens::Distortion;
//! use std::f64::consts::FRAC_PI_4;
//!
//! let lens = Distortion::from_parts("fisheye", &[0.0; 4])?;
//! // Without coefficients, the distance from the axis is the angle of the ray: 45 degrees.
//! let image = lens.image(DVec2::X).ok_or("the image folds")?;
//! assert!((image - DVec2::X * FRAC_PI_4).length() < 1e-12);
//! let ray = lens.undistort(image).ok_or("no ray")?;
//! assert!((ray - DVec2::X).length() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use glam::{DMat2, DVec2};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Largest coordinate of a ray at focal length 1 that a pinhole image holds: 76 degrees from the axis. Beyond
/// it, such an image grows without bound.
pub const WIDEST: f64 = 4.0;
/// Largest number of Newton's steps, and the distance from the wanted point at which they end.
const STEPS: usize = 50;
const SETTLED: f64 = 1e-13;
/// Points on the way from the axis to a ray at which the lens must not fold.
const PROBES: u32 = 32;

/// A lens that distorts, with the models and coefficients of OpenCV.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Distortion {
    /// Radial and tangential, or rational: k1, k2, p1, p2, k3, k4, k5, k6.
    #[serde(rename = "opencv")]
    Rational([f64; 8]),
    /// Fisheye (Kannala and Brandt 2006): k1 to k4 of `theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3
    /// theta^6 + k4 theta^8)`.
    Fisheye([f64; 4]),
}

impl Distortion {
    /// The image of a ray at focal length 1, and its derivatives by the ray.
    #[must_use]
    pub fn distort(&self, ray: DVec2) -> (DVec2, DMat2) {
        match self {
            Self::Rational(k) => rational(*k, ray),
            Self::Fisheye(k) => fisheye(*k, ray),
        }
    }

    /// The ray at focal length 1 whose image is at this point. `None` if no ray has it before the image
    /// folds.
    #[must_use]
    pub fn undistort(&self, image: DVec2) -> Option<DVec2> {
        let mut ray = self.start(image)?;
        for _ in 0..STEPS {
            let (found, slopes) = self.distort(ray);
            let off = found - image;
            if off.length() <= SETTLED * (1.0 + image.length()) {
                // Behind a fold, other rays have the same image, and Newton's method may end at one of them.
                return self.is_unfolded(ray).then_some(ray);
            }
            let step = slopes.inverse() * off;
            // A step is at most half of the way to the axis and a half, so that the search stays near.
            let most = 0.5 * (ray.length() + 0.5);
            ray -= if step.length() > most { step * (most / step.length()) } else { step };
            if !ray.is_finite() {
                return None;
            }
        }
        None
    }

    /// The first guess of a ray.
    fn start(&self, image: DVec2) -> Option<DVec2> {
        match self {
            Self::Rational(_) => Some(image),
            // The angle of a fisheye without coefficients, within the field of a pinhole.
            Self::Fisheye(_) => {
                let angle = image.length().min(libm::atan(WIDEST));
                Some(image * if angle > 0.0 { libm::tan(angle) / image.length() } else { 1.0 })
            }
        }
    }

    /// The image of a ray at focal length 1. `None` if the image folds before it.
    #[must_use]
    pub fn image(&self, ray: DVec2) -> Option<DVec2> {
        self.is_unfolded(ray).then(|| self.distort(ray).0)
    }

    /// Returns true if the lens keeps the order of the rays from the axis to this one.
    fn is_unfolded(&self, ray: DVec2) -> bool {
        let mut shares = (1..=PROBES).map(|probe| f64::from(probe) / f64::from(PROBES));
        match self {
            Self::Rational(_) => shares.all(|share| self.distort(ray * share).1.determinant() > 0.0),
            // Its slope across the radius is positive where its slope along it is.
            Self::Fisheye(k) => {
                let angle = libm::atan(ray.length());
                shares.all(|share| bent_slope(*k, angle * share) > 0.0)
            }
        }
    }

    /// Name of the camera's model in COLMAP's files and in those of nerfstudio, and the coefficients with
    /// their names there. No loader of nerfstudio reads the rational model, which COLMAP calls `FULL_OPENCV`.
    #[must_use]
    pub fn nerfstudio(&self) -> (&'static str, Vec<(&'static str, f64)>) {
        match self {
            Self::Rational([k1, k2, p1, p2, k3, rest @ ..]) => {
                let mut named = vec![("k1", *k1), ("k2", *k2), ("k3", *k3), ("p1", *p1), ("p2", *p2)];
                let is_rational = rest.iter().any(|k| k.abs() > 0.0);
                named.extend(["k4", "k5", "k6"].into_iter().zip(*rest).filter(|_| is_rational));
                (if is_rational { "FULL_OPENCV" } else { "OPENCV" }, named)
            }
            Self::Fisheye(k) => ("OPENCV_FISHEYE", ["k1", "k2", "k3", "k4"].into_iter().zip(*k).collect()),
        }
    }

    /// Name of the model in Kalibr's files, and its coefficients. Kalibr knows the first four numbers of
    /// OpenCV's model alone; with more, the name is one that it does not know.
    #[must_use]
    pub fn kalibr(&self) -> (&'static str, Vec<f64>) {
        match self {
            Self::Rational(k) if k[4..].iter().all(|k| k.abs() == 0.0) => ("radtan", k[..4].to_vec()),
            Self::Rational(k) => ("rational", k.to_vec()),
            Self::Fisheye(k) => ("equidistant", k.to_vec()),
        }
    }

    /// The lens of a model with these coefficients.
    ///
    /// # Errors
    /// The unknown name, or the wrong number of coefficients.
    pub fn from_parts(name: &str, k: &[f64]) -> Result<Self, String> {
        match (name, k) {
            ("opencv", k) if [4, 5, 8].contains(&k.len()) => {
                let mut all = [0.0; 8];
                all[..k.len()].copy_from_slice(k);
                Ok(Self::Rational(all))
            }
            ("fisheye", &[k1, k2, k3, k4]) => Ok(Self::Fisheye([k1, k2, k3, k4])),
            ("opencv" | "fisheye", k) => Err(format!("found {} numbers", k.len())),
            _ => Err(format!("`{name}` is no model")),
        }
    }

    /// Coefficients in OpenCV's order.
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        match self {
            Self::Rational(k) => k,
            Self::Fisheye(k) => k,
        }
    }
}

/// OpenCV's rational model and its derivatives. `crates/source/src/lens.rs` has the formula.
fn rational([k1, k2, p1, p2, k3, k4, k5, k6]: [f64; 8], ray: DVec2) -> (DVec2, DMat2) {
    let [x, y] = ray.to_array();
    let r2 = x * x + y * y;
    let (top, bottom) = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
    let (top_slope, bottom_slope) =
        (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2), k4 + r2 * (2.0 * k5 + 3.0 * k6 * r2));
    let radial = top / bottom;
    // By x and by y: twice x and twice y, times this.
    let slope = 2.0 * (top_slope - radial * bottom_slope) / bottom;
    let image = DVec2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
    );
    let across = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
    let by_x = DVec2::new(radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x, across);
    let by_y = DVec2::new(across, radial + slope * y * y + 2.0 * p2 * x + 6.0 * p1 * y);
    (image, DMat2::from_cols(by_x, by_y))
}

fn fisheye(k: [f64; 4], ray: DVec2) -> (DVec2, DMat2) {
    let [k1, k2, k3, k4] = k;
    let r = ray.length();
    // Below this, the angle and its image are the radius to 64 bits.
    if r < 1e-9 {
        return (ray, DMat2::IDENTITY);
    }
    let angle = libm::atan(r);
    let a2 = angle * angle;
    let bent = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
    let (scale, along) = (bent / r, bent_slope(k, angle) / (1.0 + r * r));
    let axis = ray / r;
    // Along the radius the slope is that of the angle, across it the ratio of the radii.
    let outer = DMat2::from_cols(axis * axis.x, axis * axis.y);
    (ray * scale, DMat2::IDENTITY * scale + outer * (along - scale))
}

/// Derivative of the image of an angle by the angle.
fn bent_slope([k1, k2, k3, k4]: [f64; 4], angle: f64) -> f64 {
    let a2 = angle * angle;
    1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)))
}

impl fmt::Display for Distortion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            Self::Rational(_) => "opencv",
            Self::Fisheye(_) => "fisheye",
        };
        let numbers: Vec<String> = self.coefficients().iter().map(ToString::to_string).collect();
        write!(f, "{name}:{}", numbers.join(","))
    }
}

impl FromStr for Distortion {
    type Err = String;

    /// Reads `opencv:k1,k2,p1,p2`, with `,k3` or `,k3,k4,k5,k6` after it, or `fisheye:k1,k2,k3,k4`.
    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = "wanted opencv:k1,k2,p1,p2[,k3[,k4,k5,k6]] or fisheye:k1,k2,k3,k4";
        let Some((name, numbers)) = text.split_once(':') else {
            return Err(format!("found no model, {wanted}"));
        };
        let number = |part: &str| {
            let value = part.trim().parse().ok().filter(|v: &f64| v.is_finite());
            value.ok_or_else(|| format!("`{part}` is not a finite number, {wanted}"))
        };
        let k: Vec<f64> = numbers.split(',').map(number).collect::<Result<_, _>>()?;
        Self::from_parts(name, &k).map_err(|found| format!("{found}, {wanted}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_testing::LENSES;

    fn lens(text: &str) -> Distortion {
        text.parse().unwrap()
    }

    #[test]
    fn rays_are_found_again_and_slopes_are_those_of_the_map() {
        for lens in LENSES.map(lens) {
            for i in 0..21 * 21 {
                let ray = DVec2::new(f64::from(i % 21) - 10.0, f64::from(i / 21) - 10.0) * 0.07;
                let (image, slopes) = lens.distort(ray);
                let found = lens.undistort(image).unwrap();
                assert!((found - ray).length() < 1e-11, "{lens}: {ray} {found}");
                // Central differences: an error of h^2 times third derivatives of a few.
                let h = 1e-5;
                for (axis, slope) in [(DVec2::X, slopes.x_axis), (DVec2::Y, slopes.y_axis)] {
                    let difference =
                        (lens.distort(ray + axis * h).0 - lens.distort(ray - axis * h).0) / (2.0 * h);
                    assert!((difference - slope).length() < 1e-8, "{lens}: {ray} {difference} {slope}");
                }
            }
        }
    }

    /// Reference values: `cv2.projectPoints` and `cv2.fisheye.projectPoints` of OpenCV 5.0 with an identity
    /// camera matrix, on (0.3, -0.2, 1), printed with eight digits.
    #[test]
    fn models_are_opencvs() {
        let t = |text: &str, wanted: [f64; 2]| {
            let found = lens(text).distort(DVec2::new(0.3, -0.2)).0;
            assert!((found - DVec2::from(wanted)).length() < 1e-8, "{text}: {found}");
        };
        t("opencv:0.0578,-0.0805,-0.00098,0.000156,0.01", [0.302_018_62, -0.201_459_62]);
        t("fisheye:0.01,-0.02,0.003,0.001", [0.288_192_21, -0.192_128_14]);
    }

    #[test]
    fn lenses_are_read_from_texts() {
        for text in LENSES {
            let read = lens(text);
            assert_eq!(lens(&read.to_string()), read);
        }
        let t = |text: &str, because: &str| {
            let error = text.parse::<Distortion>().unwrap_err();
            assert!(error.contains(because), "{text}: {error}");
        };
        t("0.1,0.2", "found no model");
        t("opencv:1,2,3", "found 3 numbers");
        t("brown:1,2,3,4", "`brown` is no model");
        t("fisheye:1,2,x,4", "`x` is not a finite number");
    }
}
