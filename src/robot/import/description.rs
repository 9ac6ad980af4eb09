//! The content of a URDF as plain structures, read from the XML that the pre-parse has bounded.
//!
//! Rejected: `urdf-rs`, which parses the text a second and a third time with libraries that
//! take quadratic time for many attributes (RUSTSEC-2026-0194, -0195), loses the place of a
//! mistake, and cannot be given a document that is parsed already.

use std::path::Path;
use std::str::FromStr;

use nalgebra::{Quaternion, UnitQuaternion};
use roxmltree::{Document, Node};

use crate::{Error, preparse};
use robert_base::{limits, xml};

/// A robot: links, and the joints between them.
#[derive(Clone, Debug)]
pub(super) struct Description {
    pub(super) name: String,
    pub(super) links: Vec<Link>,
    pub(super) joints: Vec<Joint>,
    pub(super) materials: Vec<Material>,
}

/// A rigid body.
#[derive(Clone, Debug)]
pub(super) struct Link {
    pub(super) name: String,
    pub(super) inertial: Inertial,
    pub(super) visual: Vec<Visual>,
    pub(super) collision: Vec<Collision>,
}

/// Mass, kg, and inertia, kg m^2, about the origin. All are zero if the file does not give them.
#[derive(Clone, Debug, Default)]
pub(super) struct Inertial {
    pub(super) origin: Pose,
    pub(super) mass: f64,
    pub(super) inertia: Inertia,
}

/// An inertia tensor, kg m^2.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Inertia {
    pub(super) ixx: f64,
    pub(super) ixy: f64,
    pub(super) ixz: f64,
    pub(super) iyy: f64,
    pub(super) iyz: f64,
    pub(super) izz: f64,
}

/// A shape that is looked at.
#[derive(Clone, Debug)]
pub(super) struct Visual {
    pub(super) origin: Pose,
    pub(super) geometry: Geometry,
    pub(super) material: Option<Material>,
}

/// A shape that collides.
#[derive(Clone, Debug)]
pub(super) struct Collision {
    pub(super) origin: Pose,
    pub(super) geometry: Geometry,
}

/// A shape; lengths in m.
#[derive(Clone, Debug)]
pub(super) enum Geometry {
    Box { size: [f64; 3] },
    Cylinder { radius: f64, length: f64 },
    Capsule { radius: f64, length: f64 },
    Sphere { radius: f64 },
    Mesh { filename: String, scale: Option<[f64; 3]> },
}

impl Geometry {
    /// Whether the shape takes no room; meshes always take some.
    pub(super) fn is_empty(&self) -> bool {
        match self {
            Geometry::Box { size } => size.contains(&0.0),
            Geometry::Cylinder { radius, length } | Geometry::Capsule { radius, length } => {
                [radius, length].contains(&&0.0)
            }
            Geometry::Sphere { radius } => *radius == 0.0,
            Geometry::Mesh { .. } => false,
        }
    }
}

/// A colour by name. Without `rgba` it refers to one that the robot defines.
#[derive(Clone, Debug)]
pub(super) struct Material {
    pub(super) name: String,
    pub(super) rgba: Option<[f64; 4]>,
}

/// Position, m, and roll, pitch and yaw, rad, in the frame of the parent.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pose {
    pub(super) xyz: [f64; 3],
    pub(super) rpy: [f64; 3],
}

/// The motion that a joint allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JointType {
    Revolute,
    Continuous,
    Prismatic,
    Fixed,
    Floating,
    Planar,
    Spherical,
}

/// A joint between two links.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    pub(super) name: String,
    pub(super) joint_type: JointType,
    pub(super) origin: Pose,
    pub(super) parent: String,
    pub(super) child: String,
    pub(super) axis: [f64; 3],
    pub(super) limit: Limit,
    pub(super) dynamics: Option<Dynamics>,
    pub(super) mimic: Option<Mimic>,
}

/// Limits of a joint, rad or m, N m or N, rad/s or m/s. If the file does not give them, they are
/// zero, and from URDF 1.2 on infinite.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Limit {
    pub(super) lower: f64,
    pub(super) upper: f64,
    pub(super) effort: f64,
    pub(super) velocity: f64,
}

/// Damping and dry friction of a joint.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Dynamics {
    pub(super) damping: f64,
    pub(super) friction: f64,
}

/// A joint that follows another.
#[derive(Clone, Debug)]
pub(super) struct Mimic {
    pub(super) joint: String,
    pub(super) multiplier: Option<f64>,
    pub(super) offset: Option<f64>,
}

/// Reads the description of a robot.
///
/// # Errors
/// [`Error::Refused`] with the place of what is missing, no number, or too much.
pub(super) fn read(doc: &Document<'_>, path: &Path) -> Result<Description, Error> {
    let root = doc.root_element();
    let reader = Reader { path, root, version: version(root) };
    let all = |tag| root.children().filter(move |n| reader.is(*n, tag));
    for tag in ["link", "joint"] {
        if let Some(extra) = all(tag).nth(limits::BODIES) {
            let message = format!("more than {} {tag}s", limits::BODIES);
            return Err(preparse::refuse(extra, path, message));
        }
    }
    Ok(Description {
        name: root.attribute("name").unwrap_or_default().to_owned(),
        links: all("link").map(|n| reader.link(n)).collect::<Result<_, _>>()?,
        joints: all("joint").map(|n| reader.joint(n)).collect::<Result<_, _>>()?,
        materials: all("material").map(|n| reader.material(n)).collect::<Result<_, _>>()?,
    })
}

/// Version of the format; 1.0 if the file names none that is known.
fn version(root: Node<'_, '_>) -> (u32, u32) {
    let written = root.attribute("version").and_then(|v| v.trim().split_once('.'));
    written.and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?))).unwrap_or((1, 0))
}

#[derive(Clone, Copy)]
struct Reader<'a, 'd> {
    path: &'a Path,
    root: Node<'a, 'd>,
    version: (u32, u32),
}

impl<'a, 'd> Reader<'a, 'd> {
    /// Whether this is an element of URDF: those of others (Gazebo) have namespaces.
    fn is(&self, node: Node<'_, '_>, tag: &str) -> bool {
        let name = node.tag_name();
        node.is_element()
            && name.name() == tag
            && name.namespace() == self.root.tag_name().namespace()
    }

    fn child(&self, node: Node<'a, 'd>, tag: &str) -> Option<Node<'a, 'd>> {
        node.children().find(|n| self.is(*n, tag))
    }

    fn needed(&self, node: Node<'a, 'd>, tag: &str) -> Result<Node<'a, 'd>, Error> {
        self.child(node, tag).ok_or_else(|| {
            let message = format!("<{}> has no <{tag}>", node.tag_name().name());
            preparse::refuse(node, self.path, message)
        })
    }

    fn text(&self, node: Node<'a, 'd>, name: &str) -> Result<&'a str, Error> {
        node.attribute(name).ok_or_else(|| {
            let message = format!("<{}> has no {name}", node.tag_name().name());
            preparse::refuse(node, self.path, message)
        })
    }

    fn parsed<T: FromStr>(&self, node: Node<'a, 'd>, name: &str, v: &str) -> Result<T, Error> {
        v.trim().parse().map_err(|_not_one| {
            let tag = node.tag_name().name();
            let hint = if v.contains('$') { format!("; {}", xml::XACRO) } else { String::new() };
            let message = format!("<{tag} {name}=\"{v}\">: not a number{hint}");
            preparse::refuse(node, self.path, message)
        })
    }

    fn number(&self, node: Node<'a, 'd>, name: &str) -> Result<f64, Error> {
        self.parsed(node, name, self.text(node, name)?)
    }

    fn number_or(&self, node: Node<'a, 'd>, name: &str, missing: f64) -> Result<f64, Error> {
        node.attribute(name).map_or(Ok(missing), |v| self.parsed(node, name, v))
    }

    fn numbers<const N: usize>(
        &self,
        node: Node<'a, 'd>,
        name: &str,
    ) -> Result<Option<[f64; N]>, Error> {
        let Some(written) = node.attribute(name) else { return Ok(None) };
        let all = written
            .split_whitespace()
            .map(|v| self.parsed(node, name, v))
            .collect::<Result<Vec<f64>, _>>()?;
        let found = all.len();
        <[f64; N]>::try_from(all).map(Some).map_err(|_others| {
            let tag = node.tag_name().name();
            let message = format!("<{tag} {name}>: {found} numbers instead of {N}");
            preparse::refuse(node, self.path, message)
        })
    }

    fn link(&self, node: Node<'a, 'd>) -> Result<Link, Error> {
        let all = |tag| node.children().filter(move |n| self.is(*n, tag));
        Ok(Link {
            name: self.text(node, "name")?.to_owned(),
            inertial: self
                .child(node, "inertial")
                .map_or_else(|| Ok(Inertial::default()), |n| self.inertial(n))?,
            visual: all("visual").map(|n| self.visual(n)).collect::<Result<_, _>>()?,
            collision: all("collision")
                .map(|n| Ok(Collision { origin: self.origin(n)?, geometry: self.geometry(n)? }))
                .collect::<Result<_, Error>>()?,
        })
    }

    fn inertial(&self, node: Node<'a, 'd>) -> Result<Inertial, Error> {
        let mass = self.number(self.needed(node, "mass")?, "value")?;
        let at = self.child(node, "inertia");
        let entry = |name| at.map_or(Ok(0.0), |at| self.number(at, name));
        Ok(Inertial {
            origin: self.origin(node)?,
            mass,
            inertia: Inertia {
                ixx: entry("ixx")?,
                ixy: entry("ixy")?,
                ixz: entry("ixz")?,
                iyy: entry("iyy")?,
                iyz: entry("iyz")?,
                izz: entry("izz")?,
            },
        })
    }

    fn visual(&self, node: Node<'a, 'd>) -> Result<Visual, Error> {
        let material = self.child(node, "material").map(|n| self.material(n)).transpose()?;
        Ok(Visual { origin: self.origin(node)?, geometry: self.geometry(node)?, material })
    }

    fn material(&self, node: Node<'a, 'd>) -> Result<Material, Error> {
        let color = self.child(node, "color");
        let rgba = color.map(|c| self.text(c, "rgba").and_then(|_| self.numbers(c, "rgba")));
        Ok(Material {
            name: node.attribute("name").unwrap_or_default().to_owned(),
            rgba: rgba.transpose()?.flatten(),
        })
    }

    fn geometry(&self, node: Node<'a, 'd>) -> Result<Geometry, Error> {
        let node = self.needed(node, "geometry")?;
        let refuse = |message: String| preparse::refuse(node, self.path, message);
        let shape = node.children().find(Node::is_element);
        let shape = shape.ok_or_else(|| refuse("<geometry> has no shape".into()))?;
        let number = |name| self.number(shape, name);
        match shape.tag_name().name() {
            "box" => match self.numbers(shape, "size")? {
                Some(size) => Ok(Geometry::Box { size }),
                None => Err(preparse::refuse(shape, self.path, "<box> has no size")),
            },
            "cylinder" => {
                Ok(Geometry::Cylinder { radius: number("radius")?, length: number("length")? })
            }
            "capsule" => {
                Ok(Geometry::Capsule { radius: number("radius")?, length: number("length")? })
            }
            "sphere" => Ok(Geometry::Sphere { radius: number("radius")? }),
            "mesh" => Ok(Geometry::Mesh {
                filename: self.text(shape, "filename")?.to_owned(),
                scale: self.numbers(shape, "scale")?,
            }),
            other => Err(refuse(format!(
                "<{other}> is no shape; there are box, cylinder, capsule, sphere and mesh"
            ))),
        }
    }

    fn origin(&self, node: Node<'a, 'd>) -> Result<Pose, Error> {
        let Some(at) = self.child(node, "origin") else { return Ok(Pose::default()) };
        let xyz = self.numbers(at, "xyz")?.unwrap_or_default();
        let rpy = self.numbers(at, "rpy")?;
        // Quaternions came with URDF 1.1; older readers ignore them.
        let quat = if self.version >= (1, 1) { self.numbers(at, "quat_xyzw")? } else { None };
        let rpy = match (rpy, quat) {
            (Some(_), Some(_)) => {
                let message = "<origin> has both rpy and quat_xyzw; keep one of them";
                return Err(preparse::refuse(at, self.path, message));
            }
            (rpy, None) => rpy.unwrap_or_default(),
            (None, Some([x, y, z, w])) => {
                let Some(turn) = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9) else {
                    let message = "quat_xyzw of <origin> has no length, so it is no rotation";
                    return Err(preparse::refuse(at, self.path, message));
                };
                let (r, p, y) = turn.euler_angles();
                [r, p, y]
            }
        };
        Ok(Pose { xyz, rpy })
    }

    fn joint(&self, node: Node<'a, 'd>) -> Result<Joint, Error> {
        let link =
            |tag| self.needed(node, tag).and_then(|n| Ok(self.text(n, "link")?.trim().to_owned()));
        let axis = self
            .child(node, "axis")
            .map(|n| self.text(n, "xyz").and_then(|_| self.numbers(n, "xyz")));
        Ok(Joint {
            name: self.text(node, "name")?.to_owned(),
            joint_type: self.joint_type(node)?,
            origin: self.origin(node)?,
            parent: link("parent")?,
            child: link("child")?,
            axis: axis.transpose()?.flatten().unwrap_or([1.0, 0.0, 0.0]),
            limit: self
                .child(node, "limit")
                .map(|n| self.limit(n))
                .transpose()?
                .unwrap_or_default(),
            dynamics: self.child(node, "dynamics").map(|n| self.dynamics(n)).transpose()?,
            mimic: self.child(node, "mimic").map(|n| self.mimic(n)).transpose()?,
        })
    }

    fn joint_type(&self, node: Node<'a, 'd>) -> Result<JointType, Error> {
        Ok(match self.text(node, "type")? {
            "revolute" => JointType::Revolute,
            "continuous" => JointType::Continuous,
            "prismatic" => JointType::Prismatic,
            "fixed" => JointType::Fixed,
            "floating" => JointType::Floating,
            "planar" => JointType::Planar,
            "spherical" => JointType::Spherical,
            other => {
                let message = format!("\"{other}\" is no type of joint");
                return Err(preparse::refuse(node, self.path, message));
            }
        })
    }

    fn limit(&self, node: Node<'a, 'd>) -> Result<Limit, Error> {
        let (lower, upper) =
            (self.number_or(node, "lower", 0.0)?, self.number_or(node, "upper", 0.0)?);
        // From URDF 1.2 on, an end that is not named is no end; before, it is at 0. The simulator has two ends or
        // none.
        let named = ["lower", "upper"].iter().all(|end| node.has_attribute(*end));
        let [lower, upper] =
            if self.version >= (1, 2) && !named { [0.0; 2] } else { [lower, upper] };
        Ok(Limit {
            lower,
            upper,
            effort: self.number_or(node, "effort", 0.0)?,
            velocity: self.number_or(node, "velocity", 0.0)?,
        })
    }

    fn dynamics(&self, node: Node<'a, 'd>) -> Result<Dynamics, Error> {
        Ok(Dynamics {
            damping: self.number_or(node, "damping", 0.0)?,
            friction: self.number_or(node, "friction", 0.0)?,
        })
    }

    fn mimic(&self, node: Node<'a, 'd>) -> Result<Mimic, Error> {
        let optional =
            |name| node.attribute(name).map(|v| self.parsed::<f64>(node, name, v)).transpose();
        Ok(Mimic {
            joint: self.text(node, "joint")?.to_owned(),
            multiplier: optional("multiplier")?,
            offset: optional("offset")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Description, String> {
        let doc = robert_base::xml::parse(text, limits::XML_ELEMENTS).unwrap();
        read(&doc, Path::new("a.urdf")).map_err(|e| e.to_string())
    }

    #[test]
    fn a_namespace_of_its_own_and_foreign_elements_do_no_harm() {
        let text = r#"<robot name="r" xmlns="http://www.ros.org" xmlns:g="http://gazebosim.org">
            <g:link name="ghost"/><link name="a"/><link name="b"/>
            <joint name="j" type="revolute"><parent link="a"/><child link="b"/>
              <limit lower="-1" upper=" 2 " effort="3"/></joint></robot>"#;
        let robot = parse(text).unwrap();
        assert_eq!((robot.links.len(), robot.joints.len()), (2, 1));
        let j = robot.joints.first().unwrap();
        assert_eq!((j.limit.upper, j.limit.velocity, j.axis), (2.0, 0.0, [1.0, 0.0, 0.0]));
    }

    #[test]
    fn ends_that_are_not_named_are_at_0_or_do_not_exist() {
        let limit = |version: &str, written: &str| {
            let text = format!(
                "<robot version=\"{version}\"><joint name=\"j\" type=\"revolute\"><parent link=\"a\"/>\
                 <child link=\"b\"/><limit {written}/></joint><link name=\"a\"/><link name=\"b\"/></robot>"
            );
            let l = &parse(&text).unwrap().joints[0].limit;
            [l.lower, l.upper, l.effort, l.velocity]
        };
        assert_eq!(limit("1.0", "upper=\"2\""), [0.0, 2.0, 0.0, 0.0]);
        assert_eq!(limit("1.2", "upper=\"2\" effort=\"3\""), [0.0, 0.0, 3.0, 0.0]);
        assert_eq!(limit("1.2", "lower=\"-1\" upper=\"2\""), [-1.0, 2.0, 0.0, 0.0]);
    }

    #[test]
    fn a_quaternion_turns_as_its_angles_do() {
        let robot = |version: &str, origin: &str| {
            parse(&format!(
                "<robot version=\"{version}\"><link name=\"a\"><collision>{origin}<geometry>\
                 <sphere radius=\"1\"/></geometry></collision></link></robot>"
            ))
            .map(|r| r.links[0].collision[0].origin.rpy)
        };
        let quarter = "<origin quat_xyzw=\"0 0 0.70710678 0.70710678\"/>";
        let [r, p, y] = robot("1.1", quarter).unwrap();
        assert!(r.abs() < 1e-6 && p.abs() < 1e-6);
        assert!((y - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
        assert_eq!(robot("1.0", quarter).unwrap(), [0.0; 3], "unknown to URDF 1.0");
        let both = quarter.replace("/>", " rpy=\"0 0 0\"/>");
        assert!(robot("1.1", &both).unwrap_err().contains("both rpy and quat_xyzw"));
        let none = "<origin quat_xyzw=\"0 0 0 0\"/>";
        assert!(robot("1.1", none).unwrap_err().contains("no rotation"));
    }

    #[test]
    fn mistakes_have_their_place() {
        let joint = |inside: &str| {
            format!("<robot>\n <joint name=\"j\" type=\"fixed\">\n  {inside}</joint></robot>")
        };
        let ends = "<parent link=\"a\"/><child link=\"b\"/>";
        for (text, said) in [
            (joint("<child link=\"b\"/>"), "a.urdf:2:2: <joint> has no <parent>"),
            (joint("<parent/>"), "a.urdf:3:3: <parent> has no link"),
            (joint(&format!("{ends}\n<axis xyz=\"1 0\"/>")), "4:1: <axis xyz>: 2 numbers instead"),
            (joint(&format!("{ends}<axis xyz=\"1 0 z\"/>")), "not a number"),
            (joint(&format!("{ends}<axis xyz=\"$(optenv A 1 0 0)\"/>")), "expand it first"),
            (joint(ends).replace("fixed", "bent"), "\"bent\" is no type of joint"),
            (
                "<robot><link name=\"a\"><visual><geometry><cone/></geometry></visual></link></robot>"
                    .into(),
                "<cone> is no shape",
            ),
            (format!("<robot>{}</robot>", "<link name=\"a\"/>".repeat(1025)), "more than 1024 links"),
        ] {
            let e = parse(&text).unwrap_err();
            assert!(e.contains(said), "{e}");
        }
    }
}
