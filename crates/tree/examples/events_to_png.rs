//! The events of the first trajectory of a release in a window of time, as a picture:
//! `cargo run --release --example events_to_png -- RELEASE FIRST_US LAST_US events.png`

use gs2e_event::{EventSink as _, picture::WindowCounts};
use gs2e_image::png;
use gs2e_tree::Release;
use std::{env, error::Error, fs::File, io::BufWriter, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [folder, first_us, last_us, picture] = &arguments[..] else {
        return Err("usage: events_to_png RELEASE FIRST_US LAST_US events.png".into());
    };
    let window_us = [first_us.parse()?, last_us.parse()?];
    let release = Release::open(Path::new(folder))?;
    let scene = release.scene(release.scene_ids().next().ok_or("the release has no scene")?)?;
    let part = scene.trajectories.first().ok_or("the scene has no trajectory")?;
    let sensor = part.streams().next().ok_or("the trajectory has no events")?;
    let files = release.trajectory(&scene, part)?;
    let mut counts = WindowCounts::new(files.camera.size, window_us[0]..window_us[1] + 1)?;
    files.for_each_event(sensor, window_us, |event, _| {
        counts.append(&[*event])?;
        Ok::<(), Box<dyn Error>>(())
    })?;
    png::write_image(&counts.image(), BufWriter::new(File::create(picture)?))?;
    Ok(())
}
