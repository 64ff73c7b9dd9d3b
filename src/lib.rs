//! `gs2e` builds and checks datasets of synthetic event-camera streams from 3D Gaussian splats.
//!
//! # Flow of a build
//! ```text
//! recipe ── plan ── run ── store ── check ── release
//!             │      └ capture → reconstruct → trajectory → { events, sharp } → checks
//!             └ for each step: key = its description, its parameters, the digests of its inputs
//! ```
//! A [`recipe`](gs2e_recipe) describes a scene. The [`plan`](gs2e_build::plan) turns recipes into
//! steps. A step whose key has a sound record in the [`store`](gs2e_store) is left alone;
//! [`run`](gs2e_build::run) runs the others. [Checks](gs2e_check) judge the products, and compare
//! the scene with its photos. The [`release`](gs2e_release) copies the products that passed, with
//! their licences, into the tree that people download.
//!
//! Two ideas carry the rest:
//!
//! - **The key and its explanation come from one walk.** A step describes itself as a
//!   [`DescribedValue`](gs2e_store::description::DescribedValue). Its encoding is hashed into the key,
//!   and `gs2e why` prints its lines, so the explanation cannot disagree with the key.
//! - **A scene pays only for what it needs.** The plan has no step without a requested product. A
//!   stage's key holds only the values that the stage reads. The renderer is asked for one channel
//!   if one is enough, and a sensor without noise draws no random number. Omitted work is counted,
//!   and [`OmissionPolicy::Nothing`](gs2e_render::OmissionPolicy::Nothing) computes it after all.
//!
//! # Crates
//! Each begins with what it is for. From the ground up:
//!
//! - Foundation: [`gs2e_num`], [`gs2e_files`], [`gs2e_image`]. Values and arithmetic with the same
//!   bits everywhere, and the only access to files and to other programs.
//! - Domain: [`gs2e_event`], [`gs2e_sensor`], [`gs2e_scene`], [`gs2e_trajectory`], [`gs2e_render`],
//!   [`gs2e_gpu`], [`gs2e_sampling`], [`gs2e_source`], [`gs2e_train`], [`gs2e_demo`],
//!   [`gs2e_check`]. Values and models, with readers and writers of their own formats. No store,
//!   and no threads except rayon's.
//! - Engine: [`gs2e_store`] keeps bytes and knows no domain; [`gs2e_recipe`] turns YAML into valid
//!   values, with file, line and column of every fault; [`gs2e_build`] plans and runs steps.
//! - Products: [`gs2e_release`], the tree that people download and its audit; [`gs2e_export`], a
//!   trajectory in the layout that a published method reads; [`gs2e_lab`], measurements.
//! - This crate: the user's commands and messages. Printing, the environment, and the clock for
//!   people are here only.
//!
//! `docs/design` has the reasons: laws, formulas and their sources, oracles, decisions.
//!
//! # Invariants
//! - Nothing below [`cli`] prints or reads the environment. The clock is read in `cli`, `run` and
//!   the stat cache only.
//! - A file that a person or a stranger names is opened by [`gs2e_files`] alone.
//! - A key never holds a path, a host, a time or a thread count.
//! - Nothing iterates a hash map.
//! - Every random draw is a pure function of a stream's seed, its purpose and its place.
//! - Each constant has one definition.
//! - A check never repairs.
//! - Content of the store is never changed in place.
//! - The database can be lost: it holds nothing that the records do not, and nothing that is not on
//!   disk yet.
//! - An error of the disk is never a miss. A step fails if its input cannot be read; an absent or
//!   damaged input is made again.
//! - A frame sequence is never in memory as a whole.
//! - No stage holds arithmetic.
//! - `unsafe` is forbidden.
//! - Poses, time and accumulating sensor state have 64 bits; splats and pixels have 32. Values that
//!   reach a file are computed with IEEE operations and `libm`, in a fixed order, so that their
//!   bytes are the same on every machine and with any number of threads. Renderings of a GPU are
//!   its own: its name and driver are in the key.

#[cfg(not(unix))]
compile_error!(
    "gs2e uses file locks, signals and atomic exchanges of folders that only Unix has; on Windows, use WSL"
);

pub mod cli;
