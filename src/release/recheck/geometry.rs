//! Frames, depth and flow of a released trajectory, compared by its poses.

use super::RecheckError;
use super::views::ReleasedPictures;
use crate::check::flow_projection::FlowDifference;
use crate::check::geometry::{AlignedPairs, GeometryMeasures, Measured};
use crate::check::photometric::align::{
    AlignedQuantity, PairAlignment, PosedPicture, align_pair, smooth_picture,
};
use crate::check::photometric::order::FrameTriple;
use crate::check::photometric::{FRAME_SHARE, disagrees};
use crate::image::Image;
use crate::render::CameraView;
use crate::render::flow::flow_rates;
use crate::se3::{OPENCV_FROM_OPENGL, Se3};
use crate::stats::mean_median;
use glam::{DMat3, DQuat};

/// Motion of pairs apart, px: enough to be measured well, and small enough for a linear model.
const APART_PX: f64 = 1.0;
/// Largest number of pictures from one of a pair apart to the other.
const MOST_APART: usize = 8;
/// Number of pairs apart.
const PAIRS_APART: usize = 12;
/// Factors of the translation that are tried where frames and poses disagree.
const FACTORS: [f64; 8] = [0.5, 0.8, 1.0 / 1.1, 1.0 / 1.05, 1.05, 1.1, 1.25, 2.0];

/// A pose as it may be meant, from the pose and its number.
type PoseReading<'a> = &'a dyn Fn(&Se3, usize) -> Se3;

/// Compares the pictures of a trajectory.
pub(super) fn measure_geometry(of: &ReleasedPictures<'_>) -> Result<GeometryMeasures, RecheckError> {
    let [frames, depths, flows] = [("sharp", "png"), ("depth", "npy"), ("flow", "npy")]
        .map(|(kind, extension)| of.poses_with(kind, extension));
    let (frames, depths, flows) = (frames?, depths?, flows?);
    let both = |some: &[usize]| -> Vec<usize> {
        some.iter().copied().filter(|pose| depths.binary_search(pose).is_ok()).collect()
    };
    Ok(GeometryMeasures {
        pictures: PictureAligner { of, quantity: AlignedQuantity::Brightness }.measure(&both(&frames))?,
        order: measure_order(of, &frames)?,
        depths: PictureAligner { of, quantity: AlignedQuantity::Depth }.measure(&depths)?,
        flows: measure_flows(of, &both(&flows))?,
    })
}

/// Aligns the pictures of one kind.
struct PictureAligner<'a> {
    of: &'a ReleasedPictures<'a>,
    quantity: AlignedQuantity,
}

impl PictureAligner<'_> {
    fn measure(&self, poses: &[usize]) -> Result<Measured<AlignedPairs>, RecheckError> {
        if poses.len() < 2 {
            return Ok(Err(match self.quantity {
                AlignedQuantity::Brightness => "fewer than two poses have both a frame and depth",
                AlignedQuantity::Depth => "fewer than two poses have depth",
            }
            .to_owned()));
        }
        let neighbours = self.neighbours(poses)?;
        let motion = mean_median(neighbours.iter().map(|pair| pair.motion_px).collect()).unwrap_or(0.0);
        let most = MOST_APART.min((poses.len() - 1) / 2).max(1);
        // The first distance with enough motion; without motion, the largest.
        let apart = (1..=most).find(|n| *n as f64 * motion >= APART_PX).unwrap_or(most);
        let pictures = self.pairs_apart(poses, apart)?;
        let align = |read: &dyn Fn(&Se3, usize) -> Se3| -> Vec<PairAlignment> {
            let pair = |[a, b]: &[PosedPicture; 2]| {
                let [a, b] = [a, b].map(|picture| PosedPicture {
                    world_from_camera: read(&picture.world_from_camera, picture.pose),
                    ..picture.clone()
                });
                align_pair(self.quantity, &self.of.camera, [&a, &b])
            };
            pictures.iter().filter_map(pair).collect()
        };
        let apart = align(&|pose, _| *pose);
        let wrong = self.quantity == AlignedQuantity::Brightness && disagrees(&apart, FRAME_SHARE);
        let agrees_with = if wrong { self.other_reading(&align) } else { None };
        Ok(Ok(AlignedPairs { apart, neighbours, agrees_with }))
    }

    fn neighbours(&self, poses: &[usize]) -> Result<Vec<PairAlignment>, RecheckError> {
        let mut pairs = Vec::new();
        let mut before = self.picture(poses[0])?;
        for pose in &poses[1..] {
            let next = self.picture(*pose)?;
            pairs.extend(align_pair(self.quantity, &self.of.camera, [&before, &next]));
            before = next;
        }
        Ok(pairs)
    }

    fn pairs_apart(&self, poses: &[usize], apart: usize) -> Result<Vec<[PosedPicture; 2]>, RecheckError> {
        let last = poses.len() - 1 - apart;
        let count = PAIRS_APART.min(last + 1);
        let first = |i: usize| if count > 1 { i * last / (count - 1) } else { 0 };
        let pair = |i: usize| Ok([self.picture(poses[first(i)])?, self.picture(poses[first(i) + apart])?]);
        (0..count).map(pair).collect()
    }

    fn picture(&self, pose: usize) -> Result<PosedPicture, RecheckError> {
        let depth = self.of.depth(pose)?;
        let values = match self.quantity {
            AlignedQuantity::Brightness => smooth_picture(&self.of.frame(pose)?.luminance),
            AlignedQuantity::Depth => depth.clone(),
        };
        let world_from_camera = self.of.motion.trajectory.world_from_camera[pose];
        Ok(PosedPicture { pose, world_from_camera, values, depth })
    }

    /// The first usual mistake that explains the frames.
    fn other_reading(&self, align: &dyn Fn(PoseReading<'_>) -> Vec<PairAlignment>) -> Option<String> {
        let poses = &self.of.motion.trajectory.world_from_camera;
        let flip = DQuat::from_mat3(&DMat3::from_diagonal(OPENCV_FROM_OPENGL));
        let opengl = |pose: &Se3, _: usize| Se3 { rotation: pose.rotation * flip, ..*pose };
        let readings: [(&str, PoseReading<'_>); 4] = [
            ("poses from world to camera, inverted", &|pose, _| pose.inverse()),
            ("camera axes of OpenGL", &opengl),
            ("the poses, or the frames, in reverse order", &|_, at| poses[poses.len() - 1 - at]),
            ("a camera that stands still", &|_, _| poses[0]),
        ];
        let explains = |read: &dyn Fn(&Se3, usize) -> Se3| {
            let pairs = align(read);
            !pairs.is_empty() && !disagrees(&pairs, FRAME_SHARE)
        };
        let named = readings.iter().find(|(_, read)| explains(*read)).map(|(name, _)| (*name).to_owned());
        let scaled =
            |factor: f64| move |pose: &Se3, _: usize| Se3 { translation: factor * pose.translation, ..*pose };
        named.or_else(|| {
            let factor = FACTORS.into_iter().find(|factor| explains(&scaled(*factor)))?;
            Some(format!("translations {factor:.2} times as large, or depths {:.2} times", 1.0 / factor))
        })
    }
}

fn measure_order(
    of: &ReleasedPictures<'_>,
    frames: &[usize],
) -> Result<Measured<Vec<FrameTriple>>, RecheckError> {
    if frames.len() < 3 {
        return Ok(Err("there are fewer than three sharp frames".to_owned()));
    }
    let read = |pose: usize| Ok(smooth_picture(&of.frame(pose)?.luminance));
    let (mut first, mut second) = (read(frames[0])?, read(frames[1])?);
    let mut before = difference(&first, &second);
    let mut triples = Vec::new();
    for poses in frames.windows(3) {
        let third = read(poses[2])?;
        let after = difference(&second, &third);
        let outer = difference(&first, &third);
        triples.push(FrameTriple { poses: [poses[0], poses[1], poses[2]], inner: [before, after], outer });
        (first, second, before) = (second, third, after);
    }
    Ok(Ok(triples))
}

/// Root mean square difference of two images of one size.
fn difference(a: &Image<f32>, b: &Image<f32>) -> f64 {
    let squares = a.pixels().iter().zip(b.pixels()).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
    (squares.sum::<f64>() / a.pixels().len().max(1) as f64).sqrt()
}

fn measure_flows(
    of: &ReleasedPictures<'_>,
    poses: &[usize],
) -> Result<Measured<Vec<FlowDifference>>, RecheckError> {
    if poses.is_empty() {
        return Ok(Err("no pose has both flow and depth".to_owned()));
    }
    let velocities = of.motion.velocities();
    let mut differences = Vec::new();
    for &pose in poses {
        let world_from_camera = of.motion.trajectory.world_from_camera[pose];
        let view = CameraView { camera: of.camera, world_from_camera, velocity: velocities[pose] };
        let expected = flow_rates(&of.depth(pose)?, &view);
        differences.extend(FlowDifference::new(pose, &of.flow(pose)?, &expected));
    }
    Ok(Ok(differences))
}
