//! A recorded rollout and its exports.
