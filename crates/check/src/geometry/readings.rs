//! Usual mistakes in poses: the readings of them that are tried where pictures and poses disagree.

use glam::{DMat3, DQuat};
use gs2e_num::se3::{OPENCV_FROM_OPENGL, Se3};

/// Factors of the translation that are tried, with those of units: metres, millimetres, and the 5,000
/// steps per metre of the TUM depth images.
const FACTORS: [f64; 16] =
    [0.5, 0.8, 1.0 / 1.1, 1.0 / 1.05, 1.05, 1.1, 1.25, 2.0, 0.2, 5.0, 0.1, 10.0, 0.01, 100.0, 0.001, 1000.0];

/// A pose as it may be meant, from the pose and its number.
pub type PoseReading<'a> = &'a dyn Fn(&Se3, usize) -> Se3;

/// The name of the first reading of these poses with which `explains` is true.
pub(crate) fn find_reading(poses: &[Se3], explains: &dyn Fn(PoseReading<'_>) -> bool) -> Option<String> {
    let flip = DQuat::from_mat3(&DMat3::from_diagonal(OPENCV_FROM_OPENGL));
    let opengl = |pose: &Se3, _: usize| Se3 { rotation: pose.rotation * flip, ..*pose };
    let readings: [(&str, PoseReading<'_>); 4] = [
        ("poses from world to camera, inverted", &|pose, _| pose.inverse()),
        ("camera axes of OpenGL", &opengl),
        ("the poses, or the frames, in reverse order", &|_, at| poses[poses.len() - 1 - at]),
        ("a camera that stands still", &|_, _| poses[0]),
    ];
    let named = readings.iter().find(|(_, read)| explains(*read)).map(|(name, _)| (*name).to_owned());
    let scaled =
        |factor: f64| move |pose: &Se3, _: usize| Se3 { translation: factor * pose.translation, ..*pose };
    named.or_else(|| {
        let factor = FACTORS.into_iter().find(|factor| explains(&scaled(*factor)))?;
        let shown = |factor: f64| if factor < 0.1 { format!("{factor:.3}") } else { format!("{factor:.2}") };
        let (times, depths) = (shown(factor), shown(1.0 / factor));
        Some(format!("translations {times} times as large, or depths {depths} times"))
    })
}
