//! Work split into shards that any machine can do.
