use super::lit::{LitMap, LitValue};
use super::*;
use gs2e_image::{Image, Size, luminance, srgb};

fn flicker(waveform: Waveform, hz: f64, depth: f64, phase: f64) -> SceneLights {
    SceneLights { flicker: Some(Flicker { hz, depth, waveform, phase }), level: Vec::new() }
}

const WAVEFORMS: [Waveform; 3] = [Waveform::Sine, Waveform::Square, Waveform::Rectified];

fn ramp() -> Vec<LevelMoment> {
    [(0.1, 0.0), (0.3, 2.0), (0.4, -1.0)].map(|(t, stops)| LevelMoment { t, stops }).to_vec()
}

/// A period of 10 ms, in 100,000 steps: the midpoint rule misses the kinks and jumps by a step at most.
#[test]
fn the_mean_of_a_period_is_one_and_its_range_is_that_of_the_depth() {
    for waveform in WAVEFORMS {
        let lights = flicker(waveform, 100.0, 0.6, 0.3);
        let factors: Vec<f64> = (0..100_000).map(|i| lights.at((f64::from(i) + 0.5) * 1e-7).factor).collect();
        let mean = factors.iter().sum::<f64>() / 1e5;
        assert!((mean - 1.0).abs() < 2e-5, "{waveform:?}: {mean}");
        let least = factors.iter().copied().fold(f64::INFINITY, f64::min);
        let most = factors.iter().copied().fold(0.0, f64::max);
        let wanted = if waveform == Waveform::Rectified { 1.0 + 0.6 * (FRAC_PI_2 - 1.0) } else { 1.6 };
        // The darkest point of the rectified sine is a kink, which the steps miss by their slope.
        assert!((least - 0.4).abs() < 1e-4 && (most - wanted).abs() < 1e-6, "{waveform:?}: {least} {most}");
    }
}

/// Central differences: their error is `h^2 / 6` times a third derivative of at most 2 (2 pi 100)^3 = 5e8, so
/// 1e-4, and rounding over `h`.
#[test]
fn the_rate_is_the_derivative() {
    let h = 1e-6;
    for waveform in WAVEFORMS {
        let lights = SceneLights { level: ramp(), ..flicker(waveform, 100.0, 0.9, 0.123) };
        for i in 0..500 {
            let t = f64::from(i) * 1e-3 + 2.15e-4;
            let [before, after] = [-h, h].map(|by| lights.at(t + by).factor);
            let found = (after - before) / (2.0 * h);
            let LightAt { rate, .. } = lights.at(t);
            // Between these times, no kink and no jump lies within h.
            assert!((found - rate).abs() < 1e-2, "{waveform:?} at {t}: {found}, {rate}");
        }
    }
}

#[test]
fn a_square_wave_jumps_at_the_stamps_of_its_half_periods() {
    let lights = flicker(Waveform::Square, 100.0, 0.5, 0.0);
    for half in 0..20_000_i64 {
        let wanted = if half % 2 == 0 { 1.5 } else { 0.5 };
        for within in [0, 1, 4_999] {
            let found = lights.at_us(5_000 * half + within).factor;
            assert!((found - wanted).abs() < 1e-12, "{half} {within}: {found}");
        }
    }
}

#[test]
fn a_level_is_linear_in_stops_between_its_moments() {
    let lights = SceneLights { flicker: None, level: ramp() };
    for (t, stops) in [(0.0, 0.0), (0.1, 0.0), (0.2, 1.0), (0.25, 1.5), (0.35, 0.5), (0.4, -1.0), (9.0, -1.0)]
    {
        let found = lights.at(t).factor;
        assert!((libm::log2(found) - stops).abs() < 1e-12, "{t}: {found}");
    }
    assert!(lights.at(0.0).rate.abs() + lights.at(9.0).rate.abs() < 1e-300);
}

#[test]
fn full_depth_is_dark_and_never_less() {
    for waveform in WAVEFORMS {
        let lights = flicker(waveform, 50.0, 1.0, 0.75);
        let least = (0..20_001).map(|us| lights.at_us(us).factor).fold(f64::INFINITY, f64::min);
        assert!((0.0..1e-3).contains(&least), "{waveform:?}: {least}");
    }
}

#[test]
fn display_values_are_multiplied_in_linear_light() {
    for factor in [0.0, 1e-3, 0.2, 0.9, 1.0, 1.7, 30.0] {
        let map = LitMap::new(factor);
        for i in -50..1500 {
            let value = f64::from(i) / 1000.0;
            let LitValue { value: lit, by_value, by_factor } = map.with_slopes(value);
            // The pieces of the standard's curve miss each other by 3e-8 in light.
            let wanted = factor * srgb::decode(value);
            assert!((srgb::decode(lit) - wanted).abs() < 1e-7 * (1.0 + wanted), "{factor} of {value}: {lit}");
            if i == 40 || (srgb::decode(value) * factor - 0.003_13).abs() < 2e-5 {
                continue;
            }
            // The slopes, by central differences, where no piece of the curve ends.
            let h = 1e-6;
            let at = |factor: f64, value: f64| LitMap::new(factor).with_slopes(value).value;
            let found = (at(factor, value + h) - at(factor, value - h)) / (2.0 * h);
            assert!((found - by_value).abs() < 1e-3 * (1.0 + found.abs()), "{factor} of {value}: {by_value}");
            if factor > 1e-4 {
                let h = 1e-6 * factor;
                let found = (at(factor + h, value) - at(factor - h, value)) / (2.0 * h);
                let off = (found - by_factor).abs();
                assert!(off < 1e-3 * (1.0 + found.abs()), "{factor} of {value}: {by_factor}, {found}");
            }
        }
    }
}

/// Colours that change linearly with time in light that flickers: the rate is that of the product.
#[test]
fn the_rate_of_luminance_counts_both_changes() {
    let size = Size { width: 4, height: 1 };
    let lights = flicker(Waveform::Sine, 100.0, 0.5, 0.1);
    // Three greys and a colour, all above the linear piece at all moments.
    let colours = [[0.2; 3], [0.5; 3], [0.9; 3], [0.7, 0.4, 0.3]];
    let slopes = [[3.0; 3], [-4.0; 3], [0.0; 3], [2.0, -1.0, 5.0]];
    let at = |t: f64| -> Vec<[f64; 3]> {
        let moved = |(c, s): (&[f64; 3], &[f64; 3])| [0, 1, 2].map(|i| c[i] + s[i] * (t - 0.0123));
        colours.iter().zip(&slopes).map(moved).collect()
    };
    let lit = |t: f64| -> Vec<f64> {
        let factor = lights.at(t).factor;
        let lit = at(t).into_iter().map(|c| c.map(|v| srgb::encode(factor * srgb::decode(v))));
        lit.map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect()
    };
    #[expect(clippy::cast_possible_truncation, reason = "colours have 32 bits")]
    let unlit = Image::from_vec(size, at(0.0123).iter().map(|c| c.map(|v| v as f32)).collect());
    let mut grey = Image::from_vec(size, unlit.pixels().iter().map(|c| luminance(*c)).collect());
    #[expect(clippy::cast_possible_truncation, reason = "colours have 32 bits")]
    let mut rate = Image::from_vec(size, slopes.iter().map(|s| luminance(s.map(|v| v as f32))).collect());
    lights.at(0.0123).light_luminance(&unlit, &mut grey, Some(&mut rate));
    let h = 1e-6;
    for (i, wanted) in lit(0.0123).iter().enumerate() {
        assert!((f64::from(grey.pixels()[i]) - wanted).abs() < 1e-6, "{i}");
        let slope = (lit(0.0123 + h)[i] - lit(0.0123 - h)[i]) / (2.0 * h);
        // Rates of up to 100 per second in 32 bits.
        assert!((f64::from(rate.pixels()[i]) - slope).abs() < 1e-4 * (1.0 + slope.abs()), "{i}: {slope}");
    }
}

#[test]
fn steps_of_a_tolerance_follow_the_light() {
    let lights = SceneLights { level: ramp(), ..flicker(Waveform::Sine, 100.0, 0.5, 0.0) };
    let of = |from: f64, to: f64| lights.equivalent_px_s([from, to]);
    assert!((of(0.0, 0.05) - 4000.0).abs() < 1e-9);
    assert!((of(0.2, 0.21) - 4080.0).abs() < 1e-9 && (of(0.25, 0.35) - 4240.0).abs() < 1e-9);
    assert!((lights.subframes(1e-3) - 1.6).abs() < 1e-12);
}

#[test]
fn light_is_described_in_words() {
    let lights = SceneLights { level: ramp(), ..flicker(Waveform::Rectified, 100.0, 0.5, 0.0) };
    let words = "flicker of 100 Hz (rectified, depth 0.5), level from 0 to -1 stops in 3 moments";
    assert_eq!(lights.to_string(), words);
}
