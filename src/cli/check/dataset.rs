//! `gs2e check --events`: checks of a dataset that another program or a camera made.

use crate::cli::convert::events::{ASSUMED, TIME_UNITS};
use crate::cli::words::one_of;
use crate::cli::{Console, VerbError, input, output, simulate};
use gs2e_dataset::depth::EXTENSIONS;
use gs2e_dataset::layout::{DatasetLayout, DatasetPaths};
use gs2e_dataset::npy_events::NpyEvents;
use gs2e_dataset::views::{DatasetView, DatasetViews, ViewMeasures};
use gs2e_dataset::{DatasetFrames, DatasetReport, EventDataset, camera, check_dataset, text};
use gs2e_event::evt::EvtVersion;
use gs2e_event::file::{EventFormat, OpenEventFile, ReadHints};
use gs2e_event::picture::WindowCounts;
use gs2e_event::text::TextTimeUnit;
use gs2e_event::{EventFileError, EventSink as _, EventSource, file};
use gs2e_files as files;
use gs2e_image::{Image, Size};
use gs2e_release::{CaptionedPicture, compose_dataset_page};
use gs2e_sensor::frames::folder::{FolderFrames, FolderListing, image_size, list_named};
use gs2e_sensor::frames::{FrameSequence as _, npy};
use gs2e_trajectory::Trajectory;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Options of `check --events`.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct DatasetArgs {
    /// Check an event file that another program or a camera made; with --as, the folder of a sequence
    #[arg(long, value_name = "FILE or DIR", conflicts_with_all = ["recipes", "tree", "scenes"])]
    pub(super) events: Option<PathBuf>,
    /// Layout of the sequence: where its events, frames, stamps and poses lie
    #[arg(long = "as", value_name = "LAYOUT", requires = "events",
          value_parser = clap::builder::PossibleValuesParser::new(DatasetLayout::NAMES))]
    layout: Option<String>,
    /// Frames of the same pixels: a folder of images, or a .npy
    #[arg(long, value_name = "DIR or FILE", requires = "events")]
    frames: Option<PathBuf>,
    /// Stamps of the frames: a text with one per line, or a .npy of int64 microseconds
    #[arg(long, value_name = "FILE", requires = "events")]
    stamps: Option<PathBuf>,
    /// Camera poses, one line each: time x y z qx qy qz qw
    #[arg(long, value_name = "FILE", requires = "events")]
    poses: Option<PathBuf>,
    /// Intrinsics: a transforms.json, a cameras.txt of COLMAP, or a text with `fx fy cx cy`
    #[arg(long, value_name = "FILE", requires = "events")]
    camera: Option<PathBuf>,
    /// Depth images of the frames: a folder of .npy or .npz, or of PNGs of 16 bits with --depth-scale
    #[arg(long, value_name = "DIR", requires = "events")]
    depth: Option<PathBuf>,
    /// Steps of depth PNGs per unit of the poses: 1000 for millimetres and poses in metres
    #[arg(long, value_name = "N", requires = "events", value_parser = parse_steps)]
    depth_scale: Option<f64>,
    /// Unit of the times of a .txt or .csv [default: whole numbers are microseconds; s with --as tum]
    #[arg(long, requires = "events", value_parser = one_of(&TIME_UNITS), value_name = "UNIT")]
    time_unit: Option<TextTimeUnit>,
    /// Size of the sensor, for files that do not state it [default: that of the frames]
    #[arg(long, value_name = "WIDTHxHEIGHT", requires = "events", value_parser = input::parse_size)]
    size: Option<Size>,
    /// Write a page with pictures, plots and verdicts
    #[arg(long, value_name = "FILE", requires = "events")]
    report: Option<PathBuf>,
}

/// Length of the events in the page's picture, us.
const PICTURE_US: i64 = 10_000;

impl DatasetArgs {
    /// Runs the checks, and writes the page if one is asked for. `place` is what `--events` names.
    pub(super) fn run(&self, place: &Path, console: &Console) -> Result<DatasetReport, VerbError> {
        for (what, path) in [("stamps", &self.stamps), ("poses", &self.poses), ("camera", &self.camera)] {
            path.iter().try_for_each(|path| input::require_file(what, path))?;
        }
        let paths = self.paths(place);
        if !paths.events.is_dir() {
            input::require_file("events", &paths.events)?;
        }
        output::screen_outputs(self.report.as_deref(), [paths.events.as_path()], console.json)?;
        // Before the events: an event file that does not state a size takes that of the frames.
        let frames = self.read_frames(&paths)?;
        let hint = self.size.or(frames.as_ref().map(|frames| frames.size));
        let poses = paths.poses.as_deref().map(read_poses).transpose()?;
        let events = EventPlace { path: &paths.events, hint, unit: self.unit() };
        let unreadable = |e: EventFileError| input::wrong_content(&paths.events, e);
        let opened = events.open().map_err(unreadable)?;
        if opened.assumes_us {
            console.note(ASSUMED);
        }
        let size = opened.size;
        let name =
            place.file_name().map_or_else(|| ".".to_owned(), |name| name.to_string_lossy().into_owned());
        // A function and not a source: the checks and the pictures each read the whole stream from its start.
        let open = || events.open().map(|opened| opened.source);
        let views = self.measure_views(&paths, frames.as_ref(), poses.as_ref())?;
        let dataset = EventDataset {
            name: &name,
            size,
            events: &open,
            frames: frames.as_ref(),
            poses: poses.as_ref(),
            views: views.as_ref(),
        };
        let report = check_dataset(&dataset).map_err(unreadable)?;
        if let Some(to) = &self.report {
            let pictures = pictures(&dataset, &report).map_err(unreadable)?;
            let page = compose_dataset_page(&name, &report, &pictures);
            output::write_output(to, |out| out.write_all(page.as_bytes()))?;
        }
        Ok(report)
    }

    fn layout(&self) -> Option<DatasetLayout> {
        self.layout.as_deref().and_then(DatasetLayout::from_name)
    }

    /// The unit of the times of a text, if the user or the layout states it.
    fn unit(&self) -> Option<TextTimeUnit> {
        let of_layout = (self.layout() == Some(DatasetLayout::Tum)).then_some(TextTimeUnit::Second);
        self.time_unit.or(of_layout)
    }

    /// The files: those of the layout, replaced by those that the user names.
    fn paths(&self, place: &Path) -> DatasetPaths {
        let alone = || DatasetPaths { events: place.to_owned(), ..DatasetPaths::default() };
        let found = self.layout().map_or_else(alone, |layout| layout.paths(place));
        DatasetPaths {
            events: found.events,
            frames: self.frames.clone().or(found.frames),
            stamps: self.stamps.clone().or(found.stamps),
            poses: self.poses.clone().or(found.poses),
            camera: self.camera.clone().or(found.camera),
            depth: self.depth.clone().or(found.depth),
        }
    }

    /// Compares the pictures by poses, depth and camera. `None` if one of them is absent.
    fn measure_views(
        &self,
        paths: &DatasetPaths,
        frames: Option<&DatasetFrames>,
        poses: Option<&Trajectory>,
    ) -> Result<Option<ViewMeasures>, VerbError> {
        let (Some(depth), Some(camera), Some(frames), Some(poses)) =
            (&paths.depth, &paths.camera, frames, poses)
        else {
            // Depth that only the layout names is no request, so it may be left out without an error.
            return if self.depth.is_some() { Err(incomplete_views()) } else { Ok(None) };
        };
        let camera = camera::parse_camera(&read_text(camera)?, frames.size)
            .map_err(|because| input::wrong_content(camera, because))?;
        let images = match &paths.frames {
            Some(folder) if folder.is_dir() => {
                FolderListing::list_folder(folder).map_err(|e| unreadable_frames(&e))?.images
            }
            _ => Vec::new(),
        };
        let views = pair_views(depth, &images, &frames.stamps_us)?;
        let measured = DatasetViews::new(camera, views, poses, self.depth_scale).measure();
        measured.map(Some).map_err(|because| VerbError::failed("input-unreadable", because))
    }

    /// Reads the frames that the checks need.
    fn read_frames(&self, paths: &DatasetPaths) -> Result<Option<DatasetFrames>, VerbError> {
        let Some(place) = &paths.frames else { return Ok(None) };
        if !place.is_dir() {
            return read_stack(place, paths.stamps.as_deref()).map(Some);
        }
        let listing = FolderListing::list_folder(place).map_err(|e| input::unreadable_file("frames", &e))?;
        let stamps_us = match (listing.stamps_us, &paths.stamps) {
            (Some(own), None) => own,
            (_, Some(file)) => read_stamps(file)?,
            (None, None) => return Err(no_stamps(place)),
        };
        let found = listing.images.len();
        // A wrong number of stamps is refused and not cut, because nothing says which frame lacks its stamp.
        if found != stamps_us.len() {
            let (place, stamps) = (place.display(), stamps_us.len());
            let what = format!("{place} has {found} images, and there are {stamps} stamps");
            return Err(VerbError::usage("stamps", what));
        }
        let size = image_size(&listing.images[0]).map_err(|e| unreadable_frames(&e))?;
        let mut kept = DatasetFrames::new(size, stamps_us);
        let needed = kept.needed();
        let of = |index: &usize| (listing.images[*index].clone(), kept.stamps_us[*index]);
        let (images, stamps): (Vec<PathBuf>, Vec<i64>) = needed.iter().map(of).unzip();
        let mut frames = FolderFrames::new(images, &stamps).map_err(|e| unreadable_frames(&e))?;
        for index in needed {
            // The sequence has as many frames as it was given images.
            let Some(frame) = frames.next().map_err(|e| unreadable_frames(&e))? else { break };
            kept.keep(index, frame.luminance);
        }
        Ok(Some(kept))
    }
}

fn parse_steps(text: &str) -> Result<f64, String> {
    let steps = text.parse().ok().filter(|steps: &f64| *steps > 0.0 && steps.is_finite());
    steps.ok_or_else(|| format!("found {text}, wanted a number above 0"))
}

fn incomplete_views() -> VerbError {
    let what = "--depth is compared with frames by poses and camera, and one of these is absent";
    VerbError::usage("depth", what).help("pass --frames, --stamps, --poses and --camera too")
}

/// The depth image of each frame: by the stem of its name, or else by its place in the order of names.
fn pair_views(depth: &Path, images: &[PathBuf], stamps_us: &[i64]) -> Result<Vec<DatasetView>, VerbError> {
    let depths = list_named(depth, &EXTENSIONS).map_err(|e| input::unreadable_file("depth", &e))?;
    let by_stem: BTreeMap<&OsStr, &PathBuf> =
        depths.iter().filter_map(|path| Some((path.file_stem()?, path))).collect();
    let of_stem = |image: &PathBuf| by_stem.get(image.file_stem()?).map(|path| (*path).clone());
    let named: Vec<Option<PathBuf>> = images.iter().map(of_stem).collect();
    let found = named.iter().flatten().count();
    // Names count only if all of them fit. A mix of names and places could give a frame the depth of another
    // one.
    let of_frames = if found == depths.len() && found > 0 {
        named
    } else if depths.len() == stamps_us.len() {
        depths.into_iter().map(Some).collect()
    } else {
        let (place, count, frames) = (depth.display(), depths.len(), stamps_us.len());
        let what = format!(
            "{place} has {count} depth images for {frames} frames, and {found} have the name of a frame"
        );
        return Err(VerbError::usage("depth", what)
            .help("name each like its frame, or give one per frame in the order of names"));
    };
    let view = |(number, depth): (usize, Option<PathBuf>)| DatasetView {
        t_us: stamps_us[number],
        frame: images.get(number).cloned(),
        depth,
    };
    Ok(of_frames.into_iter().enumerate().map(view).collect())
}

/// The frames of a `.npy`; every frame is read, and those that are needed stay.
fn read_stack(place: &Path, stamps: Option<&Path>) -> Result<DatasetFrames, VerbError> {
    let stamps_us = stamps.map_or_else(|| Err(no_stamps(place)), read_stamps)?;
    let mut frames = simulate::open_stack(place, &stamps_us)?;
    let mut kept = DatasetFrames::new(frames.size(), stamps_us);
    let needed = kept.needed();
    while let Some(frame) = frames.next().map_err(|e| unreadable_frames(&e))? {
        if needed.binary_search(&frame.index).is_ok() {
            kept.keep(frame.index, frame.luminance);
        }
    }
    Ok(kept)
}

fn unreadable_frames(error: &dyn std::error::Error) -> VerbError {
    input::unreadable_file("frames", error)
}

fn no_stamps(place: &Path) -> VerbError {
    VerbError::usage("stamps", format!("no timestamps for {}", place.display()))
        .help("pass --stamps with a text of one stamp per line")
}

fn read_stamps(path: &Path) -> Result<Vec<i64>, VerbError> {
    if path.extension().is_some_and(|extension| extension == "npy") {
        return npy::read_stamps(path).map_err(|e| input::unreadable_file("stamps", &e));
    }
    text::parse_stamps(&read_text(path)?).map_err(|e| input::wrong_content(path, e))
}

fn read_poses(path: &Path) -> Result<Trajectory, VerbError> {
    text::parse_poses(&read_text(path)?).map_err(|e| input::wrong_content(path, e))
}

fn read_text(path: &Path) -> Result<String, VerbError> {
    files::read_text(path, files::MAX_DOCUMENT).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound => input::missing_file("file", path),
        _ => input::wrong_content(path, e),
    })
}

/// Events on the clock of the dataset.
struct EventPlace<'a> {
    path: &'a Path,
    hint: Option<Size>,
    unit: Option<TextTimeUnit>,
}

/// Events that are open for reading.
struct OpenedEvents {
    source: Box<dyn EventSource>,
    size: Size,
    assumes_us: bool,
}

impl EventPlace<'_> {
    fn open(&self) -> Result<OpenedEvents, EventFileError> {
        if self.path.is_dir() {
            let because = "the sensor's size is not known: give --size WIDTHxHEIGHT, or frames";
            let size = self.hint.ok_or_else(|| EventFileError::Container(because.to_owned()))?;
            let source = Box::new(NpyEvents::open(self.path)?);
            return Ok(OpenedEvents { source, size, assumes_us: false });
        }
        let unknown = "its name has no known extension: .h5, .npz, .raw, .aedat4, .txt, .csv, .mcap";
        let format = EventFormat::for_path(self.path, EvtVersion::Evt2)
            .ok_or_else(|| EventFileError::Container(unknown.to_owned()))?;
        let OpenEventFile { source, header, assumes_us, .. } = self.open_known(format)?;
        Ok(OpenedEvents { source, size: header.size, assumes_us })
    }

    /// Opens a file of any format. The size that it states wins over the hint: frames of another size are
    /// reported by the check.
    fn open_known(&self, format: EventFormat) -> Result<OpenEventFile, EventFileError> {
        let open = |size| file::open(self.path, format, ReadHints { size, unit: self.unit, topic: None });
        match self.hint {
            Some(_) => open(None).or_else(|_| open(self.hint)),
            None => open(None),
        }
    }
}

/// The frame nearest to the middle of the stream and the events around it, for the page.
fn pictures(
    dataset: &EventDataset<'_>,
    report: &DatasetReport,
) -> Result<Vec<CaptionedPicture>, EventFileError> {
    let Some((first, last)) = report.survey.span else { return Ok(Vec::new()) };
    // The span is in nanoseconds and the centre in microseconds: 2000 is the half and the unit together.
    let centre = first.floor_micros() + (last.0 - first.0) / 2000;
    let near = dataset.frames.and_then(|frames| frames.middle.as_ref());
    let middle = near.map_or(centre, |(stamp, _)| *stamp);
    let window = middle - PICTURE_US / 2..middle + PICTURE_US / 2;
    let too_large = |_| EventFileError::Container(format!("a sensor of {}", dataset.size));
    let mut counts = WindowCounts::new(dataset.size, window).map_err(too_large)?;
    let (mut source, mut chunk) = ((dataset.events)()?, Vec::new());
    while source.next_chunk(&mut chunk)? {
        counts.append(&chunk)?;
    }
    let mut pictures: Vec<CaptionedPicture> = Vec::new();
    pictures.extend(near.map(|(stamp, image)| CaptionedPicture {
        image: to_rgb(image),
        caption: format!("Frame at {:.3} s", (stamp - first.floor_micros()) as f64 * 1e-6),
    }));
    pictures.push(CaptionedPicture {
        image: counts.image(),
        caption: "Events of 10 ms around it: red brighter, blue darker".to_owned(),
    });
    Ok(pictures)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a grey, clamped")]
fn to_rgb(grey: &Image<f32>) -> Image<[u8; 3]> {
    let byte = |v: &f32| [v.clamp(0.0, 255.0).round() as u8; 3];
    Image::from_vec(grey.size(), grey.pixels().iter().map(byte).collect())
}
