//! `gs2e stress`: computes the table of stiff and extreme cases.

mod page;

use super::{BackendArg, CommonArgs, Console, ExitKind, VerbError, input, output};
use clap::builder::PossibleValuesParser;
use gs2e_files::is_there;
use gs2e_gpu as gpu;
use gs2e_lab::stress::splat::SplatBench;
use gs2e_lab::stress::{NotRun, Outcome, StressArea, StressCase, area_cases};
use gs2e_render::backend::Backend;
use gs2e_scene as scene;
use serde::Serialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Arguments of `stress`.
#[derive(Debug, clap::Args)]
pub(super) struct StressArgs {
    /// Cases, by name or with their area: `ties`, `splat/ties`, `splat/ties@cpu` [default: all]
    #[arg(value_name = "CASE")]
    names: Vec<String>,
    /// Run this area only; may be repeated
    #[arg(long, value_name = "AREA", value_parser = PossibleValuesParser::new(StressArea::ALL.map(StressArea::name)))]
    area: Vec<String>,
    /// Render this scene too: .ply, .splat, .spz or .sog
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// File for the table as a Markdown page: a .md
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

/// The result of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum CaseVerdict {
    Pass,
    Fail,
    NotRun,
}

/// A case with its outcome; the outcome is an error if the case could not be run.
#[derive(Debug)]
struct StressRow {
    id: String,
    area: StressArea,
    case: &'static str,
    backend: Option<&'static str>,
    regime: &'static str,
    unit: &'static str,
    outcome: Outcome,
    seconds: f64,
}

impl StressArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        output::screen_outputs(self.markdown.as_deref(), self.scene.as_deref(), console.json)?;
        common.limit_cores();
        let stage = self.stage(common)?;
        let areas = StressArea::ALL.into_iter().filter(|area| self.wants(*area));
        let mut cases: Vec<StressCase<'_>> = areas.flat_map(|area| area_cases(area, &stage)).collect();
        self.keep_named(&mut cases)?;
        let run = |case| {
            let row = StressRow::from_case(case);
            row.report(console);
            row
        };
        let rows: Vec<StressRow> = cases.iter().map(run).collect();
        console.note(&summary_line(&rows));
        if let Some(path) = &self.markdown {
            output::write_output(path, |out| page::write_page(&rows, out))?;
        }
        Ok(exit_kind(&rows))
    }

    fn wants(&self, area: StressArea) -> bool {
        self.area.is_empty() || self.area.iter().any(|name| name == area.name())
    }

    /// The scene, and the back ends: the requested one, or else all.
    fn stage(&self, common: &CommonArgs) -> Result<SplatBench, VerbError> {
        if !self.wants(StressArea::Splat) {
            return Ok(SplatBench::default());
        }
        let backends = match common.backend {
            BackendArg::Auto => {
                // A missing GPU must not fail the table: its cases are listed as not run.
                let gpu = common.device(&gpu::DeviceChoice::Any).map(Backend::from);
                vec![
                    ("cpu", Ok(Backend::Cpu)),
                    ("reference", Ok(Backend::Reference)),
                    ("gpu", gpu.map_err(|why| NotRun(why.to_string()))),
                ]
            }
            BackendArg::Cpu => vec![("cpu", Ok(common.backend()?))],
            BackendArg::Reference => vec![("reference", Ok(common.backend()?))],
            BackendArg::Gpu => vec![("gpu", Ok(common.backend()?))],
        };
        let read = |path: &Path| match is_there(path) {
            true => scene::read_any(path).map_err(|e| input::unreadable_file("scene", &e)),
            false => Err(input::missing_file("scene", path)),
        };
        let scene = self.scene.as_deref().map(read).transpose()?.map(Arc::new);
        Ok(SplatBench { backends, scene })
    }

    /// Keeps the cases that the user named.
    fn keep_named(&self, cases: &mut Vec<StressCase<'_>>) -> Result<(), VerbError> {
        let is = |case: &StressCase<'_>, name: &str| {
            let id = case.id();
            case.name == name || id == name || id.split('@').next() == Some(name)
        };
        if let Some(name) = self.names.iter().find(|name| !cases.iter().any(|case| is(case, name))) {
            let what = format!("no case has the name `{name}`");
            return Err(VerbError::usage("no-case", what).help("`gs2e stress` prints all names"));
        }
        cases.retain(|case| self.names.is_empty() || self.names.iter().any(|name| is(case, name)));
        Ok(())
    }
}

impl StressRow {
    fn from_case(case: &StressCase<'_>) -> Self {
        let start = Instant::now();
        let outcome = case.run();
        let seconds = start.elapsed().as_secs_f64();
        let StressCase { area, name, backend, regime, unit, .. } = *case;
        Self { id: case.id(), area, case: name, backend, regime, unit, outcome, seconds }
    }

    fn verdict(&self) -> CaseVerdict {
        match &self.outcome {
            Ok(found) if found.holds() => CaseVerdict::Pass,
            Ok(_) => CaseVerdict::Fail,
            Err(_) => CaseVerdict::NotRun,
        }
    }

    /// Prints a record for programs, or a line for people and the worst point of a missed limit.
    fn report(&self, console: &Console) {
        if console.json {
            return console.result(&self.to_json());
        }
        let verdict = self.verdict();
        if console.quiet && verdict != CaseVerdict::Fail {
            return;
        }
        let Self { id, regime, unit, seconds, .. } = self;
        match &self.outcome {
            Err(why) => console.print(&format!("not run  {id:42} {why}")),
            Ok(found) => {
                let word = if verdict == CaseVerdict::Pass { "ok" } else { "MISSES" };
                let (error, limit) = (found.worst.error, found.worst.limit);
                let seconds = format!("{seconds:.2} s");
                console.print(&format!(
                    "{word:7}  {id:42} {error:8.1e} of {limit:7.1e} {unit:12} {seconds:>8}  {regime}"
                ));
            }
        }
        if let (Ok(found), CaseVerdict::Fail) = (&self.outcome, verdict) {
            let (computed, answer) = (found.worst.computed, found.worst.answer);
            console.print(&format!("         {}: computed {computed:e}, answer {answer:e}", found.at));
        }
    }

    fn to_json(&self) -> Value {
        let Self { id, area, case, backend, regime, unit, seconds, .. } = self;
        let found = self.outcome.as_ref().ok();
        let worst = found.map(|found| found.worst);
        json!({
            "id": id, "area": area, "case": case, "backend": backend, "regime": regime, "verdict": self.verdict(),
            "computed": worst.map(|worst| worst.computed), "answer": worst.map(|worst| worst.answer),
            "error": worst.map(|worst| worst.error), "limit": worst.map(|worst| worst.limit), "unit": unit,
            "at": found.map(|found| &found.at), "points": found.map(|found| found.points),
            "because": self.outcome.as_ref().err().map(|why| why.0.as_str()), "seconds": seconds,
        })
    }
}

fn summary_line(rows: &[StressRow]) -> String {
    let [ok, misses, not_run] = [CaseVerdict::Pass, CaseVerdict::Fail, CaseVerdict::NotRun]
        .map(|verdict| rows.iter().filter(|row| row.verdict() == verdict).count());
    let seconds: f64 = rows.iter().map(|row| row.seconds).sum();
    format!("{ok} ok, {misses} miss their limit, {not_run} not run; {seconds:.1} s")
}

// A case that did not run is no fault: a machine without a GPU can still pass the table.
fn exit_kind(rows: &[StressRow]) -> ExitKind {
    if rows.iter().any(|row| row.verdict() == CaseVerdict::Fail) { ExitKind::Fault } else { ExitKind::Done }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_lab::stress::{CaseResult, StressPoint};

    fn row(outcome: Outcome) -> StressRow {
        let (area, case, regime, unit) = (StressArea::Splat, "ties", "deep | wide", "px");
        StressRow {
            id: "splat/ties@cpu".into(),
            area,
            case,
            backend: Some("cpu"),
            regime,
            unit,
            outcome,
            seconds: 0.5,
        }
    }

    fn found(error: f64) -> Outcome {
        let worst = StressPoint { computed: 1.0, answer: 1.0 + error, error, limit: 0.1 };
        Ok(CaseResult { worst, at: "the corner".to_owned(), points: 3 })
    }

    #[test]
    fn a_row_that_misses_ends_with_3_and_one_that_was_not_run_does_not() {
        let absent = || Err(NotRun("no GPU is available".to_owned()));
        assert_eq!(exit_kind(&[row(found(0.1)), row(absent())]), ExitKind::Done);
        assert_eq!(exit_kind(&[row(found(0.1)), row(found(0.11))]), ExitKind::Fault);
        assert_eq!(exit_kind(&[row(found(f64::NAN))]), ExitKind::Fault);
        assert_eq!(
            summary_line(&[row(found(0.0)), row(absent())]),
            "1 ok, 0 miss their limit, 1 not run; 1.0 s"
        );
    }

    #[test]
    fn what_was_not_run_is_told_and_has_no_figures() {
        let seen = row(Err(NotRun("no GPU is available".to_owned()))).to_json();
        assert_eq!((&seen["verdict"], &seen["because"]), (&json!("not-run"), &json!("no GPU is available")));
        assert!(
            ["computed", "answer", "error", "limit", "at", "points"].iter().all(|name| seen[name].is_null())
        );
        let seen = row(found(0.2)).to_json();
        assert_eq!(
            (&seen["verdict"], &seen["error"], &seen["at"]),
            (&json!("fail"), &json!(0.2), &json!("the corner"))
        );
    }

    #[test]
    fn the_page_has_a_line_a_row() {
        let mut page = Vec::new();
        page::write_page(
            &[row(found(0.05)), row(found(0.2)), row(Err(NotRun("no GPU".to_owned())))],
            &mut page,
        )
        .unwrap();
        let page = String::from_utf8(page).unwrap();
        let lines: Vec<&str> = page.lines().filter(|line| line.starts_with("| ties")).collect();
        assert_eq!(lines.len(), 3, "{page}");
        assert_eq!(lines[0], "| ties, cpu | deep \\| wide | 5.0e-2 | 1.0e-1 | px | yes | 0.50 s |");
        assert!(lines[1].contains("**no**") && lines[2].contains("not run: no GPU"));
    }
}
