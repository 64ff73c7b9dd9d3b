//! A textured plane in closed form, seen by a camera that moves in three axes and turns, with the
//! events of an ideal threshold sensor, as files of a release.

use super::blur;
use crate::release::forger::edit;
use crate::release::small::{gs2e, said};
use glam::{DQuat, DVec2, DVec3};
use gs2e_event::{Event, EventLabel, EventSink as _, LawStamp, Polarity, StreamHeader, h5};
use gs2e_image::{Image, Size, npy, png};
use gs2e_num::se3::Se3;
use gs2e_num::units::Timestamp;
use gs2e_trajectory::Trajectory;
use serde_json::json;
use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

/// A release by the program, whose trajectory is then replaced by that of the plane.
const RECIPE: &str = "\
version: 1
scene: plane
seed: 7
source:
  procedural: { kind: still-life, gaussians: 100, views: 6, arc: 8, seed: 1 }
camera: { width: 16, height: 12 }
trajectories:
  - name: base
    refine: { window: 1, factor: 2 }
  - name: other
    refine: { window: 1, factor: 2 }
sensor:
  esim: { threshold: { on: 0.2, off: 0.2 }, eps: 0.001 }
outputs: [events, sharp, depth]
";

pub(super) const SIZE: Size = Size { width: 346, height: 260 };
pub(super) const FOCAL: f64 = 300.0;
/// Threshold of both polarities.
pub(super) const THRESHOLD: f64 = 0.2;
/// Offset of the sensor's logarithm.
pub(super) const EPS: f64 = 0.001;
pub(super) const POSES: usize = 481;
/// Every n-th column and row has events. The others have none, which saves time.
pub(super) const LATTICE: u16 = 3;
/// A pixel off the lattice with a black first frame and an event at the last stamp.
pub(super) const ODD: [u16; 2] = [1, 1];
const DEPTH_EVERY: usize = 60;

/// A plane and its release.
pub(super) struct Plane {
    /// Principal point, px.
    pub(super) centre: DVec2,
    /// Poses between sharp frames.
    pub(super) sharp_every: usize,
    _folder: TempDir,
    release: PathBuf,
    /// Events of the stream.
    pub(super) events: usize,
}

/// A plane seen by a camera whose centre is that of the picture.
pub(super) fn centred() -> &'static Plane {
    static PLANE: OnceLock<Plane> = OnceLock::new();
    PLANE.get_or_init(|| Plane::new(0.0, 5))
}

/// A plane seen by a camera whose centre is half a pixel off that of the picture.
pub(super) fn half_pixel() -> &'static Plane {
    static PLANE: OnceLock<Plane> = OnceLock::new();
    PLANE.get_or_init(|| Plane::new(0.5, 24))
}

/// Encoded grey of the texture, 0.15 to 0.85.
fn grey(at: DVec2) -> f64 {
    0.5 + 0.2 * libm::sin(9.0 * at.x + 1.3 * libm::sin(4.0 * at.y))
        + 0.15 * libm::cos(11.0 * at.y - 2.0 * at.x)
}

/// The sensor's logarithm where a ray meets the plane z = 0.
pub(super) fn log_brightness(origin: DVec3, direction: DVec3) -> f64 {
    let meets = origin - direction * (origin.z / direction.z);
    libm::log(grey(meets.truncate()) + EPS)
}

/// The camera at a time, s.
pub(super) fn pose(t: f64) -> Se3 {
    let phase = TAU * t / 0.2;
    let swing =
        DVec3::new(0.2 * libm::sin(phase), 0.15 * libm::sin(0.7 * phase), 0.1 * libm::cos(phase) - 2.0);
    let turn = DVec3::new(0.03 * libm::sin(0.5 * phase), 0.04 * libm::cos(0.8 * phase), 0.1 * t);
    Se3 { rotation: DQuat::from_scaled_axis(turn), translation: swing }
}

/// Stamp of a pose, us.
pub(super) fn stamp_us(index: usize) -> i64 {
    i64::try_from((1_000_000 * index + 1200) / 2400).unwrap()
}

impl Plane {
    fn new(shift: f64, sharp_every: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("plane.yaml"), RECIPE).unwrap();
        let output = gs2e(folder.path(), &["release", "--copy", "--to", "out", "plane.yaml"]);
        assert!(output.status.success(), "{}", said(&output));
        let centre = DVec2::new(f64::from(SIZE.width) / 2.0 + shift, f64::from(SIZE.height) / 2.0 + shift);
        let release = folder.path().join("out");
        let mut plane = Self { centre, sharp_every, _folder: folder, release, events: 0 };
        edit(plane.release(), "plane/scene.json", |scene| {
            scene["camera"]["width"] = json!(SIZE.width);
            scene["camera"]["height"] = json!(SIZE.height);
            for (name, value) in [("fx", FOCAL), ("fy", FOCAL), ("cx", centre.x), ("cy", centre.y)] {
                scene["camera"][name] = json!(value);
            }
        });
        for kind in ["sharp", "depth"] {
            fs::remove_dir_all(plane.folder(kind)).unwrap();
            fs::create_dir(plane.folder(kind)).unwrap();
        }
        plane.write_poses();
        plane.write_pictures();
        blur::write(&plane);
        plane.events = plane.write_events();
        plane
    }

    pub(super) fn release(&self) -> &Path {
        &self.release
    }

    pub(super) fn folder(&self, name: &str) -> PathBuf {
        self.release().join("plane/base").join(name)
    }

    /// Direction of the ray through a place of the picture.
    pub(super) fn ray(&self, pose: &Se3, place: DVec2) -> DVec3 {
        pose.rotation * ((place - self.centre) / FOCAL).extend(1.0)
    }

    fn write_poses(&self) {
        let stamps_us: Vec<i64> = (0..POSES).map(stamp_us).collect();
        let world_from_camera = stamps_us.iter().map(|t| pose(*t as f64 * 1e-6)).collect();
        let path = Trajectory { world_from_camera, stamps_us };
        path.write_poses(fs::File::create(self.folder("poses.txt")).unwrap()).unwrap();
    }

    /// Pixel centres, by rows.
    fn places() -> impl Iterator<Item = DVec2> {
        let row = |y: u32| (0..SIZE.width).map(move |x| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        (0..SIZE.height).flat_map(row)
    }

    fn write_pictures(&self) {
        for index in (0..POSES).step_by(self.sharp_every) {
            let at = pose(stamp_us(index) as f64 * 1e-6);
            let level = |place: DVec2| {
                let grey = libm::exp(log_brightness(at.translation, self.ray(&at, place))) - EPS;
                [(grey * 255.0).round() as u8; 3]
            };
            let mut pixels: Vec<[u8; 3]> = Self::places().map(level).collect();
            pixels[usize::from(ODD[1]) * SIZE.width as usize + usize::from(ODD[0])] = [0; 3];
            let file = fs::File::create(self.folder(&format!("sharp/{index:06}.png"))).unwrap();
            png::write_image(&Image::from_vec(SIZE, pixels), file).unwrap();
        }
        for index in (0..POSES).step_by(DEPTH_EVERY) {
            let at = pose(stamp_us(index) as f64 * 1e-6);
            // The ray has length 1 along the axis, so the factor to the plane is the depth.
            let depth = Self::places().map(|place| (-at.translation.z / self.ray(&at, place).z) as f32);
            let file = fs::File::create(self.folder(&format!("depth/{index:06}.npy"))).unwrap();
            npy::write_image(&Image::from_vec(SIZE, depth.collect()), file).unwrap();
        }
    }

    /// Every crossing of a threshold, from the level at the first pose on.
    fn write_events(&self) -> usize {
        let mut events = Vec::new();
        let poses: Vec<(f64, Se3)> =
            (0..POSES).map(|k| stamp_us(k) as f64 * 1e-6).map(|t| (t, pose(t))).collect();
        for (y, x) in (0..260)
            .step_by(LATTICE.into())
            .flat_map(|y| (0..346).step_by(LATTICE.into()).map(move |x| (y, x)))
        {
            self.cross_levels([x, y], &poses, &mut events);
        }
        // No crossing falls on the last stamp by itself.
        events.push(event(stamp_us(POSES - 1), ODD, Polarity::On));
        events.sort_by_key(Event::file_order);
        let law = Some(LawStamp { version: 1, c_on: THRESHOLD, c_off: THRESHOLD });
        let header = StreamHeader { size: SIZE, law, labelled: false };
        let mut writer = h5::Writer::create(&self.folder("events.h5"), &header).unwrap();
        writer.append(&events).unwrap();
        writer.finish(stamp_us(POSES - 1)).unwrap();
        events.len()
    }

    fn cross_levels(&self, [x, y]: [u16; 2], poses: &[(f64, Se3)], events: &mut Vec<Event>) {
        let place = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let seen = |pose: &Se3| log_brightness(pose.translation, self.ray(pose, place));
        let mut level = seen(&poses[0].1);
        for ends in poses.windows(2) {
            let end = seen(&ends[1].1);
            while (end - level).abs() >= THRESHOLD {
                let rise = (end - level).signum();
                level += rise * THRESHOLD;
                let (mut early, mut late) = (ends[0].0, ends[1].0);
                // 20 halvings of 417 us are below a nanosecond.
                for _ in 0..20 {
                    let middle = (early + late) / 2.0;
                    if (seen(&pose(middle)) - level) * rise < 0.0 { early = middle } else { late = middle }
                }
                let polarity = if rise > 0.0 { Polarity::On } else { Polarity::Off };
                events.push(event((late * 1e6) as i64, [x, y], polarity));
            }
        }
    }
}

fn event(t_us: i64, [x, y]: [u16; 2], polarity: Polarity) -> Event {
    Event { t: Timestamp::from_micros(t_us), x, y, polarity, label: EventLabel::Signal }
}
