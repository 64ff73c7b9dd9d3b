//! One trajectory in the section of its scene: counts, pictures, findings and files.

use super::ReportPage;
use super::check_pictures::write_check_pictures;
use super::gallery::write_gallery;
use super::section::{self, ReportTrajectory, file_link, on_share, thousands_number};
use crate::scene::{TrajectoryPart, TrajectoryStatistics};
use gs2e_files::html::HtmlFragment;
use gs2e_trajectory::picture::short_number;
use std::fmt::Write as _;

/// Writes a trajectory: pictures first, then checks and files.
pub(super) fn write_trajectory(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    let ReportTrajectory { entry, part, published } = track;
    html.within("article", &[], |html| {
        html.within("h4", &[], |html| {
            html.text(&part.name);
            html.leaf("span", &[("class", "kind")], &format!(" {}", part.kind));
        });
        let mut words = count_words(part);
        if let Some(lights) = &entry.scene.recipe.lights {
            let _ = write!(words, "; light: {lights}");
        }
        let recipe = &entry.scene.recipe;
        if let Some(readout_us) = recipe.readout_us.filter(|_| recipe.has_sharp_along(&part.name)) {
            let _ = write!(words, "; rolling shutter of sharp frames: {readout_us} us");
        }
        html.leaf("p", &[("class", "counted")], &words);
        write_gallery(html, page, track);
        if !entry.is_withheld() {
            write_check_pictures(html, page, track);
        }
        let prefix = format!("{}/{}", entry.id(), part.name);
        section::write_findings(html, page, "Checks", &prefix, &published.findings);
        write_files(html, page, track);
    });
}

/// The counts of a trajectory, in words.
fn count_words(part: &TrajectoryPart) -> String {
    let mut words =
        format!("{} poses, {:.1} ms", thousands_number(part.poses as u64), part.duration_us as f64 * 1e-3);
    let stream = |words: &mut String, name: Option<&str>, counted: &TrajectoryStatistics| {
        let Some(events) = counted.events else { return };
        let _ = write!(
            words,
            "; {}{} events",
            name.map_or(String::new(), |n| format!("{n}: ")),
            thousands_number(events)
        );
        if let Some(rate) = counted.rate_ev_px_s {
            let _ = write!(words, ", {} events/px/s", short_number(rate));
        }
        if let Some(share) = on_share(counted) {
            let _ = write!(words, ", ON share {share:.3}");
        }
        if let Some(peak) = counted.peak_ev_per_ms {
            let _ = write!(words, ", at most {} events in a millisecond", thousands_number(peak));
        }
    };
    stream(&mut words, None, &part.statistics);
    part.sensors.iter().for_each(|(name, sensor)| stream(&mut words, Some(name), &sensor.statistics));
    if let Some(step) = part.statistics.max_step_px {
        let _ = write!(
            words,
            "; largest optical flow between frames for the sensor {} px",
            short_number(f64::from(step))
        );
    }
    words
}

/// Writes links to the trajectory's files. Of a folder of many files only the first is linked. A
/// brief page links to the most wanted files.
fn write_files(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    let folder = format!("{}/", track.part.name);
    let prefix = track.path_of("");
    // The files of the cameras of a body are theirs.
    let of_camera = |path: &&str| {
        path.split_once('/').is_some_and(|(folder, _)| track.part.cameras.iter().any(|name| name == folder))
    };
    let below = track.entry.below(&folder).filter_map(|path| path.strip_prefix(&prefix));
    let paths: Vec<&str> = below.filter(|path| !of_camera(path)).collect();
    // Paths are sorted, so the frames of one folder are neighbours.
    let same = |a: &&str, b: &&str| of_many(a).is_some() && of_many(a) == of_many(b);
    let groups = paths.chunk_by(same).filter(|group| page.detail.full || is_most_wanted(group[0]));
    html.within("p", &[("class", "files")], |html| {
        html.text("Files: ");
        for (number, group) in groups.enumerate() {
            html.text(if number > 0 { ", " } else { "" });
            file_link(html, &format!("{prefix}{}", group[0]), group[0]);
            if group.len() > 1 {
                html.text(&format!(" and {} more", group.len() - 1));
            }
        }
        html.text(if page.detail.full { "" } else { ", and others with them" });
    });
}

/// Returns true for the files that a brief page links to: the events, the findings, and the path in
/// full.
fn is_most_wanted(path: &str) -> bool {
    path.starts_with("events") || ["checks.json", "trajectory.svg", "trajectory.png"].contains(&path)
}

/// The folder of a file that is one of many numbered frames.
fn of_many(path: &str) -> Option<&str> {
    let (folder, name) = path.split_once('/')?;
    name.starts_with(|c: char| c.is_ascii_digit()).then_some(folder)
}
