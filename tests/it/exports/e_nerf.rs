//! E-NeRF.

use super::TestExport;
use super::arrays::{read_npy, rows};
use super::plane::{self, POSES, Plane, SIZE};
use super::steps::{Path, ReadEvent, residual};
use glam::{DQuat, DVec3};

/// The events of all files, by file.
fn event_files(exported: &TestExport) -> Vec<Vec<[f64; 4]>> {
    let read = |name: &String| {
        let array = read_npy::<f64>(&exported.path(&format!("events/{name}")));
        assert_eq!((array.kind.as_str(), array.shape[1]), ("'<f8'", 4));
        array.values.as_chunks().0.to_vec()
    };
    exported.list("events").iter().map(read).collect()
}

/// The poses, as a loader that skips the first line reads them.
fn path(exported: &TestExport) -> Path {
    let text = exported.text("poses_all.txt");
    let poses = rows(text.split_once('\n').unwrap().1);
    Path {
        times: poses.iter().map(|row| row[0]).collect(),
        centres: poses.iter().map(|row| DVec3::new(row[1], row[2], row[3])).collect(),
        turns: poses.iter().map(|row| DQuat::from_xyzw(row[4], row[5], row[6], row[7])).collect(),
    }
}

/// The residual along rays through `(x + off, y + off)`, with the centre in the middle of the picture.
fn measured(exported: &TestExport, off: f64) -> f64 {
    let bounds = read_npy::<f64>(&exported.path("poses_bounds.npy"));
    assert_eq!(bounds.shape, [POSES as u64, 17]);
    let [h, w, f] = [4, 9, 14].map(|at| bounds.values[at]);
    assert_eq!([w, h], [SIZE.width, SIZE.height].map(f64::from));
    let seen = |[x, y, t, sign]: &[f64; 4]| ReadEvent { x: *x as u16, y: *y as u16, t: *t, sign: *sign };
    let events: Vec<ReadEvent> = event_files(exported).iter().flatten().map(seen).collect();
    residual(&events, &path(exported), |x, y| {
        DVec3::new((f64::from(x) + off - w / 2.0) / f, (f64::from(y) + off - h / 2.0) / f, 1.0)
    })
}

#[test]
fn steps_along_its_rays_are_thresholds_with_the_half_pixel_met() {
    let exported = TestExport::of(plane::half_pixel(), "e-nerf", &["--lossy"]);
    // Its formula is linear below a grey of 20, which the sensor's is not.
    assert_eq!(exported.losses("approximate"), ["sensor.brightness"]);
    let residual = measured(&exported, 0.0);
    eprintln!("e-nerf, half pixel met: {residual:.6} thresholds");
    assert!(residual < 2e-4, "{residual}");
}

/// Half a pixel is 0.1 thresholds on such textures, and the export says so.
#[test]
fn a_centred_camera_needs_lossy_and_misses_half_a_pixel() {
    let exported = TestExport::of(plane::centred(), "e-nerf", &["--lossy"]);
    assert_eq!(exported.losses("approximate"), ["camera.centre", "sensor.brightness"]);
    let [own, shifted] = [0.0, 0.5].map(|off| measured(&exported, off));
    eprintln!("e-nerf, centred: {own:.6} thresholds, {shifted:.6} with rays half a pixel further");
    assert!(own > 0.02 && shifted < 2e-4, "{own} {shifted}");
}

#[test]
fn every_trap_of_its_loader_is_avoided() {
    let plane: &Plane = plane::half_pixel();
    let exported = TestExport::of(plane, "e-nerf", &["--lossy"]);
    let files = event_files(&exported);
    let frames = POSES.div_ceil(plane.sharp_every);
    assert_eq!(files.len(), frames);
    let stamps: Vec<f64> = rows(&exported.text("images/image_stamps_ns.txt")).concat();
    assert_eq!((stamps.len(), exported.list("images").len()), (frames, frames + 1));
    // A file holds the events from its frame to the next, with signs as polarity.
    let end = plane::stamp_us(POSES - 1) as f64 * 1e3;
    for (k, file) in files.iter().enumerate() {
        let next = stamps.get(k + 1).copied().unwrap_or(end);
        assert!(file.iter().all(|[.., t, p]| (stamps[k]..=next).contains(t) && p.abs() == 1.0), "file {k}");
    }
    // One step further in float32 is not past the last pose: the loader rounds, then interpolates.
    let last = files.iter().flatten().map(|event| event[2] as f32).fold(0.0, f32::max);
    assert!(last.next_up() < end as f32, "{last} {end}");
    let kept: usize = files.iter().map(Vec::len).sum();
    let dropped = &exported.json("export.json")["facts"]["events_after_the_last_pose_in_float32"];
    assert!(dropped.as_u64().unwrap() >= 1, "the plane has an event at the last stamp");
    assert_eq!(kept + usize::try_from(dropped.as_u64().unwrap()).unwrap(), plane.events);
    // Each batch of the training frames, and the file of the last one, has an OFF event.
    let facts = &exported.json("export.json")["facts"];
    let list = |name: &str| -> Vec<usize> { serde_json::from_value(facts[name].clone()).unwrap() };
    let (train, validation) = (list("train_idxs"), list("val_idxs"));
    let has_off = |batch: &[Vec<[f64; 4]>]| batch.iter().flatten().any(|event| event[3] < 0.0);
    assert!(train.windows(2).all(|ends| has_off(&files[ends[0]..ends[1]])));
    assert!(has_off(&files[*train.last().unwrap()..=*train.last().unwrap()]));
    assert!(train.len() >= 2 && validation.len() >= 2 && !train.contains(&(frames - 1)));
    assert!(train.iter().all(|frame| !validation.contains(frame)));
    let poses = exported.text("poses_all.txt");
    assert!(poses.starts_with('#') && poses.lines().count() == POSES + 1);
}
