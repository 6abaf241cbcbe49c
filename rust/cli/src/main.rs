//! The `proact` command: see [`proact_cli`].

fn main() -> std::process::ExitCode {
    // Only the launcher knows the commit; here, so that a new one compiles no more than this file.
    proact_cli::run_built_from(option_env!("PROACT_COMMIT"), proact_control::MethodRegistry::standard())
}
