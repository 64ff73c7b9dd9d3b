//! A recording as the command line names it: frames and events of the same pixels on one clock.

use super::convert::events::{EventInputOptions, SUPPORTED};
use super::simulate::{FrameInputs, StampedFrames, full_scale, parse_rate};
use super::{Console, VerbError, input};
use gs2e_event::evt::EvtVersion;
use gs2e_event::file::{EventFormat, OpenEventFile};
use gs2e_event::sorted::SortedEvents;
use gs2e_event::{Event, EventSource as _};
use gs2e_image::Size;
use gs2e_num::units::Hertz;
use gs2e_sensor::frames::array::FullScale;
use std::path::{Path, PathBuf};

/// Options of a recording.
#[derive(Debug, clap::Args)]
pub(super) struct RecordingArgs {
    /// Frames of the camera: a .npy [N, H, W] of uint8 or float32, a folder of images, or an .aedat4, whose
    /// frames have stamps
    #[arg(long, value_name = "FILE or DIR", required = true)]
    frames: Option<PathBuf>,
    /// Time stamps of the frames on the clock of the events: a .npy [N] of int64, in microseconds
    #[arg(long, value_name = "FILE", requires = "frames", conflicts_with = "fps")]
    stamps: Option<PathBuf>,
    /// Frames per second, if there are no stamps; the first frame is then at time 0
    #[arg(long, value_name = "N", requires = "frames", value_parser = parse_rate)]
    fps: Option<Hertz>,
    /// White in float frames: 1 or 255 [default: decided by the first two frames]
    #[arg(long, requires = "frames", value_parser = full_scale)]
    full_scale: Option<FullScale>,
    /// Events of the same pixels: .h5, .npz, .raw, .aedat4, .txt, .csv or .mcap
    #[arg(long, value_name = "FILE")]
    pub(super) events: PathBuf,
    #[command(flatten)]
    options: EventInputOptions,
}

impl RecordingArgs {
    /// The files that are read.
    pub(super) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.stamps.iter().chain(&self.frames).chain([&self.events]).map(PathBuf::as_path)
    }

    /// The file or folder of the frames. `calibrate` does without.
    pub(super) fn frames(&self) -> Option<&Path> {
        self.frames.as_deref()
    }

    /// Opens the frames, and prints what was decided about them.
    pub(super) fn open_frames(&self, console: &Console) -> Result<StampedFrames, VerbError> {
        let frames =
            self.frames().ok_or_else(|| VerbError::usage("frames", "--frames is missing".to_owned()))?;
        let sequence = StampedFrames::open_inputs(FrameInputs {
            frames,
            rates: None,
            stamps: self.stamps.as_deref(),
            fps: self.fps,
            full_scale: self.full_scale,
        })?;
        sequence.notices.iter().for_each(|line| console.note(line));
        Ok(sequence)
    }

    /// Opens a file of events.
    fn open(&self, path: &Path) -> Result<OpenEventFile, VerbError> {
        let format = EventFormat::for_path(path, EvtVersion::Evt2).ok_or_else(|| {
            let what = format!("{}: not an event format", path.display());
            VerbError::usage("format", what).help(SUPPORTED)
        })?;
        // Fractions are read as seconds: nothing else fits a camera's clock.
        match self.options.assumed_unit(path, format) {
            Some(unit) => self.options.open_in(path, format, Some(unit)),
            None => self.options.open(path, format),
        }
    }

    /// Says if the times of a file of events are taken for seconds.
    pub(super) fn note_seconds(&self, path: &Path, console: &Console) {
        let format = EventFormat::for_path(path, EvtVersion::Evt2);
        if format.is_some_and(|format| self.options.assumed_unit(path, format).is_some()) {
            let place = path.display();
            console.note(&format!(
                "{place}: times with fractions are read as seconds; --time-unit states another"
            ));
        }
    }

    /// The pixels of the events.
    pub(super) fn size(&self) -> Result<Size, VerbError> {
        Ok(self.open(&self.events)?.header.size)
    }

    /// Opens a file of events of these pixels.
    pub(super) fn open_events(&self, path: &Path, size: Size) -> Result<OpenEventFile, VerbError> {
        let opened = self.open(path)?;
        let found = opened.header.size;
        if found != size {
            let what =
                format!("{}: events of {found} and frames of {size}, wanted the same pixels", path.display());
            return Err(VerbError::usage("size", what));
        }
        Ok(opened)
    }

    /// Passes all events of a file to `take`, in order of time, which not every camera's file keeps.
    pub(super) fn read_events(
        &self,
        path: &Path,
        size: Size,
        take: &mut dyn FnMut(&[Event]),
    ) -> Result<(), VerbError> {
        let OpenEventFile { mut source, .. } = self.open_events(path, size)?;
        let mut sorted = SortedEvents::new(&mut *source);
        let mut chunk = Vec::new();
        while sorted.next_chunk(&mut chunk).map_err(|e| input::wrong_events(path, &e))? {
            take(&chunk);
        }
        Ok(())
    }
}
