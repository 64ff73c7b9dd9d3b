//! The luminance of a PNG, 0 to 255, as a float32 array for NumPy:
//! `cargo run --release --example luminance -- picture.png luminance.npy`

use gs2e_image::{npy, png};
use std::{env, error::Error, fs::File, io::BufReader};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [picture, out] = &arguments[..] else {
        return Err("usage: luminance picture.png luminance.npy".into());
    };
    let luminance = png::read_luminance(BufReader::new(File::open(picture)?), None)?;
    npy::write_image(&luminance, File::create(out)?)?;
    Ok(())
}
