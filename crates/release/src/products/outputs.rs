//! The products that recipes ask for, one row each.

use super::{FilePresence, FileRow, FileSet, LicenceClass, PictureNumbers, ProductForm, ReleaseProduct};
use crate::report::{
    blurred_picture, depth_picture, disparity_picture, flow_picture, inertial_picture, segmentation_picture,
    sharp_picture,
};
use gs2e_build::artifact::OBJECT_PLACES;
use gs2e_recipe::OutputKind;

const HDF5: &str = "application/x-hdf5";
const PNG: &str = "image/png";
const NPY: &str = "application/x-npy";

/// Event streams.
pub static EVENTS: ReleaseProduct = ReleaseProduct {
    output: OutputKind::Events,
    form: ProductForm::Streams,
    files: &[
        material(
            "<scene>/<trajectory>/events.h5",
            "events in DSEC's layout: `events/{x,y,p,t}`, `ms_to_idx`, `t_offset`",
            FilePresence::WithStreams,
            FileSet {
                id: "event-files",
                media: HDF5,
                glob: "**/events.h5",
                description: "events of a trajectory, in DSEC's layout",
            },
        ),
        material(
            "<scene>/<trajectory>/events/<sensor>.h5",
            "the same, one file per sensor of the trajectory",
            FilePresence::WithSeveralSensors,
            FileSet {
                id: "sensor-event-files",
                media: HDF5,
                glob: "**/events/*.h5",
                description: "events of one of several sensors, in DSEC's layout",
            },
        ),
    ],
    noun: "streams",
    instance: "the events of a simulated sensor",
    content: "events (time in microseconds, column, row, polarity)",
    loading: &[
        "t, x, y, p, label = scene.events(10_000, 20_000)  # t0_us <= t < t1_us",
        "voxel = scene.voxel(10_000, 20_000, bins=5)  # [bins, H, W]",
    ],
    data_type: None,
    picture: None,
};

/// Sharp frames.
pub static SHARP: ReleaseProduct = ReleaseProduct {
    output: OutputKind::Sharp,
    form: ProductForm::Colours(PictureNumbers::SpacedAndExposed),
    files: &[material(
        "sharp/%06d.png",
        "8-bit sRGB rendering at the pose with that number",
        FilePresence::Always,
        FileSet {
            id: "picture-files",
            media: PNG,
            glob: "**/sharp/*.png",
            description: "sharp pictures, 8-bit sRGB",
        },
    )],
    noun: "sharp frames",
    instance: "sharp frames",
    content: "8-bit sRGB frames",
    loading: &["frame = scene.frames[0]"],
    data_type: Some("sharp"),
    picture: Some(sharp_picture),
};

/// Blurred frames.
pub static BLUR: ReleaseProduct = ReleaseProduct {
    output: OutputKind::Blur,
    form: ProductForm::Colours(PictureNumbers::Exposed),
    files: &[material(
        "blur/%06d.png",
        "8-bit sRGB mean over an exposure around that pose, in linear light; `transforms.json` has its times",
        FilePresence::Always,
        FileSet {
            id: "blur-files",
            media: PNG,
            glob: "**/blur/*.png",
            description: "blurred pictures, 8-bit sRGB: means over an exposure, in linear light",
        },
    )],
    noun: "blurred frames",
    instance: "blurred frames",
    content: "8-bit sRGB blurred frames with their exposures",
    loading: &["exposure = scene.blurred[0]"],
    data_type: Some("blurry"),
    picture: Some(blurred_picture),
};

static DEPTH: ReleaseProduct = ReleaseProduct {
    output: OutputKind::Depth,
    form: ProductForm::Numbers { channels: 1, positive: true, poses: PictureNumbers::Spaced },
    files: &[material(
        "depth/%06d.npy",
        "float32 `[H, W]`, scene units along the optical axis: the weighted mean of the Gaussians at a pixel, so that \
         soft edges mix near and far; NaN where the opacity is below 0.5",
        FilePresence::Always,
        FileSet {
            id: "depth-files",
            media: NPY,
            glob: "**/depth/*.npy",
            description: "depth, float32 [H, W], scene units along the optical axis; NaN: undefined",
        },
    )],
    noun: "depth images",
    instance: "depth images",
    content: "float32 depth in scene units",
    loading: &["depth = scene.depth(0)  # [H, W]"],
    data_type: None,
    picture: Some(depth_picture),
};

static FLOW: ReleaseProduct = ReleaseProduct {
    output: OutputKind::Flow,
    form: ProductForm::Numbers { channels: 2, positive: false, poses: PictureNumbers::Spaced },
    files: &[material(
        "flow/%06d.npy",
        "float32 `[H, W, 2]`, px/s: image velocity at that pose of the static point at a pixel's depth; NaN without a \
         depth",
        FilePresence::Always,
        FileSet {
            id: "flow-files",
            media: NPY,
            glob: "**/flow/*.npy",
            description: "optical flow, float32 [H, W, 2], px/s; NaN: undefined",
        },
    )],
    noun: "flow images",
    instance: "optical flow",
    content: "float32 optical flow in px/s",
    loading: &["flow = scene.flow(0)  # [H, W, 2]"],
    data_type: None,
    picture: Some(flow_picture),
};

static DISPARITY: ReleaseProduct = ReleaseProduct {
    output: OutputKind::Disparity,
    form: ProductForm::Numbers { channels: 1, positive: false, poses: PictureNumbers::Spaced },
    files: &[material(
        "disparity/%06d.npy",
        "float32 `[H, W]`, px: for each pixel of the first camera of a stereo pair, the column of its point in the first \
         rectified picture minus that in the second (the row, for cameras above each other); NaN without a depth",
        FilePresence::Always,
        FileSet {
            id: "disparity-files",
            media: NPY,
            glob: "**/disparity/*.npy",
            description: "disparity of a stereo pair, float32 [H, W], px of the rectified pictures; NaN: undefined",
        },
    )],
    noun: "disparity images",
    instance: "disparity of stereo pairs",
    content: "float32 disparity of stereo pairs in px",
    loading: &["disparity = scene.disparity(0)  # [H, W]"],
    data_type: None,
    picture: Some(disparity_picture),
};

static SEGMENTATION: ReleaseProduct = ReleaseProduct {
    output: OutputKind::Segmentation,
    form: ProductForm::Greys { poses: PictureNumbers::Spaced, beside: Some(OBJECT_PLACES) },
    files: &[material(
        "segmentation/%06d.png, segmentation/objects.csv",
        "8-bit grey: the number of the object with the largest blended weight at a pixel, 0 for what is still; and \
         number, name, pose, velocity and angular velocity of every object at every pose, in world axes",
        FilePresence::Always,
        FileSet {
            id: "segmentation-files",
            media: PNG,
            glob: "**/segmentation/*.png",
            description: "masks of moving objects, 8-bit grey: the number of the object; 0: what is still",
        },
    )],
    noun: "files of masks",
    instance: "masks of moving objects",
    content: "8-bit masks of moving objects with their poses",
    loading: &["mask = scene.segmentation(0)  # [H, W], 0: what is still"],
    data_type: None,
    picture: Some(segmentation_picture),
};

static IMU: ReleaseProduct = ReleaseProduct {
    output: OutputKind::Imu,
    form: ProductForm::Samples,
    files: &[material(
        "imu/imu.csv, imu/state.csv, imu/sensor.yaml",
        "inertial data in EuRoC's form, on the clock of the events: measurements, true state and biases in metres, and \
         the sensor with its noise and gravity",
        FilePresence::Always,
        FileSet {
            id: "imu-files",
            media: "text/csv",
            glob: "**/imu/*.csv",
            description: "inertial measurements and true states, in EuRoC's form",
        },
    )],
    noun: "files of inertial data",
    instance: "inertial data",
    content: "inertial measurements with their true states and biases",
    loading: &["imu = scene.imu()  # t_ns, gyroscope [N, 3], accelerometer [N, 3]"],
    data_type: None,
    picture: Some(inertial_picture),
};

/// The products that have a folder of files, in the order of every listing.
pub static FOLDERS: [&ReleaseProduct; 7] = [&SHARP, &BLUR, &DEPTH, &FLOW, &DISPARITY, &SEGMENTATION, &IMU];

/// A row of files that show the scene.
const fn material(
    name: &'static str,
    content: &'static str,
    presence: FilePresence,
    set: FileSet,
) -> FileRow {
    FileRow { name, content, set: Some(set), presence, class: LicenceClass::Material }
}
