//! E2NeRF.

use super::plane::{self, LATTICE, ODD, Plane, SIZE, THRESHOLD};
use super::{TestExport, blur, refusals};
use crate::support::absent::absent;
use glam::{DMat3, DVec2, DVec3};
use serde_json::Value;
use std::io::Read as _;
use std::process::Command;

type Matrix = [[f64; 4]; 4];

/// The camera of a matrix with OpenGL axes: its centre, and its OpenCV axes.
fn camera(matrix: &Matrix) -> (DVec3, DMat3) {
    let column = |k: usize| DVec3::new(matrix[0][k], matrix[1][k], matrix[2][k]);
    (column(3), DMat3::from_cols(column(0), -column(1), -column(2)))
}

/// The lists of poses in a file, and the focal length.
fn transforms(exported: &TestExport, name: &str) -> (Vec<Vec<Matrix>>, f64) {
    let text = exported.json(name);
    let lists = text["frames"].as_array().unwrap().iter();
    let lists = lists.map(|frame| serde_json::from_value(frame["transform_matrix"].clone()).unwrap());
    let angle = text["camera_angle_x"].as_f64().unwrap();
    (lists.collect(), f64::from(SIZE.width) / 2.0 / libm::tan(angle / 2.0))
}

/// The numbers of the tensor, and the shape that its archive states to no reader of pickles.
fn counts(exported: &TestExport) -> Vec<f32> {
    let file = std::fs::File::open(exported.path("events.pt")).unwrap();
    let mut archive = zip::ZipArchive::new(file).unwrap();
    let mut bytes = Vec::new();
    archive.by_name("archive/data/0").unwrap().read_to_end(&mut bytes).unwrap();
    bytes.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect()
}

/// The program takes entries 1, 5, 9, 13 and 17 of every second frame, and rays through whole pixels.
#[test]
fn counts_are_the_change_between_its_five_poses() {
    let plane: &Plane = plane::half_pixel();
    let exported = TestExport::of(plane, "e2nerf", &["--lossy"]);
    let (lists, focal) = transforms(&exported, "transform_train.json");
    let exposures = blur::exposures(plane);
    assert_eq!(lists.len(), 2 * exposures.len());
    let facts = &exported.json("export.json")["facts"]["similarity"];
    let origin: [f64; 3] = serde_json::from_value(facts["origin"].clone()).unwrap();
    let scale = facts["scale"].as_f64().unwrap();
    let counts = counts(&exported);
    assert_eq!(counts.len(), exposures.len() * 4 * SIZE.pixels());
    let (mut squares, mut largest, mut n) = (0.0, 0.0f64, 0u32);
    for (view, (_, [start, end])) in exposures.iter().enumerate() {
        assert!(lists[2 * view].len() == 18 && lists[2 * view] == lists[2 * view + 1]);
        let poses = [1usize, 5, 9, 13, 17].map(|k| {
            let (centre, turn) = camera(&lists[2 * view][k]);
            let t = *start as f64 + (end - start) as f64 * (k - 1) as f64 / 16.0;
            let (centre, truth) = (centre / scale + DVec3::from_array(origin), plane::pose(t * 1e-6));
            // A straight line between poses at 2,400 Hz departs by 197 units/s^2 * (417 us)^2 / 8 = 4.3e-6.
            assert!((centre - truth.translation).length() < 1e-5, "view {view}, pose {k}");
            (centre, turn)
        });
        for (y, x) in (0..260)
            .step_by(LATTICE.into())
            .flat_map(|y| (0..346).step_by(LATTICE.into()).map(move |x| (y, x)))
        {
            let [mx, my] = [SIZE.width, SIZE.height].map(|side| f64::from(side) / 2.0);
            let ray = DVec3::new((f64::from(x) - mx) / focal, (f64::from(y) - my) / focal, 1.0);
            let logs = poses.map(|(centre, turn)| plane::log_brightness(centre, turn * ray));
            for stretch in 0..4 {
                let at = (view * 4 + stretch) * SIZE.pixels() + y as usize * SIZE.width as usize + x as usize;
                let off = (logs[stretch + 1] - logs[stretch]) / THRESHOLD - f64::from(counts[at]);
                squares += off * off;
                largest = largest.max(off.abs());
                n += 1;
            }
        }
    }
    let rms = (squares / f64::from(n)).sqrt();
    eprintln!("e2nerf: {rms:.3} events RMS, {largest:.2} at most");
    // As the windows of EventNeRF: two lags of less than an event each.
    assert!(rms < 0.8165 && largest < 2.0, "{rms} {largest}");
}

/// With the centre half a pixel further, its rays go through the pixel centres.
#[test]
fn its_rays_meet_the_pixel_centres_with_the_half_pixel_met() {
    let plane: &Plane = plane::half_pixel();
    let exported = TestExport::of(plane, "e2nerf", &["--lossy"]);
    let wanted = ["camera.size", "blur.count", "sensor.threshold", "sensor.brightness", "blur.light"];
    assert_eq!(exported.losses("approximate"), wanted);
    let (lists, focal) = transforms(&exported, "transform_test.json");
    let names = exported.list("test");
    assert_eq!(lists.len(), names.len());
    let [mx, my] = [SIZE.width, SIZE.height].map(|side| f64::from(side) / 2.0);
    for (x, y) in [(0.0, 0.0), (345.0, 259.0), (17.0, 200.0)] {
        let own = DVec2::new((x - mx) / focal, (y - my) / focal);
        let truth = (DVec2::new(x + 0.5, y + 0.5) - plane.centre) / plane::FOCAL;
        // An angle and its tangent: a few roundings of numbers near 1.
        assert!((own - truth).length() < 1e-14, "{own} {truth}");
    }
    // Test views are the sharp frames that no exposure has in its middle, and entry 1 is their pose.
    let middles: Vec<usize> = blur::exposures(plane).iter().map(|(pose, _)| *pose).collect();
    let between: Vec<usize> =
        (0..plane::POSES).step_by(plane.sharp_every).filter(|pose| !middles.contains(pose)).collect();
    assert_eq!(lists.len(), between.len());
    for (view, pose) in between.iter().enumerate() {
        let released = std::fs::read(plane.folder(&format!("sharp/{pose:06}.png"))).unwrap();
        assert!(std::fs::read(exported.path(&format!("test/r_{view}.png"))).unwrap() == released);
        let truth = plane::pose(plane::stamp_us(*pose) as f64 * 1e-6);
        let forward = camera(&lists[view][1]).1.z_axis;
        assert!((forward - truth.rotation * DVec3::Z).length() < 1e-12);
    }
    // Blurred pictures have even numbers.
    let blurred = exported.list("train");
    assert_eq!(blurred.len(), middles.len());
    assert!(blurred.iter().all(|name| name[2..name.len() - 4].parse::<usize>().unwrap() % 2 == 0));
}

/// E2GS takes the same five poses, unscaled, and reads test views like those for training.
#[test]
fn e2gs_has_the_same_counts_and_lists_of_poses_for_all_views() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "e2gs", &["--lossy"]);
    let wanted = ["sensor.threshold", "sensor.brightness", "blur.light"];
    assert_eq!(exported.losses("approximate"), wanted);
    let (lists, _) = transforms(&exported, "transform_train.json");
    let exposures = blur::exposures(plane);
    assert_eq!(lists.len(), 2 * exposures.len());
    for (view, (_, [start, end])) in exposures.iter().enumerate() {
        assert!(lists[2 * view].len() == 18 && lists[2 * view] == lists[2 * view + 1]);
        for k in [1usize, 5, 9, 13, 17] {
            let t = *start as f64 + (end - start) as f64 * (k - 1) as f64 / 16.0;
            let (centre, truth) = (camera(&lists[2 * view][k]).0, plane::pose(t * 1e-6));
            // A straight line between poses at 2,400 Hz departs by 4.3e-6, as above.
            assert!((centre - truth.translation).length() < 1e-5, "view {view}, pose {k}");
        }
    }
    // Two entries per test view, each a list of one pose.
    let (lists, _) = transforms(&exported, "transform_test.json");
    assert_eq!(lists.len(), 2 * exported.list("test").len());
    for pair in lists.chunks(2) {
        assert!(pair[0] == pair[1] && pair[0].len() == 18 && pair[0].iter().all(|pose| *pose == pair[0][0]));
    }
    let description = exported.json("export.json");
    assert!(description["facts"]["points"].as_u64().unwrap() > 1000, "{description}");
    assert_eq!(exported.list("sparse/0"), ["cameras.bin", "images.bin", "points3D.bin"]);
    assert!(counts(&exported) == counts(&TestExport::of(plane, "e2nerf", &["--lossy"])));
}

#[test]
fn depths_lie_within_the_bounds_of_its_code() {
    let exported = TestExport::of(plane::half_pixel(), "e2nerf", &["--lossy"]);
    let facts = &exported.json("export.json")["facts"];
    let [near, far] = ["near", "far"].map(|name| facts[name].as_f64().unwrap());
    assert!(2.0 < near && near < far && far < 6.0, "{near} {far}");
}

#[test]
fn a_planted_pixel_counts_where_its_events_are() {
    let plane: &Plane = plane::half_pixel();
    let exported = TestExport::of(plane, "e2nerf", &["--lossy"]);
    let counts = counts(&exported);
    // Its only event is at the last pose, after every exposure.
    let odd = usize::from(ODD[1]) * SIZE.width as usize + usize::from(ODD[0]);
    assert!(counts.chunks(SIZE.pixels()).all(|stretch| stretch[odd] == 0.0));
}

const UNPICKLE: &str = "
import collections, json, pickle, sys, zipfile
calls = []
class Reader(pickle.Unpickler):
    def find_class(self, module, name):
        return {
            ('collections', 'OrderedDict'): collections.OrderedDict,
            ('torch', 'FloatStorage'): 'float32',
            ('torch._utils', '_rebuild_tensor_v2'): lambda *call: calls.append(call),
        }[module, name]
    def persistent_load(self, storage):
        return list(storage)
archive = zipfile.ZipFile(sys.argv[1])
assert archive.testzip() is None and archive.read('archive/version') == b'3\\n'
Reader(archive.open('archive/data.pkl')).load()
print(json.dumps(calls))
";

/// Python's own reader of pickles sees the call that PyTorch makes.
#[test]
fn its_tensor_is_a_pickle_of_the_call_that_rebuilds_it() {
    let plane: &Plane = plane::half_pixel();
    let exported = TestExport::of(plane, "e2nerf", &["--lossy"]);
    let Ok(output) = Command::new("python3").args(["-c", UNPICKLE]).arg(exported.path("events.pt")).output()
    else {
        return absent("REQUIRE_READERS", "python3 is absent");
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let calls: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (views, pixels) = (blur::exposures(plane).len(), SIZE.pixels());
    let wanted = serde_json::json!([[
        ["storage", "float32", "0", "cpu", views * 4 * pixels],
        0,
        [views, 4, pixels],
        [4 * pixels, pixels, 1],
        false,
        {}
    ]]);
    assert_eq!(calls, wanted);
}

#[test]
fn numbers_in_its_code_need_lossy() {
    let base = ["--trajectory", "base"];
    // The largest sRGB value less its light is at the light (1.055 / 2.4)^(12 / 7) = 0.2444: 0.2873, or 73 of
    // 255.
    let words = ["800x800", "31 blurred pictures", "0.3 and 0.2", "73 greys", "--lossy"];
    refusals::refused(plane::centred().release(), "e2nerf", &base, 2, &words);
}
