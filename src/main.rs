//! The `rigd` command.
fn main() {}
