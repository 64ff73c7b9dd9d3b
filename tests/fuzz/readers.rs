//! The readers, each with its starting files. A container that protects its content with checksums
//! is opened first and closed again around the changed content: otherwise every mutated file would
//! be refused at once.

use crate::corpus::{Corpus, files, inflated, zipped};
use crate::{command_lines, consoles};
use gs2e_event as event;
use gs2e_event::{EventSource, text};
use gs2e_image::{Size, jpeg, png};
use gs2e_recipe::{RecipeFile, read_files};
use gs2e_scene::{ply, sog, splat, spz};
use gs2e_sensor::frames::array::FullScale;
use gs2e_sensor::frames::{FrameSequence as _, folder, npy};
use gs2e_source::{colmap, nerfstudio};
use std::io::{Cursor, Write as _};
use std::path::Path;
use std::time::Duration;
use zip::CompressionMethod;
use zip::write::SimpleFileOptions;

/// A reader under test.
pub(crate) struct Reader {
    pub(crate) name: &'static str,
    pub(crate) corpus: fn() -> Corpus,
    /// Returns true if the file is sound.
    pub(crate) read: fn(&[u8]) -> bool,
}

const PLY: [&str; 4] = [
    "tests/golden/scenes/packed-plain.expected.ply",
    "tests/fuzz/corpus/ascii.ply",
    "tests/fuzz/corpus/far.ply",
    "tests/fuzz/corpus/lists.ply",
];
const PACKED: [&str; 3] = [
    "tests/golden/scenes/packed-plain.ply",
    "tests/golden/scenes/packed-third-degree.ply",
    "tests/fuzz/corpus/packed-ascii.ply",
];
const SPZ: [&str; 3] =
    ["tests/fuzz/corpus/v2.spz", "tests/fuzz/corpus/v3.spz", "tests/fuzz/corpus/extension.spz"];
const EVENTS: [&str; 6] = [
    "tests/fuzz/corpus/none.h5",
    "tests/fuzz/corpus/three.h5",
    "tests/fuzz/corpus/none.npz",
    "tests/fuzz/corpus/many.npz",
    "tests/fuzz/corpus/labels.h5",
    "tests/fuzz/corpus/labels.npz",
];
const EVT: [&str; 2] = ["tests/fuzz/corpus/evt2.raw", "tests/fuzz/corpus/evt3.raw"];
const AEDAT4: [&str; 2] = ["tests/fuzz/corpus/few.aedat4", "tests/fuzz/corpus/plain.aedat4"];
const FRAMES: [&str; 2] = ["tests/fuzz/corpus/davis.aedat4", "tests/fuzz/corpus/colour.aedat4"];
const MCAP: [&str; 2] = ["tests/fuzz/corpus/few.mcap", "tests/fuzz/corpus/plain.mcap"];
const TEXT: [&str; 3] =
    ["tests/fuzz/corpus/few.txt", "tests/fuzz/corpus/few.csv", "tests/fuzz/corpus/foreign.txt"];
const IMAGES: [&str; 6] = [
    "tests/fuzz/corpus/colour.jpg",
    "tests/fuzz/corpus/colour.png",
    "tests/fuzz/corpus/deep.png",
    "tests/fuzz/corpus/grey.jpg",
    "tests/fuzz/corpus/grey.png",
    "tests/fuzz/corpus/progressive.jpg",
];
const ARRAYS: [&str; 3] =
    ["tests/fuzz/corpus/bytes.npy", "tests/fuzz/corpus/floats.npy", "tests/fuzz/corpus/stamps.npy"];
const SOG: &str = "tests/golden/scenes/flat.sog";
const PALETTE: &str = "tests/golden/scenes/palette.sog";

pub(crate) const READERS: [Reader; 25] = [
    Reader { name: "release", corpus: crate::forging::corpus, read: crate::forging::read },
    Reader { name: "ply", corpus: || files(&PLY), read: |file| ply::read_ply(file).is_ok() },
    Reader { name: "packed", corpus: || files(&PACKED), read: |file| ply::read_ply(file).is_ok() },
    Reader {
        name: "splat",
        corpus: || files(&["tests/fuzz/corpus/three.splat"]),
        read: |file| splat::read_splat(file).is_ok(),
    },
    Reader { name: "spz", corpus: || files(&SPZ), read: |file| spz::read_spz(file).is_ok() },
    Reader {
        name: "spz-4",
        corpus: || files(&["tests/fuzz/corpus/v4.spz"]),
        read: |file| spz::read_spz(file).is_ok(),
    },
    Reader {
        name: "spz-content",
        corpus: || inflated(&SPZ),
        read: |content| spz::read_spz(&gzip(content)).is_ok(),
    },
    Reader { name: "sog", corpus: || files(&[SOG]), read: |file| sog::read_sog(file).is_ok() },
    Reader {
        name: "sog-meta",
        corpus: || [zipped(PALETTE, "json"), zipped(SOG, "json")].concat(),
        read: |json| read_parts(&zipped(PALETTE, ".webp"), json),
    },
    Reader { name: "sog-image", corpus: || zipped(PALETTE, ".webp"), read: read_as_every_image },
    Reader { name: "colmap", corpus: || model("bin"), read: |file| read_model(file, "bin") },
    Reader { name: "colmap-text", corpus: || model("txt"), read: |file| read_model(file, "txt") },
    Reader {
        name: "transforms",
        corpus: || files(&["tests/fuzz/corpus/transforms.json"]),
        read: |file| on_disk(file, "transforms.json", |path| nerfstudio::read_capture(path).is_ok()),
    },
    Reader {
        name: "recipe",
        corpus: || files(&["recipes/demo.yaml", "tests/fuzz/corpus/recipe.yaml"]),
        read: |file| {
            on_disk(file, "recipe.yaml", |path| {
                read_files(&[RecipeFile { path: path.to_owned(), defaults: None }]).is_ok()
            })
        },
    },
    Reader { name: "events", corpus: || files(&EVENTS), read: |file| on_disk(file, "events", read_events) },
    Reader {
        name: "evt",
        corpus: || files(&EVT),
        read: |file| on_disk(file, "events", |path| event::evt::Reader::open(path).is_ok_and(drain)),
    },
    Reader {
        name: "aedat4",
        corpus: || files(&AEDAT4),
        read: |file| on_disk(file, "events", |path| event::aedat4::Reader::open(path).is_ok_and(drain)),
    },
    Reader {
        name: "aedat4-frames",
        corpus: || files(&FRAMES),
        read: |file| {
            on_disk(file, "frames", |path| event::aedat4::FrameReader::open(path).is_ok_and(drain_frames))
        },
    },
    Reader {
        name: "mcap",
        corpus: || files(&MCAP),
        read: |file| on_disk(file, "events", |path| event::mcap::Reader::open(path, None).is_ok_and(drain)),
    },
    Reader {
        name: "event-text",
        corpus: || files(&TEXT),
        read: |file| {
            let size = Size { width: 32, height: 24 };
            on_disk(file, "events", |path| text::Reader::open(path, Some(size), None).is_ok_and(drain))
        },
    },
    Reader { name: "image", corpus: || files(&IMAGES), read: read_image },
    Reader {
        name: "npy",
        corpus: || files(&ARRAYS),
        read: |file| on_disk(file, "array.npy", |path| npy::read_stamps(path).is_ok() || read_stack(path)),
    },
    Reader {
        name: "info",
        corpus: || files(&["tests/fuzz/corpus/info.txt"]),
        read: |file| {
            on_disk(b"", "grey.png", |_| true);
            on_disk(file, folder::INFO, |path| {
                folder::FolderListing::list_folder(path.parent().unwrap()).is_ok()
            })
        },
    },
    Reader { name: "command-lines", corpus: command_lines::corpus, read: command_lines::read },
    Reader { name: "consoles", corpus: consoles::corpus, read: consoles::read },
];

impl Reader {
    /// Maximum time of a run. An audit of a whole tree is slow in an unoptimised program, and one
    /// run of `consoles` starts several processes.
    pub(crate) fn longest(&self) -> Duration {
        Duration::from_secs(match self.name {
            "release" => 30,
            "consoles" => 60,
            _ => 1,
        })
    }
}

/// Reads the file as both kinds of image, for its luminance and for its colours.
fn read_image(file: &[u8]) -> bool {
    let png = || Cursor::new(file);
    let luminance = [png::read_luminance(png(), None).is_ok(), jpeg::read_luminance(file, None).is_ok()];
    let colours = [png::read_colours(png(), None).is_ok(), jpeg::read_colours(file, None).is_ok()];
    let has_luminance = colours.iter().zip(luminance).all(|(&colours, luminance)| !colours || luminance);
    assert!(has_luminance, "what has colours has luminance");
    luminance.contains(&true)
}

/// Reads a stack of frames to its end.
fn read_stack(path: &Path) -> bool {
    let Ok(stack) = npy::FrameStack::open(path) else { return false };
    let stamps: Vec<i64> = (0..).take(stack.frames()).collect();
    let Ok(mut frames) = npy::NpyFrames::new(stack, FullScale::One, &stamps) else { return false };
    loop {
        match frames.next() {
            Ok(Some(_)) => {}
            Ok(None) => return true,
            Err(_) => return false,
        }
    }
}

/// The three files of a model.
fn model(extension: &str) -> Corpus {
    let paths = ["cameras", "images", "points3D"].map(|name| format!("tests/fuzz/corpus/{name}.{extension}"));
    files(&paths.each_ref().map(String::as_str))
}

fn gzip(content: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(content).unwrap();
    encoder.finish().unwrap()
}

/// Reads a SOG of these images.
fn read_parts(images: &Corpus, json: &[u8]) -> bool {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let meta = (sog::META.to_owned(), json.to_owned());
    for (name, content) in images.iter().chain([&meta]) {
        archive.start_file(name.as_str(), stored).unwrap();
        archive.write_all(content).unwrap();
    }
    sog::read_sog(&archive.finish().unwrap().into_inner()).is_ok()
}

/// Replaces each image of a SOG in turn by this one, and reads the SOG.
fn read_as_every_image(image: &[u8]) -> bool {
    thread_local! {
        static SOUND: (Corpus, Vec<u8>) = (zipped(PALETTE, ".webp"), zipped(PALETTE, "json").remove(0).1);
    }
    SOUND.with(|(images, json)| {
        let read = |k: usize| {
            let mut images = images.clone();
            images[k].1 = image.to_vec();
            read_parts(&images, json)
        };
        // All are read, since each image may fail in its own place.
        (0..images.len()).filter(|&k| read(k)).count() > 0
    })
}

/// Writes the file into the process's own folder and reads it.
fn on_disk(file: &[u8], name: &str, read: impl Fn(&Path) -> bool) -> bool {
    let path = std::env::current_dir().unwrap().join(name);
    std::fs::write(&path, file).unwrap();
    read(&path)
}

/// Reads the file as each of a model's three files.
fn read_model(file: &[u8], extension: &str) -> bool {
    for name in ["cameras", "images"] {
        on_disk(file, &format!("{name}.{extension}"), |_| true);
    }
    on_disk(file, &format!("points3D.{extension}"), |path| {
        let Ok(model) = colmap::ColmapModel::find_model(path.parent().unwrap()) else { return false };
        [model.cameras().is_ok(), model.images().is_ok(), model.points().is_ok()].contains(&true)
    })
}

/// Reads the file as both kinds of event stream, to its end.
fn read_events(path: &Path) -> bool {
    let h5 = event::h5::Reader::open(path).is_ok_and(|reader| {
        let indexed = reader.verify_index().is_ok();
        drain(reader) && indexed
    });
    h5 || event::npz::Reader::open(path).is_ok_and(drain)
}

fn drain_frames(mut reader: event::aedat4::FrameReader) -> bool {
    loop {
        match reader.next_frame() {
            Ok(None) => return true,
            Ok(Some(_)) => {}
            Err(_) => return false,
        }
    }
}

/// Reads a stream. Returns true if its end was reached.
fn drain(mut source: impl EventSource) -> bool {
    let mut chunk = Vec::new();
    loop {
        match source.next_chunk(&mut chunk) {
            Ok(true) => {}
            Ok(false) => return true,
            Err(_) => return false,
        }
    }
}
