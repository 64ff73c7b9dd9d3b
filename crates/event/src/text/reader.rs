//! Reading, line by line.

use super::NAMES;
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
    fn digits(self) -> usize {
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
}

impl Reader {
    /// Opens a file and reads the lines before the events. `size` and `unit` are given by the user;
    /// a size stated in the file must agree.
    ///
    /// # Errors
    /// The file is empty, the sensor size is unknown, or the line of names lacks a column.
    pub fn open(path: &Path, size: Option<Size>, unit: Option<TextTimeUnit>) -> Result<Self, EventFileError> {
        Self::new(BufReader::new(files::open(path)?), size, unit)
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
        Ok(Self { lines, first, places: head.places, unit, states_unit: head.states_unit, header })
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
        while out.len() < CHUNK {
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
