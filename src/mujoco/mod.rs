//! The simulator layer.
