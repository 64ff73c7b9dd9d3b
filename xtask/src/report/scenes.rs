//! The scenes of the page, and their recipes.

use crate::command::root;
use std::path::PathBuf;

/// A scene and how it is captured.
pub(super) struct Scene {
    pub(super) name: &'static str,
    /// Description and author of the scene.
    pub(super) words: &'static str,
    /// The file of its Gaussians and the file of its views; `None` for a scene that the program
    /// makes.
    files: Option<[&'static str; 2]>,
    /// Size of its pictures, px.
    size: [u32; 2],
    /// Number of bursts in which the whole path takes about as long as at the base's speed.
    bursts: u16,
}

pub(super) const SCENES: [Scene; 3] = [
    Scene {
        name: "still-life",
        words: "The scene that the program makes itself: 20,000 surfels, harmonics of degree 2.",
        files: None,
        size: [640, 360],
        bursts: 36,
    },
    Scene {
        name: "plant",
        words: "`plant.splat`, a houseplant captured with a phone: 113,648 Gaussians without harmonics; by Marcel Padilla, CC-BY-4.0.",
        files: Some(["plant.splat", "plant.transforms.json"]),
        size: [360, 640],
        bursts: 48,
    },
    Scene {
        name: "playbot",
        words: "`playbot.spz`, PLAYBOT at level 0: 500,000 Gaussians, harmonics of degree 2; by Stephane Agullo, CC-BY-4.0.",
        files: Some(["playbot.spz", "playbot.transforms.json"]),
        size: [640, 360],
        bursts: 48,
    },
];

/// Speed of the picture at the full size, px/s.
const BASE: u32 = 300;
const FAST: u32 = 1200;
const FASTER: u32 = 4800;
/// Multiples of the speed, and duration of each, s.
const BURSTS: [&str; 4] = ["0.1", "1.9", "0.4", "1.6"];
const BURST_S: f64 = 0.02;
/// Factor by which pictures are smaller in a quick trial.
const SMALLER: u32 = 4;

impl Scene {
    pub(super) fn is_there(&self) -> bool {
        self.files.is_none_or(|files| files.iter().all(|name| shared(name).is_file()))
    }

    /// Returns true if the program makes the scene itself.
    pub(super) fn is_ours(&self) -> bool {
        self.files.is_none()
    }

    /// The recipe of its trajectories `base`, `fast` and `bursty`, without outputs.
    pub(super) fn paths(&self, quick: bool) -> String {
        let smaller = if quick { SMALLER } else { 1 };
        let bursts: Vec<&str> = BURSTS.into_iter().cycle().take(self.bursts.into()).collect();
        let bursty = format!(
            "name: bursty, refine: {{ duration: {:.2} }}, speed: {{ list: {{ multipliers: [{}], blend: 0.25 }} }}",
            f64::from(self.bursts) * BURST_S,
            bursts.join(", "),
        );
        let trajectories = [at("base", BASE / smaller), at("fast", FAST / smaller), bursty];
        self.recipe(smaller, &trajectories, "sampling: { rate: 2400 }\noutputs: []")
    }

    /// The trajectories of the comparison of a tolerance with a rate.
    pub(super) fn compared(&self) -> &'static [&'static str] {
        // The shortest paths are where the frames that choose a sampling weigh most.
        if self.name == "playbot" { &["base", "fast"] } else { &["base", "fast", "faster"] }
    }

    /// The recipe of one of these trajectories with this sampling and these outputs.
    pub(super) fn sampled(&self, quick: bool, trajectory: &str, sampling: &str, outputs: &str) -> String {
        let smaller = if quick { SMALLER } else { 1 };
        let made = format!("{sampling}\noutputs: [{outputs}]");
        let px_s = match trajectory {
            "faster" => FASTER,
            "fast" => FAST,
            _ => BASE,
        };
        self.recipe(smaller, &[at(trajectory, px_s / smaller)], &made)
    }

    fn recipe(&self, smaller: u32, trajectories: &[String], made: &str) -> String {
        let [width, height] = self.size.map(|side| side / smaller);
        let source = match self.files {
            None => {
                "procedural: { kind: still-life, gaussians: 20000, views: 30, arc: 80, seed: 1 }".to_owned()
            }
            Some([_, views]) => format!("nerfstudio: {{ path: {:?} }}", shared(views)),
        };
        let given =
            self.files.map(|[scene, _]| format!("reconstruct: {{ given: {{ path: {:?} }} }}", shared(scene)));
        let licence = if self.files.is_some() { "CC-BY-4.0" } else { "CC0-1.0" };
        let trajectories: String = trajectories.iter().map(|one| format!("\n  - {{ {one} }}")).collect();
        format!(
            "version: 1\n\
             scene: {}\n\
             source: {{ {source} }}\n\
             {}\n\
             camera: {{ width: {width}, height: {height} }}\n\
             trajectories:{trajectories}\n\
             {made}\n\
             licence: {{ expression: {licence}, holder: their authors }}\n",
            self.name,
            given.unwrap_or_default(),
        )
    }
}

/// A trajectory of even speed.
fn at(name: &str, px_s: u32) -> String {
    format!("name: {name}, refine: {{}}, speed: {{ flow: {{ px_s: {px_s} }} }}")
}

/// A file of the optional test data.
fn shared(name: &str) -> PathBuf {
    root().join("../shared/data/scenes").join(name)
}
