//! The options of all verbs, and the machine, renderer and programs that they choose.

use super::environment::Environment;
use super::{Console, VerbError, machine};
use clap::{Args, ValueEnum};
use gs2e_build::run::backends::{AutoRenderers, RendererChoice, RendererKind};
use gs2e_files::is_there;
use gs2e_files::programs::ProgramFinder;
use gs2e_gpu::{self as gpu, GpuDevice, GpuPool};
use gs2e_render::backend::Backend;
use gs2e_render::{GpuError, OmissionPolicy};
use std::path::PathBuf;
use std::sync::Arc;

/// Options of every verb.
#[derive(Debug, Clone, Args)]
pub(super) struct CommonArgs {
    /// Work in this folder
    #[arg(short = 'C', long = "directory", value_name = "DIR", global = true)]
    pub(super) directory: Option<PathBuf>,
    /// Folder of the store, which keeps the built products
    #[arg(long, value_name = "DIR", default_value = CommonArgs::STORE, global = true)]
    pub(super) store: PathBuf,
    /// Cores to use [default: all]
    #[arg(short = 'j', long = "jobs", value_name = "N", global = true, value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) jobs: Option<u16>,
    /// Keep going past a failed scene
    #[arg(short = 'k', long, global = true)]
    pub(super) keep_going: bool,
    /// Renderer
    #[arg(long, value_enum, default_value_t = BackendArg::Auto, global = true)]
    pub(super) backend: BackendArg,
    /// GPU to render on: its index in the list of all GPUs, from 0, or a part of its name, or `all`, so that
    /// each GPU of the most capable kind renders a scene
    #[arg(long, value_name = "NAME, INDEX or all", global = true)]
    pub(super) gpu: Option<gpu::DeviceChoice>,
    /// Features of the GPU to leave out, separated by commas: subgroups, timestamps
    #[arg(long, value_name = "FEATURES", global = true)]
    pub(super) gpu_without: Option<gpu::FeatureSet>,
    /// Also do the rendering work that changes no bit, for comparison with a normal build
    #[arg(long, global = true)]
    pub(super) no_omit: bool,
    /// Run the programs that recipes name, instead of showing them
    #[arg(long, global = true)]
    pub(super) allow_commands: bool,
    /// Fail instead of waiting while another gs2e uses the store
    #[arg(long, global = true)]
    pub(super) no_wait: bool,
    /// Print results for programs to stdout
    #[arg(long, global = true)]
    pub(super) json: bool,
    /// Print failures only
    #[arg(short, long, global = true)]
    pub(super) quiet: bool,
    /// Print more: the work that each trajectory skipped
    #[arg(short, long, global = true)]
    pub(super) verbose: bool,
    /// The whole command as typed, shown to other processes that wait for this one.
    #[arg(skip)]
    pub(super) command: String,
    #[arg(skip)]
    pub(super) environment: Environment,
}

impl CommonArgs {
    /// Default folder of the store.
    pub(super) const STORE: &'static str = ".gs2e";

    /// The renderer of the scenes of recipes. The keys of their steps depend on it.
    pub(super) fn renderers(&self) -> Result<RendererChoice, VerbError> {
        let by = match self.backend {
            // A software GPU is slower than the CPU renderer, so it is used only if it is named.
            BackendArg::Auto => {
                let choice = self.gpu.clone().unwrap_or(gpu::DeviceChoice::Hardware);
                let without = self.features_left_out();
                RendererKind::Auto(AutoRenderers::new(move || Ok(Arc::new(GpuPool::open(&choice, without)?))))
            }
            _ => RendererKind::One(self.backend()?),
        };
        Ok(RendererChoice::new(by, self.omit(), self.programs()))
    }

    /// The programs on the user's path. This program supervises them, even if its own file was
    /// replaced meanwhile.
    pub(super) fn programs(&self) -> ProgramFinder {
        // The link in /proc still leads to the running executable after its file was replaced or
        // deleted.
        let own = PathBuf::from("/proc/self/exe");
        let own = if is_there(&own) { own } else { std::env::current_exe().unwrap_or_default() };
        ProgramFinder::new(self.environment.path.as_deref(), own)
    }

    /// Number of cores to use.
    pub(super) fn cores(&self) -> usize {
        self.jobs.map_or_else(machine::available_cores, usize::from)
    }

    /// Limits `-j` to the cores of this machine. Idle threads look for work at each other, so the
    /// time that they take grows with the square of their number.
    pub(super) fn clamp_jobs(&mut self, console: &Console) {
        let cores = u16::try_from(machine::available_cores()).unwrap_or(u16::MAX);
        if let Some(jobs) = self.jobs.filter(|jobs| *jobs > cores) {
            console.note(&format!("-j {jobs} exceeds the cores of this machine: using {cores} cores"));
            self.jobs = Some(cores);
        }
    }

    /// The work that renderers leave out.
    pub(super) fn omit(&self) -> OmissionPolicy {
        if self.no_omit { OmissionPolicy::Nothing } else { OmissionPolicy::Needless }
    }

    /// The back end for renderings other than the scenes of recipes: the CPU unless another one is
    /// requested.
    pub(super) fn backend(&self) -> Result<Backend, VerbError> {
        match self.backend {
            BackendArg::Gpu => {
                let choice = self.gpu.clone().unwrap_or(gpu::DeviceChoice::Any);
                let pool = GpuPool::open(&choice, self.features_left_out());
                let refused = |e: GpuError| VerbError::usage("no-adapter", e.to_string()).help(e.help());
                pool.map(Backend::from).map_err(refused)
            }
            _ if self.gpu.is_some() => Err(not_of_gpu("--gpu selects a GPU")),
            _ if self.gpu_without.is_some() => Err(not_of_gpu("--gpu-without leaves out features of a GPU")),
            BackendArg::Auto | BackendArg::Cpu => Ok(Backend::Cpu),
            BackendArg::Reference => Ok(Backend::Reference),
        }
    }

    /// The GPU that `--gpu` chooses, or else one that matches `otherwise`.
    pub(super) fn device(&self, otherwise: &gpu::DeviceChoice) -> Result<GpuDevice, GpuError> {
        GpuDevice::open_without(self.gpu.as_ref().unwrap_or(otherwise), self.features_left_out())
    }

    /// The features of a GPU that `--gpu-without` names.
    pub(super) fn features_left_out(&self) -> gpu::FeatureSet {
        self.gpu_without.unwrap_or_default()
    }

    /// Limits a single step to the cores that it may use.
    pub(super) fn limit_cores(&self) {
        if let Some(jobs) = self.jobs {
            // It fails only if a thread pool exists already, and no verb starts one before this
            // call.
            let _ = rayon::ThreadPoolBuilder::new().num_threads(jobs.into()).build_global();
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum BackendArg {
    Auto,
    Cpu,
    Gpu,
    Reference,
}

/// The error for an option of GPUs without one. `option` says what it does.
fn not_of_gpu(option: &str) -> VerbError {
    VerbError::usage("no-adapter", format!("{option}, but the backend is not a GPU"))
        .help("add --backend gpu")
}
