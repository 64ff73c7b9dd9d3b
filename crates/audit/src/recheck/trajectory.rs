//! The passes over one trajectory of a release.

use super::anchors::read_anchors;
use super::crossings::CrossingWatch;
use super::image_motion::MeasuredMotion;
use super::pictures::{ComposedPictures, ReleasedPictures};
use super::walk::{PictureGround, PicturesPresent, WalkedPictures, walk_pictures};
use gs2e_build::artifact::TrajectoryProduct;
use gs2e_check::drift::{DriftLaw, FrameRounding};
use gs2e_check::event_times::crossing::StreamClock;
use gs2e_check::motion::warp::{FlowAt, total_px};
use gs2e_check::records::exposure::{ExposureMean, ExposureMismatch};
use gs2e_check::records::objects::{judge_places, stated_motion};
use gs2e_check::tally::{StreamObserver, TallyReference};
use gs2e_check::{Finding, StreamTally, TrajectorySubject, judge_trajectory, records};
use gs2e_event::{EventFileError, EventSource as _, h5};
use gs2e_num::seed::{Seed, StreamPurpose};
use gs2e_num::units::{Hertz, Ratio};
use gs2e_recipe::{OutputKind, Recipe, SceneSource};
use gs2e_release::scene::TrajectoryPart;
use gs2e_sampling::exposure;
use gs2e_scene::camera::stereo::Rectification;
use gs2e_scene::motion::{ObjectMotion, PlaceLine};
use gs2e_sensor::frames::anchors::AnchorFrames;
use gs2e_sensor::front_end::FrontEnd;
use gs2e_sensor::{SensorChoice, front_end};
use gs2e_trajectory::path::CameraPath;
use gs2e_tree::{PictureKind, TrajectoryFiles, TreeError, event_file};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Largest number of blurred frames that are compared with their sharp frames.
const EXPOSURES: usize = 8;

/// A trajectory of a release.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReleasedTrajectory<'a> {
    pub(super) files: &'a TrajectoryFiles<'a>,
    pub(super) composed: &'a ComposedPictures,
    /// `scene/trajectory`.
    pub(super) name: &'a str,
    pub(super) recipe: &'a Recipe,
    pub(super) part: &'a TrajectoryPart,
    /// The stereo pair whose first camera sees along this trajectory.
    pub(super) pair: Option<Rectification>,
    /// Number of photos that the scene was made from.
    pub(super) photos: usize,
}

/// A stream of the tree.
pub(super) struct ReleasedStream<'a> {
    /// `scene/trajectory`, with the sensor's name if there are several.
    name: String,
    pub(super) sensor: &'a SensorChoice,
    pub(super) sensor_name: Option<&'a str>,
    /// Rates of its hot pixels, Hz; empty without any.
    pub(super) hot_hz: Vec<f64>,
}

/// The measurements on the files of a trajectory.
struct MeasuredTrajectory<'a> {
    motion: MeasuredMotion,
    pictures: WalkedPictures,
    streams: Vec<CountedStream<'a>>,
}

/// The frames and the flow that the events of a stream are counted against.
struct StreamGround<'a> {
    rate: Hertz,
    /// Stamp of the last pose, us.
    end_us: i64,
    flows: &'a [FlowAt],
    front_ends: &'a [FrontEnd],
    /// Some frames, as each front end shows them.
    anchors: Vec<AnchorFrames>,
}

/// A stream of the tree, counted.
struct CountedStream<'a> {
    /// `scene/trajectory`, with the sensor's name if there are several.
    name: String,
    sensor: &'a SensorChoice,
    tally: StreamTally,
    /// Times of the events against those that the frames predict, or the reason for their absence.
    crossings: Result<StreamClock, String>,
}

impl ReleasedTrajectory<'_> {
    pub(super) fn findings(&self) -> Result<Vec<Finding>, TreeError> {
        let motion = self.motion()?;
        let rate = motion.report.rate.parse::<Ratio>().map_err(|e| self.files.refusal("speed.json", e))?;
        let Self { files, composed, recipe, .. } = *self;
        let pictures = ReleasedPictures { files, composed, recipe, motion: &motion };
        let places = pictures.places()?;
        let measure = || self.measure(&pictures, places.as_deref(), Hertz(rate));
        let (measured, blur) = rayon::join(measure, || self.blur(&pictures));
        let MeasuredTrajectory { motion: measured, pictures: walked, streams: counted } = measured?;
        let limits = self.recipe.checks.of_trajectory();
        let whole = TrajectorySubject {
            speed: Some(&motion.report),
            views: self.key_views(),
            geometry: Some(&walked.geometry),
            blocks: (!walked.blocks.is_empty()).then_some(&walked.blocks),
            disparities: walked.disparities.as_ref(),
            flow: measured.steps_px,
            moved_px: total_px(&measured.flows, motion.trajectory.stamps_us.last().copied().unwrap_or(0)),
            tolerance: self.recipe.tolerance.map(|asked| asked.rms),
            coverage: measured.coverage,
            light_changes: self.recipe.lights.is_some(),
            moves_by_itself: self.recipe.moves_by_itself(),
            is_release: true,
            ..TrajectorySubject::new(self.name, Hertz(rate), &motion.trajectory, &limits)
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
        findings.push(blur?);
        findings.extend(self.inertial(&motion)?);
        findings.extend(places.map(|places| {
            judge_places(self.name, &self.recipe.objects, &motion.trajectory.stamps_us, &places)
        }));
        Ok(findings)
    }

    /// Reads the pictures in one walk and the streams twice: with the frames, and with what some of these
    /// show.
    fn measure(
        &self,
        pictures: &ReleasedPictures<'_>,
        places: Option<&[PlaceLine]>,
        rate: Hertz,
    ) -> Result<MeasuredTrajectory<'_>, TreeError> {
        let measured = MeasuredMotion::of_pictures(pictures)?;
        let present = PicturesPresent::find(pictures)?;
        let streams = self.released_streams()?;
        let open = |stream| CrossingWatch::open(stream, pictures, present.sharp.len());
        let mut watches: Vec<CrossingWatch> = streams.iter().map(open).collect::<Result<_, _>>()?;
        let models = || self.recipe.sensors_of(&self.part.name).iter().map(|(_, sensor)| sensor.as_model());
        let front_ends = front_end::distinct_front_ends(models());
        let anchors = read_anchors(pictures, &front_ends, measured.steps_px)?;
        let end_us = pictures.motion.trajectory.stamps_us.last().copied().unwrap_or(0);
        let (flows, front_ends) = (measured.flows.as_slice(), front_ends.as_slice());
        let counted_on = StreamGround { rate, end_us, flows, front_ends, anchors };
        let count = |stream| self.count_stream(stream, &counted_on);
        let ground = PictureGround { motions: places.map(motions_by_stamp), pair: self.pair.as_ref() };
        let mut tallies = Ok(Vec::new());
        // The readers of the walk stay on this thread.
        let walked = rayon::in_place_scope(|scope| {
            scope.spawn(|_| tallies = streams.par_iter().map(count).collect());
            walk_pictures(pictures, &present, &ground, &mut watches)
        })?;
        let tallies: Vec<StreamTally> = tallies?;
        let crossings = watches.into_iter().map(CrossingWatch::finish);
        let counted = streams.into_iter().zip(tallies).zip(crossings).map(|((stream, tally), crossings)| {
            let ReleasedStream { name, sensor, .. } = stream;
            CountedStream { name, sensor, tally, crossings }
        });
        let streams = counted.collect();
        Ok(MeasuredTrajectory { motion: measured, pictures: walked, streams })
    }

    fn motion(&self) -> Result<TrajectoryProduct, TreeError> {
        let trajectory = self.files.poses()?;
        if trajectory.stamps_us.is_empty() {
            return Err(self.files.refusal("poses.txt", "it has no pose"));
        }
        Ok(TrajectoryProduct { trajectory, report: self.files.speeds()? })
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

    /// The streams that are in the tree.
    fn released_streams(&self) -> Result<Vec<ReleasedStream<'_>>, TreeError> {
        let mut found = Vec::new();
        let Recipe { seed, scene, .. } = self.recipe;
        let seed = Seed::for_stream(*seed, scene, &self.part.name, StreamPurpose::Sensor);
        for (sensor_name, sensor) in self.recipe.sensors_of(&self.part.name).iter() {
            if self.files.has(&event_file(sensor_name))? {
                let of = |stream| format!("{}/{stream}", self.name);
                let name = sensor_name.map_or_else(|| self.name.to_owned(), of);
                let hot_hz = sensor.hot_pixels().rates_hz(seed, self.files.camera.size);
                found.push(ReleasedStream { name, sensor, sensor_name, hot_hz });
            }
        }
        Ok(found)
    }

    fn count_stream(
        &self,
        stream: &ReleasedStream<'_>,
        ground: &StreamGround<'_>,
    ) -> Result<StreamTally, TreeError> {
        let between = self.recipe.tolerance.map_or(0.0, |asked| asked.rms);
        let front_end = stream.sensor.as_model().front_end();
        let of = ground.front_ends.iter().position(|other| *other == front_end);
        let anchors = of.and_then(|i| ground.anchors.get(i));
        // The hot pixels are known, so the law is that of the others.
        let sensor = stream.sensor.without_hot_pixels();
        let law = DriftLaw::for_sensor(&sensor).with_rounding(FrameRounding { front_end, between });
        let reader = self.files.events(stream.sensor_name)?;
        let against = TallyReference {
            observed: anchors.map(|anchors| (law, anchors)),
            flows: ground.flows,
            dead_us: stream.sensor.dead_us(),
            hot_hz: &stream.hot_hz,
            labelled: reader.labelled(),
        };
        let observer = StreamObserver::new(self.files.camera.size, ground.rate, ground.end_us, against);
        count_events(reader, observer).map_err(|e| self.files.refusal(&event_file(stream.sensor_name), e))
    }

    /// Compares some blurred frames with the mean of their sharp frames.
    fn blur(&self, pictures: &ReleasedPictures<'_>) -> Result<Finding, TreeError> {
        if !self.recipe.outputs_of(&self.part.name).contains(&OutputKind::Blur) {
            return Ok(records::blur_not_compared(self.name, "the recipe asks for none"));
        }
        let frames = self.recipe.shutter.frames;
        let stated = self.part.blur.as_ref().and_then(|blur| blur["subframes"].as_u64());
        let subframes = stated.and_then(|n| u32::try_from(n).ok()).unwrap_or(u32::MAX);
        let centres = exposure::exposure_centres(pictures.motion.trajectory.world_from_camera.len(), frames);
        let step = centres.len().div_ceil(EXPOSURES).max(1);
        let poses: Vec<usize> = centres.into_iter().step_by(step).collect();
        let compare =
            |pose: &usize| Ok(exposed(pictures, *pose, subframes)?.map(|mismatch| (*pose, mismatch)));
        let compared: Vec<Option<_>> = poses.par_iter().map(compare).collect::<Result<_, TreeError>>()?;
        let compared: Vec<_> = compared.into_iter().flatten().collect();
        Ok(records::judge_blur(self.name, &compared))
    }
}

/// The motions of the objects at each stamp, in the order of their lines, which [`judge_places`] judges.
fn motions_by_stamp(places: &[PlaceLine]) -> BTreeMap<i64, Vec<ObjectMotion>> {
    let mut found = BTreeMap::<i64, Vec<ObjectMotion>>::new();
    for line in places {
        found.entry(line.stamp_us).or_default().extend(stated_motion(line));
    }
    found
}

/// Compares the blurred frame at a pose, if it and all of its sharp frames are in the tree.
fn exposed(
    pictures: &ReleasedPictures<'_>,
    pose: usize,
    subframes: u32,
) -> Result<Option<ExposureMismatch>, TreeError> {
    if pictures.is_rolling() {
        return Ok(None);
    }
    let Some(blurred) = pictures.colours(PictureKind::Blur, pose)? else { return Ok(None) };
    let shutter = pictures.recipe.shutter;
    let half = shutter.frames as usize / 2;
    let mut mean = ExposureMean::new(pictures.files.camera.size.pixels(), shutter.mean);
    // `exposure_centres` leaves half an exposure on each side of a pose, so this neither underflows nor ends
    // early.
    for frame in pose - half..=pose + half {
        let Some(sharp) = pictures.colours(PictureKind::Sharp, frame)? else { return Ok(None) };
        mean.add(&sharp);
    }
    Ok(Some(mean.compare(&blurred, subframes)))
}

fn count_events(
    mut reader: h5::Reader,
    mut observer: StreamObserver<'_>,
) -> Result<StreamTally, EventFileError> {
    let (mut chunk, mut following) = (Vec::new(), Vec::new());
    let mut more = reader.next_chunk(&mut chunk)?;
    while more {
        // The reader stays on this thread.
        more = rayon::in_place_scope(|scope| {
            scope.spawn(|_| observer.append(&chunk));
            reader.next_chunk(&mut following)
        })?;
        std::mem::swap(&mut chunk, &mut following);
    }
    Ok(observer.finish())
}
