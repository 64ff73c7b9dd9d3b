//! From what is written to what is meant: required fields, ranges, defaults, presets, and paths.

mod number;
mod sensor;
mod source;
pub(super) mod trajectory;

use super::field::{Field, Later};
use super::names;
use super::problem::{Problem, quoted};
use super::reader::{Problems, unknown};
use super::text::Place;
use super::{LicenceChoice, Output, schema};
use crate::camera::CameraChoice;
use crate::check::Limits;
use crate::render::Rules;
use crate::render::{Antialiased, RenderChoice};
use crate::units::Hertz;
use number::{Range, Whole};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Most frames a second: stamps are whole microseconds and must increase.
const MAX_RATE: f64 = 1e6;

/// Most frames of a trajectory (pipeline 2.10).
const MAX_FRAMES: u64 = 20_000_000;

/// Resolves one recipe, collecting what is wrong with it.
pub(super) struct Resolver<'a> {
    /// Where faults are left.
    pub problems: &'a Problems,
    /// The folder of each file that the recipe is made from; its relative paths start there.
    pub folders: &'a [PathBuf],
    /// The recipe as a whole, for what is missing.
    pub root: Place,
}

/// Everything of a recipe but its names of files and its merged form.
pub(super) struct Resolved {
    pub scene: String,
    pub seed: u64,
    pub source: super::Source,
    pub reconstruct: Option<super::Reconstruct>,
    pub camera: Option<CameraChoice>,
    pub trajectories: Vec<super::TrajectoryRecipe>,
    pub rate: Hertz,
    pub render: RenderChoice,
    pub sensor: crate::sensor::Sensor,
    pub outputs: BTreeSet<Output>,
    pub sharp_every: u32,
    pub checks: Limits,
    pub licence: Option<LicenceChoice>,
}

impl Resolver<'_> {
    /// The recipe, or `None` where something is wrong with it, which then was reported.
    pub(super) fn recipe(&self, raw: &schema::Recipe) -> Option<Resolved> {
        self.version(&raw.version);
        self.refuse_later(raw);
        let scene = self.scene(&raw.scene);
        let seed = self.or(&raw.seed, 0);
        let source = self.source(&raw.source);
        let reconstruct = self.reconstruct(&raw.reconstruct, source.as_ref());
        let camera = self.camera(&raw.camera);
        let rate = self.rate(&raw.sampling);
        let trajectories = self.trajectories(&raw.trajectories, rate);
        let render = self.render(&raw.render);
        let between = self.between(&raw.sampling);
        let sensor = self.sensor(&raw.sensor, between, rate);
        let outputs = self.outputs(&raw.outputs);
        let sharp_every = self.sharp_every(&raw.sharp);
        let checks = self.or(&raw.checks, Limits::default());
        let licence = self.licence(&raw.licence);
        Some(Resolved {
            scene: scene?,
            seed: seed?,
            source: source?,
            reconstruct: reconstruct?,
            camera: camera?,
            trajectories: trajectories?,
            rate: rate?,
            render: render?,
            sensor: sensor?,
            outputs: outputs?,
            sharp_every: sharp_every?,
            checks: checks?,
            licence: licence?,
        })
    }

    fn version(&self, field: &Field<u64>) {
        if let Some((version, place)) = self.required(field, "version", self.root, "version: 1")
            && *version != 1
        {
            let problem = Problem::of_field(format!("is {version}, and this gs2e reads version 1"));
            self.report(problem.help("use a newer gs2e, or write version: 1").at(place));
        }
    }

    fn refuse_later(&self, raw: &schema::Recipe) {
        self.later(&raw.sensors, "this gs2e feeds one sensor: use sensor");
        self.later(&raw.blur, "this gs2e makes events and sharp frames");
        self.later(&raw.release, "this gs2e releases the products alone");
        self.later(&raw.attributes, "this gs2e takes attributes from the source");
    }

    fn scene(&self, field: &Field<String>) -> Option<String> {
        let help = "scene: my/scene is its id, and its folder in the release";
        let (id, place) = self.required(field, "scene", self.root, help)?;
        self.named(id, place, names::scene_id(id), names::SCENE_HELP)
    }

    /// A name, where nothing speaks against it.
    fn named(&self, name: &str, place: Place, verdict: Result<(), String>, help: &str) -> Option<String> {
        match verdict {
            Ok(()) => Some(name.to_owned()),
            Err(because) => {
                let problem = Problem::of_field(format!("is {}, {because}", quoted(name)));
                self.refuse(problem.help(help).at(place))
            }
        }
    }

    fn camera(&self, field: &Field<schema::Camera>) -> Option<Option<CameraChoice>> {
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
        let side = |f: &Field<u64>, name| {
            self.required(f, name, place, "width and height are both given, in pixels")?;
            self.whole(f, 1, Whole::new(1, 16_384))
        };
        let (width, height) = (side(&raw.width, "width"), side(&raw.height, "height"));
        let intrinsics = self.intrinsics(raw, place);
        let small = |n: u64| u32::try_from(n).expect("within its range");
        Some(Some(CameraChoice { width: small(width?), height: small(height?), intrinsics: intrinsics? }))
    }

    fn intrinsics(&self, raw: &schema::Camera, camera: Place) -> Option<Option<[f64; 4]>> {
        let fields = [&raw.fx, &raw.fy, &raw.cx, &raw.cy];
        if fields.iter().all(|f| f.is_absent()) {
            return Some(None);
        }
        let ranges =
            [Range::above(0.0, 1e6), Range::above(0.0, 1e6), Range::new(-1e6, 1e6), Range::new(-1e6, 1e6)];
        let values: Vec<Option<f64>> = ["fx", "fy", "cx", "cy"]
            .into_iter()
            .zip(fields)
            .zip(ranges)
            .map(|((name, field), range)| {
                self.required(
                    field,
                    name,
                    camera,
                    "fx, fy, cx and cy are given together, in pixels, or not at all",
                )?;
                self.real(field, 0.0, range)
            })
            .collect();
        Some(Some([values[0]?, values[1]?, values[2]?, values[3]?]))
    }

    fn rate(&self, field: &Field<schema::Sampling>) -> Option<Hertz> {
        let absent = schema::Sampling::default();
        let raw = self.section(field, &absent)?;
        self.later(&raw.tolerance, "this gs2e samples at a fixed rate");
        self.ratio(&raw.rate, 2400, Range::above(0.0, MAX_RATE)).map(Hertz)
    }

    fn render(&self, field: &Field<schema::Render>) -> Option<RenderChoice> {
        let absent = schema::Render::default();
        let raw = self.section(field, &absent)?;
        self.later(&raw.order, "this gs2e has no soft rules, and so no order of theirs");
        let rules = self.rules(&raw.rules);
        let antialiased = match self.or(&raw.antialiased, schema::Antialiased::Auto) {
            Some(schema::Antialiased::Auto) => Some(Antialiased::Auto),
            Some(schema::Antialiased::On) => Some(Antialiased::On),
            Some(schema::Antialiased::Off) => Some(Antialiased::Off),
            None => None,
        };
        let background = match &raw.background {
            Field::Absent => Some([0.0; 3]),
            Field::Bad => None,
            Field::Given(rgb, _) => {
                let [r, g, b] = rgb.each_ref().map(|c| self.real(c, 0.0, Range::new(0.0, 1.0)));
                (|| Some([r?, g?, b?]))()
            }
        };
        Some(RenderChoice { rules: rules?, antialiased: antialiased?, background: background? })
    }

    fn rules(&self, field: &Field<schema::Rules>) -> Option<Rules> {
        match field {
            Field::Absent | Field::Given(schema::Rules::Official, _) => Some(Rules::Official),
            Field::Given(schema::Rules::Exact, _) => Some(Rules::Exact),
            Field::Given(rules @ (schema::Rules::Gsplat | schema::Rules::Soft), place) => {
                let name = if matches!(rules, schema::Rules::Gsplat) { "gsplat" } else { "soft" };
                self.word_later(name, *place, "this gs2e renders with the rules official and exact")
            }
            Field::Bad => None,
        }
    }

    fn outputs(&self, field: &Field<Vec<Field<schema::Output>>>) -> Option<BTreeSet<Output>> {
        let list = match field {
            Field::Absent => return Some(BTreeSet::from([Output::Events, Output::Sharp])),
            Field::Bad => return None,
            Field::Given(list, _) => list,
        };
        let mut outputs = BTreeSet::new();
        let mut sound = true;
        for item in list {
            let output = self.output(item);
            sound &= output.is_some_and(|(output, place)| {
                outputs.insert(output)
                    || self.refuse(Problem::of_field("is in the list twice").at(place)).unwrap_or(false)
            });
        }
        sound.then_some(outputs)
    }

    fn output(&self, item: &Field<schema::Output>) -> Option<(Output, Place)> {
        let (output, place) = item.given()?;
        let name = match output {
            schema::Output::Events => return Some((Output::Events, place)),
            schema::Output::Sharp => return Some((Output::Sharp, place)),
            schema::Output::Blur => "blur",
            schema::Output::Depth => "depth",
            schema::Output::Flow => "flow",
        };
        self.word_later(name, place, "this gs2e makes events and sharp frames")
    }

    fn sharp_every(&self, field: &Field<schema::Sharp>) -> Option<u32> {
        let absent = schema::Sharp::default();
        let every = self.whole(&self.section(field, &absent)?.every, 1, Whole::new(1, MAX_FRAMES))?;
        Some(u32::try_from(every).expect("within its range"))
    }

    fn licence(&self, field: &Field<schema::Licence>) -> Option<Option<LicenceChoice>> {
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
        self.later(&raw.evidence, "this gs2e composes licences without evidence");
        let help = "licence: { expression: CC0-1.0, holder: Example Lab }";
        let expression = self.required(&raw.expression, "expression", place, help);
        let expression = expression.and_then(|(text, place)| self.spdx(text, place));
        let holder = self.required(&raw.holder, "holder", place, help);
        let holder = holder.and_then(|(text, place)| self.filled(text, place));
        Some(Some(LicenceChoice { expression: expression?, holder: holder? }))
    }

    fn spdx(&self, text: &str, place: Place) -> Option<String> {
        match spdx::Expression::parse(text) {
            Ok(_) => Some(text.to_owned()),
            Err(error) => {
                let wrong = text.get(error.span.clone()).filter(|s| !s.is_empty()).unwrap_or(text);
                let message = format!("is no SPDX licence expression: {} at {}", error.reason, quoted(wrong));
                let help = "ids are those of spdx.org/licenses; own terms are LicenseRef-Name";
                self.refuse(Problem::of_field(message).help(help).at(place))
            }
        }
    }

    /// A text that says something.
    fn filled(&self, text: &str, place: Place) -> Option<String> {
        if text.trim().is_empty() {
            return self.refuse(Problem::of_field("is empty").at(place));
        }
        Some(text.to_owned())
    }

    /// A path, relative to the folder of the file that names it.
    fn path(&self, field: &Field<String>, within: Place) -> Option<PathBuf> {
        let (text, place) =
            self.required(field, "path", within, "a path is relative to the recipe's folder")?;
        self.filled(text, place)?;
        Some(self.folders[place.file as usize].join(Path::new(text)))
    }

    fn report(&self, problem: Problem) {
        self.problems.borrow_mut().push(problem);
    }

    /// Reports a problem that leaves no value.
    fn refuse<T>(&self, problem: Problem) -> Option<T> {
        self.report(problem);
        None
    }

    /// Refuses a field whose feature is not there yet.
    fn later(&self, field: &Field<Later>, instead: &str) {
        if let Some((_, place)) = field.given() {
            self.report(Problem::of_key("is not built yet").help(instead).at(place));
        }
    }

    /// Refuses a choice whose feature is not there yet.
    fn word_later<T>(&self, word: &str, place: Place, instead: &str) -> Option<T> {
        self.refuse(Problem::new(format!("\"{word}\" is not built yet")).help(instead).at(place))
    }

    /// A section that may be left out; `None` where it is faulty.
    fn section<'f, T>(&self, field: &'f Field<T>, absent: &'f T) -> Option<&'f T> {
        match field {
            Field::Absent => Some(absent),
            Field::Bad => None,
            Field::Given(value, _) => Some(value),
        }
    }

    /// The value, or the default where there is none.
    fn or<T: Clone>(&self, field: &Field<T>, default: T) -> Option<T> {
        self.section(field, &default).cloned()
    }

    /// The value of a field that must be there.
    fn required<'f, T>(
        &self,
        field: &'f Field<T>,
        name: &str,
        within: Place,
        help: &str,
    ) -> Option<(&'f T, Place)> {
        if field.is_absent() {
            self.report(Problem::new(format!("missing field \"{name}\"")).help(help).at(within));
        }
        field.given()
    }

    /// The value of a name from a list.
    fn unknown<T>(&self, what: &str, found: &str, known: &[&str], place: Place) -> Option<T> {
        self.refuse(unknown(what, found, known).at(place))
    }
}
