//! Pictures that checks made, each with the verdict on its own sensor. A check has a row of its own
//! unless all pictures fit into one row.

use super::ReportPage;
use super::detail::DetailLevel;
use super::findings::{is_fault, verdict_rank, worst_verdict, write_badge};
use super::previews::tree_picture;
use super::section::{ReportTrajectory, write_image};
use gs2e_check::{Finding, Verdict};
use gs2e_files::html::HtmlFragment;

/// Number of pictures that fit next to each other on a wide screen.
const COLUMNS: usize = 4;

/// The picture of a check in the trajectory's folder: `checks/<check>.png` or
/// `checks/<sensor>.<check>.png`.
#[derive(Debug)]
struct CheckPicture<'a> {
    check: &'a str,
    sensor: Option<&'a str>,
    path: &'a str,
}

impl<'a> CheckPicture<'a> {
    fn from_path(path: &'a str) -> Option<Self> {
        let stem = path.rsplit('/').next()?.strip_suffix(".png")?;
        // Names of sensors can have dots, and names of checks have none.
        let (sensor, check) = match stem.rsplit_once('.') {
            Some((sensor, check)) => (Some(sensor), check),
            None => (None, stem),
        };
        Some(Self { check, sensor, path })
    }

    /// Returns true if a finding is of this check, on this sensor where the picture is of one of
    /// several.
    fn concerns(&self, finding: &Finding) -> bool {
        finding.check == self.check && self.sensor.is_none_or(|sensor| finding.subject.is_of_sensor(sensor))
    }

    /// The worst verdict on what the picture shows.
    fn verdict(&self, track: &ReportTrajectory<'_>) -> Option<Verdict> {
        worst_verdict(track.published.findings.iter().filter(|finding| self.concerns(finding)))
    }
}

/// The pictures of checks that the page shows. The worst are chosen first if there are too many.
fn listed_pictures<'a>(track: &ReportTrajectory<'a>, detail: DetailLevel) -> Vec<CheckPicture<'a>> {
    let paths = track.entry.below(&format!("{}/checks/", track.part.name));
    let mut pictures: Vec<CheckPicture<'_>> = paths.filter_map(CheckPicture::from_path).collect();
    pictures.retain(|picture| detail.passes || picture.verdict(track).is_some_and(is_fault));
    pictures.sort_by_key(|picture| picture.verdict(track).map_or(usize::MAX, verdict_rank));
    pictures.truncate(detail.check_pictures);
    // Back in the order of names: the rows are cut where the check changes, so its pictures must be
    // neighbours.
    pictures.sort_by_key(|picture| (picture.check, picture.sensor));
    pictures
}

/// Writes the pictures of a trajectory.
pub(super) fn write_check_pictures(
    html: &mut HtmlFragment,
    page: &ReportPage<'_>,
    track: ReportTrajectory<'_>,
) {
    let pictures = listed_pictures(&track, page.detail);
    let fit_one_row = pictures.len() <= COLUMNS;
    for row in pictures.chunk_by(|a, b| fit_one_row || a.check == b.check) {
        html.within("div", &[("class", "row")], |html| {
            row.iter().for_each(|picture| write_picture(html, page, track, picture));
        });
    }
}

fn write_picture(
    html: &mut HtmlFragment,
    page: &ReportPage<'_>,
    track: ReportTrajectory<'_>,
    of: &CheckPicture<'_>,
) {
    let Some(picture) = tree_picture(of.path, page.places, page.detail.picture) else { return };
    let (panels, meaning) = legend(of.check);
    let name = of.sensor.map_or_else(|| of.check.to_owned(), |sensor| format!("{}, {sensor}", of.check));
    html.within("figure", &[], |html| {
        if !panels.is_empty() {
            html.within("div", &[("class", "panels")], |html| {
                panels.iter().for_each(|panel| html.leaf("span", &[], panel));
            });
        }
        write_image(html, &picture, "", &format!("check {name}"));
        html.within("figcaption", &[], |html| {
            html.text(&format!("check {name} "));
            if let Some(verdict) = of.verdict(&track) {
                write_badge(html, verdict, verdict.name());
            }
            html.text(meaning);
        });
    });
}

/// The names of the panels in a check's picture, from the left, and what its colours mean.
fn legend(check: &str) -> (&'static [&'static str], &'static str) {
    match check {
        "event_frame" => (
            &["red (brighter), blue (darker): within the limit", "yellow: beyond it"],
            "Change of brightness that the events of a pixel do not explain, at the last frame. A sound picture is \
             red and blue: a pixel waits for its next event with less than the threshold of one event, or than what \
             the spread of thresholds adds to it. Yellow is a fault, or an event of the sensor's noise floor.",
        ),
        "motion" => (
            &["in place", "moved along the flow"],
            "Number of events per pixel in one short window. Moved along the optical flow, they should be sharper.",
        ),
        _ => (&[], ""),
    }
}

#[cfg(test)]
mod tests {
    use super::super::findings::tests::finding;
    use super::*;

    #[test]
    fn pictures_of_checks_say_whose_they_are() {
        for (name, wanted) in [
            ("s/t/checks/motion.png", Some((None, "motion"))),
            ("s/t/checks/fine.event_frame.png", Some((Some("fine"), "event_frame"))),
            ("s/t/checks/a.b.motion.png", Some((Some("a.b"), "motion"))),
            ("s/t/checks/verdicts.json", None),
        ] {
            assert_eq!(CheckPicture::from_path(name).map(|of| (of.sensor, of.check)), wanted);
        }
    }

    #[test]
    fn a_picture_has_the_verdict_of_its_own_sensor() {
        let fine = CheckPicture::from_path("s/t/checks/fine.motion.png").unwrap();
        for (subject, wanted) in
            [("s/t/fine", true), ("s/t/fine#median", true), ("s/t/coarse", false), ("s/t/superfine", false)]
        {
            assert_eq!(fine.concerns(&finding("motion", subject, Verdict::Fail)), wanted, "{subject}");
        }
        assert!(!fine.concerns(&finding("speed", "s/t/fine", Verdict::Fail)));
    }
}
