//! EVT 3.0: bits 15..12 are the kind of a word, the others its value. Time has 12 + 12 bits and
//! overflows every 16.8 seconds. Row and time hold until they are replaced. A run of pixels is a
//! base and masks of 12 or 8 pixels.

use super::reader::{DecodedWords, WordDecoder};
use crate::order::END_US;
use crate::{Event, EventLabel, Polarity};
use gs2e_num::units::Timestamp;

const ADDRESS_Y: u16 = 0x0;
const ADDRESS_X: u16 = 0x2;
const BASE_X: u16 = 0x3;
const MASK_12: u16 = 0x4;
const MASK_8: u16 = 0x5;
const TIME_LOW: u16 = 0x6;
const CONTINUED_4: u16 = 0x7;
const TIME_HIGH: u16 = 0x8;
const TRIGGER: u16 = 0xa;
const OTHERS: u16 = 0xe;
const CONTINUED_12: u16 = 0xf;

/// Number of bits of each half of a time, and of the value of a word.
const TIME_BITS: u32 = 12;
/// Largest value of a word.
const VALUE: u16 = (1 << TIME_BITS) - 1;

/// Minimum number of events for which a base and a mask are shorter.
const WORTH_A_MASK: usize = 3;

/// Largest step of the upper part of a time that is written at once. A reader notices an overflow
/// by a step down, so steps of a quarter of the range leave no doubt about the number of overflows.
const STEP: i64 = 1 << (TIME_BITS - 2);

/// Maximum number of words in a stream that only bridge silence, 2 bytes for each 4.2 seconds: 51
/// days.
pub(super) const MAX_SILENT_WORDS: i64 = 1 << 20;

/// Number of events that are decoded before they are passed on.
const SPAN: usize = 64;

/// Encodes events as words. Events of one time, row and polarity wait for one another.
#[derive(Debug, Default)]
pub(super) struct Evt3Encoder {
    /// Time divided by 2^12, without overflow; `None` before the first.
    high: Option<i64>,
    low: Option<u16>,
    row: Option<u16>,
    /// The run of the columns that wait, or of the last that were written.
    run: Option<PixelRun>,
    columns: Vec<u16>,
    /// The time that was written last, if it was that of a run.
    run_us: Option<i64>,
    /// Time divided by 2^12 of the last event, and the number of words that silence takes up to it.
    put_high: i64,
    silent_words: i64,
}

/// The properties that the pixels of a run share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PixelRun {
    t_us: i64,
    row: u16,
    polarity: Polarity,
}

fn write_word(kind: u16, value: u16, out: &mut Vec<u8>) {
    out.extend_from_slice(&(kind << TIME_BITS | value & VALUE).to_le_bytes());
}

impl Evt3Encoder {
    /// Encodes an event. Returns `None` if silence takes more words than [`MAX_SILENT_WORDS`].
    pub(super) fn put(&mut self, event: &Event, out: &mut Vec<u8>) -> Option<()> {
        let t_us = event.t.floor_micros();
        let high = t_us >> TIME_BITS;
        // The encoder bridges a pause with one word for each whole step.
        self.silent_words += (high - self.put_high) / STEP;
        self.put_high = high;
        // Checked per event: a single late time could fill the disk with time words.
        if self.silent_words > MAX_SILENT_WORDS {
            return None;
        }
        // A run of pixels has one time, row and polarity, so a change of any of them ends it.
        let run = Some(PixelRun { t_us, row: event.y, polarity: event.polarity });
        if self.run != run {
            self.flush(out);
            self.run = run;
        }
        self.columns.push(event.x);
        Some(())
    }

    /// Writes the collected events, and then the time `t_us` in full. The next event writes its row again,
    /// so a reader may begin here. The caller keeps pauses shorter than half an overflow.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "masked to 12 bits")]
    pub(super) fn restart(&mut self, t_us: i64, out: &mut Vec<u8>) {
        self.flush(out);
        let (high, low) = (t_us >> TIME_BITS, (t_us as u16) & VALUE);
        write_word(TIME_HIGH, high as u16, out);
        write_word(TIME_LOW, low, out);
        (self.high, self.low, self.row) = (Some(high), Some(low), None);
        self.run_us = None;
    }

    /// Writes the collected events.
    pub(super) fn flush(&mut self, out: &mut Vec<u8>) {
        let Some(run) = self.run.filter(|_| !self.columns.is_empty()) else { return };
        if self.run_us != Some(run.t_us) {
            self.run_us = Some(run.t_us);
            self.time(run.t_us, out);
        }
        let polarity = (run.polarity as u16) << 11;
        if self.row != Some(run.row) {
            self.row = Some(run.row);
            // Most runs are one pixel in a row of its own: two words at once.
            if let [x] = self.columns[..] {
                let words = u32::from(ADDRESS_X << TIME_BITS | x | polarity) << 16 | u32::from(run.row);
                out.extend_from_slice(&words.to_le_bytes());
                self.columns.clear();
                return;
            }
            write_word(ADDRESS_Y, run.row, out);
        }
        let mut rest = &self.columns[..];
        while let Some(&x) = rest.first() {
            let (mask, taken) = if rest.len() < WORTH_A_MASK { (0, 0) } else { leading_mask(rest, x) };
            // A base and a mask are two words, so fewer columns are shorter as single events.
            if taken < WORTH_A_MASK {
                write_word(ADDRESS_X, x | polarity, out);
                rest = &rest[1..];
                continue;
            }
            write_word(BASE_X, x | polarity, out);
            let (mut base, mut mask, mut taken) = (x, mask, taken);
            // The base advances by itself: each further mask costs no more than one event.
            while taken > 0 {
                write_word(MASK_12, mask, out);
                rest = &rest[taken..];
                base += 12;
                (mask, taken) = leading_mask(rest, base);
            }
        }
        self.columns.clear();
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "masked to 12 bits")]
    fn time(&mut self, t_us: i64, out: &mut Vec<u8>) {
        let (high, low) = (t_us >> TIME_BITS, (t_us as u16) & VALUE);
        let mut at = self.high.unwrap_or(0);
        // A reader takes a large step for an overflow of the counter, so long pauses are bridged in
        // small ones.
        while high - at > STEP {
            at += STEP;
            write_word(TIME_HIGH, at as u16, out);
        }
        if self.high != Some(high) {
            write_word(TIME_HIGH, high as u16, out);
            // A reader sets the lower part to 0 at a new upper part, so it is written again.
            self.low = None;
        }
        if self.low != Some(low) {
            write_word(TIME_LOW, low, out);
        }
        (self.high, self.low) = (Some(high), Some(low));
    }
}

/// The mask of the leading columns within 12 of `base`, and their number. A repeated column ends
/// it.
fn leading_mask(columns: &[u16], base: u16) -> (u16, usize) {
    let mut mask = 0;
    let mut taken = 0;
    for &x in columns {
        let Some(bit) = x.checked_sub(base).filter(|bit| *bit < 12) else { break };
        // Columns ascend, so a bit at or above this one is the same column once more.
        if mask >> bit != 0 {
            break;
        }
        mask |= 1 << bit;
        taken += 1;
    }
    (mask, taken)
}

/// Decodes words into events.
#[derive(Debug, Default)]
pub(super) struct Evt3Decoder {
    high: Option<u16>,
    low: u16,
    turns: i64,
    row: Option<u16>,
    base: u16,
    polarity: u16,
    /// True if words were lost since the last time: no event has a time until the next one.
    stale: bool,
    /// Time by another clock at the next upper part, if one is known.
    expected_us: Option<i64>,
    /// Time at the first upper part of a packet.
    first_us: Option<i64>,
}

impl Evt3Decoder {
    /// Begins a packet of words. If words before it were `lost`, the row and the time are unknown until
    /// their next words. `expected_us` is the time of the packet by another clock: it shows overflows
    /// without a word.
    pub(super) fn begin_packet(&mut self, lost: bool, expected_us: Option<i64>) {
        if lost {
            (self.stale, self.row) = (true, None);
        }
        (self.expected_us, self.first_us) = (expected_us, None);
    }

    /// Time at the first upper part of the packet, us.
    pub(super) fn first_us(&self) -> Option<i64> {
        self.first_us
    }

    fn t_us(&self, high: u16) -> i64 {
        (self.turns << TIME_BITS | i64::from(high)) << TIME_BITS | i64::from(self.low)
    }

    fn set_high(&mut self, value: u16) {
        // A large step backwards is an overflow of the counter, not disorder.
        self.turns += i64::from(self.high.is_some_and(|last| last > value && last - value > 1 << 11));
        // The lower part starts at 0 until its own word comes. A repeated upper part changes nothing.
        if self.high != Some(value) || self.stale {
            (self.high, self.low) = (Some(value), 0);
        }
        self.stale = false;
        if let Some(expected) = self.expected_us.take() {
            // Times beyond the last turn are refused with their first event.
            self.turns = (self.turns + missed_turns(self.t_us(value), expected)).min(LAST_TURN);
        }
        // After missed overflows are added: the next packet is expected from this time on.
        self.first_us = self.first_us.or(Some(self.t_us(value)));
    }

    /// An event in the present row and at the present time.
    fn event(&self, x: u16, on: bool, found: &mut DecodedWords<'_>) -> Result<(), String> {
        let (Some(high), Some(y), false) = (self.high, self.row, self.stale) else {
            found.untimed += 1;
            return Ok(());
        };
        let t_us = self.t_us(high);
        let polarity = if on { Polarity::On } else { Polarity::Off };
        found.push(t_us, [x, y], polarity)
    }

    /// Takes the first words that are single events, rows and lower times on the sensor, and returns their
    /// number. `None` if time or row is unknown. Which kind comes next is hardly foreseen, so every word is
    /// decoded as each of the three.
    fn take_span(&mut self, words: &[[u8; 2]], found: &mut DecodedWords<'_>) -> Option<usize> {
        let high = self.high.filter(|_| !self.stale)?;
        // Of this upper part, whatever the lower one is.
        let start_us = self.t_us(high) - i64::from(self.low);
        let mut row = self.row.filter(|row| found.has(0, *row))?;
        if start_us > END_US - (1 << TIME_BITS) {
            return None;
        }
        let start_ns = 1000 * start_us;
        // Any address of another kind is too large.
        let mut limits = [0; 1 << (16 - TIME_BITS)];
        let [last_x, last_y] = found.last_pixel();
        limits[usize::from(ADDRESS_X)] = last_x + 1;
        limits[usize::from(ADDRESS_Y)] = last_y + 1;
        limits[usize::from(TIME_LOW)] = u32::MAX;
        let (mut low, mut taken, mut ended) = (self.low, 0, false);
        let event = |x, y, low: u16, flag| Event {
            t: Timestamp(start_ns + i64::from(1000 * u32::from(low))),
            x,
            y,
            polarity: if flag == 1 { Polarity::On } else { Polarity::Off },
            label: EventLabel::Signal,
        };
        let mut events = [event(0, 0, 0, 0); SPAN];
        while taken < words.len() && !ended {
            let mut count = 0;
            while count < SPAN
                && let Some(word) = words.get(taken)
            {
                let word = u16::from_le_bytes(*word);
                let next = words.get(taken + 1).map_or(0, |word| u16::from_le_bytes(*word));
                let (kind, address) = (word >> TIME_BITS, word & 0x7ff);
                if u32::from(address) >= limits[usize::from(kind)] {
                    ended = true;
                    break;
                }
                // The usual pair: a row and its only event.
                let x = next & 0x7ff;
                if kind == ADDRESS_Y && next >> TIME_BITS == ADDRESS_X && u32::from(x) <= last_x {
                    row = address;
                    events[count] = event(x, row, low, next >> 11 & 1);
                    count += 1;
                    taken += 2;
                    continue;
                }
                row = if kind == ADDRESS_Y { address } else { row };
                low = if kind == TIME_LOW { word & VALUE } else { low };
                events[count] = event(address, row, low, word >> 11 & 1);
                count += usize::from(kind == ADDRESS_X);
                taken += 1;
            }
            found.extend(&events[..count]);
        }
        (self.row, self.low) = (Some(row), low);
        Some(taken)
    }

    /// Takes a word of a run of pixels on the sensor, and returns true, or leaves it.
    fn take_run(&mut self, word: u16, found: &mut DecodedWords<'_>) -> bool {
        match (word >> TIME_BITS, self.row) {
            (BASE_X, _) => (self.base, self.polarity) = (word & 0x7ff, word >> 11 & 1),
            (MASK_12, Some(y)) if found.has(self.base + 11, y) => {
                // Cannot fail: the pixels are on the sensor, and their time was known before.
                return self.run(word & VALUE, 12, found).is_ok();
            }
            _ => return false,
        }
        true
    }

    fn run(&mut self, mask: u16, bits: u16, found: &mut DecodedWords<'_>) -> Result<(), String> {
        for bit in (0..bits).filter(|bit| mask >> bit & 1 == 1) {
            self.event(self.base + bit, self.polarity != 0, found)?;
        }
        // Bounded, so that the masks of a damaged file cannot overflow the column.
        self.base = (self.base + bits).min(VALUE);
        Ok(())
    }
}

/// Time after which the counter overflows, us.
pub(super) const TURN_US: i64 = 1 << (2 * TIME_BITS);

/// Number of the first overflow after all times.
const LAST_TURN: i64 = END_US / TURN_US + 1;

/// Number of overflows between a time and the time by another clock, to the nearest. A clock that is behind
/// shows none: it was set back, or stands still.
fn missed_turns(t_us: i64, expected_us: i64) -> i64 {
    (expected_us.saturating_sub(t_us).saturating_add(TURN_US / 2) / TURN_US).max(0)
}

impl WordDecoder for Evt3Decoder {
    const BYTES: usize = 2;

    fn take_usual(&mut self, bytes: &[u8], found: &mut DecodedWords<'_>) -> usize {
        let (words, _) = bytes.as_chunks();
        let mut number = 0;
        while let Some(taken) = self.take_span(&words[number..], found) {
            number += taken;
            // The words of runs stand between, and others are left to `take`.
            let Some(word) = words.get(number) else { break };
            if !self.take_run(u16::from_le_bytes(*word), found) {
                break;
            }
            number += 1;
        }
        number
    }

    fn take(&mut self, bytes: &[u8], found: &mut DecodedWords<'_>) -> Result<(), String> {
        let word = u16::from_le_bytes(bytes.try_into().expect("a word has 2 bytes"));
        let (value, address, flag) = (word & VALUE, word & 0x7ff, word >> 11 & 1);
        match word >> TIME_BITS {
            ADDRESS_Y => self.row = Some(address),
            ADDRESS_X => return self.event(address, flag == 1, found),
            BASE_X => (self.base, self.polarity) = (address, flag),
            MASK_12 => return self.run(value, 12, found),
            MASK_8 => return self.run(value & 0xff, 8, found),
            // This does not end a stale time: the upper part is still unknown.
            TIME_LOW => self.low = value,
            TIME_HIGH => self.set_high(value),
            TRIGGER | OTHERS | CONTINUED_4 | CONTINUED_12 => {}
            kind => return Err(format!("a word of kind {kind:#x}, which EVT 3.0 does not have")),
        }
        Ok(())
    }
}
