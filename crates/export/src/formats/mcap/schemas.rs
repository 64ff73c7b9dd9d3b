//! Definitions of the message types in the form `ros2msg` (mcap.dev, "Well-known schema encodings"): the
//! type itself, then each type that it uses, after a line and its name.
//!
//! Readers decode messages by these definitions alone, and viewers know the types by their names.

use gs2e_event::mcap::EVENT_PACKET;

/// A message type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MessageType {
    EventPacket,
    Image,
    CameraInfo,
    Imu,
    PoseStamped,
    Transforms,
}

/// Encoding of the definitions.
pub(super) const ENCODING: &str = "ros2msg";

const HEADER: [(&str, &str); 2] = [
    ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
];

const PACKET_FIELDS: &str = "\
std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
";

const IMAGE_FIELDS: &str = "\
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
";

const CAMERA_INFO_FIELDS: &str = "\
std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
sensor_msgs/RegionOfInterest roi
";

const REGION: (&str, &str) = (
    "sensor_msgs/RegionOfInterest",
    "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
);

const IMU_FIELDS: &str = "\
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
";

const POSE_FIELDS: &str = "std_msgs/Header header\ngeometry_msgs/Pose pose\n";
const POSE: (&str, &str) =
    ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n");
const POINT: (&str, &str) = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");
const QUATERNION: (&str, &str) = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n");

const TRANSFORMS_FIELDS: &str = "geometry_msgs/TransformStamped[] transforms\n";
const TRANSFORM_STAMPED: (&str, &str) = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
);
const TRANSFORM: (&str, &str) =
    ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n");
const VECTOR: (&str, &str) = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");

impl MessageType {
    /// Its name.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::EventPacket => EVENT_PACKET,
            Self::Image => "sensor_msgs/msg/Image",
            Self::CameraInfo => "sensor_msgs/msg/CameraInfo",
            Self::Imu => "sensor_msgs/msg/Imu",
            Self::PoseStamped => "geometry_msgs/msg/PoseStamped",
            Self::Transforms => "tf2_msgs/msg/TFMessage",
        }
    }

    /// Its definition, with those of the types that it uses.
    pub(super) fn definition(self) -> String {
        let (fields, used): (_, &[(&str, &str)]) = match self {
            Self::EventPacket => (PACKET_FIELDS, &[]),
            Self::Image => (IMAGE_FIELDS, &[]),
            Self::CameraInfo => (CAMERA_INFO_FIELDS, &[REGION]),
            Self::Imu => (IMU_FIELDS, &[QUATERNION, VECTOR]),
            Self::PoseStamped => (POSE_FIELDS, &[POSE, POINT, QUATERNION]),
            Self::Transforms => (TRANSFORMS_FIELDS, &[TRANSFORM_STAMPED, TRANSFORM, VECTOR, QUATERNION]),
        };
        let line = "=".repeat(80);
        let part = |(name, fields): &(&str, &str)| format!("{line}\nMSG: {name}\n{fields}");
        fields.to_owned() + &used.iter().chain(&HEADER).map(part).collect::<String>()
    }
}
