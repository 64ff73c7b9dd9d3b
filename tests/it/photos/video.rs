//! Frames of videos that ffmpeg has encoded without loss.

use super::planted::Corner;
use crate::support::absent::absent;
use crate::support::foreign::programs;
use crate::support::workspace::Workspace;
use gs2e_source::foreign::versions;
use gs2e_source::foreign::video::{FrameError, TakenFrames, take_frames};
use gs2e_source::reconstruct::ProgramWorkspace;
use gs2e_source::solving::FramePicking;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

fn ffmpeg_is_there() -> bool {
    versions::ffmpeg(&programs()).map_err(|because| absent("REQUIRE_FFMPEG", &because)).is_ok()
}

/// A video whose frame `k` is the photo `k` modulo 6, except frame 8, which is grey. Returns the
/// bytes of the pixels by frame.
fn film(place: &Workspace, frames: usize) -> Vec<Vec<[u8; 3]>> {
    let corner = Corner::default();
    let photos = corner.write_photos(place, "photos");
    super::planted::grey(place, "grey.png", corner.size());
    let mut pixels = Vec::new();
    for k in 0..frames {
        let from = if k == 8 { place.path("grey.png") } else { photos[k % photos.len()].1.clone() };
        let bytes = fs::read(from).unwrap();
        place.write(&format!("film/{k}.png"), &bytes);
        pixels.push(gs2e_image::png::read_rgb(std::io::Cursor::new(bytes)).unwrap().into_pixels());
    }
    let encoded = Command::new("ffmpeg")
        .args([
            "-v",
            "error",
            "-framerate",
            "30",
            "-i",
            "film/%d.png",
            "-c:v",
            "ffv1",
            "-pix_fmt",
            "bgr0",
            "film.mkv",
        ])
        .current_dir(place.path(""))
        .status()
        .unwrap();
    assert!(encoded.success());
    pixels
}

fn take(place: &Workspace, name: &str, picking: FramePicking) -> Result<TakenFrames, FrameError> {
    let number = fs::read_dir(place.path("")).unwrap().count();
    let [to, folder] = ["to", "desk"].map(|name| place.path(&format!("{name}-{number}")));
    [&to, &folder].into_iter().for_each(|folder| fs::create_dir(folder).unwrap());
    let (log, programs) = (place.path("log"), programs());
    let workspace = ProgramWorkspace { folder: &folder, log: &log, goes_on: &|| true, programs: &programs };
    let taken = take_frames(&place.path(name), picking, &to, 3, workspace);
    let _ = fs::remove_dir_all(place.path("frames"));
    fs::rename(&to, place.path("frames")).unwrap();
    taken
}

#[test]
fn every_nth_frame_is_taken_and_blurred_ones_are_dropped() {
    if !ffmpeg_is_there() {
        return;
    }
    let place = Workspace::new();
    let pixels = film(&place, 25);
    let t = |every: u32, sharpness: f64, wanted: &[usize]| {
        let taken = take(&place, "film.mkv", FramePicking { every, sharpness }).unwrap();
        let mut names: Vec<std::ffi::OsString> =
            fs::read_dir(place.path("frames")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort_unstable();
        let wanted_names: Vec<std::ffi::OsString> =
            wanted.iter().map(|k| format!("{k:06}.png").into()).collect();
        assert_eq!(names, wanted_names);
        assert_eq!(taken.kept, wanted.len());
        for k in wanted {
            let bytes = fs::read(place.path(&format!("frames/{k:06}.png"))).unwrap();
            let frame = gs2e_image::png::read_rgb(std::io::Cursor::new(bytes)).unwrap();
            assert!(frame.pixels() == pixels[*k], "frame {k}");
        }
    };
    t(4, 0.5, &[0, 4, 12, 16, 20, 24]);
    t(4, 0.0, &[0, 4, 8, 12, 16, 20, 24]);
    t(7, 0.5, &[0, 7, 14, 21]);
}

#[test]
fn videos_that_cannot_be_used_are_named() {
    if !ffmpeg_is_there() {
        return;
    }
    let place = Workspace::new();
    film(&place, 4);
    let t = |name: &str, every: u32, wanted: &str| {
        let picking = FramePicking { every, ..FramePicking::default() };
        let told = take(&place, name, picking).unwrap_err().to_string();
        assert!(told.contains(wanted), "{told}");
    };
    t("film.mkv", 10, "one frame in 10 gives 1, wanted at least 3");
    t("film.mkv", 2, "one frame in 2 gives 2, wanted at least 3");
    place.write("text.mp4", "no video");
    t("text.mp4", 1, "run ffmpeg");
    // A list of files would let a recipe of a stranger read any video of this machine.
    place.write("list.mp4", "#EXTM3U\n#EXTINF:1,\nfilm.mkv\n#EXT-X-ENDLIST\n");
    t("list.mp4", 1, "run ffmpeg");
    place.write("concat.mp4", "ffconcat version 1.0\nfile film.mkv\n");
    t("concat.mp4", 1, "run ffmpeg");
}

/// In a pattern of ffmpeg, `%` begins a number.
#[test]
fn a_folder_with_a_per_cent_sign_takes_frames() {
    if !ffmpeg_is_there() {
        return;
    }
    let place = Workspace::new();
    film(&place, 5);
    let [to, folder] = ["to", "50% done %d"].map(|name| place.path(name));
    [&to, &folder].into_iter().for_each(|folder| fs::create_dir(folder).unwrap());
    let (log, programs) = (place.path("log"), programs());
    let workspace = ProgramWorkspace { folder: &folder, log: &log, goes_on: &|| true, programs: &programs };
    let picking = FramePicking { every: 1, sharpness: 0.0 };
    let taken = take_frames(&place.path("film.mkv"), picking, &to, 3, workspace).unwrap();
    assert_eq!((taken.kept, fs::read_dir(&to).unwrap().count()), (5, 5));
}

/// Encodes frames that ffmpeg draws, by an encoder that needs little memory for large ones.
fn drawn(place: &Workspace, name: &str, source: &str) {
    let words = ["-v", "error", "-f", "lavfi", "-i", source, "-c:v", "utvideo", "-threads", "1", name];
    assert!(Command::new("ffmpeg").args(words).current_dir(place.path("")).status().unwrap().success());
}

/// Nothing is on the disk before the frames are chosen, and no frame is too large for the memory.
#[test]
fn a_video_is_bounded_before_its_frames_are_written() {
    if !ffmpeg_is_there() {
        return;
    }
    let place = Workspace::new();
    drawn(&place, "many.mkv", "color=size=16x16:rate=1000:duration=5.012");
    let picking = FramePicking { every: 1, sharpness: 0.0 };
    let told = take(&place, "many.mkv", picking).unwrap_err().to_string();
    assert!(told.contains("one frame in 1 gives more than 5000"), "{told}");
    let entries = fs::read_dir(place.path("")).unwrap().map(|entry| entry.unwrap().path());
    let desks: Vec<PathBuf> =
        entries.filter(|path| path.file_name().unwrap().to_string_lossy().starts_with("desk")).collect();
    assert_eq!(desks.len(), 1);
    assert_eq!(fs::read_dir(&desks[0]).unwrap().count(), 0, "frames were written");

    drawn(&place, "large.mkv", "color=size=9000x9000:rate=1:duration=1");
    let told = take(&place, "large.mkv", picking).unwrap_err().to_string();
    assert!(told.contains("run ffmpeg"), "{told}");
    let log = fs::read_to_string(place.path("log")).unwrap();
    assert!(log.contains("max pixel"), "{log}");
}

/// A video without a frame for minutes must still end when it is asked to.
#[test]
fn a_stopped_video_ends() {
    if !ffmpeg_is_there() {
        return;
    }
    let place = Workspace::new();
    film(&place, 4);
    let folder = place.path("desk");
    fs::create_dir(&folder).unwrap();
    let (log, programs) = (place.path("log"), programs());
    let workspace = ProgramWorkspace { folder: &folder, log: &log, goes_on: &|| false, programs: &programs };
    let taken = take_frames(&place.path("film.mkv"), FramePicking::default(), &folder, 3, workspace);
    assert!(
        matches!(taken, Err(FrameError::Program(gs2e_source::foreign::ForeignError::Stopped))),
        "{taken:?}"
    );
}

#[test]
fn a_video_becomes_steps_of_a_build() {
    let place = Workspace::new();
    place.write("film.mp4", "no video");
    place.write(
        "recipe.yaml",
        super::scripted::recipe("")
            .replace("photos: { path: photos,  }", "video: { path: film.mp4, every: 4 }"),
    );
    let steps: Vec<String> = place.plan("recipe.yaml").into_iter().map(|(step, _)| step).collect();
    assert_eq!(steps[..3], ["lab/corner/frames", "lab/corner/poses", "lab/corner/capture"]);
    let ended = place.gs2e("build -j 1 recipe.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("ffmpeg"), "{}", ended.stderr);
}
