//! `gs2e convert events.* picture.png`: the pixels of planted events.

use crate::support::workspace::Workspace;
use gs2e_image::{Image, Size, png};
use serde_json::Value;
use std::fs::File;
use std::io::BufReader;

const WHITE: [u8; 3] = [255; 3];

/// On 8x4: ON at (1, 2) at 100 us, OFF at (3, 0) at 200 and 900, one event of each polarity at (5,
/// 1).
fn workspace() -> Workspace {
    let place = Workspace::new();
    let events = "100 1 2 1\n200 3 0 0\n300 5 1 1\n400 5 1 0\n900 3 0 0\n";
    place.write("e.txt", format!("# t x y p in us; sensor 8x4\n{events}"));
    place
}

fn picture(place: &Workspace, options: &str) -> Image<[u8; 3]> {
    place.ok(&format!("convert e.txt p.png {options}"));
    png::read_rgb(BufReader::new(File::open(place.path("p.png")).unwrap())).unwrap()
}

fn at(image: &Image<[u8; 3]>, x: usize, y: usize) -> [u8; 3] {
    image.pixels()[y * image.size().width as usize + x]
}

#[test]
fn a_frame_shows_the_balance_of_its_window() {
    let place = workspace();
    let all = picture(&place, "");
    assert_eq!(all.size(), Size { width: 8, height: 4 });
    assert_eq!((at(&all, 1, 2), at(&all, 3, 0), at(&all, 0, 0)), ([255, 127, 127], [63, 63, 255], WHITE));
    let part = picture(&place, "--picture frame --window 150,900");
    assert_eq!((at(&part, 1, 2), at(&part, 3, 0), at(&part, 5, 1)), (WHITE, [127, 127, 255], [208; 3]));
}

#[test]
fn a_surface_shows_the_last_event_by_its_age() {
    let place = workspace();
    // ages 900, 100 and 600 us of 500: exp(-1.8) = 0.165, exp(-0.2) = 0.819, exp(-1.2) = 0.301
    let surface = picture(&place, "--picture surface --window 0,1000 --tau 500");
    assert_eq!(at(&surface, 1, 2), [255, 213, 213]);
    assert_eq!(at(&surface, 3, 0), [46, 46, 255]);
    assert_eq!(at(&surface, 5, 1), [178, 178, 255]);
    assert_eq!(at(&surface, 0, 0), WHITE);
}

#[test]
fn rates_are_drawn_over_the_window_and_printed() {
    let place = workspace();
    let found = place.ok("convert e.txt p.png --picture rate --window 0,1000 --json").stdout;
    let found: Value = serde_json::from_str(&found).unwrap();
    assert_eq!((&found["events"], &found["picture"]), (&5.into(), &"rate".into()));
    let rate = picture(&place, "--picture rate --window 0,1000");
    let (width, middle) = (rate.size().width as usize, rate.size().height as usize / 2);
    // one bar per microsecond, each as high as the others: one event
    let coloured: Vec<usize> = (0..width).filter(|&x| at(&rate, x, middle - 1) != WHITE).collect();
    assert_eq!(coloured, [100, 300]);
    let below: Vec<usize> = (0..width).filter(|&x| at(&rate, x, middle + 1) != WHITE).collect();
    assert_eq!(below, [200, 400, 900]);
}

#[test]
fn impossible_pictures_are_refused() {
    let place = workspace();
    let t = |args: &str, message: &str| {
        let ended = place.gs2e(args);
        assert_eq!(ended.code, 2, "{args}: {}", ended.stderr);
        assert!(ended.stderr.contains(message), "{args}: {}", ended.stderr);
        assert!(!place.path("p.png").exists() && !place.path("e.h5").exists());
    };
    t("convert e.txt e.h5 --picture rate", "e.h5 is not a .png, but a picture is requested");
    t("convert e.txt p.png --window 5", "`5` is not T0,T1");
    t("convert e.txt p.png --window 9,9", "`9,9` is not T0,T1");
    t("convert gone.txt p.png", "gone.txt cannot be read");
    t("convert scene.ply p.png", "p.png: not a format that gs2e writes");
}

#[test]
fn a_window_without_events_is_said_once() {
    let place = workspace();
    let ended = place.ok("convert e.txt p.png --window 5000,9000");
    assert_eq!(ended.stderr.matches("no events in this window").count(), 1, "{}", ended.stderr);
    assert!(!ended.stderr.contains("0 events"), "{}", ended.stderr);
}
