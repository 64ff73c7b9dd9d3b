//! All passes on sound worlds, and faults that concern several passes. Each pass has its own tests.

use super::planted::{PlantedWorld, WorldSettings};
use super::*;

#[test]
fn every_pass_says_something() {
    let world = PlantedWorld::default_world();
    let findings = world.findings();
    for (check, _) in PASSES {
        assert!(findings.iter().any(|f| f.check == *check), "{check}");
    }
    // Everything moves in this world, and its sensor has no dead time. There are no released files.
    let silent = findings.iter().filter(|f| f.verdict == Verdict::NotRun);
    let silent: Vec<&str> = silent.map(|f| f.check.as_str()).collect();
    let released = ["event_times", "event_times", "photometric", "depth_consistency", "flow_projection"];
    let wanted = [&["refractory", "flash"], &released[..2], &["noise_floor"], &released[2..]].concat();
    assert_eq!(silent, wanted, "{findings:#?}");
}

#[test]
fn sound_worlds_raise_no_alarm() {
    let (paces, thresholds) = ([0.05, 0.3, 0.8], [[1.0, 1.0], [0.6, 0.9], [1.4, 1.0]]);
    let lights = [(0.6, 0.0), (0.25, 0.0), (0.4, 1.5)];
    // A Latin square: each pace, pair of thresholds and light meets each other once.
    for i in 0..9 {
        let (contrast, dawn) = lights[(i / 3 + i) % 3];
        let thresholds = thresholds[i % 3];
        let setting =
            WorldSettings { pace: paces[i / 3], thresholds, contrast, dawn, ..WorldSettings::default() };
        let mut world = PlantedWorld::new(setting);
        // The usual rate per flow holds for scenes, which these waves are not.
        world.flow = None;
        assert_eq!(world.faults(), [""; 0], "{setting:?}: {:#?}", world.findings());
    }
}

#[test]
fn verdicts_have_one_name() {
    for verdict in [Verdict::Pass, Verdict::Warn, Verdict::Fail, Verdict::Waived, Verdict::NotRun] {
        assert_eq!(serde_json::to_value(verdict).unwrap(), verdict.name());
    }
}

/// A lamp changes all pixels in step and without motion, and its events show the picture where it stands.
#[test]
fn a_lamp_leaves_offset_motion_and_rate_unjudged() {
    let mut world = PlantedWorld::default_world();
    for check in ["motion#median", "event_rate#flow"] {
        assert_eq!(world.finding(check).verdict, Verdict::Pass);
    }
    world.light_changes = true;
    for check in ["motion", "event_rate#flow", "time_offset"] {
        assert_eq!(world.finding(check).verdict, Verdict::NotRun);
    }
}

#[test]
fn waived_faults_say_why() {
    let mut world = PlantedWorld::default_world();
    world.trajectory.stamps_us[20] += 1;
    world.limits.waive = vec![CheckWaiver { check: "stamps".into(), because: "a test".into() }];
    let finding = world.finding("stamps#poses");
    assert_eq!(finding.verdict, Verdict::Waived);
    assert!(finding.because.ends_with("; accepted: a test"), "{}", finding.because);
}
