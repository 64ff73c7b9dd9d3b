//! The frames of a simulation, with their time stamps.

use crate::cli::words::parse_numbers;
use crate::cli::{ExitKind, UserMessage, VerbError, input};
use gs2e_files::is_there;
use gs2e_files::programs::ProgramFinder;
use gs2e_num::units::{Hertz, Ratio, format_amount};
use gs2e_sensor::frames::aedat4::{Aedat4Error, Aedat4Frames};
use gs2e_sensor::frames::array::FullScale;
use gs2e_sensor::frames::folder::{FolderError, FolderFrames, FolderListing, INFO};
use gs2e_sensor::frames::npy::{FrameStack, NpyError, NpyFrames, RatedFrames, SampleKind};
use gs2e_sensor::frames::stamps::relative_stamps;
use gs2e_sensor::frames::video::{VideoError, VideoFrames};
use gs2e_sensor::frames::{FrameSequence, npy};
use std::io;
use std::path::Path;

/// Frame rate above which the memory for held frames is reported, frames per second.
const MANY_A_SECOND: f64 = 50_000.0;
/// Length of time for which a sensor holds frames, ns: one root cell of the dyadic clock.
const HELD_NS: f64 = 1_048_576.0;

/// Reads `X,Y`.
pub(super) fn parse_origin(text: &str) -> Result<[u16; 2], String> {
    parse_numbers(text)
        .ok_or_else(|| format!("`{text}` is not X,Y, two numbers from 0 to 65535 such as 40,12"))
}

/// Reads `1` or `255`.
pub(in crate::cli) fn full_scale(text: &str) -> Result<FullScale, String> {
    match text {
        "1" => Ok(FullScale::One),
        "255" => Ok(FullScale::Grey255),
        _ => Err(format!("`{text}` is neither 1 nor 255")),
    }
}

/// Reads a frame rate that whole microseconds can resolve.
pub(in crate::cli) fn parse_rate(text: &str) -> Result<Hertz, String> {
    let ratio: Ratio = text.parse().map_err(|e: gs2e_num::units::RatioError| e.to_string())?;
    if ratio.to_f64() > 1e6 || ratio.to_f64() < 1e-6 {
        return Err(format!("`{text}` is not between 1e-6 and 1e6 frames per second"));
    }
    Ok(Hertz(ratio))
}

/// Frames and stamps as the command line names them.
#[derive(Debug, Clone, Copy)]
pub(in crate::cli) struct FrameInputs<'a> {
    pub(in crate::cli) frames: &'a Path,
    pub(in crate::cli) rates: Option<&'a Path>,
    pub(in crate::cli) stamps: Option<&'a Path>,
    pub(in crate::cli) fps: Option<Hertz>,
    pub(in crate::cli) full_scale: Option<FullScale>,
}

/// Frames with their time stamps.
pub(in crate::cli) struct StampedFrames {
    pub(in crate::cli) frames: Box<dyn FrameSequence>,
    /// Stamps in microseconds, strictly increasing, at least two.
    pub(in crate::cli) stamps_us: Vec<i64>,
    /// The value of white.
    pub(in crate::cli) full_scale: FullScale,
    /// True if the frames decided the value of white.
    pub(in crate::cli) decided: bool,
    /// True if frames may have colours.
    pub(in crate::cli) may_be_coloured: bool,
    /// Lines to be printed.
    pub(in crate::cli) notices: Vec<String>,
}

/// The frames, with the stamps that came with them.
enum FrameSource {
    Stack(FrameStack),
    Images(FolderListing),
    Camera(Aedat4Frames),
}

impl StampedFrames {
    /// Opens all inputs that the command line names.
    pub(in crate::cli) fn open_inputs(asked: FrameInputs<'_>) -> Result<Self, VerbError> {
        let source = open_frames(asked.frames)?;
        let stamps_us = find_stamps(asked, &source)?;
        require_two(asked.frames, &stamps_us)?;
        let mut notices = Vec::new();
        let floats = matches!(&source, FrameSource::Stack(stack) if stack.kind() == SampleKind::Floats);
        let full_scale = match asked.full_scale {
            Some(full_scale) if floats => full_scale,
            None if floats => decide_scale(asked.frames, &mut notices)?,
            // Integers are grey from 0 to 255.
            _ => FullScale::Grey255,
        };
        let decided = floats && asked.full_scale.is_none();
        if !floats && asked.full_scale == Some(FullScale::One) {
            let what = "warning: --full-scale applies to floats: these frames are already grey 0 to 255";
            notices.push(what.to_owned());
        }
        let may_be_coloured = matches!(source, FrameSource::Images(_) | FrameSource::Camera(_));
        let frames: Box<dyn FrameSequence> = match source {
            FrameSource::Stack(stack) => {
                Box::new(NpyFrames::new(stack, full_scale, &stamps_us).map_err(|e| mismatched_frames(&e))?)
            }
            FrameSource::Images(listing) => {
                Box::new(FolderFrames::new(listing.images, &stamps_us).map_err(|e| wrong_folder(&e))?)
            }
            FrameSource::Camera(frames) => {
                notices.push(stamp_notice(asked.frames, &frames));
                Box::new(frames)
            }
        };
        let frames = match asked.rates {
            None => frames,
            Some(path) => {
                let rates = FrameStack::open(path).map_err(|e| unreadable_array("rates", &e, path))?;
                Box::new(RatedFrames::new(frames, rates, full_scale).map_err(|e| mismatched_frames(&e))?)
            }
        };
        let mut sequence = Self { frames, stamps_us, full_scale, decided, may_be_coloured, notices };
        sequence.notices.extend(sequence.many());
        Ok(sequence)
    }

    /// Opens a video, whose container has the stamps.
    pub(super) fn open_video(path: &Path, programs: &ProgramFinder) -> Result<Self, VerbError> {
        let video = VideoFrames::open(path, programs).map_err(|e| unreadable_video(&e, path))?;
        let stamps_us = video.stamps_us().to_vec();
        require_two(path, &stamps_us)?;
        let mut sequence = Self {
            frames: Box::new(video),
            stamps_us,
            full_scale: FullScale::Grey255,
            decided: false,
            may_be_coloured: true,
            notices: Vec::new(),
        };
        sequence.notices.extend(sequence.many());
        Ok(sequence)
    }

    /// The first and the last stamp, in microseconds.
    pub(in crate::cli) fn span_us(&self) -> (i64, i64) {
        (self.stamps_us[0], self.stamps_us[self.stamps_us.len() - 1])
    }

    /// The mean number of frames per second.
    pub(super) fn rate(&self) -> Hertz {
        let (first, last) = self.span_us();
        let intervals = (self.stamps_us.len() as u64 - 1).saturating_mul(1_000_000);
        let rate = Ratio::new(intervals, last.abs_diff(first));
        Hertz(rate.expect("at least two stamps, strictly increasing"))
    }

    /// A warning about the memory for the frames that a sensor holds, if the frame rate is high.
    fn many(&self) -> Option<String> {
        let hz = self.rate().to_f64();
        // A sample of a held frame takes 4 bytes.
        let held = (hz * HELD_NS * 1e-9).ceil() * self.frames.size().pixels() as f64 * 4.0;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an amount for people")]
        let bytes = format_amount(held as u64, "B");
        (hz > MANY_A_SECOND).then(|| {
            format!("warning: at {hz:.0} frames per second the sensor holds {bytes} of frames at once")
        })
    }
}

fn require_two(input: &Path, stamps_us: &[i64]) -> Result<(), VerbError> {
    let count = stamps_us.len();
    if count >= 2 {
        return Ok(());
    }
    let what = format!("{} holds {count} frames, wanted at least 2", input.display());
    Err(VerbError::usage("frames", what))
}

/// The error for a video that cannot be read.
fn unreadable_video(error: &VideoError, path: &Path) -> VerbError {
    match error {
        VideoError::Io(error) if error.source.kind() == io::ErrorKind::NotFound => {
            input::missing_file("video", path)
        }
        VideoError::NoProgram(_) => VerbError::usage("program-missing", error.to_string())
            .help("install FFmpeg, for example by `apt install ffmpeg`, `brew install ffmpeg` or `conda install ffmpeg`"),
        VideoError::Stamps { .. } => VerbError::usage("stamps", error.to_string()),
        VideoError::Io { .. } | VideoError::Program { .. } => input::unreadable_file("video", error),
    }
}

fn open_frames(path: &Path) -> Result<FrameSource, VerbError> {
    if path.is_dir() {
        return FolderListing::list_folder(path).map(FrameSource::Images).map_err(|e| wrong_folder(&e));
    }
    let has = |wanted: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(wanted));
    if is_there(path) && has("aedat4") {
        let frames = Aedat4Frames::open(path).map_err(|e| wrong_camera_file(path, &e))?;
        return Ok(FrameSource::Camera(frames));
    }
    if is_there(path) && !has("npy") {
        let what = format!("{} is neither a .npy nor a folder of images", path.display());
        return Err(VerbError::usage("format", what));
    }
    FrameStack::open(path).map(FrameSource::Stack).map_err(|e| unreadable_array("frames", &e, path))
}

/// The frames of a `.npy` at their stamps. The frames decide the value of white.
pub(in crate::cli) fn open_stack(
    path: &Path,
    stamps_us: &[i64],
) -> Result<Box<dyn FrameSequence>, VerbError> {
    let stack = FrameStack::open(path).map_err(|e| unreadable_array("frames", &e, path))?;
    let full_scale = match stack.kind() {
        SampleKind::Floats => decide_scale(path, &mut Vec::new())?,
        SampleKind::Bytes => FullScale::Grey255,
    };
    Ok(Box::new(NpyFrames::new(stack, full_scale, stamps_us).map_err(|e| mismatched_frames(&e))?))
}

fn find_stamps(asked: FrameInputs<'_>, source: &FrameSource) -> Result<Vec<i64>, VerbError> {
    let (count, own) = match source {
        FrameSource::Stack(stack) => (stack.frames(), None),
        FrameSource::Images(listing) => (listing.images.len(), listing.stamps_us.as_deref()),
        FrameSource::Camera(frames) => (frames.len(), Some(frames.stamps_us())),
    };
    match (own, asked.stamps, asked.fps) {
        (Some(own), None, None) => Ok(own.to_vec()),
        (Some(_), _, _) => {
            let place = asked.frames.display();
            let what = match source {
                FrameSource::Camera(_) => format!("the frames of {place} have stamps"),
                _ => format!("the stamps of {place} are in its {INFO}"),
            };
            Err(VerbError::usage("stamps", what).help("leave --stamps and --fps out"))
        }
        (None, Some(path), _) => {
            let stamps = npy::read_stamps(path).map_err(|e| unreadable_array("stamps", &e, path))?;
            // Checked here, so that the error names the file of the stamps.
            relative_stamps(&stamps)
                .map_err(|e| VerbError::usage("stamps", format!("{}: {e}", path.display())))?;
            Ok(stamps)
        }
        (None, None, Some(rate)) => Ok((0..count as u64).map(|index| rate.stamp_us(index)).collect()),
        (None, None, None) => {
            let what = format!("no timestamps for {}", asked.frames.display());
            let help = "pass --stamps with a .npy of int64 microseconds, or --fps";
            Err(VerbError::usage("stamps", what).help(help))
        }
    }
}

/// Says what the stamps of a camera's file are.
fn stamp_notice(path: &Path, frames: &Aedat4Frames) -> String {
    let place = path.display();
    match frames.exposure_us() {
        Some(us) => {
            format!("{place}: frames are stamped at the middle of their exposures of {us} us in the mean")
        }
        None => format!("{place}: frames state no exposure, so their own stamps are taken"),
    }
}

/// The error for a camera's file whose frames cannot be read.
fn wrong_camera_file(path: &Path, error: &Aedat4Error) -> VerbError {
    input::wrong_content(path, format_args!("failed to read frames: {error}"))
}

/// Decides the full scale of floats by the brightest sample of the first two frames.
fn decide_scale(path: &Path, notices: &mut Vec<String>) -> Result<FullScale, VerbError> {
    let brightest = npy::brightest_sample(path).map_err(|e| unreadable_array("frames", &e, path))?;
    let Some(full_scale) = FullScale::decide(brightest) else {
        // Both scales are possible, and a wrong guess would scale the brightness by 255.
        let what =
            format!("white may be 1 or 255: the brightest value of the first two frames is {brightest}");
        return Err(VerbError::usage("full-scale", what).help("pass --full-scale 1 or --full-scale 255"));
    };
    let white = full_scale.white();
    notices.push(format!(
        "full scale: {white}, because the brightest value of the first two frames is {brightest}"
    ));
    Ok(full_scale)
}

/// The error for an array file that is absent, or cannot be read as the wanted array.
fn unreadable_array(what: &str, error: &NpyError, path: &Path) -> VerbError {
    match error {
        NpyError::Io(error) if error.source.kind() == io::ErrorKind::NotFound => {
            input::missing_file(what, path)
        }
        error => input::unreadable_file(what, error),
    }
}

/// The error for frames that do not match the other inputs. Nothing ran.
fn mismatched_frames(error: &NpyError) -> VerbError {
    VerbError::usage("frames", error.to_string())
}

fn wrong_folder(error: &FolderError) -> VerbError {
    let exit = if matches!(error, FolderError::Io { .. }) { ExitKind::Failed } else { ExitKind::Usage };
    VerbError::new(exit, UserMessage::error("frames", error.to_string()))
}
