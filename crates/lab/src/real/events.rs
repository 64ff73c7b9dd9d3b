//! The events of a recording in memory, 12 bytes each.

/// Events in order of time.
#[derive(Debug, Clone, Default)]
pub(super) struct PackedEvents {
    us: Vec<i64>,
    /// Twice the pixel, and 1 for ON.
    codes: Vec<u32>,
}

/// An event that counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CountedEvent {
    pub(super) us: i64,
    /// Row by row.
    pub(super) pixel: usize,
    pub(super) is_on: bool,
}

impl CountedEvent {
    /// 1 for ON, -1 for OFF.
    pub(super) fn sign(self) -> i32 {
        if self.is_on { 1 } else { -1 }
    }
}

impl PackedEvents {
    /// Adds an event, which is not before the last one.
    pub(super) fn push(&mut self, event: CountedEvent) {
        let code = u32::try_from(2 * event.pixel).expect("a sensor has less than 2^31 pixels");
        self.us.push(event.us);
        self.codes.push(code | u32::from(event.is_on));
    }

    /// The events from one time to before another.
    pub(super) fn between(&self, from_us: i64, to_us: i64) -> impl Iterator<Item = CountedEvent> {
        let place = |us: i64| self.us.partition_point(|t| *t < us);
        let range = place(from_us)..place(to_us).max(place(from_us));
        self.us[range.clone()].iter().zip(&self.codes[range]).map(|(us, code)| CountedEvent {
            us: *us,
            pixel: (code / 2) as usize,
            is_on: code % 2 == 1,
        })
    }
}
