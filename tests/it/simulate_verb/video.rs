//! Videos through `ffmpeg`, compared with the pictures that another run of `ffmpeg` extracts and with
//! the stamps that `ffprobe` prints.

use super::npy;
use crate::support::absent::absent;
use crate::support::workspace::Workspace;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Runs a program of FFmpeg, and returns what it prints.
fn ffmpeg(place: &Path, program: &str, args: &str) -> String {
    let args = ["-v", "error"].into_iter().chain(args.split_whitespace());
    let output = Command::new(program).args(args).current_dir(place).output().unwrap();
    assert!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A workspace with `clip.mp4`, of a variable frame rate, and `turned.mp4`, which is the same but for
/// its rotation; `None` without FFmpeg.
fn clips() -> Option<Workspace> {
    let there = |program: &str| Command::new(program).arg("-version").output().is_ok();
    if !there("ffmpeg") || !there("ffprobe") {
        absent("REQUIRE_FFMPEG", "ffmpeg or ffprobe is absent");
        return None;
    }
    let place = Workspace::new();
    let uneven = "select=not(eq(mod(n\\,7)\\,3))*not(eq(mod(n\\,5)\\,2))";
    let make = format!(
        "-f lavfi -i testsrc2=size=64x48:rate=30000/1001:duration=1 -vf {uneven} -vsync passthrough -c:v mpeg4 clip.mp4"
    );
    ffmpeg(place.path("").as_path(), "ffmpeg", &make);
    ffmpeg(place.path("").as_path(), "ffmpeg", "-i clip.mp4 -c copy -metadata:s:v rotate=90 turned.mp4");
    Some(place)
}

/// The stamps of the frames in microseconds, from the decimals that `ffprobe` prints.
fn stamps(place: &Workspace, clip: &str) -> Vec<i64> {
    let args = format!("-select_streams v:0 -show_entries frame=pts_time -of csv=print_section=0 {clip}");
    let text = ffmpeg(place.path("").as_path(), "ffprobe", &args);
    let micros = |line: &str| (line.trim_end_matches(',').parse::<f64>().unwrap() * 1e6).round();
    #[expect(clippy::cast_possible_truncation, reason = "a second in microseconds")]
    let all = text.lines().map(|line| micros(line) as i64).collect();
    all
}

#[test]
fn a_video_is_its_pictures_at_its_stamps() {
    let Some(place) = clips() else { return };
    for clip in ["clip.mp4", "turned.mp4"] {
        let stamps = stamps(&place, clip);
        let gaps: std::collections::BTreeSet<i64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(stamps.len() > 15 && gaps.len() > 2, "the frame rate varies: {stamps:?}");
        let folder = place.path(&format!("{clip}.d"));
        fs::create_dir(&folder).unwrap();
        let extract = format!("-i {clip} -vsync passthrough -pix_fmt rgb24 {clip}.d/%03d.png");
        ffmpeg(place.path("").as_path(), "ffmpeg", &extract);
        npy(&place.path("stamps.npy"), &[stamps.len() as u64], &stamps);
        let common = "--sensor v2e-noisy --seed 3 --luminance rec709 --allow-cap";
        place.ok(&format!("simulate --video {clip} {common} --out video.h5"));
        place.ok(&format!("simulate --frames {clip}.d --stamps stamps.npy {common} --out pictures.h5"));
        let [video, pictures] = ["video.h5", "pictures.h5"].map(|name| fs::read(place.path(name)).unwrap());
        assert!(video == pictures, "{clip}");
    }
    // A quarter turn swaps the sides.
    let found = place.ok("info --json video.h5").stdout;
    assert!(found.contains("48") && found.contains("64"), "{found}");
}

#[test]
fn what_is_no_video_is_refused() {
    let Some(place) = clips() else { return };
    place.write("text.mp4", "no video");
    let whole = fs::read(place.path("clip.mp4")).unwrap();
    place.write("cut.mp4", &whole[..whole.len() / 2]);
    place.write("list.m3u8", "#EXTM3U\n#EXTINF:1,\nhttp://localhost:9/a.ts\n#EXT-X-ENDLIST\n");
    let t = |args: &str, code: i32, part: &str| {
        let ended = place.gs2e(&format!("simulate {args} --sensor esim --out e.h5"));
        assert_eq!(ended.code, code, "{args}: {}", ended.stderr);
        assert!(ended.stderr.contains(part), "{args}: {part}\n{}", ended.stderr);
        assert!(!place.path("e.h5").exists());
    };
    t("--video gone.mp4", 2, "video: gone.mp4 does not exist");
    t("--video text.mp4", 1, "text.mp4: ffprobe cannot read it");
    t("--video cut.mp4", 1, "cut.mp4: ffprobe cannot read it");
    t("--video list.m3u8", 1, "list.m3u8: ffprobe cannot read it");
    t("--video clip.mp4 --fps 30", 2, "cannot be used with");
    t("--video clip.mp4 --frames clip.mp4", 2, "cannot be used with");
}

#[test]
fn without_ffmpeg_the_error_says_how_to_install_it() {
    let place = Workspace::new();
    place.write("clip.mp4", "not looked into");
    let mut command = place.command("simulate --video clip.mp4 --sensor esim --out e.h5");
    // A relative folder of the path is never searched.
    let output = command.env("PATH", ".").output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("there is no program `ffprobe`") && said.contains("apt install ffmpeg"), "{said}");
}
