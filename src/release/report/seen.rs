//! Contents of a scene's files for the page: event rates, and pictures of one moment of a
//! trajectory.
//!
//! Rates come from `ms_to_idx`, so that no event is read for them. A picture is of the middle of
//! the trajectory: the sharp frame nearest to it, and the events around that frame. A file that
//! cannot be read is not shown; the release finds the cause when it copies the file.

use super::curve::ReportCurve;
use super::depth::DetailLevel;
use super::embed::EmbeddedPicture;
use super::section::ReportTrajectory;
use crate::artifact::EventStream;
use crate::check::Finding;
use crate::event::picture::WindowCounts as Balance;
use crate::event::{EventSink as _, EventSource as _, h5};
use crate::files;
use crate::image::Size;
use crate::release::published::{self, StoredPlaces};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A picture and what it shows.
#[derive(Debug)]
pub(super) struct ShownPicture {
    pub(super) picture: EmbeddedPicture,
    pub(super) words: String,
}

/// The sharp frame nearest to the middle of the trajectory: its number and path.
fn middle_frame<'a>(track: &ReportTrajectory<'a>) -> Option<(usize, &'a str)> {
    let middle = track.part.poses / 2;
    // Of two frames at one distance the first is shown, so that equal releases have equal pages.
    track.frames("sharp").min_by_key(|(number, _)| (number.abs_diff(middle), *number))
}

/// Time of that frame, or of the middle pose where there are no frames, us.
fn moment_us(track: &ReportTrajectory<'_>) -> i64 {
    let stamps = &track.published.motion.trajectory.stamps_us;
    let number = middle_frame(track).map_or(stamps.len() / 2, |(number, _)| number);
    stamps.get(number).copied().unwrap_or(0)
}

/// A PNG file of the tree.
fn picture(path: &str, places: StoredPlaces<'_>, width: u32) -> Option<EmbeddedPicture> {
    let bytes = files::read_with(&places(path)?, files::LinkRule::Refuse, files::MAX_DOCUMENT).ok()?;
    EmbeddedPicture::of_png(&bytes, width)
}

/// The sharp frame nearest to the middle.
pub(super) fn sharp_picture(
    track: ReportTrajectory<'_>,
    places: StoredPlaces<'_>,
    width: u32,
) -> Option<ShownPicture> {
    let (number, path) = middle_frame(&track)?;
    let words = format!("sharp frame {number} at {:.1} ms", moment_us(&track) as f64 * 1e-3);
    Some(ShownPicture { picture: picture(path, places, width)?, words })
}

/// The blurred frame whose exposure is nearest to that frame in time.
pub(super) fn blurred_picture(
    track: ReportTrajectory<'_>,
    places: StoredPlaces<'_>,
    width: u32,
) -> Option<ShownPicture> {
    let exposures = published::exposures(track.part, &track.published.motion);
    let moment = moment_us(&track);
    // Twice the distance from the exposure's centre, which is a whole number.
    let away = |[start, end]: &[i64; 2]| (start + end - 2 * moment).abs();
    let (pose, times) = exposures.iter().min_by_key(|(_, times)| away(times))?;
    let (_, path) = track.frames("blur").find(|(number, _)| number == pose)?;
    let [from, to] = times.map(|us| us as f64 * 1e-3);
    Some(ShownPicture {
        picture: picture(path, places, width)?,
        words: format!("blurred frame {pose}, exposed from {from:.1} to {to:.1} ms"),
    })
}

/// The rate of a stream over time, from its file: events per second, over a trajectory of this
/// length.
pub(super) fn stream_rate(file: &Path, duration_us: i64, points: usize) -> Option<ReportCurve> {
    let index = h5::Reader::open(file).ok()?.index().ok()?;
    let counts: Vec<f64> = index.windows(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64).collect();
    let (hz, ms) = millisecond_rates(&counts, duration_us as f64 * 1e-3);
    Some(ReportCurve::new(&hz, &ms, points))
}

/// Events per second from the counts of milliseconds, and the duration of each rate, ms. The last
/// millisecond is only partly within the trajectory. Less than half of it is added to the one
/// before it, since a rate over so little says nothing.
fn millisecond_rates(counts: &[f64], whole_ms: f64) -> (Vec<f64>, Vec<f64>) {
    let length = |k: usize| (whole_ms - k as f64).clamp(0.0, 1.0);
    let mut held: Vec<[f64; 2]> = counts.iter().enumerate().map(|(k, count)| [*count, length(k)]).collect();
    while let [.., before, last] = held.as_mut_slice()
        && last[1] < 0.5
    {
        *before = [before[0] + last[0], before[1] + last[1]];
        held.pop();
    }
    held.into_iter().map(|[count, ms]| (count * 1e3 / ms, ms)).unzip()
}

/// A picture of the events of a stream around the middle of its trajectory.
pub(super) fn events_picture(track: ReportTrajectory<'_>, file: &Path, width: u32) -> Option<ShownPicture> {
    let camera = &track.entry.scene.file.camera;
    let size = Size { width: camera.width, height: camera.height };
    let mut reader = h5::Reader::open(file).ok()?;
    let index = reader.index().ok()?;
    let ms =
        busy_window(&index, usize::try_from(moment_us(&track) / 1000).ok()?, size.pixels() as u64 / DENSITY)?;
    let us = |ms: usize| i64::try_from(ms).ok()?.checked_mul(1000);
    let window_us = us(ms.start)?..us(ms.end)?;
    let mut balance = Balance::new(size, window_us.clone()).ok()?;
    let mut chunk = Vec::new();
    // The chunk can begin before the window; events outside the window are not counted.
    reader.seek(index[ms.start]);
    while reader.next_chunk(&mut chunk).ok()? {
        balance.append(&chunk).ok()?;
        if chunk.last().is_some_and(|event| event.t.floor_micros() >= window_us.end) {
            break;
        }
    }
    let picture = EmbeddedPicture::from_image(&balance.image(), width)?;
    let words = format!("events of {} to {} ms: brighter in red, darker in blue", ms.start, ms.end);
    Some(ShownPicture { picture, words })
}

/// Number of pixels for each event that a picture should have.
const DENSITY: u64 = 6;
/// Length in milliseconds at which a window stops growing.
const MAX_WINDOW_MS: usize = 40;

/// The milliseconds around `middle` that hold about `wanted` events; `None` in an empty index.
fn busy_window(index: &[u64], middle: usize, wanted: u64) -> Option<Range<usize>> {
    // The last entry of the index is the end of the last millisecond.
    let last = index.len().checked_sub(2)?;
    let mut range = middle.min(last)..middle.min(last) + 1;
    let held = |range: &Range<usize>| index[range.end].saturating_sub(index[range.start]);
    while held(&range) < wanted && range.len() < MAX_WINDOW_MS && range != (0..last + 1) {
        range = range.start.saturating_sub(1)..(range.end + 1).min(last + 1);
    }
    Some(range)
}

/// The picture of a check in the trajectory's folder: `checks/<check>.png` or
/// `checks/<sensor>.<check>.png`.
#[derive(Debug)]
pub(super) struct OfCheck<'a> {
    pub(super) check: &'a str,
    pub(super) sensor: Option<&'a str>,
    path: &'a str,
}

impl OfCheck<'_> {
    /// Returns true if a finding is of this check, on this sensor where the picture is of one of several.
    pub(super) fn concerns(&self, finding: &Finding) -> bool {
        let stream = finding.subject.split('#').next().unwrap_or_default();
        let is_of_sensor = |sensor| stream.strip_suffix(sensor).is_some_and(|rest: &str| rest.ends_with('/'));
        finding.check == self.check && self.sensor.is_none_or(is_of_sensor)
    }

    pub(super) fn read(&self, places: StoredPlaces<'_>, width: u32) -> Option<EmbeddedPicture> {
        picture(self.path, places, width)
    }
}

/// The pictures of checks that the page shows, faults first.
pub(super) fn of_checks(track: ReportTrajectory<'_>, depth: DetailLevel) -> Vec<OfCheck<'_>> {
    let paths = track.entry.below(&format!("{}/checks/", track.part.name));
    let mut pictures: Vec<OfCheck<'_>> = paths.filter_map(output_number).collect();
    let findings = &track.published.findings;
    let worst = |of: &OfCheck<'_>| super::findings::worst_verdict(findings.iter().filter(|f| of.concerns(f)));
    pictures.retain(|of| depth.passed_pictures || worst(of).is_some_and(super::findings::is_fault));
    pictures.sort_by_key(|of| worst(of).map_or(usize::MAX, super::findings::verdict_rank));
    pictures.truncate(depth.check_pictures);
    pictures
}

fn output_number(path: &str) -> Option<OfCheck<'_>> {
    let stem = path.rsplit('/').next()?.strip_suffix(".png")?;
    // Names of sensors can have dots, and names of checks have none.
    let (sensor, check) = match stem.rsplit_once('.') {
        Some((sensor, check)) => (Some(sensor), check),
        None => (None, stem),
    };
    Some(OfCheck { check, sensor, path })
}

/// The event files of a trajectory, with the names of their sensors.
pub(super) fn stream_outputs<'a>(
    track: ReportTrajectory<'a>,
    places: StoredPlaces<'_>,
) -> Vec<(Option<&'a str>, PathBuf)> {
    let names = published::stream_names(track.part).into_iter();
    names
        .filter_map(|name| Some((name, places(&track.path_of(&EventStream::released_name(name)))?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_grows_until_it_holds_enough() {
        // 10 events a millisecond, 100 ms and the entry past the last.
        let index: Vec<u64> = (0..=100).map(|k| 10 * k).collect();
        assert_eq!(busy_window(&index, 50, 5), Some(50..51));
        assert_eq!(busy_window(&index, 50, 45), Some(48..53));
        assert_eq!(busy_window(&index, 0, 25), Some(0..3));
        assert_eq!(busy_window(&index, 200, 15), Some(98..100));
        assert_eq!(busy_window(&index, 50, u64::MAX), Some(30..71));
        assert_eq!(busy_window(&[0, 0], 3, 7), Some(0..1));
        assert_eq!((busy_window(&[0], 3, 7), busy_window(&[], 3, 7)), (None, None));
    }

    #[test]
    fn the_last_rate_is_over_what_is_left_of_its_millisecond() {
        let check = |counts: &[f64], whole_ms, wanted: &[[f64; 2]]| {
            let (hz, ms) = millisecond_rates(counts, whole_ms);
            let found: Vec<[f64; 2]> = hz.into_iter().zip(ms).map(|(hz, ms)| [hz, ms]).collect();
            assert_eq!(found, wanted, "{counts:?}");
        };
        check(&[10.0, 20.0, 15.0], 2.75, &[[1e4, 1.0], [2e4, 1.0], [2e4, 0.75]]);
        check(&[10.0, 20.0, 5.0], 2.25, &[[1e4, 1.0], [2e4, 1.25]]);
        // an event at the very end of a whole number of milliseconds
        check(&[10.0, 19.0, 1.0], 2.0, &[[1e4, 1.0], [2e4, 1.0]]);
        check(&[], 0.0, &[]);
    }

    #[test]
    fn pictures_of_checks_say_whose_they_are() {
        for (name, wanted) in [
            ("s/t/checks/motion.png", Some((None, "motion"))),
            ("s/t/checks/fine.event_frame.png", Some((Some("fine"), "event_frame"))),
            ("s/t/checks/a.b.motion.png", Some((Some("a.b"), "motion"))),
            ("s/t/checks/verdicts.json", None),
        ] {
            assert_eq!(output_number(name).map(|of| (of.sensor, of.check)), wanted);
        }
    }
}
