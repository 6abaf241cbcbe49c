//! The `proact` command.
fn main() {}
