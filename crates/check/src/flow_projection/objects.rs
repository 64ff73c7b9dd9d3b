//! Flow images at the pixels of moving objects. A gate, with segmentation, depth, and places of the objects.
//!
//! A pixel of an object moves with it: its flow follows from its depth, the camera and the motion of the
//! object in `objects.csv`, to the rounding of 32 bits. A pixel whose flow is off by 0.1 % is wrong: then its
//! flow, its depth, its number or the motion of its object is. The number of wrong pixels is compared with
//! that of the pixels of objects, so that a small object counts as much as a large one, and so does a
//! segmentation that misses it. The limit is one in a hundred.

use super::rank;
use crate::TrajectorySubject;
use crate::geometry::Measurement;
use crate::subject::{Judgement, JudgementResult, LimitSide};
use gs2e_image::Image;
use gs2e_scene::camera::flow::flow_of_objects;
use gs2e_scene::camera::view::CameraView;

/// Largest number of wrong pixels, as a share of the pixels of objects.
const MOST_WRONG: f64 = 0.01;
/// Largest difference of a flow from the expected one, as a share of it.
const SHARE: f64 = 1e-3;
/// Share of the median flow of the image that may be added to it: rounding of flows that are nearly zero.
const OF_IMAGE: f64 = 1e-5;
/// Difference of flows that no image shows, px/s.
const INVISIBLE: f64 = 1e-6;

/// A flow image against the motions of camera and objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ObjectFlow {
    /// The pose.
    pub pose: usize,
    /// Number of pixels of objects.
    pub pixels: u64,
    /// Number of pixels with another flow than that of the object that the segmentation states.
    pub wrong: u64,
    /// A number in the segmentation that no object has.
    pub stranger: Option<u8>,
}

impl ObjectFlow {
    /// Compares the flow at a pose. `views` are those of what is still and of each object, in the order of
    /// the numbers in `segmentation`.
    ///
    /// # Panics
    /// The images differ in size, or there is no view.
    #[must_use]
    pub fn new(
        pose: usize,
        stated: &Image<[f32; 2]>,
        depth: &Image<f32>,
        segmentation: &Image<u8>,
        views: &[CameraView],
    ) -> Self {
        let numbers = || segmentation.pixels().iter().copied();
        let pixels = numbers().filter(|number| *number > 0).count() as u64;
        let stranger = numbers().find(|number| usize::from(*number) >= views.len());
        if stranger.is_some() {
            return Self { pose, pixels, wrong: 0, stranger };
        }
        let expected = flow_of_objects(depth, Some(segmentation), views);
        let allowed = OF_IMAGE * median_size(&expected) + INVISIBLE;
        let pairs = stated.pixels().iter().zip(expected.pixels());
        let wrong = pairs.filter(|(stated, expected)| is_wrong(**stated, **expected, allowed)).count() as u64;
        Self { pose, pixels, wrong, stranger }
    }

    fn share(&self) -> f64 {
        self.wrong as f64 / self.pixels.max(1) as f64
    }
}

fn size([u, v]: [f64; 2]) -> f64 {
    (u * u + v * v).sqrt()
}

fn median_size(flow: &Image<[f32; 2]>) -> f64 {
    let sizes = flow.pixels().iter().map(|flow| size(flow.map(f64::from))).filter(|size| size.is_finite());
    rank(sizes.collect(), 50).unwrap_or(0.0)
}

fn is_wrong(stated: [f32; 2], expected: [f32; 2], allowed: f64) -> bool {
    let is_known = |flow: [f32; 2]| flow.iter().all(|v| v.is_finite());
    if is_known(stated) != is_known(expected) {
        return true;
    }
    let expected = expected.map(f64::from);
    let off = size([0, 1].map(|i| f64::from(stated[i]) - expected[i]));
    // NaN on both sides is no difference.
    off > SHARE * size(expected) + allowed
}

/// The statement on the flow of objects; `None` if nothing moves by itself.
pub(super) fn judge_objects(subject: &TrajectorySubject<'_>) -> Option<JudgementResult> {
    let flows: &Measurement<Vec<ObjectFlow>> = subject.geometry?.objects.as_ref()?;
    let flows = match flows {
        Ok(flows) => flows,
        Err(because) => return Some(Err(because.clone())),
    };
    let limit = LimitSide::gate(MOST_WRONG);
    if let Some(ObjectFlow { pose, stranger: Some(number), .. }) = flows.iter().find(|f| f.stranger.is_some())
    {
        let because =
            format!("the mask at pose {pose} has the number {number}, which no object of the recipe has");
        return Some(Ok(Judgement::new(limit.beyond, 1.0, limit.value, "1", because)));
    }
    let worst = flows.iter().max_by(|a, b| a.share().total_cmp(&b.share()))?;
    let because = format!(
        "at pose {}, {} pixels have another flow than depth, camera and the object in their mask give, next to {} pixels \
         of objects: the worst of {} images",
        worst.pose,
        worst.wrong,
        worst.pixels,
        flows.len()
    );
    Some(Ok(Judgement::at_most(worst.share(), limit, "1", because).detecting(MOST_WRONG, "1")))
}
