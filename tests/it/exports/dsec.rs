//! DSEC: events with the size of the sensor, a map of a camera without a lens, and displacements as PNG.

use super::plane::{self, POSES, Plane, SIZE};
use super::{TestExport, samples};
use crate::support::absent::absent;
use glam::{DVec2, DVec3};
use gs2e_event::{EventSource as _, h5};
use gs2e_num::se3::Se3;
use rust_hdf5::H5File;
use std::io::BufReader;
use std::path::Path;
use std::process::Command;

/// Red, green and blue of a PNG of 16 bits.
fn wide(path: &Path) -> Vec<[u16; 3]> {
    let decoder = ::png::Decoder::new(BufReader::new(std::fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.color_type, info.bit_depth), (::png::ColorType::Rgb, ::png::BitDepth::Sixteen));
    let values: Vec<u16> = bytes.as_chunks().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect();
    values.as_chunks().0.to_vec()
}

/// Where a pixel's point on the plane is in another view, less the pixel.
fn displacement(plane: &Plane, pixel: DVec2, from: &Se3, to: &Se3) -> DVec2 {
    let ray = plane.ray(from, pixel);
    let point = from.translation - ray * (from.translation.z / ray.z);
    let own: DVec3 = to.rotation.conjugate() * (point - to.translation);
    own.truncate() / own.z * plane::FOCAL + plane.centre - pixel
}

#[test]
fn flows_are_the_displacements_of_the_plane() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "dsec", &[]);
    let root = "test/plane-base";
    let names = exported.list(&format!("{root}/flow/forward"));
    // Depth at every 60th pose. The last one starts no flow.
    assert_eq!(names.len(), (POSES - 1) / 60);
    let table = exported.text(&format!("{root}/test_forward_flow_timestamps.csv"));
    let (mut furthest, mut longest) = (0.0f64, 0.0f64);
    for (name, line) in names.iter().zip(table.lines().skip(1)) {
        let stamps: Vec<i64> = line.split(", ").map(|part| part.parse().unwrap()).collect();
        let index = usize::try_from(stamps[2]).unwrap();
        assert_eq!(*name, format!("{index:06}.png"));
        let ends = [index, index + 1].map(|frame| plane::stamp_us(frame * plane.sharp_every));
        assert_eq!(stamps[..2], ends);
        let [from, to] = ends.map(|t_us| plane::pose(t_us as f64 * 1e-6));
        let flow = wide(&exported.path(&format!("{root}/flow/forward/{name}")));
        for (at, [u, v, valid]) in flow.into_iter().enumerate() {
            let [x, y] = [at % SIZE.width as usize, at / SIZE.width as usize];
            let wanted = displacement(plane, DVec2::new(x as f64 + 0.5, y as f64 + 0.5), &from, &to);
            let found = DVec2::new(f64::from(u) - 32_768.0, f64::from(v) - 32_768.0) / 128.0;
            assert_eq!(valid, 1);
            furthest = furthest.max((found - wanted).abs().max_element());
            longest = longest.max(wanted.length());
        }
    }
    eprintln!("dsec: flow within {furthest:.5} px, of up to {longest:.1} px");
    // Half a step of 1/128 px; depth and flow are rounded to 32 bits, below 1e-5 px.
    assert!(furthest < 0.5 / 128.0 + 1e-5 && longest > 1.0, "{furthest} {longest}");
}

#[test]
fn events_are_those_of_the_release_with_the_size_of_the_sensor() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "dsec", &[]);
    let path = exported.path("test/plane-base/events_left/events.h5");
    let mut reader = h5::Reader::open(&path).unwrap();
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk).unwrap() {
        all.extend_from_slice(&chunk);
    }
    assert!(all == samples::stream(plane));
    let file = H5File::open(&path).unwrap();
    let side = |name: &str| file.dataset(&format!("events/{name}")).unwrap().read_raw::<u16>().unwrap();
    assert_eq!((side("height"), side("width")), (vec![260], vec![346]));
    let index =
        |path: &Path| H5File::open(path).unwrap().dataset("ms_to_idx").unwrap().read_raw::<u64>().unwrap();
    assert!(index(&path) == index(&plane.folder("events.h5")));
    let map = H5File::open(exported.path("test/plane-base/events_left/rectify_map.h5")).unwrap();
    let map = map.dataset("rectify_map").unwrap();
    assert_eq!(map.shape(), [260, 346, 2]);
    let map = map.read_raw::<f32>().unwrap();
    assert_eq!(map[2 * (17 * 346 + 300)..][..2], [300.0, 17.0]);
}

const H5PY: &str = "
import sys, h5py, numpy as np
dsec, rectify, monash, flat = (h5py.File(path, 'r') for path in sys.argv[1:])
assert dsec['events/height'][()] == 260 and dsec['events/width'][()] == 346
assert dsec['events/height'].dtype == np.uint16 and dsec['events/height'].shape == ()
assert rectify['rectify_map'].shape == (260, 346, 2) and rectify['rectify_map'].dtype == np.float32
ps = monash['events/ps']
assert ps.dtype == bool and monash['events/xs'].dtype == np.int16 and monash['events/ts'].dtype == np.float64
t, x, y, p = (dsec['events/' + name][:] for name in 'txyp')
assert np.array_equal(np.round(monash['events/ts'][:] * 1e6), t) and np.array_equal(ps[:], p == 1)
assert np.array_equal(monash['events/xs'][:], x) and np.array_equal(monash['events/ys'][:], y)
image = monash['images/image000000001']
assert image.attrs['type'] == 'greyscale' and tuple(image.attrs['size']) == (260, 346)
assert image.dtype == np.uint8 and image.attrs['timestamp'] == 0.002083
assert image.attrs['event_idx'] == np.searchsorted(t, 2083)
root = monash.attrs
assert root['num_events'] == len(t) == root['num_pos'] + root['num_neg'] and root['num_pos'] == p.sum()
assert tuple(root['sensor_resolution']) == (260, 346) and root['num_imgs'] == len(monash['images'])
assert root['t0'] == 0 and root['tk'] == root['duration'] == 0.2 and root['source'] == 'gs2e'
assert np.array_equal(flat['t'][:], t.astype(np.int64) + 1000) and np.array_equal(flat['p'][:], p)
assert np.array_equal(flat['x'][:], x) and np.array_equal(flat['y'][:], y)
";

/// The HDF5 files of the exports by h5py, which is the C library: types, attributes and all events.
#[test]
fn the_hdf5_files_are_read_by_the_c_library() {
    let found = Command::new("python3").args(["-c", "import h5py, numpy"]).output();
    if !found.is_ok_and(|output| output.status.success()) {
        return absent("REQUIRE_READERS", "python3 with h5py is absent");
    }
    let plane: &Plane = plane::centred();
    let [dsec, monash, flat] =
        ["dsec", "monash-h5", "evdeblurnerf"].map(|format| TestExport::of(plane, format, &[]));
    let left = |name: &str| dsec.path(&format!("test/plane-base/events_left/{name}"));
    let files = [left("events.h5"), left("rectify_map.h5"), monash.path("events.h5"), flat.path("events.h5")];
    let output = Command::new("python3").args(["-c", H5PY]).args(files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
