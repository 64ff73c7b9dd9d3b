//! nerfstudio's `transforms.json` (docs.nerf.studio, "Data conventions"; also the form of
//! instant-ngp and Blender).
//!
//! Poses are camera to world in OpenGL camera axes. Intrinsics are at the top level or in each
//! frame; the frame wins. Blender's form has only `camera_angle_x`. Pixel centres lie at
//! half-integers, as in this program, unless the file has `pixel_center: 0`. `applied_transform` is
//! already part of the poses; the world is that of the file.

use super::layout::CaptureLayout;
use super::node::{JsonNode, load_document};
use super::photo::{self, PhotoInfo, PhotoScrutiny, SCALED};
use super::{
    Capture, CapturedView, DiskCapture, FoundView, LensModel, SourceError, SourceWarning, collect_views,
    model, screen_camera,
};
use glam::{DMat3, DVec3};
use gs2e_files::is_there;
use gs2e_image::Size;
use gs2e_num::se3;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Returns the path of the file, given the file or its folder.
pub(super) fn locate_transforms(path: &Path) -> PathBuf {
    if path.is_dir() { path.join("transforms.json") } else { path.to_owned() }
}

/// Files `transforms.json`.
pub(super) struct NerfstudioLayout;

impl CaptureLayout for NerfstudioLayout {
    fn name(&self) -> &'static str {
        "nerfstudio"
    }

    fn words(&self) -> &'static str {
        "a transforms.json"
    }

    fn is_in(&self, folder: &Path) -> bool {
        is_there(&locate_transforms(folder))
    }

    fn is_file(&self, file: &Path) -> bool {
        // The file may have any name, for example `transforms_train.json`.
        file.extension().is_some_and(|extension| extension == "json") && !model::is_cameras(file)
    }

    fn read(
        &self,
        captured: &DiskCapture,
        look: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        look_at(&captured.path, look)
    }

    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError> {
        files_of(&locate_transforms(&captured.path), PhotoLocation::AsNamed)
    }

    /// The folder of the file, and the folders of existing or missing photos.
    fn folders(&self, captured: &DiskCapture) -> Vec<PathBuf> {
        let file = locate_transforms(&captured.path);
        let home = photo::or_here(file.parent().unwrap_or(Path::new("")));
        let mut folders = vec![home.clone()];
        // A document that cannot be read names no photos. Its fault is reported by the reader.
        let document = load_document(&file).unwrap_or_default();
        let top = JsonNode::top_node(&file, &document);
        for frame in top.list("frames").unwrap_or_default() {
            let photo = home.join(frame.text("file_path").unwrap_or_default());
            // The nearest existing folder: a missing folder of photos would appear in it.
            folders.extend(photo.ancestors().skip(1).find(|folder| folder.is_dir()).map(Path::to_owned));
        }
        folders.sort();
        folders.dedup();
        folders
    }
}

/// Reads a `transforms.json`, or the one in a folder, as a capture.
///
/// # Errors
/// The file is no `transforms.json`, a value is missing or wrong, a pose is invalid, the camera
/// model is not supported, or the aspect ratio of a photo differs from the file's.
pub fn read_capture(path: &Path) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    look_at(path, PhotoScrutiny::Bytes)
}

/// Reads a `transforms.json`, with the given depth of reading for photos.
pub(super) fn look_at(
    path: &Path,
    look: PhotoScrutiny,
) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    read_file(&locate_transforms(path), PhotoLocation::AsNamed, look)
}

/// Location of the photos that a file names.
#[derive(Clone, Copy)]
pub(super) enum PhotoLocation<'a> {
    /// At the named path.
    AsNamed,
    /// In this folder, whatever folder the file names.
    In(&'a Path),
}

impl PhotoLocation<'_> {
    /// Finds the photo of `file_path`. Blender's form omits the extension.
    fn find(self, file: &Path, name: &str) -> Option<PathBuf> {
        let (folder, name) = match self {
            Self::AsNamed => (file.parent()?, name),
            // The file names the folder of another size, so only the last part counts.
            Self::In(folder) => (folder, name.rsplit('/').next()?),
        };
        photo::find_photo(folder, name).or_else(|| photo::find_photo(folder, &format!("{name}.png")))
    }

    /// Reads the photo of a frame, if it exists.
    fn of(self, frame: &JsonNode<'_>, look: PhotoScrutiny) -> Result<Option<PhotoInfo>, SourceError> {
        let path = self.find(frame.path(), frame.text("file_path")?);
        path.map(|path| photo::read_photo(&path, look)).transpose()
    }
}

/// Reads this `transforms.json`.
pub(super) fn read_file(
    file: &Path,
    photos: PhotoLocation<'_>,
    look: PhotoScrutiny,
) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    let document = load_document(file)?;
    let top = JsonNode::top_node(file, &document);
    let frames = top.list("frames")?;
    let taken: Vec<Option<PhotoInfo>> =
        frames.par_iter().map(|frame| photos.of(frame, look)).collect::<Result<_, _>>()?;
    let (mut found, mut warnings) = (Vec::new(), Vec::new());
    for (frame, photo) in frames.iter().zip(&taken) {
        let (view, own) = read_frame(&top, frame, photo.as_ref())?;
        found.push(view);
        warnings.extend(own);
    }
    let home = match photos {
        PhotoLocation::AsNamed => photo::or_here(file.parent().unwrap_or(Path::new(""))),
        PhotoLocation::In(folder) => folder.to_owned(),
    };
    let names = found.iter().map(|found| found.view.name.as_str());
    warnings.extend(photo::missing_warning(&home, names.zip(taken.iter().map(Option::as_ref))));
    Ok((collect_views(file, found)?, warnings))
}

/// Returns the files that [`read_file`] reads.
pub(super) fn files_of(
    file: &Path,
    photos: PhotoLocation<'_>,
) -> Result<Vec<(String, PathBuf)>, SourceError> {
    let document = load_document(file)?;
    let mut files = vec![("transforms.json".to_owned(), file.to_owned())];
    for frame in JsonNode::top_node(file, &document).list("frames")? {
        let name = frame.text("file_path")?;
        files.extend(photos.find(file, name).map(|path| (name.to_owned(), path)));
    }
    Ok(files)
}

fn read_frame(
    top: &JsonNode<'_>,
    frame: &JsonNode<'_>,
    photo: Option<&PhotoInfo>,
) -> Result<(FoundView, Vec<SourceWarning>), SourceError> {
    let name = frame.text("file_path")?.to_owned();
    let size = photo.and_then(|p| p.size);
    let own = FrameValues { frame, top };
    let stated = own.camera(size)?;
    let lens = own.lens()?;
    let camera = fit_camera(frame, &stated, size)?;
    screen_camera(&camera, &lens).map_err(|e| frame.fault(e))?;
    let (world_from_camera, projected) = matrix_pose(&frame.get("transform_matrix")?)?;
    let rescaled = size.filter(|&photo| photo != stated.size).map(|photo| SourceWarning::PhotoSize {
        image: name.clone(),
        photo,
        stated: stated.size,
        action: SCALED,
    });
    let projected = projected.map(|deviation| SourceWarning::Projected { image: name.clone(), deviation });
    let sha256 = photo.and_then(|p| p.sha256.clone());
    let view = CapturedView { name, world_from_camera, camera, lens, sha256 };
    Ok((FoundView { view, place: frame.place() }, rescaled.into_iter().chain(projected).collect()))
}

/// Returns the camera, scaled to its photo if `w` and `h` state another size.
fn fit_camera(frame: &JsonNode<'_>, stated: &Camera, photo: Option<Size>) -> Result<Camera, SourceError> {
    let other = photo.filter(|&photo| photo != stated.size);
    other
        .map_or(Ok(*stated), |photo| photo::fit_camera(stated, photo))
        .map_err(|because| frame.fault(because))
}

/// Values of a frame, with the file's values as a fallback.
struct FrameValues<'a> {
    frame: &'a JsonNode<'a>,
    top: &'a JsonNode<'a>,
}

impl FrameValues<'_> {
    fn find(&self, key: &str) -> Option<JsonNode<'_>> {
        self.frame.find(key).or_else(|| self.top.find(key))
    }

    fn number(&self, key: &str) -> Result<Option<f64>, SourceError> {
        self.find(key).map(|node| node.number()).transpose()
    }

    /// Returns the camera as the file states it. The size is that of the photo if the file has no
    /// size.
    fn camera(&self, photo: Option<Size>) -> Result<Camera, SourceError> {
        let size = match (self.side("w")?, self.side("h")?, photo) {
            (Some(width), Some(height), _) => Size { width, height },
            (None, None, Some(photo)) => photo,
            _ => {
                return Err(self
                    .top
                    .missing("w", "the image size in `w` and `h`, because no photo gives it"));
            }
        };
        let centre = [f64::from(size.width) / 2.0, f64::from(size.height) / 2.0];
        let ([fx, fy], [cx, cy]) = match (self.number("fl_x")?, self.number("camera_angle_x")?) {
            (Some(fx), _) => ([fx, self.wanted("fl_y")?], [self.wanted("cx")?, self.wanted("cy")?]),
            (None, Some(angle)) => {
                // The angle is the horizontal field of view.
                let f = centre[0] / libm::tan(angle / 2.0);
                let c = |key, middle| Ok::<f64, SourceError>(self.number(key)?.unwrap_or(middle));
                ([f, f], [c("cx", centre[0])?, c("cy", centre[1])?])
            }
            (None, None) => {
                return Err(self.top.missing("fl_x", "a focal length in pixels, or `camera_angle_x`"));
            }
        };
        let shift = self.pixel_shift()?;
        Ok(Camera { size, fx, fy, cx: cx + shift, cy: cy + shift, lens: None })
    }

    fn wanted(&self, key: &str) -> Result<f64, SourceError> {
        self.number(key)?.ok_or_else(|| self.top.missing(key, "a number, because `fl_x` is present"))
    }

    fn side(&self, key: &str) -> Result<Option<u32>, SourceError> {
        self.find(key).map(|node| node.side()).transpose()
    }

    /// Returns the shift of the principal point for counting from pixel corners.
    fn pixel_shift(&self) -> Result<f64, SourceError> {
        let Some(node) = self.find("pixel_center") else { return Ok(0.0) };
        let centre = node.number()?;
        match centre {
            0.0 => Ok(0.5),
            0.5 => Ok(0.0),
            _ => Err(node.fault(format!("{centre}, wanted 0 or 0.5"))),
        }
    }

    fn lens(&self) -> Result<LensModel, SourceError> {
        if let Some(node) = self.find("camera_model") {
            let model = node.string()?;
            if !["OPENCV", "PINHOLE"].contains(&model) {
                return Err(node.fault(format!("the camera model `{model}`, wanted OPENCV or PINHOLE")));
            }
        }
        let [k1, k2, k3, k4] = ["k1", "k2", "k3", "k4"].map(|key| self.number(key));
        let [p1, p2] = ["p1", "p2"].map(|key| self.number(key));
        let or_zero = |v: Result<Option<f64>, SourceError>| v.map(Option::unwrap_or_default);
        let [k1, k2, k3, k4, p1, p2] =
            [or_zero(k1)?, or_zero(k2)?, or_zero(k3)?, or_zero(k4)?, or_zero(p1)?, or_zero(p2)?];
        if k4 != 0.0 {
            return Err(self.top.field_fault(
                "k4",
                format!("{k4}, wanted 0: the supported camera models have no eighth-order term"),
            ));
        }
        Ok(match [k1, k2, p1, p2, k3] {
            [0.0, 0.0, 0.0, 0.0, 0.0] => LensModel::Pinhole,
            [_, _, _, _, 0.0] => LensModel::OpenCv { k: [k1, k2, p1, p2] },
            _ => LensModel::FullOpenCv { k: [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0] },
        })
    }
}

/// Returns the pose of a matrix, and its deviation from a rotation if it must be reported.
fn matrix_pose(node: &JsonNode<'_>) -> Result<(Se3, Option<f64>), SourceError> {
    let m: [[f64; 4]; 4] = node.matrix()?;
    if m[3].iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(found, wanted)| (found - wanted).abs() > 1e-9) {
        return Err(node.fault(format!("its last row is {:?}, wanted 0, 0, 0, 1", m[3])));
    }
    let column = |j: usize| DVec3::new(m[0][j], m[1][j], m[2][j]);
    // A change of the camera's axes multiplies from the right: the columns of y and z change their
    // signs.
    let axes = se3::OPENCV_FROM_OPENGL;
    let rotation = DMat3::from_cols(column(0) * axes.x, column(1) * axes.y, column(2) * axes.z);
    let screened = se3::rotation_from_matrix(&rotation).map_err(|e| node.fault(e.to_string()))?;
    let pose = Se3 { rotation: screened.rotation, translation: column(3) };
    Ok((pose, screened.projected.then_some(screened.deviation)))
}
