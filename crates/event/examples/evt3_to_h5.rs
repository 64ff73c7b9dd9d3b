//! A recording in EVT 2 or EVT 3 as an HDF5 file in the layout of DSEC:
//! `cargo run --release --features hdf5 --example evt3_to_h5 -- recording.raw events.h5`

use gs2e_event::{Event, EventSink as _, EventSource as _, evt, h5};
use std::{env, error::Error, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [recording, out] = &arguments[..] else {
        return Err("usage: evt3_to_h5 recording.raw events.h5".into());
    };
    let mut reader = evt::Reader::open(Path::new(recording))?;
    let mut writer = h5::Writer::create(Path::new(out), &reader.header())?;
    let (mut chunk, mut last_us) = (Vec::<Event>::new(), 0);
    while reader.next_chunk(&mut chunk)? {
        writer.append(&chunk)?;
        last_us = chunk.last().map_or(last_us, |event| event.t.floor_micros());
    }
    writer.finish(last_us)?;
    Ok(())
}
