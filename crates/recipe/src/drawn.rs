//! Numbers of sensors that are drawn for each trajectory.
//!
//! A law stands in the place of a number. The tree is resolved once with the medians, for
//! everything that concerns the scene as a whole; once with all lower and once with all upper ends,
//! which shows if a range leaves the range of its parameter; and once for each trajectory, with the
//! numbers drawn for it.

mod contrast;
mod law;
mod preset;

pub(super) use contrast::expand_contrast;
pub(super) use law::is_law;
pub(super) use preset::{RANDOMISED, take_preset};

use super::problem::FieldProblem;
use super::reader::{Problems, TreeReader};
use super::resolve::Resolver;
use super::text::TextSpan;
use super::tree::{MappingEntry, NodeKind, TreeNode};
use super::{Recipe, TrajectoryRecipe, schema};
use gs2e_num::seed::Seed;
use gs2e_num::seed::range::RangeLaw;
use gs2e_num::units::Hertz;
use gs2e_sensor::SensorSet;
use gs2e_sensor::voltmeter::BetweenFrames;
use serde::Deserialize as _;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};

/// The sensors of a trajectory with their drawn numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnSensors {
    /// The drawn numbers by name of the sensor (empty if the recipe has one sensor) and path, such
    /// as `v2e.threshold.on`.
    pub numbers: BTreeMap<String, BTreeMap<String, f64>>,
    /// The sensors with these numbers.
    pub sensors: SensorSet,
}

/// A number of a sensor with its law.
#[derive(Debug)]
struct DrawnNumber {
    /// The camera of the rig that has the sensor; `None` for a sensor of the recipe.
    camera: Option<usize>,
    /// Name of the sensor; empty for the only one.
    sensor: String,
    /// Keys from the sensor to the number; an index for an item of a list.
    steps: Vec<String>,
    place: TextSpan,
    law: RangeLaw,
}

impl DrawnNumber {
    /// The path as messages write it: `voltmeter.k[2]`.
    fn path(&self) -> String {
        let mut path = String::new();
        for step in &self.steps {
            match step.bytes().all(|b| b.is_ascii_digit()) {
                true => path.push_str(&format!("[{step}]")),
                false if path.is_empty() => path.push_str(step),
                false => path.push_str(&format!(".{step}")),
            }
        }
        path
    }
}

/// The drawn numbers of a recipe, in file order.
#[derive(Debug)]
pub(super) struct SensorDraws {
    numbers: Vec<DrawnNumber>,
    /// The tree with medians in the place of laws.
    middle: TreeNode,
}

impl SensorDraws {
    /// Finds the laws of a recipe's tree, and reports the faulty ones.
    pub(super) fn find(tree: &TreeNode, problems: &Problems) -> Self {
        let (mut numbers, mut middle) = (Vec::new(), tree.clone());
        for_each_law(&mut middle, &mut |(camera, sensor), steps, node| match law::parse_law(node) {
            Ok(_) if steps.iter().any(|step| step == contrast::CONTRAST) => {
                let problem = FieldProblem::of_field("is a law, wanted a number");
                let help = "write the law under threshold, in the unit of the sensor";
                problems.borrow_mut().push(problem.help(help).at(node.place));
                node.kind = NodeKind::Refused;
            }
            Ok(law) => {
                let (sensor, steps) = (sensor.to_owned(), steps.to_vec());
                numbers.push(DrawnNumber { camera, sensor, steps, place: node.place, law });
                // The number keeps the place of its law, by which later steps and messages find the law
                // again.
                *node = law::number_node(law.quantile(0.5), node.place);
            }
            Err(problem) => {
                problems.borrow_mut().push(problem);
                node.kind = NodeKind::Refused;
            }
        });
        Self { numbers, middle }
    }

    /// The tree with medians in the place of laws.
    pub(super) fn middle(&self) -> &TreeNode {
        &self.middle
    }

    /// Reports each law with an end outside the range of its parameter.
    pub(super) fn check_ends(&self, tree: &TreeNode, resolver: &Resolver<'_>) {
        let cameras: BTreeSet<Option<usize>> = self.numbers.iter().map(|number| number.camera).collect();
        let ends = ["lower", "upper"].into_iter().enumerate();
        for (camera, (end, name)) in
            cameras.into_iter().flat_map(|camera| ends.clone().map(move |e| (camera, e)))
        {
            let values: Vec<f64> = self.numbers_of(camera).map(|number| number.law.ends()[end]).collect();
            let found = Problems::default();
            // Without a frame rate, sensors are not screened: the ends of all ranges together are a
            // sensor that is never drawn.
            let tree = self.with_values(tree, camera, &values);
            resolve_sensors(&tree, resolver, &found, BetweenFrames::Linear, None);
            for problem in found.into_inner() {
                let at = |number: &&DrawnNumber| Some(number.place) == problem.order();
                // A problem at another place does not come from a law, and the recipe's own resolution
                // reports it.
                let Some(number) = self.numbers.iter().find(at) else { continue };
                let mut known = resolver.problems.borrow_mut();
                if known.iter().all(|other| other.order() != Some(number.place)) {
                    known.push(problem.noting(&format!(" (the {name} end of its range)")));
                }
            }
        }
    }

    /// Keeps the first of several problems of one law.
    pub(super) fn keep_first(&self, problems: &Problems) {
        let mut seen = Vec::new();
        problems.borrow_mut().retain(|problem| {
            let place = problem.order();
            let repeated = seen.contains(&place) && self.numbers.iter().any(|n| Some(n.place) == place);
            seen.push(place);
            !repeated
        });
    }

    /// Draws the numbers of each trajectory, and resolves its sensors.
    pub(super) fn draw(
        &self,
        tree: &TreeNode,
        mut recipe: Recipe,
        resolver: &Resolver<'_>,
    ) -> Option<Recipe> {
        if self.numbers.is_empty() {
            return Some(recipe);
        }
        // A fault of a range would be a fault of many draws.
        if !resolver.problems.borrow().is_empty() {
            return None;
        }
        // All sensors have the same interpolation.
        let between = recipe.sensors.iter().map(|(_, sensor)| sensor.between()).next()?;
        let (seed, scene, rate) = (recipe.seed, &recipe.scene, recipe.rate);
        // The camera of the rig whose own sensor sees along a trajectory.
        let own = |trajectory: &TrajectoryRecipe| {
            let camera = &trajectory.mounted.as_deref()?.camera;
            camera.sensors.as_ref()?;
            recipe.rig.iter().position(|other| other.name == camera.name)
        };
        for trajectory in &mut recipe.trajectories {
            let camera = own(trajectory);
            if self.numbers_of(camera).next().is_none() {
                continue;
            }
            let stream = |number: &DrawnNumber| {
                Seed::for_parameter(seed, scene, &trajectory.name, &number.sensor, &number.path())
            };
            let values: Vec<f64> =
                self.numbers_of(camera).map(|number| number.law.draw(stream(number))).collect();
            let found = Problems::default();
            let tree = self.with_values(tree, camera, &values);
            let sensors = resolve_sensors(&tree, resolver, &found, between, Some(rate));
            let place = format!(" (drawn for the trajectory {})", trajectory.name);
            let problems = found.into_inner().into_iter().map(|problem| problem.noting(&place));
            resolver.problems.borrow_mut().extend(problems);
            let mut numbers: BTreeMap<String, BTreeMap<String, f64>> = BTreeMap::new();
            for (number, value) in self.numbers_of(camera).zip(values) {
                numbers.entry(number.sensor.clone()).or_default().insert(number.path(), value);
            }
            trajectory.drawn = Some(DrawnSensors { numbers, sensors: sensors? });
        }
        Some(recipe)
    }

    /// Writes the laws into the full form of a recipe, which has the medians.
    pub(super) fn write_laws(&self, merged: &mut Value) {
        for number in &self.numbers {
            let mut at = match (number.camera, number.sensor.as_str()) {
                (Some(camera), _) => &mut merged["rig"]["cameras"][camera]["sensor"],
                (None, "") => &mut merged["sensor"],
                (None, name) => &mut merged["sensors"][name],
            };
            for step in &number.steps {
                at = match at {
                    Value::Array(items) => {
                        let index = step.parse::<usize>().unwrap_or(usize::MAX);
                        match items.get_mut(index) {
                            Some(item) => item,
                            None => return,
                        }
                    }
                    // A section whose medians are all defaults is not written.
                    other => {
                        if !other.is_object() {
                            *other = Value::Object(Map::new());
                        }
                        &mut other[step.as_str()]
                    }
                };
            }
            *at = law::law_value(number.law);
        }
    }

    /// The numbers of the recipe's sensors, or of the sensor of a camera.
    fn numbers_of(&self, camera: Option<usize>) -> impl Iterator<Item = &DrawnNumber> {
        self.numbers.iter().filter(move |number| number.camera == camera)
    }

    /// A recipe with the sensors of a tree alone, or with the sensor of a camera, and these values in the
    /// place of the laws.
    fn with_values(&self, tree: &TreeNode, camera: Option<usize>, values: &[f64]) -> TreeNode {
        let mut sensors = Vec::new();
        for_each_sensor(&mut tree.clone(), &mut |(of, name), sensor| {
            if of == camera {
                sensors.push((name.to_owned(), sensor.clone()));
            }
        });
        let entry = |(name, value): (String, TreeNode)| MappingEntry { key: name, place: value.place, value };
        let mapping = |entries| TreeNode { place: tree.place, kind: NodeKind::Map(entries) };
        let mut out = match sensors.iter().any(|(name, _)| name.is_empty()) {
            true => mapping(sensors.into_iter().map(|(_, own)| entry(("sensor".to_owned(), own))).collect()),
            false => {
                let named = mapping(sensors.into_iter().map(entry).collect());
                mapping(vec![entry(("sensors".to_owned(), named))])
            }
        };
        // Laws with faults were left out of the list, and this counts the others.
        let mut rest = self.numbers_of(camera).zip(values).peekable();
        for_each_law(
            &mut out,
            &mut |_, _, node| match rest.next_if(|(number, _)| number.place == node.place) {
                Some((_, value)) => *node = law::number_node(*value, node.place),
                None => node.kind = NodeKind::Refused,
            },
        );
        out
    }
}

/// Reads and resolves the sensors of a tree.
fn resolve_sensors(
    tree: &TreeNode,
    resolver: &Resolver<'_>,
    problems: &Problems,
    between: BetweenFrames,
    rate: Option<Hertz>,
) -> Option<SensorSet> {
    let raw = schema::RecipeSchema::deserialize(TreeReader::new(tree, problems));
    let raw = raw.map_err(|problem: FieldProblem| problems.borrow_mut().push(problem)).ok()?;
    let own = Resolver { problems, folders: resolver.folders, root: resolver.root };
    own.sensors(&raw, Some(between), rate)
}

/// Where a tree has a sensor: the camera of its rig, or `None` for the recipe, and the name of the sensor,
/// which is empty for the only one.
type SensorPlace<'p> = (Option<usize>, &'p str);

/// A visitor of the laws of a tree: place of the sensor, path within it, and the value.
type LawVisitor<'v> = dyn FnMut(SensorPlace<'_>, &[String], &mut TreeNode) + 'v;

/// Visits each law of the sensors of a tree, in file order.
fn for_each_law(tree: &mut TreeNode, visit: &mut LawVisitor<'_>) {
    for_each_sensor(tree, &mut |sensor, node| visit_laws(node, sensor, &mut Vec::new(), visit));
}

/// Visits each sensor of a tree, in file order.
pub(super) fn for_each_sensor(tree: &mut TreeNode, visit: &mut dyn FnMut(SensorPlace<'_>, &mut TreeNode)) {
    for MappingEntry { key, value, .. } in entries_of(tree) {
        match key.as_str() {
            "sensor" => visit((None, ""), value),
            "sensors" => entries_of(value).iter_mut().for_each(|own| visit((None, &own.key), &mut own.value)),
            "rig" => {
                let cameras = entries_of(value).iter_mut().filter(|entry| entry.key == "cameras");
                let cameras = cameras.flat_map(|entry| match &mut entry.value.kind {
                    NodeKind::List(cameras) => cameras.as_mut_slice(),
                    _ => &mut [],
                });
                for (i, camera) in cameras.enumerate() {
                    let own = entries_of(camera).iter_mut().filter(|entry| entry.key == "sensor");
                    own.for_each(|own| visit((Some(i), ""), &mut own.value));
                }
            }
            _ => {}
        }
    }
}

/// The entries of a mapping; none of any other value.
fn entries_of(node: &mut TreeNode) -> &mut [MappingEntry] {
    match &mut node.kind {
        NodeKind::Map(entries) => entries,
        _ => &mut [],
    }
}

fn visit_laws(
    node: &mut TreeNode,
    sensor: SensorPlace<'_>,
    steps: &mut Vec<String>,
    visit: &mut LawVisitor<'_>,
) {
    // A law directly under a sensor's name is no number of a sensor, and the reader reports it.
    if is_law(node) && !steps.is_empty() {
        return visit(sensor, steps, node);
    }
    let mut descend = |step: String, value: &mut TreeNode| {
        steps.push(step);
        visit_laws(value, sensor, steps, visit);
        steps.pop();
    };
    match &mut node.kind {
        NodeKind::Map(entries) => entries.iter_mut().for_each(|e| descend(e.key.clone(), &mut e.value)),
        NodeKind::List(items) => {
            items.iter_mut().enumerate().for_each(|(i, item)| descend(i.to_string(), item));
        }
        NodeKind::Null | NodeKind::Scalar { .. } | NodeKind::Refused => {}
    }
}
