//! Event-3DGS and the COLMAP model.

use super::TestExport;
use super::arrays::read_npy;
use super::plane::{self, LATTICE, ODD, POSES, Plane, SIZE, THRESHOLD};
use glam::{DVec2, DVec3};
use gs2e_event::{EventSource as _, Polarity, h5};
use gs2e_image::{Image, png};
use gs2e_source::colmap::ColmapModel;
use std::fs::File;
use std::io::BufReader;

fn picture(exported: &TestExport, name: &str) -> Image<[u8; 3]> {
    png::read_rgb(BufReader::new(File::open(exported.path(name)).unwrap())).unwrap()
}

/// Signed counts of the pixels between two stamps: after the first, up to the second.
fn counts(plane: &Plane, [first, last]: [i64; 2]) -> Vec<f64> {
    let mut reader = h5::Reader::open(&plane.release().join("plane/base/events.h5")).unwrap();
    let (mut chunk, mut counts) = (Vec::new(), vec![0.0; SIZE.pixels()]);
    while reader.next_chunk(&mut chunk).unwrap() {
        for event in chunk.iter().filter(|e| e.t.floor_micros() > first && e.t.floor_micros() <= last) {
            let at = usize::from(event.y) * SIZE.width as usize + usize::from(event.x);
            counts[at] += if event.polarity == Polarity::On { 1.0 } else { -1.0 };
        }
    }
    counts
}

#[test]
fn differences_of_its_pictures_are_counts_of_events() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "event-3dgs", &[]);
    let names = exported.list("images_event");
    assert_eq!(names.len(), POSES.div_ceil(plane.sharp_every));
    for folder in ["images", "renders"] {
        assert_eq!(exported.list(folder), names);
    }
    let (mut squares, mut n) = (0.0, 0u32);
    for pair in [[10, 11], [40, 41], [80, 82]] {
        let [a, b] = pair.map(|k| picture(&exported, &format!("images_event/{k:06}.png")));
        let counts = counts(plane, pair.map(|k| plane::stamp_us(k * plane.sharp_every)));
        for (at, count) in counts.iter().enumerate() {
            let [x, y] = [at % SIZE.width as usize, at / SIZE.width as usize];
            if x % usize::from(LATTICE) == 0 && y % usize::from(LATTICE) == 0 {
                // Its own formula: weights whose sum cancels for a grey picture.
                let log = |image: &Image<[u8; 3]>| {
                    libm::log(0.95 * f64::from(image.pixels()[at][0]) / 255.0 + 1e-8)
                };
                let off = (log(&b) - log(&a)) / THRESHOLD - count;
                squares += off * off;
                n += 1;
            }
        }
    }
    let rms = (squares / f64::from(n)).sqrt();
    eprintln!("event-3dgs: {rms:.4} events RMS");
    // Two roundings of 1/sqrt(12) of a level at greys of 38 to 217 are 0.009 to 0.054 thresholds.
    assert!(rms < 0.054, "{rms}");
}

/// The program takes `ln(grey + 1e-8)`: a 0 would be 75 thresholds below a 1.
#[test]
fn no_picture_has_a_pixel_of_0() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "event-3dgs", &[]);
    let odd = usize::from(ODD[1]) * SIZE.width as usize + usize::from(ODD[0]);
    assert_eq!(picture(&exported, "renders/000000.png").pixels()[odd], [0; 3], "the planted pixel");
    for name in exported.list("images_event").iter().step_by(16) {
        let image = picture(&exported, &format!("images_event/{name}"));
        assert!(image.pixels().iter().all(|rgb| rgb[0] > 0), "{name}");
        assert_eq!(image.pixels()[odd], [1; 3]);
    }
}

#[test]
fn its_model_projects_to_the_same_pixels() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "colmap", &[]);
    let model = ColmapModel::find_model(&exported.path("sparse/0")).unwrap();
    let cameras = model.cameras().unwrap();
    let images = model.images().unwrap();
    assert_eq!(images.len(), exported.list("images").len());
    let mut furthest = 0.0f64;
    for (k, image) in images.iter().enumerate() {
        assert_eq!(image.name, format!("{k:06}.png"));
        let camera = cameras[&image.camera_id].camera;
        let truth = plane::pose(plane::stamp_us(k * plane.sharp_every) as f64 * 1e-6);
        for place in [DVec2::new(0.5, 0.5), DVec2::new(300.5, 17.5), DVec2::new(120.5, 259.5)] {
            let world = truth.translation + 2.0 * plane.ray(&truth, place);
            let own: DVec3 = image.rotation.rotation * world + image.translation;
            let [x, y] = camera.project(own).unwrap();
            furthest = furthest.max((DVec2::new(x, y) - place).length());
        }
    }
    eprintln!("colmap: {furthest:.2e} px");
    assert!(furthest < 1e-9, "{furthest}");
}

/// Points are lifted through pixel centres: they lie on the plane to the rounding of a float32 depth.
#[test]
fn its_points_lie_on_the_plane() {
    let exported = TestExport::of(plane::centred(), "colmap", &[]);
    let bytes = std::fs::read(exported.path("sparse/0/points3D.bin")).unwrap();
    let (count, rest) = bytes.split_at(8);
    let count = u64::from_le_bytes(count.try_into().unwrap());
    // Each point has an id, three coordinates, a colour, an error and an empty track.
    assert!(count > 5000 && rest.len() as u64 == count * 51, "{count}");
    let furthest = rest.chunks(51).map(|point| f64::from_le_bytes(point[24..32].try_into().unwrap()).abs());
    // Depth is 2 with a rounding of 1.2e-7 at most.
    assert!(furthest.fold(0.0, f64::max) < 3e-7);
    let released = plane::centred().release().join("plane/base/depth/000000.npy");
    assert_eq!(read_npy::<f32>(&released).shape, [260, 346]);
}
