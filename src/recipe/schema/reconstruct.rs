//! Where the Gaussians come from, as it is written.

use crate::recipe::field::{Field, Later};
use serde::Deserialize;

/// Where the Gaussians come from.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Reconstruct {
    Given(Field<Given>),
    Builtin(Field<Later>),
    Command(Field<Later>),
}

/// A scene file.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Given {
    /// Required.
    pub path: Field<String>,
    /// Whether it was trained on undistorted photos.
    pub undistorted: Field<Later>,
}
