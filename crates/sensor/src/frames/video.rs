//! Frames of a video, decoded by the programs of FFmpeg.
//!
//! `ffprobe` lists the stamps of all frames, and `ffmpeg` decodes one frame after the other into a pipe. The
//! stamps are those of the container, so a variable frame rate is kept. Frames are turned as the video's
//! metadata says, and have 8 bits per colour.
//!
//! # Examples
//!
//! ```
//! use gs2e_files::programs::ProgramFinder;
//! use gs2e_sensor::frames::video::{VideoError, VideoFrames};
//! use std::path::Path;
//!
//! // FFmpeg is looked for in the folders of `PATH`. The program `gs2e` supervises it.
//! let programs = ProgramFinder::new(std::env::var_os("PATH").as_deref(), "gs2e".into());
//! match VideoFrames::open(Path::new("no-such-folder/clip.mp4"), &programs) {
//!     Ok(video) => panic!("a video with {} frames", video.stamps_us().len()),
//!     Err(error) => assert!(matches!(error, VideoError::Io { .. })),
//! }
//! ```

use super::stamps::{StampError, relative_stamps};
use super::{DenseFrame, FrameError, FrameSequence};
use gs2e_files as files;
use gs2e_files::PathError;
use gs2e_files::programs::{EndKind, PipedProgram, ProgramCall, ProgramFinder};
use gs2e_image::png::GreyWeights;
use gs2e_image::{Image, Size};
use gs2e_num::units::Timestamp;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{self, BufRead, Read};
use std::path::{Path, PathBuf};

/// Maximum number of frames: three months at 30 frames per second.
const MAX_FRAMES: usize = 1 << 28;
/// Longest line that is read of `ffprobe`, and longest header of a picture, in bytes.
const MAX_LINE: u64 = 1 << 12;
/// First version of FFmpeg that is asked by `-fps_mode` to keep the frames. Older ones have `-vsync`.
const HAS_FPS_MODE: u32 = 6;

/// The reason why a video cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The file cannot be opened.
    #[error(transparent)]
    Io(#[from] PathError),
    /// A program of FFmpeg is not installed.
    #[error("there is no program `{0}` in the absolute folders of PATH, and it decodes videos")]
    NoProgram(&'static str),
    /// A program of FFmpeg fails.
    #[error("{}: {program} cannot read it: {because}", path.display())]
    Program {
        /// The file.
        path: PathBuf,
        /// Name of the program.
        program: &'static str,
        /// Its message, or the kind of its end.
        because: String,
    },
    /// The stamps of the frames are not valid.
    #[error("{}: {source}", path.display())]
    Stamps {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: StampError,
    },
}

/// The file of a video, and the programs that read it.
#[derive(Debug)]
struct VideoSource<'a> {
    path: &'a Path,
    programs: &'a ProgramFinder,
}

impl VideoSource<'_> {
    fn failed(&self, program: &'static str, because: impl Into<String>) -> VideoError {
        VideoError::Program { path: self.path.to_owned(), program, because: because.into() }
    }

    /// Starts a program on the file, as the argument after `before`.
    fn start(
        &self,
        program: &'static str,
        before: &[&str],
        after: &[&str],
    ) -> Result<PipedProgram, VideoError> {
        let unreadable = |source| PathError::new(self.path, source);
        // With the protocol in front, no name is taken for an option or an address.
        let mut input = OsString::from("file:");
        input.push(self.path.canonicalize().map_err(unreadable)?);
        // Messages of the decoder would stand between the bytes of its pictures.
        let level = if program == PROBE { "error" } else { "quiet" };
        // A playlist may name addresses, and other files of this machine.
        let fixed = ["-v", level, "-protocol_whitelist", "file", "-format_whitelist", CONTAINERS];
        let words = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
        let arguments = [words(&fixed), words(before), vec![input], words(after)].concat();
        let folder = PathBuf::from("/");
        let call = ProgramCall { program: program.into(), arguments, environment: BTreeMap::new(), folder };
        PipedProgram::start(self.programs, &call).map_err(|how| match how {
            EndKind::NotStarted(error) if error.kind() == io::ErrorKind::NotFound => {
                VideoError::NoProgram(program)
            }
            how => self.failed(program, how.to_string()),
        })
    }

    /// The stamps of all frames, in microseconds, as `ffprobe` prints them.
    fn stamps(&self) -> Result<Vec<i64>, VideoError> {
        let entries = "frame=best_effort_timestamp_time";
        let format = "default=noprint_wrappers=1:nokey=1";
        let before = ["-select_streams", "v:0", "-show_entries", entries, "-of", format, "-i"];
        let mut probe = self.start(PROBE, &before, &[])?;
        let mut stamps = Vec::new();
        while let Some(line) = short_line(&mut probe).map_err(|e| self.failed(PROBE, e.to_string()))? {
            // What is no stamp is a message of the program.
            let stamp = parse_micros(line.trim()).ok_or_else(|| self.failed(PROBE, line.trim()))?;
            if stamps.len() == MAX_FRAMES {
                return Err(self.failed(PROBE, format!("more than {MAX_FRAMES} frames")));
            }
            stamps.push(stamp);
        }
        probe.finish().map_err(|how| self.failed(PROBE, how.to_string()))?;
        Ok(stamps)
    }

    fn decode(&self) -> Result<PipedProgram, VideoError> {
        let version =
            self.programs.ask(DECODER, &["-version"]).map_err(|_| VideoError::NoProgram(DECODER))?;
        let keep = if major_version(&version) < HAS_FPS_MODE { "-vsync" } else { "-fps_mode" };
        // No frame may be repeated or dropped for a constant rate: each one belongs to a stamp of the probe.
        let output = ["-map", "0:v:0", keep, "passthrough", "-pix_fmt", "rgb24"];
        let pictures = ["-f", "image2pipe", "-c:v", "ppm", "pipe:1"];
        self.start(DECODER, &["-nostdin", "-i"], &[&output[..], &pictures[..]].concat())
    }
}

/// Containers that are read. Playlists and texts, which FFmpeg can show as a video, are not among them.
const CONTAINERS: &str = "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,ogg,asf,ivf,gif,apng,yuv4mpegpipe,nut,mxf,\
                          h264,hevc,obu,m4v,dv";

const PROBE: &str = "ffprobe";
const DECODER: &str = "ffmpeg";

/// The first number of `ffmpeg version 6.1.1-3ubuntu5`; of builds without a number, a large one.
fn major_version(said: &str) -> u32 {
    let word = said.split_whitespace().nth(2).unwrap_or_default().trim_start_matches('n');
    let digits: String = word.chars().take_while(char::is_ascii_digit).collect();
    digits.parse().unwrap_or(u32::MAX)
}

/// Microseconds of a decimal number of seconds with at most six decimals.
fn parse_micros(text: &str) -> Option<i64> {
    let (negative, digits) = text.strip_prefix('-').map_or((false, text), |digits| (true, digits));
    let (seconds, decimals) = digits.split_once('.').unwrap_or((digits, ""));
    let are_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if seconds.is_empty() || decimals.len() > 6 || !are_digits(seconds) || !are_digits(decimals) {
        return None;
    }
    let micros: i64 = format!("{seconds}{decimals:0<6}").parse().ok()?;
    Some(if negative { -micros } else { micros })
}

/// The next line; `None` at the end.
fn short_line(from: &mut impl BufRead) -> io::Result<Option<String>> {
    let mut line = Vec::new();
    from.take(MAX_LINE).read_until(b'\n', &mut line)?;
    Ok((!line.is_empty()).then(|| String::from_utf8_lossy(&line).into_owned()))
}

/// The frames of a video at their stamps.
#[derive(Debug)]
pub struct VideoFrames {
    pictures: PipedProgram,
    size: Size,
    stamps_us: Vec<i64>,
    /// Stamps, ns since the first.
    stamps: Vec<i64>,
    next: usize,
    /// The first picture, which was read for its size.
    first: Option<Vec<[u8; 3]>>,
    /// True if colours are requested.
    coloured: bool,
    /// Colours of the last frame.
    colour: Option<Image<[f32; 3]>>,
}

impl VideoFrames {
    /// Reads the stamps of a video, and starts to decode it.
    ///
    /// # Errors
    /// The file is absent or no video, FFmpeg is absent, or the stamps do not increase.
    pub fn open(path: &Path, programs: &ProgramFinder) -> Result<Self, VideoError> {
        files::open(path).map_err(|source| PathError::new(path, source))?;
        let source = VideoSource { path, programs };
        let stamps_us = source.stamps()?;
        let stamps = relative_stamps(&stamps_us)
            .map_err(|error| VideoError::Stamps { path: path.to_owned(), source: error })?;
        let mut pictures = source.decode()?;
        let first = read_picture(&mut pictures).map_err(|e| source.failed(DECODER, e.to_string()))?;
        let (size, first) = first.ok_or_else(|| source.failed(DECODER, "it has no picture"))?;
        Ok(Self {
            pictures,
            size,
            stamps_us,
            stamps,
            next: 0,
            first: Some(first),
            coloured: false,
            colour: None,
        })
    }

    /// The stamps in microseconds.
    #[must_use]
    pub fn stamps_us(&self) -> &[i64] {
        &self.stamps_us
    }

    fn picture(&mut self) -> Result<Option<Vec<[u8; 3]>>, String> {
        if let Some(first) = self.first.take() {
            return Ok(Some(first));
        }
        match read_picture(&mut self.pictures).map_err(|e| e.to_string())? {
            Some((size, _)) if size != self.size => {
                Err(format!("{size}, wanted {} like the first", self.size))
            }
            picture => Ok(picture.map(|(_, pixels)| pixels)),
        }
    }
}

impl FrameSequence for VideoFrames {
    fn size(&self) -> Size {
        self.size
    }

    fn len(&self) -> usize {
        self.stamps.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let index = self.next;
        let invalid = |because| FrameError::Invalid { index, because };
        let Some(pixels) = self.picture().map_err(invalid)? else {
            // A video that is cut off in the middle of a frame has a stamp for it.
            let because =
                format!("{DECODER} decodes {index} frames, but {PROBE} lists {}", self.stamps.len());
            return if index == self.stamps.len() { Ok(None) } else { Err(invalid(because)) };
        };
        let t = *self.stamps.get(index).ok_or_else(|| invalid(format!("{PROBE} lists no stamp for it")))?;
        let weights = GreyWeights::default();
        let luminance = pixels.iter().map(|rgb| weights.weigh(rgb.map(f64::from))).collect();
        self.colour = self
            .coloured
            .then(|| Image::from_vec(self.size, pixels.iter().map(|rgb| rgb.map(f32::from)).collect()));
        self.next += 1;
        let luminance = Image::from_vec(self.size, luminance);
        Ok(Some(DenseFrame { index, t: Timestamp(t), luminance, rate: None }))
    }

    fn want_colour(&mut self) {
        self.coloured = true;
    }

    fn colour(&self) -> Option<&Image<[f32; 3]>> {
        self.colour.as_ref()
    }
}

fn parse_side(text: &str) -> Option<u32> {
    text.parse().ok().filter(|side| *side > 0)
}

/// The size of the next picture of a stream of binary PPM files, whose pixels follow; `None` at the end.
///
/// # Errors
/// The stream fails, or is no such picture.
pub fn picture_size(from: &mut impl BufRead) -> io::Result<Option<Size>> {
    let Some(kind) = short_line(from)? else { return Ok(None) };
    let mut header = kind;
    // `P6`, the sides, and the largest value, each on a line of its own.
    for _ in 0..2 {
        header.push_str(&short_line(from)?.unwrap_or_default());
    }
    let words: Vec<&str> = header.split_whitespace().collect();
    let sides = match words[..] {
        ["P6", width, height, "255"] => parse_side(width).zip(parse_side(height)),
        _ => None,
    };
    let (width, height) = sides.ok_or_else(|| invalid("its output is no picture".to_owned()))?;
    Ok(Some(Size { width, height }))
}

fn invalid(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// The next picture of a stream of binary PPM files; `None` at the end.
fn read_picture(from: &mut impl BufRead) -> io::Result<Option<(Size, Vec<[u8; 3]>)>> {
    let Some(size) = picture_size(from)? else { return Ok(None) };
    size.check_sensor().map_err(|e| invalid(format!("a picture of {e}")))?;
    let mut pixels = gs2e_files::budget::try_filled([0u8; 3], size.pixels())?;
    from.read_exact(pixels.as_flattened_mut())?;
    Ok(Some((size, pixels)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_become_microseconds() {
        let t = |text, wanted| assert_eq!(parse_micros(text), wanted, "{text}");
        t("0.000000", Some(0));
        t("12.345678", Some(12_345_678));
        t("-0.020000", Some(-20_000));
        t("3.5", Some(3_500_000));
        t("7", Some(7_000_000));
        for text in ["N/A", "", "-", ".5", "1.2345678", "1e3", "1.-5", "99999999999999"] {
            t(text, None);
        }
    }

    #[test]
    fn versions_are_recognised() {
        let t = |text, wanted| assert_eq!(major_version(text), wanted, "{text}");
        t("ffmpeg version 5.1.6-0+deb12u1 Copyright (c)", 5);
        t("ffmpeg version n7.1 Copyright", 7);
        t("ffmpeg version N-118-g1234567 Copyright", u32::MAX);
    }

    #[test]
    fn pictures_are_read_one_after_the_other() {
        let mut stream: &[u8] = b"P6\n2 1\n255\nabcdefP6\n1 1\n255\nxyzP6\n2 1\n255\nab";
        let size = Size { width: 2, height: 1 };
        assert_eq!(read_picture(&mut stream).unwrap(), Some((size, vec![*b"abc", *b"def"])));
        assert_eq!(read_picture(&mut stream).unwrap().unwrap().1, [*b"xyz"]);
        assert_eq!(read_picture(&mut stream).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        assert_eq!(read_picture(&mut &b""[..]).unwrap(), None);
        for text in ["P5\n1 1\n255\nx", "P6\n0 1\n255\n", "P6\n1 1\n65535\nxxyyzz", "error: no\n", "P6\n1"] {
            assert!(read_picture(&mut text.as_bytes()).is_err(), "{text}");
        }
    }
}
