//! EVT 3.0 in packets, as messages of robots hold it: the words of one stream, cut into pieces that each
//! have a number and a time of their own.
//!
//! The time of EVT 3.0 overflows every 16.8 s, and a reader counts the overflows that it sees. Packets that
//! are lost, and long pauses without a packet, hide some. The times of the packets show them.
//!
//! # Examples
//! ```
//! use gs2e_event::evt::packet::{PacketEncoder};
//! use gs2e_event::{Event, EventLabel, Polarity};
//! use gs2e_num::units::Timestamp;
//!
//! let mut encoder = PacketEncoder::default();
//! encoder.begin(20);
//! let t = Timestamp::from_micros(21);
//! encoder
//!     .put(&Event { t, x: 3, y: 1, polarity: Polarity::On, label: EventLabel::Signal })
//!     .ok_or("the silence is too long")?;
//! // Words of 16 bits.
//! assert_eq!(encoder.finish().len() % 2, 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::evt3::{Evt3Decoder, Evt3Encoder, TURN_US};
use super::reader::{DecodedWords, WordDecoder as _};
use crate::Event;
use gs2e_image::Size;

/// Size of a word, bytes.
pub(crate) const WORD: usize = Evt3Decoder::BYTES;

/// Time after which the clock is 0 again, us.
pub const OVERFLOW_US: i64 = TURN_US;

/// Encodes events in packets. A packet begins with its whole time and the row of its first event, so a
/// reader that begins with it misses the overflows before it only.
#[derive(Debug, Default)]
pub struct PacketEncoder {
    encoder: Evt3Encoder,
    words: Vec<u8>,
}

impl PacketEncoder {
    /// Begins a packet at a time. Two packets begin less than half an overflow apart, 8.3 s.
    pub fn begin(&mut self, t_us: i64) {
        self.encoder.restart(t_us, &mut self.words);
    }

    /// Adds an event. Returns `None` if silence takes more words than the format allows.
    pub fn put(&mut self, event: &Event) -> Option<()> {
        self.encoder.put(event, &mut self.words)
    }

    /// Number of bytes so far. The last run of pixels is not among them.
    #[must_use]
    pub fn byte_count(&self) -> usize {
        self.words.len()
    }

    /// The words of the packet.
    pub fn finish(&mut self) -> Vec<u8> {
        self.encoder.flush(&mut self.words);
        std::mem::take(&mut self.words)
    }
}

/// Decodes packets into events.
#[derive(Debug, Default)]
pub(crate) struct PacketDecoder {
    decoder: Evt3Decoder,
    before: Option<PacketMark>,
    /// Number of events without a time or a row.
    untimed: u64,
}

/// The place of a packet in the stream.
#[derive(Debug)]
struct PacketMark {
    seq: u64,
    stamp_ns: i64,
    /// Time of its first word, if known.
    t_us: Option<i64>,
}

impl PacketDecoder {
    /// Begins a packet with this number and time.
    pub(crate) fn begin(&mut self, seq: u64, stamp_ns: i64) {
        let before = self.before.take();
        // A writer that does not count leaves the same number.
        let lost = before.as_ref().is_some_and(|b| seq != b.seq && Some(seq) != b.seq.checked_add(1));
        let expected = before.and_then(|b| {
            let since_us = stamp_ns.saturating_sub(b.stamp_ns) / 1000;
            // A packet without an upper part has no time of its own, so the expected one stands for it.
            Some(self.decoder.first_us().or(b.t_us)?.saturating_add(since_us))
        });
        self.decoder.begin_packet(lost, expected);
        self.before = Some(PacketMark { seq, stamp_ns, t_us: expected });
    }

    /// Decodes words of the packet from a sensor of `size`. The error has the offset of the word.
    pub(crate) fn decode(
        &mut self,
        words: &[u8],
        size: Size,
        out: &mut Vec<Event>,
    ) -> Result<(), (usize, String)> {
        let mut found = DecodedWords::new(out, size);
        for (number, word) in words.chunks_exact(WORD).enumerate() {
            self.decoder.take(word, &mut found).map_err(|because| (number * WORD, because))?;
        }
        self.untimed += found.untimed;
        Ok(())
    }

    /// Number of events that were dropped because they have no time or no row.
    pub(crate) fn untimed(&self) -> u64 {
        self.untimed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EventLabel, Polarity};
    use gs2e_num::units::Timestamp;

    const SIZE: Size = Size { width: 2048, height: 2048 };

    fn event(t_us: i64, x: u16, y: u16) -> Event {
        let t = Timestamp::from_micros(t_us);
        Event { t, x, y, polarity: Polarity::On, label: EventLabel::Signal }
    }

    /// A packet of one event.
    fn packet(encoder: &mut PacketEncoder, event: &Event) -> Vec<u8> {
        encoder.begin(event.t.floor_micros());
        encoder.put(event).unwrap();
        encoder.finish()
    }

    /// Packets `(seq, time)`, each with one event, decoded with stamps that count from 1 s.
    fn decoded(packets: &[(u64, i64)]) -> Vec<i64> {
        let (mut decoder, mut out) = (PacketDecoder::default(), Vec::new());
        for (seq, t_us) in packets {
            let words = packet(&mut PacketEncoder::default(), &event(*t_us, 3, 4));
            decoder.begin(*seq, (t_us + 1_000_000) * 1000);
            decoder.decode(&words, SIZE, &mut out).unwrap();
        }
        assert_eq!(decoder.untimed(), 0);
        out.iter().map(|event| event.t.floor_micros()).collect()
    }

    #[test]
    fn overflows_without_a_packet_are_seen_by_the_stamps() {
        let t = |times: &[i64]| {
            let packets: Vec<(u64, i64)> = (0..).zip(times.iter().copied()).collect();
            assert_eq!(decoded(&packets), times);
        };
        t(&[0, 5_000_000, 12_000_000, 17_000_000, 22_000_000, 34_000_000]);
        // Pauses of one and of several overflows, with and without a step down of the counter.
        t(&[1_000_000, 1_000_000 + TURN_US, 1_500_000 + 5 * TURN_US]);
        t(&[16_000_000, 15_000_000 + TURN_US, 14_000_000 + 3 * TURN_US, 16_777_215 + 300 * TURN_US]);
        // Ten seconds that step down by less than half of the counter.
        t(&[16_000_000, 26_000_000]);
    }

    /// Stamps that stand still or go back show nothing; the counter itself is believed.
    #[test]
    fn useless_stamps_do_no_harm() {
        let (mut decoder, mut encoder, mut out) =
            (PacketDecoder::default(), PacketEncoder::default(), Vec::new());
        let times = [16_000_000, 20_000_000, 27_000_000, 34_000_000];
        for ((seq, t_us), stamp_ns) in (0..).zip(times).zip([0, 0, -60_000_000_000, i64::MIN]) {
            decoder.begin(seq, stamp_ns);
            decoder.decode(&packet(&mut encoder, &event(t_us, 0, 0)), SIZE, &mut out).unwrap();
        }
        assert_eq!(out.iter().map(|event| event.t.floor_micros()).collect::<Vec<_>>(), times);
    }

    /// Words after a lost packet have the row and the time of nothing until these words come.
    #[test]
    fn events_after_a_lost_packet_wait_for_time_and_row() {
        let (mut decoder, mut out) = (PacketDecoder::default(), Vec::new());
        let words = |words: &[u16]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
        decoder.begin(7, 0);
        decoder.decode(&words(&[0x8001, 0x6002, 0x0005, 0x2801]), SIZE, &mut out).unwrap();
        // The next number: the row holds. A later one: it does not, and neither does the time.
        decoder.begin(8, 1_000_000);
        decoder.decode(&words(&[0x2802]), SIZE, &mut out).unwrap();
        decoder.begin(10, 2_000_000);
        decoder.decode(&words(&[0x2803, 0x0006, 0x2804, 0x8001, 0x2805]), SIZE, &mut out).unwrap();
        let found: Vec<_> = out.iter().map(|e| (e.t.floor_micros(), e.x, e.y)).collect();
        assert_eq!(found, [(4098, 1, 5), (4098, 2, 5), (4096, 5, 6)]);
        assert_eq!(decoder.untimed(), 2);
    }

    #[test]
    fn a_packet_begins_with_time_and_row() {
        let mut encoder = PacketEncoder::default();
        let far = event(20_000_000, 2047, 2047);
        let first = packet(&mut encoder, &far);
        // 20,000,000 is 4882 x 4096 + 3328, and 4882 is 786 after one overflow.
        let wanted = [0x8000 | 786, 0x6000 | 3328, 2047, 0x2000 | 0x800 | 2047_u16];
        assert_eq!(first, wanted.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>());
        assert_eq!(packet(&mut encoder, &far), first, "nothing is left out in the second one");
    }
}
