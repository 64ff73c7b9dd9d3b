//! Properties of an event file.

use super::PathFacts;
use crate::cli::{VerbError, input};
use gs2e_event::file::OpenEventFile;
use gs2e_event::survey::EventSurvey;
use gs2e_num::units::{Timestamp, format_amount};
use serde_json::json;
use std::path::Path;

pub(super) fn event_facts(place: &Path, mut opened: OpenEventFile) -> Result<PathFacts, VerbError> {
    let found = EventSurvey::measure_stream(&mut *opened.source);
    let found = found.map_err(|e| input::wrong_events(place, &e))?;
    let format = place.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let header = opened.header;
    let share = |part: u64| (found.events > 0).then(|| part as f64 / found.events as f64);
    let ends = found.span.map(|(first, last)| [first, last].map(Timestamp::floor_micros));
    let law = header.law.map(|law| json!({ "c_on": law.c_on, "c_off": law.c_off, "version": law.version }));
    let value = json!({
        "format": format, "width": header.size.width, "height": header.size.height,
        "events": found.events, "on": found.on, "on_share": share(found.on),
        "first_us": ends.map(|[first, _]| first), "last_us": ends.map(|[_, last]| last),
        "rate_ev_s": found.rate(),
        "labelled": header.labelled, "signal": header.labelled.then_some(found.signal),
        "sorted": found.backward == 0, "backward": found.backward, "untimed": found.untimed,
        "law": law,
    });
    let mut rows = vec![("format", format!(".{format}")), ("sensor", header.size.to_string())];
    rows.extend(count_rows(&found, header.labelled));
    if opened.assumes_us {
        rows.push(("unit", "not stated: whole times are read as microseconds; see --time-unit".to_owned()));
    }
    if let Some(law) = header.law {
        rows.push(("thresholds", format!("ON {:.4}, OFF {:.4}, in ln L", law.c_on, law.c_off)));
    }
    Ok(PathFacts { kind: "events", title: "events", rows, recipe: Vec::new(), value })
}

fn count_rows(found: &EventSurvey, labelled: bool) -> Vec<(&'static str, String)> {
    let percent = |part: u64| match found.events {
        0 => String::new(),
        events => format!(", {:.2} %", 100.0 * part as f64 / events as f64),
    };
    let mut rows =
        vec![("events", found.events.to_string()), ("ON", format!("{}{}", found.on, percent(found.on)))];
    if let Some((first, last)) = found.span {
        let [first, last] = [first, last].map(Timestamp::floor_micros);
        rows.push(("time", format!("{first} to {last} us")));
    }
    if let Some(rate) = found.rate() {
        rows.push(("rate", rate_text(rate)));
    }
    let labels = labelled.then(|| format!("{} signal{}", found.signal, percent(found.signal)));
    rows.push(("labels", labels.unwrap_or_else(|| "none".to_owned())));
    let order = match found.backward {
        0 => "sorted by time".to_owned(),
        backward => format!("not sorted: {backward} events are earlier than the one before"),
    };
    rows.push(("order", order));
    if found.untimed > 0 {
        rows.push(("untimed", format!("{} events before the first time of the recording", found.untimed)));
    }
    rows
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive; a cast saturates")]
fn rate_text(rate: f64) -> String {
    if rate < 1000.0 { format!("{rate:.1} ev/s") } else { format_amount(rate as u64, "ev/s") }
}
