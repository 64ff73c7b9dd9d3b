//! Errors of a GPU, as everything but the code on it knows them.

/// The reason why a GPU cannot be used, or can no longer be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// There is no GPU.
    #[error("no GPU is available: {0}")]
    None(String),
    /// No GPU matches the choice.
    #[error("no GPU is {wanted}; there is {found}")]
    Other {
        /// The choice.
        wanted: String,
        /// The GPUs of the machine.
        found: String,
    },
    /// Several GPUs match the choice.
    #[error("{count} GPUs are called `{wanted}`; there is {found}")]
    Several {
        /// Number of GPUs that match.
        count: usize,
        /// The choice.
        wanted: String,
        /// The GPUs of the machine, with their numbers.
        found: String,
    },
    /// The GPU lacks a feature that the renderer needs.
    #[error("{adapter} cannot be used: {because}")]
    Refused {
        /// Name of the GPU.
        adapter: String,
        /// Reason given by its driver.
        because: String,
    },
    /// The GPU is out of memory.
    #[error("{adapter} has no memory for {wanted} bytes of {what}: {because}")]
    Memory {
        /// Name of the GPU.
        adapter: String,
        /// Purpose of the allocation.
        what: &'static str,
        /// Size of the allocation, bytes.
        wanted: u64,
        /// Reason given by its driver.
        because: String,
    },
    /// One tile needs more memory than the GPU can bind at once.
    #[error("{adapter} binds at most {limit} bytes at once, but the {what} of one tile take more")]
    Tile {
        /// Name of the GPU.
        adapter: String,
        /// Purpose of the buffer.
        what: &'static str,
        /// Largest binding, bytes.
        limit: u64,
    },
    /// The GPU has less of something than every frame needs.
    #[error("{adapter} cannot be used: it has at most {found} {what}, wanted at least {wanted}")]
    Limits {
        /// Name of the GPU.
        adapter: String,
        /// What is limited, with its unit.
        what: &'static str,
        /// The limit.
        found: u64,
        /// The least limit with which a frame can be rendered.
        wanted: u64,
    },
    /// The first picture of a scene has values that are not finite.
    #[error("{adapter} returned a picture with values that are not finite")]
    NotFinite {
        /// Name of the GPU.
        adapter: String,
    },
    /// The GPU failed or was removed during work.
    #[error("{adapter} was lost: {because}")]
    Lost {
        /// Name of the GPU.
        adapter: String,
        /// Reason given by its driver.
        because: String,
    },
}

impl GpuError {
    /// What to try.
    #[must_use]
    pub fn help(&self) -> &'static str {
        match self {
            Self::None(_) => "use --backend cpu, or leave the option out; `gs2e doctor` shows the GPUs",
            Self::Other { .. } | Self::Several { .. } => {
                "use --gpu with a number or a longer part of the name: `gs2e doctor` shows both"
            }
            Self::Refused { .. } => {
                "update its driver, leave features out with --gpu-without, or use --backend cpu"
            }
            Self::Limits { .. } => "choose another GPU with --gpu, or use --backend cpu",
            Self::Memory { .. } => "choose a GPU with more memory, a smaller picture, or --backend cpu",
            Self::Tile { .. } => "render fewer channels at once, choose another GPU, or use --backend cpu",
            Self::NotFinite { .. } => {
                "update its driver, leave features out with --gpu-without subgroups, or use --backend cpu; `gs2e \
                 doctor` tries it on a scene that is known to be finite"
            }
            Self::Lost { .. } => "run it again, or use --backend cpu",
        }
    }
}
