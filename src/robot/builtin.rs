//! The built-in robots: our own models of primitive geometry, in `assets/robots`.

/// A built-in robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Builtin {
    pub(super) id: &'static str,
    /// The model; `None` if the profile names that of another robot.
    pub(super) model: Option<&'static str>,
    pub(super) profile: &'static str,
}

/// In the order of `robert robots ls`.
pub(super) const BUILTIN: [Builtin; 4] = [
    Builtin {
        id: "pointmass",
        model: Some(include_str!("assets/pointmass/robot.xml")),
        profile: include_str!("assets/pointmass/profile.toml"),
    },
    Builtin {
        id: "ur5e",
        model: Some(include_str!("assets/ur5e/robot.xml")),
        profile: include_str!("assets/ur5e/profile.toml"),
    },
    Builtin {
        id: "ur5e_light",
        model: None,
        profile: include_str!("assets/ur5e_light/profile.toml"),
    },
    Builtin {
        id: "shadow_hand",
        model: Some(include_str!("assets/shadow_hand/robot.xml")),
        profile: include_str!("assets/shadow_hand/profile.toml"),
    },
];

/// The notices of the sources of these models' figures.
pub const NOTICE: &str = include_str!("assets/NOTICE");

/// The robot of this id.
pub(super) fn find(id: &str) -> Option<&'static Builtin> {
    BUILTIN.iter().find(|b| b.id == id)
}
