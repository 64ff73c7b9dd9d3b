//! Warnings about frames between which events cannot be known.

use super::sequence::StampedFrames;
use gs2e_files::programs::quoted;
use gs2e_sensor::frames::motion::FrameMotion;
use std::path::Path;

/// Motion between two frames from which on events are inexact, px.
const SOUND_PX: f32 = 1.0;
/// Motion over which interpolation by ffmpeg is of little use, px.
const FAR_PX: f32 = 32.0;

/// Warnings if the picture moves too far from frame to frame, or if frames repeat.
pub(super) fn motion_warnings(motion: &FrameMotion, input: &Path, sequence: &StampedFrames) -> Vec<String> {
    let repeated = motion.repeated();
    let of_repeats = repeated.map(|[repeats, frames]| {
        let means = command(input, sequence.rate().to_f64(), "mpdecimate -fps_mode vfr");
        format!(
            "warning: {repeats} of {frames} frames repeat the one before: was the clip sampled up? Its events come in \
             bursts. Use the clip as it was recorded, or leave the repeated frames out{means}"
        )
    });
    let rate = sequence.rate().to_f64();
    // Repeated frames show nothing: the others are the clip.
    let rate = repeated.map_or(rate, |[repeats, frames]| rate * (frames - repeats) as f64 / frames as f64);
    let of_motion = motion.median_px().and_then(|px| motion_warning(px, rate, input));
    [of_repeats, of_motion].into_iter().flatten().collect()
}

fn motion_warning(px: f32, rate: f64, input: &Path) -> Option<String> {
    if px <= SOUND_PX {
        return None;
    }
    let scene = "or make a scene of the frames (`gs2e train`) and render as many as you need (docs/video.md)";
    if px.is_infinite() {
        return Some(format!(
            "warning: the frames are too far apart: most parts of one are not found in the next, so events between \
             frames are guesses. Record at a higher rate, {scene}"
        ));
    }
    let times = f64::from((px / SOUND_PX).ceil());
    let fps = (times * rate).round();
    let ffmpeg = command(input, rate, &format!("minterpolate=fps={fps:.0}:mi_mode=mci"));
    let ffmpeg = if px < FAR_PX { ffmpeg } else { String::new() };
    Some(format!(
        "warning: the picture moves by {px:.1} px from frame to frame, so events between frames are inexact: use at \
         least {times:.0} times the frames, {fps:.0} per second. Record them, interpolate them with a network (RIFE, \
         FILM){ffmpeg}, {scene}"
    ))
}

/// A command of ffmpeg with this filter, where ffmpeg reads the input.
fn command(input: &Path, rate: f64, filter: &str) -> String {
    let is_array = input.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"));
    if is_array {
        return String::new();
    }
    let images = input.join("*");
    let input = match input.is_dir() {
        true => format!("-framerate {rate} -pattern_type glob -i {}", quoted([images.as_path()])),
        false => format!("-i {}", quoted([input])),
    };
    format!(" (`ffmpeg {input} -vf {filter} out.mkv`)")
}
