//! Laws as written: `{ uniform: [a, b] }`, `{ log_uniform: [a, b] }`, or
//! `{ normal: [mean, sd], within: [a, b] }` in the place of a number.

use crate::problem::FieldProblem;
use crate::reader::parse_real;
use crate::text::TextSpan;
use crate::tree::{MappingEntry, NodeKind, TreeNode};
use gs2e_num::seed::range::RangeLaw;
use serde_json::{Value, json};

const KEYS: [&str; 4] = ["uniform", "log_uniform", "normal", "within"];
const HELP: &str =
    "write { uniform: [a, b] }, { log_uniform: [a, b] } or { normal: [mean, sd], within: [a, b] }";

/// Returns true if a value is written as a law. No other mapping of a sensor has these keys.
pub(crate) fn is_law(node: &TreeNode) -> bool {
    matches!(&node.kind, NodeKind::Map(entries) if entries.iter().any(|e| KEYS.contains(&e.key.as_str())))
}

/// Reads a law.
pub(super) fn parse_law(node: &TreeNode) -> Result<RangeLaw, FieldProblem> {
    let NodeKind::Map(entries) = &node.kind else {
        return Err(FieldProblem::of_field("is no law").help(HELP).at(node.place));
    };
    let numbers = |key: &str| entries.iter().find(|e| e.key == key).map(two_numbers).transpose();
    let keys: Vec<&str> = entries.iter().map(|e| e.key.as_str()).collect();
    let law = match keys.as_slice() {
        ["uniform"] => numbers("uniform")?.map(|[low, high]| RangeLaw::Uniform { low, high }),
        ["log_uniform"] => numbers("log_uniform")?.map(|[low, high]| RangeLaw::LogUniform { low, high }),
        ["normal", "within"] | ["within", "normal"] => numbers("normal")?
            .zip(numbers("within")?)
            .map(|([mean, deviation], [low, high])| RangeLaw::Normal { mean, deviation, low, high }),
        ["normal"] => {
            let found = "is normal without within: a normal law has no ends, and would leave any range";
            return Err(FieldProblem::of_field(found).help(HELP).at(node.place));
        }
        _ => None,
    };
    let law = law.ok_or_else(|| {
        let found = format!("has {}, wanted one law", keys.join(" and "));
        FieldProblem::of_field(found).help(HELP).at(node.place)
    })?;
    law.validate().map(|()| law).map_err(|found| FieldProblem::of_field(found).at(node.place))
}

/// Reads a list of two numbers.
fn two_numbers(entry: &MappingEntry) -> Result<[f64; 2], FieldProblem> {
    let real = |node: &TreeNode| match &node.kind {
        NodeKind::Scalar { text, plain: true } => parse_real(text),
        _ => None,
    };
    let found: Option<Vec<f64>> = match &entry.value.kind {
        NodeKind::List(items) => items.iter().map(real).collect(),
        _ => None,
    };
    let fault = || FieldProblem::of_field("wanted a list of two numbers").help(HELP).at(entry.value.place);
    found.and_then(|found| found.try_into().ok()).ok_or_else(fault)
}

/// A number in the place of a law.
pub(super) fn number_node(value: f64, place: TextSpan) -> TreeNode {
    // Rust writes as many digits as the same number needs, so the reader gets the drawn value back.
    TreeNode { place, kind: NodeKind::Scalar { text: value.to_string(), plain: true } }
}

/// The law in the full form of a recipe.
pub(super) fn law_value(law: RangeLaw) -> Value {
    match law {
        RangeLaw::Uniform { low, high } => json!({ "uniform": [low, high] }),
        RangeLaw::LogUniform { low, high } => json!({ "log_uniform": [low, high] }),
        RangeLaw::Normal { mean, deviation, low, high } => {
            json!({ "normal": [mean, deviation], "within": [low, high] })
        }
    }
}
