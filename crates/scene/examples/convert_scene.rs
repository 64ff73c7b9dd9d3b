//! A scene in any format (`.ply`, `.splat`, `.spz`, `.sog`) as a file in the format of its extension:
//! `cargo run --release --example convert_scene -- scene.ply scene.spz`

use gs2e_scene::form::SceneFormat;
use std::{env, error::Error, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [from, to] = &arguments[..] else {
        return Err("usage: convert_scene FROM TO".into());
    };
    let scene = gs2e_scene::read_any(Path::new(from))?;
    let form = SceneFormat::for_path(Path::new(to)).ok_or("no format has this extension")?;
    let (bytes, _losses) = form.write(&scene)?;
    std::fs::write(to, bytes)?;
    Ok(())
}
