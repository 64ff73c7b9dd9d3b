//! The sensor as Python sees it.

use gs2e_recipe::{RecipeFaults, read_sensor, sensor_from_text};
use gs2e_sensor::SensorChoice;
use gs2e_sensor::voltmeter::BetweenFrames;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

pyo3::import_exception!(gs2e._errors, RecipeError);

/// A sensor with all its parameters.
#[pyclass(frozen, eq, module = "gs2e._native")]
#[derive(Clone, PartialEq)]
pub(crate) struct Sensor(pub(crate) SensorChoice);

#[pymethods]
impl Sensor {
    /// The sensor with this name; `None` if no sensor has it.
    #[staticmethod]
    fn by_name(name: &str) -> Option<Self> {
        SensorChoice::by_name(name).map(Self)
    }

    /// The names of `by_name`.
    #[staticmethod]
    fn names() -> Vec<&'static str> {
        SensorChoice::NAMES.to_vec()
    }

    /// The sensor of a file; `name` is the name of one of several.
    #[staticmethod]
    #[pyo3(signature = (path, name=None))]
    fn from_file(path: PathBuf, name: Option<&str>) -> PyResult<Self> {
        read_sensor(&path, name).map(Self).map_err(|faults| recipe_error(&faults))
    }

    /// The sensor of a text as in a recipe; faults name the text as `display_path`.
    #[staticmethod]
    fn from_text(text: String, display_path: &str) -> PyResult<Self> {
        sensor_from_text(text, Path::new(display_path), None)
            .map(Self)
            .map_err(|faults| recipe_error(&faults))
    }

    /// The sensor with all parameters as `to_json` writes them.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        serde_json::from_str(text).map(Self).map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// All parameters.
    fn to_json(&self) -> PyResult<String> {
        serde_json::to_string(&self.0).map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// The name of its model in recipes.
    #[getter]
    fn model(&self) -> &'static str {
        self.0.name()
    }

    /// Changes of ln(brightness) that make one ON and one OFF event.
    #[getter]
    fn contrast(&self) -> (f64, f64) {
        self.0.as_model().contrast()
    }

    /// The interpolation between frames.
    #[getter]
    fn between(&self) -> &'static str {
        match self.0.between() {
            BetweenFrames::Linear => "linear",
            BetweenFrames::Catmull => "catmull",
            BetweenFrames::Hermite => "hermite",
        }
    }

    /// True if events are labelled as signal or noise.
    #[getter]
    fn labels(&self) -> bool {
        self.0.as_model().labels()
    }

    /// The sensor with other contrast thresholds, ON and OFF.
    fn with_contrast(&self, on: f64, off: f64) -> PyResult<Self> {
        if [on, off].iter().all(|value| *value > 0.0 && value.is_finite()) {
            return Ok(Self(self.0.as_model().with_contrast(on, off)));
        }
        Err(PyValueError::new_err(format!("threshold is ({on}, {off}), wanted numbers above 0")))
    }

    /// The sensor with another interpolation between frames.
    fn with_between(&self, name: &str) -> PyResult<Self> {
        let between = match name {
            "linear" => BetweenFrames::Linear,
            "catmull" => BetweenFrames::Catmull,
            "hermite" => BetweenFrames::Hermite,
            _ => {
                let what = format!("between is {name:?}, wanted \"linear\", \"catmull\" or \"hermite\"");
                return Err(PyValueError::new_err(what));
            }
        };
        let changed = self.0.with_between(between);
        if changed.between() == between {
            return Ok(Self(changed));
        }
        let what =
            format!("between={name:?} applies to the sensor voltmeter, but this sensor is {}", self.0.name());
        Err(PyValueError::new_err(what))
    }

    /// The sensor with labels, or with a cap that drops events, switched on.
    fn switched(&self, labels: bool, allow_cap: bool) -> Self {
        let mut settings = self.0.settings();
        settings.labels |= labels;
        settings.allow_cap |= allow_cap;
        Self(self.0.clone().with_settings(settings))
    }
}

/// The exception for faults of a recipe: its text, and one dictionary as JSON for each fault.
pub(crate) fn recipe_error(faults: &RecipeFaults) -> PyErr {
    let listed = serde_json::Value::Array(faults.to_json());
    RecipeError::new_err((faults.to_string(), listed.to_string(), faults.more()))
}
