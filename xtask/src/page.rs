//! Time that a browser takes to open `report.html` of thousands of scenes.
//!
//! A release of some scenes is made, enough of them for the page to be as brief as that of
//! thousands. Then its rows and sections are repeated under other ids up to the requested number.
//! The result equals a real page of this many scenes byte for byte except for its sums, and costs
//! minutes less.

use crate::command::{Outcome, cargo, program, say};
use crate::folder::Folder;
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Number of scenes in the release: with three trajectories each, more than a page shows in full.
const MADE: usize = 201;

const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

struct Options {
    scenes: usize,
    runs: usize,
    /// An existing page, in place of a new one.
    page: Option<PathBuf>,
    /// The place where the long page is kept.
    keep: Option<PathBuf>,
}

/// Makes the page and opens it.
pub(crate) fn run(args: &[String]) -> Outcome {
    let options = options(args)?;
    let folder = Folder::new("page")?;
    let page = match &options.page {
        Some(page) => page.clone(),
        None => made(folder.path())?,
    };
    let page = std::fs::read_to_string(&page).map_err(|e| format!("{}: {e}", page.display()))?;
    let page = repeated(&page, options.scenes)?;
    let long = options.keep.clone().unwrap_or_else(|| folder.path().join("long.html"));
    write(&long, &page)?;
    let elements = page.matches('<').count() - page.matches("</").count();
    say(&format!(
        "{} scenes: {:.1} MB, {elements} elements; {:.1} kB and {} elements a scene",
        options.scenes,
        page.len() as f64 * 1e-6,
        page.len() as f64 * 1e-3 / options.scenes as f64,
        elements / options.scenes
    ));
    opened(&long, folder.path(), options.runs)
}

fn options(args: &[String]) -> Outcome<Options> {
    let mut options = Options { scenes: 2000, runs: 5, page: None, keep: None };
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or(format!("{arg} wants a value"));
        let count = |text: &String| {
            text.parse().ok().filter(|n| *n > 0).ok_or(format!("found {text}, wanted a count above 0"))
        };
        match arg.as_str() {
            "--scenes" => options.scenes = count(value()?)?,
            "--runs" => options.runs = count(value()?)?,
            "--page" => options.page = Some(value()?.into()),
            "--keep" => options.keep = Some(value()?.into()),
            _ => {
                return Err(format!(
                    "found `{arg}`, wanted --scenes N, --runs N, --page FILE or --keep FILE"
                ));
            }
        }
    }
    Ok(options)
}

fn write(path: &Path, text: &str) -> Outcome {
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

/// The page of a release of [`MADE`] scenes.
fn made(folder: &Path) -> Outcome<PathBuf> {
    let (recipes, tree) = (folder.join("recipes"), folder.join("tree"));
    std::fs::create_dir_all(&recipes).map_err(|e| format!("{}: {e}", recipes.display()))?;
    for number in 0..MADE {
        write(&recipes.join(format!("{number}.yaml")), &recipe(number))?;
    }
    let start = Instant::now();
    let args = ["run", "--release", "--quiet", "--bin", "gs2e", "--", "release", "-q", "--backend", "cpu"];
    let to = [Path::new("--store"), &folder.join("store"), Path::new("--to"), &tree, &recipes];
    cargo(&args).args(to).run()?;
    say(&format!("a release of {MADE} scenes: {:.0} s", start.elapsed().as_secs_f64()));
    Ok(tree.join("report.html"))
}

/// A recipe with three trajectories as wide as a picture of the page. The page has the same bytes
/// as one of larger scenes.
fn recipe(number: usize) -> String {
    format!(
        "version: 1\nscene: set/{number:06}\nseed: 7\nsource: {{ procedural: {{ gaussians: 2000, views: 9, arc: 8 }} }}\n\
         camera: {{ width: 160, height: 90 }}\ntrajectories:\n  - {{ name: base, refine: {{ factor: 3 }} }}\n\
         \x20 - {{ name: slow, refine: {{ factor: 4 }}, speed: {{ function: \"1 + t\" }} }}\n\
         \x20 - {{ name: fast, refine: {{ factor: 2 }}, speed: {{ function: \"2 - t\" }} }}\n\
         outputs: [events, sharp]\nsharp: {{ every: 9 }}\nlicence: {{ expression: CC0-1.0, holder: A benchmark }}\n"
    )
}

/// Begin and end of a scene's row, and the end of all rows; [`SECTIONS`] has the same for sections.
const ROWS: [&str; 3] = ["<tr class=\"has-", "</tr>\n", "</tbody>"];
const SECTIONS: [&str; 3] = ["<details class=\"scene\"", "</details>\n", "</section>"];

/// The page with its scenes repeated in turn, each under an id of its own.
fn repeated(page: &str, scenes: usize) -> Outcome<String> {
    let page = multiplied(page, ROWS, scenes)?;
    multiplied(&page, SECTIONS, scenes)
}

fn multiplied(page: &str, [begin, end, after]: [&str; 3], scenes: usize) -> Outcome<String> {
    let broken = || "the page has no scenes where they were".to_owned();
    let start = page.find(begin).ok_or_else(broken)?;
    let stop = start + page[start..].find(after).ok_or_else(broken)?;
    let own: Vec<&str> =
        page[start..stop].split_inclusive(end).filter(|part| part.starts_with(begin)).collect();
    let mut out = page[..start].to_owned();
    for number in 0..scenes {
        let part = own.get(number % own.len().max(1)).ok_or_else(broken)?;
        let id = id(part).ok_or_else(broken)?;
        out += &part.replace(id, &format!("{id}-{number:05}"));
    }
    Ok(out + &page[stop..])
}

/// The id of the scene that a row links to or a section describes.
fn id(part: &str) -> Option<&str> {
    let after = part.split("scene/").nth(1)?;
    after.split('"').next()
}

/// Opens the page `runs` times, each time followed by an empty page.
fn opened(page: &Path, folder: &Path, runs: usize) -> Outcome {
    let there = |name: &&&str| program(OsStr::new(**name), &["--version"]).succeeds();
    let Some(browser) = BROWSERS.iter().find(there) else {
        say("not timed: there is no Chromium");
        return Ok(());
    };
    let empty = folder.join("empty.html");
    write(&empty, "<!DOCTYPE html><title>empty</title>\n")?;
    let mut times = [const { Vec::new() }; 3];
    for run in 0..=runs {
        let took =
            [loaded(browser, folder, page)?, shot(browser, folder, page)?, shot(browser, folder, &empty)?];
        // The first run is to warm up.
        if run > 0 {
            times.iter_mut().zip(took).for_each(|(times, took)| times.push(took));
        }
    }
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let [loaded, whole, nothing] = times.each_mut().map(median);
    say(&format!(
        "{browser}, median of {runs}: {loaded:.2} s until its load event; started, shown and ended in {whole:.2} s, an empty \
         page in {nothing:.2} s: {:.2} s for loading and the first picture",
        whole - nothing
    ));
    Ok(())
}

/// Arguments that keep a browser from loading anything but the page.
fn quiet(folder: &Path) -> Vec<String> {
    let mut args: Vec<String> = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--window-size=1400,900",
    ]
    .map(str::to_owned)
    .to_vec();
    args.push(format!("--user-data-dir={}", folder.join("profile").display()));
    args
}

/// Seconds until the load event by the browser's own clock, measured in a frame of a page that
/// waits for it.
fn loaded(browser: &str, folder: &Path, page: &Path) -> Outcome<f64> {
    let frame = folder.join("frame.html");
    let mut text = String::from("<!DOCTYPE html><title>frame</title><p id=\"took\"></p><script>\n");
    let _ = write!(
        text,
        "const begin = performance.now(), frame = document.createElement('iframe');\n\
         frame.width = 1400; frame.height = 900; frame.src = 'file://{}';\n\
         frame.onload = () => {{ took.textContent = 'took ' + (performance.now() - begin) + ' ms'; }};\n\
         document.body.append(frame);\n</script>\n",
        page.display()
    );
    write(&frame, &text)?;
    let output = program(OsStr::new(browser), &quiet(folder))
        .args(["--timeout=60000".to_owned(), "--dump-dom".to_owned(), format!("file://{}", frame.display())])
        .capture()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let took = text.split(">took ").nth(1).and_then(|rest| rest.split(" ms").next()?.parse::<f64>().ok());
    took.map(|ms| ms * 1e-3).ok_or("the page did not load within a minute".to_owned())
}

/// Seconds from the browser's start to its end, with a picture of the page between.
fn shot(browser: &str, folder: &Path, page: &Path) -> Outcome<f64> {
    let picture = format!("--screenshot={}", folder.join("shot.png").display());
    let start = Instant::now();
    program(OsStr::new(browser), &quiet(folder))
        .args([picture, format!("file://{}", page.display())])
        .capture()?;
    Ok(start.elapsed().as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::repeated;

    #[test]
    fn scenes_are_repeated_under_their_own_ids() {
        let page = "<tbody><tr class=\"has-pass\"><a href=\"#scene/a/b\">a/b</a></tr>\n</tbody>\
                    <section><h2>Each</h2><details class=\"scene\"><i id=\"scene/a/b\">a/b</i></details>\n</section>end";
        let found = repeated(page, 2).unwrap();
        let row = |id: &str| format!("<tr class=\"has-pass\"><a href=\"#scene/{id}\">{id}</a></tr>\n");
        let section =
            |id: &str| format!("<details class=\"scene\"><i id=\"scene/{id}\">{id}</i></details>\n");
        let ids = ["a/b-00000", "a/b-00001"];
        let [rows, sections] = [ids.map(row).concat(), ids.map(section).concat()];
        assert_eq!(found, format!("<tbody>{rows}</tbody><section><h2>Each</h2>{sections}</section>end"));
        assert!(repeated("<p>no scenes</p>", 2).is_err());
    }
}
