//! The messages, field by field in the order of their definitions.

use super::cdr::CdrWriter;
use super::packets::EventPacket;
use glam::DVec3;
use gs2e_image::{Image, Size};
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::lens::Distortion;

/// The frame of the poses.
const WORLD: &str = "world";
/// The frame of the camera: x right, y down, z forward, which ROS calls an optical frame.
const CAMERA: &str = "camera";

const NS_PER_S: i64 = 1_000_000_000;

/// A message of its own, which begins with a header.
fn stamped(t_ns: i64, frame: &str) -> CdrWriter {
    let mut message = CdrWriter::new();
    header(&mut message, t_ns, frame);
    message
}

/// `std_msgs/msg/Header`.
#[expect(clippy::cast_possible_truncation, reason = "END_US bounds all times")]
fn header(message: &mut CdrWriter, t_ns: i64, frame: &str) {
    message.i32(t_ns.div_euclid(NS_PER_S) as i32);
    message.u32(t_ns.rem_euclid(NS_PER_S) as u32);
    message.text(frame);
}

/// `event_camera_msgs/msg/EventPacket`.
pub(super) fn event_packet(t_ns: i64, size: Size, seq: u64, packet: &EventPacket) -> Vec<u8> {
    let mut message = stamped(t_ns, CAMERA);
    message.u32(size.height);
    message.u32(size.width);
    message.u64(seq);
    // EVT 3.0 has times of its own.
    message.u64(0);
    message.text("evt3");
    message.u8(0);
    message.list(&packet.words);
    message.finish()
}

/// `sensor_msgs/msg/Image` with `bytes` per pixel.
fn image(t_ns: i64, size: Size, encoding: &str, bytes: u32, data: &[u8]) -> Vec<u8> {
    let mut message = stamped(t_ns, CAMERA);
    message.u32(size.height);
    message.u32(size.width);
    message.text(encoding);
    message.u8(0);
    message.u32(size.width * bytes);
    message.list(data);
    message.finish()
}

/// A picture in sRGB.
pub(super) fn colour(t_ns: i64, picture: &Image<[u8; 3]>) -> Vec<u8> {
    image(t_ns, picture.size(), "rgb8", 3, picture.pixels().as_flattened())
}

/// Depth along the optical axis; NaN where nothing is seen, as REP 118 has it.
pub(super) fn depth(t_ns: i64, picture: &Image<f32>) -> Vec<u8> {
    let data: Vec<u8> = picture.pixels().iter().flat_map(|z| z.to_le_bytes()).collect();
    image(t_ns, picture.size(), "32FC1", 4, &data)
}

/// `sensor_msgs/msg/Imu` of a body rate and a specific force, in the axes of the camera.
pub(super) fn imu(t_ns: i64, [rate, force]: &[DVec3; 2]) -> Vec<u8> {
    let mut message = stamped(t_ns, CAMERA);
    message.f64s(&[0.0, 0.0, 0.0, 1.0]);
    // A first covariance of -1 says that there is no orientation; covariances of 0 are unknown ones.
    message.f64s(&[-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    for vector in [rate, force] {
        message.f64s(&vector.to_array());
        message.f64s(&[0.0; 9]);
    }
    message.finish()
}

/// `sensor_msgs/msg/CameraInfo`. Its pixel centres are at integers.
pub(super) fn camera_info(t_ns: i64, camera: &Camera) -> Vec<u8> {
    let Camera { size, fx, fy, cx, cy, lens } = *camera;
    // Readers of a camera without distortion want five numbers too.
    let (model, coefficients) = match &lens {
        None => ("plumb_bob", &[0.0; 5][..]),
        Some(Distortion::Rational(k)) if k[5..].iter().all(|k| k.abs() == 0.0) => ("plumb_bob", &k[..5]),
        Some(Distortion::Rational(k)) => ("rational_polynomial", &k[..]),
        Some(Distortion::Fisheye(k)) => ("equidistant", &k[..]),
    };
    let (cx, cy) = (cx - 0.5, cy - 0.5);
    let mut message = stamped(t_ns, CAMERA);
    message.u32(size.height);
    message.u32(size.width);
    message.text(model);
    message.length(coefficients.len());
    message.f64s(coefficients);
    message.f64s(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    message.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    message.f64s(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    // No binning, and no region of interest: zeros stand for the whole picture.
    (0..6).for_each(|_| message.u32(0));
    message.u8(0);
    message.finish()
}

/// Place and rotation, in the order that `Pose` and `Transform` share.
fn place(message: &mut CdrWriter, pose: &Se3) {
    message.f64s(&pose.translation.to_array());
    message.f64s(&pose.rotation.to_array());
}

/// `geometry_msgs/msg/PoseStamped` of the camera in the world.
pub(super) fn pose(t_ns: i64, world_from_camera: &Se3) -> Vec<u8> {
    let mut message = stamped(t_ns, WORLD);
    place(&mut message, world_from_camera);
    message.finish()
}

/// `tf2_msgs/msg/TFMessage` with one transform, of the camera in the world.
pub(super) fn transform(t_ns: i64, world_from_camera: &Se3) -> Vec<u8> {
    let mut message = CdrWriter::new();
    message.length(1);
    header(&mut message, t_ns, WORLD);
    message.text(CAMERA);
    place(&mut message, world_from_camera);
    message.finish()
}
