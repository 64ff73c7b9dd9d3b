//! The value of white in an array.

/// Brightness of white in an array of floats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FullScale {
    /// White is 1.
    One,
    /// White is 255.
    Grey255,
}

/// Upper bound of the brightest sample in frames on the scale 0..1, with room for highlights.
const MAX_OF_ONE: f32 = 2.0;

/// Lower bound of the brightest sample in frames on the scale 0..255.
const MIN_OF_255: f32 = 16.0;

impl FullScale {
    /// The scale of floats with this brightest sample; `None` if both scales are possible.
    #[must_use]
    pub fn decide(brightest: f32) -> Option<Self> {
        if brightest > MIN_OF_255 {
            Some(Self::Grey255)
        } else {
            (brightest <= MAX_OF_ONE).then_some(Self::One)
        }
    }

    /// The value of white.
    #[must_use]
    pub fn white(self) -> u8 {
        match self {
            Self::One => 1,
            Self::Grey255 => 255,
        }
    }

    /// Number of greys per unit.
    #[must_use]
    pub fn grey(self) -> f32 {
        match self {
            Self::One => 255.0,
            Self::Grey255 => 1.0,
        }
    }
}
