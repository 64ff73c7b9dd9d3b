//! The table of checks, in the order of reports. Names, passes, limits and remedies are read off
//! it.
//!
//! A row is the name; `limits` for a check whose limits a recipe may set (the type is
//! `name::Limits`), or `exact` for one that is right or wrong; its subject: a `pass` over
//! trajectories, a whole `scene`, or the files of a release `tree`; and the remedy, which is the
//! first thing to try.

/// Calls a macro with the table.
macro_rules! check_table {
    ($then:ident) => {
        $then! {
            schema (exact schema) (pass schema::SchemaPass)
                "rebuild the trajectory: `gs2e build --verify`; if the finding remains, it is a bug in gs2e: report it";
            stamps (exact stamps) (pass stamps::StampsPass)
                "rebuild the trajectory: `gs2e build --verify`; if the finding remains, it is a bug in gs2e: report it";
            duplicates (limits duplicates) (pass duplicates::DuplicatesPass)
                "raise the sensor's thresholds or its dead time";
            coverage (limits coverage) (pass coverage::CoveragePass)
                "check the views along the path in report.html; change its centre, distance or arc so that it faces the scene";
            event_rate (limits event_rate) (pass event_rate::EventRate)
                "check the number of frames, the thresholds against the contrast of the frames (`gs2e study thresholds`), and the views along the path in report.html";
            polarity (limits polarity) (pass polarity::OnShare)
                "check for a brightness change along the path, and for ON and OFF thresholds that differ by mistake";
            refractory (exact refractory) (pass refractory::DeadTime)
                "rebuild the trajectory: `gs2e build --verify`; if the finding remains, it is a bug in gs2e: report it";
            batching (limits batching) (pass batching::BatchingPass)
                "use more frames: `sampling: { tolerance: 0.1 }`, or a higher `sampling.rate`";
            hot_pixels (limits hot_pixels) (pass hot_pixels::HotPixelsPass)
                "lower the sensor's share of hot pixels, or its noise";
            structure (limits structure) (pass structure::StructurePass)
                "the events look like noise: lower the sensor's noise, or its thresholds";
            event_frame (limits event_frame) (pass event_frame::EventFrame)
                "use more frames: `sampling: { tolerance: 0.1 }`; then compare sharp/ with the events in report.html";
            flash (limits flash) (pass flash::FlashPass)
                "a large Gaussian close to the camera appears or vanishes: leave such out of the path with `render: { near: 0.1 }`, or move the path away from it";
            alignment (limits alignment) (pass alignment::AlignmentPass)
                "compare the pixels of events.h5 with those of sharp/: an image may be shifted, mirrored or turned, or the frames may be in another order";
            completeness (limits completeness) (pass completeness::CompletenessPass)
                "events are missing: copy the stream again, or build the trajectory again";
            motion (limits motion) (pass motion::MotionCompensation)
                "slow the path down or use more frames, so that events follow the image motion";
            time_offset (limits time_offset) (pass time_offset::TimeOffset)
                "compare the time stamps of the frames with those of the events";
            event_times (exact event_times) (pass event_times::EventTimes)
                "compare the clock of the events with that of the frames; write event times in microseconds";
            noise_floor (limits noise_floor) (pass noise_floor::NoiseFloor)
                "set the sensor's noise parameters to those of your camera: docs/sensors.md";
            sampling (limits sampling) (pass sampling::SamplingPass)
                "use more frames: a higher `sampling.rate`, or `sampling: { tolerance: 0.1 }` for the sensor voltmeter; or slow the path down: fewer `px_s` of a flow, or a longer `duration`";
            affine (limits affine) (pass affine::AffinePass)
                "hide those that the path comes close to with `render: { near: 0.1 }`, or use a larger distance, or another arc; the check `flash` finds those that flash";
            drift_identity (exact drift_identity) (pass drift_identity::DriftIdentity)
                "rebuild the trajectory: `gs2e build --verify`; if the finding remains, it is a bug in gs2e: report it";
            readback (limits readback) (pass readback::ReadbackPass)
                "check the report of the named program; the files may be damaged";
            pose_continuity (limits pose_continuity) (pass pose_continuity::PoseContinuity)
                "smooth the path: a larger `refine.window`, or fewer keyframes";
            photometric (exact photometric) (pass photometric::PhotometricPass)
                "compare poses, depth and frames: their order, axes, direction and scale; `gs2e audit --rebuild` makes them again";
            depth_consistency (exact depth_consistency) (pass depth_consistency::DepthConsistency)
                "compare poses, depth and frames: their order, axes, direction and scale; `gs2e audit --rebuild` makes them again";
            flow_projection (exact flow_projection) (pass flow_projection::FlowProjection)
                "compare poses, depth and frames: their order, axes, direction and scale; `gs2e audit --rebuild` makes them again";
            pose_colmap (limits pose_colmap) (pass pose_colmap::PoseColmap)
                "compare the poses and the camera of the source with those of the photos";
            pose_opencv (limits pose_opencv) (pass pose_opencv::PoseOpencv)
                "compare the poses and the camera of the source with those of the photos";
            speed (limits speed) (pass speed::SpeedPass)
                "compare poses.txt with speed.json; a longer `refine.window` or fewer poses make the path easier to follow";
            recon_psnr (limits recon_psnr) (scene recon_psnr)
                "train the scene longer, or exclude photos that it cannot reproduce";
            capture (limits capture) (scene capture)
                "check the named photos and poses; `gs2e init --exclude` leaves photos out";
            records (exact records) (tree records)
                "write the release again: gs2e release --to DIR --replace; a file was changed without the others";
        }
    };
}

pub(super) use check_table;
