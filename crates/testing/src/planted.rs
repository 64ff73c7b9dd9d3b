//! A small COLMAP model with known content, written in both forms according to COLMAP's
//! documentation, without code of the crates under test.

use std::fmt::Write as _;
use std::path::Path;

const WRITTEN: &str = "memory can be written";

/// A row of `cameras.txt`.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Number by which images name it.
    pub id: u32,
    /// Number and name of the camera model.
    pub model: (i32, &'static str),
    /// Width and height, pixels.
    pub size: [u64; 2],
    /// Parameters of the camera model, in COLMAP's order.
    pub parameters: Vec<f64>,
}

/// Two rows of `images.txt`.
#[derive(Debug, Clone)]
pub struct Image {
    /// Its number.
    pub id: u32,
    /// Quaternion w, x, y, z, world to camera.
    pub q: [f64; 4],
    /// Translation, world to camera.
    pub t: [f64; 3],
    /// Number of its camera.
    pub camera: u32,
    /// Path of the photo.
    pub name: String,
    /// x, y, and a point's id or -1.
    pub observations: Vec<(f64, f64, i64)>,
}

/// A model.
#[derive(Debug, Clone)]
pub struct Planted {
    /// Cameras, in the order of the file.
    pub cameras: Vec<Camera>,
    /// Images, in the order of the file.
    pub images: Vec<Image>,
    /// Id, position, error.
    pub points: Vec<(u64, [f64; 3], f64)>,
}

/// Two cameras and four images out of order, with gaps in the ids, a space and a folder in names,
/// and one image without key points.
#[must_use]
pub fn model() -> Planted {
    let image = |id, q, t, camera, name: &str, observations: &[(f64, f64, i64)]| Image {
        id,
        q,
        t,
        camera,
        name: name.to_owned(),
        observations: observations.to_vec(),
    };
    let s = 0.5f64.sqrt();
    Planted {
        cameras: vec![
            Camera {
                id: 7,
                model: (2, "SIMPLE_RADIAL"),
                size: [640, 360],
                parameters: vec![500.5, 320.0, 180.0, -0.01],
            },
            Camera {
                id: 3,
                model: (1, "PINHOLE"),
                size: [640, 360],
                parameters: vec![500.0, 501.0, 319.5, 181.0],
            },
        ],
        images: vec![
            image(12, [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0], 7, "10.jpg", &[(1.5, 2.5, -1), (3.25, 4.0, 99)]),
            image(2, [s, 0.0, s, 0.0], [1.0, 2.0, 3.0], 7, "9.jpg", &[]),
            image(40, [0.5, 0.5, -0.5, 0.5], [-1.0, 0.25, 1e-3], 3, "left side/a b.jpg", &[(0.1, 0.2, 5)]),
            image(41, [-s, 0.0, 0.0, s], [0.0, 0.0, 0.0], 3, "1.jpg", &[(640.0, 360.0, 5), (2.0, 2.0, -1)]),
        ],
        points: vec![(5, [1.0, -2.0, 1.0 / 3.0], 0.5), (99, [0.0, 0.0, 9.0], 1.25)],
    }
}

impl Planted {
    /// `cameras.bin`, `images.bin`, `points3D.bin`.
    #[must_use]
    pub fn binary(&self) -> [Vec<u8>; 3] {
        let mut cameras = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for c in &self.cameras {
            cameras.extend(c.id.to_le_bytes());
            cameras.extend(c.model.0.to_le_bytes());
            c.size.iter().for_each(|side| cameras.extend(side.to_le_bytes()));
            c.parameters.iter().for_each(|p| cameras.extend(p.to_le_bytes()));
        }
        let mut images = (self.images.len() as u64).to_le_bytes().to_vec();
        for i in &self.images {
            images.extend(i.id.to_le_bytes());
            i.q.iter().chain(&i.t).for_each(|v| images.extend(v.to_le_bytes()));
            images.extend(i.camera.to_le_bytes());
            images.extend(i.name.bytes());
            images.push(0);
            images.extend((i.observations.len() as u64).to_le_bytes());
            for (x, y, point) in &i.observations {
                images.extend([x.to_le_bytes(), y.to_le_bytes(), point.to_le_bytes()].concat());
            }
        }
        let mut points = (self.points.len() as u64).to_le_bytes().to_vec();
        for (id, xyz, error) in &self.points {
            points.extend(id.to_le_bytes());
            xyz.iter().for_each(|v| points.extend(v.to_le_bytes()));
            points.extend([200, 100, 50]);
            points.extend(error.to_le_bytes());
            // A track of one element.
            points.extend([1u64.to_le_bytes(), 12u64.to_le_bytes()].concat());
        }
        [cameras, images, points]
    }

    /// `cameras.txt`, `images.txt`, `points3D.txt`.
    ///
    /// # Panics
    /// Never: memory can be written.
    #[must_use]
    pub fn text(&self) -> [String; 3] {
        let mut cameras =
            "# Camera list with one line of data per camera:\n# Number of cameras: 2\n".to_owned();
        for c in &self.cameras {
            let [width, height] = c.size;
            let parameters: Vec<String> = c.parameters.iter().map(ToString::to_string).collect();
            writeln!(cameras, "{} {} {width} {height} {}", c.id, c.model.1, parameters.join(" "))
                .expect(WRITTEN);
        }
        let mut images = "# Image list with two lines of data per image:\n".to_owned();
        for i in &self.images {
            let numbers: Vec<String> = i.q.iter().chain(&i.t).map(ToString::to_string).collect();
            writeln!(images, "{} {} {} {}", i.id, numbers.join(" "), i.camera, i.name).expect(WRITTEN);
            let key_points: Vec<String> =
                i.observations.iter().map(|(x, y, p)| format!("{x} {y} {p}")).collect();
            writeln!(images, "{}", key_points.join(" ")).expect(WRITTEN);
        }
        let mut points = "# 3D point list with one line of data per point:\n".to_owned();
        for (id, [x, y, z], error) in &self.points {
            writeln!(points, "{id} {x} {y} {z} 200 100 50 {error} 12 0").expect(WRITTEN);
        }
        [cameras, images, points]
    }

    /// Writes the binary form into a folder, which is made.
    pub fn write_binary(&self, dir: &Path) {
        write(dir, "bin", self.binary());
    }

    /// Writes the text form into a folder, which is made.
    pub fn write_text(&self, dir: &Path) {
        write(dir, "txt", self.text().map(String::into_bytes));
    }
}

fn write(dir: &Path, extension: &str, files: [Vec<u8>; 3]) {
    std::fs::create_dir_all(dir).expect("folders can be made");
    for (stem, content) in ["cameras", "images", "points3D"].iter().zip(files) {
        std::fs::write(dir.join(stem).with_extension(extension), content).expect("files can be written");
    }
}
