//! Captures and recipes.

use crate::{Bomb, Fate, Place};

const TRAJECTORY: &str = "trajectory --capture capture --recipe r.yaml --name base --out poses.txt";

pub(crate) const BOMBS: &[Bomb] = &[
    Bomb {
        name: "json-numbers",
        what: "a transforms.json of 8,000,000 numbers",
        args: TRAJECTORY,
        fate: Fate::Refused,
        make: |place| transforms(place, &format!("[{}0]", "0,".repeat(8_000_000))),
    },
    Bomb {
        name: "json-objects",
        what: "a transforms.json of 1,000,000 frames with nothing in them",
        args: TRAJECTORY,
        fate: Fate::Refused,
        make: |place| transforms(place, &format!("[{}{{}}]", "{\"a\":0},".repeat(1_000_000))),
    },
    Bomb {
        name: "json-deep",
        what: "a transforms.json of 1,000,000 nested lists",
        args: TRAJECTORY,
        fate: Fate::Refused,
        make: |place| transforms(place, &"[".repeat(1_000_000)),
    },
    Bomb {
        name: "colmap-images",
        what: "2^60 images of a COLMAP model, and no data",
        args: TRAJECTORY,
        fate: Fate::Refused,
        make: |place| colmap(place, &(1_u64 << 60).to_le_bytes()),
    },
    Bomb {
        name: "colmap-key-points",
        what: "an image with 2^60 key points, and no data",
        args: TRAJECTORY,
        fate: Fate::Refused,
        make: |place| {
            let mut images = 1_u64.to_le_bytes().to_vec();
            images.extend(1_u32.to_le_bytes());
            images.extend([1.0_f64, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].map(f64::to_le_bytes).concat());
            images.extend(1_u32.to_le_bytes());
            images.extend(b"a.png\0");
            images.extend((1_u64 << 60).to_le_bytes());
            colmap(place, &images);
        },
    },
    Bomb {
        name: "colmap-text",
        what: "a line of 3,000,000 key points, the last without its id",
        args: TRAJECTORY,
        fate: Fate::Refused,
        make: |place| {
            recipe(place, "");
            place.write("capture/cameras.txt", "1 PINHOLE 64 48 60 60 32 24\n");
            let points = "0 0 -1 ".repeat(3_000_000);
            place.write("capture/images.txt", format!("1 1 0 0 0 0 0 0 1 a.png\n{points}x y z\n"));
        },
    },
    Bomb {
        name: "yaml-aliases",
        what: "a text of 600 kB that 99 aliases repeat",
        args: "plan r.yaml",
        fate: Fate::Refused,
        make: |place| {
            let aliases = "  - *a\n".repeat(99);
            place.write("r.yaml", format!("a: &a \"{}\"\nb:\n{aliases}", "x".repeat(600_000)));
        },
    },
    Bomb {
        name: "yaml-laughs",
        what: "nine levels of lists of nine aliases each",
        args: "plan r.yaml",
        fate: Fate::Refused,
        make: |place| {
            let level = |n: u8| {
                let under = format!("*{}, ", char::from(b'a' + n - 1)).repeat(9);
                format!("{0}: &{0} [{under}]\n", char::from(b'a' + n))
            };
            place.write("r.yaml", format!("a: &a x\n{}", (1..10).map(level).collect::<String>()));
        },
    },
    Bomb {
        name: "yaml-deep",
        what: "300,000 nested lists",
        args: "plan r.yaml",
        fate: Fate::Refused,
        make: |place| place.write("r.yaml", format!("a: {}", "[".repeat(300_000))),
    },
    Bomb {
        name: "recipe-camera",
        what: "a camera of 16384x16384",
        args: "plan r.yaml",
        fate: Fate::Refused,
        make: |place| recipe(place, "camera: { width: 16384, height: 16384 }\n"),
    },
    Bomb {
        name: "recipe-hot-pixels",
        what: "every pixel hot, at 10^6 events per second",
        args: "plan r.yaml",
        fate: Fate::Refused,
        make: |place| recipe(place, "sensor: { voltmeter: { hot_pixels: { share: 1, rate: 1e6 } } }\n"),
    },
    Bomb {
        name: "recipe-leak",
        what: "a leak of 1 Hz that spreads over three decades",
        args: "plan r.yaml",
        fate: Fate::Refused,
        make: |place| recipe(place, "sensor: { v2e: { leak: { rate: 1, cov: 3 } } }\n"),
    },
];

/// Writes a sound recipe of a tiny scene, with the lines `more` appended.
pub(crate) fn recipe(place: &Place, more: &str) {
    let camera = if more.contains("camera:") { "" } else { "camera: { width: 64, height: 48 }\n" };
    place.write(
        "r.yaml",
        format!(
            "version: 1\nscene: tiny\nseed: 7\nsource: {{ procedural: {{ kind: still-life, gaussians: 500, views: 6, \
             arc: 6, seed: 1 }} }}\n{camera}trajectories:\n  - name: base\n    refine: {{ window: 2, factor: 2, curve: \
             cubic }}\n    speed: {{ function: \"0.25*sin(t) + 1.1\" }}\nsampling: {{ rate: 2400, between: linear }}\n\
             outputs: [events]\n{more}"
        ),
    );
}

fn transforms(place: &Place, frames: &str) {
    recipe(place, "");
    place.write("capture/transforms.json", format!("{{\"w\":64,\"h\":48,\"frames\":{frames}}}"));
}

/// Writes a model with one camera and the given images.
fn colmap(place: &Place, images: &[u8]) {
    recipe(place, "");
    let mut cameras = 1_u64.to_le_bytes().to_vec();
    cameras.extend([1_u32, 1].map(u32::to_le_bytes).concat());
    cameras.extend([64_u64, 48].map(u64::to_le_bytes).concat());
    cameras.extend([60.0_f64, 60.0, 32.0, 24.0].map(f64::to_le_bytes).concat());
    place.write("capture/cameras.bin", cameras);
    place.write("capture/images.bin", images);
}
