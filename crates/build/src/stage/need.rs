//! Memory and GPU that a step needs.

use crate::artifact::{Artifact, ArtifactFiles};
use gs2e_image::Size;
use gs2e_render::backend::Backend;
use gs2e_render::lens::rendered_size;
use gs2e_scene::camera;
use gs2e_scene::camera::CameraChoice;
use gs2e_source::Capture;

/// Resources of a step other than cores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepNeed {
    /// Peak memory, bytes; an estimate.
    pub memory: u64,
    /// True if the step renders on a GPU.
    pub gpu: bool,
}

impl StepNeed {
    /// The sum of these amounts of memory plus the base of every step, bytes.
    #[must_use]
    pub fn for_memory(amounts: impl IntoIterator<Item = u64>) -> Self {
        /// Base: the program itself with its buffers, stacks and tables.
        const BASE: u64 = 24 << 20;
        Self { memory: amounts.into_iter().fold(BASE, u64::saturating_add), gpu: false }
    }
}

/// Memory of a stage that holds little but its inputs, bytes.
pub(super) fn small_stage_memory(files: &[ArtifactFiles]) -> u64 {
    /// Factor on the bytes of the inputs.
    const COPIES: u64 = 4;
    COPIES * files.iter().map(ArtifactFiles::bytes).sum::<u64>()
}

/// Resources of a stage that renders: the renderer, and `others` bytes per pixel of its own. The
/// first input is the capture; if it cannot be read, the number of pixels is unknown, and the stage
/// will not run. The second input is the scene.
pub(super) fn rendering_need(
    backend: &Backend,
    choice: Option<CameraChoice>,
    files: &[ArtifactFiles],
    others: u64,
) -> StepNeed {
    let capture = files.first().and_then(|capture| Capture::open(capture).ok());
    let own = |capture: Capture| capture.camera().map(|(own, _)| own);
    let camera = capture.and_then(|capture| camera::choose_camera(choice, own(capture).as_ref()));
    let scene = files.get(1).map_or(0, ArtifactFiles::bytes);
    let own = |size: Size| u64::from(size.width) * u64::from(size.height) * others;
    let need = StepNeed::for_memory(
        camera
            .into_iter()
            .flat_map(|camera| [backend.memory(scene, rendered_size(&camera)), own(camera.size)]),
    );
    StepNeed { gpu: backend.takes_gpu(), ..need }
}
