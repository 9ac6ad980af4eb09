//! The network: masked action-inverse inference.
