//! The embedded scene `still-life`: a scene and a capture of it that need no download.
//!
//! Fruit, flowers, books and brass on a table in front of a tiled wall, as surfels: flattened
//! Gaussians that follow the surfaces, with a size that depends on their number. Light is computed
//! once and stored as colour; the harmonics of glossy items contain the reflection of the lamp.
//! The same parameters give the same bits on every machine: all arithmetic is in 64 bits,
//! transcendental functions come from `libm`, and every draw from ChaCha12.
//!
//! The scene is one of `gs2e-scene` and the capture one of `gs2e-source`, as their readers return them.
//! Poses come from `gs2e-num`, sizes and colours from `gs2e-image`. `gs2e-recipe` reads the parameters and
//! `gs2e-build` makes the scene; `gs2e-lab` studies it.
//!
//! # Examples
//!
//! ```
//! use gs2e_demo::{StillLife, still_capture, still_life};
//!
//! let life = StillLife { gaussians: 500, views: 4, ..StillLife::default() };
//! life.validate()?;
//! let (scene, capture) = (still_life(&life), still_capture(&life));
//! assert_eq!((scene.len(), capture.views.len()), (500, 4));
//! assert_eq!(still_life(&life), scene);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod books;
mod bouquet;
mod capture;
mod draw;
mod fountain;
mod fruit;
mod light;
mod primitive;
mod room;
mod shape;
mod texture;

use draw::SceneDraws;
pub use fountain::{Fountain, GRAVITY};
use glam::DVec3;
use gs2e_scene::collector::{Gaussian, GaussianCollector};
use gs2e_scene::dynamic::{SplatCourse, SplatTrack};
use gs2e_scene::{Gaussians, sh};
use gs2e_source::Capture;
use light::LitPoint;
use primitive::{ScenePrimitive, SurfaceFinish, TableArrangement};
use serde::{Deserialize, Serialize};
use shape::{PrimitiveShape, SurfelSpot};

/// Parameters of the still life.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StillLife {
    /// Number of Gaussians, 100 to 10,000,000.
    pub gaussians: u32,
    /// Number of key views, 2 to 10,000.
    pub views: u32,
    /// Extent of the capture's arc in degrees, above 0 to 360. From about 80 on, the outer views
    /// see the ends of the room.
    pub arc: f64,
    /// Seed of the scene and of the capture's unevenness.
    pub seed: u64,
    /// A fountain, with which the scene changes with time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fountain: Option<Fountain>,
}

impl Default for StillLife {
    fn default() -> Self {
        Self { gaussians: 20_000, views: 30, arc: 20.0, seed: 1, fountain: None }
    }
}

/// A parameter out of its range.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{field}` is {found}, wanted {wanted}")]
pub struct OutOfRange {
    /// The parameter's name.
    pub field: &'static str,
    /// Its value.
    pub found: String,
    /// Its range.
    pub wanted: &'static str,
}

impl StillLife {
    /// Checks that every parameter is within its range.
    ///
    /// # Errors
    /// The first parameter that is not.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let check = |ok: bool, field, found: String, wanted| {
            if ok { Ok(()) } else { Err(OutOfRange { field, found, wanted }) }
        };
        let Self { gaussians, views, arc, .. } = *self;
        let counts = (100..=10_000_000).contains(&gaussians);
        check(counts, "gaussians", gaussians.to_string(), "100 to 10,000,000")?;
        check((2..=10_000).contains(&views), "views", views.to_string(), "2 to 10,000")?;
        check(arc > 0.0 && arc <= 360.0, "arc", arc.to_string(), "above 0 and at most 360 degrees")
    }
}

/// The scene: exactly `gaussians` of them, harmonics of degree 2; then the drops of the fountain.
///
/// # Panics
/// If the parameters are not [valid](StillLife::validate).
#[must_use]
pub fn still_life(life: &StillLife) -> Gaussians {
    life.validate().expect("the parameters were validated where they were read");
    let arrangement = arrange_table(life.seed);
    let weights: Vec<f64> = arrangement.primitives.iter().map(|p| p.detail * p.shape.area()).collect();
    let counts = shape::split_count(life.gaussians as usize, &weights);
    let drops = life.fountain.map_or(0, |fountain| fountain.drops as usize);
    let mut collector = GaussianCollector::new(light::DEGREE, life.gaussians as usize + drops)
        .expect("a valid still life has few Gaussians");
    // Each primitive draws from its own stream, so the number of surfels of one changes no draw of
    // another.
    for (stream, (primitive, count)) in (0_u64..).zip(arrangement.primitives.iter().zip(counts)) {
        let mut draws = SceneDraws::new(life.seed, stream);
        primitive
            .shape
            .spots(count, &mut draws, |spot| paint_spot(primitive, spot, &arrangement, &mut collector));
    }
    let tracks = life.fountain.map(|fountain| {
        // Tracks go by position: the surfels are in the collector already, and the drops follow them.
        let still = std::iter::repeat_n(SplatTrack::STILL, life.gaussians as usize);
        still.chain(fountain::add_fountain(&fountain, life.seed, &mut collector)).collect()
    });
    let scene = collector
        .finish(DVec3::ZERO, Some(false))
        .expect("a valid still life has Gaussians, all of them finite");
    match (tracks, life.fountain) {
        (Some(tracks), Some(fountain)) => scene.with_dynamics(fountain.time, SplatCourse::Tracks(tracks)),
        _ => scene,
    }
}

/// The capture: `views` poses along an arc about the table, 640x360 pixels, not distorted.
///
/// # Panics
/// If the parameters are not [valid](StillLife::validate).
#[must_use]
pub fn still_capture(life: &StillLife) -> Capture {
    life.validate().expect("the parameters were validated where they were read");
    capture::arc_capture(life)
}

fn arrange_table(seed: u64) -> TableArrangement {
    let mut arrangement = TableArrangement::default();
    // The offsets keep apart the seeds that each group derives from its own.
    room::add_room(seed, &mut arrangement);
    fruit::add_fruit(seed.wrapping_add(200), &mut arrangement);
    bouquet::add_bouquet(seed.wrapping_add(300), &mut arrangement);
    books::add_books(seed.wrapping_add(400), &mut arrangement);
    // A part draws from the stream of its place in this list, so the order of the groups belongs to the
    // scene.
    arrangement.primitives.push(dust_primitive());
    arrangement
}

/// Floaters: faint blobs in the air in front of the table, as in every captured scene.
fn dust_primitive() -> ScenePrimitive {
    let shape = PrimitiveShape::Blobs {
        low: DVec3::new(-1.8, -1.5, -1.3),
        high: DVec3::new(1.9, -0.3, 1.2),
        share: 0.05,
    };
    let look = |s: &SurfelSpot| {
        let warm = DVec3::new(0.62, 0.58, 0.50);
        SurfaceFinish { albedo: warm * (0.4 + 0.6 * s.u), gloss: 0.0, opacity: 0.05 + 0.13 * s.v }
    };
    ScenePrimitive { item: "dust", shape, look: Box::new(look), detail: 1.0, thin: true }
}

/// Lights a spot, and passes it on as a Gaussian.
fn paint_spot(
    primitive: &ScenePrimitive,
    spot: &SurfelSpot,
    arrangement: &TableArrangement,
    collector: &mut GaussianCollector,
) {
    let finish = (primitive.look)(spot);
    // The side towards the lamp and the viewer is lit.
    let away = primitive.thin && spot.normal.dot(DVec3::new(0.1, -0.5, -0.85)) < 0.0;
    let normal = if away { -spot.normal } else { spot.normal };
    let lit = LitPoint { item: primitive.item, position: spot.position, normal };
    let colour = light::display_light(light::shade_point(lit, finish.albedo, &arrangement.occluders));
    let mut coefficients = [DVec3::ZERO; sh::function_count(light::DEGREE)];
    coefficients[0] = (colour - DVec3::splat(0.5)) / sh::C0;
    light::add_gloss(lit, finish.gloss, &arrangement.occluders, &mut coefficients);
    let opacity = finish.opacity;
    let rotation = spot.rotation;
    collector.push(&Gaussian {
        position: to_single(spot.position),
        log_scale: to_single(DVec3::from_array(spot.deviations.to_array().map(libm::log))),
        rotation: [rotation.w, rotation.x, rotation.y, rotation.z].map(sh::Scalar::nearest),
        opacity_logit: sh::Scalar::nearest(libm::log(opacity / (1.0 - opacity))),
        sh: &coefficients.map(to_single),
    });
}

fn to_single(v: DVec3) -> [f32; 3] {
    v.to_array().map(sh::Scalar::nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::se3::Se3;
    use gs2e_scene::camera::Camera;
    use gs2e_source::LensModel;

    fn life(gaussians: u32) -> StillLife {
        StillLife { gaussians, ..StillLife::default() }
    }

    #[test]
    fn parameters_have_ranges() {
        let t = |change: fn(&mut StillLife), message: &str| {
            let mut life = StillLife::default();
            change(&mut life);
            assert_eq!(life.validate().unwrap_err().to_string(), message);
        };
        assert_eq!(StillLife::default().validate(), Ok(()));
        t(|l| l.gaussians = 99, "`gaussians` is 99, wanted 100 to 10,000,000");
        t(|l| l.gaussians = 10_000_001, "`gaussians` is 10000001, wanted 100 to 10,000,000");
        t(|l| l.views = 1, "`views` is 1, wanted 2 to 10,000");
        t(|l| l.arc = 0.0, "`arc` is 0, wanted above 0 and at most 360 degrees");
        t(|l| l.arc = f64::NAN, "`arc` is NaN, wanted above 0 and at most 360 degrees");
        t(|l| l.arc = 360.5, "`arc` is 360.5, wanted above 0 and at most 360 degrees");
    }

    #[test]
    fn there_are_as_many_gaussians_as_asked_for() {
        for count in [100, 101, 317, 1_000, 12_345] {
            let scene = still_life(&life(count));
            assert_eq!(scene.len(), count as usize);
            assert_eq!(
                scene.screening,
                gs2e_scene::SceneScreening { read: u64::from(count), ..Default::default() }
            );
        }
    }

    /// Frozen: a change of these bits changes every release with a procedural scene.
    #[test]
    fn the_scene_and_its_capture_are_frozen() {
        let mut bytes = Vec::new();
        gs2e_scene::ply::write_ply(&still_life(&life(2_000)), &mut bytes).unwrap();
        let wanted = "6fdbcd12826d8be36a7ddf3e2a51ae425d196451e12617d2e21bce4453e42365";
        assert_eq!(blake3::hash(&bytes).to_hex().as_str(), wanted);
        let mut poses = blake3::Hasher::new();
        for view in still_capture(&life(2_000)).views {
            let Se3 { rotation, translation } = view.world_from_camera;
            for number in rotation.to_array().into_iter().chain(translation.to_array()) {
                poses.update(&number.to_le_bytes());
            }
        }
        assert_eq!(
            poses.finalize().to_hex().as_str(),
            "8cf85e8c5001386dea198130571f7a3cd4edf0825e8893bb92ad62e4727efa74"
        );
        let other = still_life(&StillLife { seed: 2, ..life(2_000) });
        assert_ne!(other, still_life(&life(2_000)));
    }

    #[test]
    fn colours_lie_between_black_and_white_from_the_middle_of_the_arc() {
        let scene = still_life(&life(5_000));
        let eye = still_capture(&life(5_000)).views[15].world_from_camera.translation;
        for i in 0..scene.len() {
            let to = DVec3::from_array(scene.positions[i].map(f64::from)) - eye;
            let basis = sh::basis_values(scene.sh_degree, to_single(to.normalize()));
            let colour = sh::sum_colour(scene.sh_of(i), &basis);
            // The lobe's series may fall below zero next to its peak, and raise highlights above
            // one.
            assert!(colour.iter().all(|c| (0.0..1.3).contains(c)), "{i}: {colour:?}");
        }
    }

    #[test]
    fn the_capture_is_an_uneven_arc_about_the_table() {
        let views = still_capture(&StillLife::default()).views;
        assert_eq!(views.len(), 30);
        assert_eq!((views[0].name.as_str(), views[29].name.as_str()), ("001.jpg", "030.jpg"));
        let middle = DVec3::new(0.1, -0.5, 0.1);
        let mut angles = Vec::new();
        for view in &views {
            let pose = view.world_from_camera;
            let [x, y] = project(&pose.inverse(), &view.camera, middle).unwrap();
            assert!((x - 320.0).abs() < 40.0 && (y - 180.0).abs() < 40.0, "{}: {x}, {y}", view.name);
            assert!((pose.rotation.length() - 1.0).abs() < 1e-15);
            assert!((pose.rotation * DVec3::Y).y > 0.9, "down is down");
            assert_eq!((&view.lens, &view.sha256), (&LensModel::Pinhole, &None));
            let from = pose.translation - middle;
            angles.push(from.x.atan2(-from.z).to_degrees());
        }
        let steps: Vec<f64> = angles.windows(2).map(|w| w[1] - w[0]).collect();
        let (least, most) = steps.iter().fold((f64::MAX, f64::MIN), |(l, m), &s| (l.min(s), m.max(s)));
        assert!(least > 0.2 && most > 1.3 * least, "{least} to {most}");
        assert!((angles[29] - angles[0] - 20.0).abs() < 0.5);
    }

    /// A trajectory resamples the arc to 150 poses. Between two of them, at most 5 % of the visible
    /// points may move by more than 0.85 px on average over the arc. This is measured between key
    /// views, including the tremor of the hand.
    #[test]
    fn the_default_arc_moves_slowly() {
        let life = StillLife::default();
        let (scene, views) = (still_life(&life), still_capture(&life).views);
        let total: f64 = views.windows(2).map(|pair| flow_quantile(&scene, &pair[0], &pair[1])).sum();
        assert!(total / 149.0 < 0.85, "{} px a pose", total / 149.0);
    }

    fn flow_quantile(scene: &Gaussians, a: &gs2e_source::CapturedView, b: &gs2e_source::CapturedView) -> f64 {
        let (pose_a, pose_b) = (a.world_from_camera.inverse(), b.world_from_camera.inverse());
        let mut flow: Vec<f64> = scene
            .positions
            .iter()
            .filter_map(|p| {
                let p = DVec3::from_array(p.map(f64::from));
                let [xa, ya] = project(&pose_a, &a.camera, p)?;
                let [xb, yb] = project(&pose_b, &b.camera, p)?;
                Some((xb - xa).hypot(yb - ya))
            })
            .collect();
        flow.sort_by(f64::total_cmp);
        flow[flow.len() * 95 / 100]
    }

    /// The projection of a point, unless it is behind the camera or outside the image.
    fn project(camera_from_world: &Se3, camera: &Camera, point: DVec3) -> Option<[f64; 2]> {
        let q = camera_from_world.rotation * point + camera_from_world.translation;
        let (x, y) = (camera.fx * q.x / q.z + camera.cx, camera.fy * q.y / q.z + camera.cy);
        (q.z > 0.2 && (0.0..640.0).contains(&x) && (0.0..360.0).contains(&y)).then_some([x, y])
    }
}
