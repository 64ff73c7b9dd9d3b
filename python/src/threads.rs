//! Threads of a call.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Threads for one call; 0 is one for each core. Each call has its own, because a process that was
/// forked does not have the threads of its parent's pool, and would wait for them forever.
pub(crate) fn call_pool(threads: usize) -> PyResult<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| PyRuntimeError::new_err(error.to_string()))
}
