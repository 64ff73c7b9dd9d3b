//! Events of a released stream, compared with the times that its frames predict. Frames and events
//! are read in step, each once.

use super::pictures::ReleasedPictures;
use super::trajectory::ReleasedStream;
use gs2e_check::drift::DriftLaw;
use gs2e_check::event_times::crossing::{BrightnessFrame, CrossingObserver, StreamClock};
use gs2e_event::{Event, EventFileError, EventSource as _, h5};
use gs2e_image::GreyImage;
use gs2e_num::units::Timestamp;
use gs2e_recipe::Recipe;
use gs2e_sensor::SensorChoice;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::front_end::FrontEnd;
use gs2e_tree::{TreeError, event_file};
use std::path::PathBuf;

/// A stream that is being compared, or the reason why the comparison says nothing.
#[derive(Debug)]
pub(super) enum CrossingWatch {
    Unfit(String),
    Events(Box<CrossingEvents>),
}

/// The events of a stream up to the latest frame.
#[derive(Debug)]
pub(super) struct CrossingEvents {
    law: DriftLaw,
    front_end: FrontEnd,
    /// The hot pixels; empty without any.
    is_hot: Vec<bool>,
    path: PathBuf,
    /// Stamp of the last frame, us.
    end_us: i64,
    /// `None` before the first frame.
    observer: Option<CrossingObserver>,
    reader: h5::Reader,
    chunk: Vec<Event>,
    /// Number of the events of the chunk that have been seen.
    consumed: usize,
}

impl CrossingWatch {
    /// Opens a stream. `frames` of the poses have a sharp frame.
    pub(super) fn open(
        stream: &ReleasedStream<'_>,
        pictures: &ReleasedPictures<'_>,
        frames: usize,
    ) -> Result<Self, TreeError> {
        let ReleasedStream { sensor, sensor_name, hot_hz, .. } = stream;
        let stamps_us = &pictures.motion.trajectory.stamps_us;
        // Known hot pixels are left out, so the law is that of the others.
        let law = match law_of_crossings(&sensor.without_hot_pixels(), pictures.recipe) {
            Ok(law) => law,
            Err(because) => return Ok(Self::Unfit(because.to_owned())),
        };
        // The times of crossings are predicted between neighbouring frames. With some frames
        // missing, the brightness between two may have gone up and down again.
        if frames < stamps_us.len() || frames < 2 {
            return Ok(Self::Unfit(format!(
                "{frames} of {} poses have a sharp frame, and the sensor saw them all",
                stamps_us.len()
            )));
        }
        Ok(Self::Events(Box::new(CrossingEvents {
            law,
            front_end: sensor.as_model().front_end(),
            is_hot: hot_hz.iter().map(|hz| *hz > 0.0).collect(),
            path: pictures.files.display_path(&event_file(*sensor_name)),
            end_us: stamps_us[frames - 1],
            observer: None,
            reader: pictures.files.events(*sensor_name)?,
            chunk: Vec::new(),
            consumed: 0,
        })))
    }

    /// Takes the next frame, and sees the events up to its stamp.
    pub(super) fn see(&mut self, t_us: i64, frame: &GreyImage) -> Result<(), TreeError> {
        let Self::Events(events) = self else { return Ok(()) };
        let mut frame = brightness_frame(frame, t_us, &events.front_end);
        // A pixel that is cut off has no known drift, and is not compared.
        frame.cut.iter_mut().zip(&events.is_hot).for_each(|(cut, hot)| *cut |= *hot);
        match &mut events.observer {
            None => {
                let count = events.reader.count();
                events.observer = Some(CrossingObserver::new(events.law, frame, events.end_us, count));
            }
            Some(observer) => observer.take_frame(frame),
        }
        // All events after the last frame are seen with it.
        let until = if t_us >= events.end_us { i64::MAX } else { t_us };
        events.see_until(until).map_err(|e| TreeError::new(&events.path, e))
    }

    /// The comparison. The inner error is the reason why it says nothing.
    pub(super) fn finish(self) -> Result<StreamClock, String> {
        match self {
            Self::Unfit(because) => Err(because),
            Self::Events(events) => events
                .observer
                .map_or_else(|| Err("there are no sharp frames".to_owned()), CrossingObserver::finish),
        }
    }
}

impl CrossingEvents {
    fn see_until(&mut self, t_us: i64) -> Result<(), EventFileError> {
        let Some(observer) = &mut self.observer else { return Ok(()) };
        loop {
            // An event after this frame waits: its prediction needs the next one.
            let rest = &self.chunk[self.consumed..];
            let due = rest.iter().position(|event| event.t.floor_micros() > t_us);
            observer.see(&rest[..due.unwrap_or(rest.len())]);
            if let Some(due) = due {
                self.consumed += due;
                return Ok(());
            }
            self.consumed = 0;
            if !self.reader.next_chunk(&mut self.chunk)? {
                self.chunk.clear();
                return Ok(());
            }
        }
    }
}

/// The law by which frames predict the times of events.
fn law_of_crossings(sensor: &SensorChoice, recipe: &Recipe) -> Result<DriftLaw, &'static str> {
    if recipe.readout_us.is_some() {
        return Err("the rows of sharp frames have times of their own");
    }
    if recipe.tolerance.is_some() {
        return Err("with `tolerance`, the sensor saw other frames than those at the poses");
    }
    DriftLaw::for_crossings(sensor)
}

/// A frame of the release as the sensor sees it.
fn brightness_frame(
    GreyImage { luminance, colours }: &GreyImage,
    t_us: i64,
    front_end: &FrontEnd,
) -> BrightnessFrame {
    // Colours beyond black and white are cut off in 8 bits, and not for the sensor.
    let is_cut = |value: f32| !(0.5..=254.5).contains(&value);
    let cut = match colours {
        Some(colours) => colours.pixels().iter().map(|rgb| rgb.iter().any(|v| is_cut(*v))).collect(),
        None => luminance.pixels().iter().map(|v| is_cut(*v)).collect(),
    };
    let frame =
        DenseFrame { index: 0, t: Timestamp::from_micros(t_us), luminance: luminance.clone(), rate: None };
    BrightnessFrame { t_us, brightness: front_end.see(&frame, colours.as_ref()).luminance, cut }
}
