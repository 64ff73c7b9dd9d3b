//! `gs2e` builds datasets of synthetic event-camera streams from 3D Gaussian splats, and proves them.
//!
//! # The story, which runs one way
//! ```text
//! recipe ── plan ── run ── store ── check ── release
//!             │      └ capture → reconstruct → trajectory → { events, sharp } → checks
//!             └ for each step: key = what it is, its own parameters, the digests of its inputs
//! ```
//! A [`recipe`] says what a scene is. The [`plan`] turns recipes into steps. A step whose key has a sound record in
//! the [`store`] is left alone; [`run`] runs the others. [`check`]s judge what was made, and the scene itself by its
//! photos. The [`release`] copies what passed, with its licences, into the tree that people download.
//!
//! Two ideas carry the rest. **The key and its explanation come from one walk**: a step describes itself into a
//! [`store::description::DescribedValue`], whose encoding is hashed into the key and whose lines `gs2e why` prints, so the
//! explanation cannot disagree with the key. **A scene pays only for what it needs**: the plan has no step whose
//! product nobody asked for, a stage's key holds only what the stage reads, the renderer is asked for one channel
//! where one is enough, and a sensor without noise draws no random number; what was left out is counted, and
//! [`render::OmissionPolicy::Nothing`] computes it after all.
//!
//! # The rooms
//! A module knows those above it in this list, and none below (`tests/it/tidy.rs` holds the list against the code).
//!
//! | room | what lives there |
//! |---|---|
//! | [`units`] [`escape`] [`files`] [`programs`] [`budget`] `elementary` [`seed`] [`mod@image`] [`se3`] | foundation: pure values, visible text, budgets, and the doors for files and for programs of others |
//! | [`camera`] [`scene`] [`speed`] [`trajectory`] [`render`] [`frames`] [`event`] [`sensor`] [`sampling`] [`source`] [`reconstruct`] [`foreign`] [`check`] [`licence`] | domain: values and models, with readers and writers of their own formats; no store, no threads but rayon's |
//! | [`store`] | blobs, records, descriptions, stat fields, memos; knows nothing of ours but the door for files |
//! | [`artifact`] | the one seam between domain formats and the store |
//! | [`stage`] | what a step is: parameters, inputs, and one call into a room |
//! | [`mod@recipe`] | YAML to valid values, with file, line and column of every fault |
//! | [`plan`] | recipes to steps; which of them must run, and why; which scenes are up to date at a glance |
//! | [`run`] | runs them: order, cores and memory, failures, interrupts, time left |
//! | [`release`] | the tree that people download, and its audit |
//! | [`study`] | measurements of a scene: what a setting costs and what it does to the events; of the program: how exact it is where it is hard |
//! | [`cli`] | what the user types and reads; the only printing, environment and clock for people |
//!
//! Why it computes what it computes is in `docs/design`: laws, formulas and their sources, oracles, decisions.
//!
//! # Invariants
//! - Nothing below `cli` prints or reads the environment; the clock is read in `cli`, `run` and the stat cache only.
//! - A file that a person or a stranger names is opened by [`files`] alone.
//! - A key never holds a path, a host, a time or a thread count.
//! - Nothing iterates a hash map.
//! - Every random draw is a pure function of a stream's seed, what it is drawn for, and where.
//! - Each constant has one definition.
//! - A check never repairs.
//! - What is in the store is never changed in place.
//! - The database can be lost: it holds nothing that the records do not, and nothing that is not on disk yet.
//! - An error of the disk is never a miss: what cannot be read fails the step, what is absent or damaged is made again.
//! - A frame sequence is never whole in memory.
//! - No stage holds arithmetic.
//! - `unsafe` is forbidden.
//! - Numbers: 64 bits for poses, time and sensor state that accumulates; 32 bits for splats and pixels. What reaches
//!   a file is computed with IEEE operations and `libm`, in a fixed order, so that its bytes are the same on every
//!   machine and with any number of threads. What a GPU renders is its own: its name and driver are in the key.

pub mod artifact;
pub mod budget;
pub mod camera;
pub mod check;
pub mod cli;
pub(crate) mod elementary;
pub mod escape;
pub mod event;
pub mod files;
pub mod foreign;
pub mod frames;
pub mod image;
pub mod licence;
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
pub mod store;
pub mod study;
pub mod trajectory;
pub mod units;
