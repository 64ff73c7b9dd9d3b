//! Frozen results of each stage: the content digest of tiny scenes, with the stage's revision and
//! class. A change of bytes without a change of the key would let old results pass for new ones.
//! This test then fails and names the revision to raise.

use crate::support::given::{GIVEN, sound};
use gs2e_release::ReleaseManifest;
use gs2e_store::record::content_digest;
use std::collections::BTreeSet;
use std::fmt;
use std::io::Write as _;
use std::path::Path;

/// A step and its pinned values.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Pin {
    /// Scene and step.
    step: String,
    stage: String,
    revision: u32,
    /// Numerical class; empty if the stage has none.
    class: String,
    /// Digest of the step's parameters and inputs.
    key: String,
    /// Content digest of its outputs.
    made: String,
}

/// The pins, one line each: step, stage, revision, class (`-` for none), key, content.
const PINS: &str = "\
flowing/capture capture 1 - 8fbda1239547ab3a4bfa6a46f504f7a88dd613ab58b5545cd419e0289d83b99e 87d60d8cc2c95af711b2471be4c4b464bb222c0187ecceb1c46f2caf068a3e0b
flowing/reconstruct reconstruct 1 - f08e239c29c207756f7905e41ab76ed699d2781e07b6f7c14be494f0a7c93c88 a3e152f67b49bb0b2f669a27a7ddfbb1278d1b2f627b1443b8aefd0c0b52e19c
flowing/base/trajectory trajectory 2 - a124f5048c89e3ed2c5e8d13167dfa3ab52a94c54b0f3fb6cdf4ed1393f82e78 bc3d6236918fdd1d0589e995cceb31a15871308727960a6c385e233ed2e1c640
flowing/base/events events 8 cpu/1 94974c60dc9f45e73c20e0dab6e855c3fda39b4c9082a3cb7d1df284b4412628 7492b5109b24ba6170e8fffac75386f39681308796871a94069cdb95f8accd0a
flowing/base/flow flow 1 cpu/1 2317da7eb960b55108ae732d8bb02652b301f2e1a498c9ee175c5fc42d742fe9 91c51645e525c1ca9935fdf365f81d3c839bc8306629534bb9b012f1ece8b152
flowing/base/checks checks 16 - dcb76a5e844165411d5c4a2a64bfbd867c667f5db7853ed1d17f72702963e98e b8c845b3a2d4153afa6bffcba4d2b1a20c5f4aecef0a44924b946deb4225a731
given/capture capture 1 - 1f239bc3706bce6ad48cb95e467edac25bc8c05f00b22f1574cfe4d3134362b4 1e0e0dc66631d04197236d1f8eaba364597393244ef8abedd258f9527bdcecd7
given/reconstruct reconstruct 1 - 1fda88689eebaf79bd69dc825d1d13c89d127b8e5922e8fbbdecea2344e6c91f f9d26ec341aaeefc6d12772e2167ee7c2c0613e6d37dba3ea374738e9a68cfc6
given/base/trajectory trajectory 2 - d5c2dcf5ff34f00fbe458b8667219ca5f32ab3b71ed08701b9daadc1052aa2d3 97eb2ad797db5b7c46e6ea448914ecae323fc6d440b18f9799708281bea11b17
given/base/events events 8 cpu/1 6137865c21b3fc36e09db674dff1a3301fbbd9a7203ecdcc76921fcf1340a14f abcad0e05492be541b0ff09418db3e30de448647c2b2f55cadba6865e25f5d95
given/base/sharp sharp 2 cpu/1 9107b40f174199b3f90163fc0ede60e8d655aa9536ed21a3ac4fb7e16ba4fb1b 46950ca3f60a2450125c71a7802a4e823ab0d1d2b0914997218bb90b682bc58c
given/base/checks checks 16 - 2505d1cea0ff30385892ff4372890a32765b3c6f0f74d03cd530565d99a23daf 85cfabe3bf92146131084f72213f46872a0b8f8b1f74dd56a6902144bdb05aca
given/fidelity fidelity 2 cpu/1 c49c42dba6e3014cf24dff8e4d1054f9369e012e634de81b4f28fd448d184a6e 9e05967baa77e646770f04f385e6484c5f03dcd6ce94c7b7fa9c824a8b8f1a03
given/checks scene_checks 4 - 2fc44bf85ff8d6f37d5e6c4d48ab5767dc2dbeac918a77d52a51b6ea7d345e03 105953e6c87fc84269e3dc228996a311676c307cf36e085f693f693fc9621755
moving/capture capture 1 - 8fbda1239547ab3a4bfa6a46f504f7a88dd613ab58b5545cd419e0289d83b99e 87d60d8cc2c95af711b2471be4c4b464bb222c0187ecceb1c46f2caf068a3e0b
moving/reconstruct reconstruct 1 - bb522cd35603c8faa21430c3e65be173ba1e0af66737cadcfdaf000c44de2c8e 992bae2d6968045bc8f05e821f5414130d32cd1806221cc0e17cca847572c39d
moving/objects objects 1 - f4b72069723c9ae17963b3643f7578c918a454a5fcc7bf20ad73ae9b92ff58a0 ed273ee71784b65632380ec8973c059a83fade3ef1e9bcbacf215851b131b3a3
moving/base/trajectory trajectory 2 - a124f5048c89e3ed2c5e8d13167dfa3ab52a94c54b0f3fb6cdf4ed1393f82e78 bc3d6236918fdd1d0589e995cceb31a15871308727960a6c385e233ed2e1c640
moving/base/events events 8 cpu/1 580c6b135f8cc01b8db394d8390f112f5543153961298b756a434ecd4e866d6f 4f259bf938b50ccb043f1d940711e8b5c269b71d4e7277962ee39c74d712d84d
moving/base/flow flow 1 cpu/1 e1a00f7bc5712ba9c4f1a62e8e58f314cb13180c36515b2abacda81dd8791780 95be39dd5ed5e900d65aa13319aa066c14820f72f3da84098c23ebe5ad6533b4
moving/base/segmentation segmentation 1 cpu/1 5adbba8a295a0c721ac5e1daa6c16ac03a15ad6f1be1641bb3ebed45a5f7e7e6 16dadf7747233891de1a924dbbffef076f6224681a9b70ceb11ec3e05f4f2cd9
moving/base/checks checks 16 - f2b41099fe51262a5f190f80e1922141c4123777fe5681d53d631170dc371087 ee05f606eea022547c2c180fc5eb26337d968a8809d77612f186b08459cf39fe
rigged/capture capture 1 - 8fbda1239547ab3a4bfa6a46f504f7a88dd613ab58b5545cd419e0289d83b99e 87d60d8cc2c95af711b2471be4c4b464bb222c0187ecceb1c46f2caf068a3e0b
rigged/reconstruct reconstruct 1 - bb522cd35603c8faa21430c3e65be173ba1e0af66737cadcfdaf000c44de2c8e 992bae2d6968045bc8f05e821f5414130d32cd1806221cc0e17cca847572c39d
rigged/base/trajectory trajectory 2 - a124f5048c89e3ed2c5e8d13167dfa3ab52a94c54b0f3fb6cdf4ed1393f82e78 bc3d6236918fdd1d0589e995cceb31a15871308727960a6c385e233ed2e1c640
rigged/base/checks checks 16 - 15342d4d16b6a1d5b322641741c822e96c3c14d073fefc8a7518441a555ccd28 f4e14b4964136efa0ee00ae849c8837cae54fab39cb8095ccf1301604b74319a
rigged/base/left/trajectory mount 1 - 7ba7dee357ae3acfa6747aeb63c585ed5768a70d3dd96ddbd8deefa7fbd27260 1123c570d485f7ce61a793ddd54cb411fdc87ae2371e860f5bf8beb25e66cc20
rigged/base/left/disparity disparity 1 cpu/1 ae9e77c698ebed71b028e5935ea5a00cfd7c60f0261aea28cbfaeb809e4e0b31 13e5c45b49276a6c2873c460656db5d99b70ae106b1dc04a44079671bac06117
rigged/base/left/checks checks 16 - 65282a86ae458d30064773ac046e75fce0266e8cd28658076001c1cb23eab00d 3fcdaf8cd126b8b720491fea750bc26b2fae589b8290929883d6c6d74d0ce8ed
rigged/base/right/trajectory mount 1 - 711995a320980f9f92883c6ad7e5e91abe0ac6cbf2f2820f20ba7751a34ae974 1c29e24ee7aa8dabc0f068f0227be5e0e3efb39f716c5818bb4336cf2caed8c6
rigged/base/right/checks checks 16 - 9939d2214145854de36b6d4c054f03e66fa0a9ce130606b38d4235edec9c0ab4 f411ff5b1255e610290d310ed865b07a1e5785c2845ef0090d0b71343c952bfc
spelled/capture capture 1 - 8fbda1239547ab3a4bfa6a46f504f7a88dd613ab58b5545cd419e0289d83b99e 87d60d8cc2c95af711b2471be4c4b464bb222c0187ecceb1c46f2caf068a3e0b
spelled/reconstruct reconstruct 1 - bb522cd35603c8faa21430c3e65be173ba1e0af66737cadcfdaf000c44de2c8e 992bae2d6968045bc8f05e821f5414130d32cd1806221cc0e17cca847572c39d
spelled/base/trajectory trajectory 2 - a124f5048c89e3ed2c5e8d13167dfa3ab52a94c54b0f3fb6cdf4ed1393f82e78 bc3d6236918fdd1d0589e995cceb31a15871308727960a6c385e233ed2e1c640
spelled/base/events events 8 cpu/1 350b5b2eeb3e61433183d85ccc836155fe8747f88afdfc052d984549a29fc9fc bf63138d337436736b181a14d4591a6169a3e9dffada3dd9ef4b9b43824f1890
spelled/base/sharp sharp 2 cpu/1 9e70b9d306674523a1d50f7e49852e34016270afb38b650b22bf698883fb9304 a4c22a3972dc28126ec4d9cfea06384f365c186efeac22171b9d0548cd32c205
spelled/base/blur blur 1 cpu/1 e31795adc297bb8b54a3fb6b53b68abca4656f471ea405b4ffafed265cf7745f 8f39a9779b9f6903a0a52931312fc244a7aa1e2ec9202c17acb81aef3d671556
spelled/base/depth depth 1 cpu/1 9ef57dc12265f7fafb924d79a4f4babf033f688c6ccf25accfa5004036d645e3 6138a782339e1f7cd8493e3c41c9deedc423004e07b1fbfcc6b77bbbcbffb354
spelled/base/flow flow 1 cpu/1 228378ea723c7ead71c0fa20e93c82cbe8e5ddeb486c8780b0fbe1a9af05a3da dd7e0f4f5c0e8a7bd08bfd3f1597235427a9ccacb4194876c307365505080653
spelled/base/imu imu 1 - f994a6b0917bbc6ad7a44cf04707d82ad8e6aa5fccc13a364f0b15a05ca7638f f60e8f7ab466ddcff0bc8f71c1e76c8f5084df49c37a73c87c9d916d2514e95d
spelled/base/checks checks 16 - 10df5692814ec2e9b4ae5b29e4d15e4435e284d548a7325725d2f05d9d4bab30 d1765604ecb45a55b645f8741a025b6892d32534d965045a4135b20d96878a2b
";

/// All values are written out: a changed default would move the key and hide a change of bytes.
const SPELLED: &str = "\
version: 1
scene: spelled
seed: 7
source: { procedural: { kind: still-life, gaussians: 300, views: 6, arc: 1, seed: 1 } }
camera: { width: 48, height: 32, fx: 50, fy: 50, cx: 24, cy: 16 }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"0.25*sin(t) + 1.1\" }
sampling: { rate: 2400, between: linear }
render: { rules: official, antialiased: false, background: [0.1, 0.2, 0.3] }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }
outputs: [events, sharp, blur, depth, flow, imu]
scale: { metres_per_unit: 0.5 }
imu:
  rate: 1000
  up: [0, -1, 0]
  gravity: 9.80665
  gyroscope: { noise: 0.0002, walk: 0.00002, bias: 0.01, range: 30 }
  accelerometer: { noise: 0.002, walk: 0.0003, bias: 0.2, range: 200 }
sharp: { every: 3 }
blur: { frames: 3, subframes: auto }
depth: { every: 4 }
flow: { every: 4 }
licence: { expression: CC0-1.0, holder: Nobody }
";

/// A scene with an object.
const MOVING: &str = "\
version: 1
scene: moving
seed: 7
source: { procedural: { kind: still-life, gaussians: 300, views: 6, arc: 1, seed: 1 } }
camera: { width: 48, height: 32, fx: 50, fy: 50, cx: 24, cy: 16 }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"0.25*sin(t) + 1.1\" }
sampling: { rate: 2400, between: linear }
render: { rules: official, antialiased: false, background: [0.1, 0.2, 0.3] }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }
outputs: [events, flow, segmentation]
flow: { every: 4 }
segmentation: { every: 4 }
objects:
  - name: bowl
    select: { box: { low: [-0.3, -0.7, -0.7], high: [1, 0, 0.7] } }
    path: { straight: { velocity: [1, 0, 0.5], spin: [0, 90, 0] } }
licence: { expression: CC0-1.0, holder: Nobody }
";

/// A scene with a rig.
const RIGGED: &str = "\
version: 1
scene: rigged
seed: 7
source: { procedural: { kind: still-life, gaussians: 300, views: 6, arc: 1, seed: 1 } }
camera: { width: 48, height: 32, fx: 50, fy: 50, cx: 24, cy: 16 }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"0.25*sin(t) + 1.1\" }
sampling: { rate: 2400, between: linear }
render: { rules: official, antialiased: false, background: [0.1, 0.2, 0.3] }
rig:
  cameras:
    - { name: left }
    - { name: right, extrinsic: { position: [0.1, 0.01, 0], rotation: [0, 0.02, 0, 0.9998] } }
  stereo: [[left, right]]
outputs: [disparity]
disparity: { every: 4 }
licence: { expression: CC0-1.0, holder: Nobody }
";

/// A scene that changes with time, behind a lens.
const FLOWING: &str = "\
version: 1
scene: flowing
seed: 7
source:
  procedural:
    kind: still-life
    gaussians: 300
    views: 6
    arc: 1
    seed: 1
    fountain: { drops: 40, time: { duration: 2, start: 0.5 } }
camera: { width: 48, height: 32, fx: 50, fy: 50, cx: 24, cy: 16, lens: { opencv: [-0.1, 0.02, 0.001, -0.001] } }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"0.25*sin(t) + 1.1\" }
sampling: { rate: 2400, between: linear }
render: { rules: official, antialiased: false, background: [0.1, 0.2, 0.3] }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }
outputs: [events, flow]
flow: { every: 4 }
licence: { expression: CC0-1.0, holder: Nobody }
";

/// The answer to a step that differs from its pin.
#[derive(Debug, PartialEq, Eq)]
enum Verdict {
    /// Nothing changed.
    Same,
    /// The revision was raised although the bytes are the same.
    RaisedForNothing,
    /// The bytes changed and the key did not: a store would confuse the two.
    Raise,
    /// Key and bytes changed together, or the key alone: only the pin must be replaced.
    PinAnew,
}

fn judge(pinned: &Pin, found: &Pin) -> Verdict {
    if found == pinned {
        Verdict::Same
    } else if found.key == pinned.key {
        Verdict::Raise
    } else if found.revision > pinned.revision && found.made == pinned.made && found.class == pinned.class {
        Verdict::RaisedForNothing
    } else {
        Verdict::PinAnew
    }
}

impl Pin {
    fn parse(line: &str) -> Self {
        let [step, stage, revision, class, key, made] =
            line.split_whitespace().collect::<Vec<_>>().try_into().expect("a pin has six parts");
        let class = if class == "-" { "" } else { class };
        let revision = revision.parse().unwrap();
        let [step, stage, class, key, made] = [step, stage, class, key, made].map(str::to_owned);
        Self { step, stage, revision, class, key, made }
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { step, stage, revision, class, key, made } = self;
        let class = if class.is_empty() { "-" } else { class };
        write!(f, "{step} {stage} {revision} {class} {key} {made}")
    }
}

/// Six views from a straight line, in decimals: a sine of the C library may differ in its last
/// digit elsewhere.
fn transforms() -> String {
    let frame = |i: u32| {
        format!(
            "{{ \"file_path\": \"images/{i}.png\", \"transform_matrix\": \
             [[1, 0, 0, 0.0{i}], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]] }}"
        )
    };
    let frames = (0..6).map(frame).collect::<Vec<_>>().join(", ");
    format!(
        "{{ \"w\": 64, \"h\": 48, \"fl_x\": 60, \"fl_y\": 60, \"cx\": 32, \"cy\": 24, \"frames\": [{frames}] }}"
    )
}

/// The pins of all scenes, built and released.
fn found() -> Vec<Pin> {
    let place = sound();
    place.write("transforms.json", transforms());
    place.write("spelled.yaml", SPELLED);
    assert!(GIVEN.contains("scene: given"), "the other scene is a captured one");
    place.write("moving.yaml", MOVING);
    place.write("rigged.yaml", RIGGED);
    place.write("flowing.yaml", FLOWING);
    place.ok("release -q --to out recipe.yaml spelled.yaml moving.yaml rigged.yaml flowing.yaml");
    let manifest = std::fs::read(place.path("out/manifest.json")).unwrap();
    let manifest: ReleaseManifest = serde_json::from_slice(&manifest).unwrap();
    let mut pins = Vec::new();
    for scene in manifest.scenes {
        for step in scene.steps {
            let made_of = step.made_of.expect("this program says what its keys are made of");
            pins.push(Pin {
                step: format!("{}/{}", scene.id, step.step),
                stage: step.stage,
                revision: made_of.revision,
                class: made_of.class.unwrap_or_default(),
                key: step.key.to_string(),
                made: content_digest(&step.outputs).to_string(),
            });
        }
    }
    pins
}

#[test]
fn each_stage_makes_its_pinned_bytes() {
    let (pins, found) = (pins(), found());
    let steps = |pins: &[Pin]| pins.iter().map(|pin| pin.step.clone()).collect::<Vec<_>>();
    let mut faults = Vec::new();
    if steps(&pins) != steps(&found) {
        faults.push("the pinned steps are not those of the scenes".to_owned());
    }
    for (pinned, found) in pins.iter().zip(&found).filter(|(pinned, found)| pinned.step == found.step) {
        let Pin { step, stage, revision, .. } = found;
        match judge(pinned, found) {
            Verdict::Same => {}
            Verdict::RaisedForNothing => {
                let (was, now) = (pinned.revision, revision);
                let line = format!(
                    "warning: the REVISION of `{stage}` went from {was} to {now} and {step} has the bytes it \
                     had; if that is meant, pin\n{found}\n"
                );
                // Written directly, past the captured output, so that it is seen although the test
                // passes.
                drop(std::io::stderr().write_all(line.as_bytes()));
            }
            Verdict::Raise => faults.push(format!(
                "{step} has other bytes under its old key: raise the REVISION of `{stage}` to {}, then pin \
                 what this test names; its content is now {}",
                revision + 1,
                found.made
            )),
            Verdict::PinAnew => faults.push(format!(
                "{step} has another key, and with it {}: pin it anew",
                if pinned.made == found.made { "the same bytes" } else { "other bytes" }
            )),
        }
    }
    let lines: Vec<String> = found.iter().map(|pin| format!("{pin}\n")).collect();
    assert!(faults.is_empty(), "{}\nthe pins would be\n{}", faults.join("\n"), lines.concat());
}

fn pins() -> Vec<Pin> {
    PINS.lines().map(Pin::parse).collect()
}

/// The pinned stages are those that the sources define, so a new stage is missed here at once.
#[test]
fn every_stage_is_pinned() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/build/src/stage");
    let mut stages = BTreeSet::new();
    let entries = walkdir::WalkDir::new(folder).into_iter().map(Result::unwrap);
    for file in entries.filter(|entry| entry.file_type().is_file()) {
        let text = std::fs::read_to_string(file.path()).unwrap();
        // A name in quotes, or that of an output: `OutputKind::Blur.name()`.
        let named =
            text.lines().filter_map(|line| line.split_once("const NAME: ")).filter_map(|(_, value)| {
                let of_output =
                    value.split_once("OutputKind::").and_then(|(_, rest)| rest.split_once(".name()"));
                match of_output {
                    Some((variant, _)) => Some(variant.to_lowercase()),
                    None => value.split('"').nth(1).map(str::to_owned),
                }
            });
        stages.extend(named);
    }
    assert!(stages.len() >= 6, "the sources are not read as they are written: {stages:?}");
    // The answers of other programs depend on the installed versions.
    for stage in ["foreign", "frames", "poses"] {
        stages.remove(stage);
    }
    let pinned: BTreeSet<String> = pins().into_iter().map(|pin| pin.stage).collect();
    assert_eq!(stages, pinned, "left: the stages there are; right: the stages that are pinned");
}

#[test]
fn the_verdict_follows_key_and_bytes() {
    let pinned = Pin::parse("s/base/events events 1 cpu/1 k m");
    let t = |line: &str, wanted: Verdict| assert_eq!(judge(&pinned, &Pin::parse(line)), wanted, "{line}");
    t("s/base/events events 1 cpu/1 k m", Verdict::Same);
    t("s/base/events events 1 cpu/1 k n", Verdict::Raise);
    t("s/base/events events 2 cpu/1 l m", Verdict::RaisedForNothing);
    t("s/base/events events 2 cpu/1 l n", Verdict::PinAnew);
    // An input or a parameter changed, or the class.
    t("s/base/events events 1 cpu/1 l n", Verdict::PinAnew);
    t("s/base/events events 1 cpu/1 l m", Verdict::PinAnew);
    t("s/base/events events 1 cpu/2 l m", Verdict::PinAnew);
}
