//! Versions of other programs, remembered from the last time they were asked.
//!
//! A build asks each program that a recipe names. It remembers the answer with the stat fields of
//! the program and of the folders of its packages. Commands that run nothing take the answer from
//! there. If a program or one of those folders has moved since, they report that a step may run.

use gs2e_files::programs::ProgramFinder;
use gs2e_files::stat::StatSighting;
use gs2e_source::foreign::versions::VersionQuery;
use gs2e_store::{Digest, MemoGround, Store};
use std::path::PathBuf;

/// Raised when a program is asked in another way.
const TAG: &[u8] = b"versions of programs 1";

fn name(program: VersionQuery) -> String {
    format!("program {}", program.name())
}

/// Asks a program for its version and remembers the answer.
#[must_use]
pub fn ask(program: VersionQuery, programs: &ProgramFinder, store: &Store) -> String {
    let version = program.version(programs);
    // If one of the files cannot be observed, a change could go unnoticed, so nothing is
    // remembered.
    let sight = |path: &PathBuf| Some((path.clone(), store.sight(path).ok()?));
    let grounds: Option<Vec<(PathBuf, StatSighting)>> = version.grounds.iter().map(sight).collect();
    if let (Some(grounds), Some(path)) = (grounds, program.path(programs)) {
        let fact = (path, version.text.clone());
        let ground = MemoGround { tag: Digest::of_bytes(TAG), files: &grounds, blobs: &[] };
        store.remember(&name(program), ground, fact);
    }
    version.text
}

/// The version of a program, if it is known without asking. It is always known if the program is
/// absent.
#[must_use]
pub fn recall(program: VersionQuery, programs: &ProgramFinder, store: &Store) -> Option<String> {
    let Some(path) = program.path(programs) else { return Some(program.version(programs).text) };
    let recalled = store.recall::<(PathBuf, String)>(&[name(program)], &Digest::of_bytes(TAG)).ok()?;
    let (asked, text) = recalled.into_iter().next().flatten()?;
    // `PATH` may meanwhile lead to another program of the same name.
    (asked == path).then_some(text)
}
