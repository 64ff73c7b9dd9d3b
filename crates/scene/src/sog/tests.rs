//! Handmade SOG archives, valid and broken.

use super::*;
use image_webp::{ColorType, WebPEncoder};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::f32::consts::FRAC_1_SQRT_2;
use std::io::Write as _;
use zip::write::SimpleFileOptions;

/// The files of a scene: three Gaussians of degree 1, in images of 2x2 pixels and a palette of two
/// sets.
#[derive(Clone)]
struct Scene {
    meta: Value,
    images: BTreeMap<&'static str, Vec<u8>>,
}

fn webp(rgb: &[u8], (width, height): (u32, u32), color: ColorType) -> Vec<u8> {
    let mut out = Vec::new();
    WebPEncoder::new(&mut out).encode(rgb, width, height, color).unwrap();
    out
}

/// The codebook with `k - 128` as entry `k`, in units of `step`.
fn codebook(step: f64) -> Vec<f64> {
    (0..256).map(|k| step * (f64::from(k) - 128.0)).collect()
}

fn sound() -> Scene {
    let rgb = |pixels: [[u8; 3]; 4]| webp(pixels.as_flattened(), (2, 2), ColorType::Rgb8);
    let rgba = |pixels: [[u8; 4]; 4]| webp(pixels.as_flattened(), (2, 2), ColorType::Rgba8);
    let mut palette = vec![128; 64 * 3 * 3];
    palette[..9].copy_from_slice(&[129, 130, 131, 132, 133, 134, 135, 136, 137]);
    palette[9..18].copy_from_slice(&[0, 255, 128, 1, 2, 3, 127, 127, 127]);
    let images = [
        ("means_l.webp", rgb([[0, 255, 0], [255, 255, 255], [0, 0, 0], [9; 3]])),
        ("means_u.webp", rgb([[0, 255, 128], [255, 255, 255], [0, 0, 0], [9; 3]])),
        ("scales.webp", rgb([[128, 130, 0], [1, 2, 3], [255; 3], [0; 3]])),
        ("quats.webp", rgba([[255, 0, 128, 252], [128, 128, 255, 255], [0, 255, 0, 253], [0; 4]])),
        ("sh0.webp", rgba([[128, 0, 255, 51], [0, 0, 0, 0], [1, 2, 3, 255], [0; 4]])),
        ("sets.webp", webp(&palette, (192, 1), ColorType::Rgb8)),
        ("labels.webp", rgb([[1, 0, 0], [0, 0, 9], [1, 0, 0], [255; 3]])),
    ];
    let meta = json!({
        "version": 2, "count": 3, "antialias": true,
        "means": { "mins": [-1.0, 0.0, 0.5], "maxs": [1.0, 0.0, 1.5], "files": ["means_l.webp", "means_u.webp"] },
        "scales": { "codebook": codebook(0.0625), "files": ["scales.webp"] },
        "quats": { "files": ["quats.webp"] },
        "sh0": { "codebook": codebook(0.5), "files": ["sh0.webp"] },
        "shN": { "count": 1024, "bands": 1, "codebook": codebook(0.25), "files": ["sets.webp", "labels.webp"] },
    });
    Scene { meta, images: images.into() }
}

impl Scene {
    /// Returns the files as an archive with `meta.json` last, stored by `method`.
    fn zip(&self, method: zip::CompressionMethod) -> Vec<u8> {
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let meta = self.meta.to_string().into_bytes();
        for (name, content) in self.images.iter().chain([(&META, &meta)]) {
            archive.start_file(*name, SimpleFileOptions::default().compression_method(method)).unwrap();
            archive.write_all(content).unwrap();
        }
        archive.finish().unwrap().into_inner()
    }

    fn read(&self) -> Result<Gaussians, SceneError> {
        read_sog(&self.zip(zip::CompressionMethod::Stored))
    }
}

fn near(got: &[f32], wanted: &[f32]) {
    for (g, w) in got.iter().zip(wanted) {
        // The wanted values have seven digits.
        assert!((g - w).abs() <= 2e-6 * w.abs().max(0.1), "{got:?} for {wanted:?}");
    }
}

#[test]
fn what_was_planted_is_read() {
    for method in [zip::CompressionMethod::Stored, zip::CompressionMethod::Deflated] {
        let scene = read_sog(&sound().zip(method)).unwrap();
        // e - 1 = 1.7182818; 32768 of 65535 lie 7.6e-6 above the middle: exp(1.0000076) - 1 =
        // 1.7183026
        near(&scene.positions[0], &[-1.718_281_8, 0.0, 1.718_302_6]);
        near(&scene.positions[1], &[1.718_281_8, 0.0, 3.481_689_1]);
        near(&scene.positions[2], &[-1.718_281_8, 0.0, 0.648_721_3]);
        assert_eq!(scene.log_scales, [[0.0, 0.125, -8.0], [-7.9375, -7.875, -7.8125], [7.9375; 3]]);
        // 128/255*2 - 1 = 1/255, over the root of 2: 0.0027730; the largest is the rest of the unit
        near(&scene.rotations[0], &[0.0, FRAC_1_SQRT_2, -FRAC_1_SQRT_2, 0.002_773_0]);
        near(&scene.rotations[1], &[0.002_773_0, 0.002_773_0, FRAC_1_SQRT_2, 0.707_095_9]);
        near(&scene.rotations[2], &[-FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2, -FRAC_1_SQRT_2]);
        // ln 1/4, ln 1/509, ln 509
        near(&scene.opacity_logits, &[-1.386_294_4, -6.232_448, 6.232_448]);
        assert_eq!(scene.sh_of(0)[..1], [[0.0, -64.0, 63.5]]);
        assert_eq!(scene.sh_of(0)[1..], [[-32.0, 31.75, 0.0], [-31.75, -31.5, -31.25], [-0.25; 3]]);
        assert_eq!(scene.sh_of(1)[1..], [[0.25, 0.5, 0.75], [1.0, 1.25, 1.5], [1.75, 2.0, 2.25]]);
        assert_eq!((scene.sh_degree, scene.antialiased, scene.screening.read), (1, Some(true), 3));
    }
}

#[test]
fn a_folder_is_read_as_an_archive_is() {
    let (scene, folder) = (sound(), tempfile::tempdir().unwrap());
    for (name, content) in &scene.images {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    std::fs::write(folder.path().join(META), scene.meta.to_string()).unwrap();
    let read = read_sog_folder(folder.path()).unwrap();
    assert_eq!(read, scene.read().unwrap());
    for path in [folder.path().to_owned(), folder.path().join(META)] {
        assert_eq!(crate::read_any(&path).unwrap(), read);
    }
    std::fs::remove_file(folder.path().join("quats.webp")).unwrap();
    let error = crate::read_any(folder.path()).unwrap_err().to_string();
    assert!(error.contains("quats.webp`: "), "{error}");
}

#[test]
fn antialiasing_is_read_from_both_spellings() {
    let t = |antialias: Value, model: Value, wanted: Option<bool>| {
        let mut scene = sound();
        scene.meta["antialias"] = antialias;
        scene.meta["model"] = model;
        assert_eq!(scene.read().unwrap().antialiased, wanted);
    };
    t(Value::Null, Value::Null, None);
    t(json!(false), Value::Null, Some(false));
    t(Value::Null, json!("antialiased"), Some(true));
    t(Value::Null, json!("default"), Some(false));
}

/// Asserts that reading the valid scene after `change` is an error with these words.
#[track_caller]
fn broken(change: &dyn Fn(&mut Scene), message: &str) {
    let mut scene = sound();
    change(&mut scene);
    let error = scene.read().unwrap_err().to_string();
    assert!(error.contains(message), "{error}");
}

#[test]
fn errors_in_the_meta_file_name_their_place() {
    let meta = |path: &str, value: Value, message: &str| {
        broken(&|scene| *scene.meta.pointer_mut(path).unwrap() = value.clone(), message);
    };
    meta("/version", json!(3), "read .sog (meta.json) at byte 0: found version 3, wanted version 2");
    meta("/scales/codebook", json!([1, 2]), "found a codebook of 2 entries, wanted 256");
    meta("/sh0/codebook/7", json!(1e300), "found number out of range");
    meta("/sh0/codebook/7", json!("1"), "found invalid type: string \"1\", expected f32");
    meta("/means/mins", json!([0, 0]), "found invalid length 2");
    meta("/means/mins/1", json!(7.0), "found positions from 7 to 0, wanted `mins` below `maxs`");
    meta("/means/files", json!(["means_l.webp"]), "found 1 files, wanted 2");
    meta(
        "/quats/files/0",
        json!("../quats.webp"),
        "found the file `../quats.webp`, wanted a name without folders",
    );
    meta(
        "/quats/files/0",
        json!("other.webp"),
        "read .sog (archive) at byte 0: found an archive without the file",
    );
    meta("/shN/bands", json!(4), "found 4 bands of harmonics, wanted 1 to 3");
    meta("/shN/bands", json!(2), "found an image 192 pixels wide, wanted 512 pixels for 2 bands");
    meta(
        "/shN/count",
        json!(1),
        "read .sog (labels of harmonics) at byte 0: found the label 1 of Gaussian 0",
    );
    meta(
        "/count",
        json!(5),
        "read .sog (labels of harmonics) at byte 0: found an image of 2x2 pixels, wanted 5",
    );
    meta("/count", json!(-1), "found invalid value: integer `-1`");
    meta("/count", json!(0), "find a Gaussian to render: of 0 in the scene");
    broken(&|scene| scene.meta["model"] = json!("2dgs"), "the model `2dgs` is not supported");
    broken(
        &|scene| drop(scene.meta.as_object_mut().unwrap().remove("version")),
        "SOG version 1 is not supported; convert it with a current splat-transform",
    );
    broken(&|scene| drop(scene.meta.as_object_mut().unwrap().remove("quats")), "found missing field `quats`");
}

#[test]
fn errors_in_images_name_their_part_and_place() {
    let image = |name: &'static str, pixels: &[u8], size: (u32, u32), color, message: &str| {
        broken(&|scene| drop(scene.images.insert(name, webp(pixels, size, color))), message);
    };
    image(
        "scales.webp",
        &[0; 6],
        (2, 1),
        ColorType::Rgb8,
        "read .sog (scales) at byte 0: found an image of 2x1",
    );
    let tags = [[0, 0, 0, 252], [0, 0, 0, 252], [0, 0, 0, 251], [0; 4]];
    image(
        "quats.webp",
        tags.as_flattened(),
        (2, 2),
        ColorType::Rgba8,
        "read .sog (rotations) at byte 11: found the tag 251 for the largest component of Gaussian 2, wanted 252 to 255",
    );
    image(
        "labels.webp",
        &[1, 0, 0, 64, 0, 0, 0, 0, 0, 0, 0, 0],
        (2, 2),
        ColorType::Rgb8,
        "at byte 3: found the label 64 of Gaussian 1, wanted a label below 64, the size of the palette",
    );
    broken(
        &|scene| drop(scene.images.insert("sh0.webp", b"RIFF".to_vec())),
        "read .sog (colours) at byte 0: found a broken image",
    );
    let huge = vec![0; 3 * 2048 * 2048];
    image(
        "means_u.webp",
        &huge,
        (2048, 2048),
        ColorType::Rgb8,
        "read .sog (positions, high bytes) at byte 0: found an image of 2048x2048 pixels, wanted 3 to 65548 pixels",
    );
}

/// Images whose pixels the count requires, but which no file of this size may have; and one of a
/// folder, whose files have a budget together.
#[test]
fn images_take_no_more_than_the_budget() {
    let mut scene = sound();
    let (width, height) = (2048, 1536);
    let pixels = usize::try_from(width * height).unwrap();
    scene.meta["count"] = json!(pixels);
    drop(scene.meta.as_object_mut().unwrap().remove("shN"));
    for name in ["means_l.webp", "means_u.webp", "scales.webp"] {
        drop(scene.images.insert(name, webp(&vec![0; 3 * pixels], (width, height), ColorType::Rgb8)));
    }
    for name in ["quats.webp", "sh0.webp"] {
        let rgba: Vec<u8> = [0, 0, 0, 255].repeat(pixels);
        drop(scene.images.insert(name, webp(&rgba, (width, height), ColorType::Rgba8)));
    }
    let bytes = scene.zip(zip::CompressionMethod::Stored);
    let error = read_sog(&bytes).unwrap_err().to_string();
    assert!(error.contains("wanted fewer: all images take "), "{} bytes: {error}", bytes.len());
}

#[test]
fn every_truncation_is_an_error() {
    let scene = sound();
    let whole = scene.zip(zip::CompressionMethod::Deflated);
    for len in 0..whole.len() {
        assert!(read_sog(&whole[..len]).is_err(), "{len} of {} bytes", whole.len());
    }
    for (name, image) in &scene.images {
        for len in 0..image.len() {
            let mut cut = scene.clone();
            cut.images.insert(name, image[..len].to_vec());
            let error = cut.read().map_err(|e| e.to_string());
            // The padding of a WebP image's last chunk is not part of the image.
            assert!(error.is_err() || len + 1 == image.len(), "{name}, {len} of {} bytes", image.len());
        }
    }
    let text = scene.meta.to_string();
    for len in 0..text.len() {
        assert!(SogMeta::parse_meta(&text.as_bytes()[..len]).is_err(), "{len} of {} bytes", text.len());
    }
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig {
        failure_persistence: None, ..proptest::prelude::ProptestConfig::with_cases(500)
    })]

    #[test]
    fn damage_never_panics(at in 0_usize..100_000, byte: u8, part in 0_usize..9) {
        let mut scene = sound();
        if let Some(image) = scene.images.values_mut().nth(part) {
            let at = at % image.len();
            image[at] = byte;
            let _ = scene.read();
        } else {
            let mut bytes = scene.zip(zip::CompressionMethod::Stored);
            let at = at % bytes.len();
            bytes[at] = byte;
            let _ = read_sog(&bytes);
        }
    }
}
