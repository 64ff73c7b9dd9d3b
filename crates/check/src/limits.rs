//! The `checks:` of a recipe: limits that differ from the defaults, and faults that are accepted
//! with a reason.

mod parse;

pub use parse::REASON;
use parse::{LimitsVisitor, parse_reason, pass_name, refusal_message};
pub(super) use parse::{not_asked, parse_positive, parse_share};

use super::table::check_table;
use super::{
    SCENE, affine, alignment, batching, capture, completeness, coverage, duplicates, event_frame, event_rate,
    flash, hot_pixels, motion, noise_floor, polarity, pose_colmap, pose_continuity, pose_opencv, readback,
    recon_psnr, sampling, speed, structure, time_offset,
};
use serde::de::MapAccess;
use serde::{Deserialize, Deserializer, Serialize};

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
    /// Name of the pass, one of [`NAMES`](crate::NAMES).
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NAMES;

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
