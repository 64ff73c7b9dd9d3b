//! The `checks:` of a recipe: limits that differ from the defaults, and faults that are accepted
//! with a reason.

use super::table::check_table;
use super::{
    NAMES, SCENE, TREE, affine, alignment, batching, capture, completeness, coverage, duplicates,
    event_frame, event_rate, hot_pixels, motion, noise_floor, polarity, pose_colmap, pose_continuity,
    pose_opencv, readback, recon_psnr, sampling, speed, structure, time_offset,
};
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// Declares the limits of the checks: one field and one key per check that has any, and the type of
/// the key's value.
macro_rules! limits_of {
    ($($name:ident ($(exact $exact:ident)? $(limits $limits:ident)?) ($($subject:tt)*) $advice:literal;)+) => {
        /// The `checks:` of a recipe: limits that differ from the defaults, and accepted faults.
        #[derive(Debug, Clone, PartialEq, Default, Serialize)]
        #[expect(missing_docs, reason = "each field is named like the check whose limits it holds")]
        pub struct Limits {
            $($(#[serde(skip_serializing_if = "Option::is_none")] pub $limits: Option<$limits::Limits>,)?)+
            /// Accepted faults, each with its reason.
            #[serde(skip_serializing_if = "Vec::is_empty")]
            pub waive: Vec<CheckWaiver>,
        }

        /// Keys of `checks:` that this version knows.
        const KEYS: &[&str] = &[$($(stringify!($limits),)?)+ "waive"];

        /// Checks without limits: their results are right or wrong.
        const EXACT: &[&str] = &[$($(stringify!($exact),)?)+];

        impl Limits {
            fn read<'de, A: MapAccess<'de>>(&mut self, key: &str, map: &mut A) -> Result<(), A::Error> {
                match key {
                    $($(stringify!($limits) => self.$limits = Some(map.next_value()?),)?)+
                    "waive" => self.waive = map.next_value()?,
                    other => return Err(refusal_message(other)),
                }
                Ok(())
            }
        }
    };
}

check_table!(limits_of);

/// An accepted fault.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckWaiver {
    /// Name of the pass, one of [`NAMES`].
    #[serde(deserialize_with = "pass_name")]
    pub check: String,
    /// The reason for accepting it; not empty.
    #[serde(deserialize_with = "parse_reason")]
    pub because: String,
}

impl Limits {
    /// The limits of the passes over trajectories.
    #[must_use]
    pub fn of_trajectory(&self) -> Self {
        let mut waive = self.waive.clone();
        // A limit of another stage must not enter the key of this one.
        waive.retain(|waiver| !SCENE.contains(&waiver.check.as_str()));
        Self { recon_psnr: None, capture: None, waive, ..self.clone() }
    }

    /// Returns true if other programs are asked.
    #[must_use]
    pub fn asks_programs(&self) -> bool {
        self.pose_colmap.is_some() || self.pose_opencv.is_some() || self.readback.is_some()
    }

    /// The limits of the passes over scenes.
    #[must_use]
    pub fn of_scene(&self) -> Self {
        let mut waive = self.waive.clone();
        waive.retain(|waiver| SCENE.contains(&waiver.check.as_str()));
        Self { recon_psnr: self.recon_psnr, capture: self.capture, waive, ..Self::default() }
    }
}

impl<'de> Deserialize<'de> for Limits {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(LimitsVisitor)
    }
}

struct LimitsVisitor;

impl<'de> Visitor<'de> for LimitsVisitor {
    type Value = Limits;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a mapping from check names to limits")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Limits, A::Error> {
        let mut limits = Limits::default();
        let mut seen = Vec::new();
        while let Some(key) = map.next_key::<String>()? {
            // A derived implementation refuses a repeated key; this one must do so itself.
            if seen.contains(&key) {
                return Err(A::Error::custom(format_args!("duplicate field `{key}`")));
            }
            limits.read(&key, &mut map)?;
            seen.push(key);
        }
        Ok(limits)
    }
}

fn refusal_message<E: Error>(key: &str) -> E {
    // The name is known, so the message for unknown fields would mislead.
    if EXACT.contains(&key) {
        E::custom(format_args!(
            "the check `{key}` has no limit to set: it is exact, or its limits follow from the data"
        ))
    } else {
        E::unknown_field(key, KEYS)
    }
}

fn pass_name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    // A misspelt name would accept nothing, and not say so.
    let known: Vec<&str> = NAMES.into_iter().filter(|name| !TREE.contains(name)).collect();
    if known.contains(&name.as_str()) {
        Ok(name)
    } else {
        Err(D::Error::custom(format_args!("no check is named `{name}`; the checks are {}", known.join(", "))))
    }
}

fn parse_reason<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let because = String::deserialize(deserializer)?;
    if because.trim().is_empty() {
        return Err(D::Error::custom("a check is waived only with a reason, and this one is empty"));
    }
    Ok(because)
}

/// The reason for not running a pass of another program that the recipe does not request.
pub(super) fn not_asked(name: &str) -> String {
    format!("the recipe does not request it; `checks: {{ {name}: {{}} }}` does")
}

/// A limit: a finite number above zero.
pub(super) fn parse_positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    let limit = f64::deserialize(deserializer)?;
    if limit.is_finite() && limit > 0.0 {
        Ok(Some(limit))
    } else {
        Err(D::Error::custom(format_args!("a limit is a finite number above 0, not {limit}")))
    }
}

/// A share: a number from 0 to 1.
pub(super) fn parse_share<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    let limit = f64::deserialize(deserializer)?;
    if (0.0..=1.0).contains(&limit) {
        Ok(Some(limit))
    } else {
        Err(D::Error::custom(format_args!("a share is a number from 0 to 1, not {limit}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(json: &str) -> Result<Limits, String> {
        serde_json::from_str(json).map_err(|e| e.to_string())
    }

    #[test]
    fn limits_are_read_by_the_pass_they_name() {
        let limits = parse(
            r#"{"event_rate": {"max": 5000}, "sampling": {"max": 1},
                "waive": [{"check": "speed", "because": "a test"}]}"#,
        )
        .unwrap();
        assert_eq!(limits.event_rate.unwrap().max, Some(5000.0));
        assert_eq!(limits.sampling.unwrap().max, Some(1.0));
        assert_eq!(limits.waive[0].check, "speed");
        let text = serde_json::to_string(&limits).unwrap();
        assert_eq!(parse(&text).unwrap(), limits);
        assert_eq!(serde_json::to_string(&Limits::default()).unwrap(), "{}");
    }

    #[test]
    fn a_step_reads_the_limits_of_its_own_passes() {
        let of = |json: &str| {
            let limits = parse(json).unwrap();
            [limits.of_trajectory(), limits.of_scene()].map(|l| serde_json::to_string(&l).unwrap())
        };
        let [trajectory, scene] =
            of(r#"{"sampling": {"max": 1}, "recon_psnr": {"drop": 2}, "capture": {"gap": 9},
            "waive": [{"check": "speed", "because": "a"}, {"check": "capture", "because": "b"}]}"#);
        assert_eq!(trajectory, r#"{"sampling":{"max":1.0},"waive":[{"check":"speed","because":"a"}]}"#);
        let wanted = r#"{"recon_psnr":{"drop":2.0},"capture":{"gap":9.0},"waive":[{"check":"capture","because":"b"}]}"#;
        assert_eq!(scene, wanted);
    }

    #[test]
    fn what_cannot_be_meant_is_refused_by_name() {
        let t = |json: &str, wanted: &str| {
            let message = parse(json).unwrap_err();
            assert!(message.contains(wanted), "{json}: {message}");
        };
        t(r#"{"schema": {}}"#, "`schema` has no limit");
        t(r#"{"eventrate": {}}"#, "unknown field `eventrate`");
        t(r#"{"sampling": {"most": 1}}"#, "unknown field `most`");
        t(r#"{"sampling": {"max": -1}}"#, "above 0, not -1");
        t(r#"{"polarity": {"max": 1.5}}"#, "from 0 to 1, not 1.5");
        t(r#"{"sampling": {}, "sampling": {}}"#, "duplicate field `sampling`");
        t(r#"{"waive": [{"check": "spped", "because": "x"}]}"#, "no check is named `spped`");
        t(r#"{"waive": [{"check": "speed", "because": " "}]}"#, "with a reason");
        t(r#"{"waive": [{"check": "speed"}]}"#, "missing field `because`");
    }

    #[test]
    fn every_name_is_a_key_or_an_exact_pass() {
        for name in NAMES {
            let message = parse(&format!(r#"{{"{name}": {{"nonsense": 1}}}}"#)).unwrap_err();
            let expected = if EXACT.contains(&name) { "has no limit" } else { "unknown field `nonsense`" };
            assert!(message.contains(expected), "{name}: {message}");
        }
    }
}
