//! Sentences on how the data of a release were made. They follow from the scene records: no sentence
//! names a sensor, a picture or a source that the release does not have.

use super::scene::{SceneRecord, SensorPart, TrajectoryPart};
use gs2e_sensor::SensorChoice;
use gs2e_source::kind::SourceKind;
use serde_json::Value;
use std::collections::BTreeSet;

/// The means by which the trajectories of a release were made.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Provenance {
    /// Models of the sensors whose events were simulated, as in `scene.json`.
    models: BTreeSet<String>,
    /// True if some scenes are captures, of photos that exist.
    captured: bool,
    /// True if some scenes name photos.
    photos: bool,
    /// True if frames are rendered: for a sensor, or as pictures.
    rendered: bool,
    /// True if objects move in some scenes, or some scenes change with time.
    moving: bool,
    /// True if some trajectories carry several cameras.
    rigs: bool,
}

impl Provenance {
    pub(super) fn of<'s>(scenes: impl Iterator<Item = &'s SceneRecord>) -> Self {
        let mut of = Self::default();
        for scene in scenes {
            of = of.with_models(&scene.trajectories);
            let outputs = scene.recipe["outputs"].as_array().map_or(0, Vec::len);
            of.rendered |= outputs > 0;
            // A kind that this version does not know is taken for a capture.
            let kind = SourceKind::by_name(&scene.source.kind);
            of.captured |= kind.is_none_or(|kind| kind.captured().is_some());
            of.photos |= !scene.images.is_empty();
            let states = |place: &str| scene.recipe.pointer(place).is_some();
            // A new way to move things in a recipe belongs into this list, or the texts call its scenes
            // static.
            of.moving |= ["/objects", "/reconstruct/given/time", "/source/procedural/fountain"]
                .into_iter()
                .any(states);
            of.rigs |= states("/rig");
        }
        of
    }

    /// True if nothing but cameras moves.
    pub(super) fn is_static(&self) -> bool {
        !self.moving
    }

    /// True if there are simulated events.
    pub(super) fn has_events(&self) -> bool {
        !self.models.is_empty()
    }

    /// Each model of a sensor that was used, with its publication.
    pub(super) fn models(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let used = SensorChoice::FAMILY.into_iter().filter(|facts| self.models.contains(facts.name));
        used.map(|facts| (facts.title, facts.publication))
    }

    /// The simulated devices of a scene: `3DGS + DVS-Voltmeter`.
    pub(super) fn device(trajectories: &[TrajectoryPart]) -> String {
        let of = Self::default().with_models(trajectories);
        std::iter::once("3DGS").chain(of.models().map(|(name, _)| name)).collect::<Vec<_>>().join(" + ")
    }

    fn with_models(mut self, trajectories: &[TrajectoryPart]) -> Self {
        let models = trajectories.iter().flat_map(sensors_of).filter_map(|sensor| sensor["model"].as_str());
        self.models.extend(models.map(str::to_owned));
        self
    }

    /// The origin of the data.
    pub(super) fn collection(&self) -> String {
        let making = if self.has_events() {
            "Events are simulated: a scene of 3D Gaussians is rendered along a dense camera path, and the model of an event \
             sensor processes the luminance of the renderings."
        } else if self.rendered {
            "Pictures are rendered from a scene of 3D Gaussians along a camera path."
        } else {
            "Camera paths are computed; nothing is rendered."
        };
        format!(
            "{making} The build is deterministic. Every step, with its parameters and the digests of its inputs, is in \
             manifest.json."
        )
    }

    /// Known limits of the data.
    pub(super) fn limits(&self) -> String {
        let mut text = vec![if self.moving {
            "Some scenes move or change as their recipes state; an object that moves casts no shadow."
        } else {
            "Scenes are static; only the camera moves."
        }];
        if self.rendered {
            text.push(
                "Splatting artefacts (floaters, popping where the depth order changes, the smallest opacity of 1/255) \
                 are visible in the renderings.",
            );
        }
        if self.has_events() {
            text.push(
                "They also affect the brightness that the sensor sees, and thus the events. Sensor effects, such as a \
                 bandwidth limit, a refractory period or a mismatch between pixels, are simulated only where the recipe \
                 sets them. Between two frames the brightness is interpolated; `sampling` in `checks.json` reports the motion of \
                 the picture from frame to frame.",
            );
        }
        text.push("The poses are exactly those used in the computation.");
        if self.captured {
            text.push(
                "The poses of a capture are as good as its reconstruction. The unit of length of a capture is arbitrary, and \
                 the upward direction is unknown.",
            );
        }
        if self.captured && self.rendered {
            text.push("Brightness beyond the range of the training photos is unknown.");
        }
        if self.photos {
            text.push("Photos are listed by name and SHA-256; they are not in the release.");
        }
        text.join(" ")
    }

    /// Uses for which the data are meant.
    pub(super) fn uses(&self) -> &'static str {
        if self.has_events() {
            "Training and evaluation of methods that use events: reconstruction of scenes and of intensity, pose estimation, \
             deblurring, frame interpolation. The data do not replace real recordings for methods that will run on those."
        } else {
            "Training and evaluation of methods that use views with exact poses."
        }
    }

    /// Known biases.
    pub(super) fn biases(&self) -> String {
        let scenes = if self.moving { "Some scenes move or change" } else { "Scenes are static" };
        let cameras = if self.rigs { "rigs of cameras move" } else { "one camera moves" };
        let mut text = format!("{scenes}, and {cameras} through them along smooth paths.");
        if self.captured && self.rendered {
            text.push_str(" The lighting is that of the captures.");
        }
        if self.has_events() {
            text.push_str(
                " Sensors are models with stated parameters, and their noise is that of the model.",
            );
        }
        text
    }
}

/// Records of the sensors of a trajectory.
fn sensors_of(part: &TrajectoryPart) -> impl Iterator<Item = &Value> {
    part.sensor.iter().chain(part.sensors.values().map(|SensorPart { sensor, .. }| sensor))
}
