//! `gs2e study sensor`: the answers of a sensor to steps and to constant light.

use crate::cli::simulate::sensor_from;
use crate::cli::{CommonArgs, Console, ExitKind, VerbError, output};
use gs2e_lab::sensor::noise_curve::NoiseTrial;
use gs2e_lab::sensor::picture::study_svg;
use gs2e_lab::sensor::{ContrastRow, NoiseRow, SensorStudy, measure_contrast, measure_noise};
use gs2e_sensor::SensorChoice;
use gs2e_sensor::voltmeter::VoltmeterPreset;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Arguments of `study sensor`.
#[derive(Debug, clap::Args)]
pub(super) struct SensorArgs {
    /// Preset (davis346, evk4, dvxplorer, dvs346-paper, dvs240, gs2e-si), recipe, or file with the content of a
    /// recipe's `sensor`
    #[arg(value_name = "PRESET or FILE")]
    sensor: String,
    /// Light on the sensor at grey 255 in lux, for the presets davis346, evk4 and dvxplorer [default: 250]
    #[arg(long, value_name = "LUX")]
    lux: Option<f64>,
    /// File for the picture, a .svg
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

impl SensorArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        output::screen_outputs(self.picture.as_deref(), [Path::new(&self.sensor)], console.json)?;
        let sensor = sensor_from(&self.sensor, self.lux, 0)?.0;
        common.limit_cores();
        let failed = |e| VerbError::failed("step-failed", format!("failed to simulate: {e}"));
        let anchors = VoltmeterPreset::ALL.into_iter().find(|preset| is_preset(*preset, &sensor));
        let anchors = anchors.map_or(&[][..], VoltmeterPreset::noise_anchors);
        let study = SensorStudy {
            contrast: measure_contrast(&sensor, &sensor, 1.0).map_err(failed)?,
            noise: measure_noise(&sensor, anchors, NoiseTrial::DEFAULT).map_err(failed)?,
        };
        if let Some(path) = &self.picture {
            let picture = study_svg(&self.sensor, &sensor, &study);
            output::write_output(path, |out| out.write_all(picture.as_bytes()))?;
        }
        self.report(&sensor, &study, console);
        Ok(if study.passes() { ExitKind::Done } else { ExitKind::Fault })
    }

    fn report(&self, sensor: &SensorChoice, study: &SensorStudy, console: &Console) {
        if console.json {
            console.result(&json!({
                "sensor": sensor, "contrast": study.contrast, "noise": study.noise,
                "passes": study.passes(),
            }));
            return;
        }
        let front_end = sensor.as_model().front_end();
        console.print(&format!("{}: {}; brightness: {front_end}", self.sensor, sensor.name()));
        console.print("contrast     grey  stated   50 %     off by   spread   stated");
        study.contrast.iter().for_each(|row| console.print(&contrast_line(row)));
        console.print("noise        lux or grey  ON Hz    OFF Hz    predicted            published");
        study.noise.rows.iter().for_each(|row| console.print(&noise_line(row)));
        let found = &study.noise;
        if let (Some([median, worst]), Some(share)) = (found.factors, found.share) {
            console.print(&format!(
                "published rates: within a factor of {median:.2} (median) and {worst:.2} (worst); ON share within {share:.3}"
            ));
        }
        if let Some(least) = found.least_us {
            let dead = sensor.dead_us();
            console.print(&format!(
                "shortest time between two events of a pixel: {least} us, dead time {dead} us"
            ));
        }
        let verdict = |passes: bool| if passes { "pass" } else { "FAIL" };
        let contrast = verdict(study.contrast.iter().all(|row| row.passes));
        console.print(&format!("contrast: {contrast}, noise_curve: {}", verdict(found.passes)));
    }
}

/// Returns true if a sensor is a preset at some light, with or without labels.
fn is_preset(preset: VoltmeterPreset, sensor: &SensorChoice) -> bool {
    let Some(found) = sensor.as_voltmeter() else { return false };
    let lux = found.settings.front_end.white_lux();
    SensorChoice::from(preset.model_at(lux)).effective() == sensor.effective()
}

fn contrast_line(row: &ContrastRow) -> String {
    let ContrastRow { grey, on, stated, found, stated_spread, found_spread, passes, .. } = row;
    let side = if *on { "ON " } else { "OFF" };
    let (found, off) = match found {
        Some(found) => (format!("{found:.4}"), format!("{:+.2} %", 100.0 * (found / stated - 1.0))),
        None => ("none".to_owned(), "-".to_owned()),
    };
    let verdict = if *passes { "" } else { "  FAIL" };
    format!(
        "  {side}    {grey:9}  {stated:.4}   {found:7}  {off:7}  {found_spread:.4}   {stated_spread:.4}{verdict}"
    )
}

fn noise_line(row: &NoiseRow) -> String {
    let NoiseRow { grey, lux, predicted, found, anchor, holds } = row;
    let light = lux.map_or_else(|| format!("grey {grey:.1}"), |lux| format!("{lux:.2} lux"));
    let published = anchor.map_or_else(|| "-".to_owned(), |[on, off]| format!("{on} / {off}"));
    let verdict = if *holds { "" } else { "  FAIL" };
    let [[on, off], [on_hz, off_hz]] = [*found, *predicted];
    format!("  {light:>20}  {on:.4}   {off:.4}    {on_hz:.4} / {off_hz:.4}      {published}{verdict}")
}
