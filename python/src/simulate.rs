//! Simulation of a sensor on frames from Python.

use crate::frames::FrameIterator;
use crate::received::{FrameMessage, ReceivedFrames};
use crate::sensor::Sensor;
use crate::threads::call_pool;
use gs2e_event::evt::EvtVersion;
use gs2e_event::file::{EventFile, EventFormat};
use gs2e_event::h5::ChunkFilter;
use gs2e_event::{Event, EventFileError, EventSink};
use gs2e_num::seed::Seed;
use gs2e_sensor::frames::FrameSequence as _;
use gs2e_sensor::frames::stamps::relative_stamps;
use gs2e_sensor::voltmeter::BetweenFrames;
use gs2e_sensor::{
    SensorChannel, SensorError, SimulateError, SimulatedStream, SimulationAccount, simulate_all,
};
use numpy::{IntoPyArray as _, PyArray1, PyArrayMethods as _, PyReadonlyArray1};
use pyo3::exceptions::{PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, sync_channel};

/// Frames that wait for the sensor. One is enough to convert a frame while the sensor works on another.
const WAITING: usize = 1;

/// Everything that a simulation needs besides the frames.
#[derive(FromPyObject)]
pub(crate) struct SimulationRequest<'py> {
    stamps_us: PyReadonlyArray1<'py, i64>,
    rates: Option<Bound<'py, PyAny>>,
    sensor: Py<Sensor>,
    seed: u64,
    full_scale: Option<u32>,
    origin: (u16, u16),
    threads: Option<usize>,
}

/// The columns of the events: t, x, y, p, and the labels if the sensor writes them.
type Columns<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<u16>>,
    Bound<'py, PyArray1<u16>>,
    Bound<'py, PyArray1<u8>>,
    Option<Bound<'py, PyArray1<u8>>>,
);

/// The events in memory: columns, and the counts as JSON.
#[pyfunction]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    frames: &Bound<'py, PyAny>,
    request: SimulationRequest<'py>,
) -> PyResult<(Columns<'py>, String)> {
    let run = SimulationRun::new(frames, &request)?;
    let mut columns = EventColumns::new(run.stamps_us[0], run.sensor.0.as_model().labels());
    let account =
        run.drive(py, |setup, frames| setup.simulate(frames, &mut columns).map_err(RunFailure::from))?;
    let EventColumns { t, x, y, p, label, .. } = columns;
    let label = label.map(|label| label.into_pyarray(py));
    let columns = (t.into_pyarray(py), x.into_pyarray(py), y.into_pyarray(py), p.into_pyarray(py), label);
    Ok((columns, to_json(&account)))
}

/// The events in a file, which appears when it is complete; returns the counts as JSON.
#[pyfunction]
pub(crate) fn simulate_to_file<'py>(
    py: Python<'py>,
    out: PathBuf,
    filter: &str,
    frames: &Bound<'py, PyAny>,
    request: SimulationRequest<'py>,
) -> PyResult<String> {
    let format = EventFormat::for_output(&out, EvtVersion::Evt2).ok_or_else(|| {
        let what =
            format!("{}: not an event format; wanted .h5, .npz, .raw, .aedat4, .txt or .csv", out.display());
        PyValueError::new_err(what)
    })?;
    let filter: ChunkFilter = filter.parse().map_err(|e| PyValueError::new_err(format!("h5_filter: {e}")))?;
    let run = SimulationRun::new(frames, &request)?;
    if run.sensor.0.as_model().labels() && !format.keeps_labels() {
        let what = format!("{} cannot store the labels of events; write .h5 or .npz", out.display());
        return Err(PyValueError::new_err(what));
    }
    run.drive(py, |setup, frames| setup.write(frames, &out, format, filter)).map(|account| to_json(&account))
}

fn to_json(account: &SimulationAccount) -> String {
    serde_json::to_string(account).unwrap_or_default()
}

/// The reason why a simulation has no result.
enum RunFailure {
    Simulate(SimulateError),
    Write(EventFileError),
}

impl From<SimulateError> for RunFailure {
    fn from(error: SimulateError) -> Self {
        Self::Simulate(error)
    }
}

impl From<EventFileError> for RunFailure {
    fn from(error: EventFileError) -> Self {
        Self::Write(error)
    }
}

impl From<io::Error> for RunFailure {
    fn from(error: io::Error) -> Self {
        Self::Write(error.into())
    }
}

impl From<RunFailure> for PyErr {
    fn from(failure: RunFailure) -> Self {
        match failure {
            RunFailure::Write(EventFileError::Io(error)) => error.into(),
            RunFailure::Write(error) => PyOSError::new_err(error.to_string()),
            RunFailure::Simulate(SimulateError::Sensor(SensorError::Sink(error))) => error.into(),
            RunFailure::Simulate(SimulateError::Sensor(error @ SensorError::Cap { .. })) => {
                let help = "raise max_events_per_pixel_frame, or pass allow_cap=True";
                PyRuntimeError::new_err(format!("{error}; {help}"))
            }
            RunFailure::Simulate(error) => PyValueError::new_err(error.to_string()),
        }
    }
}

/// The parts of a run that the threads of the simulation may have.
struct RunSetup {
    sensor: Sensor,
    seed: u64,
    origin: [u16; 2],
    span_us: (i64, i64),
}

impl RunSetup {
    fn simulate(
        &self,
        frames: &mut ReceivedFrames,
        sink: &mut dyn EventSink,
    ) -> Result<SimulationAccount, SimulateError> {
        let model = self.sensor.0.as_model();
        let pixels = model.start(frames.size(), self.origin, Seed(self.seed))?;
        let mut channel = [SensorChannel::new(pixels, sink).behind(model.front_end())];
        let accounts = simulate_all(frames, &mut channel, &mut |_| std::ops::ControlFlow::Continue(()))?;
        Ok(accounts.into_iter().next().unwrap_or_default())
    }

    fn write(
        &self,
        frames: &mut ReceivedFrames,
        out: &Path,
        format: EventFormat,
        filter: ChunkFilter,
    ) -> Result<SimulationAccount, RunFailure> {
        let stream = SimulatedStream { sensor: &self.sensor.0, size: frames.size(), span_us: self.span_us };
        let mut account = SimulationAccount::default();
        gs2e_files::write_by_rename(out, |part| {
            let mut file = stream.create_file(part, format, filter)?;
            account = self.simulate(frames, &mut FileSink(&mut *file))?;
            EventFile::finish(file, stream.length_us())?;
            Ok::<(), RunFailure>(())
        })?;
        Ok(account)
    }
}

/// An event file as an event sink.
struct FileSink<'a>(&'a mut dyn EventFile);

impl EventSink for FileSink<'_> {
    fn append(&mut self, events: &[Event]) -> io::Result<()> {
        self.0.append(events)
    }
}

/// A simulation whose inputs are sound.
struct SimulationRun<'py> {
    frames: FrameIterator<'py>,
    rates: Option<FrameIterator<'py>>,
    stamps_us: Vec<i64>,
    sensor: Sensor,
    seed: u64,
    origin: [u16; 2],
    threads: usize,
}

impl<'py> SimulationRun<'py> {
    fn new(frames: &Bound<'py, PyAny>, request: &SimulationRequest<'py>) -> PyResult<Self> {
        let stamps_us = request.stamps_us.to_vec()?;
        relative_stamps(&stamps_us).map_err(|e| PyValueError::new_err(format!("stamps_us: {e}")))?;
        if stamps_us.len() < 2 {
            return Err(PyValueError::new_err(format!("{} stamps, wanted at least 2", stamps_us.len())));
        }
        let sensor = request.sensor.get().clone();
        let wants_rates = sensor.0.between() == BetweenFrames::Hermite;
        if wants_rates != request.rates.is_some() {
            let what = if wants_rates {
                "hermite needs rates: the change of luminance per second"
            } else {
                "rates apply to between=\"hermite\" only"
            };
            return Err(PyValueError::new_err(what));
        }
        let frames = FrameIterator::start("frames", frames, request.full_scale)?;
        let rates = request.rates.as_ref().map(|rates| FrameIterator::start("rates", rates, Some(255)));
        let mut rates = rates.transpose()?;
        if let Some(rates) = &mut rates {
            if rates.size != frames.size {
                let what = format!("rates[0] is {}, wanted {} like the frames", rates.size, frames.size);
                return Err(PyValueError::new_err(what));
            }
            // Rates are on the scale of the frames.
            rates.scale = frames.scale;
        }
        let origin = [request.origin.0, request.origin.1];
        let threads = request.threads.unwrap_or(0);
        Ok(Self { frames, rates, stamps_us, sensor, seed: request.seed, origin, threads })
    }

    /// Runs `work` in threads of its own, and feeds it with frames from this thread.
    fn drive<R: Send>(
        mut self,
        py: Python<'py>,
        work: impl FnOnce(&RunSetup, &mut ReceivedFrames) -> Result<R, RunFailure> + Send,
    ) -> PyResult<R> {
        let pool = call_pool(self.threads)?;
        let (sender, receiver) = sync_channel(WAITING);
        let ends = [self.stamps_us.first(), self.stamps_us.last()].map(|stamp| stamp.copied().unwrap_or(0));
        let setup = RunSetup {
            sensor: self.sensor.clone(),
            seed: self.seed,
            origin: self.origin,
            span_us: (ends[0], ends[1]),
        };
        let mut received = ReceivedFrames::new(receiver, self.frames.size, &self.stamps_us)
            .map_err(|e| PyValueError::new_err(e.to_string()))?;
        std::thread::scope(|scope| {
            let worker = scope.spawn(move || pool.install(|| work(&setup, &mut received)));
            // The sender goes with the call: the worker waits for frames until it is dropped, also after an
            // error.
            let fed = self.feed(py, sender);
            // The sensor may still work for long, and other threads of Python run meanwhile.
            let ended = py.detach(|| worker.join());
            let ended = ended.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            // What went wrong on this side comes first: the worker only saw that the frames ended.
            fed.and_then(|()| ended.map_err(PyErr::from))
        })
    }

    /// Sends every frame, and the end. The sensor gets an abort if this fails.
    fn feed(&mut self, py: Python<'py>, sender: SyncSender<FrameMessage>) -> PyResult<()> {
        for index in 0..self.stamps_us.len() {
            py.check_signals()?;
            let luminance = self.frames.next_frame()?.ok_or_else(|| self.too_few("frames", index))?;
            let rate = match &mut self.rates {
                None => None,
                Some(rates) => Some(rates.next_frame()?.ok_or_else(|| self.too_few("rates", index))?),
            };
            // The worker ends early if it fails; its own error is reported then.
            if py.detach(|| sender.send(FrameMessage::Frame(luminance, rate))).is_err() {
                return Ok(());
            }
        }
        if self.frames.next_frame()?.is_some() {
            let what = format!("there are more frames than stamps_us, which has {}", self.stamps_us.len());
            return Err(PyValueError::new_err(what));
        }
        py.detach(|| drop(sender.send(FrameMessage::End)));
        Ok(())
    }

    fn too_few(&self, what: &str, found: usize) -> PyErr {
        PyValueError::new_err(format!("{found} {what}, but {} stamps_us", self.stamps_us.len()))
    }
}

/// The events as columns, with the times of the stamps.
struct EventColumns {
    zero_us: i64,
    t: Vec<i64>,
    x: Vec<u16>,
    y: Vec<u16>,
    p: Vec<u8>,
    label: Option<Vec<u8>>,
}

impl EventColumns {
    fn new(zero_us: i64, labels: bool) -> Self {
        Self {
            zero_us,
            t: Vec::new(),
            x: Vec::new(),
            y: Vec::new(),
            p: Vec::new(),
            label: labels.then(Vec::new),
        }
    }
}

impl EventSink for EventColumns {
    fn append(&mut self, events: &[Event]) -> io::Result<()> {
        // The stamps lie within 64 bits of microseconds, and so do the events between them.
        self.t.extend(events.iter().map(|event| self.zero_us + event.t.floor_micros()));
        self.x.extend(events.iter().map(|event| event.x));
        self.y.extend(events.iter().map(|event| event.y));
        self.p.extend(events.iter().map(|event| event.polarity as u8));
        if let Some(label) = &mut self.label {
            label.extend(events.iter().map(|event| event.label as u8));
        }
        Ok(())
    }
}
