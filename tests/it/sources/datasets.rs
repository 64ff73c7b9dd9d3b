//! Dataset trees with the layouts of `MVImgNet` and DL3DV-10K, and with their known defects. Poses
//! and photos are trivial; only the layout matters. No code of the crate is used.

use gs2e_testing::planted::{Camera, Image, Planted};
use std::fs;
use std::path::{Path, PathBuf};

/// Possible defects of an instance of `MVImgNet`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Defect {
    /// No COLMAP model.
    NoModel,
    /// `cameras.bin` is missing.
    NoCameras,
    /// `images.bin` ends early.
    Truncated,
    /// A camera model with a number that COLMAP does not have.
    UnknownCamera,
    /// A fisheye camera.
    Fisheye,
    /// Two images with one name.
    TwiceNamed,
    /// A pose that is not a number.
    NanPose,
    /// A focal length of zero.
    NoFocal,
    /// Five views.
    FewViews,
    /// Photos of 128x96.
    Small,
    /// One photo is missing.
    OnePhotoLess,
    /// Additional photos, some without background.
    Leftovers,
}

/// Number of views in a sound instance.
pub(crate) const VIEWS: u32 = 12;
/// Size of the photos, px.
const SIZE: [u32; 2] = [640, 360];

/// A grey photo.
fn photo([width, height]: [u32; 2]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().expect("memory can be written");
    writer.write_image_data(&vec![128; (width * height) as usize]).expect("memory can be written");
    writer.finish().expect("memory can be written");
    file
}

/// A short walk around the origin.
fn model(views: u32, [width, height]: [u32; 2]) -> Planted {
    let image = |i: u32| {
        let half = 0.01 * f64::from(i);
        Image {
            id: i + 1,
            q: [half.cos(), 0.0, half.sin(), 0.0],
            t: [0.0, 0.0, 4.0],
            camera: 1,
            name: format!("{:03}.jpg", i + 1),
            observations: vec![(1.0, 2.0, 1), (3.0, 4.0, -1)],
        }
    };
    let [w, h] = [width, height].map(f64::from);
    Planted {
        cameras: vec![Camera {
            id: 1,
            model: (2, "SIMPLE_RADIAL"),
            size: [width.into(), height.into()],
            parameters: vec![w, w / 2.0, h / 2.0, -0.01],
        }],
        images: (0..views).map(image).collect(),
        points: vec![(1, [0.0, 0.0, 0.0], 0.5)],
    }
}

/// Lays out trees. Photos of one size are made once.
pub(crate) struct Generator {
    photo: Vec<u8>,
    small: Vec<u8>,
}

impl Generator {
    pub(crate) fn new() -> Self {
        Self { photo: photo(SIZE), small: photo([128, 96]) }
    }

    /// Writes `count` sound instances from the `first`th on, ten per class, each with a scene file
    /// of these bytes. Returns their folders.
    pub(crate) fn mvimgnet(&self, root: &Path, first: u32, count: u32, scene: &[u8]) -> Vec<PathBuf> {
        let instance = |i: u32| {
            let dir = root.join(format!("{}/{:08x}", i / 10, i.wrapping_mul(2_654_435_761)));
            self.instance(&dir, None);
            fs::write(dir.join("point_cloud.ply"), scene).unwrap();
            dir
        };
        (first..first + count).map(instance).collect()
    }

    /// Writes one instance, sound or not. Its photos are PNGs with the extension of JPEGs, which
    /// also occurs in practice.
    pub(crate) fn instance(&self, dir: &Path, defect: Option<Defect>) {
        let images = dir.join("images");
        fs::create_dir_all(&images).unwrap();
        let (views, size, photo) = match defect {
            Some(Defect::FewViews) => (5, SIZE, &self.photo),
            Some(Defect::Small) => (VIEWS, [128, 96], &self.small),
            _ => (VIEWS, SIZE, &self.photo),
        };
        let mut model = model(views, size);
        for image in &model.images {
            fs::write(images.join(&image.name), photo).unwrap();
        }
        match defect {
            Some(Defect::NoModel) => return,
            Some(Defect::UnknownCamera) => model.cameras[0].model.0 = 99,
            Some(Defect::Fisheye) => model.cameras[0].model.0 = 8,
            Some(Defect::TwiceNamed) => model.images[4].name = model.images[7].name.clone(),
            Some(Defect::NanPose) => model.images[3].t[1] = f64::NAN,
            Some(Defect::NoFocal) => model.cameras[0].parameters[0] = 0.0,
            Some(Defect::OnePhotoLess) => fs::remove_file(images.join("005.jpg")).unwrap(),
            Some(Defect::Leftovers) => {
                fs::write(images.join("001_bg_removed.png"), photo).unwrap();
                fs::write(images.join("013.jpg"), photo).unwrap();
            }
            _ => {}
        }
        let sparse = dir.join("sparse/0");
        model.write_binary(&sparse);
        match defect {
            Some(Defect::NoCameras) => fs::remove_file(sparse.join("cameras.bin")).unwrap(),
            Some(Defect::Truncated) => {
                let bytes = fs::read(sparse.join("images.bin")).unwrap();
                fs::write(sparse.join("images.bin"), &bytes[..bytes.len() - 100]).unwrap();
            }
            _ => {}
        }
    }

    /// Writes a scene of DL3DV's bulk sets: poses of photos at 3840x2160, and photos at a quarter
    /// of that.
    pub(crate) fn dl3dv_bulk(&self, dir: &Path) {
        let photos = dir.join("images_4");
        fs::create_dir_all(&photos).unwrap();
        let photo = photo([960, 540]);
        for i in 1..=VIEWS {
            fs::write(photos.join(format!("frame_{i:05}.png")), &photo).unwrap();
        }
        fs::write(dir.join("transforms.json"), transforms()).unwrap();
    }

    /// Writes a scene of DL3DV's samples: both forms of poses and two sizes of photos. The model's
    /// world differs.
    pub(crate) fn dl3dv_sample(&self, dir: &Path) {
        let home = dir.join("colmap");
        self.dl3dv_bulk(&home);
        let photos = home.join("images_2");
        fs::create_dir_all(&photos).unwrap();
        let photo = photo([1920, 1080]);
        for i in 1..=VIEWS {
            fs::write(photos.join(format!("frame_{i:05}.png")), &photo).unwrap();
        }
        let mut model = model(VIEWS, [3840, 2160]);
        for (image, i) in model.images.iter_mut().zip(1..) {
            image.name = format!("frame_{i:05}.png");
        }
        model.write_binary(&home.join("colmap/sparse/0"));
    }
}

/// Views of the origin from 7 units away, in OpenGL axes, as photos of the full size.
fn transforms() -> String {
    let frame = |i: u32| {
        let (sin, cos) = (0.01 * f64::from(i)).sin_cos();
        serde_json::json!({
            "file_path": format!("images/frame_{i:05}.png"), "colmap_im_id": i,
            "transform_matrix": [[cos, 0.0, sin, 7.0 * sin], [0.0, 1.0, 0.0, 0.0], [-sin, 0.0, cos, 7.0 * cos], [0.0, 0.0, 0.0, 1.0]],
        })
    };
    let frames: Vec<_> = (1..=VIEWS).map(frame).collect();
    serde_json::json!({
        "w": 3840, "h": 2160, "fl_x": 3000.0, "fl_y": 3004.0, "cx": 1920.0, "cy": 1082.0, "camera_model": "OPENCV",
        "k1": 0.01, "k2": 0.0, "p1": 0.0, "p2": 0.0, "applied_transform": [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]],
        "frames": frames,
    })
    .to_string()
}
