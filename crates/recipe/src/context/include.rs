//! `include:` of `release.yaml`: the exports that a release has besides its own files.

use crate::field::Field;
use crate::names;
use crate::problem::FieldProblem;
use crate::resolve::{Resolver, all, resolved};
use crate::text::TextSpan;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Names of the formats of exports, in the order of their documentation.
pub const EXPORT_FORMATS: [&str; 20] = [
    "e-nerf",
    "event-3dgs",
    "colmap",
    "eventnerf",
    "e-3dgs",
    "robust-e-nerf",
    "deblur-e-nerf",
    "evdeblurnerf",
    "llff",
    "e2nerf",
    "e2gs",
    "inceventgs",
    "monash-h5",
    "e2vid",
    "e2vid-zip",
    "evreal",
    "dsec",
    "webdataset",
    "parquet",
    "mcap",
];

/// Spacing of the held-out frames, where no other is asked for.
pub const HELD_OUT_EVERY: u32 = 8;

/// An export that a release has, of one trajectory of each scene or of all of them.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IncludedExport {
    /// Name of the format.
    pub format: String,
    /// Name of the trajectory. Without it, every trajectory is exported, except for the one in
    /// `test_from`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trajectory: Option<String>,
    /// Name of the sensor, for trajectories with several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// Every n-th sharp frame is held out; default [`HELD_OUT_EVERY`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_every: Option<u32>,
    /// The trajectory whose sharp frames are held out instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_from: Option<String>,
    /// True if approximate properties are accepted.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub lossy: bool,
}

impl IncludedExport {
    /// Returns true if a trajectory of this name is exported.
    #[must_use]
    pub fn covers(&self, trajectory: &str) -> bool {
        match &self.trajectory {
            Some(name) => name == trajectory,
            None => self.test_from.as_deref() != Some(trajectory),
        }
    }
}

/// An item of the list: the name of a format, or a mapping with options.
#[derive(Debug)]
pub(super) enum RawInclude {
    Name(String),
    Entry(IncludeEntry),
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct IncludeEntry {
    format: Field<String>,
    trajectory: Field<String>,
    sensor: Field<String>,
    test_every: Field<u32>,
    test_from: Field<String>,
    lossy: Field<bool>,
}

impl<'de> Deserialize<'de> for RawInclude {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct IncludeVisitor;

        impl<'de> Visitor<'de> for IncludeVisitor {
            type Value = RawInclude;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the name of a format, or a mapping with `format`")
            }

            fn visit_str<E>(self, name: &str) -> Result<RawInclude, E> {
                Ok(RawInclude::Name(name.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, entries: A) -> Result<RawInclude, A::Error> {
                IncludeEntry::deserialize(MapAccessDeserializer::new(entries)).map(RawInclude::Entry)
            }
        }

        deserializer.deserialize_any(IncludeVisitor)
    }
}

const HELP: &str = "write include: [robust-e-nerf], or include: [{ format: e-nerf, lossy: true }]";

/// Resolves the list; empty if it is absent.
pub(super) fn resolve_include(
    field: &Field<Vec<Field<RawInclude>>>,
    resolver: &Resolver<'_>,
) -> Option<Vec<IncludedExport>> {
    let Some((raw, _)) = field.given() else { return field.is_absent().then(Vec::new) };
    let items: Vec<(IncludedExport, TextSpan)> = all(raw, |item| {
        let (item, place) = item.given()?;
        Some((resolve_item(item, place, resolver)?, place))
    })?;
    for (at, (item, place)) in items.iter().enumerate() {
        if items[..at].iter().any(|(other, _)| share_folder(item, other)) {
            let message = format!("{} is included twice for one trajectory", item.format);
            let help = "a trajectory has one export of a format; give each entry a `trajectory` of its own";
            return resolver.refuse(FieldProblem::new(message).help(help).at(*place));
        }
    }
    Some(items.into_iter().map(|(item, _)| item).collect())
}

/// Returns true if both exports of one trajectory would have the same folder.
fn share_folder(one: &IncludedExport, other: &IncludedExport) -> bool {
    // An entry without a trajectory covers all of them, so only two names can keep entries apart.
    let apart =
        one.trajectory.as_ref().zip(other.trajectory.as_ref()).is_some_and(|(one, other)| one != other);
    one.format == other.format && !apart
}

fn resolve_item(item: &RawInclude, place: TextSpan, resolver: &Resolver<'_>) -> Option<IncludedExport> {
    let entry = match item {
        RawInclude::Name(name) => {
            let format = known_format(name, place, resolver)?;
            return Some(IncludedExport { format, ..IncludedExport::default() });
        }
        RawInclude::Entry(entry) => entry,
    };
    let format = resolver.required(&entry.format, "format", place, HELP);
    let name = |field: &Field<String>| field.optional(|name| known_name(name, resolver));
    resolved!(IncludedExport {
        format: format.and_then(|(name, place)| known_format(name, place, resolver)),
        trajectory: name(&entry.trajectory),
        sensor: name(&entry.sensor),
        test_from: name(&entry.test_from),
        test_every: entry.test_every.optional(|every| {
            let (every, at) = every.given()?;
            if *every < 2 {
                let problem = FieldProblem::of_field(format!("is {every}, wanted at least 2"));
                return resolver.refuse(problem.at(at));
            }
            if let Some(Some(_)) = test_from {
                let message = "test_every and test_from exclude each other";
                return resolver.refuse(FieldProblem::new(message).help("remove one of them").at(place));
            }
            Some(*every)
        }),
        lossy: entry.lossy.or(false),
    })
}

fn known_format(name: &str, place: TextSpan, resolver: &Resolver<'_>) -> Option<String> {
    if EXPORT_FORMATS.contains(&name) {
        return Some(name.to_owned());
    }
    resolver.refuse(FieldProblem::unknown_name("format", name, &EXPORT_FORMATS).at(place))
}

/// The name of a trajectory or of a sensor. Both have one form.
fn known_name(field: &Field<String>, resolver: &Resolver<'_>) -> Option<String> {
    let (name, place) = field.given()?;
    match names::check_sensor(name) {
        Ok(()) => Some(name.clone()),
        Err(because) => resolver
            .refuse(FieldProblem::of_field(format!("is \"{}\", {because}", name.escape_default())).at(place)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(trajectory: Option<&str>, test_from: Option<&str>) -> IncludedExport {
        IncludedExport {
            format: "colmap".into(),
            trajectory: trajectory.map(str::to_owned),
            sensor: None,
            test_every: None,
            test_from: test_from.map(str::to_owned),
            lossy: false,
        }
    }

    #[test]
    fn an_entry_covers_its_trajectory_or_all_but_the_held_out_one() {
        let t = |of: &IncludedExport, wanted: [bool; 2]| {
            assert_eq!(["base", "held"].map(|name| of.covers(name)), wanted, "{of:?}");
        };
        t(&entry(None, None), [true, true]);
        t(&entry(Some("base"), None), [true, false]);
        t(&entry(None, Some("held")), [true, false]);
        t(&entry(Some("base"), Some("held")), [true, false]);
    }

    #[test]
    fn entries_of_one_format_need_trajectories_of_their_own() {
        assert!(share_folder(&entry(None, None), &entry(Some("base"), None)));
        assert!(share_folder(&entry(Some("base"), None), &entry(Some("base"), None)));
        assert!(!share_folder(&entry(Some("base"), None), &entry(Some("slow"), None)));
    }
}
