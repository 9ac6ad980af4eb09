//! The curious agents that collect motion without reward.
