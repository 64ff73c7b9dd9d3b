//! Events of a DAVIS346 from grey frames `[N, H, W]` of bytes, or of floats from 0 to 1:
//! `cargo run --release --example frames_to_events -- frames.npy STEP_US events.h5`

use gs2e_event::{StreamHeader, h5};
use gs2e_num::seed::Seed;
use gs2e_sensor::frames::array::FullScale;
use gs2e_sensor::frames::npy::{FrameStack, NpyFrames};
use gs2e_sensor::simulate_one;
use gs2e_sensor::voltmeter::VoltmeterPreset;
use std::{env, error::Error, ops::ControlFlow, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [frames, step_us, out] = &arguments[..] else {
        return Err("usage: frames_to_events frames.npy STEP_US events.h5".into());
    };
    let stack = FrameStack::open(Path::new(frames))?;
    let (size, step_us) = (stack.size(), step_us.parse::<i64>()?);
    let stamps: Vec<i64> = (0_i64..).map(|i| i * step_us).take(stack.frames()).collect();
    let mut frames = NpyFrames::new(stack, FullScale::One, &stamps)?;
    let model = VoltmeterPreset::Davis346.model();
    let mut events = h5::Writer::create(Path::new(out), &StreamHeader { size, law: None, labelled: false })?;
    simulate_one(&mut frames, &model, Seed(7), &mut events, &mut |_| ControlFlow::Continue(()))?;
    events.finish(stamps.last().copied().unwrap_or(0))?;
    Ok(())
}
