//! `report.html`: the release for people, in one file that opens from disk.
//!
//! It needs no network, no script and no other file: pictures are inside, the style sheet too, and the page's own policy
//! forbids the browser anything else. Links lead to files of the tree alone. Every string that a recipe brings is text in
//! it, by `report/html.rs`. It tells no time of the build, and equal releases have equal pages.

mod curve;
mod depth;
mod embed;
mod findings;
mod html;
mod overview;
mod section;
mod seen;
mod trajectory;

use super::built::BuiltScene;
use super::manifest::ManifestScene;
use super::scene::SceneFile;
use crate::check::Finding;
use crate::licence::Composed;
use crate::recipe::ReleaseInfo;
use crate::store::Store;
use depth::Depth;
use html::Html;
use rayon::prelude::*;
use section::{Entry, Part};
use sha2::{Digest as _, Sha256};

/// Name of the file.
pub(super) const NAME: &str = "report.html";

/// The style sheet.
const STYLE: &str = include_str!("report/style.css");

/// What the page is about.
#[derive(Debug)]
pub(super) struct Told<'a> {
    pub(super) info: &'a ReleaseInfo,
    pub(super) licence: &'a Composed,
    pub(super) scenes: &'a [BuiltScene<'a>],
    pub(super) described: &'a [SceneFile],
    /// The scenes with their files.
    pub(super) listed: &'a [ManifestScene],
    /// How many scenes are left out, as they are taken down.
    pub(super) taken_down: usize,
    /// Files at the top of the tree.
    pub(super) top: Vec<String>,
}

/// The page while it is written.
#[derive(Debug)]
struct Page<'a> {
    info: &'a ReleaseInfo,
    licence: &'a Composed,
    entries: Vec<Entry<'a>>,
    taken_down: usize,
    top: Vec<String>,
    store: &'a Store,
    depth: Depth,
}

impl<'a> Page<'a> {
    fn findings(&self) -> impl Iterator<Item = &'a Finding> {
        self.entries.iter().flat_map(|entry| entry.built.findings())
    }

    fn trajectories(&self) -> usize {
        self.entries.iter().map(|entry| entry.file.trajectories.len()).sum()
    }

    /// Whether there are so few scenes that they are shown unfolded.
    fn is_short(&self) -> bool {
        self.entries.len() <= UNFOLDED
    }
}

/// Most scenes that are shown unfolded.
const UNFOLDED: usize = 2;

/// Composes the page. Scenes are read side by side; beyond the page itself only what one of them shows is in memory.
pub(super) fn compose(told: Told<'_>, store: &Store) -> String {
    let scenes = told.scenes.iter().zip(told.described).zip(told.listed);
    let entries: Vec<Entry<'_>> =
        scenes.map(|((built, file), listed)| Entry { built, file, files: &listed.files }).collect();
    let depth = Depth::of(entries.iter().map(|entry| entry.file.trajectories.len()).sum());
    let Told { info, licence, taken_down, top, .. } = told;
    let page = Page { info, licence, entries, taken_down, top, store, depth };
    let parts: Vec<Part> = page.entries.par_iter().map(|entry| section::compose(&page, entry)).collect();
    Html::page(|html| {
        html.within("head", &[], |html| head(html, page.info));
        html.within("body", &[], |html| {
            overview::head(html, &page);
            html.within("main", &[], |html| {
                overview::scenes(html, &page, &parts);
                overview::checks(html, &page);
                overview::not_run(html, &page);
                overview::left_out(html, &page);
                html.within("section", &[("id", "each")], |html| {
                    html.leaf("h2", &[], "Each scene");
                    parts.iter().for_each(|part| html.append(&part.section));
                });
                overview::files(html, &page);
            });
        });
    })
}

fn head(html: &mut Html, info: &ReleaseInfo) {
    html.empty("meta", &[("charset", "utf-8")]);
    html.empty("meta", &[("http-equiv", "Content-Security-Policy"), ("content", &policy())]);
    html.empty("meta", &[("name", "viewport"), ("content", "width=device-width, initial-scale=1")]);
    html.empty("meta", &[("name", "color-scheme"), ("content", "light dark")]);
    html.empty("meta", &[("name", "referrer"), ("content", "no-referrer")]);
    html.leaf("title", &[], &format!("{} {}", info.name, info.version));
    html.style(STYLE);
}

/// What a browser may do for the page: show its pictures, and follow its one style sheet.
fn policy() -> String {
    let style = embed::base64(&Sha256::digest(STYLE.as_bytes()));
    format!(
        "default-src 'none'; style-src 'sha256-{style}'; img-src data:; base-uri 'none'; form-action 'none'"
    )
}
