//! Writer of the binary form (COLMAP `doc/format.rst`), the input of trainers. It writes pinhole
//! cameras only, and neither key points nor tracks, which trainers do not read.

use super::{ColmapPoint, lenses};
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// An image of a model to write.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenImage {
    /// File name, without a NUL.
    pub name: String,
    /// Camera to world, OpenCV camera axes.
    pub world_from_camera: Se3,
    /// Pinhole camera of the image.
    pub camera: Camera,
}

/// Writes `cameras.bin`, `images.bin` and `points3D.bin` into the folder `dir`. Equal cameras are
/// written once. All ids count from 1 in the given order.
///
/// # Errors
/// A file cannot be written.
pub fn write_model(dir: &Path, images: &[WrittenImage], points: &[ColmapPoint]) -> io::Result<()> {
    let mut cameras: Vec<Camera> = Vec::new();
    let mut camera_ids = Vec::with_capacity(images.len());
    for image in images {
        let known = cameras.iter().position(|camera| *camera == image.camera);
        camera_ids.push(1 + known.unwrap_or(cameras.len()));
        if known.is_none() {
            cameras.push(image.camera);
        }
    }
    write_file(&dir.join("cameras.bin"), |out| write_cameras(out, &cameras))?;
    write_file(&dir.join("images.bin"), |out| write_images(out, images, &camera_ids))?;
    write_file(&dir.join("points3D.bin"), |out| write_points(out, points))
}

fn write_file(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::new(File::create(path)?);
    write(&mut out)?;
    // Dropping the writer would ignore an error of the last write.
    out.flush()
}

fn write_cameras(out: &mut impl Write, cameras: &[Camera]) -> io::Result<()> {
    write_count(out, cameras.len())?;
    for (id, camera) in (1u32..).zip(cameras) {
        out.write_all(&id.to_le_bytes())?;
        out.write_all(&lenses::PINHOLE.to_le_bytes())?;
        for side in [camera.size.width, camera.size.height] {
            out.write_all(&u64::from(side).to_le_bytes())?;
        }
        write_numbers(out, &[camera.fx, camera.fy, camera.cx, camera.cy])?;
    }
    Ok(())
}

fn write_images(out: &mut impl Write, images: &[WrittenImage], camera_ids: &[usize]) -> io::Result<()> {
    write_count(out, images.len())?;
    for ((id, image), camera_id) in (1u32..).zip(images).zip(camera_ids) {
        // COLMAP stores poses as world to camera.
        let Se3 { rotation, translation } = image.world_from_camera.inverse();
        out.write_all(&id.to_le_bytes())?;
        write_numbers(out, &[rotation.w, rotation.x, rotation.y, rotation.z])?;
        write_numbers(out, &translation.to_array())?;
        out.write_all(&u32::try_from(*camera_id).map_err(io::Error::other)?.to_le_bytes())?;
        out.write_all(image.name.as_bytes())?;
        out.write_all(&[0])?;
        write_count(out, 0)?;
    }
    Ok(())
}

fn write_points(out: &mut impl Write, points: &[ColmapPoint]) -> io::Result<()> {
    write_count(out, points.len())?;
    for (id, point) in (1u64..).zip(points) {
        out.write_all(&id.to_le_bytes())?;
        write_numbers(out, &point.xyz.to_array())?;
        out.write_all(&point.rgb)?;
        write_numbers(out, &[point.error])?;
        write_count(out, 0)?;
    }
    Ok(())
}

fn write_count(out: &mut impl Write, count: usize) -> io::Result<()> {
    out.write_all(&(count as u64).to_le_bytes())
}

fn write_numbers(out: &mut impl Write, numbers: &[f64]) -> io::Result<()> {
    numbers.iter().try_for_each(|number| out.write_all(&number.to_le_bytes()))
}

#[cfg(test)]
mod tests {
    use super::super::{ColmapModel, binary};
    use super::*;
    use glam::{DQuat, DVec3};
    use gs2e_image::Size;

    fn camera(fx: f64) -> Camera {
        Camera { size: Size { width: 640, height: 360 }, fx, fy: 501.25, cx: 320.5, cy: 180.25, lens: None }
    }

    fn taken(name: &str, fx: f64, turn: [f64; 4]) -> WrittenImage {
        let rotation = DQuat::from_array(turn).normalize();
        let world_from_camera = Se3 { rotation, translation: DVec3::new(1.5, -2.25, 1.0 / 3.0) };
        WrittenImage { name: name.to_owned(), world_from_camera, camera: camera(fx) }
    }

    #[test]
    fn what_is_written_is_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let images = [
            taken("000000.jpg", 500.0, [0.1, -0.2, 0.3, 0.7]),
            taken("000001.png", 499.0, [0.9, 0.0, -0.1, -0.2]),
            taken("000002.jpg", 500.0, [0.0, 0.0, 0.0, 1.0]),
        ];
        let points = [
            ColmapPoint { xyz: DVec3::new(0.1, -1e-9, 7e5), rgb: [0, 128, 255], error: 0.75 },
            ColmapPoint { xyz: DVec3::ZERO, rgb: [1, 2, 3], error: 0.0 },
        ];
        write_model(dir.path(), &images, &points).unwrap();
        let model = ColmapModel::find_model(dir.path()).unwrap();
        let cameras = model.cameras().unwrap();
        assert_eq!(cameras.keys().copied().collect::<Vec<_>>(), [1, 2], "equal cameras are one");
        let read = model.images().unwrap();
        assert_eq!(read.len(), 3);
        for (image, taken) in read.iter().zip(&images) {
            assert_eq!(image.name, taken.name);
            assert_eq!(cameras[&image.camera_id].camera, taken.camera);
            assert_eq!(cameras[&image.camera_id].lens, crate::LensModel::Pinhole);
            let camera_from_world = Se3 { rotation: image.rotation.rotation, translation: image.translation };
            // Both the camera's centre and a point in front of it must agree, up to a few roundings
            // of numbers up to 3.
            for own in [DVec3::ZERO, DVec3::new(0.5, -1.0, 2.0)] {
                let world = taken.world_from_camera.rotation * own + taken.world_from_camera.translation;
                let back = camera_from_world.rotation * world + camera_from_world.translation;
                assert!((back - own).length() < 4e-15, "{}: {own} came back as {back}", taken.name);
            }
        }
        let read = binary::read_points(&dir.path().join("points3D.bin")).unwrap();
        assert_eq!(read.into_values().collect::<Vec<_>>(), points);
    }

    /// The expected bytes follow COLMAP's `src/colmap/scene/reconstruction_io_binary.cc`.
    #[test]
    fn the_bytes_are_those_of_the_format() {
        let dir = tempfile::tempdir().unwrap();
        let image = WrittenImage {
            name: "a.png".into(),
            world_from_camera: Se3 { rotation: DQuat::IDENTITY, translation: DVec3::new(-1.0, 0.0, -4.0) },
            camera: camera(500.0),
        };
        let point = ColmapPoint { xyz: DVec3::new(1.0, 2.0, 3.0), rgb: [9, 8, 7], error: 0.5 };
        write_model(dir.path(), &[image], &[point]).unwrap();
        let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
        let f = |x: f64| x.to_le_bytes().to_vec();
        let u = |x: u64| x.to_le_bytes().to_vec();
        let cameras =
            [u(1), vec![1, 0, 0, 0, 1, 0, 0, 0], u(640), u(360), f(500.0), f(501.25), f(320.5), f(180.25)];
        assert_eq!(read("cameras.bin"), cameras.concat());
        // World to camera: without a rotation, the translation changes its sign.
        let pose = [f(1.0), f(-0.0), f(-0.0), f(-0.0), f(1.0), f(-0.0), f(4.0)].concat();
        let end = [vec![1, 0, 0, 0], b"a.png\0".to_vec(), u(0)].concat();
        let images = read("images.bin");
        assert_eq!(images[..12], [u(1), vec![1, 0, 0, 0]].concat());
        let found: Vec<f64> = images[12..68].as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let wanted: Vec<f64> = pose.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        assert_eq!(found, wanted);
        assert_eq!(images[68..], end);
        let points = [u(1), u(1), f(1.0), f(2.0), f(3.0), vec![9, 8, 7], f(0.5), u(0)];
        assert_eq!(read("points3D.bin"), points.concat());
    }
}
