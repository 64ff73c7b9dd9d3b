//! Where the Gaussians come from, as it is written.

use crate::recipe::field::{Field, Later};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Where the Gaussians come from.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Reconstruct {
    Given(Field<Given>),
    Builtin(Field<Later>),
    Command(Field<Box<Command>>),
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

/// A program that is run.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Command {
    /// Required.
    pub program: Field<String>,
    pub arguments: Field<Vec<Field<String>>>,
    /// Required.
    pub version: Field<String>,
    /// What it is started with to say its version.
    pub probe: Field<Vec<Field<String>>>,
    /// Required.
    pub licence: Field<String>,
    /// Below `{out}`; default: the newest of a 3DGS model folder.
    pub scene: Field<String>,
    pub iterations: Field<u64>,
    pub environment: Field<BTreeMap<String, Field<String>>>,
    /// Files that arguments name.
    pub files: Field<BTreeMap<String, Field<String>>>,
    pub hold_out: Field<u64>,
    /// How many it has to bring.
    pub gaussians: Field<Count>,
    /// Mean PSNR that it has to have where views are held out, dB.
    pub min_psnr: Field<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Count {
    pub min: Field<u64>,
    pub max: Field<u64>,
}
