//! The build engine: steps, their plan and their execution.
//!
//! A plan follows from a recipe of `gs2e-recipe`, and `gs2e-store` keeps what each step made. A step
//! calls the crate that does the work: `gs2e-source`, `gs2e-demo`, `gs2e-train`, `gs2e-trajectory`,
//! `gs2e-sampling`, `gs2e-render`, `gs2e-sensor` or `gs2e-check`. It writes events with `gs2e-event`,
//! images with `gs2e-image`, scenes with `gs2e-scene` and other files with `gs2e-files`; seeds come from
//! `gs2e-num`. `gs2e-release` and `gs2e-publish` take the products of a plan, and `gs2e-audit` and
//! `gs2e-export` use their types.
//!
//! # Examples
//!
//! ```
//! use gs2e_build::plan::Plan;
//! use gs2e_recipe::read_recipe_text;
//! use gs2e_render::backend::Backend;
//!
//! let text = "version: 1\nscene: table\nsource: { procedural: { gaussians: 300 } }
//! trajectories: [{ name: base, refine: { duration: 1 } }]";
//! let recipe = read_recipe_text(text.to_owned(), "table.yaml".as_ref())?;
//! let plan = Plan::new(vec![recipe], &Backend::Cpu);
//! assert!(plan.steps().iter().any(|step| step.name == "base/trajectory"));
//! // The inputs of a step come before it.
//! assert!(plan.steps_of(0).all(|(id, step)| step.step.inputs().iter().all(|(_, input)| *input < id)));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod artifact;
pub mod cluster;
pub mod plan;
pub mod run;
pub mod stage;
