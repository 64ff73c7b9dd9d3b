//! The layouts of reconstruction networks and their benchmark: the HDF5 layout of Monash, E2VID, EVREAL.

use super::arrays::{read_npy, rows};
use super::plane::{self, POSES, Plane, SIZE};
use super::{TestExport, export, samples};
use crate::release::small;
use gs2e_event::{Event, Polarity};
use gs2e_image::{luminance, png};
use rust_hdf5::{H5File, types::HBool};
use std::io::{BufReader, Read as _};

fn is_on(event: &Event) -> bool {
    event.polarity == Polarity::On
}

/// Numbers of events before the frames, from the stream.
fn before(plane: &Plane, stream: &[Event]) -> Vec<u64> {
    let stamps = (0..POSES).step_by(plane.sharp_every).map(plane::stamp_us);
    stamps.map(|stamp| stream.partition_point(|event| event.t.floor_micros() < stamp) as u64).collect()
}

/// A sharp frame in grey.
fn grey(plane: &Plane, pose: usize) -> Vec<u8> {
    let file = std::fs::File::open(plane.folder(&format!("sharp/{pose:06}.png"))).unwrap();
    let image = png::read_rgb(BufReader::new(file)).unwrap();
    image.pixels().iter().map(|rgb| luminance(rgb.map(f32::from)).round() as u8).collect()
}

#[test]
fn monash_h5_has_every_event_and_the_place_of_each_frame() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "monash-h5", &[]);
    let file = H5File::open(exported.path("events.h5")).unwrap();
    let [x, y] =
        ["xs", "ys"].map(|name| file.dataset(&format!("events/{name}")).unwrap().read_raw::<i16>().unwrap());
    let t = file.dataset("events/ts").unwrap().read_raw::<f64>().unwrap();
    let p = file.dataset("events/ps").unwrap().read_raw::<HBool>().unwrap();
    let stream = samples::stream(plane);
    assert_eq!([x.len(), y.len(), t.len(), p.len()], [stream.len(); 4]);
    for (i, event) in stream.iter().enumerate() {
        assert_eq!([x[i], y[i]], [event.x, event.y].map(u16::cast_signed));
        assert_eq!((t[i] * 1e6).round() as i64, event.t.floor_micros());
        assert_eq!(bool::from(p[i]), is_on(event));
    }
    for (k, before) in before(plane, &stream).into_iter().enumerate() {
        let image = file.dataset(&format!("images/image{k:09}")).unwrap();
        assert_eq!(image.shape(), [SIZE.height as usize, SIZE.width as usize]);
        let found = image.attr("event_idx").unwrap().read_numeric::<u64>().unwrap();
        assert_eq!(found, before, "{k}");
        let stamp = image.attr("timestamp").unwrap().read_numeric::<f64>().unwrap();
        assert_eq!((stamp * 1e6).round() as i64, plane::stamp_us(k * plane.sharp_every));
        if k == 7 {
            assert!(image.read_raw::<u8>().unwrap() == grey(plane, 7 * plane.sharp_every));
        }
    }
}

/// The one general layout that takes a velocity as it is; it has no mask, so that NaN is 0.
#[test]
fn monash_h5_has_the_flow_by_channels() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let output = export(small::release(), &out, "monash-h5", &["--trajectory", "base"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let file = H5File::open(out.join("events.h5")).unwrap();
    let flow = file.dataset("flow/flow000000001").unwrap();
    assert_eq!(flow.shape(), [2, 48, 64]);
    let found = flow.read_raw::<f32>().unwrap();
    let released = read_npy::<f32>(&small::release().join("small/one/base/flow/000012.npy"));
    assert_eq!(released.shape, [48, 64, 2]);
    for (i, value) in found.iter().enumerate() {
        let wanted = released.values[2 * (i % (48 * 64)) + i / (48 * 64)];
        assert_eq!(*value, if wanted.is_nan() { 0.0 } else { wanted });
    }
    assert!(found.iter().any(|value| *value != 0.0));
}

#[test]
fn e2vid_reads_the_same_events_from_text_and_zip() {
    let plane: &Plane = plane::half_pixel();
    let text = TestExport::of(plane, "e2vid", &[]);
    let zipped = TestExport::of(plane, "e2vid-zip", &[]);
    let mut archive = zip::ZipArchive::new(std::fs::File::open(zipped.path("events.zip")).unwrap()).unwrap();
    // Its reader takes the only file of the archive.
    assert_eq!(archive.len(), 1);
    let mut inside = String::new();
    archive.by_index(0).unwrap().read_to_string(&mut inside).unwrap();
    let whole = text.text("events.txt");
    assert!(whole == inside);
    let (head, lines) = whole.split_once('\n').unwrap();
    assert_eq!(head, "346 260");
    let stream = samples::stream(plane);
    assert_eq!(lines.lines().count(), stream.len());
    for (line, event) in lines.lines().zip(&stream) {
        let parts: Vec<&str> = line.split(' ').collect();
        assert_eq!(parts[0].split_once('.').unwrap().1.len(), 6, "{line}");
        let t_us = (parts[0].parse::<f64>().unwrap() * 1e6).round() as i64;
        let numbers = [parts[1], parts[2], parts[3]].map(|part| part.parse::<u16>().unwrap());
        assert_eq!((t_us, numbers), (event.t.floor_micros(), [event.x, event.y, u16::from(is_on(event))]));
    }
    let stamps = rows(&text.text("images/timestamps.txt")).len();
    assert_eq!((stamps, text.list("images").len()), (POSES.div_ceil(plane.sharp_every), stamps + 1));
}

#[test]
fn evreal_has_signed_arrays_and_the_place_of_each_frame() {
    let plane: &Plane = plane::centred();
    let exported = TestExport::of(plane, "evreal", &[]);
    let t = read_npy::<f64>(&exported.path("events_ts.npy"));
    let xy = read_npy::<i16>(&exported.path("events_xy.npy"));
    // Its reader takes 2 p - 1, which an unsigned 0 would make 255.
    let p = read_npy::<i8>(&exported.path("events_p.npy"));
    let stream = samples::stream(plane);
    let n = stream.len() as u64;
    assert_eq!((&t.shape[..], &xy.shape[..], &p.shape[..]), (&[n][..], &[n, 2][..], &[n][..]));
    for (i, event) in stream.iter().enumerate() {
        assert_eq!((t.values[i] * 1e6).round() as i64, event.t.floor_micros());
        assert_eq!(xy.values[2 * i..2 * i + 2], [event.x, event.y].map(u16::cast_signed));
        assert_eq!(p.values[i], i8::from(is_on(event)));
    }
    let frames = POSES.div_ceil(plane.sharp_every);
    let images = read_npy::<u8>(&exported.path("images.npy"));
    assert_eq!(images.shape, [frames as u64, 260, 346, 1]);
    assert!(images.values[3 * SIZE.pixels()..4 * SIZE.pixels()] == grey(plane, 3 * plane.sharp_every));
    let places = read_npy::<i64>(&exported.path("image_event_indices.npy"));
    assert_eq!(places.shape, [frames as u64, 1]);
    let wanted = before(plane, &stream).into_iter().map(u64::cast_signed);
    assert_eq!(places.values, wanted.collect::<Vec<_>>());
    let stamps = read_npy::<f64>(&exported.path("images_ts.npy"));
    assert_eq!((stamps.shape, stamps.values[1] * 1e6), (vec![frames as u64, 1], plane::stamp_us(5) as f64));
    assert_eq!(exported.json("metadata.json")["sensor_resolution"], serde_json::json!([260, 346]));
}
