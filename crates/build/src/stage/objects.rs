//! Stage `objects`: the scene with its moving objects.

use super::{SourceFile, Stage, StageContext, StageError, StageFacts, StepTarget};
use crate::artifact::SCENE_OBJECTS;
use gs2e_scene::Gaussians;
use gs2e_scene::motion::ObjectRecord;
use gs2e_scene::objects::{ObjectSettings, add_objects};
use gs2e_scene::ply::write_ply;
use serde::Serialize;
use std::fs::File;

/// Parameters: the objects. Their files enter the key by their digests.
#[derive(Debug, Serialize)]
pub(crate) struct ObjectsStage {
    /// The objects.
    pub objects: Vec<ObjectSettings>,
}

impl StageFacts for ObjectsStage {
    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        let file = |object: &ObjectSettings| {
            let path = object.from.file()?.to_owned();
            Some(SourceFile { name: object.name.clone(), path })
        };
        Ok(self.objects.iter().filter_map(file).collect())
    }
}

impl Stage for ObjectsStage {
    const NAME: &'static str = "objects";
    const REVISION: u32 = 1;
    type Inputs = StepTarget<Gaussians>;
    type Output = Gaussians;

    fn run(&self, scene: Gaussians, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let made =
            add_objects(&scene, &self.objects).map_err(StageError::work_failed("place the objects"))?;
        let out = cx.out.join("scene.ply");
        File::create(&out).and_then(|file| write_ply(&made, file)).map_err(StageError::io_error(&out))?;
        let records: Vec<&ObjectRecord> = made.motion.iter().flat_map(|motion| motion.records()).collect();
        cx.write_record(SCENE_OBJECTS, &records)
    }
}
