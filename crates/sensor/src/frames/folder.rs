//! Frames from image files: a folder of images in natural order, or a DVS-Voltmeter sequence
//! (GitHub Lynn0306/DVS-Voltmeter), a folder with an `info.txt` that has one line `path timestamp`
//! per frame, in integer microseconds.
//!
//! A path in `info.txt` is relative to its folder, or else to the folder above, as in the published
//! sample. Images are PNG with 8 or 16 bits, grey or RGB, or JPEG. The published reader rounds
//! colours to 8-bit grey. Here, luminance is not rounded, and colours are kept if they are
//! requested.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::{Image, Size, png};
//! # use gs2e_sensor::frames::FrameSequence;
//! use gs2e_sensor::frames::folder::{FolderFrames, FolderListing};
//!
//! let folder = tempfile::tempdir()?;
//! for grey in [10, 2] {
//!     let file = std::fs::File::create(folder.path().join(format!("{grey}.png")))?;
//!     png::write_image(&Image::filled(Size { width: 2, height: 1 }, grey), file)?;
//! }
//! // Natural order: 2 comes before 10.
//! let images = FolderListing::list_folder(folder.path())?.images;
//! let mut frames = FolderFrames::new(images, &[0, 1000])?;
//! let first = frames.next()?.ok_or("there is no frame")?;
//! assert_eq!(first.luminance.pixels(), [2.0, 2.0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::stamps::{StampError, relative_stamps};
use super::{DenseFrame, FrameError, FrameSequence};
use gs2e_files as files;
use gs2e_files::{PathError, natural};
use gs2e_image::{GreyImage, Image, Size, jpeg, png};
use gs2e_num::units::Timestamp;
use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Maximum number of frames of a sequence of image files. Each takes some hundred bytes for its
/// path.
pub const MAX_FRAMES: usize = 1 << 19;

/// The file with a sequence's paths and stamps.
pub const INFO: &str = "info.txt";

/// The reason why a folder is not a sequence of frames.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// A file or folder cannot be read.
    #[error(transparent)]
    Io(#[from] PathError),
    /// A line of `info.txt` is wrong.
    #[error("{}:{line}: {because}", path.display())]
    Line {
        /// The `info.txt`.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// The text found and the text wanted.
        because: String,
    },
    /// An image, or all of them, cannot be used.
    #[error("{}: {because}", path.display())]
    Content {
        /// Its path.
        path: PathBuf,
        /// The value found and the value wanted.
        because: String,
    },
    /// The stamps are not valid.
    #[error(transparent)]
    Stamps(#[from] StampError),
}

/// The image files and stamps of a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FolderListing {
    /// The images, in the order of their frames; at least one.
    pub images: Vec<PathBuf>,
    /// Their stamps in microseconds, if there is an `info.txt`.
    pub stamps_us: Option<Vec<i64>>,
}

impl FolderListing {
    /// Lists a folder: by its `info.txt`, or else by the names of its images.
    ///
    /// # Errors
    /// The folder cannot be read or has no image, or a line of `info.txt` is wrong or names a
    /// missing file.
    pub fn list_folder(folder: &Path) -> Result<Self, FolderError> {
        let info = folder.join(INFO);
        if files::is_there(&info) { of_info(folder, &info) } else { of_names(folder) }
    }
}

fn of_info(folder: &Path, path: &Path) -> Result<FolderListing, FolderError> {
    let text = files::read_text(path, files::MAX_DOCUMENT).map_err(|source| PathError::new(path, source))?;
    let (mut images, mut stamps_us, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
    let refusal = |line, because| FolderError::Line { path: path.to_owned(), line, because };
    for (number, line) in (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty()) {
        if images.len() == MAX_FRAMES {
            return Err(refusal(number, format!("more than {MAX_FRAMES} frames, the limit for a sequence")));
        }
        let (image, stamp) = parse_line(line).map_err(|because| refusal(number, because))?;
        let image =
            find_image(folder, image).ok_or_else(|| refusal(number, format!("{image} is not there")))?;
        images.push(image);
        stamps_us.push(stamp);
        numbers.push(number);
    }
    if images.is_empty() {
        return Err(FolderError::Content { path: path.to_owned(), because: "it names no image".to_owned() });
    }
    // The stamps are checked here as well as in the frames, because the lines are known only here.
    relative_stamps(&stamps_us).map_err(|error| match error {
        StampError::Order { index, found, before } => {
            let because = format!("{found} us is not later than the previous stamp, {before} us");
            refusal(numbers[index], because)
        }
        error @ StampError::Span { index, .. } => refusal(numbers[index], error.to_string()),
    })?;
    Ok(FolderListing { images, stamps_us: Some(stamps_us) })
}

/// `path timestamp`; the path may contain spaces.
fn parse_line(line: &str) -> Result<(&str, i64), String> {
    let wanted = "wanted `path timestamp`, the timestamp in microseconds";
    let (path, stamp) = line.trim().rsplit_once(char::is_whitespace).ok_or(format!("one word, {wanted}"))?;
    let stamp =
        stamp.parse().map_err(|_| format!("the timestamp is {stamp}, wanted an integer in microseconds"))?;
    Ok((path.trim_end(), stamp))
}

fn find_image(folder: &Path, image: &str) -> Option<PathBuf> {
    let above = folder.join("..");
    [folder, &above].map(|base| base.join(image)).into_iter().find(|path| files::is_there(path))
}

fn of_names(folder: &Path) -> Result<FolderListing, FolderError> {
    let images = list_named(folder, &["png", "jpg", "jpeg"])?;
    if images.is_empty() {
        let because = format!("it contains neither {INFO} nor a .png or .jpg file");
        return Err(FolderError::Content { path: folder.to_owned(), because });
    }
    Ok(FolderListing { images, stamps_us: None })
}

/// The files of a folder with one of these extensions, in the natural order of their names. Hidden ones
/// are left out.
///
/// # Errors
/// The folder cannot be read, or has more files than a sequence may have.
pub fn list_named(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>, FolderError> {
    let unreadable = |source| PathError::new(folder, source);
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name();
        let is_named = |name: &&str| is_visible(name, extensions);
        names.extend(name.to_str().filter(is_named).map(str::to_owned));
    }
    if names.len() > MAX_FRAMES {
        let because = format!("{} images, wanted at most {MAX_FRAMES}", names.len());
        return Err(FolderError::Content { path: folder.to_owned(), because });
    }
    names.sort_by(|a, b| natural::compare_names(a, b));
    Ok(names.iter().map(|name| folder.join(name)).collect())
}

fn is_visible(name: &str, extensions: &[&str]) -> bool {
    !name.starts_with('.') && extensions.iter().any(|wanted| has_extension(Path::new(name), wanted))
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

/// The images of a folder at their stamps. Each is read when it is needed.
#[derive(Debug)]
pub struct FolderFrames {
    images: Vec<PathBuf>,
    size: Size,
    /// Stamps, ns since the first.
    stamps: Vec<i64>,
    next: usize,
    /// True if colours are requested.
    coloured: bool,
    /// Colours of the last frame.
    colour: Option<Image<[f32; 3]>>,
}

impl FolderFrames {
    /// The images, one per stamp. The first stamp may have any value. The size of each image is
    /// read from its header.
    ///
    /// # Errors
    /// The numbers of stamps and images differ, the stamps do not strictly increase, or an image
    /// has an unreadable size or one that differs from the first.
    pub fn new(images: Vec<PathBuf>, stamps_us: &[i64]) -> Result<Self, FolderError> {
        let refusal = |path: &Path, because| FolderError::Content { path: path.to_owned(), because };
        let [first, rest @ ..] = images.as_slice() else {
            return Err(refusal(Path::new("."), "no image".to_owned()));
        };
        if images.len() != stamps_us.len() {
            let because = format!("{} images, but {} stamps", images.len(), stamps_us.len());
            return Err(refusal(first.parent().unwrap_or(first), because));
        }
        let stamps = relative_stamps(stamps_us)?;
        let wanted = image_size(first)?;
        // The first image is decoded before a sensor of its size is made: a header alone may claim
        // any size.
        read_image(first, false, wanted).map_err(|because| refusal(first, because))?;
        for path in rest {
            let found = image_size(path)?;
            if found != wanted {
                return Err(refusal(path, format!("{found}, wanted {wanted} like the first image")));
            }
        }
        Ok(Self { size: wanted, images, stamps, next: 0, coloured: false, colour: None })
    }
}

/// The luminance of an image of this size, on the grey scale.
///
/// # Errors
/// The file is not an image of this size.
pub fn read_luminance(path: &Path, size: Size) -> Result<Image<f32>, FolderError> {
    let read = read_image(path, false, size);
    let refusal = |because| FolderError::Content { path: path.to_owned(), because };
    read.map(|image| image.luminance).map_err(refusal)
}

/// The size of an image from its header.
///
/// # Errors
/// The header cannot be read, or states a size that no sensor has.
pub fn image_size(path: &Path) -> Result<Size, FolderError> {
    let refusal = |because| FolderError::Content { path: path.to_owned(), because };
    let file = files::open_at_most(path, files::MAX_PICTURE).map_err(|e| refusal(e.to_string()))?;
    let found = imagesize::reader_size(BufReader::new(file)).map_err(|e| refusal(e.to_string()))?;
    let side = |n: usize| u32::try_from(n).ok().filter(|n| (1..=1 << 16).contains(n));
    let sides = side(found.width).zip(side(found.height));
    let (width, height) = sides.ok_or_else(|| refusal("wanted 1 to 65536 columns and rows".to_owned()))?;
    let size = Size { width, height };
    // A sensor takes memory for each pixel before it sees the first frame.
    size.check_sensor().map_err(|e| refusal(format!("an image of {e}")))?;
    Ok(size)
}

impl FrameSequence for FolderFrames {
    fn size(&self) -> Size {
        self.size
    }

    fn len(&self) -> usize {
        self.stamps.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let index = self.next;
        let Some((path, &t)) = self.images.get(index).zip(self.stamps.get(index)) else { return Ok(None) };
        // The file may have been replaced since its size was read.
        let GreyImage { luminance, colours } =
            read_image(path, self.coloured, self.size).map_err(|because| {
                let because = format!("{}: {because}", path.display());
                FrameError::Invalid { index, because }
            })?;
        self.colour = colours;
        self.next += 1;
        Ok(Some(DenseFrame { index, t: Timestamp(t), luminance, rate: None }))
    }

    fn want_colour(&mut self) {
        self.coloured = true;
    }

    fn colour(&self) -> Option<&Image<[f32; 3]>> {
        self.colour.as_ref()
    }
}

/// The luminance of an image of this size, and its colours if they are requested and the image has
/// any.
fn read_image(path: &Path, coloured: bool, size: Size) -> Result<GreyImage, String> {
    let size = Some(size);
    if has_extension(path, "png") {
        let file = files::open_at_most(path, files::MAX_PICTURE).map_err(|e| e.to_string())?;
        let file = BufReader::new(file);
        let read = match coloured {
            true => png::read_colours(file, size),
            false => png::read_luminance(file, size).map(|luminance| GreyImage { luminance, colours: None }),
        };
        return read.map_err(|e| e.to_string());
    }
    let bytes = files::read(path, files::MAX_PICTURE).map_err(|e| e.to_string())?;
    let read = match coloured {
        true => jpeg::read_colours(&bytes, size),
        false => jpeg::read_luminance(&bytes, size).map(|luminance| GreyImage { luminance, colours: None }),
    };
    read.map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use tempfile::TempDir;

    const SIZE: Size = Size { width: 2, height: 1 };

    fn image(dir: &TempDir, name: &str, greys: [u8; 2]) {
        let path = dir.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        png::write_image(&Image::from_vec(SIZE, greys.to_vec()), File::create(path).unwrap()).unwrap();
    }

    fn greys(listing: &FolderListing, stamps_us: &[i64]) -> Vec<(i64, Vec<f32>)> {
        let mut frames = FolderFrames::new(listing.images.clone(), stamps_us).unwrap();
        std::iter::from_fn(|| frames.next().unwrap())
            .map(|frame| (frame.t.0, frame.luminance.into_pixels()))
            .collect()
    }

    #[test]
    fn images_come_in_natural_order() {
        let dir = tempfile::tempdir().unwrap();
        for (name, grey) in [("10.png", 3), ("9.PNG", 2), ("1.png", 1)] {
            image(&dir, name, [grey, 255]);
        }
        fs::write(dir.path().join("notes.txt"), "none of them").unwrap();
        fs::write(dir.path().join(".hidden.png"), "none of them").unwrap();
        let listing = FolderListing::list_folder(dir.path()).unwrap();
        assert_eq!(listing.stamps_us, None);
        let found = greys(&listing, &[7, 8, 10]);
        assert_eq!(found, [(0, vec![1.0, 255.0]), (1000, vec![2.0, 255.0]), (3000, vec![3.0, 255.0])]);
    }

    #[test]
    fn paths_of_an_info_start_at_its_folder_or_above() {
        let dir = tempfile::tempdir().unwrap();
        image(&dir, "clip/b c.png", [5, 6]);
        image(&dir, "clip/a.png", [7, 8]);
        fs::write(dir.path().join("clip/info.txt"), "b c.png 1000000\n\nclip/a.png\t 1000500 \n").unwrap();
        let listing = FolderListing::list_folder(&dir.path().join("clip")).unwrap();
        let stamps = listing.stamps_us.clone().unwrap();
        assert_eq!(stamps, [1_000_000, 1_000_500]);
        assert_eq!(greys(&listing, &stamps), [(0, vec![5.0, 6.0]), (500_000, vec![7.0, 8.0])]);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let dir = tempfile::tempdir().unwrap();
        image(&dir, "a.png", [5, 6]);
        let t = |text: &str, wanted: &str| {
            fs::write(dir.path().join(INFO), text).unwrap();
            let error = FolderListing::list_folder(dir.path()).unwrap_err().to_string();
            assert!(error.ends_with(wanted), "{error}");
        };
        t("a.png 0\na.png 0.5\n", "info.txt:2: the timestamp is 0.5, wanted an integer in microseconds");
        t("a.png 0\n\na.png 0\n", "info.txt:3: 0 us is not later than the previous stamp, 0 us");
        t("a.png 0\nb.png 4\n", "info.txt:2: b.png is not there");
        t("a.png\n", "info.txt:1: one word, wanted `path timestamp`, the timestamp in microseconds");
        t("\n", "info.txt: it names no image");
        fs::remove_file(dir.path().join(INFO)).unwrap();
        fs::remove_file(dir.path().join("a.png")).unwrap();
        let error = FolderListing::list_folder(dir.path()).unwrap_err().to_string();
        assert!(error.ends_with("it contains neither info.txt nor a .png or .jpg file"), "{error}");
    }

    #[test]
    fn images_of_two_sizes_and_too_few_stamps_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        image(&dir, "1.png", [5, 6]);
        image(&dir, "2.png", [5, 6]);
        let images = FolderListing::list_folder(dir.path()).unwrap().images;
        let new = |stamps: &[i64]| FolderFrames::new(images.clone(), stamps).map(|_| ());
        assert!(new(&[0]).unwrap_err().to_string().ends_with(": 2 images, but 1 stamps"));
        assert!(new(&[0, 0]).unwrap_err().to_string().starts_with("stamp 1 is 0 us"));
        let tall = Image::filled(Size { width: 1, height: 2 }, 9u8);
        png::write_image(&tall, File::create(dir.path().join("2.png")).unwrap()).unwrap();
        assert!(
            new(&[0, 1]).unwrap_err().to_string().ends_with("2.png: 1x2, wanted 2x1 like the first image")
        );
        fs::write(dir.path().join("2.png"), "no image").unwrap();
        assert!(new(&[0, 1]).unwrap_err().to_string().contains("2.png: "));
    }
}
