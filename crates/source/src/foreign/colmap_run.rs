//! One run of a COLMAP command, with the option names of the installed version.
//!
//! COLMAP 3.8 has `SiftExtraction.use_gpu` and `random_seed` where 4.x has `FeatureExtraction.use_gpu`
//! and `default_random_seed` (`option_manager.cc` in COLMAP's sources). An unknown option is an error,
//! so each command is asked for its options first.

use super::run::ExternalRun;
use super::versions::COLMAP;
use crate::reconstruct::ProgramWorkspace;
use gs2e_files::programs::ProgramFinder;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::Path;

/// Options with their values, under the names of COLMAP 3.8.
pub(super) type ColmapOptions = Vec<(&'static str, OsString)>;

/// Names of COLMAP 3.8 and of 4.x.
const RENAMED: [(&str, &str); 6] = [
    ("--random_seed", "--default_random_seed"),
    ("--SiftExtraction.use_gpu", "--FeatureExtraction.use_gpu"),
    ("--SiftExtraction.num_threads", "--FeatureExtraction.num_threads"),
    ("--SiftExtraction.max_image_size", "--FeatureExtraction.max_image_size"),
    ("--SiftMatching.use_gpu", "--FeatureMatching.use_gpu"),
    ("--SiftMatching.num_threads", "--FeatureMatching.num_threads"),
];

/// Seeds that only some versions have, in addition to the common one.
const SEEDS: [&str; 2] = ["--Mapper.random_seed", "--TwoViewGeometry.random_seed"];

/// Time limit of each command: one week. A thousand photos take days on one core.
const MAX_SECONDS: u32 = 7 * 86_400;

/// A run of this command on a database, with a fixed seed.
pub(super) fn colmap_run<'a>(
    command: &str,
    database: &Path,
    options: ColmapOptions,
    workspace: ProgramWorkspace<'a>,
) -> ExternalRun<'a> {
    let known = known_options(command, workspace.programs);
    let mut named = vec![("--random_seed", OsString::from("1")), ("--database_path", database.into())];
    named.extend(options);
    named.extend(SEEDS.into_iter().filter(|seed| known.contains(*seed)).map(|seed| (seed, "1".into())));
    let words = named.into_iter().flat_map(|(name, value)| [current_name(name, &known).into(), value]);
    let arguments = std::iter::once(OsString::from(command)).chain(words).collect();
    ExternalRun { program: COLMAP, arguments, seconds: MAX_SECONDS, workspace }
}

/// The options that a command lists. Empty if it cannot be asked: its run then reports the cause.
fn known_options(command: &str, programs: &ProgramFinder) -> BTreeSet<String> {
    let said = programs.ask(COLMAP, &[command, "-h"]).unwrap_or_default();
    listed_options(&said)
}

/// The options in a help text: one per line, each line with its default.
fn listed_options(help: &str) -> BTreeSet<String> {
    let first = help.lines().filter_map(|line| line.split_whitespace().next());
    first.filter(|word| word.starts_with("--")).map(str::to_owned).collect()
}

/// The name that the installed version has for an option.
fn current_name<'n>(name: &'n str, known: &BTreeSet<String>) -> &'n str {
    let renamed = RENAMED.iter().find(|(old, _)| *old == name).map(|(_, new)| *new);
    renamed.filter(|new| !known.contains(name) && known.contains(*new)).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of `colmap feature_extractor -h` of both versions.
    #[test]
    fn options_have_the_names_of_the_version() {
        let t = |help: &str, wanted: &[(&str, &str)]| {
            let known = listed_options(help);
            for (name, current) in wanted {
                assert_eq!(current_name(name, &known), *current, "{help}");
            }
        };
        let gpu = "--SiftExtraction.use_gpu";
        t(
            "Options can either be specified via command-line or by defining\n\n  -h [ --help ]\n  \
             --random_seed arg (=0)\n  --SiftExtraction.use_gpu arg (=1)\n",
            &[(gpu, gpu), ("--random_seed", "--random_seed")],
        );
        t(
            "  --default_random_seed arg (=0)\n  --FeatureExtraction.use_gpu arg (=1)\n  \
             --SiftExtraction.max_num_features arg (=8192)\n",
            &[
                (gpu, "--FeatureExtraction.use_gpu"),
                ("--random_seed", "--default_random_seed"),
                ("--SiftExtraction.max_num_features", "--SiftExtraction.max_num_features"),
            ],
        );
        // A program that lists nothing is given the old names.
        t("", &[(gpu, gpu)]);
    }
}
