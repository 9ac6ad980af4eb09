//! Compiles the C++ shim over `MuJoCo` and links the library.

fn main() {}
