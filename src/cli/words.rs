//! Options with a few values, each with its name and a line of help, and options with several numbers.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use gs2e_render::RenderRules;
use std::str::FromStr;

/// A value of an option: its name, a line of help or nothing, and the value.
pub(super) type Word<T> = (&'static str, &'static str, T);

const OFFICIAL: Word<RenderRules> =
    ("official", "Published CUDA rasteriser: 3-sigma extents, rounded out to tiles", RenderRules::Official);
const EXACT: Word<RenderRules> =
    ("exact", "Every pixel where a layer's opacity reaches 1/255", RenderRules::Exact);
const GSPLAT: Word<RenderRules> = ("gsplat", "Conventions of gsplat", RenderRules::Gsplat);

/// The rule sets of published renderers.
pub(super) const RENDERED: [Word<RenderRules>; 4] = [
    OFFICIAL,
    EXACT,
    GSPLAT,
    (
        "soft",
        "Like exact, but layers fade in: opacity is a continuous function of the view",
        RenderRules::Soft,
    ),
];

/// The rule sets that can be trained.
pub(super) const TRAINED: [Word<RenderRules>; 4] = [
    ("soft", "Layers fade in: opacity is a continuous function of the view", RenderRules::Soft),
    OFFICIAL,
    EXACT,
    GSPLAT,
];

/// Reads `N` numbers, separated by commas.
pub(super) fn parse_numbers<T: FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// A parser of one of these values, by its name.
pub(super) fn one_of<T: Clone + Send + Sync>(words: &'static [Word<T>]) -> impl TypedValueParser<Value = T> {
    let shown = words.iter().map(|(name, help, _)| {
        let value = PossibleValue::new(*name);
        if help.is_empty() { value } else { value.help(*help) }
    });
    PossibleValuesParser::new(shown).map(|name| {
        let named = words.iter().find(|(known, ..)| *known == name);
        named.expect("the parser accepts these names only").2.clone()
    })
}
