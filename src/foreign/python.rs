//! Questions to Python, with a file for the question and a file for the answer.

use super::ForeignError;
use super::programs::PYTHON;
use super::run::Run;
use crate::reconstruct::{Desk, How};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The script that calls OpenCV, h5py and numpy.
const SCRIPT: &str = include_str!("ask.py");

/// Time limit of an answer: one hour.
const MOST_SECONDS: u32 = 3600;

/// Asks one question and returns the answer.
pub(super) fn ask<A: DeserializeOwned>(
    question: &str,
    request: &impl Serialize,
    desk: Desk<'_>,
) -> Result<A, ForeignError> {
    let place = |name: &str| desk.folder.join(name);
    let (script, asked, answer) = (place("ask.py"), place("request.json"), place("answer.json"));
    std::fs::write(&script, SCRIPT).map_err(ForeignError::io(&script))?;
    let request = serde_json::to_vec(request).expect("a request is plain data");
    std::fs::write(&asked, request).map_err(ForeignError::io(&asked))?;
    let arguments = ["ask.py", question, "request.json", "answer.json"].map(Into::into).to_vec();
    let ran = Run { program: PYTHON, arguments, seconds: MOST_SECONDS, desk }.end_well()?;
    let product = |e: &dyn std::fmt::Display| ran.failed(How::Product(format!("its answer: {e}")));
    let text = std::fs::read(&answer).map_err(|e| product(&e))?;
    serde_json::from_slice(&text).map_err(|e| product(&e))
}
