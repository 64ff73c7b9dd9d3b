//! Tests of the loop of a training.

use super::*;
use glam::{DQuat, DVec3};
use gs2e_image::{Image, Size, png};
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_source::{CapturedView, LensModel};
use std::cell::Cell;

/// A folder with five photos of coloured stripes, taken from a row of cameras.
fn striped() -> (tempfile::TempDir, Capture, Vec<(String, PathBuf)>) {
    let folder = tempfile::tempdir().unwrap();
    let size = Size { width: 48, height: 40 };
    let (mut views, mut files) = (Vec::new(), Vec::new());
    for i in 0..5_u8 {
        let name = format!("{i}.png");
        let pixel = |k: usize| [u8::try_from(5 * (k % 48)).unwrap(), 40 * i, u8::try_from(k / 48).unwrap()];
        let image = Image::from_vec(size, (0..size.pixels()).map(pixel).collect());
        let path = folder.path().join(&name);
        png::write_image(&image, std::fs::File::create(&path).unwrap()).unwrap();
        files.push((name.clone(), path));
        let translation = DVec3::new(0.1 * f64::from(i), 0.0, 0.0);
        views.push(CapturedView {
            name,
            world_from_camera: Se3 { rotation: DQuat::IDENTITY, translation },
            camera: Camera { size, fx: 40.0, fy: 40.0, cx: 24.0, cy: 20.0, lens: None },
            lens: LensModel::Pinhole,
            sha256: None,
        });
    }
    (folder, Capture { views, unused: Vec::new() }, files)
}

fn settings(until: TrainingGoal) -> TrainingSettings {
    TrainingSettings { gaussians: 200, iterations: 60, resolution: 48, until, ..TrainingSettings::default() }
}

/// A clock, or none.
type Clock = Option<fn() -> f64>;

/// A training that goes on as long as it is asked less than `asked` times.
fn trained(
    (capture, files): (&Capture, &[(String, PathBuf)]),
    until: TrainingGoal,
    (clock, checkpoint): (Clock, Option<CheckpointFile<'_>>),
    asked: u32,
) -> (Result<TrainedGaussians, TrainingError>, Vec<TrainingNews>) {
    let count = std::sync::atomic::AtomicU32::new(0);
    let goes_on = || count.fetch_add(1, std::sync::atomic::Ordering::Relaxed) < asked;
    let mut heard = Vec::new();
    let mut news = |news: &TrainingNews| heard.push(news.clone());
    let watch = TrainingWatch { goes_on: &goes_on, news: &mut news, clock, checkpoint };
    (train_capture(capture, files, &settings(until), &Backend::Cpu, watch), heard)
}

const NO_GOAL: TrainingGoal = TrainingGoal { psnr: None, minutes: None };

thread_local! {
    static NOW: Cell<f64> = const { Cell::new(0.0) };
}

/// A clock that moves by 10 s whenever it is read.
fn ticking() -> f64 {
    NOW.set(NOW.get() + 10.0);
    NOW.get()
}

#[test]
fn a_training_ends_when_its_goal_is_reached() {
    let (_folder, capture, files) = striped();
    let (whole, heard) = trained((&capture, &files), NO_GOAL, (None, None), u32::MAX);
    let whole = whole.unwrap().record;
    assert_eq!((whole.iterations, whole.ended, whole.course.len()), (60, TrainingEnd::Iterations, 20));
    assert_eq!(heard[0], TrainingNews::Read { training: 4, held_out: 1, points: 0 });
    assert_eq!(heard.len(), 21);

    // A PSNR that the course has for the first time at its fifth report or later.
    let point = whole.course[4..].iter().find(|point| whole.course[0].psnr < point.psnr).unwrap();
    let goal = TrainingGoal { psnr: point.psnr, ..NO_GOAL };
    let first = whole.course.iter().find(|p| p.psnr >= point.psnr).unwrap();
    let early = trained((&capture, &files), goal, (None, None), u32::MAX).0.unwrap().record;
    assert_eq!((early.iterations, early.ended), (first.iteration, TrainingEnd::Psnr));
    assert_eq!(early.course[..], whole.course[..early.course.len()]);

    // Two minutes of a clock that is read once per iteration and once at the start.
    let goal = TrainingGoal { minutes: Some(2.0), ..NO_GOAL };
    let early = trained((&capture, &files), goal, (Some(ticking), None), u32::MAX).0.unwrap().record;
    assert_eq!(early.ended, TrainingEnd::Minutes);
    assert!((8..=12).contains(&early.iterations), "{early:?}");
}

/// Stopped between two reports, where the sum of the losses is part of the state.
#[test]
fn a_resumed_training_has_the_record_of_an_uninterrupted_one() {
    let (folder, capture, files) = striped();
    let whole = trained((&capture, &files), NO_GOAL, (None, None), u32::MAX).0.unwrap();
    let path = folder.path().join("state");
    let kept = Some(CheckpointFile { path: &path, replaces: true });
    let stopped = trained((&capture, &files), NO_GOAL, (None, kept), 36).0;
    assert!(matches!(stopped, Err(TrainingError::Stopped)), "{stopped:?}");
    let (resumed, heard) = trained((&capture, &files), NO_GOAL, (None, kept), u32::MAX);
    let resumed = resumed.unwrap();
    assert!(heard.len() < 20, "it started again: {heard:?}");
    assert_eq!(resumed.record, whole.record);
    assert_eq!(resumed.scene.positions, whole.scene.positions);

    // A file that a killed process left half written is replaced where that is asked for.
    std::fs::write(&path, b"gs2e training 2\nnothing that has a digest of its own").unwrap();
    let (again, heard) = trained((&capture, &files), NO_GOAL, (None, kept), u32::MAX);
    assert_eq!(again.unwrap().record, whole.record);
    assert!(matches!(&heard[1], TrainingNews::Restarted { because } if because.contains("damaged")));
    std::fs::write(&path, b"gs2e training 2\nnothing that has a digest of its own").unwrap();
    let named = Some(CheckpointFile { path: &path, replaces: false });
    let refused = trained((&capture, &files), NO_GOAL, (None, named), u32::MAX).0;
    assert!(matches!(refused, Err(TrainingError::Checkpoint { .. })), "{refused:?}");
}

#[test]
fn a_value_that_is_not_finite_is_named() {
    let (_folder, capture, files) = striped();
    let settings = settings(NO_GOAL);
    let views = TrainingViews::read(&capture, &files, 48, 8, &|| true).unwrap();
    let mut trainer = SceneTrainer::new(&views, &[], &settings, &Backend::Cpu).unwrap();
    for _ in 0..3 {
        trainer.step().unwrap();
    }
    // Squares of these colours exceed the largest number of 32 bits.
    trainer.renderer.rebuild(|scene| scene.sh.iter_mut().for_each(|sh| *sh = [1e30; 3])).unwrap();
    match trainer.step() {
        Err(TrainingError::NotFinite { iteration: 4, view, what }) => {
            assert!(capture.views.iter().any(|other| other.name == view) && what == "loss", "{view}: {what}");
        }
        other => panic!("{other:?}"),
    }
}

/// No gradient and no loss shows it: a Gaussian that is not finite is not drawn.
#[test]
fn a_state_that_is_not_finite_is_named() {
    let (_folder, capture, files) = striped();
    let settings = settings(NO_GOAL);
    let views = TrainingViews::read(&capture, &files, 48, 8, &|| true).unwrap();
    let mut trainer = SceneTrainer::new(&views, &[], &settings, &Backend::Cpu).unwrap();
    trainer.check_state().unwrap();
    trainer.renderer.rebuild(|scene| scene.log_scales[3][1] = f32::INFINITY).unwrap();
    match trainer.check_state() {
        Err(TrainingError::NotFinite { what, .. }) => assert_eq!(what, "state of Gaussian 3"),
        other => panic!("{other:?}"),
    }
}
