//! `gs2e` builds and checks datasets of synthetic event-camera streams from 3D Gaussian splats.
//!
//! # Flow of a build
//! ```text
//! recipe ── plan ── run ── store ── check ── release
//!             │      └ capture → reconstruct → trajectory → { events, sharp } → checks
//!             └ for each step: key = its description, its parameters, the digests of its inputs
//! ```
//! A [`recipe`] describes a scene. The [`plan`] turns recipes into steps. A step whose key has a
//! sound record in the [`store`] is left alone; [`run`] runs the others. [`check`]s judge the
//! products, and compare the scene with its photos. The [`release`] copies the products that
//! passed, with their licences, into the tree that people download.
//!
//! Two ideas carry the rest:
//!
//! - **The key and its explanation come from one walk.** A step describes itself as a
//!   [`store::description::DescribedValue`]. Its encoding is hashed into the key, and `gs2e why`
//!   prints its lines, so the explanation cannot disagree with the key.
//! - **A scene pays only for what it needs.** The plan has no step without a requested product. A
//!   stage's key holds only the values that the stage reads. The renderer is asked for one channel
//!   if one is enough, and a sensor without noise draws no random number. Omitted work is counted,
//!   and [`render::OmissionPolicy::Nothing`] computes it after all.
//!
//! # Rooms
//! A module knows only the modules before it in this list; `tests/it/tidy/imports.rs` checks the
//! code.
//!
//! - [`units`], [`escape`], `html`, [`files`], [`programs`], [`budget`], [`stats`], `elementary`, [`seed`],
//!   [`mod@image`], [`se3`]: the foundation. Pure values, visible text, memory budgets, and the
//!   only access to files and to other programs.
//! - [`camera`], [`source`], [`scene`], [`speed`], [`trajectory`], [`render`], [`gpu`], [`lights`],
//!   [`frames`], [`event`], [`sensor`], [`sampling`], [`imu`], [`reconstruct`], [`training`], [`foreign`], [`check`],
//!   [`dataset`], [`licence`]: the domain. Values and models, with readers and writers of their own
//!   formats. No store, and no threads except rayon's.
//! - [`store`]: blobs, records, descriptions, stat fields, memos. It knows no other room except
//!   [`files`].
//! - [`artifact`]: the only connection between domain formats and the store.
//! - [`stage`]: parameters and inputs of each kind of step, and one call into a room.
//! - [`mod@recipe`]: YAML to valid values, with file, line and column of every fault.
//! - [`plan`]: recipes to steps. It finds the steps that must run, with the reasons, and the scenes
//!   that are up to date at a glance.
//! - [`run`]: execution of steps: order, cores and memory, failures, interrupts, remaining time.
//! - [`cluster`]: scenes that the tasks of a batch system build, and their states.
//! - [`release`]: the tree that people download, and its audit.
//! - [`export`]: a trajectory of a released tree in the layout that a published method reads.
//! - [`study`]: measurements. Of a scene: the cost of a setting and its effect on the events. Of
//!   the program: its precision in hard cases.
//! - [`cli`]: the user's commands and messages. Printing, the environment, and the clock for people
//!   are here only.
//!
//! `docs/design` has the reasons: laws, formulas and their sources, oracles, decisions.
//!
//! # Invariants
//! - Nothing below `cli` prints or reads the environment. The clock is read in `cli`, `run` and the
//!   stat cache only.
//! - A file that a person or a stranger names is opened by [`files`] alone.
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

pub mod artifact;
pub mod budget;
pub mod camera;
pub mod check;
pub mod cli;
pub mod cluster;
pub mod dataset;
pub(crate) mod elementary;
pub mod escape;
pub mod event;
pub mod export;
pub mod files;
pub mod foreign;
pub mod frames;
pub mod gpu;
pub(crate) mod html;
pub mod image;
pub mod imu;
pub mod licence;
pub mod lights;
pub mod plan;
pub mod programs;
pub mod recipe;
pub mod reconstruct;
pub mod release;
pub mod render;
pub mod run;
pub mod sampling;
pub mod scene;
pub mod se3;
pub mod seed;
pub mod sensor;
pub mod source;
pub mod speed;
pub mod stage;
pub mod stats;
pub mod store;
pub mod study;
pub mod training;
pub mod trajectory;
pub mod units;
