//! EvDeblurNeRF and LLFF.

use super::arrays::{read_npy, read_npz};
use super::blur;
use super::plane::{self, POSES, Plane, SIZE, THRESHOLD};
use super::steps::{Path, ReadEvent, residual};
use super::{TestExport, refusals};
use glam::{DMat3, DQuat, DVec3};
use rust_hdf5::H5File;

/// A row: the camera axes, the place, height, width and focal length, and the bounds.
struct Row {
    turn: DMat3,
    centre: DVec3,
    sides: [f64; 3],
    bounds: [f64; 2],
}

/// Rows of LLFF: the axes are down, right and back.
fn rows(exported: &TestExport, name: &str) -> Vec<Row> {
    let array = read_npy::<f64>(&exported.path(name));
    assert_eq!((array.kind.as_str(), array.shape[1]), ("'<f8'", 17));
    let row = |row: &[f64; 17]| {
        let column = |k: usize| DVec3::new(row[k], row[5 + k], row[10 + k]);
        let [down, right, back] = [0, 1, 2].map(column);
        let turn = DMat3::from_cols(right, down, -back);
        // Its loader asserts rotations.
        assert!((turn.determinant() - 1.0).abs() < 1e-12, "{turn}");
        let sides = [row[4], row[9], row[14]];
        Row { turn, centre: column(3), sides, bounds: [row[15], row[16]] }
    };
    array.values.as_chunks::<17>().0.iter().map(row).collect()
}

fn column<T: rust_hdf5::H5Type + Copy>(exported: &TestExport, name: &str) -> Vec<T> {
    H5File::open(exported.path("events.h5")).unwrap().dataset(name).unwrap().read_raw::<T>().unwrap()
}

fn events(exported: &TestExport) -> Vec<ReadEvent> {
    let (x, y) = (column::<u16>(exported, "x"), column::<u16>(exported, "y"));
    let (t, p) = (column::<i64>(exported, "t"), column::<u8>(exported, "p"));
    assert!(t.is_sorted() && p.iter().all(|p| *p <= 1));
    let event = |i: usize| ReadEvent { x: x[i], y: y[i], t: t[i] as f64, sign: f64::from(p[i]) * 2.0 - 1.0 };
    (0..t.len()).map(event).collect()
}

#[test]
fn steps_along_its_rays_are_thresholds() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "evdeblurnerf", &[]);
    assert_eq!(exported.losses("approximate"), Vec::<String>::new());
    let dense = rows(&exported, "all_poses_bounds.npy");
    let times = read_npy::<i64>(&exported.path("all_timestamps.npy")).values;
    assert_eq!((dense.len(), times.len()), (POSES, POSES));
    let path = Path {
        times: times.iter().map(|t| *t as f64).collect(),
        centres: dense.iter().map(|row| row.centre).collect(),
        turns: dense.iter().map(|row| DQuat::from_mat3(&row.turn)).collect(),
    };
    let [h, w, f] = dense[0].sides;
    assert_eq!([w, h], [SIZE.width, SIZE.height].map(f64::from));
    let events = events(&exported);
    assert_eq!(events.len(), plane.events);
    let residual = residual(&events, &path, |x, y| {
        DVec3::new((f64::from(x) + 0.5 - w / 2.0) / f, (f64::from(y) + 0.5 - h / 2.0) / f, 1.0)
    });
    eprintln!("evdeblurnerf: {residual:.6} thresholds");
    assert!(residual < 2e-4, "{residual}");
    // Its logarithm is of linear light, so thresholds grow by 2.2, but for the offsets: 0.5 %.
    let found = exported.json("export.json")["facts"]["thresholds"]["on"].as_f64().unwrap();
    assert!((found / THRESHOLD / 2.2 - 1.0).abs() < 0.005, "{found}");
}

/// A picture is sharp for the loader if its exposure has no length, and a start of 0 would be taken for none.
#[test]
fn every_trap_of_its_pictures_is_avoided() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "evdeblurnerf", &["--test-every", "4"]);
    let exposures = blur::exposures(plane);
    let stamps = ["timestamps", "timestamps_start", "timestamps_end"]
        .map(|name| read_npz::<i64>(&exported.path("images_1/timestamps.npz"), name).values);
    let pictures = rows(&exported, "poses_bounds.npy");
    let names = exported.list("images_1");
    let lengths = [names.len() - 1, pictures.len(), stamps[0].len(), stamps[1].len(), stamps[2].len()];
    assert_eq!(lengths, [exposures.len(); 5]);
    for (k, (pose, open)) in exposures.iter().enumerate() {
        let at = stamps.each_ref().map(|stamps| stamps[k] - 1000);
        let (kind, wanted) = if k % 4 == 0 {
            ("sharp", [plane::stamp_us(*pose); 3])
        } else {
            ("blur", [plane::stamp_us(*pose), open[0], open[1]])
        };
        assert_eq!(at, wanted, "{k}");
        assert!(stamps[1][k] > 0 && (k % 4 == 0) == (at[1] == at[2]), "{k}");
        let released = std::fs::read(plane.folder(&format!("{kind}/{pose:06}.png"))).unwrap();
        assert!(std::fs::read(exported.path(&format!("images_1/{}", names[k]))).unwrap() == released, "{k}");
        let truth = plane::pose(plane::stamp_us(*pose) as f64 * 1e-6);
        assert!((pictures[k].centre - truth.translation).length() < 1e-12);
        // The plane is at z = 0, and the camera looks at it from about 2 units.
        let [near, far] = pictures[k].bounds;
        assert!(near < -truth.translation.z && far > -truth.translation.z && near > 1.0, "{near} {far}");
    }
    assert!(exported.text("config.txt").contains("llffhold = 4\nevents_threshold_pos"), "it looks one way");
}

#[test]
fn llff_has_the_same_pictures_without_events() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "llff", &[]);
    let wanted = blur::exposures(plane).len();
    assert_eq!(rows(&exported, "poses_bounds.npy").len(), wanted);
    assert_eq!((exported.list("images").len(), exported.list("images_1").len()), (wanted, wanted));
    assert!(!exported.path("events.h5").exists());
    let facts = &exported.json("export.json")["facts"];
    assert_eq!((&facts["blurred"], &facts["llffhold"]), (&(wanted - wanted.div_ceil(8)).into(), &8.into()));
}

#[test]
fn too_few_blurred_pictures_are_refused() {
    let release = crate::release::small::release();
    let slow = ["--trajectory", "slow"];
    refusals::refused(
        release,
        "evdeblurnerf",
        &slow,
        2,
        &["2 blurred pictures, 2 of", "outputs: [sharp, blur]"],
    );
    let other = ["--trajectory", "base", "--test-from", "other"];
    refusals::refused(plane::centred().release(), "evdeblurnerf", &other, 2, &["--test-every instead"]);
}
