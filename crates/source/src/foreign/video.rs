//! Frames of a video, decoded by ffmpeg. Every n-th frame is a candidate; candidates that are blurred
//! are dropped.
//!
//! The video is decoded twice. The first time, ffmpeg prints the candidates, and each is measured row by
//! row while it passes; so a video of any length takes no memory and no disk before its frames are chosen.
//! The second time, ffmpeg writes the chosen frames.
//!
//! The sharpness of a frame is the variance of the Laplacian of its luma (Pech-Pacheco et al., ICPR
//! 2000). It depends on what is seen, so a frame is compared with its neighbours only.

use super::ForeignError;
use super::run::ExternalRun;
use super::versions::FFMPEG;
use crate::reconstruct::ProgramWorkspace;
use crate::solving::FramePicking;
use gs2e_files as files;
use gs2e_files::programs::{PipedProgram, ProgramCall};
use gs2e_image::Size;
use gs2e_num::stats::upper_median;
use gs2e_sensor::frames::video::picture_size;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{self, BufReader, Read};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};

/// Maximum number of candidates. A frame of 1080p takes about 3 MB.
const MAX_FRAMES: usize = 5000;
/// Maximum number of pixels of a frame: twice those of 8K. ffmpeg holds several frames at once.
const MAX_PIXELS: &str = "67108864";
/// Maximum number of columns of a frame, whose rows are held.
const MAX_WIDTH: u32 = 65_536;
/// Number of neighbours on each side that a frame is compared with.
const NEIGHBOURS: usize = 4;
/// Time limit: one day.
const MAX_SECONDS: u32 = 86_400;
/// Containers that ffmpeg may read. A playlist would name other files to open, on this machine or
/// elsewhere.
const CONTAINERS: &str = "mov,matroska,avi,mpegts,mpeg,flv,ogg,asf,ivf";

/// The frames that were taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TakenFrames {
    /// Number of kept frames.
    pub kept: usize,
    /// Number of candidates that were dropped as blurred.
    pub dropped: usize,
}

/// The reason why no frames were taken.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// ffmpeg failed, or the work was asked to stop.
    #[error(transparent)]
    Program(#[from] ForeignError),
    /// There are too few frames.
    #[error("one frame in {every} gives {found}, wanted at least {wanted}: lower `every`, or film longer")]
    Few {
        /// Number of frames.
        found: usize,
        /// Spacing of the candidates.
        every: u32,
        /// Required number of frames.
        wanted: usize,
    },
    /// The second decoding gave other frames than the first.
    #[error("ffmpeg wrote {found} frames, wanted the {wanted} that were chosen")]
    Unlike {
        /// Number of frames.
        found: usize,
        /// Number of chosen frames.
        wanted: usize,
    },
    /// There are too many frames.
    #[error("one frame in {every} gives more than {MAX_FRAMES}: raise `every`")]
    Many {
        /// Spacing of the candidates.
        every: u32,
    },
}

/// Writes the frames of a video to the folder `to`, as PNG files that are named by the number of the
/// frame in the video, from 0.
///
/// # Errors
/// ffmpeg fails, or there are fewer than `wanted` frames or too many.
pub fn take_frames(
    video: &Path,
    picking: FramePicking,
    to: &Path,
    wanted: usize,
    workspace: ProgramWorkspace<'_>,
) -> Result<TakenFrames, FrameError> {
    let FramePicking { every, sharpness } = picking;
    let measured = measure_candidates(video, every, workspace)?;
    let found = measured.len();
    let kept = sharp_enough(&measured, sharpness);
    if kept.len() < wanted {
        return Err(FrameError::Few { found: kept.len(), every, wanted });
    }
    let dropped: Vec<usize> = (0..found).filter(|index| kept.binary_search(index).is_err()).collect();
    let chosen = Choice { every, dropped: &dropped, most: kept.len() };
    let files = OsString::from_vec([&escaped(workspace.folder)[..], b"/%06d.png"].concat());
    decode(video, chosen, &[files], workspace)?;
    // ffmpeg counts its files from 1.
    for (number, index) in (1..).zip(&kept) {
        let written = workspace.folder.join(format!("{number:06}.png"));
        if !files::is_there(&written) {
            return Err(FrameError::Unlike { found: number - 1, wanted: kept.len() });
        }
        let frame = to.join(format!("{:06}.png", index * every as usize));
        std::fs::rename(&written, &frame).map_err(ForeignError::io_error(&frame))?;
    }
    Ok(TakenFrames { kept: kept.len(), dropped: dropped.len() })
}

/// The frames that ffmpeg passes on: one in `every`, without the candidates `dropped`, up to `most`.
#[derive(Clone, Copy)]
struct Choice<'a> {
    every: u32,
    dropped: &'a [usize],
    most: usize,
}

impl Choice<'_> {
    /// The filter of ffmpeg.
    fn filter(self) -> String {
        let Self { every, dropped, .. } = self;
        let unwanted = one_of(dropped, every);
        // Selected frames get times one after another: otherwise ffmpeg repeats frames to keep the rate.
        format!("select=if(mod(n\\,{every})\\,0\\,not({unwanted})),setpts=N/(25*TB)")
    }
}

/// An expression of ffmpeg that is above 0 at these candidates. It is a balanced tree: ffmpeg bounds the
/// depth of an expression, and that of a plain sum is its length.
fn one_of(candidates: &[usize], every: u32) -> String {
    match candidates {
        [] => "0".to_owned(),
        [candidate] => format!("eq(n\\,{})", candidate * every as usize),
        _ => {
            let (first, second) = candidates.split_at(candidates.len() / 2);
            format!("({}+{})", one_of(first, every), one_of(second, every))
        }
    }
}

/// Arguments of ffmpeg that pass on the chosen frames of a video, up to those of the output.
fn decoding_arguments(video: &Path, chosen: Choice<'_>, level: &str) -> Result<Vec<OsString>, ForeignError> {
    let video = std::path::absolute(video).map_err(ForeignError::io_error(video))?;
    // The prefix keeps a path with a colon from being taken for a protocol.
    let mut input = OsString::from("file:");
    input.push(video);
    let before = ["-nostdin", "-v", level, "-protocol_whitelist", "file", "-format_whitelist", CONTAINERS];
    let before = before.into_iter().chain(["-max_pixels", MAX_PIXELS, "-i"]);
    let (filter, most) = (chosen.filter(), chosen.most.to_string());
    // The rate is that of the times in the filter, so that no frame is repeated or dropped.
    let after = ["-map", "0:v:0", "-vf", &filter, "-r", "25", "-frames:v", &most, "-pix_fmt", "rgb24"];
    let before = before.map(OsString::from).chain([input]);
    Ok(before.chain(after.map(OsString::from)).collect())
}

/// Runs ffmpeg to its end.
fn decode(
    video: &Path,
    chosen: Choice<'_>,
    output: &[OsString],
    workspace: ProgramWorkspace<'_>,
) -> Result<(), ForeignError> {
    let arguments = [&decoding_arguments(video, chosen, "error")?[..], output].concat();
    let run = ExternalRun { program: FFMPEG, arguments, seconds: MAX_SECONDS, workspace };
    run.end_well().map(drop)
}

/// A path in a pattern of file names, in which `%` begins a number.
fn escaped(path: &Path) -> Vec<u8> {
    let double = |byte: &u8| if *byte == b'%' { vec![b'%'; 2] } else { vec![*byte] };
    path.as_os_str().as_bytes().iter().flat_map(double).collect()
}

/// The sharpness of every candidate.
fn measure_candidates(
    video: &Path,
    every: u32,
    workspace: ProgramWorkspace<'_>,
) -> Result<Vec<f64>, FrameError> {
    let chosen = Choice { every, dropped: &[], most: MAX_FRAMES + 1 };
    // Errors would be printed between the pictures.
    let arguments = decoding_arguments(video, chosen, "quiet")?;
    let pictures = ["-f", "image2pipe", "-c:v", "ppm", "pipe:1"].map(OsString::from);
    let arguments = [&arguments[..], &pictures].concat();
    let (environment, folder) = (BTreeMap::new(), PathBuf::from("/"));
    let call = ProgramCall { program: FFMPEG.into(), arguments, environment, folder };
    match measure_pictures(&call, workspace) {
        Ok(Some(measured)) => Ok(measured),
        Ok(None) => Err(FrameError::Many { every }),
        Err(_) if !(workspace.goes_on)() => Err(ForeignError::Stopped.into()),
        Err(error) => Err(failed_decoding(video, chosen, error, workspace)),
    }
}

/// The sharpness of every picture that ffmpeg prints; `None` if they are too many.
fn measure_pictures(call: &ProgramCall, workspace: ProgramWorkspace<'_>) -> io::Result<Option<Vec<f64>>> {
    let program = PipedProgram::start(workspace.programs, call).map_err(io::Error::other)?;
    let mut pictures = BufReader::new(program.watched(workspace.goes_on)?);
    let mut measured = Vec::new();
    while let Some(size) = picture_size(&mut pictures)? {
        if measured.len() == MAX_FRAMES {
            return Ok(None);
        }
        if size.width > MAX_WIDTH {
            return Err(io::Error::other(format!(
                "frames of {size} pixels, wanted at most {MAX_WIDTH} columns"
            )));
        }
        measured.push(laplacian_variance(size, &mut pictures)?);
    }
    pictures.into_inner().finish().map_err(io::Error::other)?;
    Ok(Some(measured))
}

/// The error of a decoding whose messages were not read: the program runs again, and its log has them.
fn failed_decoding(
    video: &Path,
    chosen: Choice<'_>,
    error: io::Error,
    workspace: ProgramWorkspace<'_>,
) -> FrameError {
    let nowhere = ["-f", "null", "-"].map(OsString::from);
    match decode(video, chosen, &nowhere, workspace) {
        Err(error) => error.into(),
        Ok(()) => ForeignError::io_error(video)(error).into(),
    }
}

/// Variance of the Laplacian of the luma, over the pixels that have four neighbours; 0 without such
/// pixels. `rows` are 3 bytes a pixel, of which three rows are held.
fn laplacian_variance(size: Size, rows: &mut impl Read) -> io::Result<f64> {
    let (width, height) = (size.width as usize, size.height as usize);
    let mut row = vec![0; 3 * width];
    let mut lumas: [Vec<i64>; 3] = std::array::from_fn(|_| vec![0; width]);
    let (mut sum, mut squares, mut count) = (0i64, 0i128, 0u32);
    for y in 0..height {
        rows.read_exact(&mut row)?;
        lumas.rotate_left(1);
        lumas[2].iter_mut().zip(row.as_chunks().0).for_each(|(to, pixel)| *to = luma(*pixel));
        let [above, here, below] = &lumas;
        if y < 2 {
            continue;
        }
        for x in 1..width.saturating_sub(1) {
            let laplacian = here[x - 1] + here[x + 1] + above[x] + below[x] - 4 * here[x];
            sum += laplacian;
            squares += i128::from(laplacian * laplacian);
            count += 1;
        }
    }
    if count == 0 {
        return Ok(0.0);
    }
    // The sums are exact, and the mean of a Laplacian is near 0, so the difference below loses few digits.
    // The luma is in thousandths, which the variance has squared.
    let mean = sum as f64 / f64::from(count);
    Ok((squares as f64 / f64::from(count) - mean * mean) / 1e6)
}

/// Rec. 601 in thousandths: integers, so that a sum has no order.
fn luma([r, g, b]: [u8; 3]) -> i64 {
    299 * i64::from(r) + 587 * i64::from(g) + 114 * i64::from(b)
}

/// Indices of the frames whose sharpness is at least this share of the median of their neighbours.
fn sharp_enough(measured: &[f64], share: f64) -> Vec<usize> {
    let is_sharp = |i: &usize| {
        let around = i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(measured.len());
        let others = around.filter(|j| j != i).map(|j| measured[j]).collect();
        upper_median(others).is_none_or(|median| measured[*i] >= share * median)
    };
    (0..measured.len()).filter(is_sharp).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_lowers_the_variance_of_the_laplacian() {
        let size = Size { width: 8, height: 8 };
        let t = |luma: &dyn Fn(i32, i32) -> u8, wanted: f64| {
            let bytes = (0..8).flat_map(|y| (0..8).map(move |x| (x, y))).flat_map(|(x, y)| [luma(x, y); 3]);
            let found = laplacian_variance(size, &mut &bytes.collect::<Vec<u8>>()[..]).unwrap();
            assert!((found - wanted).abs() <= 1e-9 * wanted, "{found}, wanted {wanted}");
        };
        t(&|_, _| 77, 0.0);
        // A ramp has no second derivative.
        t(&|x, y| u8::try_from(10 * x + 20 * y).unwrap_or(0), 0.0);
        // A chessboard of 0 and 10 has the Laplacians 40 and -40, half of them each.
        t(&|x, y| if (x + y) % 2 == 0 { 10 } else { 0 }, 1600.0);
        // Columns of 0 and 10 have 20 and -20.
        t(&|x, _| if x % 2 == 0 { 10 } else { 0 }, 400.0);
        let narrow = Size { width: 2, height: 9 };
        assert_eq!(laplacian_variance(narrow, &mut &[1; 54][..]).unwrap().to_bits(), 0);
        assert!(laplacian_variance(size, &mut &[1; 191][..]).is_err(), "a picture that ends early");
    }

    #[test]
    fn a_per_cent_sign_in_a_folder_is_no_number() {
        assert_eq!(escaped(Path::new("/50% done/%d")), b"/50%% done/%%d");
    }

    #[test]
    fn candidates_that_are_dropped_are_named_by_their_frames() {
        let filter = Choice { every: 4, dropped: &[2, 5], most: 9 }.filter();
        assert!(filter.contains("not((eq(n\\,8)+eq(n\\,20)))"), "{filter}");
    }

    #[test]
    fn frames_are_compared_with_their_neighbours() {
        let t = |measured: &[f64], wanted: &[usize]| assert_eq!(sharp_enough(measured, 0.5), wanted);
        t(&[], &[]);
        t(&[3.0], &[0]);
        t(&[10.0, 4.0, 10.0, 11.0, 9.0], &[0, 2, 3, 4]);
        // A slow fall is a change of what is seen, not blur.
        t(&[100.0, 80.0, 64.0, 51.0, 41.0, 33.0, 26.0, 21.0], &[0, 1, 2, 3, 4, 5, 6, 7]);
    }
}
