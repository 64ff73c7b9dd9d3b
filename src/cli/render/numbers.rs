//! Options with several numbers: `1,2,3`.

use glam::DVec3;
use gs2e_scene::camera::view::CameraVelocity;

/// Reads `R,G,B`, each channel 0..1.
pub(super) fn parse_colour(text: &str) -> Result<[f64; 3], String> {
    let rgb = parse_numbers(text)?;
    match rgb.iter().find(|v| !(0.0..=1.0).contains(*v)) {
        Some(bad) => Err(format!("{bad} is not between 0 and 1")),
        None => Ok(rgb),
    }
}

/// Reads `vx,vy,vz,wx,wy,wz`.
pub(super) fn parse_velocity(text: &str) -> Result<CameraVelocity, String> {
    let [vx, vy, vz, wx, wy, wz] = parse_numbers(text)?;
    Ok(CameraVelocity { linear: DVec3::new(vx, vy, vz), angular: DVec3::new(wx, wy, wz) })
}

/// Reads a moment of a scene, s.
pub(super) fn parse_moment(text: &str) -> Result<f64, String> {
    let [value] = parse_numbers(text)?;
    if value >= 0.0 { Ok(value) } else { Err(format!("{value} is below 0")) }
}

/// Reads a number above 0.
pub(super) fn parse_positive(text: &str) -> Result<f64, String> {
    let [value] = parse_numbers(text)?;
    if value > 0.0 { Ok(value) } else { Err(format!("{value} is not above 0")) }
}

/// Reads `N` finite numbers, separated by commas.
fn parse_numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let number = |part: &str| {
        let value = part.trim().parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| format!("`{part}` is not a finite number"))
    };
    let values: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
    let found = values.len();
    values.try_into().map_err(|_| format!("found {found} numbers, wanted {N} separated by commas"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_many_as_are_wanted() {
        assert_eq!(parse_colour("0, .5,1"), Ok([0.0, 0.5, 1.0]));
        let wanted =
            CameraVelocity { linear: DVec3::new(-1.0, 2e3, 0.0), angular: DVec3::new(0.5, -0.0, 7.0) };
        assert_eq!(parse_velocity("-1,2e3,0,.5,-0,7"), Ok(wanted));
        let t = |text: &str, wanted: &str| assert_eq!(parse_colour(text).unwrap_err(), wanted, "{text}");
        t("", "`` is not a finite number");
        t("1,2", "found 2 numbers, wanted 3 separated by commas");
        t("1,0,0,1", "found 4 numbers, wanted 3 separated by commas");
        t("1,,0", "`` is not a finite number");
        t("1,nan,0", "`nan` is not a finite number");
        t("1,0,1e999", "`1e999` is not a finite number");
        t("255,0,0", "255 is not between 0 and 1");
        t("0,-0.1,0", "-0.1 is not between 0 and 1");
        assert_eq!((parse_moment("0"), parse_positive("2.5")), (Ok(0.0), Ok(2.5)));
        assert_eq!(parse_moment("-1").unwrap_err(), "-1 is below 0");
        assert_eq!(parse_positive("0").unwrap_err(), "0 is not above 0");
    }
}
