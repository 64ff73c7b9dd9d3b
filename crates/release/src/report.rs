//! `report.html`: the release for people, in one file that opens from disk.
//!
//! The page needs no network, no script and no other file. Pictures and style sheet are inside, and
//! the page's own policy forbids the browser anything else. Links lead to files of the tree alone.
//! Every string of a recipe is text in it, by `report/html.rs`. It does not state the time of the
//! build, so equal releases have equal pages.

mod check_pictures;
mod curve;
pub(super) mod dataset;
mod detail;
mod embed;
mod findings;
mod gallery;
mod inertia;
mod maps;
mod overview;
mod path_views;
mod previews;
mod section;
mod segmentation;
mod trajectory;

pub(super) use inertia::inertial_picture;
pub(super) use maps::{depth_picture, disparity_picture, flow_picture};
pub(super) use previews::{PictureRequest, Preview, blurred_picture, sharp_picture};
pub(super) use segmentation::segmentation_picture;

use super::facts::ReleaseFacts;
use super::held_back::HeldBackScene;
use super::published::StoredPlaces;
use detail::DetailLevel;
use gs2e_check::Finding;
use gs2e_files::html::{HtmlFragment, write_page_head};
use gs2e_recipe::ReleaseInfo;
use gs2e_source::licence::ComposedTerms;
use rayon::prelude::*;
use section::{SceneEntry, SceneSection};

/// Name of the file.
pub(super) const NAME: &str = "report.html";

/// The page while it is written.
struct ReportPage<'a> {
    info: &'a ReleaseInfo,
    licence: &'a ComposedTerms,
    entries: Vec<SceneEntry<'a>>,
    taken_down: usize,
    held_back: &'a [HeldBackScene],
    top: Vec<String>,
    places: StoredPlaces<'a>,
    detail: DetailLevel,
}

impl<'a> ReportPage<'a> {
    fn findings(&self) -> impl Iterator<Item = &'a Finding> {
        self.entries.iter().flat_map(|entry| entry.scene.all_findings())
    }

    fn trajectories(&self) -> usize {
        self.entries.iter().map(|entry| entry.scene.file.trajectories.len()).sum()
    }

    /// Returns true if there are few enough scenes to show them unfolded.
    fn is_short(&self) -> bool {
        self.entries.len() <= UNFOLDED
    }
}

/// Maximum number of scenes that are shown unfolded.
const UNFOLDED: usize = 6;

/// Composes the page; `top` are the files at the top of the tree. Scenes are read in parallel, and
/// only what the page shows of them stays in memory.
pub(super) fn compose_page(facts: &ReleaseFacts<'_>, top: Vec<String>, places: StoredPlaces<'_>) -> String {
    let entries: Vec<SceneEntry<'_>> = facts.scenes.iter().map(|scene| SceneEntry { scene }).collect();
    let detail = DetailLevel::for_trajectories(facts.counts().trajectories);
    let ReleaseFacts { info, licence, taken_down, held_back, .. } = *facts;
    let page = ReportPage { info, licence, entries, taken_down, held_back, top, places, detail };
    let parts: Vec<SceneSection> =
        page.entries.par_iter().map(|entry| section::compose_section(&page, entry)).collect();
    HtmlFragment::whole_page(|html| {
        html.within("head", &[], |html| write_page_head(html, &format!("{} {}", info.name, info.version)));
        html.within("body", &[], |html| {
            overview::write_head(html, &page);
            html.within("main", &[], |html| {
                // Pictures come first. On a long page they are in the table of scenes.
                if page.is_short() {
                    write_each(html, &parts);
                }
                overview::write_scenes(html, &page, &parts);
                overview::write_checks(html, &page);
                overview::not_run(html, &page);
                if !page.is_short() {
                    write_each(html, &parts);
                }
                overview::write_absences(html, &page);
                overview::write_files(html, &page);
                overview::write_skipped(html, &page);
            });
        });
    })
}

/// Writes the sections of all scenes.
fn write_each(html: &mut HtmlFragment, parts: &[SceneSection]) {
    html.within("section", &[("id", "each")], |html| {
        html.leaf("h2", &[], "Pictures of each scene");
        parts.iter().for_each(|part| html.append(&part.section));
    });
}
