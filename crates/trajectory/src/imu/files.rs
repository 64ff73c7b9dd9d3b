//! Files of inertial data, in the form of the EuRoC MAV dataset (Burri et al. 2016): `imu.csv` is its
//! `imu0/data.csv`, `state.csv` its `state_groundtruth_estimate0/data.csv`, and `sensor.yaml` its
//! `imu0/sensor.yaml`.

use super::{ImuModel, ImuSample, ImuState};
use glam::DVec3;
use gs2e_files::budget::ByteBudget;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

/// The names of the files.
pub const SAMPLES: &str = "imu.csv";
/// The truth at each sample.
pub const STATES: &str = "state.csv";
/// The sensor.
pub const SENSOR: &str = "sensor.yaml";

/// Most characters of a value that a sentence shows.
const MAX_CHARS: usize = 60;

/// The first line of the samples.
pub const SAMPLES_HEAD: &str = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],\
                                a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]";
/// The first line of the states.
pub const STATES_HEAD: &str = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],\
     v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],\
     b_w_RS_S_z [rad s^-1],b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]";

/// Writes one line of the samples.
///
/// # Errors
/// `out` takes no more.
pub fn write_sample(sample: &ImuSample, out: &mut dyn Write) -> io::Result<()> {
    write!(out, "{}", sample.t_ns)?;
    write_vector(sample.gyroscope, out)?;
    write_vector(sample.accelerometer, out)?;
    writeln!(out)
}

/// Writes one line of the states.
///
/// # Errors
/// `out` takes no more.
pub fn write_state(sample: &ImuSample, out: &mut dyn Write) -> io::Result<()> {
    let ImuState { world_from_body, velocity, gyroscope_bias, accelerometer_bias } = sample.state;
    write!(out, "{}", sample.t_ns)?;
    write_vector(world_from_body.translation, out)?;
    let q = world_from_body.rotation;
    write!(out, ",{}", q.w)?;
    write_vector(DVec3::new(q.x, q.y, q.z), out)?;
    for vector in [velocity, gyroscope_bias, accelerometer_bias] {
        write_vector(vector, out)?;
    }
    writeln!(out)
}

/// Reads a file of samples or states: the stamp of each line, ns, and its values.
///
/// # Errors
/// A line is missing or has other columns, a value is not a finite number, or stamps do not increase.
pub fn read_lines(bytes: &[u8], head: &str) -> Result<Vec<(i64, Vec<f64>)>, String> {
    let mut budget = ByteBudget::of(bytes.len());
    let mut found = Vec::new();
    for line in InertialText::new(bytes, head)? {
        let (stamp, values) = line?;
        // A list with its head and the word of the allocator in front of it.
        budget
            .take(1, size_of::<(i64, Vec<f64>)>() + size_of_val(&*values) + 16)
            .map_err(|e| e.to_string())?;
        found.push((stamp, values));
    }
    Ok(found)
}

/// The lines of a file of samples or states.
struct InertialText<'a> {
    lines: std::iter::Zip<std::ops::RangeFrom<usize>, std::str::Lines<'a>>,
    columns: usize,
    last: Option<i64>,
}

impl<'a> InertialText<'a> {
    /// Begins behind the first line, which must be `head`.
    fn new(bytes: &'a [u8], head: &str) -> Result<Self, String> {
        let mut lines = std::str::from_utf8(bytes).map_err(|e| e.to_string())?.lines();
        let first = lines.next().unwrap_or_default();
        if first != head {
            let shown: String = first.chars().take(head.len()).collect();
            return Err(format!("its first line is `{shown}`"));
        }
        Ok(Self { lines: (2..).zip(lines), columns: head.split(',').count(), last: None })
    }

    fn parse(&mut self, line: &str) -> Result<(i64, Vec<f64>), &'static str> {
        let (stamp, values) = line.split_once(',').ok_or("it has one column")?;
        let stamp: i64 = stamp.parse().map_err(|_| "its stamp is no whole number")?;
        if self.last.replace(stamp).is_some_and(|before| stamp <= before) {
            return Err("its stamp is not above the one before");
        }
        if values.split(',').count() + 1 != self.columns {
            return Err("it has another number of columns");
        }
        let value = |text: &str| text.parse().ok().filter(|value: &f64| value.is_finite());
        let values: Option<Vec<f64>> = values.split(',').map(value).collect();
        Ok((stamp, values.ok_or("a value is not a finite number")?))
    }
}

impl Iterator for InertialText<'_> {
    type Item = Result<(i64, Vec<f64>), String>;

    fn next(&mut self) -> Option<Self::Item> {
        let (number, line) = self.lines.next()?;
        Some(self.parse(line).map_err(|what| format!("line {number}: {what}")))
    }
}

/// Returns true if a file of samples or states is in the form that this program writes.
///
/// # Errors
/// As [`read_lines`].
pub fn is_canonical(bytes: &[u8]) -> Result<bool, String> {
    let is_states = bytes.starts_with(STATES_HEAD.as_bytes());
    let head = if is_states { STATES_HEAD } else { SAMPLES_HEAD };
    let mut texts = std::str::from_utf8(bytes).map_err(|e| e.to_string())?.split_inclusive('\n');
    let mut is_same = texts.next().is_some_and(|first| first.strip_suffix('\n') == Some(head));
    for line in InertialText::new(bytes, head)? {
        let (stamp, values) = line?;
        let values: String = values.iter().map(|value| format!(",{value}")).collect();
        is_same &= texts.next() == Some(format!("{stamp}{values}\n").as_str());
    }
    Ok(is_same)
}

/// The differences of a text of [`sensor_text`] from the sensor with this gravity, one sentence each: values
/// are compared as numbers where they are some, and as words otherwise.
///
/// # Errors
/// The text is no UTF-8, or has a line outside of a key.
pub fn sensor_differences(bytes: &[u8], model: &ImuModel, gravity: DVec3) -> Result<Vec<String>, String> {
    let text = std::str::from_utf8(bytes).map_err(|e| e.to_string())?;
    let own = sensor_text(model, gravity);
    let (found, wanted) = (sensor_values(text)?, sensor_values(&own)?);
    let keys: BTreeSet<&String> = found.keys().chain(wanted.keys()).collect();
    // A text of another origin may be long.
    let shown = |values: Option<&Vec<&str>>| -> String {
        values.map_or("absent".to_owned(), |values| values.join(" ").chars().take(MAX_CHARS).collect())
    };
    let differs = |key: &&String| {
        let (found, wanted) = (found.get(*key), wanted.get(*key));
        let are_same = |(a, b): (&Vec<&str>, &Vec<&str>)| {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_same_value(a, b))
        };
        let same = found.zip(wanted).is_some_and(are_same);
        (!same).then(|| format!("its {key} is {}, wanted {}", shown(found), shown(wanted)))
    };
    Ok(keys.iter().filter_map(differs).collect())
}

/// The values of each key of a text of [`sensor_text`], which may go on over several lines.
fn sensor_values(text: &str) -> Result<BTreeMap<String, Vec<&str>>, String> {
    let mut found = BTreeMap::<String, Vec<&str>>::new();
    let mut key: Option<String> = None;
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.split('#').next().unwrap_or_default();
        let (own, values) =
            line.split_once(':').map_or((None, line), |(own, values)| (Some(own.trim()), values));
        key = own.map(str::to_owned).or(key);
        let values = values.split([',', '[', ']', ' ']).filter(|value| !value.is_empty());
        match &key {
            Some(key) => found.entry(key.clone()).or_default().extend(values),
            None if line.trim().is_empty() => {}
            None => return Err(format!("line {number} belongs to no key")),
        }
    }
    Ok(found)
}

/// Returns true for equal numbers, and for equal words.
fn is_same_value(found: &str, wanted: &str) -> bool {
    let number = |text: &str| text.parse::<f64>().ok();
    match (number(found), number(wanted)) {
        (Some(a), Some(b)) => (a - b).abs() <= 0.0,
        _ => found == wanted,
    }
}

/// Gravity in a text of [`sensor_text`], m/s^2 in world axes.
///
/// # Errors
/// There is no line with three numbers.
pub fn read_gravity(bytes: &[u8]) -> Result<DVec3, String> {
    let text = std::str::from_utf8(bytes).map_err(|e| e.to_string())?;
    let line = text.lines().find_map(|line| line.strip_prefix("gravity: ["));
    let values: Option<Vec<f64>> = line
        .and_then(|line| line.split_once(']'))
        .and_then(|(values, _)| values.split(',').map(|v| v.trim().parse().ok()).collect());
    match values.as_deref() {
        Some(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
        _ => Err("it has no line `gravity: [x, y, z]`".to_owned()),
    }
}

/// Each number in the fewest digits that give it back.
fn write_vector(v: DVec3, out: &mut dyn Write) -> io::Result<()> {
    write!(out, ",{},{},{}", v.x, v.y, v.z)
}

/// The sensor in YAML, with the gravity that it feels, m/s^2 in world axes.
#[must_use]
pub fn sensor_text(model: &ImuModel, gravity: DVec3) -> String {
    let ImuModel { rate, gyroscope, accelerometer, metres_per_unit, .. } = model;
    format!(
        "# In the form of EuRoC. S: sensor, which is the camera with OpenCV axes. R: world axes of the scene, in metres.\n\
         sensor_type: imu\n\
         T_BS:\n  cols: 4\n  rows: 4\n  data: [1.0, 0.0, 0.0, 0.0,\n         0.0, 1.0, 0.0, 0.0,\n         \
         0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\n\
         rate_hz: {}\n\
         gyroscope_noise_density: {}      # rad/s/sqrt(Hz)\n\
         gyroscope_random_walk: {}        # rad/s^2/sqrt(Hz)\n\
         accelerometer_noise_density: {}  # m/s^2/sqrt(Hz)\n\
         accelerometer_random_walk: {}    # m/s^3/sqrt(Hz)\n\
         gravity: [{}, {}, {}]            # m/s^2, in R\n\
         metres_per_unit: {}              # of the scene; the poses of the release are in its units\n",
        rate.to_f64(),
        gyroscope.noise,
        gyroscope.walk,
        accelerometer.noise,
        accelerometer.walk,
        gravity.x,
        gravity.y,
        gravity.z,
        metres_per_unit,
    )
}
