//! Reading, line by line.

use super::NAMES;
use super::plain::PlainLines;
use crate::order::END_US;
use crate::{Event, EventFileError, EventLabel, EventSource, Polarity, StreamHeader};
use gs2e_files as files;
use gs2e_files::budget::{MAX_LINE, ShortLines};
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Number of events in a chunk.
const CHUNK: usize = 65_536;

/// Number of bytes read at a time.
const BLOCK: usize = 1 << 16;

/// The mark that some programs put before UTF-8 text.
const BYTE_ORDER_MARK: &str = "\u{feff}";

/// Unit of a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextTimeUnit {
    /// Seconds.
    Second,
    /// Milliseconds.
    Millisecond,
    /// Microseconds.
    Microsecond,
    /// Nanoseconds.
    Nanosecond,
}

impl TextTimeUnit {
    /// Number of digits after the point that reach nanoseconds.
    pub(super) fn digits(self) -> usize {
        match self {
            Self::Second => 9,
            Self::Millisecond => 6,
            Self::Microsecond => 3,
            Self::Nanosecond => 0,
        }
    }
}

/// Reads one stream. Its order is not checked.
#[derive(Debug)]
pub struct Reader<R = BufReader<File>> {
    lines: Lines<R>,
    /// The first line of events, which was read with the header.
    first: Option<String>,
    /// Columns of time, column, row and polarity in a line.
    places: [usize; 4],
    unit: Option<TextTimeUnit>,
    states_unit: bool,
    header: StreamHeader,
    /// The form of most lines, if the columns have it.
    plain: Option<PlainLines>,
}

impl Reader {
    /// Opens a file and reads the lines before the events. `size` and `unit` are given by the user;
    /// a size stated in the file must agree.
    ///
    /// # Errors
    /// The file is empty, the sensor size is unknown, or the line of names lacks a column.
    pub fn open(path: &Path, size: Option<Size>, unit: Option<TextTimeUnit>) -> Result<Self, EventFileError> {
        Self::new(BufReader::with_capacity(BLOCK, files::open(path)?), size, unit)
    }
}

impl<R: BufRead> Reader<R> {
    /// Reads the lines before the events, as [`Reader::open`] does.
    ///
    /// # Errors
    /// The text is empty, the sensor size is unknown, or the line of names lacks a column.
    pub fn new(input: R, size: Option<Size>, unit: Option<TextTimeUnit>) -> Result<Self, EventFileError> {
        let mut head = TextHead { size, places: [0, 1, 2, 3], states_unit: unit.is_some() };
        let input = ShortLines::new(input, MAX_LINE);
        let mut lines = Lines { input, number: 0 };
        let (mut first, mut is_empty) = (None, true);
        while let Some(line) = lines.next()? {
            // A file with a head and no events is an empty stream. An empty file is an error.
            is_empty &= line.trim().is_empty();
            if !head.takes(&line).map_err(|because| error_at(lines.number, &because))? {
                first = Some(line);
                break;
            }
        }
        if is_empty {
            let because = "the file is empty, wanted events, or at least a line that names their columns";
            return Err(EventFileError::Container(because.to_owned()));
        }
        let Some(size) = head.size.filter(|size| size.pixels() > 0) else {
            let time = first.as_deref().and_then(|line| split_fields(line).nth(head.places[0]));
            let because = match time {
                Some(time) if unit.is_none() && time.contains('.') => {
                    "the file states neither the sensor's size nor the unit of its times: give --size WIDTHxHEIGHT, \
                     and --time-unit s, ms, us or ns"
                }
                _ => "the file does not state the sensor's size: give --size WIDTHxHEIGHT",
            };
            return Err(EventFileError::Container(because.to_owned()));
        };
        let header = StreamHeader { size, law: None, labelled: false };
        let (places, states_unit) = (head.places, head.states_unit);
        let plain = PlainLines::new(places, size, unit);
        Ok(Self { lines, first, places, unit, states_unit, header, plain })
    }

    /// Returns true if the first time has a fraction and nothing states its unit.
    #[must_use]
    pub fn lacks_unit(&self) -> bool {
        let time = self.first.as_deref().and_then(|line| split_fields(line).nth(self.places[0]));
        self.unit.is_none() && time.is_some_and(|time| time.contains('.'))
    }

    /// Returns true if the unit of the times is known: the user or the file states it.
    #[must_use]
    pub(crate) fn states_unit(&self) -> bool {
        self.states_unit
    }

    /// The properties that the file states.
    #[must_use]
    pub fn header(&self) -> StreamHeader {
        self.header
    }

    /// Reads the plain lines that the buffer holds as a whole, up to the first other one.
    fn plain_lines(&mut self, out: &mut Vec<Event>) {
        let (None, Some(plain)) = (&self.first, &self.plain) else { return };
        // An error is met again, and reported, where a line is read.
        let Ok(buffer) = self.lines.input.get_mut().fill_buf() else { return };
        let before = out.len();
        let taken = plain.read(buffer, CHUNK - before, out);
        self.lines.input.get_mut().consume(taken);
        self.lines.number += (out.len() - before) as u64;
    }

    fn line(&mut self) -> Result<Option<String>, EventFileError> {
        if let Some(first) = self.first.take() {
            return Ok(Some(first));
        }
        self.lines.next()
    }

    fn event(&self, line: &str) -> Result<Event, String> {
        let fields: Vec<&str> = split_fields(line).collect();
        let field = |k: usize| {
            let found = fields.get(self.places[k]);
            found.ok_or_else(|| {
                format!(
                    "{} columns, but {} is expected in column {}",
                    fields.len(),
                    NAMES[k],
                    self.places[k] + 1
                )
            })
        };
        let t = parse_time(field(0)?, self.unit)?;
        if !(0..END_US).contains(&t.floor_micros()) {
            return Err(format!("t = {} us, wanted 0 to {}", t.floor_micros(), END_US - 1));
        }
        let coordinate = |k: usize, end: u32| {
            let text = field(k)?;
            // Parsed as the type of a coordinate, so that a large number is refused and not
            // wrapped.
            let found = text.parse::<u16>().ok().filter(|v| u32::from(*v) < end);
            found.ok_or_else(|| format!("{} = {text}, wanted 0 to {}", NAMES[k], end - 1))
        };
        let Size { width, height } = self.header.size;
        let polarity = match *field(3)? {
            "1" | "+1" => Polarity::On,
            "0" | "-1" => Polarity::Off,
            other => return Err(format!("p = {other}, wanted 0 or 1, or -1 or 1")),
        };
        Ok(Event {
            t,
            x: coordinate(1, width)?,
            y: coordinate(2, height)?,
            polarity,
            label: EventLabel::Signal,
        })
    }
}

impl<R: BufRead> EventSource for Reader<R> {
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        out.clear();
        loop {
            self.plain_lines(out);
            if out.len() >= CHUNK {
                break;
            }
            let Some(line) = self.line()? else { break };
            let content = line.split('#').next().unwrap_or_default();
            if !content.trim().is_empty() {
                out.push(self.event(content).map_err(|because| error_at(self.lines.number, &because))?);
            }
        }
        Ok(!out.is_empty())
    }
}

/// The lines of a file, each of at most [`MAX_LINE`] bytes, with their numbers.
#[derive(Debug)]
struct Lines<R> {
    input: ShortLines<R>,
    /// Number of lines so far.
    number: u64,
}

impl<R: BufRead> Lines<R> {
    fn next(&mut self) -> Result<Option<String>, EventFileError> {
        let Some(line) = self.input.next() else { return Ok(None) };
        self.number += 1;
        let mut line = line.map_err(|e| error_at(self.number, &e.to_string()))?;
        // Only at the start of the file. Elsewhere it is a character of a field.
        if self.number == 1 && line.starts_with(BYTE_ORDER_MARK) {
            line.drain(..BYTE_ORDER_MARK.len());
        }
        Ok(Some(line))
    }
}

/// The head of a text: everything before the events.
struct TextHead {
    size: Option<Size>,
    places: [usize; 4],
    states_unit: bool,
}

impl TextHead {
    /// Returns true if a line belongs to the head. Its content is stored.
    fn takes(&mut self, line: &str) -> Result<bool, String> {
        if let Some(comment) = line.trim().strip_prefix('#') {
            // Our own form: `t x y p in us; sensor 640x360`.
            self.states_unit |= comment.contains(" in us");
            let size = comment.split_once("sensor ").and_then(|(_, size)| size.trim().split_once('x'));
            return self.sized(size).map(|()| true);
        }
        let fields: Vec<&str> = split_fields(line).collect();
        match fields[..] {
            [] => Ok(true),
            // Two numbers in a line of their own are the sensor size; an event has four columns.
            [width, height] => self.sized(Some((width, height))).map(|()| true),
            // A line of names has no number at all, so a damaged event is not taken for one.
            _ if fields.iter().all(|f| f.parse::<f64>().is_err()) => self.named(&fields).map(|()| true),
            _ => Ok(false),
        }
    }

    fn sized(&mut self, found: Option<(&str, &str)>) -> Result<(), String> {
        let Some((Ok(width), Ok(height))) = found.map(|(w, h)| (w.parse(), h.parse())) else { return Ok(()) };
        let found = Size { width, height };
        match self.size {
            Some(said) if said != found => Err(format!("a sensor of {found}, but --size is {said}")),
            _ => {
                self.size = Some(found);
                Ok(())
            }
        }
    }

    fn named(&mut self, names: &[&str]) -> Result<(), String> {
        let others =
            [&["t", "ts", "time", "timestamp", "t_us"][..], &["x"], &["y"], &["p", "polarity", "pol", "on"]];
        for (k, known) in others.iter().enumerate() {
            let place = names.iter().position(|name| known.contains(&name.to_lowercase().as_str()));
            self.places[k] = place.ok_or_else(|| {
                format!("no column is named {}, found {}", known.join(" or "), names.join(", "))
            })?;
        }
        Ok(())
    }
}

fn error_at(line: u64, because: &str) -> EventFileError {
    EventFileError::Container(format!("line {line}: {because}"))
}

fn split_fields(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| c.is_whitespace() || c == ',' || c == ';').filter(|field| !field.is_empty())
}

/// A decimal time, digit by digit: seconds since 1970 to the microsecond have more digits than an
/// f64. Digits below a nanosecond are cut off.
fn parse_time(text: &str, unit: Option<TextTimeUnit>) -> Result<Timestamp, String> {
    let refuse = || format!("t = {text}, wanted a decimal number");
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let unit = match unit {
        Some(unit) => unit,
        None if !text.contains('.') => TextTimeUnit::Microsecond,
        None => {
            return Err(format!("t = {text} has a fraction: give its unit with --time-unit s, ms, us or ns"));
        }
    };
    let negative = whole.starts_with('-');
    let digits = whole.trim_start_matches(['-', '+']);
    let sound = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
    if digits.is_empty() || !sound(digits) || !sound(fraction) {
        return Err(refuse());
    }
    let places = unit.digits();
    let kept = fraction.chars().chain(std::iter::repeat('0')).take(places);
    // Digits are joined before they are parsed, so no rounding takes place.
    let ns: i64 = digits.chars().chain(kept).collect::<String>().parse().map_err(|_| refuse())?;
    Ok(Timestamp(if negative { -ns } else { ns }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::sample::select;

    /// Parts of lines, sound and unsound. Whole lines among them lead into the middle of a file.
    const PARTS: [&[u8]; 44] = [
        b"0",
        b"1",
        b"7",
        b"00",
        b"12",
        b"639",
        b"640",
        b"0012",
        b"65535",
        b"65541",
        b"000000003",
        b"12345678",
        b"123456789",
        b"1468941032",
        b"999999999999999999",
        b"9223372036854774",
        b"9223372036854775807",
        b"1468941032.229165635",
        b"0.0038110004",
        b".",
        b"-",
        b"+",
        b"-1",
        b"+1",
        b" ",
        b",",
        b";",
        b"\t",
        b"  ",
        b"\n",
        b"\r\n",
        b"\r",
        b"#",
        b"t",
        b"\x0b",
        "\u{feff}".as_bytes(),
        "\u{a0}".as_bytes(),
        b"\xff",
        b"\x8a",
        b"1 2 3 0\n",
        b"20 2 3 1\r\n",
        b"5,6,7,1\n",
        b"5 6 7 1 9\n",
        b"0.25 6 7 -1\n",
    ];

    /// A file with a head, the places of its columns by their names, and lines from `PARTS`.
    fn file(order: &str, parts: &[&[u8]]) -> Vec<u8> {
        let head = format!("# sensor 640x480\n{order}\n1 1 1 1 1\n");
        // Enough bytes behind the last part, so that lines are not left out for being near the end.
        [head.as_bytes(), &parts.concat(), b"\n", &b"1 1 1 1\n".repeat(12)].concat()
    }

    /// All events, and the error that ends them.
    fn read(bytes: &[u8], unit: Option<TextTimeUnit>, block: usize, is_plain: bool) -> (Vec<Event>, String) {
        let mut reader = Reader::new(BufReader::with_capacity(block, bytes), None, unit).unwrap();
        if !is_plain {
            reader.plain = None;
        }
        let (mut events, mut chunk) = (Vec::new(), Vec::new());
        loop {
            match reader.next_chunk(&mut chunk) {
                Ok(true) => events.append(&mut chunk),
                Ok(false) => return (events, String::new()),
                Err(e) => return (events, e.to_string()),
            }
        }
    }

    fn unit() -> impl Strategy<Value = Option<TextTimeUnit>> {
        use TextTimeUnit::{Microsecond, Millisecond, Nanosecond, Second};
        select(vec![None, Some(Second), Some(Millisecond), Some(Microsecond), Some(Nanosecond)])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        /// Files that are read with and without plain lines have the same events, and are refused for the
        /// same reason.
        #[test]
        fn plain_lines_are_read_like_all_others(
            order in select(vec!["t x y p", "x y p t", "x,y,t,p", "p t y x", "t x y q p"]),
            parts in prop::collection::vec(select(PARTS.to_vec()), 0..24),
            unit in unit(),
            block in select(vec![16, 70, 100, 4096]),
        ) {
            let bytes = file(order, &parts);
            prop_assert_eq!(read(&bytes, unit, block, true), read(&bytes, unit, block, false));
        }

        /// Sound lines with numbers of all lengths.
        #[test]
        fn numbers_of_all_lengths_are_read_alike(
            lines in prop::collection::vec(
                "[0-9]{1,19}(\\.[0-9]{1,19})?[ ,;\t]0{0,3}[0-9]{1,4}[ ,][0-9]{1,3}[ ,][01]\r?\n",
                1..12,
            ),
            unit in unit(),
        ) {
            let parts: Vec<&[u8]> = lines.iter().map(String::as_bytes).collect();
            let bytes = file("t x y p", &parts);
            prop_assert_eq!(read(&bytes, unit, 4096, true), read(&bytes, unit, 4096, false));
        }

        #[test]
        fn arbitrary_bytes_are_read_alike(bytes in prop::collection::vec(any::<u8>(), 0..300), unit in unit()) {
            let bytes = file("t x y p", &[&bytes]);
            prop_assert_eq!(read(&bytes, unit, 4096, true), read(&bytes, unit, 4096, false));
        }
    }

    /// The usual lines do not take the slow way.
    #[test]
    fn usual_lines_are_plain() {
        let t = |order: [usize; 4], unit: Option<TextTimeUnit>, line: &str, wanted: i64| {
            let plain = PlainLines::new(order, Size { width: 640, height: 480 }, unit).unwrap();
            let mut events = Vec::new();
            let bytes = [line, &"\0".repeat(64)].concat();
            assert_eq!(plain.read(bytes.as_bytes(), 9, &mut events), line.len(), "{line:?}");
            let event = events.pop().unwrap();
            assert_eq!((event.t.0, event.x, event.y, event.polarity), (wanted, 639, 47, Polarity::On));
        };
        let second = Some(TextTimeUnit::Second);
        t([0, 1, 2, 3], None, "1474999,639,47,1\n", 1_474_999_000);
        t([0, 1, 2, 3], None, "1700000000000001 639 47 1\r\n", 1_700_000_000_000_001_000);
        t([0, 1, 2, 3], second, "0.003811000 639 47 1\n", 3_811_000);
        t([3, 0, 1, 2], second, "639 47 1 1468941032.229165635\n", 1_468_941_032_229_165_635);
        t([3, 2, 1, 0], None, "+1\t47\t639\t5\n", 5000);
    }
}
