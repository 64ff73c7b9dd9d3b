//! The law of the time between events of a pixel of constant brightness, as in `gs2e stress`, at
//! its anchors.

pub(super) use gs2e_sensor::statistics::interval_law::BarrierExit;

#[test]
fn anchors() {
    // The anchors of docs/design/numerics-sensor.md, "Interval law".
    let t = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
    let exit = |drift| BarrierExit { drift, variance: 1.0, up: 1.0, down: 1.0 };
    t(exit(0.0).upward_by(0.5), 0.157_277_117);
    t(exit(0.0).upward_by(1.0), 0.314_611_285);
    t(exit(0.5).upward_by(1.0), 0.486_135_864);
    t(exit(-0.5).upward_by(1.0), 0.178_839_390);
    t(exit(0.5).by(1.0), 0.486_135_864 + 0.178_839_390);
}
