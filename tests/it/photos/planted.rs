//! Photos with known poses: the corner of a room whose three walls have a texture of blobs. Each
//! pixel is the colour of the wall that its ray hits first.

use crate::support::workspace::Workspace;
use glam::{DMat3, DQuat, DVec3};
use gs2e_image::{Image, Size, png};
use gs2e_num::se3::Se3;
use std::path::PathBuf;

/// Focal length of the cameras, px.
pub(super) const FOCAL_PX: f64 = 300.0;

/// Photos of the corner.
pub(super) struct Corner {
    /// Camera to world.
    pub(super) poses: Vec<Se3>,
    /// Distinguishes the textures of two corners.
    pub(super) seed: u64,
}

impl Default for Corner {
    /// Six cameras on an arc of 40 degrees, 5 units from the place that they look at, at changing
    /// heights.
    fn default() -> Self {
        let pose = |k: u32| {
            let angle = (25.0 + 8.0 * f64::from(k)).to_radians();
            let height = 1.6 + 0.5 * f64::from(k % 2);
            let centre = DVec3::new(5.0 * angle.cos(), 5.0 * angle.sin(), height);
            let forward = (DVec3::new(0.5, 0.5, 0.8) - centre).normalize();
            let right = forward.cross(DVec3::Z).normalize();
            let axes = DMat3::from_cols(right, forward.cross(right), forward);
            Se3 { rotation: DQuat::from_mat3(&axes), translation: centre }
        };
        Self { poses: (0..6).map(pose).collect(), seed: 1 }
    }
}

impl Corner {
    pub(super) fn size(&self) -> Size {
        Size { width: 320, height: 240 }
    }

    /// Writes the photos to a folder. Their names have spaces, as photos of cameras may.
    pub(super) fn write_photos(&self, place: &Workspace, folder: &str) -> Vec<(String, PathBuf)> {
        let write = |(k, pose): (usize, &Se3)| {
            let name = format!("view {k}.png");
            let mut bytes = Vec::new();
            png::write_image(&self.photo(pose), &mut bytes).unwrap();
            place.write(&format!("{folder}/{name}"), bytes);
            let path = place.path(&format!("{folder}/{name}"));
            (name, path)
        };
        self.poses.iter().enumerate().map(write).collect()
    }

    fn photo(&self, pose: &Se3) -> Image<[u8; 3]> {
        let size = self.size();
        let pixel = |index: usize| {
            let (x, y) = (index % size.width as usize, index / size.width as usize);
            let [x, y] = [x as f64 + 0.5 - 160.0, y as f64 + 0.5 - 120.0];
            let ray = pose.rotation * DVec3::new(x, y, FOCAL_PX);
            let [r, g, b] = self.colour(pose.translation, ray);
            [r, g, b].map(gs2e_image::to_byte)
        };
        Image::from_vec(size, (0..size.pixels()).map(pixel).collect())
    }

    /// The colour of the nearest of the walls x = 0, y = 0 and z = 0 on a ray.
    fn colour(&self, from: DVec3, ray: DVec3) -> [f32; 3] {
        let hits = (0..3).map(|axis| (axis, -from[axis] / ray[axis])).filter(|(_, t)| *t > 0.0);
        let Some((axis, t)) = hits.min_by(|a, b| a.1.total_cmp(&b.1)) else { return [0.5; 3] };
        let at = from + ray * t;
        let on_wall = [at[(axis + 1) % 3], at[(axis + 2) % 3]];
        let octaves = [(3.0, 0.3), (8.0, 0.35), (20.0, 0.35)];
        let grey = octaves.map(|(per_unit, weight)| weight * self.noise(on_wall.map(|x| x * per_unit), axis));
        #[expect(clippy::cast_possible_truncation, reason = "a grey value")]
        let grey = grey.iter().sum::<f64>() as f32;
        [grey, 0.9 * grey, 0.8 * grey + 0.1]
    }

    /// Value noise from 0 to 1: random values on a grid, and cubic steps between them.
    fn noise(&self, at: [f64; 2], wall: usize) -> f64 {
        let [cell, inside] = [at.map(f64::floor), at.map(|x| x - x.floor())];
        let [u, v] = inside.map(|x| x * x * (3.0 - 2.0 * x));
        #[expect(clippy::cast_possible_truncation, reason = "walls are seen for less than 1000 cells")]
        let value = |i: i64, j: i64| {
            let [x, y] = [cell[0] as i64 + i, cell[1] as i64 + j];
            let mixed = [x.cast_unsigned(), y.cast_unsigned(), wall as u64];
            // SplitMix64 over the place of the value.
            let hash = mixed.iter().fold(self.seed, |hash, word| {
                let z = (hash ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
                let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
                z ^ (z >> 31)
            });
            (hash >> 11) as f64 / (1u64 << 53) as f64
        };
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        mix(mix(value(0, 0), value(1, 0), u), mix(value(0, 1), value(1, 1), u), v)
    }
}

/// Writes a photo without any structure.
pub(super) fn grey(place: &Workspace, name: &str, size: Size) -> PathBuf {
    let mut bytes = Vec::new();
    png::write_image(&Image::filled(size, [90u8, 90, 90]), &mut bytes).unwrap();
    place.write(name, bytes);
    place.path(name)
}
