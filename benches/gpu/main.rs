//! The GPU renderer on this machine: frames a second, time and counted work by stage, likeness to the
//! CPU, and memory over many scenes: `cargo xtask bench gpu`, which adds the peer and a whole build.
//!
//! No result here passes or fails, except that a frame must render.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "the figures are printed")]

mod model;
mod parity;
mod rates;
mod series;
mod views;

use gs2e_gpu::{DeviceChoice, FeatureSet, GpuDevice, list_gpus};
use gs2e_image::Size;
use std::path::PathBuf;
use std::process::ExitCode;

const USAGE: &str = "usage: cargo xtask bench gpu [--quick] [--gpu NAME] [--gpu-without FEATURES] [--scene FILE --views FILE] \
                     [--size WxH] [--frames N] [--scenes N]";

struct Options {
    choice: DeviceChoice,
    without: FeatureSet,
    /// A scene, and a `transforms.json` with its views; the still life if absent.
    scene: Option<[PathBuf; 2]>,
    size: Size,
    /// Frames a rate is taken over.
    frames: usize,
    /// Scenes in a row.
    scenes: u32,
    /// Gaussians of the still life.
    gaussians: u32,
    /// Folder for the scene and the views as other programs read them.
    export: Option<PathBuf>,
}

fn main() -> ExitCode {
    let options = match parse(std::env::args().skip(1)) {
        Ok(options) => options,
        Err(why) => {
            eprintln!("error: {why}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    match measure(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
    }
}

fn measure(options: &Options) -> Result<(), String> {
    for (index, gpu) in list_gpus(options.without).map_err(|e| e.to_string())?.iter().enumerate() {
        let [least, most] = gpu.subgroups;
        println!(
            "GPU {index}: {}, {}, driver {}, features {}, subgroups of {least} to {most}",
            gpu.name, gpu.kind, gpu.driver, gpu.features
        );
    }
    let device = GpuDevice::open_without(&options.choice, options.without).map_err(|e| e.to_string())?;
    println!("measured: {}, with {}\n", device.name(), device.features());
    let bench = views::BenchViews::new(options)?;
    if let Some(folder) = &options.export {
        bench.export(folder)?;
    }
    rates::measure(&device, &bench, options.frames)?;
    parity::measure(&device, &bench)?;
    series::measure(&device, options.scenes)
}

fn parse(mut args: impl Iterator<Item = String>) -> Result<Options, String> {
    let mut options = Options {
        choice: DeviceChoice::Any,
        without: FeatureSet::NONE,
        scene: None,
        size: Size { width: 1280, height: 720 },
        frames: 120,
        scenes: 200,
        gaussians: 20_000,
        export: None,
    };
    let (mut scene, mut views) = (None, None);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or_else(|| format!("found nothing after {arg}"));
        match arg.as_str() {
            // cargo passes this to every benchmark.
            "--bench" => {}
            "--quick" => {
                options.size = Size { width: 160, height: 90 };
                (options.frames, options.scenes, options.gaussians) = (6, 8, 2000);
            }
            "--gpu" => options.choice = value()?.parse().unwrap_or_default(),
            "--gpu-without" => options.without = value()?.parse()?,
            "--scene" => scene = Some(PathBuf::from(value()?)),
            "--views" => views = Some(PathBuf::from(value()?)),
            "--export" => options.export = Some(PathBuf::from(value()?)),
            "--size" => options.size = size(&value()?)?,
            "--frames" => options.frames = count(&value()?)?,
            "--scenes" => options.scenes = count(&value()?)?,
            _ => return Err(format!("found `{arg}`, wanted an option")),
        }
    }
    options.scene = match (scene, views) {
        (Some(scene), Some(views)) => Some([scene, views]),
        (None, None) => None,
        _ => return Err("--scene and --views go together".to_owned()),
    };
    Ok(options)
}

fn count<T: std::str::FromStr + PartialOrd + From<u8>>(text: &str) -> Result<T, String> {
    let found = text.parse().ok().filter(|n| *n > T::from(0));
    found.ok_or_else(|| format!("found {text}, wanted a count above 0"))
}

fn size(text: &str) -> Result<Size, String> {
    let (width, height) = text.split_once('x').ok_or_else(|| format!("found {text}, wanted WxH"))?;
    Ok(Size { width: count(width)?, height: count(height)? })
}
