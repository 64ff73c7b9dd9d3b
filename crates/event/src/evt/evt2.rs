//! EVT 2.0: bits 31..28 are the kind of a word. An event has 6 bits of time, 11 of x and 11 of y; a
//! time word has the 28 higher bits of the time.

use super::reader::{DecodedWords, GROUP, WordDecoder};
use crate::order;
use crate::{Event, EventLabel, Polarity};
use gs2e_num::units::Timestamp;

const TIME_HIGH: u32 = 0x8;
const TRIGGER: u32 = 0xa;
const OTHERS: u32 = 0xe;
const CONTINUED: u32 = 0xf;

/// Number of time bits in an event.
const LOW: u32 = 6;

/// Number of time bits in total, 34: 4.8 hours.
pub(super) const END_US: i64 = 1 << 34;

/// Encodes events as words.
#[derive(Debug, Default)]
pub(super) struct Evt2Encoder {
    high: Option<u32>,
}

impl Evt2Encoder {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times are below END_US")]
    pub(super) fn put(&mut self, event: &Event, out: &mut Vec<u8>) {
        let t = event.t.floor_micros() as u64;
        let (high, low) = ((t >> LOW) as u32, t as u32 & ((1 << LOW) - 1));
        // Written only where it changes: events between two time words share the upper bits.
        if self.high != Some(high) {
            self.high = Some(high);
            out.extend_from_slice(&(TIME_HIGH << 28 | high).to_le_bytes());
        }
        // The kinds 0 and 1 are OFF and ON events, so the polarity is the kind.
        let word = (event.polarity as u32) << 28 | low << 22 | u32::from(event.x) << 11 | u32::from(event.y);
        out.extend_from_slice(&word.to_le_bytes());
    }
}

/// Decodes words into events.
#[derive(Debug, Default)]
pub(super) struct Evt2Decoder {
    /// The part of the time from time words; `None` before the first.
    high: Option<u32>,
    /// Number of overflows of the time.
    turns: i64,
}

impl WordDecoder for Evt2Decoder {
    const BYTES: usize = 4;

    #[expect(clippy::cast_possible_truncation, reason = "masked to 11 bits")]
    fn take_usual(&mut self, bytes: &[u8], found: &mut DecodedWords<'_>) -> usize {
        let Some(high) = self.high else { return 0 };
        let start_us = self.turns * END_US + (i64::from(high) << LOW);
        if start_us > order::END_US - (1 << LOW) {
            return 0;
        }
        let start_ns = 1000 * start_us;
        let side = |word: u32, from: u32| word >> from & 0x7ff;
        let [last_x, last_y] = found.last_pixel();
        let (words, _) = bytes.as_chunks();
        let (groups, _) = words.as_chunks::<GROUP>();
        for (number, group) in groups.iter().enumerate() {
            let group = group.map(u32::from_le_bytes);
            // Not 0 if a word is no event, or not on the sensor: then a difference is negative.
            let wrong = group.iter().fold(0, |wrong, word| {
                let outside = last_x.wrapping_sub(side(*word, 11)) | last_y.wrapping_sub(side(*word, 0));
                wrong | *word >> 29 | outside >> 31
            });
            if wrong != 0 {
                return GROUP * number;
            }
            found.extend_with(group.iter().map(|word| Event {
                t: Timestamp(start_ns + i64::from(1000 * (word >> 22 & ((1 << LOW) - 1)))),
                x: side(*word, 11) as u16,
                y: side(*word, 0) as u16,
                polarity: if word >> 28 == 1 { Polarity::On } else { Polarity::Off },
                label: EventLabel::Signal,
            }));
        }
        GROUP * groups.len()
    }

    fn take(&mut self, bytes: &[u8], found: &mut DecodedWords<'_>) -> Result<(), String> {
        let word = u32::from_le_bytes(bytes.try_into().expect("a word has 4 bytes"));
        match word >> 28 {
            kind @ (0 | 1) => {
                let Some(high) = self.high else {
                    found.untimed += 1;
                    return Ok(());
                };
                let low = word >> 22 & ((1 << LOW) - 1);
                let t_us = self.turns * END_US + (i64::from(high) << LOW | i64::from(low));
                let (x, y) = ((word >> 11 & 0x7ff) as u16, (word & 0x7ff) as u16);
                let polarity = if kind == 1 { Polarity::On } else { Polarity::Off };
                found.push(t_us, [x, y], polarity)
            }
            TIME_HIGH => {
                let high = word & 0x0fff_ffff;
                // A large step backwards is an overflow of the counter, not disorder.
                self.turns += i64::from(self.high.is_some_and(|last| last > high && last - high > 1 << 27));
                self.high = Some(high);
                Ok(())
            }
            TRIGGER | OTHERS | CONTINUED => Ok(()),
            kind => Err(format!("a word of kind {kind:#x}, which EVT 2.0 does not have")),
        }
    }
}
