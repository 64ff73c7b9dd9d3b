//! Places of events among some pixels of an image.

use gs2e_event::Event;
use gs2e_image::Size;

/// The place of each pixel in a list of pixels, by the index of the pixel.
pub(super) struct PixelPlaces {
    width: usize,
    places: Vec<Option<usize>>,
}

impl PixelPlaces {
    pub(super) fn new(size: Size, pixels: &[usize]) -> Self {
        let mut places = vec![None; size.pixels()];
        for (place, pixel) in pixels.iter().enumerate() {
            places[*pixel] = Some(place);
        }
        Self { width: size.width as usize, places }
    }

    /// The place of an event's pixel, if it is listed.
    pub(super) fn of(&self, event: &Event) -> Option<usize> {
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        self.places.get(y * self.width + x).copied().flatten().filter(|_| x < self.width)
    }
}

/// The quadrant of a pixel, 0 to 3: errors are estimated from quadrants.
pub(super) fn quadrant(size: Size, pixel: usize) -> usize {
    let (width, height) = (size.width as usize, size.height as usize);
    let (x, y) = (pixel % width, pixel / width);
    usize::from(2 * x >= width) + 2 * usize::from(2 * y >= height)
}
