//! Writes normal deviates of a pixel as text. Every machine writes the same digits:
//! `cargo run --release --example draws -- SEED COLUMN ROW FILE`

use gs2e_num::seed::{DrawSpace, Seed, SeedCell};
use std::{env, error::Error, fmt::Write as _};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [seed, x, y, file] = &arguments[..] else {
        return Err("usage: draws SEED COLUMN ROW FILE".into());
    };
    let cell = SeedCell { x: x.parse()?, y: y.parse()?, level: 0, index: 0 };
    let mut draws = Seed(seed.parse()?).draws(cell, DrawSpace::Leaf);
    let mut text = String::new();
    for _ in 0..10 {
        writeln!(text, "{}", draws.normal())?;
    }
    std::fs::write(file, text)?;
    Ok(())
}
