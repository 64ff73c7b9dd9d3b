//! Lines in front of barriers, at many points of many cells.

use super::*;
use fearless_simd::{Level, dispatch};
use gs2e_num::seed::{DrawSpace, Seed, SeedCell};

/// A span, the voltages at its ends, thresholds, and how far drift and Brownian motion stray.
type Case = (PathSpan, [f64; 2], Barriers, [f64; 2]);

/// Spans of all lengths beside `1 / theta`, with noise and voltages anywhere.
fn cases(n: u64) -> impl Iterator<Item = Case> {
    (0..n).map(|index| {
        let mut draws = Seed(3).draws(SeedCell { x: 0, y: 0, level: 0, index }, DrawSpace::Leaf);
        let mut between = |low: f64, high: f64| low + (high - low) * draws.uniform();
        let point = |time, noise| PathPoint { time, noise, motion: 0.0, drift: 0.0 };
        let barriers = Barriers { up: between(0.5, 2.0), down: between(0.5, 2.0) };
        let deviation = libm::exp(between(-4.0, 0.0));
        let length = libm::exp(between(5.0, 14.0));
        let rate = libm::exp(between(-6.0, 1.5)) / length;
        let mut noise = || between(-3.0, 3.0) * deviation;
        let (from, to) = (point(7.0, noise()), point(7.0 + length, noise()));
        let voltage = [between(-barriers.down, barriers.up), between(-barriers.down, barriers.up)];
        let stray = [libm::exp(between(-20.0, -3.0)), between(0.0, 0.05)];
        (PathSpan { from, to, rate, deviation }, voltage, barriers, stray)
    })
}

/// The lines are curves whose second derivative is `theta^2` times themselves. No point of them may be behind
/// the barrier as the noise sees it, which moves with the chord of the rest of the voltage, less what that
/// strays.
#[test]
fn lines_lie_in_front_of_barriers() {
    let mut decided = 0;
    for (span, [x, y], barriers, stray) in cases(20_000) {
        let Some(lines) = BarrierLines::new(&span, [x, y], barriers, stray) else { continue };
        decided += 1;
        let (from, to, whole) = (span.from.noise, span.to.noise, span.rate * span.length());
        let margin = stray[0] + stray[1];
        for (sign, [a, g], [near, far]) in [
            (1.0, lines.distances[0], [barriers.up - x, barriers.up - y]),
            (-1.0, lines.distances[1], [barriers.down + x, barriers.down + y]),
        ] {
            for i in 0..=40 {
                let s = f64::from(i) / 40.0;
                let [after, before] = [1.0 - s, s].map(|s| libm::sinh(whole * s) / libm::sinh(whole));
                let line = (sign * from + a) * after + (sign * to + g) * before;
                let barrier = (sign * from + near) * (1.0 - s) + (sign * to + far) * s;
                assert!(line <= barrier - margin + 1e-12, "{span:?} {s}: {line} {barrier} {margin}");
            }
        }
    }
    assert!(decided > 2000, "{decided}");
}

#[test]
fn eight_pixels_have_the_lines_of_each() {
    for (span, [x, y], barriers, [straying, motion]) in cases(2000) {
        let wanted = BarrierLines::new(&span, [x, y], barriers, [straying, motion]);
        let found = dispatch!(Level::new(), simd => {
            let all = |value| f64x8::splat(simd, value);
            let cell = WideCell {
                shape: WideShape::new(all(libm::exp(-span.rate * span.length()))),
                deviation: all(span.deviation),
                ends: [all(span.from.noise), all(span.to.noise)],
                voltage: [all(x), all(y)],
                straying: all(straying),
                motion: all(motion),
            };
            let lines = cell.lines(WideBarriers::splat(simd, barriers));
            // The number 0 leaves every pixel open.
            assert_eq!(lines.open(all(0.0)), lines.decided);
            (lines.decided, lines.of(5))
        });
        assert_eq!(found.0, if wanted.is_some() { 0xff } else { 0 }, "{span:?}");
        if let Some(BarrierLines { distances, spread }) = wanted {
            assert_eq!((distances, spread), (found.1.distances, found.1.spread));
        }
    }
}

/// A touched line is touched at a point of the line.
#[test]
fn touches_lie_on_their_line() {
    let mut draws = Seed(4).draws(SeedCell { x: 0, y: 0, level: 0, index: 0 }, DrawSpace::Leaf);
    for (span, voltage, barriers, stray) in cases(2000) {
        let Some(lines) = BarrierLines::new(&span, voltage, barriers, stray) else { continue };
        for (sign, side) in [(1.0, BarrierSide::Up), (-1.0, BarrierSide::Down)] {
            let [a, g] = lines.distances[usize::from(sign < 0.0)];
            let [after, noise] = lines.touch(&span, side, &mut draws);
            let length = span.length();
            assert!((0.0..=length).contains(&after), "{after} of {length}");
            let [before, rest, whole] = [after, length - after, length].map(|t| libm::sinh(span.rate * t));
            let (from, to) = (span.from.noise + sign * a, span.to.noise + sign * g);
            let wanted = (from * rest + to * before) / whole;
            assert!((noise - wanted).abs() < 1e-9, "{noise} {wanted}");
        }
    }
}
