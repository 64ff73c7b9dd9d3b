//! Time of an iteration of training by the number of Gaussians and of pixels: core-seconds, all
//! photos at full size and all Gaussians placed. `memory` has the peak memory.
//!
//! The photos are renderings of the embedded scene, in a temporary folder. A training of 40
//! iterations has all its Gaussians and full-size photos from the 24th on; those are timed.

pub(crate) mod memory;

use crate::laws::GrowthLaws;
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_image::{Size, png};
use gs2e_render::backend::Backend;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use gs2e_scene::camera::view::CameraView;
use gs2e_source::Capture;
use gs2e_train as training;
use gs2e_train::{TrainingNews, TrainingSettings, TrainingWatch};
use serde_json::{Value, json};
use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;

/// The part's name on the command line.
pub(crate) const PART: &str = "training";

const ITERATIONS: u32 = 40;
/// The first timed iteration.
const FROM: u32 = 24;
const VIEWS: u32 = 8;

/// A capture on disk. The folder lasts as long as this value.
struct Photos {
    capture: Capture,
    files: Vec<(String, PathBuf)>,
    size: Size,
    folder: tempfile::TempDir,
}

/// One size of an axis: the Gaussians, the photos, and the core-seconds of each run's iterations.
struct Point {
    gaussians: u32,
    photos: Arc<Photos>,
    runs: Vec<f64>,
}

/// An axis along which one size grows.
pub(crate) struct Axis {
    name: &'static str,
    what: String,
    points: Vec<Point>,
}

/// Measures both axes with `runs` runs each, in interleaved rounds.
pub(crate) fn measure(runs: usize) -> Vec<Axis> {
    let point =
        |gaussians, photos: &Arc<Photos>| Point { gaussians, photos: photos.clone(), runs: Vec::new() };
    let middle = Arc::new(photos(wide(480)));
    let counts = [10_000, 20_000, 40_000, 80_000, 160_000];
    let by_count = counts.map(|count| point(count, &middle)).into();
    let widths = [240, 339, 480, 679, 960];
    let by_pixels = widths.map(|width| point(40_000, &Arc::new(photos(wide(width))))).into();
    let mut axes = vec![
        Axis { name: "Gaussians", what: format!("{} px", middle.size), points: by_count },
        Axis { name: "pixels", what: "40,000 Gaussians".to_owned(), points: by_pixels },
    ];
    for _ in 0..runs {
        for point in axes.iter_mut().flat_map(|axis| &mut axis.points) {
            point.runs.push(iteration_seconds(point.gaussians, &point.photos));
        }
    }
    axes.iter_mut().flat_map(|axis| &mut axis.points).for_each(|point| point.runs.sort_by(f64::total_cmp));
    axes
}

/// A size of about 16:9.
fn wide(width: u32) -> Size {
    Size { width, height: (width * 9 + 8) / 16 }
}

/// Photos of the embedded scene.
fn photos(size: Size) -> Photos {
    let life = StillLife { gaussians: 100_000, views: VIEWS, ..StillLife::default() };
    let mut capture = procedural::still_capture(&life);
    let style = RenderStyle {
        rules: RenderRules::Soft,
        order: LayerOrder::Depth,
        antialiased: false,
        background: [0.0; 3],
    };
    let scene = Arc::new(procedural::still_life(&life));
    let mut renderer = CpuRenderer::new(scene, style).expect("the scene can be rendered");
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let mut files = Vec::new();
    for (i, view) in capture.views.iter_mut().enumerate() {
        view.camera = view.camera.resized(size);
        view.name = format!("{i}.png");
        let mut out = RenderedImages::default();
        let at = CameraView::at_rest(view.camera, view.world_from_camera);
        renderer.render(&at, ChannelSet { rgb: true, ..ChannelSet::NONE }, &mut out).expect("it renders");
        let path = folder.path().join(&view.name);
        let file = File::create(&path).expect("the folder can be written");
        png::write_image(&png::to_bytes(&out.rgb.expect("it was asked for")), file).expect("it is written");
        files.push((view.name.clone(), path));
    }
    Photos { capture, files, size, folder }
}

/// Core-seconds of an iteration.
fn iteration_seconds(gaussians: u32, photos: &Photos) -> f64 {
    let settings = TrainingSettings {
        gaussians,
        iterations: ITERATIONS,
        resolution: photos.size.width,
        hold_out: 0,
        ..TrainingSettings::default()
    };
    let mut marks = Vec::new();
    let mut news = |news: &TrainingNews| {
        if let TrainingNews::Report(report) = news {
            marks.push((report.point.iteration, crate::growth::spent()));
        }
    };
    let watch = TrainingWatch { goes_on: &|| true, news: &mut news, clock: None, checkpoint: None };
    training::train_capture(&photos.capture, &photos.files, &settings, &Backend::Cpu, watch)
        .expect("it trains");
    let first = marks.iter().find(|(iteration, _)| *iteration >= FROM).expect("a report every 2 iterations");
    let last = marks.last().expect("a report at the end");
    (last.1 - first.1) / f64::from(last.0 - first.0)
}

impl Point {
    fn size(&self, axis: &str) -> f64 {
        if axis == "pixels" { self.photos.size.pixels() as f64 } else { f64::from(self.gaussians) }
    }
}

impl Axis {
    /// A Markdown table: one row per size, then the law of growth.
    pub(crate) fn table(&self) -> String {
        let mut lines = vec![
            format!("**{}**, {}:\n", self.name, self.what),
            format!("| {} | core-ms per iteration | median |", self.name),
            "|---|---|---|".to_owned(),
        ];
        for point in &self.points {
            let [best, median] = [point.runs[0], point.runs[point.runs.len() / 2]].map(|s| 1e3 * s);
            lines.push(format!("| {} | {best:.1} | {median:.1} |", point.size(self.name)));
        }
        if let Some(law) = self.growth() {
            lines.push(format!(
                "\nAs a power: {:.2} ± {:.2}. As a line: {:.1} core-ms, and {:.1} core-ns for each of the {}; \
                 off by up to {:.0} %.",
                law.exponent,
                law.standard_error,
                1e3 * law.fixed,
                1e9 * law.marginal,
                self.name,
                100.0 * law.worst
            ));
        }
        lines.join("\n")
    }

    fn growth(&self) -> Option<GrowthLaws> {
        let points: Vec<_> = self.points.iter().map(|p| (p.size(self.name), p.runs[0])).collect();
        GrowthLaws::fit_points(&points)
    }

    /// The figures as JSON.
    pub(crate) fn json(&self) -> Value {
        let point = |p: &Point| json!({ "size": p.size(self.name), "core_s": p.runs });
        let points: Vec<Value> = self.points.iter().map(point).collect();
        json!({ "axis": self.name, "workload": self.what, "points": points, "growth": self.growth() })
    }
}
