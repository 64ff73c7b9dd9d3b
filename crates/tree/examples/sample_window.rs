//! The events of the first trajectory of a release in a window of time, one line per event:
//! `cargo run --release --example sample_window -- RELEASE FIRST_US LAST_US events.txt`

use gs2e_tree::Release;
use std::io::{BufWriter, Write as _};
use std::{env, error::Error, fs::File, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [folder, first_us, last_us, out] = &arguments[..] else {
        return Err("usage: sample_window RELEASE FIRST_US LAST_US events.txt".into());
    };
    let release = Release::open(Path::new(folder))?;
    let scene = release.scene(release.scene_ids().next().ok_or("the release has no scene")?)?;
    let part = scene.trajectories.first().ok_or("the scene has no trajectory")?;
    let sensor = part.streams().next().ok_or("the trajectory has no events")?;
    let mut out = BufWriter::new(File::create(out)?);
    let files = release.trajectory(&scene, part)?;
    files.for_each_event(sensor, [first_us.parse()?, last_us.parse()?], |event, t_us| {
        writeln!(out, "{t_us} {} {} {}", event.x, event.y, event.polarity as u8)?;
        Ok::<(), Box<dyn Error>>(())
    })?;
    out.flush()?;
    Ok(())
}
