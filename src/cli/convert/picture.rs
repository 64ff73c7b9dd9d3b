//! Events as a picture.

use super::events::{ASSUMED, EventOptions};
use super::refuse_usage;
use crate::cli::console::{Console, path};
use crate::cli::output::{self, OutputFile};
use crate::cli::problem::{ExitKind, VerbError};
use clap::ValueEnum;
use gs2e_event::file::EventFormat;
use gs2e_event::picture::WindowCounts;
use gs2e_event::picture::rate::RateBars;
use gs2e_event::picture::surface::TimeSurface;
use gs2e_event::{Event, EventFileError, EventSink, EventSource};
use gs2e_image::{Image, Size, png};
use gs2e_num::units::format_amount;
use serde_json::json;
use std::collections::TryReserveError;
use std::io;
use std::ops::Range;
use std::path::Path;

/// Options of pictures.
#[derive(Debug, clap::Args)]
pub(super) struct PictureOptions {
    /// Kind of picture [default: frame]
    #[arg(long, value_enum, value_name = "KIND")]
    picture: Option<PictureKind>,
    /// Time window of the picture, T0 <= t < T1, in microseconds [default: all]
    #[arg(long, value_name = "T0,T1", value_parser = parse_window, allow_hyphen_values = true)]
    window: Option<TimeWindow>,
    /// Age in microseconds at which an event of a time surface has faded to 1/e [default: a quarter
    /// of the window]
    #[arg(long, value_name = "US", value_parser = clap::value_parser!(u32).range(1..))]
    tau: Option<u32>,
}

/// Kinds of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PictureKind {
    /// Event balance of each pixel: brighter in red, darker in blue
    Frame,
    /// Time surface: the last event of each pixel, fading with its age
    Surface,
    /// Events per second over time, brighter upwards, darker downwards
    Rate,
}

/// Begin and end, in microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct TimeWindow(i64, i64);

/// Reads `T0,T1`.
fn parse_window(text: &str) -> Result<TimeWindow, String> {
    let ends = text.split_once(',').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    match ends {
        Some((begin, end)) if begin < end => Ok(TimeWindow(begin, end)),
        _ => Err(format!("`{text}` is not T0,T1: two whole microseconds, T0 before T1")),
    }
}

/// The accumulator of a picture.
enum EventCanvas {
    Frame(WindowCounts),
    Surface(TimeSurface),
    Rate(RateBars),
}

impl EventCanvas {
    fn image(&self, tau_us: Option<u32>) -> Image<[u8; 3]> {
        match self {
            Self::Frame(picture) => picture.image(),
            Self::Surface(surface) => surface.image(tau_us.map_or_else(|| surface.usual_tau_us(), f64::from)),
            Self::Rate(rate) => rate.image(),
        }
    }

    fn sink(&mut self) -> &mut dyn EventSink {
        match self {
            Self::Frame(picture) => picture,
            Self::Surface(surface) => surface,
            Self::Rate(rate) => rate,
        }
    }
}

impl PictureOptions {
    /// Returns true if the name of the output asks for a picture.
    ///
    /// # Errors
    /// An option for pictures is given, and the output is not a picture.
    pub(super) fn of(&self, output: &Path) -> Result<bool, VerbError> {
        let is_png = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        let asked = self.picture.is_some() || self.window.is_some() || self.tau.is_some();
        if asked && !is_png {
            return refuse_usage(format!("{} is not a .png, but a picture is requested", output.display()));
        }
        Ok(is_png)
    }

    /// Draws the events of a file, and writes the picture.
    pub(super) fn draw(
        &self,
        (input, format): (&Path, EventFormat),
        output: &Path,
        options: &EventOptions,
        console: &Console,
    ) -> Result<ExitKind, VerbError> {
        output::screen_outputs([output], [input], console.json)?;
        let mut opened = options.open(input, format)?;
        if opened.assumes_us {
            console.say(ASSUMED);
        }
        let size = opened.header.size;
        let window_us = self.window.map_or(i64::MIN..i64::MAX, |TimeWindow(begin, end)| begin..end);
        // A large sensor may need more memory than there is; that is an error here and not an
        // abort.
        let mut canvas = self.canvas(size, window_us.clone()).map_err(|e| {
            let what = format!("{}: a picture of {size}: {}", output.display(), io::Error::from(e));
            VerbError::failed("not-written", what)
        })?;
        let events = pour_events(&mut *opened.source, &window_us, canvas.sink()).map_err(|e| {
            let what = format!("{}: failed to read events: {e}", input.display());
            VerbError::failed("input-unreadable", what)
        })?;
        let image = canvas.image(self.tau);
        let fill = |out: &mut dyn io::Write| png::write_image(&image, out);
        output::write_outputs(&[OutputFile { path: output, fill: &fill }])?;
        console.say(&self.account(output, events, size, image.size()));
        if console.json {
            let kind = self.kind().to_possible_value().map(|value| value.get_name().to_owned());
            console.result(&json!({
                "input": path(input), "output": path(output), "picture": kind, "events": events,
                "width": image.size().width, "height": image.size().height,
            }));
        }
        Ok(ExitKind::Done)
    }

    /// The line about a picture.
    fn account(&self, output: &Path, events: u64, sensor: Size, picture: Size) -> String {
        let output = output.display();
        match self.window {
            Some(_) if events == 0 => format!("warning: {output}: no events in this window"),
            _ => {
                let shown = format_amount(events, "events");
                format!("{output}: {shown} from a sensor of {sensor}, {picture}")
            }
        }
    }

    fn kind(&self) -> PictureKind {
        self.picture.unwrap_or(PictureKind::Frame)
    }

    fn canvas(&self, size: Size, window_us: Range<i64>) -> Result<EventCanvas, TryReserveError> {
        Ok(match self.kind() {
            PictureKind::Frame => EventCanvas::Frame(WindowCounts::new(size, window_us)?),
            PictureKind::Surface => EventCanvas::Surface(TimeSurface::new(size, window_us)?),
            PictureKind::Rate => EventCanvas::Rate(RateBars::new(window_us)),
        })
    }
}

/// Adds the events of a whole file to a picture. Returns the number of events in its window.
fn pour_events(
    source: &mut dyn EventSource,
    window_us: &Range<i64>,
    sink: &mut dyn EventSink,
) -> Result<u64, EventFileError> {
    let (mut chunk, mut count) = (Vec::new(), 0);
    while source.next_chunk(&mut chunk)? {
        // The picture ignores events outside its window; only the count needs this test.
        let within = |event: &&Event| window_us.contains(&event.t.floor_micros());
        count += chunk.iter().filter(within).count() as u64;
        sink.append(&chunk)?;
    }
    Ok(count)
}
