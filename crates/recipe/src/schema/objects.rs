//! Objects as written: the source of the Gaussians, and a path.
//!
//! ```yaml
//! objects:
//!   - name: apple                       # Gaussians of the scene
//!     select: { sphere: { centre: [0.3, -0.2, 0], radius: 0.2 } }
//!     path: { orbit: { centre: [0, 0, 0], axis: [0, -1, 0], degrees_per_second: 90 } }
//!   - name: cup                         # a scene of its own, placed in this one
//!     scene: { path: cup.ply, at: [0, 0, 1], turn: [0, 90, 0], scale: 0.5 }
//!     path:
//!       keyframes:
//!         - { at: 0 }
//!         - { at: 0.5, shift: [0.3, 0, 0], turn: [0, 45, 0] }
//! ```

use super::super::field::Field;
use serde::Deserialize;

/// An object: its Gaussians, by `select` or `scene`, and its path. [scene.md](scene.md#moving-objects)
/// describes them.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ObjectSection {
    /// Name: letters, digits, `.`, `_` and `-`. Range: at most 100 bytes. Required.
    pub name: Field<String>,
    /// The Gaussians of the scene that move. Default: none; required without `scene`.
    pub select: Field<SelectSection>,
    /// Another scene that is placed in this one. Default: none; required without `select`.
    pub scene: Field<PlacedSection>,
    /// Path of the object. Required.
    pub path: Field<ObjectPathSection>,
    /// Point about which the object turns, world coordinates at rest. Unit: scene units. Default: the mean of
    /// its means.
    pub pivot: Field<[Field<f64>; 3]>,
}

/// Gaussians of the scene, by their means or by their numbers.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SelectSection {
    /// Those with a mean in a box.
    Box(Field<BoxSection>),
    /// Those with a mean in a ball.
    Sphere(Field<SphereSection>),
    /// Those with the numbers in a file, one a line, from 0 in the order of the scene file. The path is
    /// relative to the recipe.
    Ids(Field<String>),
}

/// A box along the axes of the world: `box: { low: [0, 0, 0], high: [1, 1, 1] }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct BoxSection {
    /// Least corner. Unit: scene units. Required.
    pub low: Field<[Field<f64>; 3]>,
    /// Greatest corner. Unit: scene units. Required.
    pub high: Field<[Field<f64>; 3]>,
}

/// A ball: `sphere: { centre: [0, 0, 0], radius: 1 }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct SphereSection {
    /// Centre. Unit: scene units. Required.
    pub centre: Field<[Field<f64>; 3]>,
    /// Radius. Unit: scene units. Required.
    pub radius: Field<f64>,
}

/// A scene file and its place in the world.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct PlacedSection {
    /// Scene file, relative to the recipe. Required.
    pub path: Field<String>,
    /// Place of the file's origin, world coordinates. Unit: scene units. Default: `[0, 0, 0]`.
    pub at: Field<[Field<f64>; 3]>,
    /// Turn of the file's axes: an axis in world axes, as long as the angle. Unit: degrees. Default: `[0, 0,
    /// 0]`.
    pub turn: Field<[Field<f64>; 3]>,
    /// Scene units per unit of the file. Default: `1`.
    pub scale: Field<f64>,
}

/// Form of the path.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ObjectPathSection {
    /// C2 splines through at least two keyframes; the first is at 0 s. They must last as long as the
    /// trajectory.
    Keyframes(Field<Vec<Field<ObjectKeySection>>>),
    /// A rotation about a fixed axis.
    Orbit(Field<ObjectOrbitSection>),
    /// A constant velocity and a constant spin.
    Straight(Field<ObjectStraightSection>),
}

/// A keyframe of an object.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ObjectKeySection {
    /// Time from the first pose of the trajectory. Unit: s. Required.
    pub at: Field<f64>,
    /// Displacement of the pivot from its place at rest, world axes. Unit: scene units. Default: `[0, 0, 0]`.
    pub shift: Field<[Field<f64>; 3]>,
    /// Turn about the pivot: an axis in world axes, as long as the angle. The way from keyframe to keyframe
    /// is the shorter one. Unit: degrees. Default: `[0, 0, 0]`.
    pub turn: Field<[Field<f64>; 3]>,
}

/// A rotation: `orbit: { centre: [0, 0, 0], axis: [0, 1, 0], degrees_per_second: 90 }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ObjectOrbitSection {
    /// A point of the axis, world coordinates. Unit: scene units. Required.
    pub centre: Field<[Field<f64>; 3]>,
    /// Direction of the axis, of any length but 0. Required.
    pub axis: Field<[Field<f64>; 3]>,
    /// Rate, right-handed about the axis. Unit: degrees per second. Required.
    pub degrees_per_second: Field<f64>,
}

/// A steady motion: `straight: { velocity: [1, 0, 0], spin: [0, 90, 0] }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ObjectStraightSection {
    /// Velocity, world axes. Unit: scene units per second. Default: `[0, 0, 0]`.
    pub velocity: Field<[Field<f64>; 3]>,
    /// Spin about the pivot: an axis in world axes, as long as the rate. Unit: degrees per second. Default:
    /// `[0, 0, 0]`.
    pub spin: Field<[Field<f64>; 3]>,
}
