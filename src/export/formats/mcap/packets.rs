//! The events in packets: at most 10 ms each, and at least one in each pause of 4 s.

use super::{PACKET_US, SILENCE_US};
use crate::event::Event;
use crate::event::evt::packet::PacketEncoder;
use crate::export::ExportError;
use crate::units::Timestamp;

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
    /// Time at which the last packet began.
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
        let is_full = |open_us| t_us - open_us >= PACKET_US || self.encoder.len() >= PACKET_BYTES;
        if self.open_us.is_some_and(is_full) {
            self.finish(&mut send)?;
        }
        if self.open_us.is_none() {
            // Packets without an event let readers count the overflows of the clock.
            while t_us - self.last_us > SILENCE_US {
                self.begin(self.last_us + SILENCE_US);
                self.finish(&mut send)?;
            }
            self.begin(t_us);
        }
        self.events += 1;
        let event = Event { t: Timestamp::from_micros(t_us), ..*event };
        self.encoder.put(&event).ok_or_else(|| {
            ExportError::Data(format!("t = {t_us} us: EVT 3.0 has no words for so long a pause before it"))
        })
    }

    fn begin(&mut self, t_us: i64) {
        self.encoder.begin(t_us);
        (self.open_us, self.last_us) = (Some(t_us), t_us);
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
