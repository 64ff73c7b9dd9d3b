//! The part of one scene: its row in the table of scenes, and its section.

use super::embed::EmbeddedPicture;
use super::findings::{self, VerdictCount, WORST_FIRST};
use super::previews::{PictureRequest, sharp_picture, tree_picture};
use super::{ReportPage, trajectory};
use crate::products::ReleaseProduct;
use crate::published::{PublishedScene, PublishedTrajectory};
use crate::scene::{SceneRecord, SensorPart, TrajectoryPart, TrajectoryStatistics};
use crate::{layout, products};
use gs2e_check::{Finding, Verdict};
use gs2e_files::html::{HtmlFragment, link_address};
use gs2e_train::{TrainingEnd, TrainingRecord};
use gs2e_trajectory::picture::short_number;

/// A scene of the page.
#[derive(Debug, Clone, Copy)]
pub(super) struct SceneEntry<'a> {
    pub(super) scene: &'a PublishedScene,
}

/// A trajectory of the page.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ReportTrajectory<'a> {
    pub(super) entry: SceneEntry<'a>,
    pub(super) part: &'a TrajectoryPart,
    pub(super) published: &'a PublishedTrajectory,
}

impl<'a> ReportTrajectory<'a> {
    /// The path of a file in its folder.
    pub(super) fn path_of(&self, name: &str) -> String {
        format!("{}/{}/{name}", self.entry.id(), self.part.name)
    }

    /// Its pictures of a product: the number of the pose, and the path.
    pub(super) fn numbered(
        &self,
        product: &ReleaseProduct,
    ) -> impl Iterator<Item = (usize, &'a str)> + use<'a> {
        let (folder, end) = (product.name(), product.form.extensions()[0]);
        let number = move |path: &str| path.rsplit('/').next()?.strip_suffix(end)?.parse().ok();
        let paths = self.entry.below(&format!("{}/{folder}/", self.part.name));
        paths.filter_map(move |path| Some((number(path)?, path)))
    }
}

/// The contribution of one scene to the page.
#[derive(Debug)]
pub(super) struct SceneSection {
    pub(super) row: HtmlFragment,
    pub(super) section: HtmlFragment,
}

impl<'a> SceneEntry<'a> {
    pub(super) fn id(&self) -> &'a str {
        &self.scene.file.id
    }

    /// Returns true if nothing that shows the scene may be passed on.
    pub(super) fn is_withheld(&self) -> bool {
        self.scene.is_withheld()
    }

    /// Returns its trajectories.
    pub(super) fn tracks(self) -> impl Iterator<Item = ReportTrajectory<'a>> {
        self.scene.paths().map(move |(part, published)| ReportTrajectory { entry: self, part, published })
    }

    pub(super) fn count(&self) -> VerdictCount {
        VerdictCount::from_findings(self.scene.all_findings())
    }

    /// Paths of its files that start with `folder` below the scene's folder.
    pub(super) fn below(&self, folder: &str) -> impl Iterator<Item = &'a str> + use<'a> {
        let prefix = format!("{}/{folder}", self.id());
        self.scene.files.iter().map(|file| file.path.as_str()).filter(move |path| path.starts_with(&prefix))
    }

    /// The statistics of its streams.
    pub(super) fn counted(&self) -> impl Iterator<Item = &'a TrajectoryStatistics> + use<'a> {
        self.scene.file.trajectories.iter().flat_map(stream_statistics)
    }
}

/// The statistics of a trajectory's streams.
fn stream_statistics(part: &TrajectoryPart) -> impl Iterator<Item = &TrajectoryStatistics> {
    let named = part.sensors.values().map(|SensorPart { statistics, .. }| statistics);
    // With several sensors the trajectory's own statistics have no events.
    std::iter::once(&part.statistics).chain(named).filter(|counted| counted.events.is_some())
}

/// The id of a scene's section in the page.
fn section_id(id: &str) -> String {
    format!("scene/{id}")
}

/// A link to a scene's section.
pub(super) fn section_link(html: &mut HtmlFragment, id: &str, words: &str) {
    html.leaf("a", &[("href", &format!("#{}", link_address(&section_id(id))))], words);
}

/// A link to a file of the tree.
pub(super) fn file_link(html: &mut HtmlFragment, path: &str, words: &str) {
    html.leaf("a", &[("href", &link_address(path))], words);
}

/// An embedded picture.
pub(super) fn write_image(html: &mut HtmlFragment, picture: &EmbeddedPicture, class: &str, alt: &str) {
    let [width, height] = [picture.width, picture.height].map(|side| side.to_string());
    html.empty(
        "img",
        &[
            ("class", class),
            ("src", &picture.address),
            ("width", &width),
            ("height", &height),
            ("alt", alt),
            ("decoding", "async"),
        ],
    );
}

/// A number with a comma between thousands.
pub(super) fn thousands_number(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// A count with its noun, which is `one` or `more`.
pub(super) fn counted_noun(n: usize, one: &str, more: &str) -> String {
    format!("{} {}", thousands_number(n as u64), if n == 1 { one } else { more })
}

/// The lowest and the highest value; one number if they look the same.
pub(super) fn number_span(values: impl Iterator<Item = f64>) -> String {
    let bounds = values.fold(None, |bounds: Option<[f64; 2]>, v| {
        Some(bounds.map_or([v, v], |[low, high]| [low.min(v), high.max(v)]))
    });
    let Some(bounds) = bounds else { return "\u{2013}".to_owned() };
    let [low, high] = bounds.map(short_number);
    if low == high { low } else { format!("{low}\u{2013}{high}") }
}

/// The share of ON events.
pub(super) fn on_share(counted: &TrajectoryStatistics) -> Option<f64> {
    let (events, on) = (counted.events?, counted.on?);
    (events > 0).then(|| on as f64 / events as f64)
}

/// Composes the scene's part.
pub(super) fn compose_section(page: &ReportPage<'_>, entry: &SceneEntry<'_>) -> SceneSection {
    let (mut row, mut section) = (HtmlFragment::default(), HtmlFragment::default());
    table_row(&mut row, page, entry);
    write_details(&mut section, page, entry);
    SceneSection { row, section }
}

fn table_row(html: &mut HtmlFragment, page: &ReportPage<'_>, entry: &SceneEntry<'_>) {
    let count = entry.count();
    let kinds =
        WORST_FIRST.into_iter().filter(|verdict| count.get(*verdict) > 0).map(findings::verdict_class);
    let withheld = entry.is_withheld().then_some("withheld");
    let class = kinds.chain(withheld).map(|kind| format!("has-{kind}")).collect::<Vec<_>>().join(" ");
    let file = &entry.scene.file;
    html.within("tr", &[("class", &class)], |html| {
        html.within("td", &[], |html| write_thumbnail(html, page, entry));
        html.within("th", &[("scope", "row")], |html| section_link(html, entry.id(), entry.id()));
        html.leaf("td", &[], &file.source.kind);
        html.within("td", &[], |html| {
            html.text(&file.licence.expression);
            write_marks(html, entry);
        });
        let number = |html: &mut HtmlFragment, words: &str| html.leaf("td", &[("class", "n")], words);
        let poses: u64 = file.trajectories.iter().map(|t| t.poses as u64).sum();
        let sharp = entry.below("").filter(|path| products::SHARP.owns(path)).count();
        number(html, &file.trajectories.len().to_string());
        number(html, &thousands_number(poses));
        number(html, &thousands_number(sharp as u64));
        let events: Option<u64> =
            entry.counted().filter_map(|counted| counted.events).reduce(|sum, events| sum + events);
        number(html, &events.map_or_else(|| "\u{2013}".to_owned(), thousands_number));
        number(html, &number_span(entry.counted().filter_map(|counted| counted.rate_ev_px_s)));
        number(html, &number_span(entry.counted().filter_map(on_share)));
        html.within("td", &[("class", "verdicts")], |html| {
            // A bar has several elements, which are too many in thousands of rows.
            if page.detail.full {
                count.bar(html);
            }
            html.text(&count.words());
        });
    });
}

fn write_thumbnail(html: &mut HtmlFragment, page: &ReportPage<'_>, entry: &SceneEntry<'_>) {
    if entry.is_withheld() {
        return html.leaf("span", &[("class", "none")], "withheld");
    }
    let (product, places, width) = (&products::SHARP, page.places, page.detail.thumbnail);
    let sharp = |track| sharp_picture(PictureRequest { product, track, places, width });
    match entry.tracks().find_map(sharp) {
        Some(preview) => {
            write_image(html, &preview.picture, "thumb", &format!("{}: {}", entry.id(), preview.words))
        }
        None => html.leaf("span", &[("class", "none")], "no frame"),
    }
}

/// Writes marks for terms that bind a receiver and that the licence's name does not show.
fn write_marks(html: &mut HtmlFragment, entry: &SceneEntry<'_>) {
    if entry.scene.file.licence.gated {
        html.leaf("span", &[("class", "mark")], "gated");
    }
    if entry.is_withheld() {
        html.leaf("span", &[("class", "mark")], "pictures and events withheld");
    }
}

fn write_details(html: &mut HtmlFragment, page: &ReportPage<'_>, entry: &SceneEntry<'_>) {
    let open = [("class", "scene"), ("open", "")];
    html.within("details", if page.is_short() { &open } else { &open[..1] }, |html| {
        html.within("summary", &[], |html| {
            html.leaf("h3", &[], entry.id());
            html.text(" ");
            entry.count().badges(html);
            write_marks(html, entry);
        });
        html.within("div", &[("class", "inside"), ("id", &section_id(entry.id()))], |html| {
            entry.tracks().for_each(|track| trajectory::write_trajectory(html, page, track));
            html.within("section", &[("class", "about")], |html| {
                html.leaf("h4", &[], "About the scene");
                write_facts(html, page, entry);
                write_training(html, page, entry);
                write_held_out(html, page, entry);
                scene_findings(html, page, entry);
                write_files(html, entry);
            });
        });
    });
}

/// Writes the files of the scene itself.
fn write_files(html: &mut HtmlFragment, entry: &SceneEntry<'_>) {
    let own = entry.below("").filter_map(|path| path.strip_prefix(entry.id())?.strip_prefix('/'));
    // Names with a folder are those of trajectories.
    let own: Vec<&str> = own.filter(|name| !name.contains('/')).collect();
    html.within("p", &[("class", "files")], |html| {
        html.text("Files: ");
        for (number, name) in own.iter().enumerate() {
            html.text(if number > 0 { ", " } else { "" });
            file_link(html, &format!("{}/{name}", entry.id()), name);
        }
    });
}

fn write_facts(html: &mut HtmlFragment, page: &ReportPage<'_>, entry: &SceneEntry<'_>) {
    let file = &entry.scene.file;
    let camera = &file.camera;
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(short_number);
    let mut facts = vec![
        ("Source", source_words(file)),
        (
            "Camera",
            format!(
                "{} x {} px, focal length {fx}, {fy} px, principal point {cx}, {cy} px{}",
                camera.width,
                camera.height,
                camera.lens.map_or_else(String::new, |lens| format!(", lens {lens}"))
            ),
        ),
        ("Seed", file.seed.to_string()),
        ("Reconstruction", reconstruction_words(file)),
        ("Licence", licence_words(file)),
    ];
    let photos = file.images.len();
    if photos > 0 {
        let unused = file.images.iter().filter(|image| !image.used).count();
        facts.push((
            "Photos",
            format!("{photos}, {unused} of them unused; none is in the release at its own size"),
        ));
    }
    // A list would take two elements for each fact.
    if !page.detail.full {
        let sentences =
            facts.into_iter().map(|(name, words)| format!("{name}: {words}.")).collect::<Vec<_>>();
        return html.leaf("p", &[], &sentences.join(" "));
    }
    html.within("dl", &[], |html| {
        for (name, words) in facts {
            html.leaf("dt", &[], name);
            html.leaf("dd", &[], &words);
        }
    });
}

fn source_words(file: &SceneRecord) -> String {
    let source = &file.source;
    let upstream = [&source.upstream_id, &source.upstream_url].into_iter().flatten().map(String::as_str);
    std::iter::once(source.kind.as_str()).chain(upstream).collect::<Vec<_>>().join(", ")
}

fn reconstruction_words(file: &SceneRecord) -> String {
    let Some(of) = &file.reconstruction else { return "none: nothing is rendered".to_owned() };
    let mut words = format!(
        "{}, {} Gaussians, harmonics of degree {}",
        of.kind,
        thousands_number(of.gaussians),
        of.sh_degree
    );
    if let Some(psnr) = &of.psnr {
        words +=
            &format!(", mean PSNR {:.2} dB (lowest {:.2}) over {} views", psnr.mean, psnr.min, psnr.views);
        if let Some(held_out) = psnr.held_out {
            words += &format!(", {held_out:.2} dB over held-out views");
        }
    } else {
        words.push_str(", PSNR not measured");
    }
    if let Some(ssim) = of.ssim {
        words += &format!(", SSIM {ssim:.4}");
    }
    words
}

/// Writes the figures of the photos that the training held out.
fn write_training(html: &mut HtmlFragment, page: &ReportPage<'_>, entry: &SceneEntry<'_>) {
    let of = entry.scene.file.reconstruction.as_ref();
    let Some(training) = of.and_then(|of| of.training.as_ref()) else { return };
    let words = training_words(training);
    if !page.detail.full || training.held_out.is_empty() {
        return html.leaf("p", &[("class", "caption")], &words);
    }
    html.within("details", &[("class", "fold")], |html| {
        html.leaf("summary", &[], &words);
        html.within("table", &[], |html| {
            html.within("tr", &[], |html| {
                ["held-out photo", "PSNR, dB", "SSIM"].iter().for_each(|name| html.leaf("th", &[], name));
            });
            for view in &training.held_out {
                html.within("tr", &[], |html| {
                    html.leaf("td", &[], &view.name);
                    html.leaf("td", &[("class", "n")], &format!("{:.2}", view.psnr));
                    html.leaf("td", &[("class", "n")], &format!("{:.4}", view.ssim));
                });
            }
        });
    });
}

/// Width of the picture of held-out views, px: that of three pictures in the file.
const HELD_OUT_WIDTH: u32 = 484;

/// Writes the pictures of the views that were held out.
fn write_held_out(html: &mut HtmlFragment, page: &ReportPage<'_>, entry: &SceneEntry<'_>) {
    let path = format!("{}/{}", entry.id(), layout::HELD_OUT);
    let Some(picture) = tree_picture(&path, page.places, HELD_OUT_WIDTH).filter(|_| page.detail.full) else {
        return;
    };
    html.within("figure", &[("class", "wide")], |html| {
        html.within("div", &[("class", "panels")], |html| {
            ["photo", "rendering", "difference x 4"].iter().for_each(|panel| html.leaf("span", &[], panel));
        });
        write_image(html, &picture, "", "held-out views");
        html.leaf(
            "figcaption",
            &[],
            "Views that were held out from training, or every eighth one if the training is unknown.",
        );
    });
}

fn training_words(training: &TrainingRecord) -> String {
    let ended = match training.ended {
        TrainingEnd::Iterations => "",
        TrainingEnd::Psnr => ", ended by its PSNR",
        TrainingEnd::Minutes => ", ended by its minutes",
    };
    let iterations = thousands_number(training.iterations.into());
    let mut words = format!("Training: {} photos, {iterations} iterations{ended}", training.photos);
    if let Some([psnr, ssim]) = training.means() {
        let held_out = counted_noun(training.held_out.len(), "held-out photo", "held-out photos");
        words += &format!("; {held_out}: {psnr:.2} dB, SSIM {ssim:.4}");
    }
    words
}

fn licence_words(file: &SceneRecord) -> String {
    let licence = &file.licence;
    let mut words = licence.expression.clone();
    if !licence.attribution.is_empty() {
        words += &format!(", holder: {}", licence.attribution);
    }
    if licence.gated {
        words.push_str("; receivers must first accept the upstream terms");
    }
    if let Some(because) = &licence.redistribution {
        words += &format!("; redistributed, because: {because}");
    }
    if licence.withheld {
        words.push_str(
            "; the upstream terms forbid redistribution of pictures and events; only recipe, poses and reports are here",
        );
    }
    words
}

/// Writes the findings on the scene itself, from its photos and its capture.
fn scene_findings(html: &mut HtmlFragment, page: &ReportPage<'_>, entry: &SceneEntry<'_>) {
    let Some(findings) = &entry.scene.findings else { return };
    write_findings(html, page, "Checks of the scene", entry.id(), findings);
}

/// Writes findings in the detail of the page.
pub(super) fn write_findings(
    html: &mut HtmlFragment,
    page: &ReportPage<'_>,
    caption: &str,
    prefix: &str,
    findings: &[Finding],
) {
    let count = VerdictCount::from_findings(findings);
    let is_listed = |f: &&Finding| page.detail.passes || f.verdict != Verdict::Pass;
    let listed: Vec<&Finding> = findings.iter().filter(is_listed).collect();
    if page.detail.full && !listed.is_empty() {
        // Folded, so that the next pictures are near. The faults are also in the list of all scenes.
        return html.within("details", &[("class", "fold")], |html| {
            html.within("summary", &[], |html| {
                html.text(&format!("{caption}: "));
                count.badges(html);
            });
            findings::write_table(html, prefix, listed);
        });
    }
    html.leaf("p", &[("class", "caption")], &format!("{caption}: {}", count.words()));
    if !listed.is_empty() {
        findings::write_list(html, prefix, listed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_for_people() {
        for (n, wanted) in [(0, "0"), (999, "999"), (1000, "1,000"), (1_234_567, "1,234,567")] {
            assert_eq!(thousands_number(n), wanted);
        }
        assert_eq!(number_span([2.0, 1.0, 3.5].into_iter()), "1\u{2013}3.5");
        assert_eq!(number_span([0.5, 0.500_001].into_iter()), "0.5");
        assert_eq!(number_span(std::iter::empty()), "\u{2013}");
    }
}
