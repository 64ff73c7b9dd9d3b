//! `events.h5`, or a file of `events/`. It opens and its index is right. Its events are sorted, on
//! the sensor, within the time, and have the stated counts.

use super::{AuditFault, FaultCode, TrajectoryFolder};
use gs2e_event::{Event, EventFileError, EventLabel, EventSource, Polarity, h5};
use gs2e_release::scene::TrajectoryStatistics;
use gs2e_sensor::SensorChoice;

/// What a scene states of a stream.
#[derive(Debug)]
pub(super) struct StatedStream<'a> {
    /// Name of its file.
    pub(super) name: String,
    /// Counts of `scene.json`.
    pub(super) counts: &'a TrajectoryStatistics,
    /// The sensor of the recipe; `None` if the recipe has none of this name.
    pub(super) sensor: Option<&'a SensorChoice>,
}

/// Audits one stream.
pub(super) fn audit_stream(folder: &TrajectoryFolder<'_>, stream: &StatedStream<'_>) -> Vec<AuditFault> {
    let StatedStream { name, counts: stated, sensor } = stream;
    let mut faults = Vec::new();
    match count_stream(folder, name) {
        Ok(counted) => {
            let label = sensor.and_then(|sensor| label_fault(sensor, &counted));
            faults.extend(label.map(|message| folder.fault(FaultCode::ClaimsDisagree, name, message)));
            let StreamCount { events, on, peak, active, .. } = counted;
            faults.extend(counted.faults.map(|message| folder.fault(FaultCode::Unreadable, name, message)));
            let all = [
                ("events", events, stated.events),
                ("ON events", on, stated.on),
                ("events in its busiest millisecond", peak, stated.peak_ev_per_ms),
                ("pixels with an event", active, stated.active_pixels),
            ];
            let others =
                all.iter().filter(|(_, found, stated)| stated.is_some_and(|stated| stated != *found));
            let differing: Vec<String> = others
                .map(|(what, found, stated)| {
                    format!("{found} {what}, scene.json says {}", stated.unwrap_or(0))
                })
                .collect();
            if !differing.is_empty() {
                let message = format!("it holds {}", differing.join("; "));
                faults.push(folder.fault(FaultCode::ClaimsDisagree, name, message));
            }
        }
        Err(e) => faults.push(folder.fault(FaultCode::Unreadable, name, e.to_string())),
    }
    faults
}

/// Describes labels that the sensor cannot have made.
fn label_fault(sensor: &SensorChoice, counted: &StreamCount) -> Option<String> {
    let asked = sensor.as_model().labels();
    if counted.labelled != asked {
        let [found, wanted] = [counted.labelled, asked].map(|has| if has { "labels" } else { "no labels" });
        return Some(format!("it has {found}, the sensor of the recipe makes {wanted}"));
    }
    let noise = counted.noise;
    (noise > 0 && !sensor.as_model().makes_noise()).then(|| {
        format!(
            "{noise} of its events are labelled as noise, the sensor of the recipe has no source of noise"
        )
    })
}

/// The first misplaced event and the counts of a stream.
struct StreamCount {
    faults: Option<String>,
    events: u64,
    on: u64,
    /// Maximum number of events in one millisecond.
    peak: u64,
    /// Number of pixels with an event.
    active: u64,
    /// True if the events have labels.
    labelled: bool,
    /// Number of events that are labelled as noise.
    noise: u64,
}

fn count_stream(folder: &TrajectoryFolder<'_>, name: &str) -> Result<StreamCount, EventFileError> {
    let mut reader = h5::Reader::open(&folder.on_disk(name))?;
    // The reader takes the index as it stands, so the index is verified first.
    reader.verify_index()?;
    let size = folder.files.camera.size;
    let labelled = reader.labelled();
    let mut counted = StreamCount { faults: None, events: 0, on: 0, peak: 0, active: 0, labelled, noise: 0 };
    counted.faults = h5::foreign_object(&folder.on_disk(name))?
        .map(|what| format!("it has {what}, which the release format does not"));
    if reader.header().is_none_or(|header| header.size != size) {
        counted.faults = Some(format!("its sensor does not have the size {size} of scene.json"));
    }
    let mut seen = vec![false; size.pixels()];
    let (mut millisecond, mut within) = (i64::MIN, 0);
    let mut chunk = Vec::new();
    let mut previous: Option<Event> = None;
    while reader.next_chunk(&mut chunk)? {
        for event in &chunk {
            // Only the first misplaced event is described: one shift can misplace all that follow.
            if counted.faults.is_none() {
                let number = counted.events;
                counted.faults = misplaced_event(folder, previous.as_ref(), event)
                    .map(|because| format!("event {number} {because}"));
            }
            counted.events += 1;
            counted.noise += u64::from(event.label == EventLabel::Noise);
            counted.on += u64::from(event.polarity == Polarity::On);
            // Sorted events make one run of each millisecond; events out of order are a fault
            // already.
            let ms = event.t.floor_micros().div_euclid(1000);
            within = if ms == millisecond { within + 1 } else { 1 };
            (millisecond, counted.peak) = (ms, counted.peak.max(within));
            let (x, y) = (usize::from(event.x), usize::from(event.y));
            // Without this test an event to the right of the sensor would count for the next row.
            if x < size.width as usize
                && let Some(seen) = seen.get_mut(y * size.width as usize + x)
            {
                *seen = true;
            }
            previous = Some(*event);
        }
    }
    counted.active = seen.into_iter().filter(|seen| *seen).count() as u64;
    Ok(counted)
}

fn misplaced_event(folder: &TrajectoryFolder<'_>, previous: Option<&Event>, event: &Event) -> Option<String> {
    let (size, end_us, t_us) = (folder.files.camera.size, folder.part.duration_us, event.t.floor_micros());
    if u32::from(event.x) >= size.width || u32::from(event.y) >= size.height {
        Some(format!("is at ({}, {}), outside {size}", event.x, event.y))
    } else if t_us > end_us {
        Some(format!("is at {t_us} us, after the last stamp {end_us} us"))
    } else if previous.is_some_and(|before| before.file_order() > event.file_order()) {
        Some("is out of order".into())
    } else {
        None
    }
}
