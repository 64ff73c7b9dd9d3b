//! Frames and pictures.

use crate::{Bomb, Fate, Place};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use png::chunk::{IDAT, IEND, IHDR, iCCP};
use std::io::Write as _;

const SIMULATE: &str = "simulate --frames frames --fps 1000 --sensor dvs346 --out e.npz -q";

pub(crate) const BOMBS: &[Bomb] = &[
    Bomb {
        name: "png-65535",
        what: "frames of 65535x65535, header only",
        args: SIMULATE,
        fate: Fate::Refused,
        make: |place| pngs(place, &png(65_535, &[])),
    },
    Bomb {
        name: "png-30000",
        what: "frames of 30000x30000, header only",
        args: SIMULATE,
        fate: Fate::Refused,
        make: |place| pngs(place, &png(30_000, &[])),
    },
    Bomb {
        name: "png-4096-empty",
        what: "frames of 4096x4096, header only",
        args: SIMULATE,
        fate: Fate::Refused,
        make: |place| pngs(place, &png(4096, &[])),
    },
    Bomb {
        name: "png-4096-cut",
        what: "frames of 4096x4096 of one grey, cut off before the last row",
        args: SIMULATE,
        fate: Fate::Refused,
        make: |place| {
            let data = zeros(4097 * 4000);
            pngs(place, &png(4096, &[(IDAT, &data)]));
        },
    },
    Bomb {
        name: "png-profile",
        what: "a colour profile that inflates to 300 MB in a frame of 8x8",
        args: SIMULATE,
        fate: Fate::Read,
        make: |place| {
            let profile = [b"p\0\0".as_slice(), &zeros(300_000_000)].concat();
            pngs(place, &png(8, &[(iCCP, &profile), (IDAT, &zeros(9 * 8)), (IEND, &[])]));
        },
    },
    Bomb {
        name: "jpeg-16384",
        what: "frames of 16384x16384, the data of 16x16",
        args: SIMULATE,
        fate: Fate::Refused,
        make: |place| jpegs(place, 16_384),
    },
    Bomb {
        name: "jpeg-4000",
        what: "frames of 4000x4000, the data of 16x16",
        args: SIMULATE,
        fate: Fate::Refused,
        make: |place| jpegs(place, 4000),
    },
    Bomb {
        name: "npy-frames",
        what: "an array of shape (2, 65535, 65535) without data",
        args: "simulate --frames f.npy --fps 1000 --sensor dvs346 --out e.npz -q",
        fate: Fate::Refused,
        make: |place| place.write("f.npy", npy("|u1", "2, 65535, 65535")),
    },
    Bomb {
        name: "npy-stamps",
        what: "2^40 time stamps without data",
        args: "simulate --frames f.npy --stamps t.npy --sensor dvs346 --out e.npz -q",
        fate: Fate::Refused,
        make: |place| {
            place.write("f.npy", [npy("|u1", "2, 4, 4"), vec![9; 32]].concat());
            place.write("t.npy", npy("<i8", "1099511627776,"));
        },
    },
];

/// A PNG of a grey square with these chunks after its header.
fn png(side: u32, chunks: &[(png::chunk::ChunkType, &[u8])]) -> Vec<u8> {
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let header = [side.to_be_bytes().as_slice(), &side.to_be_bytes(), &[8, 0, 0, 0, 0]].concat();
    for (kind, data) in [(IHDR, header.as_slice())].iter().chain(chunks) {
        file.extend(u32::try_from(data.len()).unwrap().to_be_bytes());
        file.extend(kind.0);
        file.extend(*data);
        let mut sum = flate2::Crc::new();
        sum.update(&kind.0);
        sum.update(data);
        file.extend(sum.sum().to_be_bytes());
    }
    file
}

/// A zlib stream of `count` zeros.
fn zeros(count: usize) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    let block = vec![0; 1 << 20];
    let mut left = count;
    while left > 0 {
        let now = left.min(block.len());
        encoder.write_all(&block[..now]).unwrap();
        left -= now;
    }
    encoder.finish().unwrap()
}

fn pngs(place: &Place, png: &[u8]) {
    place.write("frames/0.png", png);
    place.write("frames/1.png", png);
}

/// Writes a sound JPEG whose header claims another size.
fn jpegs(place: &Place, side: u16) {
    let mut bytes = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut bytes, 90);
    encoder.encode(&[7; 256], 16, 16, jpeg_encoder::ColorType::Luma).unwrap();
    let at = bytes.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
    let side = side.to_be_bytes();
    bytes[at + 5..at + 9].copy_from_slice(&[side, side].concat());
    place.write("frames/0.jpg", &bytes);
    place.write("frames/1.jpg", &bytes);
}

/// The header of an array.
pub(crate) fn npy(kind: &str, shape: &str) -> Vec<u8> {
    let head = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    [b"\x93NUMPY\x01\x00\x76\x00", format!("{head:117}\n").as_bytes()].concat()
}
