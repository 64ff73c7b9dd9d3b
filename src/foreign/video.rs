//! Frames of a video, decoded by ffmpeg. Every n-th frame is a candidate; candidates that are blurred
//! are dropped.
//!
//! The sharpness of a frame is the variance of the Laplacian of its luma (Pech-Pacheco et al., ICPR
//! 2000). It depends on what is seen, so a frame is compared with its neighbours only.

use super::ForeignError;
use super::run::ExternalRun;
use super::versions::FFMPEG;
use crate::files;
use crate::image::{Image, png};
use crate::reconstruct::ProgramWorkspace;
use crate::source::solving::FramePicking;
use crate::stats::upper_median;
use rayon::prelude::*;
use std::ffi::OsString;
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};

/// Maximum number of candidates. A frame of 1080p takes about 3 MB.
const MAX_FRAMES: usize = 5000;
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
    (to, wanted): (&Path, usize),
    workspace: ProgramWorkspace<'_>,
) -> Result<TakenFrames, FrameError> {
    let FramePicking { every, sharpness } = picking;
    let decode = ExternalRun {
        program: FFMPEG,
        arguments: decoding_arguments(video, every, workspace.folder)?,
        seconds: MAX_SECONDS,
        workspace,
    };
    decode.end_well()?;
    // ffmpeg counts its files from 1.
    let numbered = (1..).map(|k| workspace.folder.join(format!("{k:06}.png")));
    let candidates: Vec<PathBuf> = numbered.take_while(|file| files::is_there(file)).collect();
    let found = candidates.len();
    if found < wanted {
        return Err(FrameError::Few { found, every, wanted });
    }
    if found > MAX_FRAMES {
        return Err(FrameError::Many { every });
    }
    let measured = candidates
        .par_iter()
        .map(|file| if (workspace.goes_on)() { frame_sharpness(file) } else { Err(ForeignError::Stopped) });
    let kept = sharp_enough(&measured.collect::<Result<Vec<f64>, _>>()?, sharpness);
    for index in &kept {
        let frame = to.join(format!("{:06}.png", index * every as usize));
        std::fs::rename(&candidates[*index], &frame).map_err(ForeignError::io_error(&frame))?;
    }
    if kept.len() < wanted {
        return Err(FrameError::Few { found: kept.len(), every, wanted });
    }
    Ok(TakenFrames { kept: kept.len(), dropped: found - kept.len() })
}

/// Arguments of ffmpeg that write every n-th frame.
fn decoding_arguments(video: &Path, every: u32, to: &Path) -> Result<Vec<OsString>, ForeignError> {
    let video = std::path::absolute(video).map_err(ForeignError::io_error(video))?;
    let mut input = OsString::from("file:");
    input.push(video);
    // Selected frames get times one after another: otherwise ffmpeg repeats frames to keep the rate.
    let filter = format!("select=not(mod(n\\,{every})),setpts=N/(25*TB)");
    let most = (MAX_FRAMES + 1).to_string();
    let before =
        ["-nostdin", "-v", "error", "-protocol_whitelist", "file", "-format_whitelist", CONTAINERS, "-i"];
    let after = ["-map", "0:v:0", "-vf", &filter, "-r", "25", "-frames:v", &most, "-pix_fmt", "rgb24"];
    let mut arguments: Vec<OsString> = before.map(OsString::from).to_vec();
    arguments.push(input);
    arguments.extend(after.map(OsString::from));
    arguments.push(to.join("%06d.png").into());
    Ok(arguments)
}

fn frame_sharpness(file: &Path) -> Result<f64, ForeignError> {
    let bytes = files::read(file, files::MAX_PICTURE).map_err(ForeignError::io_error(file))?;
    let frame = png::read_rgb(BufReader::new(Cursor::new(bytes))).map_err(ForeignError::own_product(file))?;
    Ok(laplacian_variance(&frame))
}

/// Variance of the Laplacian of the luma, over the pixels that have four neighbours; 0 without such
/// pixels.
fn laplacian_variance(frame: &Image<[u8; 3]>) -> f64 {
    let (width, height) = (frame.size().width as usize, frame.size().height as usize);
    // Rec. 601 in thousandths: integers, so that the sum has no order.
    let luma = |[r, g, b]: [u8; 3]| 299 * i64::from(r) + 587 * i64::from(g) + 114 * i64::from(b);
    let lumas: Vec<i64> = frame.pixels().iter().map(|pixel| luma(*pixel)).collect();
    let (mut sum, mut squares, mut count) = (0i64, 0i128, 0u32);
    for y in 1..height.saturating_sub(1) {
        for at in y * width + 1..(y + 1) * width - 1 {
            let around = lumas[at - 1] + lumas[at + 1] + lumas[at - width] + lumas[at + width];
            let laplacian = around - 4 * lumas[at];
            sum += laplacian;
            squares += i128::from(laplacian * laplacian);
            count += 1;
        }
    }
    if count == 0 {
        return 0.0;
    }
    let mean = sum as f64 / f64::from(count);
    (squares as f64 / f64::from(count) - mean * mean) / 1e6
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
    use crate::image::Size;

    #[test]
    fn blur_lowers_the_variance_of_the_laplacian() {
        let size = Size { width: 8, height: 8 };
        let t = |luma: &dyn Fn(i32, i32) -> u8, wanted: f64| {
            let pixels = (0..8).flat_map(|y| (0..8).map(move |x| (x, y))).map(|(x, y)| [luma(x, y); 3]);
            let found = laplacian_variance(&Image::from_vec(size, pixels.collect()));
            assert!((found - wanted).abs() <= 1e-9 * wanted, "{found}, wanted {wanted}");
        };
        t(&|_, _| 77, 0.0);
        // A ramp has no second derivative.
        t(&|x, y| u8::try_from(10 * x + 20 * y).unwrap_or(0), 0.0);
        // A chessboard of 0 and 10 has the Laplacians 40 and -40, half of them each.
        t(&|x, y| if (x + y) % 2 == 0 { 10 } else { 0 }, 1600.0);
        // Columns of 0 and 10 have 20 and -20.
        t(&|x, _| if x % 2 == 0 { 10 } else { 0 }, 400.0);
        assert!(laplacian_variance(&Image::filled(Size { width: 2, height: 9 }, [1; 3])).abs() < 1e-9);
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
