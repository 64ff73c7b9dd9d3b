//! Contents of a scene's files for the page: event rates, and pictures of one moment of a
//! trajectory.
//!
//! Rates come from `ms_to_idx`, so that no event is read for them. A picture is of the middle of
//! the trajectory: the sharp frame nearest to it, and the events around that frame. A file that
//! cannot be read is not shown; the release finds the cause when it copies the file.

use super::curve::ReportCurve;
use super::embed::EmbeddedPicture;
use super::section::{ReportTrajectory, thousands_number};
use crate::products::ReleaseProduct;
use crate::published::StoredPlaces;
use crate::{products, published};
use gs2e_event::picture::WindowCounts as Balance;
use gs2e_event::{EventSink as _, EventSource as _, h5};
use gs2e_files as files;
use gs2e_image::{Image, Size};
use gs2e_tree::event_file;
use std::ops::Range;
use std::path::PathBuf;

/// A picture of a product that the report asks for.
#[derive(Clone, Copy)]
pub(crate) struct PictureRequest<'a> {
    pub(super) product: &'a ReleaseProduct,
    pub(super) track: ReportTrajectory<'a>,
    pub(super) places: StoredPlaces<'a>,
    /// Maximum width, px.
    pub(super) width: u32,
}

impl<'a> PictureRequest<'a> {
    /// The file of the product whose pose is nearest to the shown moment, with the number of this pose.
    pub(crate) fn nearest_file(&self) -> Option<(usize, &'a str)> {
        let stamps = &self.track.published.motion.trajectory.stamps_us;
        let moment = moment_us(&self.track);
        let away = |number: usize| stamps.get(number).map(|us| us.abs_diff(moment));
        let files = self.track.numbered(self.product);
        let timed = files.filter_map(|(number, path)| Some((away(number)?, number, path)));
        // Of two poses at one distance the lower number comes first, so equal releases have equal pages.
        let (_, number, path) = timed.min()?;
        Some((number, path))
    }

    /// The time of a pose, in words.
    pub(crate) fn moment_words(&self, number: usize) -> String {
        let us = self.track.published.motion.trajectory.stamps_us.get(number).copied().unwrap_or(0);
        format!("{:.1} ms", us as f64 * 1e-3)
    }

    /// Size of its picture, if that is a size of a sensor: it comes from a file.
    pub(super) fn checked_size(&self) -> Option<Size> {
        let size = sensor_size(&self.track);
        size.check_sensor().ok()?;
        Some(size)
    }

    /// A file of the tree.
    pub(super) fn read(&self, path: &str) -> Option<Vec<u8>> {
        read_file(path, self.places)
    }

    /// The picture from a PNG file of the tree.
    pub(crate) fn show_file(&self, path: &str, words: String) -> Option<Preview> {
        Some(Preview { picture: tree_picture(path, self.places, self.width)?, words, wheel: false })
    }

    /// The picture from pixels.
    pub(super) fn show_pixels(&self, image: &Image<[u8; 3]>, words: String) -> Option<Preview> {
        Some(Preview { picture: EmbeddedPicture::from_image(image, self.width)?, words, wheel: false })
    }
}

/// A picture and what it shows.
#[derive(Debug)]
pub(crate) struct Preview {
    pub(super) picture: EmbeddedPicture,
    pub(super) words: String,
    /// True if the caption starts with the wheel of directions.
    pub(super) wheel: bool,
}

/// The sharp frame nearest to the middle of the trajectory: its number and path.
fn middle_frame<'a>(track: &ReportTrajectory<'a>) -> Option<(usize, &'a str)> {
    let middle = track.part.poses / 2;
    // Of two frames at one distance the first is shown, so that equal releases have equal pages.
    track.numbered(&products::SHARP).min_by_key(|(number, _)| (number.abs_diff(middle), *number))
}

/// Time of that frame, or of the middle pose where there are no frames, us.
fn moment_us(track: &ReportTrajectory<'_>) -> i64 {
    let stamps = &track.published.motion.trajectory.stamps_us;
    let number = middle_frame(track).map_or(stamps.len() / 2, |(number, _)| number);
    stamps.get(number).copied().unwrap_or(0)
}

/// A PNG file of the tree.
pub(super) fn tree_picture(path: &str, places: StoredPlaces<'_>, width: u32) -> Option<EmbeddedPicture> {
    EmbeddedPicture::of_png(&read_file(path, places)?, width)
}

fn read_file(path: &str, places: StoredPlaces<'_>) -> Option<Vec<u8>> {
    files::read_with(&places(path)?, files::LinkRule::Refuse, files::MAX_DOCUMENT).ok()
}

/// The sharp frame nearest to the middle.
pub(crate) fn sharp_picture(of: PictureRequest<'_>) -> Option<Preview> {
    let (number, path) = middle_frame(&of.track)?;
    of.show_file(path, format!("sharp frame at pose {number}, {}", of.moment_words(number)))
}

/// The blurred frame whose exposure is nearest to that frame in time.
pub(crate) fn blurred_picture(of: PictureRequest<'_>) -> Option<Preview> {
    let exposures = published::exposures(of.track.part, &of.track.published.motion);
    let moment = moment_us(&of.track);
    // Twice the distance from the exposure's centre, which is a whole number.
    let away = |[start, end]: &[i64; 2]| (start + end - 2 * moment).abs();
    let (pose, times) = exposures.iter().min_by_key(|(_, times)| away(times))?;
    let (_, path) = of.track.numbered(of.product).find(|(number, _)| number == pose)?;
    let [from, to] = times.map(|us| us as f64 * 1e-3);
    of.show_file(path, format!("blurred frame at pose {pose}, exposed from {from:.1} to {to:.1} ms"))
}

/// A stream of events of a trajectory.
#[derive(Debug)]
pub(super) struct PreviewStream<'a> {
    /// Name of the sensor, if there are several.
    pub(super) name: Option<&'a str>,
    file: PathBuf,
    /// Number of events before each millisecond, and before the end.
    index: Vec<u64>,
}

impl PreviewStream<'_> {
    /// Number of events in a range of milliseconds.
    fn count(&self, ms: &Range<usize>) -> u64 {
        let before = |k: usize| self.index.get(k).or(self.index.last()).copied().unwrap_or(0);
        before(ms.end).saturating_sub(before(ms.start))
    }

    /// The rate over time, events per pixel and second, of a sensor of `pixels` over a trajectory of
    /// this length.
    pub(super) fn rate(&self, duration_us: i64, points: usize, pixels: f64) -> ReportCurve {
        let pairs = self.index.windows(2);
        let counts: Vec<f64> = pairs.map(|pair| pair[1].saturating_sub(pair[0]) as f64).collect();
        let (hz, ms) = millisecond_rates(&counts, duration_us as f64 * 1e-3);
        let per_pixel: Vec<f64> = hz.into_iter().map(|hz| hz / pixels).collect();
        ReportCurve::new(&per_pixel, &ms, points)
    }
}

/// The streams of a trajectory whose files can be read.
pub(super) fn preview_streams<'a>(
    track: ReportTrajectory<'a>,
    places: StoredPlaces<'_>,
) -> Vec<PreviewStream<'a>> {
    let names = published::stream_names(track.part).into_iter();
    let stream = |name: Option<&'a str>| {
        let file = places(&track.path_of(&event_file(name)))?;
        let index = h5::Reader::open(&file).ok()?.index().ok()?;
        Some(PreviewStream { name, file, index })
    };
    names.filter_map(stream).collect()
}

/// The milliseconds around the shown moment that all event pictures of a trajectory show.
pub(super) fn shared_window(
    track: &ReportTrajectory<'_>,
    streams: &[PreviewStream<'_>],
) -> Option<Range<usize>> {
    let middle = usize::try_from(moment_us(track) / 1000).ok()?;
    busy_window(streams, middle, sensor_size(track).pixels() as u64 / DENSITY)
}

/// Size of the pictures of a trajectory.
pub(super) fn sensor_size(track: &ReportTrajectory<'_>) -> Size {
    track.entry.scene.file.camera_of(track.part).camera().size
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

/// A picture of the events of a stream in a range of milliseconds.
pub(super) fn events_picture(
    track: ReportTrajectory<'_>,
    stream: &PreviewStream<'_>,
    window: &Range<usize>,
    width: u32,
) -> Option<Preview> {
    let mut reader = h5::Reader::open(&stream.file).ok()?;
    let us = |ms: usize| i64::try_from(ms).ok()?.checked_mul(1000);
    let window_us = us(window.start)?..us(window.end)?;
    let mut balance = Balance::new(sensor_size(&track), window_us.clone()).ok()?;
    let mut chunk = Vec::new();
    // The chunk can begin before the window; events outside the window are not counted.
    let first = stream.index.get(window.start).or(stream.index.last());
    reader.seek(first.copied().unwrap_or(0));
    while reader.next_chunk(&mut chunk).ok()? {
        balance.append(&chunk).ok()?;
        if chunk.last().is_some_and(|event| event.t.floor_micros() >= window_us.end) {
            break;
        }
    }
    let picture = EmbeddedPicture::from_image(&balance.image(), width)?;
    let of = stream.name.map_or(String::new(), |name| format!("{name}: "));
    let count = thousands_number(stream.count(window));
    let words = format!(
        "{of}{count} events from {} to {} ms: red is brighter, blue darker",
        window.start, window.end
    );
    Some(Preview { picture, words, wheel: false })
}

/// Number of pixels for each event that a picture should have.
const DENSITY: u64 = 6;
/// Length in milliseconds at which a window stops growing.
const MAX_WINDOW_MS: usize = 40;

/// The milliseconds around `middle` that hold about `wanted` events of each stream, in the mean;
/// `None` if no stream has a millisecond.
fn busy_window(streams: &[PreviewStream<'_>], middle: usize, wanted: u64) -> Option<Range<usize>> {
    // The last entry of an index is the end of the last millisecond.
    let last = streams.iter().filter_map(|stream| stream.index.len().checked_sub(2)).max()?;
    let wanted = wanted.saturating_mul(streams.len() as u64);
    let held = |range: &Range<usize>| streams.iter().map(|stream| stream.count(range)).sum::<u64>();
    let mut range = middle.min(last)..middle.min(last) + 1;
    // A window of the whole recording cannot grow, so the last condition ends the loop for short recordings.
    while held(&range) < wanted && range.len() < MAX_WINDOW_MS && range != (0..last + 1) {
        range = range.start.saturating_sub(1)..(range.end + 1).min(last + 1);
    }
    Some(range)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(index: &[u64]) -> PreviewStream<'static> {
        PreviewStream { name: None, file: PathBuf::new(), index: index.to_vec() }
    }

    #[test]
    fn a_window_grows_until_it_holds_enough() {
        // 10 events a millisecond, 100 ms and the entry past the last.
        let steady: Vec<u64> = (0..=100).map(|k| 10 * k).collect();
        let busy = |index: &[u64], middle, wanted| busy_window(&[stream(index)], middle, wanted);
        assert_eq!(busy(&steady, 50, 5), Some(50..51));
        assert_eq!(busy(&steady, 50, 45), Some(48..53));
        assert_eq!(busy(&steady, 0, 25), Some(0..3));
        assert_eq!(busy(&steady, 200, 15), Some(98..100));
        assert_eq!(busy(&steady, 50, u64::MAX), Some(30..71));
        assert_eq!(busy(&[0, 0], 3, 7), Some(0..1));
        assert_eq!((busy(&[0], 3, 7), busy(&[], 3, 7)), (None, None));
    }

    #[test]
    fn streams_share_a_window() {
        // 10 and 2 events a millisecond, in the mean 6; the second stream ends early.
        let fast = stream(&(0..=100).map(|k| 10 * k).collect::<Vec<_>>());
        let slow = stream(&(0..=51).map(|k| 2 * k).collect::<Vec<_>>());
        assert_eq!(busy_window(&[fast, slow], 20, 25), Some(18..23));
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
}
