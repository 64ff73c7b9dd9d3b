//! Stage `imu`: inertial measurements along a trajectory.

use super::{
    ExpectedSize, OpenedInputs, PathLength, Stage, StageContext, StageError, StageFacts, StepTarget,
};
use crate::artifact::{ImuRecording, TrajectoryProduct};
use gs2e_num::seed::Seed;
use gs2e_recipe::OutputKind;
use gs2e_source::Capture;
use gs2e_trajectory::imu::files::{SAMPLES, SAMPLES_HEAD, SENSOR, STATES, STATES_HEAD};
use gs2e_trajectory::imu::{ImuModel, ImuSampler, files};
use gs2e_trajectory::sampled::SampledPath;
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};

/// Parameters: the sensor, and the seed of its noise.
#[derive(Debug, Serialize)]
pub struct ImuStage {
    /// The sensor.
    #[serde(flatten)]
    pub model: ImuModel,
    /// Seed of its noise.
    pub seed: Seed,
}

/// Jump of the rates at the knots, divided by the mean rate, above which accelerations depend on the frame
/// rate.
const SMOOTH: f64 = 1e-3;

/// Bytes of a sample and its state in their files, by the digits of their numbers; fewer if biases are zero.
const BYTES_A_SAMPLE: f64 = 450.0;

impl StageFacts for ImuStage {
    fn expected_size(&self, path: PathLength) -> Option<ExpectedSize> {
        let samples = 1.0 + path.seconds * self.model.rate.to_f64();
        Some(ExpectedSize::of_text(samples, BYTES_A_SAMPLE))
    }
}

impl Stage for ImuStage {
    const NAME: &'static str = OutputKind::Imu.name();
    const REVISION: u32 = 1;
    /// The capture, if its views say what is up.
    type Inputs = (StepTarget<TrajectoryProduct>, Option<StepTarget<Capture>>);
    type Output = ImuRecording;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let (motion, capture) = inputs;
        let failed =
            |because: String| StageError::work_failed("measure the motion")(io::Error::other(because));
        let poses = &motion.trajectory.world_from_camera;
        if poses.len() < 2 {
            return Err(failed("a path of one pose has no duration".to_owned()));
        }
        let path = SampledPath::with_end_rates(poses, motion.seconds())
            .map_err(StageError::work_failed("follow the path"))?;
        let up = self.model.up_or(capture.as_ref().and_then(Capture::up));
        let up = up.ok_or_else(|| failed("the captured views have no common up: write imu.up".to_owned()))?;
        let mut sampler = ImuSampler::new(&self.model, &path, up, self.seed);
        let (samples, states) = (cx.out.join(SAMPLES), cx.out.join(STATES));
        let create = |path: &std::path::Path, head: &str| -> io::Result<BufWriter<File>> {
            let mut file = BufWriter::new(File::create(path)?);
            writeln!(file, "{head}")?;
            Ok(file)
        };
        let mut out = create(&samples, SAMPLES_HEAD).map_err(StageError::io_error(&samples))?;
        let mut truth = create(&states, STATES_HEAD).map_err(StageError::io_error(&states))?;
        let mut count = 0_u64;
        for sample in &mut sampler {
            cx.go_on()?;
            files::write_sample(&sample, &mut out).map_err(StageError::io_error(&samples))?;
            files::write_state(&sample, &mut truth).map_err(StageError::io_error(&states))?;
            count += 1;
        }
        // A writer that is dropped writes its rest too, but loses the error of a full disk.
        out.flush().map_err(StageError::io_error(&samples))?;
        truth.flush().map_err(StageError::io_error(&states))?;
        let sensor = cx.out.join(SENSOR);
        let text = files::sensor_text(&self.model, sampler.gravity());
        std::fs::write(&sensor, text).map_err(StageError::io_error(&sensor))?;
        self.warn(&motion, sampler.saturated, count, cx);
        cx.remark = Some(format!("{count} samples"));
        Ok(())
    }
}

impl ImuStage {
    fn warn(&self, motion: &TrajectoryProduct, saturated: u64, count: u64, cx: &mut StageContext<'_>) {
        if saturated > 0 {
            cx.warnings
                .push(format!("{saturated} of {count} samples exceed the range of the inertial sensor"));
        }
        let jump = motion.report.knot_jumps.map_or(0.0, |jumps| jumps.c1);
        if jump > SMOOTH {
            cx.warnings.push(format!(
                "the speed of the camera jumps at the knots of the path, by {jump:.3} of its mean: the accelerations \
                 there depend on the frame rate; a curve without corners has none"
            ));
        }
    }
}
