//! Robots: model, profile, import, inverse kinematics.
