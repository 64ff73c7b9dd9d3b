//! Equal recipes give equal trees: with one thread and with all, in any order, in another folder,
//! at another time.
//! folder, at another time.

use crate::place::{Place, tree};
use crate::random::Random;
use crate::tally::Tally;
use crate::{Size, is_over, scenes};
use gs2e_store::Digest;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;

const SCENES: u32 = 8;

type Tree = BTreeMap<PathBuf, Digest>;

pub(crate) fn run(size: Size) -> Tally {
    let mut tally = Tally::default();
    let rounds = size.of(5, 50);
    let truth = released("-j 1", None, &(0..SCENES).collect::<Vec<_>>()).unwrap();
    let clock = has_fake_clock();
    if !clock {
        tally.notes.push("not run: another clock (there is no `faketime`)".to_owned());
    }
    let end = size.end();
    for round in (0..rounds).take_while(|_| !is_over(end)) {
        let mut random = Random::new(size.seed, round);
        let mut trial = |name: &str, tree: Result<Tree, String>| {
            let ended = tree.and_then(|tree| match tree == truth {
                true => Ok(()),
                false => Err("another tree".to_owned()),
            });
            tally.trial(ended.map_err(|why| format!("round {round}, {name}: {why}")));
        };
        let in_order: Vec<u32> = (0..SCENES).collect();
        trial("all cores", released("", None, &in_order));
        let threads = 2 + random.below(7);
        trial("threads", released(&format!("-j {threads}"), None, &in_order));
        trial("shuffled", released("-j 2", None, &shuffled(&mut random)));
        let folder = format!("deep/{}/er", random.next());
        trial("another folder", released("-j 2", Some(&folder), &in_order));
        if clock {
            trial("another clock", at_another_time(&mut random));
        }
    }
    tally
}

fn shuffled(random: &mut Random) -> Vec<u32> {
    let mut order: Vec<u32> = (0..SCENES).collect();
    for i in (1..order.len()).rev() {
        order.swap(i, random.below(i + 1));
    }
    order
}

/// The release of the scenes, with recipes written and named in this order. The store is in
/// `folder`, if one is given.
fn released(args: &str, folder: Option<&str>, order: &[u32]) -> Result<Tree, String> {
    let place = Place::new();
    // Names whose order in the folder is that of the list, independent of the scenes' names.
    for (rank, number) in order.iter().enumerate() {
        scenes::sources(&place, *number);
        let outputs: &[&str] = if number % 3 == 0 { &["events", "sharp"] } else { &[] };
        let recipe = scenes::recipe(&format!("s{number}"), *number, outputs);
        place.write(&format!("recipes/{rank}.yaml"), recipe.to_string());
    }
    let store = folder.map_or(".gs2e".to_owned(), |folder| format!("{folder}/store"));
    if let Some(folder) = folder {
        std::fs::create_dir_all(place.path(folder)).unwrap();
    }
    let out = folder.map_or("out".to_owned(), |folder| format!("{folder}/out"));
    place.ok(&format!("release {args} --store {store} --to {out}"))?;
    Ok(tree(&place.path(&out)))
}

fn has_fake_clock() -> bool {
    Command::new("faketime").arg("--version").output().is_ok_and(|output| output.status.success())
}

/// The release of a build whose clock is up to 5000 days slow.
fn at_another_time(random: &mut Random) -> Result<Tree, String> {
    let place = Place::new();
    scenes::write(&place, SCENES, 3);
    for number in 0..SCENES {
        let outputs: &[&str] = if number % 3 == 0 { &["events", "sharp"] } else { &[] };
        let recipe = scenes::recipe(&format!("s{number}"), number, outputs);
        place.write(&format!("recipes/{number}.yaml"), recipe.to_string());
    }
    let mut command = Command::new("faketime");
    command.args(["-f", &format!("-{}d", 1 + random.below(5000)), env!("CARGO_BIN_EXE_gs2e")]);
    let output = command.args(["release", "--to", "out"]).current_dir(place.root()).output();
    let output = output.map_err(|e| e.to_string())?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    Ok(tree(&place.path("out")))
}
