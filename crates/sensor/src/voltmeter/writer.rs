//! Counts and stores the events of pixels.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "pixels have 16 bits a side; frames are below 2^32; times within a window are below 2^31 ns"
)]

use super::bridge::Barriers;
use super::leaf::EmitEvents;
use super::window::TimeStep;
use crate::window::PackedEvent;
use crate::{SensorError, SimulationAccount};
use gs2e_event::{EventLabel, Polarity};
use std::ops::ControlFlow;

/// The event counts of one pixel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PixelTally {
    on: u32,
    off: u32,
    /// Index of the frame before the latest event, and the number of events since that frame.
    frame: u32,
    since: u32,
}

impl PixelTally {
    /// Adds a pixel to the account. Events times thresholds differ from the drift over the run by
    /// noise and by the voltages at both ends; `bound` is the largest difference that is accepted.
    pub(super) fn settle(self, barriers: Barriers, drift: f64, bound: f64, account: &mut SimulationAccount) {
        let balance = barriers.up * f64::from(self.on) - barriers.down * f64::from(self.off) - drift;
        account.add_pixel(self.on, self.off, balance.abs() / bound);
    }

    /// Counts an event, and returns the number of events since the frame before it.
    fn count(&mut self, polarity: Polarity, frame: u32) -> u32 {
        match polarity {
            Polarity::On => self.on += 1,
            Polarity::Off => self.off += 1,
        }
        // Events of a pixel come in order of time, so a change of frame starts a new count.
        self.since = if self.frame == frame { self.since + 1 } else { 1 };
        self.frame = frame;
        self.since
    }
}

/// Stores the events of a band's pixels.
#[derive(Debug)]
pub(super) struct BandWriter<'a> {
    pub(super) window: &'a TimeStep<'a>,
    /// Index of the band's first pixel.
    pub(super) first: usize,
    pub(super) tally: &'a mut [PixelTally],
    pub(super) events: &'a mut Vec<PackedEvent>,
    /// Largest number of events of one pixel between two frames.
    pub(super) most: &'a mut u32,
    pub(super) capped: &'a mut Option<SensorError>,
    /// `ln(L + k2)` of each pixel at its last event. Only for labelled events.
    pub(super) logs: Option<&'a mut [f64]>,
}

impl BandWriter<'_> {
    /// A sink for the events of one pixel of the band, at this position on the sensor (`y << 16 |
    /// x`).
    #[inline(always)]
    pub(super) fn of(&mut self, pixel: usize, seat: u64) -> impl EmitEvents {
        let [left, top] = self.window.law.origin;
        PixelPen { at: [seat as u16 - left, (seat >> 16) as u16 - top], pixel, writer: self }
    }
}

struct PixelPen<'a, 'b> {
    writer: &'a mut BandWriter<'b>,
    pixel: usize,
    at: [u16; 2],
}

impl EmitEvents for PixelPen<'_, '_> {
    #[inline(always)]
    fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()> {
        let Self { writer, pixel, at } = self;
        let window = writer.window;
        // Before the count: an event after the last stamp is not made, so it cannot exceed the cap.
        if t > window.last {
            return ControlFlow::Continue(());
        }
        // An event exactly at a stamp belongs to the interval before it.
        let legs = &window.legs;
        let leg = &legs[legs.iter().position(|leg| t <= leg.to).unwrap_or(legs.len() - 1)];
        let frame = leg.frame;
        let count = writer.tally[*pixel].count(polarity, window.frames[frame].index as u32);
        *writer.most = count.max(*writer.most);
        if count > window.law.cap {
            // Other pixels of the band may go on after a failure. The first one stays.
            if writer.capped.is_none() {
                *writer.capped = Some(writer.too_many(*pixel, frame));
            }
            return ControlFlow::Break(());
        }
        let ns = t as u64 + window.into_microsecond;
        let label = match &mut writer.logs {
            None => EventLabel::Signal,
            Some(logs) => {
                let place = writer.first + *pixel;
                window.label(place, window.rise(place, leg, t, &mut logs[*pixel]), polarity)
            }
        };
        writer.events.push(PackedEvent::new(ns, *at, polarity, label));
        ControlFlow::Continue(())
    }
}

impl BandWriter<'_> {
    fn too_many(&self, pixel: usize, frame: usize) -> SensorError {
        let pixel = self.first + pixel;
        let [x, y] = self.window.law.at(pixel);
        let before = self.window.frames[frame];
        // Past the last frame the luminance stays, so that frame is both ends of the leg.
        let after = self.window.frames.get(frame + 1).unwrap_or(&before);
        SensorError::Cap {
            x,
            y,
            frame: before.index,
            before: before.luminance[pixel],
            after: after.luminance[pixel],
            cap: self.window.law.cap,
        }
    }
}
