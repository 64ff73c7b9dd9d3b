//! Pictures of a moving camera, compared by their poses. They come in turn, and three of them are in
//! memory at most.
//!
//! A [`GeometryWatch`] sees each picture once: neighbours are aligned, and the order of the frames is
//! measured. The choice of pairs that are further apart depends on the motion between neighbours, so
//! their pictures, at most 24, are read again at the end.

use super::readings::{PoseReading, find_reading};
use super::{AlignedPairs, Measurement, PictureMeasures};
use crate::photometric::align::{AlignedQuantity, PairAlignment, PosedPicture, align_pair, smooth_picture};
use crate::photometric::order::FrameTriple;
use crate::photometric::{FRAME_SHARE, disagrees};
use gs2e_image::Image;
use gs2e_num::se3::Se3;
use gs2e_num::stats::mean_median;
use gs2e_scene::camera::Camera;
use rayon::prelude::*;

/// Motion of pairs apart, px: enough to be measured well, and small enough for a linear model.
const APART_PX: f64 = 1.0;
/// Largest number of pictures from one of a pair apart to the other.
const MOST_APART: usize = 8;
/// Number of pairs apart.
const PAIRS_APART: usize = 12;

/// Pictures that can be read again, by the number of their pose.
pub trait PosedPictures: Sync {
    /// The reason why a picture cannot be read.
    type Error: Send;

    /// Brightness of the frame at a pose, on the grey scale.
    ///
    /// # Errors
    /// The frame cannot be read.
    fn brightness(&self, pose: usize) -> Result<Image<f32>, Self::Error>;

    /// Depth along the optical axis at a pose; NaN where no depth is known.
    ///
    /// # Errors
    /// The depth cannot be read.
    fn depth(&self, pose: usize) -> Result<Image<f32>, Self::Error>;
}

/// The comparisons of the pictures of a trajectory so far.
#[derive(Debug)]
pub struct GeometryWatch<'a> {
    camera: Camera,
    poses: &'a [Se3],
    frames: NeighbourWatch,
    depths: NeighbourWatch,
    order: OrderWatch,
}

impl<'a> GeometryWatch<'a> {
    /// Starts before the first picture of a camera with these poses.
    #[must_use]
    pub fn new(camera: Camera, poses: &'a [Se3]) -> Self {
        Self {
            camera,
            poses,
            frames: NeighbourWatch::new(AlignedQuantity::Brightness),
            depths: NeighbourWatch::new(AlignedQuantity::Depth),
            order: OrderWatch::default(),
        }
    }

    /// Takes the pictures at the next pose: brightness smoothed by [`smooth_picture`], and depth.
    ///
    /// # Panics
    /// A picture does not have the camera's size.
    pub fn see(&mut self, pose: usize, smoothed: Option<Image<f32>>, depth: Option<Image<f32>>) {
        let world_from_camera = self.poses[pose];
        let picture =
            |values: Image<f32>, depth: Image<f32>| PosedPicture { pose, world_from_camera, values, depth };
        if let Some(depth) = depth {
            if let Some(values) = &smoothed {
                self.frames.see(&self.camera, picture(values.clone(), depth.clone()));
            }
            self.depths.see(&self.camera, picture(depth.clone(), depth));
        }
        if let Some(smoothed) = smoothed {
            self.order.see(pose, smoothed);
        }
    }

    /// The results, after the last picture.
    ///
    /// # Errors
    /// A picture cannot be read again.
    pub fn finish<P: PosedPictures>(self, pictures: &P) -> Result<PictureMeasures, P::Error> {
        let reopened = ReopenedPictures { camera: &self.camera, poses: self.poses, pictures };
        let (frames, depths) = (self.frames, self.depths);
        let (frames, depths) = rayon::join(|| reopened.measure(frames), || reopened.measure(depths));
        Ok(PictureMeasures { pictures: frames?, order: self.order.finish(), depths: depths? })
    }
}

/// Alignments of each picture with the one before.
#[derive(Debug)]
struct NeighbourWatch {
    quantity: AlignedQuantity,
    /// Numbers of the poses with such a picture.
    poses: Vec<usize>,
    before: Option<PosedPicture>,
    pairs: Vec<PairAlignment>,
}

impl NeighbourWatch {
    fn new(quantity: AlignedQuantity) -> Self {
        Self { quantity, poses: Vec::new(), before: None, pairs: Vec::new() }
    }

    fn see(&mut self, camera: &Camera, next: PosedPicture) {
        // Only the picture before is kept: memory does not grow with the length of the path.
        self.poses.push(next.pose);
        if let Some(before) = &self.before {
            self.pairs.extend(align_pair(self.quantity, camera, [before, &next]));
        }
        self.before = Some(next);
    }
}

/// Differences of the latest frames.
#[derive(Debug, Default)]
struct OrderWatch {
    /// The latest two frames, with the numbers of their poses.
    latest: Vec<(usize, Image<f32>)>,
    /// Difference of these two.
    inner: f64,
    triples: Vec<FrameTriple>,
}

impl OrderWatch {
    fn see(&mut self, pose: usize, frame: Image<f32>) {
        let after = self.latest.last().map_or(0.0, |(_, before)| difference(before, &frame));
        // Three frames suffice: a frame in a wrong place is further from both neighbours than they
        // are from each other.
        if let [(first, outer), (second, _)] = self.latest.as_slice() {
            let (poses, outer) = ([*first, *second, pose], difference(outer, &frame));
            self.triples.push(FrameTriple { poses, inner: [self.inner, after], outer });
            self.latest.remove(0);
        }
        self.inner = after;
        self.latest.push((pose, frame));
    }

    fn finish(self) -> Measurement<Vec<FrameTriple>> {
        let Self { triples, .. } = self;
        if triples.is_empty() { Err("there are fewer than three frames".to_owned()) } else { Ok(triples) }
    }
}

/// Root mean square difference of two images of one size.
fn difference(a: &Image<f32>, b: &Image<f32>) -> f64 {
    /// Sums that do not wait for each other: enough for two vectors of 256 bits to be in flight.
    const LANES: usize = 8;
    // In 64 bits: 32 lose the small differences of a picture next to the sum of a million others.
    let square = |a: f32, b: f32| f64::from(a - b) * f64::from(a - b);
    let ((a_lanes, a_rest), (b_lanes, b_rest)) =
        (a.pixels().as_chunks::<LANES>(), b.pixels().as_chunks::<LANES>());
    let mut sums = [0.0; LANES];
    for (a, b) in a_lanes.iter().zip(b_lanes) {
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum += square(a[i], b[i]);
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| square(*a, *b)).sum();
    ((sums.iter().sum::<f64>() + rest) / a.pixels().len().max(1) as f64).sqrt()
}

/// The pictures of a trajectory, to be read once more.
struct ReopenedPictures<'a, P> {
    camera: &'a Camera,
    poses: &'a [Se3],
    pictures: &'a P,
}

impl<P: PosedPictures> ReopenedPictures<'_, P> {
    fn measure(&self, watch: NeighbourWatch) -> Result<Measurement<AlignedPairs>, P::Error> {
        let NeighbourWatch { quantity, poses, pairs: neighbours, .. } = watch;
        if poses.len() < 2 {
            return Ok(Err(match quantity {
                AlignedQuantity::Brightness => "fewer than two poses have both a frame and depth",
                AlignedQuantity::Depth => "fewer than two poses have depth",
            }
            .to_owned()));
        }
        let motion = mean_median(neighbours.iter().map(|pair| pair.motion_px).collect()).unwrap_or(0.0);
        // Half of the pictures at most, so that several pairs exist on a short path.
        let most = MOST_APART.min((poses.len() - 1) / 2).max(1);
        // The first distance with enough motion; without motion, the largest.
        let apart = (1..=most).find(|n| *n as f64 * motion >= APART_PX).unwrap_or(most);
        let pictures = self.pairs_apart(quantity, &poses, apart)?;
        let align = |read: PoseReading<'_>| -> Vec<PairAlignment> {
            let pair = |[a, b]: &[PosedPicture; 2]| {
                let [a, b] = [a, b].map(|picture| PosedPicture {
                    world_from_camera: read(&picture.world_from_camera, picture.pose),
                    ..picture.clone()
                });
                align_pair(quantity, self.camera, [&a, &b])
            };
            pictures.iter().filter_map(pair).collect()
        };
        let apart = align(&|pose, _| *pose);
        let wrong = quantity == AlignedQuantity::Brightness && disagrees(&apart, FRAME_SHARE);
        let explains = |read: PoseReading<'_>| {
            let pairs = align(read);
            !pairs.is_empty() && !disagrees(&pairs, FRAME_SHARE)
        };
        // Each other reading of the poses costs an alignment of all pairs, so it is tried only
        // where it may explain a fault.
        let agrees_with = if wrong { find_reading(self.poses, &explains) } else { None };
        Ok(Ok(AlignedPairs { apart, neighbours, agrees_with }))
    }

    fn pairs_apart(
        &self,
        quantity: AlignedQuantity,
        poses: &[usize],
        apart: usize,
    ) -> Result<Vec<[PosedPicture; 2]>, P::Error> {
        // Pairs are spread over the whole path: a fault in one part of it must meet some of them.
        let last = poses.len() - 1 - apart;
        let count = PAIRS_APART.min(last + 1);
        let first = |i: usize| if count > 1 { i * last / (count - 1) } else { 0 };
        let picture = |place: usize| self.picture(quantity, poses[place]);
        let pair = |i: usize| Ok([picture(first(i))?, picture(first(i) + apart)?]);
        (0..count).into_par_iter().map(pair).collect()
    }

    fn picture(&self, quantity: AlignedQuantity, pose: usize) -> Result<PosedPicture, P::Error> {
        let depth = self.pictures.depth(pose)?;
        let values = match quantity {
            AlignedQuantity::Brightness => smooth_picture(&self.pictures.brightness(pose)?),
            AlignedQuantity::Depth => depth.clone(),
        };
        Ok(PosedPicture { pose, world_from_camera: self.poses[pose], values, depth })
    }
}
