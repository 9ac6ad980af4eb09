//! The whole state of a simulation, small enough to keep one per frame.

/// Everything that the next step depends on. Continuing from a snapshot gives the same bits as an
/// uninterrupted simulation. Without `qacc_warmstart` the two would differ as soon as contacts are
/// active.
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
