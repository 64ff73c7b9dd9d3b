//! Event-3DGS (Han et al., NeurIPS 2024; GitHub lanpokn/Event-3DGS at d6d12b8), and the COLMAP model
//! alone.
//!
//! | folder | content |
//! |---|---|
//! | `images`, `images_event` | pictures that were integrated from events, 8 bits, three channels |
//! | `renders` | sharp frames |
//! | `sparse/0` | COLMAP model: `cameras.bin`, `images.bin`, `points3D.bin` |
//!
//! The program reads no events. Each picture is the brightness of the first sharp frame, moved by a
//! threshold for each event up to the stamp of the frame, and mapped back to grey through the
//! sensor's own law, so that no threshold has to be known. Greys are 1 to 255: the program takes
//! `ln(grey + 1e-8)`, and a step from 0 to 1 would count as 75 thresholds.
//!
//! `colmap` is the model with sharp frames in `images`, for any trainer that reads COLMAP.

use super::camera_needs::{centred_camera, products, unmet_events, unmet_frames, unmet_held_out_views};
use crate::brightness::sensor_brightness;
use crate::{
    ExportError, ExportFolder, ExportFormat, ExportLoss, ExportPlan, TestViews, UnmetNeed, geometry,
};
use gs2e_event::Polarity;
use gs2e_image::{Image, luminance, png};
use gs2e_num::units::Timestamp;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::{SensorModel, WHITE};
use gs2e_source::colmap::write::{WrittenImage, write_model};
use serde_json::{Value, json};

/// The layout of Event-3DGS.
pub(super) static EVENT_3DGS: ExportFormat =
    ExportFormat::new("event-3dgs", "github.com/lanpokn/Event-3DGS at d6d12b8", unmet, losses, write);

/// A COLMAP model with its images.
pub(super) static COLMAP: ExportFormat = ExportFormat::new(
    "colmap",
    "github.com/colmap/colmap at 5d968cf",
    colmap_unmet,
    colmap_losses,
    write_colmap,
);

/// Its script of evaluation reads the picture of this index.
const MIN_FRAMES: usize = 86;
/// It keeps four pictures per frame open, and systems allow 1,024 open files.
const MAX_FRAMES: usize = 250;

fn unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_events(plan), unmet_frames(plan, MIN_FRAMES), unmet_points(plan), unmet_held_out_views(plan)]
}

fn losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = centred_camera(plan, 0.5, false);
    losses.push(ExportLoss::lost("events", "times, polarities and thresholds: pictures stand for them"));
    losses.push(ExportLoss::derived("images", "integrated from the first sharp frame, in steps of 8 bits"));
    losses.push(ExportLoss::derived("points", "lifted from depth"));
    losses.push(ExportLoss::lost("views", "the program chooses its test views: 5, 25, 45, 65, 85"));
    losses.push(products(&["blur", "flow", "labels of events"]));
    losses
}

fn write(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    let frames = thinned(&plan.frames);
    out.write_frames("renders", plan.subject, &frames)?;
    let events = integrate(plan, &frames, out)?;
    let points = write_model_files(plan, &frames, out)?;
    Ok(json!({
        "events": events, "frames": frames, "points": points,
        "command": "python train.py -s DIR --event --gray",
    }))
}

fn colmap_unmet(plan: &ExportPlan<'_>) -> Vec<Option<UnmetNeed>> {
    vec![unmet_frames(plan, 1), unmet_points(plan)]
}

fn colmap_losses(plan: &ExportPlan<'_>) -> Vec<ExportLoss> {
    let mut losses = vec![products(&["events", "blur", "depth", "flow"])];
    losses.push(ExportLoss::derived("points", "lifted from depth"));
    if matches!(plan.test, TestViews::From(_)) {
        losses.push(ExportLoss::lost("views", "frames of the other trajectory: a model has no sets"));
    }
    losses
}

fn write_colmap(plan: &ExportPlan<'_>, out: &mut ExportFolder<'_>) -> Result<Value, ExportError> {
    out.write_frames("images", plan.subject, &plan.frames)?;
    let points = write_model_files(plan, &plan.frames, out)?;
    let held_out: Vec<Option<usize>> = match plan.test {
        TestViews::Every(_) => {
            let of = |pose: &usize| plan.frames.iter().position(|frame| frame == pose);
            plan.test_frames().1.iter().map(of).collect()
        }
        TestViews::From(_) => Vec::new(),
    };
    Ok(json!({ "points": points, "held_out": held_out }))
}

/// First points are needed, and only depth has them.
pub(super) fn unmet_points(plan: &ExportPlan<'_>) -> Option<UnmetNeed> {
    plan.subject
        .depth
        .is_empty()
        .then(|| UnmetNeed::new("needs depth to place the first points", "outputs: [depth]"))
}

/// At most [`MAX_FRAMES`] frames, at equal distances.
fn thinned(frames: &[usize]) -> Vec<usize> {
    frames.iter().copied().step_by(frames.len().div_ceil(MAX_FRAMES).max(1)).collect()
}

/// Writes the model, and returns the number of its points.
pub(super) fn write_model_files(
    plan: &ExportPlan<'_>,
    frames: &[usize],
    out: &mut ExportFolder<'_>,
) -> Result<usize, ExportError> {
    let subject = plan.subject;
    let image = |(index, pose): (usize, &usize)| WrittenImage {
        name: format!("{index:06}.png"),
        world_from_camera: subject.poses.world_from_camera[*pose],
        camera: subject.camera,
    };
    let images: Vec<WrittenImage> = frames.iter().enumerate().map(image).collect();
    let points = geometry::lifted_points(plan)?.0;
    // The writer names all three files itself.
    let first = out.file("sparse/0/cameras.bin")?;
    for other in ["images.bin", "points3D.bin"] {
        out.file(&format!("sparse/0/{other}"))?;
    }
    let dir = first.parent().expect("the file lies in a folder");
    write_model(dir, &images, &points).map_err(ExportError::unwritten(dir))?;
    Ok(points.len())
}

/// Brightness per pixel, moved by events.
struct Integral<'a> {
    plan: &'a ExportPlan<'a>,
    brightness: Vec<f64>,
    /// Brightness halfway between the greys k and k+1, for k = 1 to 254.
    steps: Vec<f64>,
}

impl<'a> Integral<'a> {
    /// Starts with the first sharp frame.
    fn new(plan: &'a ExportPlan<'a>, first: usize) -> Result<Self, ExportError> {
        let model = plan.sensor()?.as_model();
        let greys = sensor_greys(model, &plan.subject.sharp_picture(first)?);
        let brightness = greys.pixels().iter().map(|grey| model.brightness(f64::from(*grey))).collect();
        let steps = (1..255u8).map(|k| sensor_brightness(model, (f64::from(k) + 0.5) / WHITE)).collect();
        Ok(Self { plan, brightness, steps })
    }

    /// Writes the picture of this index.
    fn write(&self, index: usize, out: &mut ExportFolder<'_>) -> Result<(), ExportError> {
        let grey = |brightness: &f64| {
            let below = self.steps.partition_point(|step| step < brightness);
            // 254 steps: the result is 1 to 255.
            [u8::try_from(below + 1).unwrap_or(u8::MAX); 3]
        };
        let picture =
            Image::from_vec(self.plan.subject.camera.size, self.brightness.iter().map(grey).collect());
        let mut file = Vec::new();
        png::write_image(&picture, &mut file).map_err(|e| ExportError::Data(e.to_string()))?;
        let name = format!("images/{index:06}.png");
        out.write_file(&name, &file)?;
        out.repeat(&name, &format!("images_event/{index:06}.png"))
    }
}

/// A picture as the sensor's pixels see it, grey.
fn sensor_greys(model: &dyn SensorModel, picture: &Image<[u8; 3]>) -> Image<f32> {
    let colours = picture.pixels().iter().map(|rgb| rgb.map(f32::from)).collect::<Vec<_>>();
    // A sensor that decodes colours ignores this grey.
    let greys = colours.iter().map(|rgb| luminance(*rgb)).collect();
    let frame = DenseFrame {
        index: 0,
        t: Timestamp::from_micros(0),
        luminance: Image::from_vec(picture.size(), greys),
        rate: None,
    };
    model.front_end().see(&frame, Some(&Image::from_vec(picture.size(), colours))).luminance
}

/// Writes the pictures of the frames, and returns the number of events in them.
fn integrate(
    plan: &ExportPlan<'_>,
    frames: &[usize],
    out: &mut ExportFolder<'_>,
) -> Result<u64, ExportError> {
    let stamps: Vec<i64> = frames.iter().map(|pose| plan.stamp_us(*pose)).collect();
    let mut integral = Integral::new(plan, frames[0])?;
    let (on, off) = plan.sensor()?.as_model().contrast();
    let width = plan.subject.camera.size.width as usize;
    let (mut next, mut events) = (0, 0);
    plan.for_each_event(|event, t_us| {
        // An event at the stamp of a frame belongs to its picture.
        while stamps.get(next).is_some_and(|stamp| *stamp < t_us) {
            integral.write(next, out)?;
            next += 1;
            out.report()?;
        }
        // The brightness of the first frame holds at its stamp, so earlier events are in it already.
        if t_us > stamps[0] && next < stamps.len() {
            let at = usize::from(event.y) * width + usize::from(event.x);
            integral.brightness[at] += if event.polarity == Polarity::On { on } else { -off };
            events += 1;
            out.count_event()?;
        }
        Ok(())
    })?;
    // Frames after the last event have the picture of that time.
    for index in next..stamps.len() {
        integral.write(index, out)?;
    }
    Ok(events)
}
