//! Stage `checks`: hands what was made of a trajectory to the validation passes.
//!
//! Neither the scene's id nor the trajectory's name is part of what is checked, so findings are stored with an empty
//! subject; whoever shows them says whose they are.

use super::{Context, Need, Stage, StageError, Target};
use crate::artifact::{EventStream, Files, Motion, Verdicts, write_json};
use crate::check::drift::DriftLaw;
use crate::check::tally::Observer;
use crate::check::{Limits, Subject, Tally, judge};
use crate::event::{EventSource, h5};
use crate::units::{Hertz, Ratio};
use serde::Serialize;

/// Name of the stage.
pub const NAME: &str = "checks";

/// Parameters: the recipe's limits and waivers.
#[derive(Debug, Serialize)]
pub struct Checking {
    /// Limits and waivers.
    pub limits: Limits,
}

impl Stage for Checking {
    const NAME: &'static str = NAME;
    const REVISION: u32 = 3;
    type Inputs = (Target<Motion>, Option<Target<EventStream>>);
    type Output = Verdicts;

    fn need(&self, files: &[Files]) -> Need {
        // The stream passes by in chunks; what the sensor saw at some frames is held, with the counts of each pixel.
        let held =
            files.iter().map(|files| files.size("brightness.npy") + files.size("poses.txt")).sum::<u64>();
        Need::memory([held, held, held])
    }

    fn run(
        &self,
        (motion, events): (Motion, Option<EventStream>),
        cx: &mut Context<'_>,
    ) -> Result<(), StageError> {
        let rate: Ratio = motion.report.rate.parse().map_err(StageError::work("read the frame rate"))?;
        let rate = Hertz(rate);
        let tally = events.as_ref().map(|stream| count(stream, &motion, rate, cx)).transpose()?;
        let simulation = events.as_ref().map(|stream| &stream.simulation);
        let findings = judge(&Subject {
            name: "",
            rate,
            trajectory: &motion.trajectory,
            speed: Some(&motion.report),
            sensor: simulation.map(|s| &s.sensor),
            account: simulation.map(|s| &s.account),
            tally: tally.as_ref(),
            flow: simulation.and_then(|s| s.flow_px),
            doubtful_share: simulation.and_then(|s| s.doubtful_share),
            limits: &self.limits,
        });
        let verdicts = Verdicts { findings, peak_ev_per_ms: tally.map(|t| t.peak_per_ms) };
        let out = cx.out.join("verdicts.json");
        write_json(&out, &verdicts).map_err(StageError::io(&out))
    }
}

/// Counts the stream in one pass.
fn count(stream: &EventStream, motion: &Motion, rate: Hertz, cx: &Context<'_>) -> Result<Tally, StageError> {
    let simulation = &stream.simulation;
    let seen = DriftLaw::of(&simulation.sensor).ok().map(|law| (law, &stream.anchors));
    let end_us = motion.trajectory.stamps_us.last().copied().unwrap_or(0);
    let mut observer = Observer::new(simulation.camera.size, rate, end_us, seen);
    let mut reader = h5::Reader::open(&stream.events).map_err(StageError::work("read events.h5"))?;
    let mut chunk = Vec::new();
    while reader.next_chunk(&mut chunk).map_err(StageError::work("read events.h5"))? {
        cx.go_on()?;
        observer.append(&chunk);
    }
    Ok(observer.finish())
}
