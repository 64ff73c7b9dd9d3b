//! Event files.

use crate::pictures::npy;
use crate::scenes::repeat;
use crate::{Bomb, Fate, Place};
use std::io::Write as _;
use zip::write::SimpleFileOptions;

pub(crate) const BOMBS: &[Bomb] = &[
    Bomb {
        name: "npz-one-time",
        what: "30,000,000 events at t = 0",
        args: "convert --size 346x260 in.npz out.h5",
        fate: Fate::Refused,
        make: |place| npz(place, 30_000_000, "30000000,"),
    },
    Bomb {
        name: "npz-two-million",
        what: "2,000,000 events at t = 0, which are sorted together",
        args: "convert --size 346x260 in.npz out.h5",
        fate: Fate::Read,
        make: |place| npz(place, 2_000_000, "2000000,"),
    },
    Bomb {
        name: "npz-shape",
        what: "2^60 events, and no data",
        args: "convert --size 346x260 in.npz out.h5",
        fate: Fate::Refused,
        make: |place| npz(place, 0, "1152921504606846976,"),
    },
    Bomb {
        name: "npz-entries",
        what: "an archive of 60,000 empty files",
        args: "convert --size 346x260 in.npz out.h5",
        fate: Fate::Refused,
        make: |place| {
            let mut archive = zip::ZipWriter::new(std::fs::File::create(place.path("in.npz")).unwrap());
            for number in 0..60_000 {
                archive.start_file(number.to_string(), SimpleFileOptions::default()).unwrap();
            }
            archive.finish().unwrap();
        },
    },
    Bomb {
        name: "h5-sensor",
        what: "a sensor of 65535x65535 in a file of few events, as a picture",
        args: "convert in.h5 out.png",
        fate: Fate::Refused,
        make: |place| h5(place, |file| patch_side(file, 65_535)),
    },
    Bomb {
        name: "txt-sensor",
        what: "a sensor of 4096x4096 in a line of text with a wrong polarity, as a time surface",
        args: "convert --picture surface in.txt out.png",
        fate: Fate::Refused,
        make: |place| place.write("in.txt", "4096 4096\n5 1 1 7\n"),
    },
    Bomb {
        name: "h5-heap",
        what: "a heap of names of 2^40 bytes",
        args: "convert in.h5 out.txt",
        fate: Fate::Refused,
        make: |place| {
            h5(place, |file| {
                let at = file.windows(4).position(|word| word == b"HEAP").unwrap();
                file[at + 8..at + 16].copy_from_slice(&(1_u64 << 40).to_le_bytes());
            });
        },
    },
    Bomb {
        name: "csv-sensor",
        what: "a sensor of 65535x65535 in a line of text, as a picture",
        args: "convert in.txt out.png",
        fate: Fate::Refused,
        make: |place| place.write("in.txt", "65535 65535\n5 1 1 1\n"),
    },
    Bomb {
        name: "txt-line",
        what: "a line of 12,000,000 numbers",
        args: "convert in.txt out.h5",
        fate: Fate::Refused,
        make: |place| place.write("in.txt", format!("346 260\n{}", "1 ".repeat(12_000_000))),
    },
    Bomb {
        name: "evt3-gap",
        what: "two events 2^51 us apart, as EVT 3.0",
        args: "convert --codec evt3 in.txt out.raw",
        fate: Fate::Refused,
        make: |place| place.write("in.txt", format!("346 260\n0 1 1 1\n{} 1 1 1\n", 1_i64 << 51)),
    },
    Bomb {
        name: "h5-gap",
        what: "two events 2^32 us apart, as HDF5",
        args: "convert in.txt out.h5",
        fate: Fate::Read,
        make: |place| place.write("in.txt", format!("346 260\n0 1 1 1\n{} 1 1 1\n", u32::MAX)),
    },
    Bomb {
        name: "h5-far",
        what: "two events 2^51 us apart, as HDF5",
        args: "convert in.txt out.h5",
        fate: Fate::Refused,
        make: |place| place.write("in.txt", format!("346 260\n0 1 1 1\n{} 1 1 1\n", 1_i64 << 51)),
    },
    Bomb {
        name: "aedat4-zstd",
        what: "a packet that inflates to 400 MB",
        args: "convert in.aedat4 out.h5",
        fate: Fate::Refused,
        make: |place| {
            let mut packet = zstd::Encoder::new(Vec::new(), 3).unwrap();
            repeat(&mut packet, 0, 400_000_000);
            aedat4(place, 3, &packet.finish().unwrap());
        },
    },
    Bomb {
        name: "aedat4-lz4",
        what: "a packet that inflates to 200 MB",
        args: "convert in.aedat4 out.h5",
        fate: Fate::Refused,
        make: |place| {
            let mut packet = lz4_flex::frame::FrameEncoder::new(Vec::new());
            repeat(&mut packet, 0, 200_000_000);
            aedat4(place, 1, &packet.finish().unwrap());
        },
    },
    Bomb {
        name: "aedat4-xml",
        what: "a header of 4,000,000 elements",
        args: "convert in.aedat4 out.h5",
        fate: Fate::Refused,
        make: |place| {
            aedat4(place, 1, &[]);
            let mut file = std::fs::read(place.path("in.aedat4")).unwrap();
            let xml = format!("<dv>{}</dv>", "<a/>".repeat(4_000_000));
            let text = file.windows(4).position(|word| word == b"<dv ").unwrap();
            file.truncate(text - 4);
            file.extend(u32::try_from(xml.len()).unwrap().to_le_bytes());
            file.extend(xml.as_bytes());
            let length = u32::try_from(file.len() - 18).unwrap();
            file[14..18].copy_from_slice(&length.to_le_bytes());
            place.write("in.aedat4", file);
        },
    },
];

/// Writes an archive whose arrays hold `count` zeros and claim the shape `shape`.
fn npz(place: &Place, count: usize, shape: &str) {
    let mut archive = zip::ZipWriter::new(std::fs::File::create(place.path("in.npz")).unwrap());
    let deflated = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for (name, kind, bytes) in [("t", "<i8", 8), ("x", "<u2", 2), ("y", "<u2", 2), ("p", "|u1", 1)] {
        archive.start_file(format!("{name}.npy"), deflated).unwrap();
        archive.write_all(&npy(kind, shape)).unwrap();
        repeat(&mut archive, 0, bytes * count);
    }
    archive.finish().unwrap();
}

/// Writes a sound file of a few events on 346x260, after `change` has altered its bytes.
fn h5(place: &Place, change: impl Fn(&mut Vec<u8>)) {
    place.write("few.txt", "346 260\n0 1 1 1\n5 2 2 0\n9 345 259 1\n");
    place.ok("convert few.txt in.h5");
    std::fs::remove_file(place.path("few.txt")).unwrap();
    let mut file = std::fs::read(place.path("in.h5")).unwrap();
    change(&mut file);
    place.write("in.h5", file);
}

/// Replaces the size in the attributes.
fn patch_side(file: &mut [u8], side: u32) {
    for (name, was) in [(b"width".as_slice(), 346_u32), (b"height", 260)] {
        let name = file.windows(name.len()).position(|word| word == name).unwrap();
        let value = file[name..].windows(4).position(|word| word == was.to_le_bytes()).unwrap();
        file[name + value..][..4].copy_from_slice(&side.to_le_bytes());
    }
}

/// Writes a sound header that declares this compression, and one packet after it.
fn aedat4(place: &Place, compression: i32, packet: &[u8]) {
    place.write("few.txt", "346 260\n0 1 1 1\n");
    place.ok("convert few.txt in.aedat4");
    std::fs::remove_file(place.path("few.txt")).unwrap();
    let mut file = std::fs::read(place.path("in.aedat4")).unwrap();
    // The file begins with 14 bytes of version, then the header's length, then 20 bytes about the
    // header's table, whose first field is the compression.
    let length = u32::from_le_bytes(file[14..18].try_into().unwrap()) as usize;
    file[42..46].copy_from_slice(&compression.to_le_bytes());
    file.truncate(18 + length);
    if !packet.is_empty() {
        file.extend(0_i32.to_le_bytes());
        file.extend(i32::try_from(packet.len()).unwrap().to_le_bytes());
        file.extend(packet);
    }
    place.write("in.aedat4", file);
}
