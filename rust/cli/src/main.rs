//! The `proact` command: see [`proact_cli`].

fn main() -> std::process::ExitCode {
    proact_cli::run(proact_control::MethodRegistry::standard())
}
