//! Messages to the client, with the client's names and fields.

use serde::Serialize;

use super::buffer::Buffer;

/// R, G, B, 0 to 255.
pub type Rgb = [u8; 3];
/// w, x, y, z.
pub type Wxyz = [f64; 4];
/// x, y, z in m.
pub type Xyz = [f64; 3];

macro_rules! messages {
    (
        nodes { $($(#[$node_doc:meta])* $node:ident($props:ty),)* }
        others { $($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $ty:ty,)* },)* }
    ) => {
        /// A message to the client.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[serde(tag = "type")]
        pub enum Message {
            $($(#[$node_doc])* $node(Node<$props>),)*
            $($(#[$doc])* $name { $($(#[$field_doc])* $field: $ty,)* },)*
        }

        $(impl From<Node<$props>> for Message {
            fn from(node: Node<$props>) -> Message {
                Message::$node(node)
            }
        })*
    };
}

/// Creates a node of the scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Node<P> {
    /// Path, `/a/b`.
    pub name: String,
    /// Empty for nodes of all clients.
    pub owner: String,
    /// Whether it is only a parent.
    #[serde(rename = "virtual")]
    pub is_virtual: bool,
    /// Its content.
    pub props: P,
}

messages! {
    nodes {
        /// A coordinate frame, also used as a parent of other nodes.
        FrameMessage(FrameProps),
        /// A mesh.
        MeshMessage(MeshProps),
        /// A mesh whose corners follow bones: many bodies in one draw call.
        SkinnedMeshMessage(SkinnedMeshProps),
        /// A box.
        BoxMessage(BoxProps),
        /// A ball.
        IcosphereMessage(IcosphereProps),
        /// A cylinder along z.
        CylinderMessage(CylinderProps),
        /// A grid.
        GridMessage(GridProps),
        /// Lines.
        LineSegmentsMessage(LineSegmentsProps),
        /// A gizmo.
        TransformControlsMessage(TransformControlsProps),
        /// A directional light.
        DirectionalLightMessage(DirectionalLightProps),
        /// An ambient light.
        AmbientLightMessage(AmbientLightProps),
    }
    others {
        /// Moves a node in its parent's frame.
        SetPositionMessage { name: String, position: Xyz, owner: String, },
        /// Turns a node in its parent's frame; name "" turns the whole scene.
        SetOrientationMessage { name: String, wxyz: Wxyz, owner: String, },
        /// Moves a bone of a skinned mesh.
        SetBonePositionMessage { name: String, bone_index: u32, position: Xyz, owner: String, },
        /// Turns a bone of a skinned mesh.
        SetBoneOrientationMessage { name: String, bone_index: u32, wxyz: Wxyz, owner: String, },
        /// Shows or hides a node and its children.
        SetSceneNodeVisibilityMessage { name: String, visible: bool, owner: String, },
        /// Changes the content of a node.
        SceneNodeUpdateMessage { name: String, updates: Updates, owner: String, },
        /// Removes a node; its children must be removed one by one.
        RemoveSceneNodeMessage { name: String, owner: String, },
        /// Sets which clicks on a node are reported.
        SetSceneNodeClickBindingsMessage { name: String, bindings: Vec<Binding>, owner: String, },
        /// Sets which drags on a node are reported.
        SetSceneNodeDragBindingsMessage { name: String, bindings: Vec<Binding>, owner: String, },
        /// Switches the client's own lights.
        EnableLightsMessage { enabled: bool, cast_shadow: bool, },
        /// Light from a picture of the surroundings.
        EnvironmentMapMessage {
            /// JPEG of the surroundings; `None` switches them off.
            hdri_data: Option<serde_bytes::ByteBuf>,
            background: bool,
            background_blurriness: f64,
            background_intensity: f64,
            background_wxyz: Wxyz,
            environment_intensity: f64,
            environment_wxyz: Wxyz,
        },
        /// Position of the camera.
        SetCameraPositionMessage {
            position: Xyz,
            /// Whether "reset view" restores it.
            initial: bool,
        },
        /// Target of the camera.
        SetCameraLookAtMessage {
            look_at: Xyz,
            /// Whether "reset view" restores it.
            initial: bool,
        },
        /// Up direction of the camera.
        SetCameraUpDirectionMessage {
            position: Xyz,
            /// Whether "reset view" restores it.
            initial: bool,
        },
        /// Vertical field of view, rad.
        SetCameraFovMessage {
            fov: f64,
            /// Whether "reset view" restores it.
            initial: bool,
        },
        /// Theme of the page around the scene.
        ThemeConfigurationMessage {
            titlebar_content: Option<()>,
            control_layout: &'static str,
            control_width: &'static str,
            show_logo: bool,
            show_share_button: bool,
            dark_mode: bool,
            colors: Option<[String; 10]>,
        },
        /// The first batch is complete: once per live connection.
        ReplayDoneMessage {},
    }
}

impl Message {
    /// A node for all clients.
    pub fn create<P>(name: &str, props: P) -> Message
    where
        Message: From<Node<P>>,
    {
        Node { name: name.to_owned(), owner: String::new(), is_virtual: false, props }.into()
    }

    /// Moves a node.
    pub fn position(name: &str, position: Xyz) -> Message {
        Message::SetPositionMessage { name: name.to_owned(), position, owner: String::new() }
    }

    /// Turns a node.
    pub fn orientation(name: &str, wxyz: Wxyz) -> Message {
        Message::SetOrientationMessage { name: name.to_owned(), wxyz, owner: String::new() }
    }

    /// Shows or hides a node.
    pub fn visibility(name: &str, visible: bool) -> Message {
        let (name, owner) = (name.to_owned(), String::new());
        Message::SetSceneNodeVisibilityMessage { name, visible, owner }
    }

    /// Gives a mesh another colour.
    pub fn recolor(name: &str, color: Rgb) -> Message {
        let (name, owner) = (name.to_owned(), String::new());
        Message::SceneNodeUpdateMessage { name, updates: Updates { color }, owner }
    }

    /// No environment picture. The client hides the scene while it loads its own, which may never
    /// succeed in a page that is opened from disk or drawn in software.
    pub fn no_environment() -> Message {
        Message::EnvironmentMapMessage {
            hdri_data: None,
            background: false,
            background_blurriness: 0.0,
            background_intensity: 1.0,
            background_wxyz: [1.0, 0.0, 0.0, 0.0],
            environment_intensity: 1.0,
            environment_wxyz: [1.0, 0.0, 0.0, 0.0],
        }
    }

    /// z is up: the client's own scene has y up.
    pub fn z_up() -> Message {
        Message::orientation("", [0.5, -0.5, 0.5, 0.5])
    }
}

/// Props that change.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Updates {
    /// The colour of a mesh.
    pub color: Rgb,
}

/// A mouse button with a modifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Binding {
    /// `left`, `middle` or `right`.
    pub button: &'static str,
    /// `cmd/ctrl`, `alt`, `shift`, or several joined by `+`.
    pub modifier: Option<&'static str>,
}

macro_rules! props {
    ($($(#[$doc:meta])* $name:ident { $($field:ident: $ty:ty = $default:expr,)* })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[allow(missing_docs)]
        pub struct $name {
            $(pub $field: $ty,)*
        }

        impl Default for $name {
            fn default() -> Self {
                $name { $($field: $default,)* }
            }
        }
    )*};
}

const GREY: Rgb = [180, 180, 180];
const NO_LIMITS: [[f64; 2]; 3] = [[-1000.0, 1000.0]; 3];

props! {
    /// Props of [`Message::FrameMessage`]; lengths in m.
    FrameProps {
        show_axes: bool = false,
        axes_length: f64 = 0.1,
        axes_radius: f64 = 0.003,
        origin_radius: f64 = 0.006,
        origin_color: Rgb = [236, 236, 0],
        scale: f64 = 1.0,
    }
    /// Props of [`Message::MeshMessage`]: vertices (V, 3) f32, faces (F, 3) u32.
    MeshProps {
        vertices: Buffer = Buffer::f32(&[]),
        faces: Buffer = Buffer::u32(&[]),
        color: Rgb = GREY,
        wireframe: bool = false,
        opacity: Option<f64> = None,
        flat_shading: bool = false,
        side: &'static str = "front",
        material: &'static str = "standard",
        scale: f64 = 1.0,
        cast_shadow: bool = true,
        receive_shadow: bool = true,
    }
    /// Props of [`Message::SkinnedMeshMessage`]: a mesh, bones (B, 4) and (B, 3) f32, per
    /// corner four bones (V, 4) u16 and their weights (V, 4) f32.
    SkinnedMeshProps {
        vertices: Buffer = Buffer::f32(&[]),
        faces: Buffer = Buffer::u32(&[]),
        color: Rgb = GREY,
        wireframe: bool = false,
        opacity: Option<f64> = None,
        flat_shading: bool = false,
        side: &'static str = "front",
        material: &'static str = "standard",
        scale: f64 = 1.0,
        cast_shadow: bool = true,
        receive_shadow: bool = true,
        bone_wxyzs: Buffer = Buffer::f32(&[]),
        bone_positions: Buffer = Buffer::f32(&[]),
        skin_indices: Buffer = Buffer::u16(&[]),
        skin_weights: Buffer = Buffer::f32(&[]),
    }
    /// Props of [`Message::BoxMessage`]; dimensions in m.
    BoxProps {
        dimensions: Xyz = [1.0, 1.0, 1.0],
        color: Rgb = GREY,
        wireframe: bool = false,
        opacity: Option<f64> = None,
        flat_shading: bool = true,
        side: &'static str = "front",
        material: &'static str = "standard",
        cast_shadow: bool = true,
        receive_shadow: bool = true,
        scale: f64 = 1.0,
    }
    /// Props of [`Message::IcosphereMessage`]; radius in m.
    IcosphereProps {
        radius: f64 = 0.5,
        subdivisions: u32 = 3,
        color: Rgb = GREY,
        wireframe: bool = false,
        opacity: Option<f64> = None,
        flat_shading: bool = false,
        side: &'static str = "front",
        material: &'static str = "standard",
        cast_shadow: bool = true,
        receive_shadow: bool = true,
        scale: f64 = 1.0,
    }
    /// Props of [`Message::CylinderMessage`]; radius and height in m.
    CylinderProps {
        radius: f64 = 0.5,
        height: f64 = 1.0,
        color: Rgb = GREY,
        radial_segments: u32 = 32,
        wireframe: bool = false,
        opacity: Option<f64> = None,
        flat_shading: bool = false,
        side: &'static str = "front",
        material: &'static str = "standard",
        cast_shadow: bool = true,
        receive_shadow: bool = true,
        scale: f64 = 1.0,
    }
    /// Props of [`Message::GridMessage`]; lengths in m.
    GridProps {
        width: f64 = 10.0,
        height: f64 = 10.0,
        plane: &'static str = "xy",
        cell_color: Rgb = [215, 215, 215],
        cell_thickness: f64 = 1.0,
        cell_size: f64 = 0.1,
        section_color: Rgb = [165, 165, 165],
        section_thickness: f64 = 1.0,
        section_size: f64 = 0.5,
        infinite_grid: bool = true,
        fade_distance: f64 = 6.0,
        fade_strength: f64 = 1.0,
        fade_from: &'static str = "camera",
        shadow_opacity: f64 = 0.15,
        plane_color: Rgb = [255, 255, 255],
        plane_opacity: f64 = 0.0,
        scale: f64 = 1.0,
    }
    /// Props of [`Message::LineSegmentsMessage`]: points (N, 2, 3) f32, colours (N, 2, 3) u8.
    LineSegmentsProps {
        points: Buffer = Buffer::f32(&[]),
        thickness: f64 = 2.0,
        colors: Buffer = Buffer::u8(&[]),
        scale: f64 = 1.0,
        thickness_units: &'static str = "screen",
    }
    /// Props of [`Message::TransformControlsMessage`]; limits in m and rad.
    TransformControlsProps {
        scale: f64 = 1.0,
        line_width: f64 = 2.5,
        fixed: bool = false,
        active_axes: [bool; 3] = [true, true, true],
        disable_axes: bool = false,
        disable_sliders: bool = false,
        disable_rotations: bool = false,
        translation_limits: [[f64; 2]; 3] = NO_LIMITS,
        rotation_limits: [[f64; 2]; 3] = NO_LIMITS,
        depth_test: bool = true,
        opacity: f64 = 1.0,
    }
    /// Props of [`Message::DirectionalLightMessage`].
    DirectionalLightProps {
        color: Rgb = [255, 255, 255],
        intensity: f64 = 1.0,
        cast_shadow: bool = false,
    }
    /// Props of [`Message::AmbientLightMessage`].
    AmbientLightProps {
        color: Rgb = [255, 255, 255],
        intensity: f64 = 1.0,
    }
}
