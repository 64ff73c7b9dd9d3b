//! Scene files.

use crate::{Bomb, Fate, Place};
use flate2::Compression;
use flate2::write::GzEncoder;
use image_webp::{ColorType, WebPEncoder};
use serde_json::json;
use std::io::Write as _;
use zip::write::SimpleFileOptions;

pub(crate) const BOMBS: &[Bomb] = &[
    Bomb {
        name: "sog-padding",
        what: "one Gaussian in images of 4096x4096",
        args: "convert in.sog out.ply",
        fate: Fate::Refused,
        make: |place| sog(place, 1, ""),
    },
    Bomb {
        name: "sog-count",
        what: "16,777,216 equal Gaussians",
        args: "convert in.sog out.ply",
        fate: Fate::Refused,
        make: |place| sog(place, 1 << 24, ""),
    },
    Bomb {
        name: "sog-zip",
        what: "a meta.json that inflates to 400 MB",
        args: "convert in.sog out.ply",
        fate: Fate::Refused,
        make: |place| {
            let mut archive = zip::ZipWriter::new(std::fs::File::create(place.path("in.sog")).unwrap());
            archive.start_file("meta.json", deflated()).unwrap();
            archive.write_all(b"{").unwrap();
            repeat(&mut archive, b' ', 400_000_000);
            archive.finish().unwrap();
        },
    },
    Bomb {
        name: "sog-json",
        what: "a meta.json of 1,000,000 numbers",
        args: "convert in.sog out.ply",
        fate: Fate::Refused,
        make: |place| sog(place, 1, &"0,".repeat(1_000_000)),
    },
    Bomb {
        name: "spz-gzip",
        what: "4,000,000 Gaussians of zeros, and a byte too many",
        args: "convert in.spz out.ply",
        fate: Fate::Refused,
        make: |place| {
            let out = std::fs::File::create(place.path("in.spz")).unwrap();
            let mut out = GzEncoder::new(out, Compression::best());
            out.write_all(&spz_header(3, 4_000_000)).unwrap();
            repeat(&mut out, 0, 65 * 4_000_000 + 1);
            out.finish().unwrap();
        },
    },
    Bomb {
        name: "spz-count",
        what: "2^32 - 1 Gaussians, and no data",
        args: "convert in.spz out.ply",
        fate: Fate::Refused,
        make: |place| {
            let mut out = GzEncoder::new(Vec::new(), Compression::best());
            out.write_all(&spz_header(3, u32::MAX)).unwrap();
            place.write("in.spz", out.finish().unwrap());
        },
    },
    Bomb {
        name: "spz-zstd",
        what: "4,000,000 Gaussians of zeros in zstd streams, the last one cut off",
        args: "convert in.spz out.ply",
        fate: Fate::Refused,
        make: zstd_spz,
    },
    Bomb {
        name: "ply-count",
        what: "10^12 Gaussians, and no data",
        args: "convert in.ply out.spz",
        fate: Fate::Refused,
        make: |place| place.write("in.ply", ply("binary_little_endian", 1_000_000_000_000, "float")),
    },
    Bomb {
        name: "ply-rows",
        what: "an element of 10^19 rows without properties",
        args: "convert in.ply out.spz",
        fate: Fate::Refused,
        make: |place| {
            let text = String::from_utf8(ply("ascii", 1, "float")).unwrap();
            let rows = "element nothing 9999999999999999999\nelement vertex";
            place.write("in.ply", text.replace("element vertex", rows));
        },
    },
    Bomb {
        name: "ply-ascii",
        what: "numbers of 64 bits, each one digit, and no end",
        args: "convert in.ply out.spz",
        fate: Fate::Refused,
        make: |place| {
            let body = "0 ".repeat(14 * 800_000);
            place.write("in.ply", [ply("ascii", 900_000, "double"), body.into_bytes()].concat());
        },
    },
    Bomb {
        name: "ply-packed",
        what: "10^12 compressed Gaussians, and no data",
        args: "convert in.ply out.spz",
        fate: Fate::Refused,
        make: |place| {
            let bounds = ["x", "y", "z", "scale_x", "scale_y", "scale_z"];
            let bounds =
                ["min", "max"].map(|end| bounds.map(|name| format!("property float {end}_{name}\n")));
            let words =
                ["position", "rotation", "scale", "color"].map(|w| format!("property uint packed_{w}\n"));
            let header = format!(
                "ply\nformat binary_little_endian 1.0\nelement chunk 3906250000\n{}element vertex 1000000000000\n{}\
                 end_header\n",
                bounds.concat().concat(),
                words.concat()
            );
            place.write("in.ply", header);
        },
    },
];

fn deflated() -> SimpleFileOptions {
    SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated)
}

/// Writes a byte `count` times.
pub(crate) fn repeat(out: &mut impl std::io::Write, byte: u8, count: usize) {
    let block = vec![byte; 1 << 20];
    let mut left = count;
    while left > 0 {
        let now = left.min(block.len());
        out.write_all(&block[..now]).unwrap();
        left -= now;
    }
}

/// Writes a SOG of one-colour images of 4096x4096, with `more` as a list in its `meta.json`.
fn sog(place: &Place, count: usize, more: &str) {
    let side = 4096;
    let image = |color, pixel: &[u8]| {
        let mut out = Vec::new();
        let pixels = pixel.repeat((side * side) as usize);
        WebPEncoder::new(&mut out).encode(&pixels, side, side, color).unwrap();
        // Bytes after the image make it look incompressible.
        out.resize(out.len() + 400_000, 0);
        out
    };
    let (rgb, rgba) = (image(ColorType::Rgb8, &[7; 3]), image(ColorType::Rgba8, &[128, 128, 128, 252]));
    let codebook: Vec<f64> = (0..256).map(|k| f64::from(k) / 64.0).collect();
    let meta = json!({
        "version": 2, "count": count,
        "means": { "mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["l.webp", "u.webp"] },
        "scales": { "codebook": codebook, "files": ["scales.webp"] },
        "quats": { "files": ["quats.webp"] }, "sh0": { "codebook": codebook, "files": ["sh0.webp"] },
    });
    let meta = meta.to_string().replacen('{', &format!("{{\"more\":[{more}0],"), 1);
    let mut archive = zip::ZipWriter::new(std::fs::File::create(place.path("in.sog")).unwrap());
    let files = [("l", &rgb), ("u", &rgb), ("scales", &rgb), ("quats", &rgba), ("sh0", &rgba)];
    for (name, content) in files {
        archive.start_file(format!("{name}.webp"), deflated()).unwrap();
        archive.write_all(content).unwrap();
    }
    archive.start_file("meta.json", deflated()).unwrap();
    archive.write_all(meta.as_bytes()).unwrap();
    archive.finish().unwrap();
}

/// The first 16 bytes of a `.spz` of degree 3.
fn spz_header(version: u32, count: u32) -> Vec<u8> {
    [b"NGSP", &version.to_le_bytes()[..], &count.to_le_bytes(), &[3, 12, 0, 0]].concat()
}

fn zstd_spz(place: &Place) {
    let count = 4_000_000;
    let mut file = spz_header(4, count);
    file[15] = 6;
    // Extensions that are not read make the file long enough for this number of Gaussians.
    let unread: u32 = 500_000;
    file.extend((32 + unread).to_le_bytes());
    file.extend([0; 12]);
    file.resize(file.len() + unread as usize, 0);
    let planes = [9, 1, 3, 3, 4, 45].map(|bytes| bytes * count as usize);
    let stream = |len: usize| {
        let mut out = zstd::Encoder::new(Vec::new(), 3).unwrap();
        repeat(&mut out, 0, len);
        out.finish().unwrap()
    };
    let mut streams = planes.map(stream);
    let last = streams[5].len();
    streams[5].truncate(last - 8);
    for (stream, plane) in streams.iter().zip(planes) {
        file.extend((stream.len() as u64).to_le_bytes());
        file.extend((plane as u64).to_le_bytes());
    }
    place.write("in.spz", [file, streams.concat()].concat());
}

/// The header of a scene of degree 0.
fn ply(encoding: &str, count: u64, number: &str) -> Vec<u8> {
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String = names.split(' ').map(|name| format!("property {number} {name}\n")).collect();
    format!("ply\nformat {encoding} 1.0\nelement vertex {count}\n{properties}end_header\n").into_bytes()
}
