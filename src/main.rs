//! The `gs2e` program: see [`gs2e::cli`].

fn main() -> std::process::ExitCode {
    gs2e::cli::run_program(std::env::args_os())
}
