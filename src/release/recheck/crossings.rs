//! Events of a released stream, compared with the times that its frames predict.

use super::RecheckError;
use super::unreadable_file;
use super::views::ReleasedPictures;
use crate::check::drift::DriftLaw;
use crate::check::event_times::crossing::{CrossingFit, CrossingObserver, SeenFrame};
use crate::event::{EventSource, h5};
use crate::frames::DenseFrame;
use crate::image::GreyImage;
use crate::recipe::Recipe;
use crate::sensor::SensorChoice;
use crate::sensor::front_end::FrontEnd;
use crate::units::Timestamp;
use std::path::Path;

/// Compares the stream in the file at `path`. The inner error is the reason why that says nothing.
pub(super) fn measure_crossings(
    of: &ReleasedPictures<'_>,
    path: &Path,
    (sensor, recipe): (&SensorChoice, &Recipe),
) -> Result<Result<CrossingFit, String>, RecheckError> {
    let law = match law_of_crossings(sensor, recipe) {
        Ok(law) => law,
        Err(because) => return Ok(Err(because.to_owned())),
    };
    let stamps = &of.motion.trajectory.stamps_us;
    let frames = of.poses_with("sharp", "png")?.len();
    if frames < stamps.len() || frames < 2 {
        let because =
            format!("{frames} of {} poses have a sharp frame, and the sensor saw them all", stamps.len());
        return Ok(Err(because));
    }
    let front_end = sensor.as_model().front_end();
    let seen = |pose: usize| Ok(seen_frame(of.frame(pose)?, stamps[pose], &front_end));
    let mut observer = CrossingObserver::new(law, seen(0)?, stamps[frames - 1]);
    let mut next = 1;
    let unreadable = |e: crate::event::EventFileError| unreadable_file(path, e);
    let mut reader = h5::Reader::open(path).map_err(unreadable)?;
    let mut chunk = Vec::new();
    while reader.next_chunk(&mut chunk).map_err(unreadable)? {
        for event in &chunk {
            while event.t.floor_micros() > observer.latest_us() && next < frames {
                observer.take_frame(&seen(next)?);
                next += 1;
            }
            observer.see(*event);
        }
    }
    Ok(observer.finish())
}

/// The law by which frames predict the times of events.
fn law_of_crossings(sensor: &SensorChoice, recipe: &Recipe) -> Result<DriftLaw, &'static str> {
    if recipe.tolerance.is_some() {
        return Err("with `tolerance`, the sensor saw other frames than those at the poses");
    }
    DriftLaw::for_crossings(sensor)
}

/// A frame of the release as the sensor sees it.
fn seen_frame(GreyImage { luminance, colours }: GreyImage, t_us: i64, front_end: &FrontEnd) -> SeenFrame {
    // Colours beyond black and white are cut off in 8 bits, and not for the sensor.
    let is_cut = |value: f32| !(0.5..=254.5).contains(&value);
    let cut = match &colours {
        Some(colours) => colours.pixels().iter().map(|rgb| rgb.iter().any(|v| is_cut(*v))).collect(),
        None => luminance.pixels().iter().map(|v| is_cut(*v)).collect(),
    };
    let frame = DenseFrame { index: 0, t: Timestamp::from_micros(t_us), luminance, rate: None };
    SeenFrame { t_us, brightness: front_end.see(&frame, colours.as_ref()).luminance, cut }
}
