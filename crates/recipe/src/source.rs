//! The source of a scene's poses, with the statements of the recipe about its origin.

use super::UpstreamOrigin;
use super::canonical::time_value;
use super::schema::SourceSection;
use gs2e_demo::{Fountain, StillLife};
use gs2e_source::DiskCapture;
use gs2e_source::kind::SourceKind;
use gs2e_source::licence::ledger;
use gs2e_source::solving::PoseSolving;
use serde_json::{Map, Value, json};

/// The source of poses. Paths are resolved against the recipe's folder.
#[derive(Debug, Clone, PartialEq)]
pub enum SceneSource {
    /// The built-in procedural scene.
    Procedural(StillLife),
    /// A capture on disk, with the recipe's statements about its origin.
    Captured(DiskCapture, UpstreamOrigin),
    /// No source: the recipe itself contains the trajectories, and the Gaussians come from a scene
    /// file.
    None,
}

impl SceneSource {
    /// Kind of the source.
    #[must_use]
    pub fn kind(&self) -> SourceKind {
        match self {
            Self::Procedural(_) => SourceKind::Procedural,
            Self::Captured(captured, _) => SourceKind::Captured(captured.kind),
            Self::None => SourceKind::None,
        }
    }

    /// The capture, if the source is one.
    #[must_use]
    pub fn captured(&self) -> Option<&DiskCapture> {
        match self {
            Self::Captured(captured, _) => Some(captured),
            Self::Procedural(_) | Self::None => None,
        }
    }

    /// The recipe's statements about the origin of a capture.
    #[must_use]
    pub fn upstream(&self) -> Option<&UpstreamOrigin> {
        match self {
            Self::Captured(_, upstream) => Some(upstream),
            Self::Procedural(_) | Self::None => None,
        }
    }

    /// Name of the kind of the source's origin, and the id that the upstream gives to this capture.
    #[must_use]
    pub fn origin(&self) -> (&'static str, Option<&str>) {
        let upstream = self.upstream();
        let kind = ledger::find_origin(self.kind(), upstream.and_then(|upstream| upstream.url.as_deref()));
        (kind.name(), upstream.and_then(|upstream| upstream.id.as_deref()))
    }

    /// Returns true if the views of the source are photographs.
    #[must_use]
    pub fn has_photos(&self) -> bool {
        self.captured().is_some()
    }

    /// Returns true if installed programs find its poses.
    #[must_use]
    pub fn runs_programs(&self) -> bool {
        self.captured().is_some_and(|captured| captured.solving.is_some())
    }

    /// Returns true if the source has views, and therefore a camera.
    #[must_use]
    pub fn has_views(&self) -> bool {
        *self != Self::None
    }

    /// The source in a recipe's full form. `raw` supplies the path of a capture as written.
    pub(super) fn written(&self, raw: Option<&SourceSection>) -> Value {
        match self {
            Self::Procedural(still_life) => {
                // The fields of the still life have the names that recipes use.
                let mut fields = Map::from_iter([("kind".to_owned(), json!("still-life"))]);
                if let Ok(Value::Object(rest)) = serde_json::to_value(still_life) {
                    fields.extend(rest);
                }
                if let Some(Fountain { drops, time }) = &still_life.fountain {
                    let fountain = json!({ "drops": drops, "time": time_value(time) });
                    fields.insert("fountain".to_owned(), fountain);
                }
                json!({ "procedural": fields })
            }
            Self::Captured(captured, upstream) => {
                let (path, _) = raw.and_then(SourceSection::paths).unwrap_or_default();
                let mut fields = Map::from_iter([("path".to_owned(), json!(path))]);
                if let Ok(Value::Object(rest)) = serde_json::to_value(&captured.selection) {
                    fields.extend(rest);
                }
                if let Some(solving) = &captured.solving {
                    fields.extend(written_solving(solving, raw));
                }
                let UpstreamOrigin { id, url, accessed, terms_accepted } = upstream;
                let said = [
                    ("upstream_id", json!(id)),
                    ("upstream_url", json!(url)),
                    ("accessed", json!(accessed)),
                    ("terms_accepted", json!(terms_accepted)),
                ];
                let said = said.into_iter().filter(|(_, value)| !value.is_null());
                fields.extend(said.map(|(key, value)| (key.to_owned(), value)));
                json!({ captured.kind.name(): fields })
            }
            Self::None => json!("none"),
        }
    }
}

/// The settings of the search for poses, by their keys in a recipe.
fn written_solving(solving: &PoseSolving, raw: Option<&SourceSection>) -> Map<String, Value> {
    let mut fields = Map::new();
    let mut add = |value: Value| {
        if let Value::Object(rest) = value {
            fields.extend(rest.into_iter().filter(|(_, value)| !value.is_null()));
        }
    };
    let (_, vocabulary) = raw.and_then(SourceSection::paths).unwrap_or_default();
    add(json!({ "vocabulary": vocabulary, "registered": solving.registered }));
    add(json!(solving));
    add(json!(solving.frames));
    fields
}
