//! Conversion from the axes of a `.spz` file to those of `.ply`: right, down, front.

use crate::cursor::ByteCursor;
use crate::{SceneError, sh};

/// Record type of Adobe's coordinate-system extension (nianticlabs/spz, `extensions/README.md`).
const COORDINATE_SYSTEM: u32 = 0xADBE_0003;

/// For each axis, true if it points opposite to the axis of `.ply`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct AxisFlip(pub(super) [bool; 3]);

/// For each function of [`sh::basis_values`], the axes in which it is odd.
const ODD: [[bool; 3]; sh::MAX_LEN] = {
    const F: bool = false;
    const T: bool = true;
    [
        [F, F, F],
        [F, T, F],
        [F, F, T],
        [T, F, F],
        [T, T, F],
        [F, T, T],
        [F, F, F],
        [T, F, T],
        [F, F, F],
        [F, T, F],
        [T, T, T],
        [F, T, F],
        [F, F, T],
        [T, F, F],
        [F, F, T],
        [T, F, F],
    ]
};

impl AxisFlip {
    /// The default axes of the format: right, up, back.
    pub(super) const RIGHT_UP_BACK: Self = Self([false, true, true]);

    /// Returns the factors of a position's components.
    pub(super) fn of_position(self) -> [f32; 3] {
        self.0.map(axis_sign)
    }

    /// Returns the factors of the components `x, y, z` of a quaternion. The axis of a rotation is a
    /// pseudovector, so each component gets the signs of the other two axes.
    pub(super) fn of_rotation(self) -> [f32; 3] {
        let [x, y, z] = self.0;
        [axis_sign(y ^ z), axis_sign(x ^ z), axis_sign(x ^ y)]
    }

    /// Returns the factor of each harmonic.
    pub(super) fn of_harmonics(self) -> [f32; sh::MAX_LEN] {
        ODD.map(|odd| axis_sign(odd.iter().zip(self.0).fold(false, |s, (&odd, flip)| s ^ (odd && flip))))
    }

    /// Returns the flip of the coordinate-system record; records of other types are skipped.
    pub(super) fn from_extensions(cursor: &mut ByteCursor) -> Result<Self, SceneError> {
        let mut flip = Self::RIGHT_UP_BACK;
        while !cursor.rest().is_empty() {
            let kind = cursor.u32("an extension's type")?;
            let len = cursor.u32("an extension's length")? as usize;
            // Read from a copy: the stated length decides where the next record begins.
            let mut payload = cursor.clone();
            cursor.take(len, "an extension")?;
            if kind == COORDINATE_SYSTEM {
                flip = Self::from_number(&mut payload)?;
            }
        }
        Ok(flip)
    }

    /// Converts the numbers 1 to 8 of nianticlabs/spz, `CoordinateSystem`. Counted from zero, bit 0
    /// is right, bit 1 up, bit 2 front. Numbers from 9 on permute the axes.
    fn from_number(cursor: &mut ByteCursor) -> Result<Self, SceneError> {
        let at = cursor.clone();
        let number = cursor.u32("a coordinate system")?;
        match number {
            0 => Ok(Self::RIGHT_UP_BACK),
            1..=8 => {
                let bit = |k: u32| (number - 1) >> k & 1 == 1;
                Ok(Self([!bit(0), bit(1), !bit(2)]))
            }
            9..=16 => {
                let what = format!("coordinate system {number}, which swaps axes,");
                Err(at.unsupported(what, "store the scene as right, up, back"))
            }
            _ => Err(at.malformed(format!("coordinate system {number}"), "a number from 1 to 16")),
        }
    }
}

fn axis_sign(flip: bool) -> f32 {
    if flip { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The functions that change sign from right, up, back to right, down, front, as
    /// docs/design/pipeline.md, "Scene files" lists them.
    #[test]
    fn the_published_terms_flip() {
        let flipped: Vec<usize> = AxisFlip::RIGHT_UP_BACK
            .of_harmonics()
            .iter()
            .enumerate()
            .filter_map(|(i, &s)| (s < 0.0).then_some(i))
            .collect();
        assert_eq!(flipped, [1, 2, 4, 7, 9, 11, 12, 14]);
        assert_eq!(AxisFlip::RIGHT_UP_BACK.of_rotation().map(f32::is_sign_negative), [false, true, true]);
    }

    /// From the flipped direction, the flipped coefficients give the same colour.
    #[test]
    fn flipping_harmonics_and_direction_changes_nothing() {
        for bits in 0..8 {
            let flip = AxisFlip([bits & 1 != 0, bits & 2 != 0, bits & 4 != 0]);
            let dir = [0.48_f32, -0.6, 0.64];
            let seen = sh::basis_values(3, dir);
            let s = flip.of_position();
            let flipped = sh::basis_values(3, [dir[0] * s[0], dir[1] * s[1], dir[2] * s[2]]);
            for (i, factor) in flip.of_harmonics().into_iter().enumerate() {
                assert!((seen[i] - factor * flipped[i]).abs() < 1e-6, "flip {bits}, function {i}");
            }
        }
    }

    /// `R' = F R F` for the matrix of the quaternion, with glam as the judge.
    #[test]
    fn flipping_rotations_is_conjugation() {
        let (w, v) = (0.8_f32, glam::Vec3::new(0.36, -0.48, 0.0));
        for bits in 0..8 {
            let flip = AxisFlip([bits & 1 != 0, bits & 2 != 0, bits & 4 != 0]);
            let f = glam::Mat3::from_diagonal(glam::Vec3::from_array(flip.of_position()));
            let q = glam::Quat::from_xyzw(v.x, v.y, v.z, w);
            let flipped = v * glam::Vec3::from_array(flip.of_rotation());
            let got = glam::Mat3::from_quat(glam::Quat::from_xyzw(flipped.x, flipped.y, flipped.z, w));
            let wanted = f * glam::Mat3::from_quat(q) * f;
            assert!(got.abs_diff_eq(wanted, 1e-6), "{bits}");
        }
    }

    #[test]
    fn coordinate_systems_are_read_by_number() {
        let t = |number: u32, wanted: Option<[bool; 3]>| {
            let mut bytes = 7_u32.to_le_bytes().to_vec();
            bytes.extend(2_u32.to_le_bytes());
            bytes.extend([1, 2]);
            for word in [COORDINATE_SYSTEM, 4, number] {
                bytes.extend(word.to_le_bytes());
            }
            let flip = AxisFlip::from_extensions(&mut ByteCursor::new("extensions", &bytes)).ok();
            assert_eq!(flip, wanted.map(AxisFlip), "{number}");
        };
        t(1, Some([true, false, true])); // left, down, back
        t(4, Some([false, true, true])); // right, up, back
        t(6, Some([false, false, false])); // right, down, front
        t(7, Some([true, true, false])); // left, up, front
        t(9, None);
        t(17, None);
    }
}
