//! `events.h5`, or a file of `events/`: it opens, its index is right, its events are sorted, on the sensor, in time, and as many as stated.

use super::{Code, Fault, Folder};
use crate::event::{Event, EventFileError, EventSource, Polarity, h5};
use crate::release::scene::Statistics;

/// Audits one stream; `stated` is what `scene.json` counts of it.
pub(super) fn audit(folder: &Folder<'_>, name: &str, stated: &Statistics) -> Vec<Fault> {
    let mut faults = Vec::new();
    match count(folder, name) {
        Ok(Counted { faults: found, events, on }) => {
            faults.extend(found.map(|message| folder.fault(Code::Unreadable, name, message)));
            let stated = (stated.events.unwrap_or(events), stated.on.unwrap_or(on));
            if (events, on) != stated {
                let message = format!(
                    "it holds {events} events, {on} of them ON; scene.json says {} and {}",
                    stated.0, stated.1
                );
                faults.push(folder.fault(Code::ClaimsDisagree, name, message));
            }
        }
        Err(e) => faults.push(folder.fault(Code::Unreadable, name, e.to_string())),
    }
    faults
}

/// What a pass over the stream found: the first event that is out of place, and the counts.
struct Counted {
    faults: Option<String>,
    events: u64,
    on: u64,
}

fn count(folder: &Folder<'_>, name: &str) -> Result<Counted, EventFileError> {
    let mut reader = h5::Reader::open(&folder.on_disk(name))?;
    reader.verify_index()?;
    let size = folder.camera.size;
    let mut counted = Counted { faults: None, events: 0, on: 0 };
    if reader.header().is_none_or(|header| header.size != size) {
        counted.faults = Some(format!("its sensor is not the {size} of scene.json"));
    }
    let mut chunk = Vec::new();
    let mut previous: Option<Event> = None;
    while reader.next_chunk(&mut chunk)? {
        for event in &chunk {
            if counted.faults.is_none() {
                let number = counted.events;
                counted.faults = misplaced(folder, previous.as_ref(), event)
                    .map(|because| format!("event {number} {because}"));
            }
            counted.events += 1;
            counted.on += u64::from(event.polarity == Polarity::On);
            previous = Some(*event);
        }
    }
    Ok(counted)
}

fn misplaced(folder: &Folder<'_>, previous: Option<&Event>, event: &Event) -> Option<String> {
    let (size, end_us, t_us) = (folder.camera.size, folder.part.duration_us, event.t.floor_micros());
    if u32::from(event.x) >= size.width || u32::from(event.y) >= size.height {
        Some(format!("is at ({}, {}), outside {size}", event.x, event.y))
    } else if t_us > end_us {
        Some(format!("is at {t_us} us, after the last stamp {end_us} us"))
    } else if previous.is_some_and(|before| before.file_order() > event.file_order()) {
        Some("does not sort behind the one before it".into())
    } else {
        None
    }
}
