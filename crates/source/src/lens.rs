//! Lens distortion: OpenCV's rational model. The other models are special cases with coefficients
//! of zero.
//!
//! For a point `(x, y)` of the pinhole image at focal length 1, with `r2 = x^2 + y^2`:
//!
//! ```text
//! radial = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
//! x' = x radial + 2 p1 x y + p2 (r2 + 2 x^2)
//! y' = y radial + 2 p2 x y + p1 (r2 + 2 y^2)
//! ```
//!
//! (OpenCV, "Camera Calibration and 3D Reconstruction", detailed description; COLMAP
//! `sensor/models.h`.)

use super::LensModel;
use gs2e_scene::camera::Camera;

/// Displacement in pixels below which distortion is ignored.
pub(crate) const NEGLIGIBLE_PX: f64 = 0.1;

/// Points along each side of the grid on which displacements are measured, border included.
const GRID: u32 = 65;

impl LensModel {
    /// k1, k2, p1, p2, k3, k4, k5, k6.
    #[must_use]
    pub fn coefficients(&self) -> [f64; 8] {
        match *self {
            Self::Pinhole => [0.0; 8],
            Self::SimpleRadial { k1 } => [k1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            Self::Radial { k1, k2 } => [k1, k2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            Self::OpenCv { k: [k1, k2, p1, p2] } => [k1, k2, p1, p2, 0.0, 0.0, 0.0, 0.0],
            Self::FullOpenCv { k } => k,
        }
    }

    /// Maps a point of the pinhole image at focal length 1 through the lens.
    #[must_use]
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.coefficients();
        let r2 = x * x + y * y;
        let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        let tangential_x = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let tangential_y = 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y);
        [x * radial + tangential_x, y * radial + tangential_y]
    }

    /// Returns the largest distance, in pixels of `camera`, between a point of the pinhole image
    /// and its image through the lens. The points form a grid of 65x65 that includes the border of
    /// the image.
    ///
    /// The result is infinite if the model has a pole in the image.
    #[must_use]
    pub fn max_displacement_px(&self, camera: &Camera) -> f64 {
        let (width, height) = (f64::from(camera.size.width), f64::from(camera.size.height));
        let at = |i: u32, side: f64| f64::from(i) / f64::from(GRID - 1) * side;
        let points = (0..GRID).flat_map(|i| (0..GRID).map(move |j| [at(i, width), at(j, height)]));
        points
            .map(|p| self.displacement_px(camera, p))
            .fold(0.0, |most: f64, d| if d <= most { most } else { d })
    }

    fn displacement_px(&self, camera: &Camera, [u, v]: [f64; 2]) -> f64 {
        let (x, y) = ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
        let [distorted_x, distorted_y] = self.distort([x, y]);
        let (du, dv) = ((distorted_x - x) * camera.fx, (distorted_y - y) * camera.fy);
        let distance = (du * du + dv * dv).sqrt();
        // At a pole the quotient may be NaN as well as infinite.
        if distance.is_nan() { f64::INFINITY } else { distance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;

    const CAMERA: Camera = Camera::pinhole(Size { width: 640, height: 480 }, [500.0, 500.0, 320.0, 240.0]);

    #[test]
    fn distortion_is_opencvs() {
        // Reference values: cv2.projectPoints of OpenCV 4 with an identity camera matrix, on (0.3,
        // -0.2, 1).
        let t = |lens: LensModel, wanted: [f64; 2]| {
            let got = lens.distort([0.3, -0.2]);
            assert!(
                (got[0] - wanted[0]).abs() < 1e-14 && (got[1] - wanted[1]).abs() < 1e-14,
                "{lens:?}: {got:?}"
            );
        };
        t(LensModel::Pinhole, [0.3, -0.2]);
        t(LensModel::SimpleRadial { k1: -0.08 }, [0.29688, -0.19792]);
        t(LensModel::Radial { k1: 0.05, k2: -0.12 }, [0.3013416, -0.20089440000000003]);
        t(
            LensModel::OpenCv { k: [0.0578, -0.0805, -0.00098, 0.000156] },
            [0.302012025, -0.20145523000000004],
        );
        t(
            LensModel::FullOpenCv { k: [0.2, -0.1, 0.003, -0.002, 0.05, 0.11, -0.07, 0.02] },
            [0.3023537970964415, -0.2013525313976277],
        );
    }

    #[test]
    fn radial_displacement_is_largest_in_the_corners() {
        // r = 400 px at the corners, 0.8 at focal length 1: displaced by k r^3 f = 0.01 * 0.512 *
        // 500 px.
        let lens = LensModel::SimpleRadial { k1: -0.01 };
        assert!((lens.max_displacement_px(&CAMERA) - 2.56).abs() < 1e-9);
        assert!(LensModel::Pinhole.max_displacement_px(&CAMERA) < NEGLIGIBLE_PX);
        let pole = LensModel::FullOpenCv { k: [0.0, 0.0, 0.0, 0.0, 0.0, -1.0 / 0.16, 0.0, 0.0] };
        assert!(pole.max_displacement_px(&Camera { cy: 0.0, ..CAMERA }) > 1e6);
    }
}
