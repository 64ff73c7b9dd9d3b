//! Writes the manual pages of the program and of each verb to a folder: `cargo xtask man DIR`.

use clap_mangen::Man;
use std::path::Path;

fn main() -> std::io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1) else {
        return Err(std::io::Error::other("usage: man DIR"));
    };
    std::fs::create_dir_all(&folder)?;
    let mut program = gs2e::cli::command_line();
    program.build();
    write_page(program.clone(), Path::new(&folder))?;
    for verb in program.get_subcommands().filter(|verb| verb.get_name() != "help") {
        // The page of a verb has the name by which `man` finds it: gs2e-release(1).
        let name = format!("gs2e-{}", verb.get_name());
        write_page(verb.clone().display_name(name), Path::new(&folder))?;
    }
    Ok(())
}

fn write_page(command: clap::Command, folder: &Path) -> std::io::Result<()> {
    let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
    let mut page = Vec::new();
    Man::new(command).render(&mut page)?;
    std::fs::write(folder.join(format!("{name}.1")), page)
}
