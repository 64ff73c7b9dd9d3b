//! Paths and speeds: the meaning of each key, also in the merged form.

use super::{recipe, said};
use glam::{DQuat, DVec3};
use gs2e_image::Size;
use gs2e_num::seed::{Seed, StreamPurpose};
use gs2e_num::units::Ratio;
use gs2e_recipe::{Recipe, SceneSource, TrajectoryRecipe, find_edits};
use gs2e_scene::camera::{Camera, CameraChoice, PrincipalPoint};
use gs2e_trajectory::curve::CurveKind;
use gs2e_trajectory::keyframes::{CameraFacing, Keyframe, KeyframePath};
use gs2e_trajectory::novel::{GroupCurve, NovelGroup};
use gs2e_trajectory::orbit::OrbitPath;
use gs2e_trajectory::path::CameraPath;
use gs2e_trajectory::refine::{RefinePath, TranslationScale};
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::speed::function::SpeedExpression;
use gs2e_trajectory::speed::list::SpeedLevels;
use gs2e_trajectory::speed::{FlowSpeed, SpeedChoice, SpeedMeaning};
use gs2e_trajectory::travel::PoseCount;

/// A procedural recipe with these trajectories, a list in flow style. Checks that its merged form
/// means the same.
fn with(trajectories: &str) -> Recipe {
    let yaml = format!(
        "version: 1\nscene: a\nseed: 7\nsource: {{ procedural: {{}} }}\ntrajectories: [{trajectories}]\n"
    );
    reparsed(&yaml)
}

/// The recipe of a text, whose merged form is checked to mean the same.
fn reparsed(yaml: &str) -> Recipe {
    let first = recipe(yaml).unwrap_or_else(|f| panic!("{yaml}\n{}", f.render_text()));
    let merged = serde_json::to_string_pretty(&first.meta.merged).unwrap();
    let second = recipe(&merged).unwrap_or_else(|f| panic!("{merged}\n{}", f.render_text()));
    assert_eq!(said(second), said(first.clone()), "{merged}");
    first
}

/// The one trajectory of a recipe with these keys.
fn one(keys: &str) -> TrajectoryRecipe {
    let mut recipe = with(&format!("{{ name: b, {keys} }}"));
    assert_eq!(recipe.trajectories.len(), 1);
    recipe.trajectories.remove(0)
}

fn law(text: &str) -> SpeedExpression {
    SpeedExpression::parse(text).unwrap()
}

fn names(recipe: &Recipe) -> Vec<&str> {
    recipe.trajectories.iter().map(|t| t.name.as_str()).collect()
}

#[test]
fn curves_are_read() {
    let t = |text: &str, wanted: CurveKind| {
        let CameraPath::Refine(RefinePath { curve, .. }) = one(&format!("refine: {{ curve: {text} }}")).path
        else {
            panic!("another path")
        };
        assert_eq!(curve, wanted, "{text}");
    };
    t("cubic", CurveKind::Cubic);
    t("cumulative", CurveKind::Cumulative);
    t("slerp-lerp", CurveKind::SlerpLerp);
    t("{ bezier: { degree: 20 } }", CurveKind::Bezier { degree: 20 });
}

#[test]
fn orbits_are_read() {
    let t = |text: &str, wanted: OrbitPath| assert_eq!(one(text).path, CameraPath::Orbit(wanted), "{text}");
    let usual = OrbitPath { centre: None, from: None, up: None, arc: 360.0, count: PoseCount::Frames(150) };
    t("orbit: {}", usual.clone());
    t(
        "orbit: { arc: -90, frames: 7 }",
        OrbitPath { arc: -90.0, count: PoseCount::Frames(7), ..usual.clone() },
    );
    let seconds = PoseCount::Duration(Ratio::new(1, 2).unwrap());
    t(
        "orbit: { up: [0, 0, 2], duration: 0.5 }",
        OrbitPath { up: Some(DVec3::Z * 2.0), count: seconds, ..usual },
    );
    let whole = one("orbit: { centre: [1, 2, 3], from: [1, 2, 7.5], up: [0, -1, 0] }");
    let CameraPath::Orbit(OrbitPath { centre, from, up, .. }) = whole.path else { panic!("another path") };
    assert_eq!((centre, from), (Some(DVec3::new(1.0, 2.0, 3.0)), Some(DVec3::new(1.0, 2.0, 7.5))));
    assert_eq!(up, Some(DVec3::NEG_Y));
    assert_eq!((whole.speed, whole.base), (SpeedChoice::Function(law("1")), None));
}

#[test]
fn keyframes_are_read() {
    let found = one("keyframes: { poses: [{ position: [0, 0, -4], rotation: [0, 0.6, 0, 0.8] }, \
         { position: [1, 0, -4], look_at: [0, 0, 0], up: [0, 1, 0] }], \
         curve: slerp-lerp, metric: { scale: 2 }, literal: true, factor: 3/2 }");
    let turned = Keyframe {
        position: DVec3::new(0.0, 0.0, -4.0),
        facing: CameraFacing::Rotation(DQuat::from_xyzw(0.0, 0.6, 0.0, 0.8)),
    };
    let facing = CameraFacing::Towards { target: DVec3::ZERO, up: DVec3::Y };
    let wanted = KeyframePath {
        poses: vec![turned, Keyframe { position: DVec3::new(1.0, 0.0, -4.0), facing }],
        count: PoseCount::Factor(Ratio::new(3, 2).unwrap()),
        curve: CurveKind::SlerpLerp,
        scale: TranslationScale::Fixed(2.0),
        literal: true,
    };
    assert_eq!((found.path, found.speed), (CameraPath::Keyframes(wanted), SpeedChoice::Function(law("1"))));
    let usual = one("keyframes: { poses: [{ position: [0, 0, 0], rotation: [0, 0, 0, 1] }] }");
    let CameraPath::Keyframes(KeyframePath { count, curve, scale, literal, .. }) = usual.path else {
        panic!("another path")
    };
    assert_eq!(
        (count, curve, scale, literal),
        (PoseCount::Frames(150), CurveKind::Cubic, TranslationScale::Scene, false)
    );
}

#[test]
fn each_group_is_a_trajectory_and_all_share_the_draws() {
    let recipe = with("{ name: mini, novel: {} }, { name: round, orbit: {} }, { name: base, refine: {} }");
    assert_eq!(names(&recipe), ["mini-0", "mini-1", "mini-2", "round", "base"]);
    // The base is the first trajectory that is not novel, at any place in the list.
    let bases: Vec<_> = recipe.trajectories.iter().map(|t| t.base.as_deref()).collect();
    assert_eq!(bases, [Some("round"), Some("round"), Some("round"), None, None]);
    for (group, trajectory) in (0..3).zip(&recipe.trajectories) {
        let wanted = NovelGroup {
            group,
            groups: 3,
            keyframes: 5,
            count: PoseCount::Frames(150),
            curve: GroupCurve::Any,
            literal: false,
            keyframes_seed: Seed::for_stream(7, "a", "mini", StreamPurpose::Keyframes),
            curve_seed: Seed::for_stream(7, "a", "mini", StreamPurpose::Curve),
        };
        assert_eq!(trajectory.path, CameraPath::Novel(wanted));
        assert_eq!((&trajectory.written[..], &trajectory.speed), ("mini", &SpeedChoice::Function(law("1"))));
    }
    assert_eq!(recipe.meta.merged["trajectories"].as_array().unwrap().len(), 3);
    assert_eq!(recipe.meta.merged["trajectories"][0]["novel"]["base"], "round");
}

#[test]
fn novel_paths_are_read() {
    let recipe = with(
        "{ name: base, refine: {} }, { name: one, novel: { groups: 1, keyframes: 2, duration: 1, \
         curve: { bezier: { degree: 4 } }, literal: true, base: base }, speed: { function: 1 + t } }",
    );
    assert_eq!(names(&recipe), ["base", "one-0"]);
    let one = &recipe.trajectories[1];
    let CameraPath::Novel(novel) = &one.path else { panic!("another path") };
    let (groups, keyframes) = (novel.groups, novel.keyframes);
    assert_eq!(
        (groups, keyframes, novel.literal, &one.speed),
        (1, 2, true, &SpeedChoice::Function(law("1 + t")))
    );
    assert_eq!(novel.curve, GroupCurve::Fixed(CurveKind::Bezier { degree: 4 }));
    assert_eq!(novel.count, PoseCount::Duration(Ratio::new(1, 1).unwrap()));
    // The number of key poses equals the base's number of poses; each is drawn once.
    with("{ name: base, refine: { frames: 15 } }, { name: mini, novel: {} }");
}

#[test]
fn edits_are_reported_by_the_written_name() {
    let path = |groups: u32, x: f64| {
        with(&format!(
            "{{ name: base, keyframes: {{ poses: [{{ position: [{x}, 0, 0], rotation: [0, 0, 0, 1] }}] }} }}, \
             {{ name: mini, novel: {{ groups: {groups} }} }}"
        ))
    };
    let found = find_edits(&path(3, 0.0).meta.merged, &path(4, 0.5).meta.merged);
    let paths: Vec<&str> = found.iter().map(|edit| edit.path.as_str()).collect();
    assert_eq!(paths, ["trajectories.base.keyframes.poses[0].position[0]", "trajectories.mini.novel.groups"]);
}

#[test]
fn only_refined_paths_have_the_speed_of_the_paper_by_default() {
    assert_eq!(one("refine: {}").speed, SpeedChoice::Function(law("0.25*sin(t) + 1.1")));
    assert_eq!(one("orbit: {}").speed, SpeedChoice::Function(law("1")));
}

#[test]
fn speeds_are_read() {
    let t = |text: &str, wanted: SpeedChoice| {
        assert_eq!(one(&format!("refine: {{}}, speed: {{ {text} }}")).speed, wanted, "{text}");
    };
    let list = |levels: &[f64], blend, meaning| {
        SpeedChoice::List(SpeedLevels::new(levels.to_vec(), blend, meaning).unwrap())
    };
    t("list: { multipliers: [1, 0.5, 2] }", list(&[1.0, 0.5, 2.0], 0.1, SpeedMeaning::Speed));
    t("list: { multipliers: [3], blend: 0 }", list(&[3.0], 0.0, SpeedMeaning::Speed));
    t(
        "list: { multipliers: [1, 2], blend: 0.5, meaning: frame-rate }",
        list(&[1.0, 2.0], 0.5, SpeedMeaning::FrameRate),
    );
    t("flow: { px_s: 400 }", SpeedChoice::Flow(FlowSpeed { px_s: 400.0, shape: law("1") }));
    t(
        "flow: { px_s: 0.5, function: 2 - t }",
        SpeedChoice::Flow(FlowSpeed { px_s: 0.5, shape: law("2 - t") }),
    );
    for path in
        ["refine: {}", "orbit: {}", "keyframes: { poses: [{ position: [0, 0, 0], rotation: [0, 0, 0, 1] }] }"]
    {
        let count = match one(&format!("{path}, speed: {{ flow: {{ px_s: 1 }} }}")).path {
            CameraPath::Refine(path) => path.count,
            CameraPath::Orbit(path) => path.count,
            CameraPath::Keyframes(path) => path.count,
            CameraPath::Novel(path) => path.count,
        };
        assert_eq!(count, PoseCount::Flow, "{path}");
    }
}

#[test]
fn the_law_is_summed_or_integrated() {
    let yaml = "version: 1\nscene: a\nsource: { procedural: {} }\ntrajectories: [{ name: b, refine: {} }]\n";
    assert_eq!(reparsed(yaml).law, SummationRule::Sum);
    assert_eq!(reparsed(&format!("{yaml}sampling: {{ law: sum }}\n")).law, SummationRule::Sum);
    assert_eq!(reparsed(&format!("{yaml}sampling: {{ law: integral }}\n")).law, SummationRule::Integral);
}

/// Methods of events take the centre of a picture for one of two places, which no number has to spell.
#[test]
fn the_principal_point_has_a_name() {
    let yaml = |camera: &str| {
        format!(
            "version: 1\nscene: a\nsource: {{ procedural: {{}} }}\ncamera: {{ width: 64, height: 48, {camera} }}\n\
             trajectories: [{{ name: b, refine: {{}} }}]\n"
        )
    };
    let own =
        Camera { size: Size { width: 64, height: 48 }, fx: 50.0, fy: 50.0, cx: 31.0, cy: 25.0, lens: None };
    let centre = |camera: &str| {
        let camera = reparsed(&yaml(camera)).camera.unwrap().resolve(Some(&own)).unwrap();
        (camera.fx, camera.cx, camera.cy)
    };
    assert_eq!(centre("principal: given"), (50.0, 31.0, 25.0));
    assert_eq!(centre("principal: middle"), (50.0, 32.0, 24.0));
    assert_eq!(centre("principal: corner-half"), (50.0, 32.5, 24.5));
    assert_eq!(centre("fx: 60, principal: corner-half"), (60.0, 32.5, 24.5));
    let Err(fault) = recipe(&yaml("fx: 60, cx: 30, principal: middle")) else { panic!("both are given") };
    assert!(fault.render_text().contains("both `principal` and `cx` or `cy`"), "{}", fault.render_text());
}

/// Sizes that methods have in their code.
#[test]
fn a_size_has_a_name() {
    let yaml = |camera: &str| {
        format!(
            "version: 1\nscene: a\nsource: {{ procedural: {{}} }}\ncamera: {{ {camera} }}\n\
             trajectories: [{{ name: b, refine: {{}} }}]\n"
        )
    };
    for (name, width, height) in
        [("davis346", 346, 260), ("dsec", 640, 480), ("blender", 800, 800), ("evk4", 1280, 720)]
    {
        let camera = reparsed(&yaml(&format!("size: {name}, principal: middle"))).camera;
        assert_eq!(
            camera,
            reparsed(&yaml(&format!("width: {width}, height: {height}, principal: middle"))).camera
        );
        assert_eq!(camera.map(|camera| (camera.width, camera.height)), Some((width, height)));
    }
    for (camera, words) in [
        ("size: dsec, width: 640", "both `size` and `width` or `height`"),
        ("size: vga", "unknown choice \"vga\""),
        ("width: 640", "missing field \"camera.height\""),
    ] {
        let Err(fault) = recipe(&yaml(camera)) else { panic!("{camera}") };
        assert!(fault.render_text().contains(words), "{}", fault.render_text());
    }
}

#[test]
fn a_scene_without_a_capture_writes_its_camera() {
    let t = |camera: &str, intrinsics: [f64; 4]| {
        let yaml = format!(
            "version: 1\nscene: a\nsource: none\nreconstruct: {{ given: {{ path: /a.ply }} }}\ncamera: {{ {camera} }}\n\
             trajectories: [{{ name: b, orbit: {{ centre: [0, 0, 0], from: [0, 0, 4], up: [0, 1, 0] }} }}]\n"
        );
        let recipe = reparsed(&yaml);
        assert_eq!((&recipe.source, recipe.source.kind().name()), (&SceneSource::None, "none"));
        let wanted = CameraChoice {
            width: 64,
            height: 48,
            intrinsics: Some(intrinsics),
            principal: PrincipalPoint::Given,
            lens: None,
        };
        assert_eq!(recipe.camera, Some(wanted), "{camera}");
    };
    t("width: 64, height: 48, fx: 60", [60.0, 60.0, 32.0, 24.0]);
    t("width: 64, height: 48, fx: 60, fy: 61, cx: 30", [60.0, 61.0, 30.0, 24.0]);
    t("width: 64, height: 48, fx: 60, fy: 61, cx: 30, cy: 20", [60.0, 61.0, 30.0, 20.0]);
}
