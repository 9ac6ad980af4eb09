//! The current scene, and which of its messages each client has not received yet.
//!
//! One slot per (kind, name) holds the newest message of that kind, with the stamp of its writing.
//! A new client gets every slot. A client with a slow connection gets the newest state of what
//! changed meanwhile. There are no queues, so nothing can overflow.

use std::collections::BTreeMap;

use robert_take::viser::Message;

/// The order in which slots are sent: a slot that others need has a lower rank.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Rank {
    Global,
    Remove,
    Create,
    Props,
    Position,
    Orientation,
    Visibility,
    Clicks,
    Drags,
    Camera,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    rank: Rank,
    name: String,
}

/// The scene; see the module.
#[derive(Debug, Default)]
pub(super) struct Retained {
    slots: BTreeMap<Key, (u64, Message)>,
    stamp: u64,
}

impl Retained {
    /// Stores a message; one that changes nothing is dropped.
    pub(super) fn put(&mut self, message: Message) {
        let Some(key) = key(&message) else { return };
        if key.rank == Rank::Create {
            self.slots.remove(&Key { rank: Rank::Remove, name: key.name.clone() });
        }
        let camera = key.rank == Rank::Camera;
        if !camera && self.slots.get(&key).is_some_and(|(_, old)| *old == message) {
            return;
        }
        self.stamp += 1;
        self.slots.insert(key, (self.stamp, message));
    }

    /// Removes a node and all below it.
    pub(super) fn remove(&mut self, name: &str) {
        let below = format!("{name}/");
        let gone: Vec<Key> = self
            .slots
            .keys()
            .filter(|k| k.rank != Rank::Global && k.rank != Rank::Camera)
            .filter(|k| k.name == name || k.name.starts_with(&below))
            .cloned()
            .collect();
        for key in gone {
            self.slots.remove(&key);
            if key.rank == Rank::Create {
                self.put(Message::RemoveSceneNodeMessage { name: key.name, owner: String::new() });
            }
        }
    }

    /// All messages since a stamp, in order, and the stamp from now on. From stamp 0 these are all
    /// messages that a new client needs.
    pub(super) fn since(&self, seen: u64) -> (Vec<Message>, u64) {
        let news = self
            .slots
            .iter()
            .filter(|(key, (stamp, _))| *stamp > seen && (seen > 0 || key.rank != Rank::Remove))
            .map(|(_, (_, message))| moving(message.clone(), seen > 0))
            .collect();
        (news, self.stamp)
    }

    /// Stamp of the newest slot.
    pub(super) fn stamp(&self) -> u64 {
        self.stamp
    }
}

/// A camera message in the form that a client must get. A message with `initial` sets where a new
/// client starts and where "reset view" goes; the camera of a connected client moves only on a
/// message without it.
fn moving(mut message: Message, there: bool) -> Message {
    if let Message::SetCameraPositionMessage { initial, .. }
    | Message::SetCameraLookAtMessage { initial, .. }
    | Message::SetCameraUpDirectionMessage { initial, .. }
    | Message::SetCameraFovMessage { initial, .. } = &mut message
    {
        *initial = !there;
    }
    message
}

fn key(message: &Message) -> Option<Key> {
    let of = |rank, name: &str| Some(Key { rank, name: name.to_owned() });
    match message {
        Message::FrameMessage(n) => of(Rank::Create, &n.name),
        Message::MeshMessage(n) => of(Rank::Create, &n.name),
        Message::SkinnedMeshMessage(n) => of(Rank::Create, &n.name),
        Message::BoxMessage(n) => of(Rank::Create, &n.name),
        Message::IcosphereMessage(n) => of(Rank::Create, &n.name),
        Message::CylinderMessage(n) => of(Rank::Create, &n.name),
        Message::GridMessage(n) => of(Rank::Create, &n.name),
        Message::LineSegmentsMessage(n) => of(Rank::Create, &n.name),
        Message::TransformControlsMessage(n) => of(Rank::Create, &n.name),
        Message::DirectionalLightMessage(n) => of(Rank::Create, &n.name),
        Message::AmbientLightMessage(n) => of(Rank::Create, &n.name),
        Message::SetPositionMessage { name, .. } => of(Rank::Position, name),
        // The whole scene's orientation comes before anything stands in it.
        Message::SetOrientationMessage { name, .. } if name.is_empty() => of(Rank::Global, "0 up"),
        Message::SetOrientationMessage { name, .. } => of(Rank::Orientation, name),
        Message::SetSceneNodeVisibilityMessage { name, .. } => of(Rank::Visibility, name),
        Message::SceneNodeUpdateMessage { name, .. } => of(Rank::Props, name),
        Message::RemoveSceneNodeMessage { name, .. } => of(Rank::Remove, name),
        Message::SetSceneNodeClickBindingsMessage { name, .. } => of(Rank::Clicks, name),
        Message::SetSceneNodeDragBindingsMessage { name, .. } => of(Rank::Drags, name),
        Message::EnvironmentMapMessage { .. } => of(Rank::Global, "3 surroundings"),
        Message::EnableLightsMessage { .. } => of(Rank::Global, "1 lights"),
        Message::ThemeConfigurationMessage { .. } => of(Rank::Global, "2 theme"),
        Message::SetCameraUpDirectionMessage { .. } => of(Rank::Camera, "0 up"),
        Message::SetCameraFovMessage { .. } => of(Rank::Camera, "1 fov"),
        Message::SetCameraPositionMessage { .. } => of(Rank::Camera, "2 position"),
        Message::SetCameraLookAtMessage { .. } => of(Rank::Camera, "3 look at"),
        // Bones are not used live, and the end of the replay belongs to one connection.
        Message::SetBonePositionMessage { .. }
        | Message::SetBoneOrientationMessage { .. }
        | Message::ReplayDoneMessage {} => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_take::viser::FrameProps;

    #[test]
    fn a_camera_is_where_new_clients_begin_and_where_others_go() {
        let mut scene = Retained::default();
        let at = |x: f64, initial| Message::SetCameraPositionMessage {
            position: [x, 0.0, 0.0],
            initial,
        };
        scene.put(at(1.0, true));
        let (first, seen) = scene.since(0);
        assert_eq!(first, [at(1.0, true)]);
        scene.put(at(2.0, true));
        assert_eq!(scene.since(seen).0, [at(2.0, false)], "who is there moves");
        assert_eq!(scene.since(0).0, [at(2.0, true)]);
    }

    #[test]
    fn the_newest_wins_and_parents_come_first() {
        let mut scene = Retained::default();
        scene.put(Message::position("/a/b", [1.0, 0.0, 0.0]));
        scene.put(Message::create("/a/b", FrameProps::default()));
        scene.put(Message::create("/a", FrameProps::default()));
        scene.put(Message::z_up());
        let (first, seen) = scene.since(0);
        assert_eq!(first.len(), 4);
        assert_eq!(first[0], Message::z_up());
        assert_eq!(first[1], Message::create("/a", FrameProps::default()));
        for k in 0..50 {
            scene.put(Message::position("/a/b", [f64::from(k), 0.0, 0.0]));
        }
        let (news, seen2) = scene.since(seen);
        assert_eq!(news, [Message::position("/a/b", [49.0, 0.0, 0.0])]);
        scene.put(Message::position("/a/b", [49.0, 0.0, 0.0]));
        assert!(scene.since(seen2).0.is_empty(), "nothing changed");
        scene.remove("/a");
        let (news, _) = scene.since(seen2);
        assert_eq!(news.len(), 2);
        assert_eq!(scene.since(0).0, [Message::z_up()]);
        scene.put(Message::create("/a", FrameProps::default()));
        assert_eq!(scene.since(0).0.len(), 2);
    }
}
