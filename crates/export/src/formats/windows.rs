//! Samples for networks: the events between two consecutive sharp frames, and the second frame.

use super::camera_needs::{products, unmet_events, unmet_frames, unmet_held_out_views};
use crate::{ExportError, ExportFolder, ExportLoss, ExportPlan, UnmetNeed, poses};
use gs2e_event::Event;
use gs2e_trajectory::text::significant_digits;
use serde_json::{Value, json};

/// Largest number of events of a window: 300 MB.
const MAX_EVENTS: usize = 1 << 25;

/// The events from one sharp frame to the next. The time of the second frame does not belong to it, except in
/// the last window.
#[derive(Debug, Default)]
pub(super) struct EventWindow {
    /// Number of the window, from 0.
    pub(super) number: usize,
    /// Pose of the first frame, and of the second.
    pub(super) frames: [usize; 2],
    /// True if the second frame is held out.
    pub(super) is_test: bool,
    /// Times, us from the first frame.
    pub(super) t: Vec<u32>,
    pub(super) x: Vec<u16>,
    pub(super) y: Vec<u16>,
    /// 1 for ON, 0 for OFF.
    pub(super) p: Vec<u8>,
}

/// What was written, and what was not.
#[derive(Debug, Default)]
pub(super) struct WindowCounts {
    train: usize,
    test: usize,
    events: u64,
    /// Events before the first frame or after the last one.
    outside: u64,
}

impl WindowCounts {
    pub(super) fn facts(&self) -> Value {
        json!({
            "train": self.train, "test": self.test, "events": self.events,
            "events_before_the_first_or_after_the_last_frame": self.outside,
        })
    }
}

impl EventWindow {
    /// Name of the set that it belongs to.
    pub(super) fn split(&self) -> &'static str {
        if self.is_test { "test" } else { "train" }
    }

    /// Start and end, in the times of the release, us.
    pub(super) fn span_us(&self, plan: &ExportPlan<'_>) -> [i64; 2] {
        self.frames.map(|pose| plan.subject.poses.stamps_us[pose])
    }

    /// Everything but events and pictures. Poses are camera to world by rows, OpenCV axes, and the pixel (0,
    /// 0) has its centre at (0.5, 0.5). A lens has the coefficients of OpenCV, in OpenCV's order.
    pub(super) fn description(&self, plan: &ExportPlan<'_>) -> Result<Value, ExportError> {
        let [start, end] = self.span_us(plan);
        let camera = &plan.subject.camera;
        let stamps = &plan.subject.poses.stamps_us;
        let pose = |pose: usize| {
            let rows = poses::matrix(&plan.subject.poses.world_from_camera[pose]);
            let numbers =
                rows.map(|row| row.map(significant_digits).map(|text| json!(text.parse::<f64>().ok())));
            json!({ "t_us": stamps[pose], "world_from_camera": numbers })
        };
        let (c_on, c_off) = plan.sensor()?.as_model().contrast();
        let mut description = json!({
            "scene": plan.subject.scene, "trajectory": plan.subject.trajectory,
            "sensor": plan.subject.sensor_name, "window": self.number, "split": self.split(),
            "t0_us": start, "t1_us": end,
            "width": camera.size.width, "height": camera.size.height,
            "K": [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]],
            "c_on": c_on, "c_off": c_off,
            "poses": (self.frames[0]..=self.frames[1]).map(pose).collect::<Vec<_>>(),
        });
        if let Some(lens) = camera.lens {
            description["lens"] = json!(lens);
        }
        Ok(description)
    }

    fn push(&mut self, event: &Event, t_us: i64) -> Result<(), ExportError> {
        let t = u32::try_from(t_us).ok().filter(|_| self.t.len() < MAX_EVENTS).ok_or_else(|| {
            let number = self.number;
            ExportError::Data(format!(
                "window {number} is longer than 2^32 us or has more than {MAX_EVENTS} events: choose a smaller sharp.every"
            ))
        })?;
        self.t.push(t);
        self.x.push(event.x);
        self.y.push(event.y);
        self.p.push(event.polarity as u8);
        Ok(())
    }

    /// Empties it for the next one, and keeps its memory.
    fn restart(&mut self, number: usize, frames: [usize; 2], is_test: bool) {
        self.t.clear();
        self.x.clear();
        self.y.clear();
        self.p.clear();
        (self.number, self.frames, self.is_test) = (number, frames, is_test);
    }
}

/// Requirements of a layout of windows.
pub(super) fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_events(plan), unmet_frames(plan, 2), unmet_held_out_views(plan)]
}

/// Losses of a layout of windows.
pub(super) fn losses(depth: bool) -> Vec<ExportLoss> {
    let names = ["blur", "flow", "labels of events", "the first sharp frame", "depth"];
    vec![products(&names[..if depth { 4 } else { 5 }])]
}

/// Calls `see` with each window in turn. One is in memory at a time.
pub(super) fn for_each_window(
    plan: &ExportPlan<'_>,
    out: &mut ExportFolder<'_>,
    mut see: impl FnMut(&EventWindow, &mut ExportFolder<'_>) -> Result<(), ExportError>,
) -> Result<WindowCounts, ExportError> {
    let held_out = plan.test_frames().1;
    let stamps: Vec<i64> = plan.frames.iter().map(|pose| plan.stamp_us(*pose)).collect();
    // `unmet` asks for two frames at least, so the first window has both of its ends.
    let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
    let mut window = EventWindow::default();
    let mut counts = WindowCounts::default();
    let start = |window: &mut EventWindow, number: usize| {
        let frames = [plan.frames[number], plan.frames[number + 1]];
        window.restart(number, frames, held_out.contains(&frames[1]));
    };
    let mut end = |window: &EventWindow, counts: &mut WindowCounts, out: &mut ExportFolder<'_>| {
        *(if window.is_test { &mut counts.test } else { &mut counts.train }) += 1;
        counts.events += window.t.len() as u64;
        see(window, out)
    };
    start(&mut window, 0);
    plan.for_each_event(|event, t_us| {
        if t_us < first || t_us > last {
            counts.outside += 1;
            return Ok(());
        }
        // The last window has no next one, and takes the events at its end.
        while window.number + 2 < stamps.len() && t_us >= stamps[window.number + 1] {
            end(&window, &mut counts, out)?;
            let next = window.number + 1;
            start(&mut window, next);
        }
        out.count_event()?;
        window.push(event, t_us - stamps[window.number])
    })?;
    loop {
        end(&window, &mut counts, out)?;
        if window.number + 2 >= stamps.len() {
            return Ok(counts);
        }
        let next = window.number + 1;
        start(&mut window, next);
    }
}
