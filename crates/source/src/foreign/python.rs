//! Questions to Python, with a file for the question and a file for the answer.

use super::ForeignError;
use super::run::ExternalRun;
use super::versions::{ISOLATED, PYTHON};
use crate::reconstruct::ProgramWorkspace;
use gs2e_files as files;
use gs2e_files::programs::EndKind;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ffi::OsString;

/// The script that calls OpenCV, h5py and numpy.
const SCRIPT: &str = include_str!("ask.py");

/// Seconds that an answer may take: an hour.
const MAX_SECONDS: u32 = 3600;

/// Asks one question and returns the answer.
pub(super) fn ask_script<A: DeserializeOwned>(
    question: &str,
    request: &impl Serialize,
    workspace: ProgramWorkspace<'_>,
) -> Result<A, ForeignError> {
    let place = |name: &str| workspace.folder.join(name);
    let (script, asked, answer) = (place("ask.py"), place("request.json"), place("answer.json"));
    std::fs::write(&script, SCRIPT).map_err(ForeignError::io_error(&script))?;
    let request = serde_json::to_vec(request).expect("a request is plain data");
    std::fs::write(&asked, request).map_err(ForeignError::io_error(&asked))?;
    let files = [script.into(), question.into(), asked.into(), answer.clone().into()];
    let arguments = [OsString::from(ISOLATED)].into_iter().chain(files).collect();
    let ran = ExternalRun { program: PYTHON, arguments, seconds: MAX_SECONDS, workspace }.end_well()?;
    let product = |e: &dyn std::fmt::Display| ran.failed(EndKind::Product(format!("its answer: {e}")));
    let text = files::read(&answer, files::MAX_DOCUMENT).map_err(|e| product(&e))?;
    serde_json::from_slice(&text).map_err(|e| product(&e))
}
