//! The whole state of a simulation, small enough to keep one a frame.

/// Everything that the next step depends on. Replaying from a snapshot gives the same bits
/// as going on: without `qacc_warmstart` it would drift as soon as contacts are active.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// Simulated time, seconds.
    pub time_secs: f64,
    /// Coordinates; (nq).
    pub qpos: Vec<f64>,
    /// Velocities; (nv).
    pub qvel: Vec<f64>,
    /// Activations; (na).
    pub act: Vec<f64>,
    /// Controls; (nu).
    pub ctrl: Vec<f64>,
    /// Solver warm start; (nv).
    pub qacc_warmstart: Vec<f64>,
    /// Applied generalised forces; (nv).
    pub qfrc_applied: Vec<f64>,
    /// Mocap positions; (nmocap, 3).
    pub mocap_pos: Vec<f64>,
    /// Mocap orientations; (nmocap, 4).
    pub mocap_quat: Vec<f64>,
}
