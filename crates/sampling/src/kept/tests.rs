use super::*;
use glam::{DQuat, DVec3};
use gs2e_image::{Image, Size};
use gs2e_scene::camera::view::CameraVelocity;
use std::cell::Cell;
use std::rc::Rc;

const SIZE: Size = Size { width: 4, height: 3 };

/// Paints every pixel with the camera's x, and counts its renderings.
struct Counting(Rc<Cell<usize>>);

impl Renderer for Counting {
    fn fingerprint(&self) -> &str {
        "counting/1"
    }

    #[expect(clippy::cast_possible_truncation, reason = "the test's values are small")]
    fn render(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError> {
        self.0.set(self.0.get() + 1);
        let x = view.world_from_camera.translation.x as f32;
        let grey = |wanted: bool, value: f32| wanted.then(|| Image::filled(SIZE, value));
        *out = RenderedImages {
            rgb: want.rgb.then(|| Image::filled(SIZE, [x, 2.0, 3.0])),
            luminance: grey(want.luminance, x),
            alpha: grey(want.alpha, 0.5),
            depth: grey(want.depth, f32::NAN),
            flow: want.flow.then(|| Image::filled(SIZE, [x, x])),
            luminance_rate: grey(want.luminance_rate, -x),
            doubtful: grey(want.doubtful, 0.25),
            segmentation: None,
            drift: None,
        };
        Ok(RenderWork { blended: 7, ..RenderWork::default() })
    }
}

fn view(x: f64) -> CameraView {
    let camera = Camera { size: SIZE, fx: 2.0, fy: 2.0, cx: 2.0, cy: 1.5, lens: None };
    let pose = Se3 { rotation: DQuat::IDENTITY, translation: DVec3::new(x, 0.0, 0.0) };
    let velocity = CameraVelocity { linear: DVec3::X, angular: DVec3::ZERO };
    CameraView { velocity, ..CameraView::at_rest(camera, pose) }
}

const FRAME: ChannelSet = ChannelSet { luminance: true, luminance_rate: true, ..ChannelSet::NONE };

/// A run over files of earlier runs: the images of each request, and the number of renderings.
fn run(
    paths: &[PathBuf],
    fresh: &std::path::Path,
    limit: u64,
    asked: &[(f64, ChannelSet)],
) -> (Vec<RenderedImages>, usize, KeptSummary) {
    let (count, kept) = (Rc::new(Cell::new(0)), Arc::new(KeptFrames::open(paths, fresh.to_owned(), limit)));
    let keeps = ChannelSet { luminance_rate: true, ..ChannelSet::NONE };
    let inner = Box::new(Counting(count.clone()));
    let mut renderer = KeptRenderer::new(inner, kept.clone(), keeps, OmissionPolicy::Needless);
    let mut shown = Vec::new();
    for (x, want) in asked {
        let mut images = RenderedImages::default();
        let work = renderer.render(&view(*x), *want, &mut images).unwrap();
        assert_eq!(work.blended, 7);
        shown.push(images);
    }
    (shown, count.get(), kept.finish())
}

fn luminance(images: &RenderedImages) -> Option<f32> {
    images.luminance.as_ref().map(|image| image.pixels()[5])
}

#[test]
fn a_second_run_renders_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let fresh = folder.path().join("a");
    let asked = [(1.0, FRAME), (2.0, FRAME), (3.0, MEASURED)];
    let (first, count, summary) = run(&[], &fresh, 1 << 20, &asked);
    assert_eq!((count, summary.reused, summary.rendered), (3, 0, 3));
    assert_eq!(summary.bytes, fresh.metadata().unwrap().len());
    let (second, count, summary) = run(&[fresh], &folder.path().join("b"), 1 << 20, &asked);
    assert_eq!((count, summary.reused, summary.rendered, summary.bytes), (0, 3, 0, 0));
    assert!(!folder.path().join("b").exists());
    for (a, b) in first.iter().zip(&second) {
        assert_eq!((&a.luminance, &a.luminance_rate, &a.alpha), (&b.luminance, &b.luminance_rate, &b.alpha));
        assert_eq!(a.depth.is_some(), b.depth.is_some());
    }
}

#[test]
fn fewer_images_are_shown_and_more_are_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let fresh = folder.path().join("a");
    run(&[], &fresh, 1 << 20, &[(1.0, FRAME)]);
    let only = ChannelSet { luminance: true, ..ChannelSet::NONE };
    let (shown, count, _) =
        run(std::slice::from_ref(&fresh), &folder.path().join("b"), 1 << 20, &[(1.0, only)]);
    assert_eq!((count, luminance(&shown[0]), shown[0].luminance_rate.is_none()), (0, Some(1.0), true));
    let more = ChannelSet { rgb: true, ..FRAME };
    let (shown, count, summary) = run(&[fresh], &folder.path().join("c"), 1 << 20, &[(1.0, more)]);
    assert_eq!((count, shown[0].rgb.is_some(), summary.rendered), (1, true, 1));
}

#[test]
fn another_pose_velocity_or_promise_is_another_view() {
    let folder = tempfile::tempdir().unwrap();
    let fresh = folder.path().join("a");
    run(&[], &fresh, 1 << 20, &[(1.0, FRAME)]);
    let kept = Arc::new(KeptFrames::open(&[fresh], folder.path().join("b"), 1 << 20));
    let count = Rc::new(Cell::new(0));
    let inner = Box::new(Counting(count.clone()));
    let mut renderer = KeptRenderer::new(inner, kept, FRAME, OmissionPolicy::Needless);
    let mut images = RenderedImages::default();
    let mut renders = |renderer: &mut KeptRenderer, view: &CameraView| {
        let before = count.get();
        renderer.render(view, FRAME, &mut images).unwrap();
        count.get() > before
    };
    assert!(!renders(&mut renderer, &view(1.0)));
    assert!(renders(&mut renderer, &view(1.0 + 1e-15)));
    let mut faster = view(1.0);
    faster.velocity.linear.y = 1e-300;
    assert!(renders(&mut renderer, &faster));
    // Of the luminance alone, the velocity changes nothing.
    let still = ChannelSet { luminance: true, ..ChannelSet::NONE };
    let before = count.get();
    renderer.render(&faster, still, &mut RenderedImages::default()).unwrap();
    assert_eq!(count.get(), before);
    // The counts of a rendering depend on the promise.
    renderer.keep_to(&view(1.0).camera, &[view(1.0).world_from_camera]);
    assert!(renders(&mut renderer, &view(1.0)));
    // Renderings that only measure time are neither shown nor kept.
    let mut renderer = renderer;
    renderer.omit(OmissionPolicy::Nothing);
    assert!(renders(&mut renderer, &view(1.0)));
}

#[test]
fn frames_without_space_are_given_up() {
    let folder = tempfile::tempdir().unwrap();
    let fresh = folder.path().join("a");
    let asked: Vec<_> = (0..50).map(|x| (f64::from(x), FRAME)).collect();
    let (shown, count, summary) = run(&[], &fresh, 2000, &asked);
    assert_eq!((shown.len(), count, summary.bytes), (50, 50, 0));
    assert!(summary.refused.unwrap().contains("exceed"));
    assert!(!fresh.exists());
    // Nor is a folder without permission a failure.
    let nowhere = folder.path().join("absent/a");
    let (shown, _, summary) = run(&[], &nowhere, 2000, &asked[..1]);
    assert!(shown[0].luminance.is_some() && summary.refused.is_some());
}
