//! The `proact` command: see [`proact_cli`].

fn main() -> std::process::ExitCode {
    // Here, so that a new commit compiles no more than this file.
    proact_cli::run_with_commit(Some(env!("PROACT_COMMIT")), proact_control::MethodRegistry::standard())
}
