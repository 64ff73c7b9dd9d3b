//! Products that follow from the recipe, the poses and the depth: inertial data, the places of objects, and
//! disparity.

use super::compared::ComparedFile;
use super::{AuditFault, FaultCode, TrustedTree, compare};
use glam::{DMat3, DQuat, DVec3};
use gs2e_build::artifact::{OBJECT_PLACES, TrajectoryProduct};
use gs2e_files as files;
use gs2e_image::{Image, Size, npy};
use gs2e_num::seed::{Seed, StreamPurpose};
use gs2e_recipe::OutputKind;
use gs2e_release::calibration;
use gs2e_release::published::PublishedScene;
use gs2e_release::scene::TrajectoryPart;
use gs2e_scene::camera::stereo::Rectification;
use gs2e_scene::motion::{MovingObject, ObjectMotion, ObjectRecord, SceneMotion, place_lines, write_places};
use gs2e_scene::objects::{ObjectSettings, ObjectSource};
use gs2e_trajectory::imu::files::{
    SAMPLES, SAMPLES_HEAD, SENSOR, STATES, STATES_HEAD, read_gravity, sensor_text, write_sample, write_state,
};
use gs2e_trajectory::imu::{ImuModel, ImuSampler};
use gs2e_trajectory::sampled::SampledPath;
use gs2e_tree::ReleaseFiles as _;
use rayon::prelude::*;
use std::io::{self, BufWriter, Cursor, Write as _};

/// Bytes that the text on the sensor has at most.
const SENSOR_BYTES: u64 = 1 << 16;

/// A trajectory of a scene that was read back.
#[derive(Clone, Copy)]
struct ReadTrajectory<'a> {
    tree: &'a TrustedTree<'a>,
    scene: &'a PublishedScene,
    part: &'a TrajectoryPart,
    motion: &'a TrajectoryProduct,
}

/// The faults of products that differ from what this program makes of the recipe and the other files.
pub(super) fn faults(
    tree: &TrustedTree<'_>,
    scene: &PublishedScene,
    part: &TrajectoryPart,
    motion: &TrajectoryProduct,
) -> Vec<AuditFault> {
    let read = ReadTrajectory { tree, scene, part, motion };
    let (imu, segmentation) = (OutputKind::Imu.name(), OutputKind::Segmentation.name());
    let mut faults = Vec::new();
    if let Some(model) = &scene.recipe.imu
        && [SAMPLES, STATES, SENSOR].iter().all(|name| tree.has(&read.path(imu, name)))
    {
        faults.extend(read.inertial(model));
    }
    if tree.has(&read.path(segmentation, OBJECT_PLACES)) {
        faults.extend(read.places(&read.path(segmentation, OBJECT_PLACES)));
    }
    faults.extend(read.disparity());
    faults
}

impl ReadTrajectory<'_> {
    fn path(&self, folder: &str, name: &str) -> String {
        format!("{}/{}/{folder}/{name}", self.scene.file.id, self.part.name)
    }

    fn bytes(&self, path: &str, limit: u64) -> Result<Vec<u8>, AuditFault> {
        self.tree
            .read(path, limit)
            .map_err(|e| AuditFault::of_file(FaultCode::Unreadable, path, e.to_string()))
    }

    fn inertial(&self, model: &ImuModel) -> Vec<AuditFault> {
        let sensor = self.path(OutputKind::Imu.name(), SENSOR);
        let gravity = match self.gravity(model, &sensor) {
            Ok(gravity) => gravity,
            Err(fault) => return vec![fault],
        };
        let mut faults = Vec::from_iter(compare(self.tree, &sensor, sensor_text(model, gravity).as_bytes()));
        let [samples, states] = [SAMPLES, STATES].map(|name| self.path(OutputKind::Imu.name(), name));
        faults.extend(self.measured(model, gravity, [&samples, &states]));
        faults
    }

    /// Gravity by the recipe. Without its `up`, the direction is that of the captured views, which the tree
    /// has in the text on the sensor alone.
    fn gravity(&self, model: &ImuModel, sensor: &str) -> Result<DVec3, AuditFault> {
        if let Some(up) = model.up_or(None) {
            return Ok(-model.gravity * up.normalize_or_zero());
        }
        let fault = |code, message: String| AuditFault::of_file(code, sensor, message);
        let found = read_gravity(&self.bytes(sensor, SENSOR_BYTES)?);
        let found = found.map_err(|message| fault(FaultCode::Unreadable, message))?;
        // The components of a unit vector are rounded, and their sum of squares with them: some parts in
        // 1e16.
        if (found.length() - model.gravity).abs() <= 1e-12 * model.gravity {
            return Ok(found);
        }
        let message = format!("its gravity is not the {} m/s^2 of the recipe", model.gravity);
        Err(fault(FaultCode::NotComposed, message))
    }

    /// Measures the motion once more, and compares samples and states.
    fn measured(&self, model: &ImuModel, gravity: DVec3, [samples, states]: [&str; 2]) -> Option<AuditFault> {
        let recipe = &self.scene.recipe;
        let poses = &self.motion.trajectory.world_from_camera;
        let path = SampledPath::with_end_rates(poses, self.motion.seconds());
        let Ok(path) = path else {
            let message = "no path leads through the poses";
            return Some(AuditFault::of_file(FaultCode::NotComposed, states, message));
        };
        let seed = Seed::for_stream(recipe.seed, &recipe.scene, &self.part.name, StreamPurpose::Imu);
        // Samples and states advance together, so that the path is followed once.
        let mut at = samples;
        let mut compared = || -> io::Result<()> {
            let open = |path: &str| ComparedFile::open(&self.tree.path_of(path));
            let (mut shown, mut truth) = (BufWriter::new(open(samples)?), BufWriter::new(open(states)?));
            writeln!(shown, "{SAMPLES_HEAD}")?;
            at = states;
            writeln!(truth, "{STATES_HEAD}")?;
            for sample in ImuSampler::under(model, &path, gravity, seed) {
                at = samples;
                write_sample(&sample, &mut shown)?;
                at = states;
                write_state(&sample, &mut truth)?;
            }
            at = samples;
            shown.into_inner().map_err(io::IntoInnerError::into_error)?.finish()?;
            at = states;
            truth.into_inner().map_err(io::IntoInnerError::into_error)?.finish()
        };
        let because = compared().err()?;
        let message = format!("it is not what the recipe and the poses give: {because}");
        Some(AuditFault::of_file(FaultCode::NotComposed, at, message))
    }

    /// Compares the places of objects with their paths in the recipe.
    fn places(&self, path: &str) -> Option<AuditFault> {
        let objects = &self.scene.recipe.objects;
        let stamps = &self.motion.trajectory.stamps_us;
        let is_known = |object: &ObjectSettings| {
            object.stated_pivot().is_some() && !matches!(object.from, ObjectSource::Scene { .. })
        };
        let compared = if objects.iter().all(is_known) {
            let motion =
                SceneMotion::prepare(objects.iter().map(record).collect()).map_err(|e| e.to_string());
            motion.and_then(|motion| {
                let written = ComparedFile::open(&self.tree.path_of(path)).and_then(|file| {
                    let mut file = BufWriter::new(file);
                    write_places(Some(&motion), stamps, &mut file)?;
                    file.into_inner().map_err(io::IntoInnerError::into_error)?.finish()
                });
                written.map_err(|e| e.to_string())
            })
        } else {
            match self.bytes(path, files::MAX_DOCUMENT) {
                Ok(bytes) => compare_places(&bytes, objects, stamps),
                Err(fault) => return Some(fault),
            }
        };
        let message = format!("it is not what the recipe and the poses give: {}", compared.err()?);
        Some(AuditFault::of_file(FaultCode::NotComposed, path, message))
    }

    fn disparity(&self) -> Vec<AuditFault> {
        let (own, name) = (OutputKind::Disparity.name(), &self.part.name);
        let Some(pair) = calibration::rectification(&self.scene.recipe, &self.scene.file, self.part) else {
            return Vec::new();
        };
        let files: Vec<&str> = self.scene.in_folder(name, own).filter(|path| self.tree.has(path)).collect();
        files.into_par_iter().filter_map(|path| self.disparity_fault(&pair, path)).collect()
    }

    /// Compares a picture of disparity with the depth at its pose; without one, its signs with the order of
    /// the cameras.
    fn disparity_fault(&self, pair: &Rectification, path: &str) -> Option<AuditFault> {
        let file = path.rsplit('/').next().unwrap_or(path);
        let depth = self.path(OutputKind::Depth.name(), file);
        let size = self.scene.file.camera_of(self.part).camera().size;
        if !self.tree.has(&depth) {
            let found = self.values(path, size).ok()?;
            // No depth gives another sign, or 0.
            let is_wrong = |value: &f32| !value.is_nan() && f64::from(*value) * -pair.baseline <= 0.0;
            let wrong = found.into_iter().find(is_wrong)?;
            let message = format!("it holds {wrong}, which no depth gives with this order of the cameras");
            return Some(AuditFault::of_file(FaultCode::NotComposed, path, message));
        }
        // Pictures that cannot be read are reported by the audit of contents.
        let depth = Image::from_vec(size, self.values(&depth, size).ok()?);
        let mut wanted = Vec::new();
        npy::write_image(&pair.disparity_image(&depth), &mut wanted).expect("a Vec takes any bytes");
        compare(self.tree, path, &wanted)
    }

    fn values(&self, path: &str, size: Size) -> Result<Vec<f32>, String> {
        let bytes = self.bytes(path, files::MAX_PICTURE).map_err(|fault| fault.message)?;
        let shape = [u64::from(size.height), u64::from(size.width)];
        npy::read_values(&shape, &mut Cursor::new(bytes)).map_err(|e| e.to_string())
    }
}

/// An object as it is stored, about the origin if its recipe does not state its pivot.
fn record(object: &ObjectSettings) -> ObjectRecord {
    let rest = object.rest();
    ObjectRecord {
        name: object.name.clone(),
        first: 0,
        shift: DVec3::ZERO,
        rotation: rest.rotation,
        translation: rest.translation,
        pivot: object.stated_pivot().unwrap_or(DVec3::ZERO),
        path: object.path.clone(),
    }
}

/// Compares places with the paths of objects whose pivots are the means of their Gaussians, which the tree
/// lacks. The pivot of such an object is the one that fits its places best.
fn compare_places(bytes: &[u8], objects: &[ObjectSettings], stamps: &[i64]) -> Result<(), String> {
    let prepare = |records| SceneMotion::prepare(records).map_err(|e| e.to_string());
    let about_origin = prepare(objects.iter().map(record).collect())?;
    let mut fits = vec![PivotFit::NONE; objects.len()];
    let expected = || stamps.iter().flat_map(|stamp| (0..objects.len()).map(move |k| (*stamp, k)));
    let mut all = expected();
    for (number, line) in (2..).zip(place_lines(bytes)?) {
        let line = line?;
        let wanted = all.next().filter(|(stamp, k)| {
            *stamp == line.stamp_us && k + 1 == usize::from(line.number) && objects[*k].name == line.name
        });
        let Some((stamp, k)) = wanted else {
            return Err(format!("line {number} has another stamp or object"));
        };
        let place = DVec3::from_slice(&line.values[..3]);
        fits[k].see(&about_origin.objects[k], stamp as f64 * 1e-6, place);
    }
    if all.next().is_some() {
        return Err("it ends before the last pose".to_owned());
    }
    let pivots = objects.iter().zip(&fits).map(|(object, fit)| {
        let mut record = record(object);
        record.pivot = object.stated_pivot().unwrap_or_else(|| fit.pivot());
        record
    });
    let motion = prepare(pivots.collect())?;
    for ((number, line), (stamp, k)) in (2..).zip(place_lines(bytes)?).zip(expected()) {
        if !is_place(&line?.values, &motion.objects[k], stamp as f64 * 1e-6) {
            return Err(format!("line {number} has another place or motion of {}", objects[k].name));
        }
    }
    Ok(())
}

/// Share of a place, a velocity or a rate that a fitted pivot may make it differ by: [`PivotFit::pivot`] errs
/// by half of the square root of [`RIDGE`], and the rest is for rounded origins.
const FITTED: f64 = 1e-6;
/// Weight of a pivot near the origin, as a share of that of the places. It decides the direction about which
/// nothing turns.
const RIDGE: f64 = 1e-12;

/// The places of an object as a system of linear equations for its pivot: `(I - R) pivot = place - place
/// about the origin`.
#[derive(Debug, Clone, Copy)]
struct PivotFit {
    normal: DMat3,
    right: DVec3,
    weight: f64,
}

impl PivotFit {
    const NONE: Self = Self { normal: DMat3::ZERO, right: DVec3::ZERO, weight: 0.0 };

    fn see(&mut self, object: &MovingObject, seconds: f64, place: DVec3) {
        let found = object.at(seconds);
        let turn = DMat3::from_quat(found.pose.rotation * object.record.rotation.conjugate());
        let rows = DMat3::IDENTITY - turn;
        self.normal += rows.transpose() * rows;
        self.right += rows.transpose() * (place - found.pose.translation);
        self.weight += 1.0;
    }

    fn pivot(&self) -> DVec3 {
        // At least the weight of one equation, so that places without a turn have a solution too.
        let ridge = DMat3::from_diagonal(DVec3::splat(RIDGE * self.weight.max(1.0)));
        (self.normal + ridge).inverse() * self.right
    }
}

/// Returns true if the values of a line are place, rotation and motion of an object at this time.
fn is_place(values: &[f64], object: &MovingObject, seconds: f64) -> bool {
    let ObjectMotion { pose, velocity, angular } = object.at(seconds);
    let [place, moving, turning] = [0, 7, 10].map(|first| DVec3::from_slice(&values[first..first + 3]));
    let rotation = DQuat::from_slice(&values[3..7]);
    let reach = 1.0 + pose.translation.length() + object.record.pivot.length();
    let is_near = |a: DVec3, b: DVec3, scale: f64| (a - b).length() <= FITTED * scale;
    is_near(place, pose.translation, reach)
        && is_near(moving, velocity, 1.0 + velocity.length() + angular.length() * reach)
        // Both follow from the path alone, whatever the pivot, so they are equal to the last bit.
        && turning == angular
        && rotation == pose.rotation
}
