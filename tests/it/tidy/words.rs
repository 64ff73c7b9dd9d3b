//! Words that the code must not hold, or only in certain files.

use super::Fault;
use super::source::Source;

struct Ban {
    /// Any of these words in the code is a fault.
    words: &'static [&'static str],
    /// Files, with the folders of the same name, in which the words are allowed.
    except: &'static [&'static str],
    because: &'static str,
}

const CLI: &[&str] = &["src/main.rs", "src/cli.rs"];

const BANS: &[Ban] = &[
    Ban {
        words: &["println!", "print!", "eprintln!", "eprint!", "dbg!", "stdout()", "stderr()", "indicatif"],
        except: CLI,
        because: "only `cli` prints",
    },
    Ban {
        words: &["std::env", "env::var", "env::args"],
        except: CLI,
        because: "only `cli` reads the environment",
    },
    Ban {
        words: &["Instant::now", "SystemTime::now"],
        except: &["src/main.rs", "src/cli.rs", "crates/build/src/run.rs", "crates/files/src/stat.rs"],
        because: "the clock is read in `cli`, `run` and the stat cache only",
    },
    Ban {
        words: &["File::open", "fs::read(", "read_to_string", ".exists()", ".is_file()"],
        except: &[
            "crates/files/src/lib.rs",
            // The store's own files, with its own rules for absence and damage.
            "crates/store/src/lib.rs",
            // The type of an entry that the walk found, without following links.
            "crates/audit/src/walk.rs",
            "crates/publish/src/removal.rs",
            "crates/publish/src/standing.rs",
            // Folders, which must be synced, and the release's own new files.
            "crates/publish/src/tree.rs",
            "crates/publish/src/work.rs",
            // A program is looked for and not opened. Its supervisor answers through a socket.
            "crates/files/src/programs.rs",
        ],
        because: "`files` is the one door: it refuses what is no regular file, and only what is not there is absent",
    },
    Ban { words: &["clap"], except: CLI, because: "the command line is parsed in `cli`" },
    Ban {
        words: &["HashMap", "HashSet", "RandomState", "DefaultHasher"],
        except: &[],
        because: "nothing may depend on hash order: BTreeMap or a sorted Vec",
    },
    Ban {
        words: &[
            "thread_rng",
            "rand::rng",
            "rand::random",
            "StdRng",
            "SmallRng",
            "from_os_rng",
            "from_entropy",
        ],
        except: &[],
        because: "every draw comes from `seed`, with its purpose and index",
    },
    Ban { words: &["unsafe"], except: &[], because: "`unsafe` is forbidden" },
    Ban {
        words: &["#[allow", "#![allow"],
        except: &[],
        because: "`#[expect(lint, reason = \"…\")]` says why and goes when it is not needed",
    },
    Ban {
        words: &["unimplemented!", "todo!", "#[ignore"],
        except: &[],
        because: "what is not there yet is refused by name, with an error",
    },
    Ban {
        words: &["mul_add", "fmuladd"],
        except: &[],
        because: "a fused multiply-add rounds once where other machines round twice",
    },
    Ban {
        words: &[
            ".sin()",
            ".cos()",
            ".tan()",
            ".sin_cos()",
            ".asin()",
            ".acos()",
            ".atan()",
            ".atan2(",
            ".sinh()",
            ".cosh()",
            ".tanh()",
            ".exp()",
            ".exp2()",
            ".exp_m1()",
            ".ln()",
            ".ln_1p()",
            ".log2()",
            ".log10()",
            ".powf(",
            ".cbrt()",
            ".hypot(",
            "f64::exp",
            "f32::exp",
            "f64::ln",
            "f32::ln",
            "f64::sin",
            "f64::cos",
        ],
        except: CLI,
        because: "std's transcendental functions differ between machines: take `libm`'s",
    },
    Ban {
        words: &[
            "from_axis_angle",
            "to_axis_angle",
            "from_rotation_x",
            "from_rotation_y",
            "from_rotation_z",
            "from_euler",
            "to_euler",
            "from_scaled_axis",
            "to_scaled_axis",
            "angle_between",
        ],
        except: &[],
        because: "glam's trigonometry goes through std's, which differs between machines: take `se3`'s",
    },
];

/// A stage connects and calls functions. Computations belong to the domain modules.
const NOT_IN_STAGES: &[&str] = &["libm::", "glam::", ".sqrt(", "as f64", "as f32"];

/// Faults of the table above.
pub(super) fn banned_words(sources: &[Source]) -> Vec<Fault> {
    let of_ban = |source: &Source, ban: &Ban| {
        if source.is_in(ban.except) { Vec::new() } else { finds(source, ban.words, ban.because) }
    };
    sources.iter().flat_map(|source| BANS.iter().flat_map(move |ban| of_ban(source, ban))).collect()
}

/// Arithmetic in a stage.
pub(super) fn stages_hold_no_arithmetic(sources: &[Source]) -> Vec<Fault> {
    let stages = sources.iter().filter(|source| source.is_in(&["crates/build/src/stage.rs"]));
    stages.flat_map(|source| finds(source, NOT_IN_STAGES, "no arithmetic in stages")).collect()
}

fn finds(source: &Source, words: &[&str], because: &str) -> Vec<Fault> {
    let holds = |line: &str| words.iter().find(|word| has_word(line, word)).copied();
    let hits = source.lines().filter_map(|(number, line)| holds(line).map(|word| (number, word)));
    hits.map(|(number, word)| Fault::new(source, number, format!("`{word}`: {because}"))).collect()
}

/// Returns true if `line` holds `word`, not as a part of a longer name: `unsafe` is not in
/// `unsafe_code`, nor `print!` in `eprint!`.
fn has_word(line: &str, word: &str) -> bool {
    let in_name = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let begins_name = in_name(word.chars().next());
    let ends_name = in_name(word.chars().last());
    line.match_indices(word).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        let after = line[at + word.len()..].chars().next();
        !(begins_name && in_name(before) || ends_name && in_name(after))
    })
}
