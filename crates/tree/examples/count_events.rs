//! The number of events of each stream of a release:
//! `cargo run --release --example count_events -- RELEASE counts.txt`

use gs2e_tree::Release;
use std::{env, error::Error, fs, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [folder, counts] = &arguments[..] else {
        return Err("usage: count_events RELEASE counts.txt".into());
    };
    let release = Release::open(Path::new(folder))?;
    let mut lines = String::new();
    for id in release.scene_ids() {
        let scene = release.scene(id)?;
        for part in &scene.trajectories {
            let files = release.trajectory(&scene, part)?;
            for sensor in part.streams() {
                let count = files.events(sensor)?.count();
                lines += &format!("{id} {} {} {count}\n", part.name, sensor.unwrap_or("-"));
            }
        }
    }
    fs::write(counts, lines)?;
    Ok(())
}
