//! The events in packets: at most 10 ms each, at least one in each pause of 4 s, and one across each overflow
//! of the clock that no packet with events spans.
//!
//! Decoders count the overflows, by different rules. `event_camera_codecs` takes any step down for one.
//! Prophesee's own decoder, and those made after it, want a step from the last 40 ms of a turn to the first
//! 40 ms of the next (Metavision SDK, sample `metavision_evt3_raw_file_decoder`).

use super::{PACKET_US, SILENCE_US};
use crate::ExportError;
use gs2e_event::Event;
use gs2e_event::evt::packet::{OVERFLOW_US, PacketEncoder};
use gs2e_num::units::Timestamp;

/// Bytes after which a packet is complete, however short: many events at once would take much memory.
const PACKET_BYTES: usize = 1 << 20;

/// A packet.
#[derive(Debug)]
pub(super) struct EventPacket {
    /// Time of its first event, us from the start of the interval.
    pub(super) t_us: i64,
    /// Words of EVT 3.0.
    pub(super) words: Vec<u8>,
}

/// Collects events.
#[derive(Debug)]
pub(super) struct EventPackets {
    encoder: PacketEncoder,
    /// Time of the open packet's first event.
    open_us: Option<i64>,
    /// Last time that the words state.
    last_us: i64,
    events: u64,
}

impl EventPackets {
    pub(super) fn new() -> Self {
        Self { encoder: PacketEncoder::default(), open_us: None, last_us: 0, events: 0 }
    }

    /// Number of events.
    pub(super) fn events(&self) -> u64 {
        self.events
    }

    /// Adds an event. Packets that are complete go to `send`.
    pub(super) fn add(
        &mut self,
        event: &Event,
        t_us: i64,
        mut send: impl FnMut(EventPacket) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let is_full = |open_us| t_us - open_us >= PACKET_US || self.encoder.byte_count() >= PACKET_BYTES;
        if self.open_us.is_some_and(is_full) {
            self.finish(&mut send)?;
        }
        if self.open_us.is_none() {
            self.bridge(t_us, &mut send)?;
            self.begin(t_us);
        }
        self.events += 1;
        self.last_us = t_us;
        let event = Event { t: Timestamp::from_micros(t_us), ..*event };
        self.encoder.put(&event).ok_or_else(|| {
            ExportError::Data(format!("t = {t_us} us: EVT 3.0 has no words for so long a pause before it"))
        })
    }

    /// Sends packets without an event for the pause before `t_us`.
    fn bridge(
        &mut self,
        t_us: i64,
        send: &mut impl FnMut(EventPacket) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        loop {
            let overflow = self.last_us - self.last_us.rem_euclid(OVERFLOW_US) + OVERFLOW_US;
            let due = overflow.min(self.last_us + SILENCE_US);
            if due > t_us {
                return Ok(());
            }
            if due == overflow {
                // The last microsecond of a turn and the first one of the next, in one packet.
                self.begin(due - 1);
                self.encoder.begin(due);
            } else {
                self.begin(due);
            }
            self.last_us = due;
            self.finish(&mut *send)?;
        }
    }

    fn begin(&mut self, t_us: i64) {
        self.encoder.begin(t_us);
        self.open_us = Some(t_us);
    }

    /// Completes the open packet, if there is one.
    pub(super) fn finish(
        &mut self,
        mut send: impl FnMut(EventPacket) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let Some(t_us) = self.open_us.take() else { return Ok(()) };
        send(EventPacket { t_us, words: self.encoder.finish() })
    }
}
