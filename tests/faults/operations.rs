//! The n-th file operation of the store fails, for every n and in every possible way, once and for
//! ever.
//!
//! The build must report failure, except after a single interruption, which is retried. Only steps
//! that are up to date may count as up to date. A build without faults then finishes with the right
//! products.

use crate::engine::{BuildOutcome, Engine};
use crate::failing::{Failing, FailureMode, Injection};
use crate::place::{Place, Products, same, within};
use crate::random::Random;
use crate::tally::Tally;
use crate::workers::spread;
use crate::{Size, scenes};
use gs2e_store::fs::{Fs, SystemFs};
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// The work of the build that meets the fault.
#[derive(Debug, Clone, Copy)]
enum Scenario {
    /// Everything, in a new store.
    Cold,
    /// One blob altered, one missing, and one new scene; another scene is known at a glance.
    Mending,
    /// Nothing.
    Idle,
    /// Nothing, and every byte is read.
    Verifying,
    /// Everything, in a new store and a new shared one.
    Sharing,
    /// Everything is copied from a shared store into a new one.
    Adopting,
}

impl Scenario {
    fn is_shared(self) -> bool {
        matches!(self, Self::Sharing | Self::Adopting)
    }
}

struct Fixture {
    place: Place,
    truth: Products,
    recipes: Vec<PathBuf>,
}

impl Fixture {
    fn new(scenes: u32) -> Self {
        let place = Place::in_memory();
        scenes::write(&place, scenes, u32::MAX);
        // Files younger than two seconds are read each time, so scenes would never be known at a
        // glance.
        std::thread::sleep(Duration::from_millis(2100));
        let truth = Engine::new(&place, Arc::new(SystemFs)).build(&place).products(&place).unwrap();
        let recipes = (0..scenes).map(|number| place.path(&format!("recipes/{number}.yaml"))).collect();
        Self { place, truth, recipes }
    }

    fn engine(&self, fs: Arc<dyn Fs>, scenario: Scenario) -> Engine {
        let shared = scenario.is_shared().then(|| self.place.path("shared"));
        Engine { recipes: self.recipes.clone(), fs, verify: matches!(scenario, Scenario::Verifying), shared }
    }

    /// Puts the store into the state in which the build begins.
    fn prepare(&self, scenario: Scenario) {
        let _ = fs::remove_dir_all(self.place.store());
        let _ = fs::remove_dir_all(self.place.path("shared"));
        let all = self.recipes.len();
        let known = match scenario {
            Scenario::Cold | Scenario::Sharing => return,
            Scenario::Mending => all - 1,
            Scenario::Idle | Scenario::Verifying | Scenario::Adopting => all,
        };
        let recipes = self.recipes[..known].to_vec();
        let engine = Engine { recipes, verify: false, ..self.engine(Arc::new(SystemFs), scenario) };
        let BuildOutcome::Done { outputs, .. } = engine.build(&self.place) else {
            panic!("a sound build failed")
        };
        if let Scenario::Adopting = scenario {
            fs::remove_dir_all(self.place.store()).unwrap();
        }
        if let Scenario::Mending = scenario {
            let path = |step: usize| {
                let digest = outputs[step].1[0].digest.to_string();
                self.place.store().join("cas").join(&digest[..2]).join(&digest)
            };
            fs::remove_file(path(0)).unwrap();
            fs::remove_file(path(2)).unwrap();
            fs::write(path(2), "altered").unwrap();
        }
    }
}

/// Maximum number of trials in the long run.
const LONG_TRIALS: usize = 2000;

pub(crate) fn run(size: Size) -> Tally {
    let scenes = size.of(3, 100);
    let mut tally = Tally::default();
    let mut all = all_injections(scenes, &mut tally);
    tally.count("ways to fail", all.len() as u64);
    if size.long {
        // Each trial builds hundreds of steps, so only every `stride`-th is tried, from an offset
        // that the seed chooses.
        let stride = all.len().div_ceil(LONG_TRIALS);
        all = all.into_iter().skip(Random::new(size.seed, 0).below(stride)).step_by(stride).collect();
    }
    tally.merge(spread(
        size,
        all.len(),
        || Fixture::new(scenes),
        |fixture, number, tally| {
            let (scenario, injection) = all[number];
            trial(fixture, scenario, injection, tally)
                .map_err(|why| format!("{scenario:?}, {injection:?}: {why}"))
        },
    ));
    for figure in ["panics", "success despite an error", "wrong states"] {
        tally.count(figure, 0);
    }
    tally
}

/// Every operation of a build without faults, with each way in which it can fail.
fn all_injections(scenes: u32, tally: &mut Tally) -> Vec<(Scenario, Injection)> {
    let fixture = Fixture::new(scenes);
    let mut all = Vec::new();
    for scenario in [
        Scenario::Cold,
        Scenario::Mending,
        Scenario::Idle,
        Scenario::Verifying,
        Scenario::Sharing,
        Scenario::Adopting,
    ] {
        fixture.prepare(scenario);
        let counting = Arc::new(Failing::never());
        let built = fixture.engine(counting.clone(), scenario).build(&fixture.place);
        tally.trial(
            undisturbed(&fixture, scenario, &built).map_err(|why| format!("{scenario:?}, no fault: {why}")),
        );
        for (at, kind) in counting.kinds().into_iter().enumerate() {
            for how in FailureMode::ALL.into_iter().filter(|how| how.can_meet(kind)) {
                all.extend([false, true].map(|forever| (scenario, Injection { at, how, forever })));
            }
        }
    }
    all
}

/// Checks a build without faults: right products, no unnecessary steps, and unchanged scenes known
/// at a glance.
fn undisturbed(fixture: &Fixture, scenario: Scenario, built: &BuildOutcome) -> Result<(), String> {
    same(&built.products(&fixture.place)?, &fixture.truth)?;
    let BuildOutcome::Done { made, settled, .. } = *built else { return Err(format!("{built:?}")) };
    let scenes = fixture.recipes.len();
    let wanted = match scenario {
        Scenario::Cold | Scenario::Sharing => (6 * scenes, 0),
        Scenario::Mending => (2 + 6, scenes - 2),
        Scenario::Idle => (0, scenes),
        Scenario::Verifying | Scenario::Adopting => (0, 0),
    };
    if (made, settled) == wanted {
        return Ok(());
    }
    Err(format!("{made} steps made and {settled} scenes known at a glance, wanted {wanted:?}"))
}

fn trial(
    fixture: &Fixture,
    scenario: Scenario,
    injection: Injection,
    tally: &mut Tally,
) -> Result<(), String> {
    fixture.prepare(scenario);
    let failing = Arc::new(Failing::new(injection));
    let built = fixture.engine(failing.clone(), scenario).build(&fixture.place);
    tally.count("errors injected", failing.hits());
    let is_retried = injection.how == FailureMode::Interrupted && !injection.forever;
    let verdict = match &built {
        BuildOutcome::Panicked => {
            tally.count("panics", 1);
            Err("a panic".to_owned())
        }
        BuildOutcome::Done { .. } if failing.hits() > 0 && !is_retried => {
            tally.count("success despite an error", 1);
            Err(format!("success although {} failed", failing.message()))
        }
        BuildOutcome::Failed(why) if is_retried => {
            Err(format!("an interruption is tried again, not text: {why}"))
        }
        BuildOutcome::Done { .. } | BuildOutcome::Failed(_) => Ok(()),
    };
    let state = after(fixture, &built, scenario).inspect_err(|_| tally.count("wrong states", 1));
    verdict.and(state)
}

/// Checks that steps that count as up to date are, and that the next build finishes.
fn after(fixture: &Fixture, built: &BuildOutcome, scenario: Scenario) -> Result<(), String> {
    let Fixture { place, truth, .. } = fixture;
    if let BuildOutcome::Done { .. } = built {
        same(&built.products(place)?, truth)?;
    }
    let meets = if scenario.is_shared() { scenario } else { Scenario::Idle };
    let sound = fixture.engine(Arc::new(SystemFs), meets);
    within(&sound.look(place)?, truth)?;
    let next = sound.build(place).products(place).and_then(|products| same(&products, truth));
    next.map_err(|why| format!("the next build: {why}"))?;
    if !scenario.is_shared() {
        return Ok(());
    }
    // Another machine, which has only the shared store.
    fs::remove_dir_all(place.store()).unwrap();
    match sound.build(place) {
        BuildOutcome::Done { made, .. } if made > 0 => {
            Err(format!("{made} steps are not in the shared store"))
        }
        other => other.products(place).and_then(|products| same(&products, truth)),
    }
}
