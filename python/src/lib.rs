//! `gs2e._native`: the part of the Python module that is compiled. `gs2e/__init__.py` is the interface.
//!
//! A simulation runs in threads of its own without the lock of the interpreter. The calling thread stays in
//! Python: it takes frames from the caller and looks for Ctrl-C.

mod frames;
mod received;
mod recipe;
mod scene;
mod sensor;
mod simulate;
mod threads;
mod trajectory;

use pyo3::prelude::*;

/// The compiled part of the module.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::recipe::read_recipes;
    #[pymodule_export]
    use crate::scene::SplatScene;
    #[pymodule_export]
    use crate::sensor::Sensor;
    #[pymodule_export]
    use crate::simulate::{simulate, simulate_to_file};
    #[pymodule_export]
    use crate::trajectory::make_trajectory;
}
