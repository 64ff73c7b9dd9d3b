//! Events as a picture.

use super::events::InputEvents;
use super::refuse_usage;
use crate::cli::words::parse_numbers;
use crate::cli::{Console, ExitKind, VerbError, input, output, path};
use clap::ValueEnum;
use gs2e_event::picture::WindowCounts;
use gs2e_event::picture::rate::RateBars;
use gs2e_event::picture::surface::TimeSurface;
use gs2e_event::{Event, EventFileError, EventSink, EventSource};
use gs2e_image::{Size, png};
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
    window: Option<[i64; 2]>,
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

/// Reads `T0,T1`.
fn parse_window(text: &str) -> Result<[i64; 2], String> {
    let window = parse_numbers(text).filter(|[begin, end]| begin < end);
    window.ok_or_else(|| format!("`{text}` is not T0,T1: two whole microseconds, T0 before T1"))
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
        input: &InputEvents<'_>,
        output: &Path,
        console: &Console,
    ) -> Result<ExitKind, VerbError> {
        output::screen_outputs([output], [input.path], console.json)?;
        let mut opened = input.open(console)?;
        let size = opened.header.size;
        let window_us = self.window.map_or(i64::MIN..i64::MAX, |[begin, end]| begin..end);
        let mut pour = |sink: &mut dyn EventSink| {
            let poured = pour_events(&mut *opened.source, &window_us, sink);
            poured.map_err(|e| input::wrong_events(input.path, &e))
        };
        // A large sensor may need more memory than there is; that is an error here and not an
        // abort.
        let too_large = |e: TryReserveError| {
            output::not_written(output, format_args!("a picture of {size}: {}", io::Error::from(e)))
        };
        let (events, image) = match self.kind() {
            PictureKind::Frame => {
                let mut frame = WindowCounts::new(size, window_us.clone()).map_err(too_large)?;
                (pour(&mut frame)?, frame.image())
            }
            PictureKind::Surface => {
                let mut surface = TimeSurface::new(size, window_us.clone()).map_err(too_large)?;
                let events = pour(&mut surface)?;
                (events, surface.image(self.tau.map_or_else(|| surface.default_tau_us(), f64::from)))
            }
            PictureKind::Rate => {
                let mut rate = RateBars::new(window_us.clone());
                (pour(&mut rate)?, rate.image())
            }
        };
        output::write_output(output, |out| png::write_image(&image, out))?;
        console.note(&self.account(output, events, size, image.size()));
        let kind = self.kind().to_possible_value().map(|value| value.get_name().to_owned());
        console.result(&json!({
            "input": path(input.path), "output": path(output), "picture": kind, "events": events,
            "width": image.size().width, "height": image.size().height,
        }));
        Ok(ExitKind::Done)
    }

    /// The line about a picture.
    fn account(&self, output: &Path, events: u64, sensor: Size, picture: Size) -> String {
        let output = output.display();
        if self.window.is_some() && events == 0 {
            return format!("warning: {output}: no events in this window");
        }
        let shown = format_amount(events, "events");
        format!("{output}: {shown} from a sensor of {sensor}, {picture}")
    }

    fn kind(&self) -> PictureKind {
        self.picture.unwrap_or(PictureKind::Frame)
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
