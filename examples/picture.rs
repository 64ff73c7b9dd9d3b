//! Makes the picture of the README from a release: a sharp frame beside the events around it.
//!
//! `cargo run --release --example picture -- TRAJECTORY_FOLDER FRAME WINDOW_US OUT.png`

use gs2e_event::picture::{WindowCounts, join_pictures};
use gs2e_event::{Event, EventSink, EventSource, h5};
use gs2e_image::png;
use std::error::Error;
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, frame, window_us, out] = arguments.as_slice() else {
        return Err("usage: picture TRAJECTORY_FOLDER FRAME WINDOW_US OUT.png".into());
    };
    let (folder, frame, window_us) = (Path::new(folder), frame.parse::<usize>()?, window_us.parse::<i64>()?);
    let stamps = std::fs::read_to_string(folder.join("timestamps_us.txt"))?;
    let stamp: i64 = stamps.lines().nth(frame).ok_or("there is no such frame")?.parse()?;
    let sharp = png::read_rgb(BufReader::new(File::open(folder.join(format!("sharp/{frame:06}.png")))?))?;
    let mut events = WindowCounts::new(sharp.size(), stamp - window_us / 2..stamp + window_us / 2)?;
    let mut reader = h5::Reader::open(&folder.join("events.h5"))?;
    let mut chunk: Vec<Event> = Vec::new();
    while reader.next_chunk(&mut chunk)? {
        events.append(&chunk)?;
    }
    let picture = join_pictures(&[&sharp, &events.image()], 8);
    png::write_image(&picture, BufWriter::new(File::create(out)?))?;
    Ok(())
}
