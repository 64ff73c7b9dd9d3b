//! Forgeries of the data itself: events, pictures and arrays that stay valid in their formats.

use super::super::audit::BASE;
use gs2e_event::h5::{ChunkFilter, H5Options};
use gs2e_event::{Event, EventSink as _, EventSource as _, h5};
use gs2e_image::{Image, Size, npy, png};
use std::fs;
use std::io::Cursor;
use std::path::Path;

/// Rewrites the events of the first trajectory.
pub(super) fn events(folder: &Path, options: H5Options, change: impl FnOnce(&mut Vec<Event>)) {
    let path = folder.join(BASE).join("events.h5");
    let mut reader = h5::Reader::open(&path).unwrap();
    let (header, mut events, mut chunk) = (reader.header().unwrap(), Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk).unwrap() {
        events.extend_from_slice(&chunk);
    }
    change(&mut events);
    let mut writer = h5::Writer::create_as(&path, &header, options).unwrap();
    writer.append(&events).unwrap();
    let stamps = fs::read_to_string(folder.join(BASE).join("timestamps_us.txt")).unwrap();
    writer.finish(stamps.lines().next_back().unwrap().parse().unwrap()).unwrap();
}

/// Two events of one pixel exchange their polarities, so that every count stays the same, and the
/// picture in the report too.
pub(super) fn trade_polarities(events: &mut [Event]) {
    let pairs = (0..events.len()).flat_map(|i| (i + 1..events.len()).map(move |j| (i, j)));
    let place = |event: &Event| (event.x, event.y);
    let mut opposite = pairs.filter(|(i, j)| {
        place(&events[*i]) == place(&events[*j]) && events[*i].polarity != events[*j].polarity
    });
    let (i, j) = opposite.next().unwrap();
    let (a, b) = (events[i].polarity, events[j].polarity);
    (events[i].polarity, events[j].polarity) = (b, a);
    events.sort_by_key(Event::file_order);
}

/// Delays the first event that can be one microsecond later and still sorts before the next.
pub(super) fn delay_one(events: &mut [Event]) {
    let us = |event: &Event| event.t.floor_micros();
    let later = events
        .windows(2)
        .position(|pair| us(&pair[1]) > us(&pair[0]) + 1 && (us(&pair[0]) + 1) / 1000 == us(&pair[0]) / 1000);
    let event = &mut events[later.unwrap()];
    event.t = gs2e_num::units::Timestamp::from_micros(event.t.floor_micros() + 1);
}

pub(super) fn drop_one(events: &mut Vec<Event>) {
    events.remove(0);
}

pub(super) fn nothing(_: &mut Vec<Event>) {}

/// Options that store the same events in another way.
pub(super) fn plain() -> H5Options {
    H5Options { filter: ChunkFilter::None, ..H5Options::default() }
}

/// Rewrites a picture.
pub(super) fn picture(path: &Path, change: impl FnOnce(&mut Vec<[u8; 3]>)) {
    let image = png::read_rgb(Cursor::new(fs::read(path).unwrap())).unwrap();
    let (size, mut pixels) = (image.size(), image.pixels().to_vec());
    change(&mut pixels);
    let mut bytes = Vec::new();
    png::write_image(&Image::from_vec(size, pixels), &mut bytes).unwrap();
    fs::write(path, bytes).unwrap();
}

/// A PNG file with a text chunk before its end.
pub(super) fn with_text_chunk(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let (kind, text) = (b"tEXt", b"Comment\0hidden");
    let mut chunk = u32::try_from(text.len()).unwrap().to_be_bytes().to_vec();
    chunk.extend(kind);
    chunk.extend(text);
    let mut crc = flate2::Crc::new();
    crc.update(&chunk[4..]);
    chunk.extend(crc.sum().to_be_bytes());
    let end = bytes.len() - 12;
    bytes.splice(end..end, chunk);
    fs::write(path, bytes).unwrap();
}

/// Rewrites a depth image.
pub(super) fn depth(path: &Path, size: Size, change: impl FnOnce(&mut Vec<f32>)) {
    let shape = [u64::from(size.height), u64::from(size.width)];
    let mut values = npy::read_values(&shape, &mut Cursor::new(fs::read(path).unwrap())).unwrap();
    change(&mut values);
    let mut bytes = Vec::new();
    npy::write_values(&shape, &values, &mut bytes).unwrap();
    fs::write(path, bytes).unwrap();
}
