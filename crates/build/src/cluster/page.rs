//! `status.html`: the state of a build on a cluster, in one page that needs no network and no script.

use super::finished::SceneProgress;
use super::report::TaskStep;
use super::scene_state::{SceneFailure, SceneState, StateCounts};
use gs2e_files::html::{HtmlFragment, write_page_head};
use gs2e_num::units::format_amount;
use std::collections::BTreeMap;

/// Number of the slowest steps that are shown.
const SLOWEST: usize = 20;
/// Size of the bar, px.
const BAR: [f64; 2] = [1000.0, 10.0];

/// The content of the page.
#[derive(Debug)]
pub struct StatusPage<'a> {
    /// The shared store.
    pub shared: &'a str,
    /// The time of the look, as `YYYY-MM-DDThh:mm:ssZ`.
    pub now: &'a str,
    /// An hour before, in the same form.
    pub hour_ago: &'a str,
    /// The scenes, in the order of the plan.
    pub scenes: &'a [ScenePanel<'a>],
    /// Core-seconds that the missing steps are expected to take, s.
    pub core_seconds: f64,
    /// Cores of the tasks that run.
    pub cores: u64,
    /// The steps that tasks made.
    pub made: &'a [TaskStep],
}

/// A scene with its state.
#[derive(Debug, Clone, Copy)]
pub struct ScenePanel<'a> {
    /// Its id.
    pub scene: &'a str,
    /// Its steps.
    pub progress: SceneProgress,
    /// Its state.
    pub state: &'a SceneState,
}

impl StatusPage<'_> {
    /// Composes the page.
    #[must_use]
    pub fn compose(&self) -> String {
        HtmlFragment::whole_page(|html| {
            html.within("head", &[], |html| write_page_head(html, "Build status"));
            html.within("body", &[], |html| {
                html.within("header", &[], |html| {
                    html.leaf("h1", &[], "Build status");
                    html.leaf("p", &[("class", "caption")], &format!("{} at {}", self.shared, self.now));
                    self.write_figures(html);
                    self.write_bar(html);
                });
                html.within("main", &[], |html| {
                    self.write_failures(html);
                    self.write_running(html);
                    self.write_machines(html);
                    self.write_kinds(html);
                    self.write_slowest(html);
                    self.write_scenes(html);
                });
            });
        })
    }

    fn counts(&self) -> StateCounts {
        StateCounts::of(self.scenes.iter().map(|scene| scene.state))
    }

    fn write_figures(&self, html: &mut HtmlFragment) {
        let sum = |of: fn(SceneProgress) -> usize| self.scenes.iter().map(|s| of(s.progress)).sum::<usize>();
        let (steps, finished) = (sum(|progress| progress.steps), sum(|progress| progress.finished));
        // Times of one form and one zone have the same order as their texts, so they are not parsed.
        let last_hour = self.made.iter().filter(|step| step.ended.as_str() >= self.hour_ago).count();
        let spent: f64 = self.made.iter().map(|step| step.core_seconds).sum();
        let mut figures = vec![
            (format!("{} of {}", self.counts().done, self.scenes.len()), "scenes done"),
            (format!("{finished} of {steps}"), "steps finished"),
            (self.cores.to_string(), "cores at work"),
            (last_hour.to_string(), "steps made in the last hour"),
            (duration(spent), "of core time for the steps made"),
        ];
        if finished < steps {
            figures.push((duration(self.core_seconds), "of core time expected for the missing steps"));
            if self.cores > 0 {
                figures.push((duration(self.core_seconds / self.cores as f64), "left on the cores at work"));
            }
        }
        html.figures(figures);
    }

    /// The share of each state, as a bar with its legend.
    fn write_bar(&self, html: &mut HtmlFragment) {
        let StateCounts { done, running, queued, failed, open } = self.counts();
        let parts = [
            ("pass", "done", done),
            ("warn", "running", running),
            ("waived", "queued", queued),
            ("fail", "failed", failed),
            ("notrun", "open", open),
        ];
        let [width, height] = BAR;
        let all = self.scenes.len().max(1) as f64;
        html.within("div", &[("class", "verdict-line")], |html| {
            let view = format!("0 0 {width} {height}");
            let attributes = [
                ("class", "bar"),
                ("viewBox", view.as_str()),
                ("preserveAspectRatio", "none"),
                ("aria-hidden", "true"),
            ];
            html.within("svg", &attributes, |html| {
                let mut from = 0.0;
                for (class, _, count) in parts {
                    let wide = width * count as f64 / all;
                    let [x, w, h] = [from, wide, height].map(|v| format!("{v:.2}"));
                    html.empty(
                        "rect",
                        &[("class", class), ("x", &x), ("y", "0"), ("width", &w), ("height", &h)],
                    );
                    from += wide;
                }
            });
            html.within("p", &[], |html| {
                for (class, words, count) in parts.iter().filter(|part| part.2 > 0) {
                    html.leaf("span", &[("class", &format!("badge {class}"))], &format!("{count} {words}"));
                }
            });
        });
    }

    fn failures(&self) -> Vec<(&str, &SceneFailure)> {
        let failed = self.scenes.iter().filter_map(|scene| match scene.state {
            SceneState::Failed(failure) => Some((scene.scene, failure)),
            _ => None,
        });
        failed.collect()
    }

    /// The failures by kind, the most frequent one first, and then one by one.
    fn write_failures(&self, html: &mut HtmlFragment) {
        let failures = self.failures();
        if failures.is_empty() {
            return;
        }
        let mut kinds: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for (scene, failure) in &failures {
            kinds.entry(failure_kind(&failure.because)).or_default().push(scene);
        }
        let mut kinds: Vec<_> = kinds.into_iter().collect();
        // The sort is stable, so kinds of equal size keep the order of their words, and the page does not
        // jump.
        kinds.sort_by_key(|(_, scenes)| usize::MAX - scenes.len());
        html.within("section", &[], |html| {
            html.leaf("h2", &[], "Failures");
            write_rows(
                html,
                &["scenes", "failure", "for example"],
                &[0],
                kinds.iter().map(|(kind, scenes)| {
                    vec![scenes.len().to_string(), (*kind).to_owned(), scenes[0].to_owned()]
                }),
            );
            for (scene, failure) in failures {
                html.within("details", &[("class", "scene")], |html| {
                    html.leaf(
                        "summary",
                        &[],
                        &format!("{scene}: task {}: {}", failure.task, failure.because),
                    );
                    let words = match failure.last.as_slice() {
                        [] => "The error of the step is known, so the log is not shown.".to_owned(),
                        lines => lines.join("\n"),
                    };
                    html.leaf("pre", &[], &words);
                });
            }
        });
    }

    fn write_running(&self, html: &mut HtmlFragment) {
        let running = self.scenes.iter().filter_map(|scene| match scene.state {
            SceneState::Running { task, node } => Some(vec![
                scene.scene.to_owned(),
                task.to_string(),
                node.clone(),
                format!("{} of {}", scene.progress.finished, scene.progress.steps),
            ]),
            _ => None,
        });
        let running: Vec<Vec<String>> = running.collect();
        if running.is_empty() {
            return;
        }
        html.within("section", &[], |html| {
            html.leaf("h2", &[], "Running");
            html.leaf(
                "p",
                &[("class", "caption")],
                "The scenes of each task that runs and that are not done. A task builds one after another.",
            );
            write_rows(html, &["scene", "task", "node", "steps"], &[3], running);
        });
    }

    fn write_machines(&self, html: &mut HtmlFragment) {
        self.write_sums(html, "Machines", "machine", |step| &step.host);
    }

    fn write_kinds(&self, html: &mut HtmlFragment) {
        self.write_sums(html, "Where the time goes", "step", TaskStep::kind);
    }

    /// Sums over the steps that were made, by a word of each; the largest sum comes first.
    fn write_sums(&self, html: &mut HtmlFragment, title: &str, column: &str, of: impl Fn(&TaskStep) -> &str) {
        let mut sums: BTreeMap<&str, Vec<&TaskStep>> = BTreeMap::new();
        self.made.iter().for_each(|step| sums.entry(of(step)).or_default().push(step));
        if sums.is_empty() {
            return;
        }
        let spent = |steps: &[&TaskStep]| steps.iter().map(|step| step.core_seconds).sum::<f64>();
        let mut sums: Vec<_> = sums.into_iter().collect();
        // Stable as well: equal sums stay in the order of their words.
        sums.sort_by(|a, b| spent(&b.1).total_cmp(&spent(&a.1)));
        let rows = sums.iter().map(|(word, steps)| {
            let slowest = steps.iter().map(|step| step.seconds).fold(0.0, f64::max);
            let memory = steps.iter().map(|step| step.memory).max().unwrap_or(0);
            vec![
                (*word).to_owned(),
                steps.len().to_string(),
                duration(spent(steps)),
                duration(slowest),
                format_amount(memory, "B"),
                format_amount(steps.iter().map(|step| step.bytes).sum(), "B"),
            ]
        });
        html.within("section", &[], |html| {
            html.leaf("h2", &[], title);
            let columns = [column, "steps", "core time", "slowest", "largest memory", "bytes written"];
            write_rows(html, &columns, &[1, 2, 3, 4, 5], rows);
        });
    }

    fn write_slowest(&self, html: &mut HtmlFragment) {
        let mut steps: Vec<&TaskStep> = self.made.iter().collect();
        steps.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
        steps.truncate(SLOWEST);
        if steps.is_empty() {
            return;
        }
        html.within("section", &[], |html| {
            html.leaf("h2", &[], "Slowest steps");
            let columns = ["step", "time", "cores", "memory", "machine", "task"];
            write_rows(
                html,
                &columns,
                &[1, 2, 3],
                steps.into_iter().map(|step| {
                    vec![
                        step.step.clone(),
                        duration(step.seconds),
                        format!("{:.1}", step.cores),
                        format_amount(step.memory, "B"),
                        step.host.clone(),
                        step.job.clone(),
                    ]
                }),
            );
        });
    }

    fn write_scenes(&self, html: &mut HtmlFragment) {
        html.within("section", &[], |html| {
            html.leaf("h2", &[], "Scenes");
            let rows = self.scenes.iter().map(|scene| {
                let ScenePanel { scene, progress, state } = scene;
                vec![
                    (*scene).to_owned(),
                    state.to_string(),
                    format!("{} of {}", progress.finished, progress.steps),
                ]
            });
            write_rows(html, &["scene", "state", "steps"], &[2], rows);
        });
    }
}

/// A table. `numeric` has the indices of the columns with numbers.
fn write_rows(
    html: &mut HtmlFragment,
    columns: &[&str],
    numeric: &[usize],
    rows: impl IntoIterator<Item = Vec<String>>,
) {
    let class = |index: usize| if numeric.contains(&index) { "n" } else { "" };
    html.table("", |html| {
        html.within("thead", &[], |html| {
            html.within("tr", &[], |html| {
                columns
                    .iter()
                    .enumerate()
                    .for_each(|(i, name)| html.leaf("th", &[("class", class(i))], name));
            });
        });
        html.within("tbody", &[], |html| {
            for row in rows {
                html.within("tr", &[], |html| {
                    for (i, cell) in row.iter().enumerate() {
                        // A number and its unit stay on one line.
                        let cell =
                            if numeric.contains(&i) { cell.replace(' ', "\u{a0}") } else { cell.clone() };
                        html.leaf("td", &[("class", class(i))], &cell);
                    }
                });
            }
        });
    });
}

/// An error without the names of its scene and step, which stand before the first colon.
fn failure_kind(because: &str) -> &str {
    // Other messages have colons too. Only the name of a step has a slash before its first one.
    because.split_once(": ").filter(|(place, _)| place.contains('/')).map_or(because, |(_, kind)| kind)
}

/// A duration with its two largest units.
fn duration(seconds: f64) -> String {
    const MINUTE: u64 = 60;
    const HOUR: u64 = 60 * MINUTE;
    const DAY: u64 = 24 * HOUR;
    if seconds < 10.0 {
        return format!("{seconds:.2} s");
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive and rounded")]
    let whole = seconds.round() as u64;
    match whole {
        DAY.. => format!("{} d {} h", whole / DAY, whole % DAY / HOUR),
        HOUR.. => format!("{} h {} min", whole / HOUR, whole % HOUR / MINUTE),
        MINUTE.. => format!("{} min {} s", whole / MINUTE, whole % MINUTE),
        _ => format!("{whole} s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::queue::TaskId;

    #[test]
    fn durations_have_two_units() {
        for (seconds, wanted) in [
            (0.0, "0.00 s"),
            (9.994, "9.99 s"),
            (59.4, "59 s"),
            (59.6, "1 min 0 s"),
            (3_725.0, "1 h 2 min"),
            (200_000.0, "2 d 7 h"),
        ] {
            assert_eq!(duration(seconds), wanted);
        }
    }

    #[test]
    fn failures_of_one_kind_share_a_row() {
        assert_eq!(failure_kind("a/base/events: failed to bend"), "failed to bend");
        assert_eq!(failure_kind("signal 9 ended it"), "signal 9 ended it");
        assert_eq!(failure_kind("no space: 3 MB"), "no space: 3 MB");
    }

    fn made(step: &str, seconds: f64, ended: &str) -> TaskStep {
        TaskStep {
            step: step.to_owned(),
            seconds,
            cores: 2.0,
            core_seconds: 2.0 * seconds,
            memory: 3_000_000,
            bytes: 10,
            host: "n1".to_owned(),
            job: "slurm 7_1".to_owned(),
            ended: ended.to_owned(),
        }
    }

    #[test]
    fn every_part_is_on_the_page() {
        let task = TaskId { job: 7, task: 1 };
        let failed = |scene: &str| {
            SceneState::Failed(SceneFailure {
                task,
                because: format!("{scene}/base/events: no <space>"),
                last: vec!["last line".to_owned()],
                memory_mb: 1,
                is_out_of_memory: false,
            })
        };
        let states =
            [SceneState::Done, SceneState::Running { task, node: "n1".into() }, failed("c"), failed("d")];
        let half = SceneProgress { steps: 4, finished: 2 };
        let scenes: Vec<ScenePanel<'_>> = ["a", "b", "c", "d"]
            .iter()
            .zip(&states)
            .map(|(scene, state)| ScenePanel { scene, progress: half, state })
            .collect();
        let made = [
            made("a/base/events", 100.0, "2026-01-02T10:30:00Z"),
            made("a/capture", 1.0, "2026-01-02T09:00:00Z"),
        ];
        let page = StatusPage {
            shared: "/lab/gs2e",
            now: "2026-01-02T11:00:00Z",
            hour_ago: "2026-01-02T10:00:00Z",
            scenes: &scenes,
            core_seconds: 7_200.0,
            cores: 4,
            made: &made,
        };
        let text = page.compose();
        for wanted in [
            "<strong>1 of 4</strong> scenes done",
            "<strong>8 of 16</strong> steps finished",
            "<strong>1</strong> steps made in the last hour",
            "<strong>3 min 22 s</strong> of core time for the steps made",
            "<strong>2 h 0 min</strong> of core time expected for the missing steps",
            "<strong>30 min 0 s</strong> left on the cores at work",
            "<span class=\"badge fail\">2 failed</span>",
            "<td class=\"n\">2</td><td>no &lt;space&gt;</td><td>c</td>",
            "<pre>last line</pre>",
            "<td>b</td><td>7_1</td><td>n1</td><td class=\"n\">2\u{a0}of\u{a0}4</td>",
            "<td>events</td><td class=\"n\">1</td><td class=\"n\">3\u{a0}min\u{a0}20\u{a0}s</td><td class=\"n\">1\u{a0}min\u{a0}40\u{a0}s</td>",
            "<td>a</td><td>done</td>",
        ] {
            assert!(text.contains(wanted), "{wanted}\n{text}");
        }
        // A strict reader accepts it.
        let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
        roxmltree::Document::parse_with_options(&text, options).unwrap();
    }
}
