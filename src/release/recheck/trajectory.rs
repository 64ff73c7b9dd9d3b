//! The passes over one trajectory of a release.

use super::crossings::measure_crossings;
use super::geometry::measure_geometry;
use super::pictures::{MeasuredMotion, PictureFolder};
use super::views::ReleasedPictures;
use super::{AuditedTree, RecheckError};
use crate::artifact::{EventStream, TrajectoryProduct};
use crate::camera::Camera;
use crate::check::drift::{DriftLaw, FrameRounding};
use crate::check::event_times::crossing::CrossingFit;
use crate::check::records;
use crate::check::records::exposure::{ExposureMean, ExposureMismatch};
use crate::check::tally::{StreamObserver, TallyReference};
use crate::check::{Finding, StreamTally, TrajectorySubject, judge_trajectory};
use crate::event::{EventSource, h5};
use crate::recipe::{OutputKind, Recipe, SceneSource};
use crate::release::scene::TrajectoryPart;
use crate::sampling::exposure;
use crate::sensor::SensorChoice;
use crate::sensor::front_end;
use crate::trajectory::Trajectory;
use crate::trajectory::path::CameraPath;
use crate::units::{Hertz, Ratio};
use std::path::Path;

/// Largest number of blurred frames that are compared with their sharp frames.
const EXPOSURES: usize = 8;

/// A trajectory of a release.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReleasedTrajectory<'a> {
    pub(super) tree: AuditedTree<'a>,
    /// Path of its folder in the tree.
    pub(super) folder: &'a str,
    /// `scene/trajectory`.
    pub(super) name: &'a str,
    pub(super) recipe: &'a Recipe,
    pub(super) camera: Camera,
    pub(super) part: &'a TrajectoryPart,
    /// Number of photos that the scene was made from.
    pub(super) photos: usize,
}

/// A stream of the tree, counted.
struct CountedStream<'a> {
    /// `scene/trajectory`, with the sensor's name if there are several.
    name: String,
    sensor: &'a SensorChoice,
    tally: StreamTally,
    /// Times of the events against those that the frames predict, or the reason for their absence.
    crossings: Result<CrossingFit, String>,
}

impl ReleasedTrajectory<'_> {
    pub(super) fn findings(&self) -> Result<Vec<Finding>, RecheckError> {
        let motion = self.motion()?;
        let speed = format!("{}/speed.json", self.folder);
        let rate = motion.report.rate.parse::<Ratio>().map_err(|e| self.tree.refusal(&speed, e))?;
        let pictures = PictureFolder {
            tree: self.tree,
            path: self.folder,
            recipe: self.recipe,
            motion: &motion,
            camera: self.camera,
        };
        let measured = pictures.measured_motion()?;
        let views =
            ReleasedPictures { tree: self.tree, folder: self.folder, camera: self.camera, motion: &motion };
        let geometry = measure_geometry(&views)?;
        let counted = self.count_streams(Hertz(rate), (&pictures, &views), &measured)?;
        // Fields without data in a release are `None`, and their passes report that they were not
        // run.
        let whole = TrajectorySubject {
            name: self.name,
            rate: Hertz(rate),
            trajectory: &motion.trajectory,
            speed: Some(&motion.report),
            sensor: None,
            account: None,
            tally: None,
            resampled: None,
            views: self.key_views(),
            geometry: Some(&geometry),
            crossings: None,
            foreign: None,
            flow: measured.steps_px,
            tolerance: self.recipe.tolerance.map(|asked| asked.rms),
            coverage: measured.coverage,
            doubtful_share: None,
            is_release: true,
            limits: &self.recipe.checks.of_trajectory(),
        };
        let streams: Vec<TrajectorySubject<'_>> = counted
            .iter()
            .map(|CountedStream { name, sensor, tally, crossings }| TrajectorySubject {
                name,
                sensor: Some(sensor),
                tally: Some(tally),
                crossings: Some(crossings),
                ..whole
            })
            .collect();
        let mut findings = judge_trajectory(&whole, &streams);
        findings.push(self.blur(&pictures)?);
        Ok(findings)
    }

    fn motion(&self) -> Result<TrajectoryProduct, RecheckError> {
        let poses = format!("{}/poses.txt", self.folder);
        let trajectory = Trajectory::read_poses(self.tree.read(&poses)?.as_slice())
            .map_err(|e| self.tree.refusal(&poses, e))?;
        if trajectory.stamps_us.is_empty() {
            return Err(self.tree.refusal(&poses, "it has no pose"));
        }
        Ok(TrajectoryProduct { trajectory, report: self.tree.json(&format!("{}/speed.json", self.folder))? })
    }

    /// Number of views or key poses that the path follows, if the files say so.
    fn key_views(&self) -> Option<usize> {
        let trajectory =
            self.recipe.trajectories.iter().find(|trajectory| trajectory.name == self.part.name)?;
        match (&trajectory.path, &self.recipe.source) {
            (CameraPath::Keyframes(path), _) => Some(path.poses.len()),
            (CameraPath::Refine(_), SceneSource::Procedural(scene)) => usize::try_from(scene.views).ok(),
            (CameraPath::Refine(_), _) => Some(self.photos).filter(|n| *n > 0),
            // An orbit follows no views; a novel trajectory's report has its key poses.
            (CameraPath::Orbit(_) | CameraPath::Novel(_), _) => None,
        }
    }

    /// Counts each stream that is in the tree, with its name.
    fn count_streams<'s>(
        &'s self,
        rate: Hertz,
        (pictures, views): (&PictureFolder<'_>, &ReleasedPictures<'_>),
        measured: &MeasuredMotion,
    ) -> Result<Vec<CountedStream<'s>>, RecheckError> {
        let sensors = self.recipe.sensors_of(&self.part.name);
        let models = || sensors.iter().map(|(_, sensor)| sensor.as_model());
        let front_ends = front_end::distinct_front_ends(models());
        let anchors = pictures.anchors(&front_ends, measured.steps_px)?;
        let end_us = pictures.motion.trajectory.stamps_us.last().copied().unwrap_or(0);
        let between = self.recipe.tolerance.map_or(0.0, |asked| asked.rms);
        let mut counted = Vec::new();
        for (stream, sensor) in sensors.iter() {
            let events = format!("{}/{}", self.folder, EventStream::released_name(stream));
            // Also checks that no link leads out of the tree: the reader below opens by path.
            if !self.tree.has(&events)? {
                continue;
            }
            let path = self.tree.path_of(&events);
            let front_end = sensor.as_model().front_end();
            let seen = front_ends.iter().position(|other| *other == front_end).and_then(|i| anchors.get(i));
            let rounding = FrameRounding { front_end, between };
            let law = DriftLaw::for_sensor(sensor).with_rounding(rounding);
            let against = TallyReference {
                seen: seen.map(|seen| (law, seen)),
                flows: &measured.flows,
                dead_us: sensor.dead_us(),
            };
            let observer = StreamObserver::new(self.camera.size, rate, end_us, against);
            let tally = count_stream(&path, observer).map_err(|e| self.tree.refusal(&events, e))?;
            let name =
                stream.map_or_else(|| self.name.to_owned(), |stream| format!("{}/{stream}", self.name));
            let crossings = measure_crossings(views, &path, (sensor, self.recipe))?;
            counted.push(CountedStream { name, sensor, tally, crossings });
        }
        Ok(counted)
    }

    /// Compares some blurred frames with the mean of their sharp frames.
    fn blur(&self, pictures: &PictureFolder<'_>) -> Result<Finding, RecheckError> {
        if !self.recipe.outputs.contains(&OutputKind::Blur) {
            return Ok(records::blur_not_compared(self.name, "the recipe asks for no blurred frames"));
        }
        let frames = self.recipe.shutter.frames;
        let stated = self.part.blur.as_ref().and_then(|blur| blur["subframes"].as_u64());
        let subframes = stated.and_then(|n| u32::try_from(n).ok()).unwrap_or(u32::MAX);
        let centres = exposure::exposure_centres(pictures.motion.trajectory.world_from_camera.len(), frames);
        let step = centres.len().div_ceil(EXPOSURES).max(1);
        let mut compared = Vec::new();
        for pose in centres.into_iter().step_by(step) {
            compared.extend(exposed(pictures, pose, (frames, subframes))?.map(|mismatch| (pose, mismatch)));
        }
        Ok(records::judge_blur(self.name, &compared))
    }
}

/// Compares the blurred frame at a pose, if it and all of its sharp frames are in the tree.
fn exposed(
    pictures: &PictureFolder<'_>,
    pose: usize,
    (frames, subframes): (u32, u32),
) -> Result<Option<ExposureMismatch>, RecheckError> {
    let Some(blurred) = pictures.picture("blur", pose)? else { return Ok(None) };
    let half = frames as usize / 2;
    let mut mean = ExposureMean::new(pictures.camera.size.pixels());
    for frame in pose - half..=pose + half {
        let Some(sharp) = pictures.picture("sharp", frame)? else { return Ok(None) };
        mean.add(&sharp);
    }
    Ok(Some(mean.compare(&blurred, subframes)))
}

fn count_stream(path: &Path, mut observer: StreamObserver<'_>) -> Result<StreamTally, String> {
    let mut reader = h5::Reader::open(path).map_err(|e| e.to_string())?;
    let mut chunk = Vec::new();
    while reader.next_chunk(&mut chunk).map_err(|e| e.to_string())? {
        observer.append(&chunk);
    }
    Ok(observer.finish())
}
