//! Numbers of sensors that are drawn for each trajectory.
//!
//! A law stands in the place of a number. The tree is resolved once with the medians, for
//! everything that concerns the scene as a whole; once with all lower and once with all upper ends,
//! which shows if a range leaves the range of its parameter; and once for each trajectory, with the
//! numbers drawn for it.

mod law;
mod preset;

pub(super) use law::is_law;
pub(super) use preset::RANDOMISED;

use super::problem::FieldProblem;
use super::reader::{Problems, TreeReader};
use super::resolve::Resolver;
use super::text::TextSpan;
use super::tree::{MappingEntry, NodeKind, TreeNode};
use super::{MountedPath, Recipe, schema};
use crate::seed::Seed;
use crate::seed::range::RangeLaw;
use crate::sensor::SensorSet;
use crate::sensor::voltmeter::BetweenFrames;
use crate::units::Hertz;
use serde::Deserialize as _;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

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
        for_each_law(&mut middle, &mut |sensor, steps, node| match law::parse_law(node) {
            Ok(law) => {
                let (sensor, steps) = (sensor.to_owned(), steps.to_vec());
                numbers.push(DrawnNumber { sensor, steps, place: node.place, law });
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
        for (end, name) in ["lower", "upper"].into_iter().enumerate() {
            let values: Vec<f64> = self.numbers.iter().map(|number| number.law.ends()[end]).collect();
            let found = Problems::default();
            // Without a frame rate, sensors are not screened: the ends of all ranges together are a
            // sensor that is never drawn.
            resolve_sensors(
                &self.with_values(tree, &values),
                resolver,
                &found,
                (BetweenFrames::Linear, None),
            );
            for problem in found.into_inner() {
                let at = |number: &&DrawnNumber| Some(number.place) == problem.order();
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
        let own = |mounted: &MountedPath| mounted.camera.sensors.is_some();
        let (_, drawn): (Vec<_>, Vec<_>) =
            recipe.trajectories.iter_mut().partition(|t| t.mounted.as_deref().is_some_and(own));
        for trajectory in drawn {
            let stream = |number: &DrawnNumber| {
                Seed::for_parameter(seed, scene, &trajectory.name, &number.sensor, &number.path())
            };
            let values: Vec<f64> =
                self.numbers.iter().map(|number| number.law.draw(stream(number))).collect();
            let found = Problems::default();
            let tree = self.with_values(tree, &values);
            let sensors = resolve_sensors(&tree, resolver, &found, (between, Some(rate)));
            let place = format!(" (drawn for the trajectory {})", trajectory.name);
            let problems = found.into_inner().into_iter().map(|problem| problem.noting(&place));
            resolver.problems.borrow_mut().extend(problems);
            let mut numbers: BTreeMap<String, BTreeMap<String, f64>> = BTreeMap::new();
            for (number, value) in self.numbers.iter().zip(values) {
                numbers.entry(number.sensor.clone()).or_default().insert(number.path(), value);
            }
            trajectory.drawn = Some(DrawnSensors { numbers, sensors: sensors? });
        }
        Some(recipe)
    }

    /// Writes the laws into the full form of a recipe, which has the medians.
    pub(super) fn write_laws(&self, merged: &mut Value) {
        for number in &self.numbers {
            let mut at = match number.sensor.as_str() {
                "" => &mut merged["sensor"],
                name => &mut merged["sensors"][name],
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

    /// The sensors of a tree with these values in the place of the laws.
    fn with_values(&self, tree: &TreeNode, values: &[f64]) -> TreeNode {
        let mut out = sensors_of(tree);
        // Laws with faults were left out of the list, and this counts the others.
        let mut rest = self.numbers.iter().zip(values).peekable();
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

/// Removes the preset `randomised` from the sensors of a tree. Returns a recipe with the ranges of
/// the presets, as YAML; empty without such a preset.
pub(super) fn take_presets(tree: &mut TreeNode) -> String {
    let mut ranges = String::new();
    let indented = |text: &str, depth: usize| -> String {
        text.lines().map(|line| format!("{}{line}\n", " ".repeat(depth))).collect()
    };
    let NodeKind::Map(entries) = &mut tree.kind else { return ranges };
    for MappingEntry { key, value, .. } in entries {
        match (key.as_str(), &mut value.kind) {
            ("sensor", _) => {
                if let Some((model, found)) = preset::take_preset(value) {
                    ranges += &format!("sensor:\n  {model}:\n{}", indented(found, 4));
                }
            }
            ("sensors", NodeKind::Map(sensors)) => {
                let named: String = sensors
                    .iter_mut()
                    .filter_map(|sensor| Some((preset::take_preset(&mut sensor.value)?, &sensor.key)))
                    // A quoted key takes any name.
                    .map(|((model, found), name)| {
                        let name = Value::from(name.as_str());
                        format!("  {name}:\n    {model}:\n{}", indented(found, 6))
                    })
                    .collect();
                if !named.is_empty() {
                    ranges += &format!("sensors:\n{named}");
                }
            }
            _ => {}
        }
    }
    ranges
}

/// The keys of a tree that hold sensors.
fn sensors_of(tree: &TreeNode) -> TreeNode {
    let NodeKind::Map(entries) = &tree.kind else { return tree.clone() };
    let kept = entries.iter().filter(|entry| ["sensor", "sensors"].contains(&entry.key.as_str()));
    TreeNode { place: tree.place, kind: NodeKind::Map(kept.cloned().collect()) }
}

/// Reads and resolves the sensors of a tree.
fn resolve_sensors(
    tree: &TreeNode,
    resolver: &Resolver<'_>,
    problems: &Problems,
    (between, rate): (BetweenFrames, Option<Hertz>),
) -> Option<SensorSet> {
    let raw = schema::RecipeSchema::deserialize(TreeReader::new(tree, problems));
    let raw = raw.map_err(|problem: FieldProblem| problems.borrow_mut().push(problem)).ok()?;
    let own = Resolver { problems, folders: resolver.folders, root: resolver.root };
    own.sensors(&raw, Some(between), rate)
}

/// A visitor of the laws of a tree: name of the sensor, path within it, and the value.
type LawVisitor<'v> = dyn FnMut(&str, &[String], &mut TreeNode) + 'v;

/// Visits each law of the sensors of a tree, in file order.
fn for_each_law(tree: &mut TreeNode, visit: &mut LawVisitor<'_>) {
    let NodeKind::Map(entries) = &mut tree.kind else { return };
    for MappingEntry { key, value, .. } in entries {
        match (key.as_str(), &mut value.kind) {
            ("sensor", _) => visit_laws(value, "", &mut Vec::new(), visit),
            ("sensors", NodeKind::Map(sensors)) => {
                for sensor in sensors {
                    visit_laws(&mut sensor.value, &sensor.key, &mut Vec::new(), visit);
                }
            }
            _ => {}
        }
    }
}

fn visit_laws(node: &mut TreeNode, sensor: &str, steps: &mut Vec<String>, visit: &mut LawVisitor<'_>) {
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
