//! The channels of `gs2e render`, and the file formats of each.

use crate::cli::VerbError;
use clap::ValueEnum;
use gs2e_image::{Image, npy, png, to_byte};
use gs2e_render::{ChannelSet, RenderedImages};
use std::io::{self, Write};
use std::path::Path;

/// The channel to render.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ChannelArg {
    /// Colour as the scene was trained, nominally 0..1
    Rgb,
    /// Accumulated opacity
    Alpha,
    /// 0.299 R + 0.587 G + 0.114 B of the unclamped colour
    Luminance,
    /// Rate of change of luminance while the camera moves, 1/s
    LuminanceRate,
    /// Mean depth along the optical axis, scene units; NaN where alpha is below 0.5
    Depth,
    /// Share of each pixel that comes from Gaussians too deep for their distance, whose projection
    /// is doubtful
    Doubtful,
    /// Image velocity of the point at each pixel, px/s; NaN where depth is NaN
    Flow,
}

impl ChannelArg {
    /// The name on the command line.
    pub(super) fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// The channels that the renderer must make.
    pub(super) fn wanted(self) -> ChannelSet {
        let none = ChannelSet::NONE;
        match self {
            Self::Rgb => ChannelSet { rgb: true, ..none },
            Self::Alpha => ChannelSet { alpha: true, ..none },
            Self::Luminance => ChannelSet { luminance: true, ..none },
            Self::LuminanceRate => ChannelSet { luminance_rate: true, ..none },
            Self::Depth => ChannelSet { depth: true, ..none },
            Self::Doubtful => ChannelSet { doubtful: true, ..none },
            Self::Flow => ChannelSet { flow: true, ..none },
        }
    }

    /// Returns true if the channel depends on the motion of the camera.
    pub(super) fn moves(self) -> bool {
        matches!(self, Self::LuminanceRate | Self::Flow)
    }

    /// Returns true if the channel is on the scale 0..1, which bytes are made from.
    fn fits_bytes(self) -> bool {
        matches!(self, Self::Rgb | Self::Alpha | Self::Luminance | Self::Doubtful)
    }
}

/// The format of a picture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PictureFormat {
    /// 32-bit numbers, unchanged.
    Npy,
    /// 8 bits per channel.
    Png,
}

impl PictureFormat {
    /// The format for a path by its extension; `.npy` for stdout.
    ///
    /// # Errors
    /// The extension is unknown, or the format cannot hold the channel.
    pub(super) fn for_path(path: &Path, channel: ChannelArg) -> Result<Self, VerbError> {
        let is = |wanted: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted));
        let shown = path.display();
        if is("npy") || path.as_os_str() == "-" {
            return Ok(Self::Npy);
        }
        if !is("png") {
            let what = format!("{shown} is neither .npy nor .png");
            let help = "pass --out with a .npy (unscaled 32-bit numbers), a .png (8 bits), or `-` for a .npy to stdout";
            return Err(VerbError::usage("output-format", what).help(help));
        }
        if !channel.fits_bytes() {
            let what =
                format!("{shown} has 8 bits, but values of {} are not limited to 0 to 1", channel.name());
            return Err(VerbError::usage("output-format", what).help("write it to a .npy"));
        }
        Ok(Self::Png)
    }
}

/// The image of one channel.
#[derive(Debug)]
pub(super) enum ChannelImage {
    /// Red, green and blue.
    Colour(Image<[f32; 3]>),
    /// One number per pixel.
    Plane(Image<f32>),
    /// The x and y components.
    Vectors(Image<[f32; 2]>),
}

impl ChannelImage {
    /// The image that was rendered for `channel`, if there is one.
    pub(super) fn from_rendered(channel: ChannelArg, rendered: RenderedImages) -> Option<Self> {
        match channel {
            ChannelArg::Rgb => rendered.rgb.map(Self::Colour),
            ChannelArg::Alpha => rendered.alpha.map(Self::Plane),
            ChannelArg::Luminance => rendered.luminance.map(Self::Plane),
            ChannelArg::LuminanceRate => rendered.luminance_rate.map(Self::Plane),
            ChannelArg::Doubtful => rendered.doubtful.map(Self::Plane),
            ChannelArg::Depth => rendered.depth.map(Self::Plane),
            ChannelArg::Flow => rendered.flow.map(Self::Vectors),
        }
    }

    /// Writes the image in a format.
    pub(super) fn write(&self, format: PictureFormat, out: &mut dyn Write) -> io::Result<()> {
        match (self, format) {
            (Self::Colour(image), PictureFormat::Npy) => npy::write_image(image, out),
            (Self::Plane(image), PictureFormat::Npy) => npy::write_image(image, out),
            (Self::Vectors(image), PictureFormat::Npy) => npy::write_image(image, out),
            (Self::Colour(image), PictureFormat::Png) => png::write_image(&png::to_bytes(image), out),
            (Self::Plane(image), PictureFormat::Png) => {
                let grey = image.pixels().iter().copied().map(to_byte).collect();
                png::write_image(&Image::from_vec(image.size(), grey), out)
            }
            // `for_path` refuses this pair before anything is rendered; the types alone do not exclude it.
            (Self::Vectors(_), PictureFormat::Png) => {
                Err(io::Error::new(io::ErrorKind::Unsupported, "a .png cannot store vectors"))
            }
        }
    }
}
