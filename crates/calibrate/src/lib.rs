//! The parameters of an event camera from a recording: frames and events of the same pixels on one clock, or
//! events of constant light alone.
//!
//! Each module estimates one thing, with a standard error, or says that the recording does not determine it.

mod anchor;
mod calibration;
mod course;
mod dead_time;
mod delay;
mod estimate;
mod flicker;
mod ladder;
mod linear;
mod read_out;
mod recording;
mod sensor;
mod still;

pub use calibration::{
    CalibrateError, Calibration, LightLevel, StaticRecording, calibrate, calibrate_static,
};
pub use course::{GreyCourse, is_usable_grey};
pub use estimate::Estimate;
pub use flicker::FlickerLine;
pub use ladder::Rung;
pub use read_out::{ReadOut, is_at_read_out};
pub use recording::{PixelTrains, Recording};
pub use sensor::sensor_text;
