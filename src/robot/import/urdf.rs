//! A URDF as a draft: tree, paths and MJCF text.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use roxmltree::{Document, Node};

use super::config::ImportConfig;
use super::description::{self, Description, Geometry, Joint, JointType, Link, Pose};
use super::draft::{ASSET_DIR, Draft, physics};
use super::packages;
use super::sound::check_tree;
use crate::derive::digits;
use crate::preparse::Unresolved;
use crate::text::escape;
use crate::{Error, dae, mesh, preparse};

/// A geom's attributes, and the colour that the mesh file gives.
type Colored = (String, Option<[f64; 4]>);

/// Rotor inertia, kg m^2 or kg, since no URDF gives it.
const ARMATURE: f64 = 0.01;
/// The most of it per unit of the torque limit, s^2, so that a small motor has a small rotor. An added
/// drive has as much.
const ARMATURE_OF_LIMIT: f64 = 0.003;
/// Density that is assumed for what the file gives no inertia, kg/m^3.
const DENSITY: f64 = 1000.0;
/// Mass and inertia of moving links that have neither inertia nor collision shapes.
const GHOST: (f64, f64) = (1e-3, 1e-6);
/// The simulator takes a principal moment below this for none, kg m^2.
const LEAST_MOMENT: f64 = 1e-14;

/// Colour of what has none.
const PLAIN: [f64; 4] = [0.7, 0.7, 0.72, 1.0];

/// Mesh files with their colours.
type Painted = Vec<(String, Option<[f64; 4]>)>;

/// The robot under work.
struct Tree<'a> {
    robot: &'a Description,
    doc: &'a Document<'a>,
    project: &'a preparse::Project,
    config: &'a ImportConfig,
    /// Joints by parent link.
    children: BTreeMap<&'a str, Vec<&'a Joint>>,
    materials: BTreeMap<&'a str, [f64; 4]>,
    /// Mesh assets by file and scale: name.
    meshes: BTreeMap<(String, String), String>,
    /// Parts of COLLADA meshes by file.
    painted: BTreeMap<PathBuf, Painted>,
    /// Folders of packages that the user did not name.
    found: BTreeMap<String, PathBuf>,
    /// What was said of files; each is reported once.
    said: BTreeSet<String>,
    draft: Draft,
    body: String,
    motors: String,
    equalities: String,
    /// Joints that are held at their zero.
    welded: BTreeSet<&'a str>,
}

pub(super) fn draft(project: &preparse::Project, config: &ImportConfig) -> Result<Draft, Error> {
    let path = &project.path;
    let doc = preparse::parse(&project.xml, path)?;
    let whole = |message: String| preparse::refuse(doc.root_element(), path, message);
    let robot = description::read(&doc, path)?;
    if robot.links.is_empty() {
        let tags = doc.root_element().children().filter(Node::is_element).count();
        let hint = if tags > 0 { "; is it a xacro template?" } else { "" };
        return Err(whole(format!("the robot has no link{hint}")));
    }
    let root = check_tree(&robot, &doc, path)?;
    let mut tree = Tree {
        children: BTreeMap::new(),
        materials: robot
            .materials
            .iter()
            .filter_map(|m| Some((m.name.as_str(), m.rgba?)))
            .collect(),
        robot: &robot,
        doc: &doc,
        project,
        config,
        meshes: BTreeMap::new(),
        painted: BTreeMap::new(),
        found: packages::find(&doc, path, &config.packages),
        said: BTreeSet::new(),
        draft: Draft { title: robot.name.clone(), rotors_assumed: true, ..Draft::default() },
        body: String::new(),
        motors: String::new(),
        equalities: String::new(),
        welded: BTreeSet::new(),
    };
    for joint in &robot.joints {
        tree.children.entry(joint.parent.as_str()).or_default().push(joint);
    }
    if let Some(name) = config.without.first() {
        let message = format!("--without {name}: only bodies of an MJCF are left out");
        return Err(Error::Unfit { message, path: path.clone() });
    }
    for name in &config.weld {
        if !robot.joints.iter().any(|j| j.name == *name) {
            let message = format!("--weld {name}: there is no such joint");
            return Err(Error::Unfit { message, path: path.clone() });
        }
    }
    tree.weld()?;
    if doc.descendants().any(|n| n.has_tag_name("transmission") || n.has_tag_name("gazebo")) {
        tree.draft.dropped.push("<transmission> and <gazebo>: not part of the kinematics".into());
    }
    tree.link(root, None, true, 1)?;
    for (package, folder) in &tree.found {
        let line = format!("package \"{package}\" is the folder {}", folder.display());
        tree.draft.assumed.push(line);
    }
    tree.finish()
}

impl<'a> Tree<'a> {
    fn path(&self) -> &'a Path {
        &self.project.path
    }

    /// Welds what the user names, and what follows it.
    fn weld(&mut self) -> Result<(), Error> {
        self.welded = self.config.weld.iter().map(String::as_str).collect();
        loop {
            let follows = |j: &&Joint| {
                if matches!(j.joint_type, JointType::Fixed) {
                    return false;
                }
                let leader = j.mimic.as_ref().map(|m| m.joint.as_str());
                leader.is_some_and(|l| self.welded.contains(l))
                    && !self.welded.contains(j.name.as_str())
            };
            let Some(j) = self.robot.joints.iter().find(follows) else { return Ok(()) };
            let (leader, offset) =
                j.mimic.as_ref().map_or(("", 0.0), |m| (m.joint.as_str(), m.offset.unwrap_or(0.0)));
            if offset != 0.0 {
                let message = format!(
                    "follows the welded joint \"{leader}\" with an offset of {offset}, and joints are welded \
                     at their zero; remove its <mimic>, or weld it at zero, too: --weld {}",
                    j.name
                );
                return Err(self.refuse_joint(j, &message));
            }
            self.welded.insert(&j.name);
        }
    }

    fn joint_node(&self, name: &str) -> Node<'a, 'a> {
        self.doc
            .root_element()
            .children()
            .find(|n| n.has_tag_name("joint") && n.attribute("name") == Some(name))
            .unwrap_or_else(|| self.doc.root_element())
    }

    /// Whether the source says anything about the link's mass.
    fn has_inertial(&self, link: &str) -> bool {
        self.doc
            .root_element()
            .children()
            .filter(|n| n.has_tag_name("link") && n.attribute("name") == Some(link))
            .any(|n| n.children().any(|c| c.has_tag_name("inertial")))
    }

    fn refuse_joint(&self, j: &Joint, message: &str) -> Error {
        preparse::refuse(
            self.joint_node(&j.name),
            self.path(),
            format!("joint \"{}\" {message}", j.name),
        )
    }

    /// Writes a link as a body, and its children inside of it.
    fn link(
        &mut self,
        link: &'a Link,
        joint: Option<&'a Joint>,
        anchored: bool,
        deep: usize,
    ) -> Result<(), Error> {
        // 2.2.2 refuses an XML nested 100 deep; a body is one level.
        if deep > 90 {
            let message =
                format!("link \"{}\" is more than 90 joints away from the base", link.name);
            return Err(preparse::refuse(self.doc.root_element(), self.path(), message));
        }
        let pad = "  ".repeat(deep);
        let is_world = joint.is_none() && link.name == "world";
        let moving = joint.is_some_and(|j| self.moves(j));
        let anchored = anchored && !moving;
        let above = std::mem::take(&mut self.body);
        let weighs = self.shapes(link, &pad)?;
        let shapes = std::mem::replace(&mut self.body, above);
        if !is_world {
            let at = joint.map_or_else(
                || format!("pos=\"0 0 {}\"", self.config.base_height_m),
                |j| frame(&j.origin),
            );
            writeln!(self.body, "{pad}<body name=\"{}\" {at}>", escape(&link.name)).ok();
            self.inertial(link, moving, anchored, weighs, &pad);
            if let Some(j) = joint {
                self.joint(j, &pad)?;
            }
        }
        self.body.push_str(&shapes);
        let children = self.children.get(link.name.as_str()).cloned().unwrap_or_default();
        if children.is_empty() && !is_world {
            writeln!(
                self.body,
                "{pad}  <site name=\"{}_tip\" size=\"0.005\" group=\"4\"/>",
                escape(&link.name)
            )
            .ok();
        }
        for j in children {
            if let Some(child) = self.robot.links.iter().find(|l| l.name == j.child) {
                self.link(child, Some(j), anchored, deep + 1)?;
            }
        }
        if !is_world {
            writeln!(self.body, "{pad}</body>").ok();
        }
        Ok(())
    }

    fn moves(&self, j: &Joint) -> bool {
        !matches!(j.joint_type, JointType::Fixed | JointType::Floating)
            && !self.welded.contains(j.name.as_str())
    }

    /// Writes the inertia of a link that is `moving` relative to its parent, or moves with it, or is
    /// `anchored` in the world. Without one in the source its shapes are weighed, if it has some.
    fn inertial(&mut self, link: &Link, moving: bool, anchored: bool, weighs: bool, pad: &str) {
        let i = &link.inertial;
        if i.mass <= 0.0 {
            if moving && !weighs {
                let (mass, inertia) = GHOST;
                writeln!(
                    self.body,
                    "{pad}  <inertial pos=\"0 0 0\" mass=\"{mass}\" diaginertia=\"{inertia} {inertia} {inertia}\"/>"
                )
                .ok();
                self.draft.assumed.push(format!(
                    "link \"{}\" has no inertia: {mass} kg, {inertia} kg m^2",
                    link.name
                ));
            } else if anchored || !moving && self.has_inertial(&link.name) {
                // A massless frame, such as a tool's, has no shapes that could have mass, and what is
                // fixed to the world needs none.
                writeln!(
                    self.body,
                    "{pad}  <inertial pos=\"0 0 0\" mass=\"0\" diaginertia=\"0 0 0\"/>"
                )
                .ok();
            } else if weighs {
                self.draft.assumed.push(format!(
                    "link \"{}\" has no inertia: that of its collision shapes at {DENSITY} kg/m^3",
                    link.name
                ));
            }
            return;
        }
        let t = &i.inertia;
        let own = Matrix3::new(t.ixx, t.ixy, t.ixz, t.ixy, t.iyy, t.iyz, t.ixz, t.iyz, t.izz);
        let r = rotation(&i.origin);
        let m = r * own * r.transpose();
        // Balanced here and not by the compiler, so that the report can name the links.
        let moments = m.symmetric_eigenvalues();
        let (lo, sum) = (moments.min(), moments.sum());
        let broken = lo < LEAST_MOMENT || 2.0 * moments.max() > sum * (1.0 + 1e-9);
        let [x, y, z] = i.origin.xyz;
        let values = if broken {
            let radius = (3.0 * i.mass / (4.0 * std::f64::consts::PI * DENSITY)).cbrt();
            let ball = 0.4 * i.mass * radius.powi(2);
            let mean = if sum == 0.0 { ball } else { sum / 3.0 }.max(1e-9);
            let why = if sum == 0.0 {
                format!(
                    "it has a mass and no inertia; {mean:.3e} kg m^2, as a ball of {DENSITY} kg/m^3"
                )
            } else if lo > 0.0 && lo < LEAST_MOMENT {
                format!("its inertia is less than the simulator takes; {mean} kg m^2 instead")
            } else {
                let list = |v: &[f64]| {
                    v.iter().map(|v| digits(*v, 3).to_string()).collect::<Vec<_>>().join(", ")
                };
                let given = list(&[t.ixx, t.iyy, t.izz, t.ixy, t.ixz, t.iyz]);
                let why = if lo < LEAST_MOMENT {
                    format!("its smallest moment would be {} kg m^2", digits(lo, 3))
                } else {
                    "one moment is larger than the sum of the others".to_owned()
                };
                let mean = digits(mean, 3);
                format!(
                    "no body can have its inertia (ixx, iyy, izz, ixy, ixz, iyz: {given} kg m^2): {why}; made round \
                     with the same trace: {mean} kg m^2 about each axis. Check the file: a wrong inertia changes how \
                     the robot moves"
                )
            };
            self.draft.changed.push(format!("link \"{}\": {why}", link.name));
            format!("diaginertia=\"{mean} {mean} {mean}\"")
        } else {
            let [a, b, c] = [m[(0, 1)], m[(0, 2)], m[(1, 2)]];
            format!("fullinertia=\"{} {} {} {a} {b} {c}\"", m[(0, 0)], m[(1, 1)], m[(2, 2)])
        };
        writeln!(self.body, "{pad}  <inertial pos=\"{x} {y} {z}\" mass=\"{}\" {values}/>", i.mass)
            .ok();
    }

    fn joint(&mut self, j: &Joint, pad: &str) -> Result<(), Error> {
        if self.welded.contains(j.name.as_str()) {
            let led = j.mimic.as_ref().map(|m| m.joint.as_str());
            let how = match led {
                Some(leader) if self.welded.contains(leader) => {
                    format!("with \"{leader}\", which it follows")
                }
                Some(leader) => format!("at its zero, and no longer follows \"{leader}\""),
                None => "at its zero".to_owned(),
            };
            self.draft.changed.push(format!("joint \"{}\" is welded {how}", j.name));
            return Ok(());
        }
        let kind = match j.joint_type {
            JointType::Fixed => return Ok(()),
            JointType::Revolute | JointType::Continuous => "hinge",
            JointType::Prismatic => "slide",
            JointType::Floating if self.config.fixed_base => {
                self.draft
                    .changed
                    .push(format!("joint \"{}\" no longer floats: held where it is", j.name));
                return Ok(());
            }
            JointType::Floating => {
                return Err(self.refuse_joint(j, "floats freely; the state takes hinge and slide joints only. To hold it still: --fixed-base"));
            }
            JointType::Planar => {
                let how = "is planar; write it as two prismatic joints and a revolute one";
                return Err(self.refuse_joint(j, &or_weld(how, &j.name)));
            }
            JointType::Spherical => {
                let how = "is spherical; write it as three revolute joints";
                return Err(self.refuse_joint(j, &or_weld(how, &j.name)));
            }
        };
        let [x, y, z] = j.axis;
        let own = Some(j.limit.effort).filter(|e| e.is_finite() && *e > 0.0).or(self.config.effort);
        let armature = own.map_or(ARMATURE, |e| digits(e * ARMATURE_OF_LIMIT, 4).min(ARMATURE));
        write!(self.body, "{pad}  <joint name=\"{}\" type=\"{kind}\" axis=\"{x} {y} {z}\" armature=\"{armature}\"", escape(&j.name)).ok();
        if let Some(d) = &j.dynamics {
            if d.damping > 0.0 {
                write!(self.body, " damping=\"{}\"", d.damping).ok();
            }
            if d.friction > 0.0 {
                write!(self.body, " frictionloss=\"{}\"", d.friction).ok();
            }
        }
        let limit = &j.limit;
        if let Some([lower, upper]) = self.stops(j) {
            write!(self.body, " limited=\"true\" range=\"{lower} {upper}\"").ok();
        }
        self.body.push_str("/>\n");
        if limit.velocity > 0.0 {
            self.draft.speeds.insert(j.name.clone(), limit.velocity);
        }
        if let Some(m) = &j.mimic {
            let (offset, factor) = (m.offset.unwrap_or(0.0), m.multiplier.unwrap_or(1.0));
            writeln!(
                self.equalities,
                "    <joint joint1=\"{}\" joint2=\"{}\" polycoef=\"{offset} {factor} 0 0 0\"/>",
                escape(&j.name),
                escape(&m.joint)
            )
            .ok();
            self.draft.changed.push(format!(
                "joint \"{}\" follows \"{}\" by an equality and has no motor",
                j.name, m.joint
            ));
            return Ok(());
        }
        let effort = if limit.effort > 0.0 {
            limit.effort
        } else {
            self.draft.effortless.insert(j.name.clone());
            1.0
        };
        writeln!(
            self.motors,
            "    <motor name=\"{0}\" joint=\"{0}\" ctrllimited=\"true\" ctrlrange=\"-{effort} {effort}\"/>",
            escape(&j.name)
        )
        .ok();
        Ok(())
    }

    /// The end stops of a joint, rad or m; `None` if it has none, which is reported.
    fn stops(&mut self, j: &Joint) -> Option<[f64; 2]> {
        if j.joint_type == JointType::Continuous {
            return None;
        }
        let own = [j.limit.lower, j.limit.upper];
        if own[0] >= own[1] {
            let limit = self.joint_node(&j.name).children().find(|n| n.has_tag_name("limit"));
            let named =
                |n: roxmltree::Node<'_, '_>| n.has_attribute("lower") && n.has_attribute("upper");
            let why = match limit {
                None => "it has no <limit>",
                Some(limit) if !named(limit) => "its <limit> does not name both",
                Some(_) => "lower and upper are equal",
            };
            self.draft.assumed.push(format!("joint \"{}\" has no end stops: {why}", j.name));
            return None;
        }
        // What differs by rounding stays.
        let beyond =
            |led: f64, own: f64, side: f64| if side * (led - own) > 1e-4 { led } else { own };
        let wide =
            self.led(j).map_or(own, |[a, b]| [beyond(a, own[0], -1.0), beyond(b, own[1], 1.0)]);
        if wide != own {
            let [[lower, upper], [low, high]] = [own, wide];
            self.draft.changed.push(format!(
                "joint \"{}\" stops at {low} and {high} instead of {lower} and {upper}, which would not let \
                 it follow its leader",
                j.name
            ));
        }
        Some(wide)
    }

    /// The positions to which its leader leads a joint, rad or m, lowest and highest.
    fn led(&self, j: &Joint) -> Option<[f64; 2]> {
        let m = j.mimic.as_ref()?;
        let leader = self.robot.joints.iter().find(|l| l.name == m.joint)?;
        let (lower, upper) = (leader.limit.lower, leader.limit.upper);
        if leader.joint_type == JointType::Continuous || lower >= upper {
            return None;
        }
        let at = |x: f64| {
            let led = m.offset.unwrap_or(0.0) + m.multiplier.unwrap_or(1.0) * x;
            (led * 1e6).round() / 1e6
        };
        let (a, b) = (at(lower), at(upper));
        Some([a.min(b), a.max(b)])
    }

    /// Writes the shapes of a link; returns whether some have mass.
    fn shapes(&mut self, link: &'a Link, pad: &str) -> Result<bool, Error> {
        let (mut seen, mut weighs) = (false, false);
        for v in &link.visual {
            let own = v
                .material
                .as_ref()
                .and_then(|m| m.rgba.or_else(|| self.materials.get(m.name.as_str()).copied()));
            for (shape, painted) in self.shape(&v.geometry, &link.name, "visual")? {
                let [r, g, b, a] = painted.or(own).unwrap_or(PLAIN).map(|c| c.clamp(0.0, 1.0));
                writeln!(
                    self.body,
                    "{pad}  <geom {shape} {} contype=\"0\" conaffinity=\"0\" group=\"2\" mass=\"0\" rgba=\"{r} {g} {b} {a}\"/>",
                    frame(&v.origin)
                )
                .ok();
                seen = true;
            }
        }
        // Without visual shapes, the collision shapes are shown.
        let group = if seen { 3 } else { 1 };
        for c in &link.collision {
            for (shape, _) in self.shape(&c.geometry, &link.name, "collision")? {
                writeln!(
                    self.body,
                    "{pad}  <geom {shape} {} group=\"{group}\"/>",
                    frame(&c.origin)
                )
                .ok();
                weighs = true;
            }
        }
        Ok(weighs)
    }

    /// Types and sizes of the geoms of a shape, with colours if its file has some; none if the file
    /// cannot be used, which is reported.
    fn shape(
        &mut self,
        geometry: &Geometry,
        link: &str,
        what: &str,
    ) -> Result<Vec<Colored>, Error> {
        if geometry.is_empty() {
            self.draft.dropped.push(format!("{what} shape of link \"{link}\": its size is 0"));
            return Ok(Vec::new());
        }
        let one = |text: String| Ok(vec![(text, None)]);
        let (filename, scale) = match geometry {
            Geometry::Box { size: s } => {
                return one(format!(
                    "type=\"box\" size=\"{} {} {}\"",
                    s[0] / 2.0,
                    s[1] / 2.0,
                    s[2] / 2.0
                ));
            }
            Geometry::Cylinder { radius, length } => {
                return one(format!("type=\"cylinder\" size=\"{radius} {}\"", length / 2.0));
            }
            Geometry::Capsule { radius, length } => {
                return one(format!("type=\"capsule\" size=\"{radius} {}\"", length / 2.0));
            }
            Geometry::Sphere { radius } => {
                return one(format!("type=\"sphere\" size=\"{radius}\""));
            }
            Geometry::Mesh { filename, scale } => (filename, scale),
        };
        if !is_read(geometry) {
            let extension = mesh::extension(Path::new(filename));
            self.leave_out(
                filename,
                link,
                what,
                &format!(".{extension} is not read (STL, OBJ and DAE are)"),
            );
            return Ok(Vec::new());
        }
        let found = self.locate(filename)?;
        let file = match found.and_then(|file| mesh::check_file(&file).map(|_bytes| file)) {
            Ok(file) => file,
            // Motion does not depend on what is only drawn.
            Err(why) if what == "visual" || self.config.without_meshes => {
                self.leave_out(filename, link, what, &why);
                return Ok(Vec::new());
            }
            Err(why) => {
                let way = "find or mend the file, or leave out what is missing: --without-meshes";
                return Err(self.refuse_mesh(filename, &format!("{why}; {way}")));
            }
        };
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let otherwise = || {
            let end = filename.get(filename.len().wrapping_sub(name.len())..);
            end.is_some_and(|end| end != name && end.eq_ignore_ascii_case(&name))
        };
        if otherwise() && self.said.insert(format!("{filename} case")) {
            self.draft.assumed.push(format!("mesh \"{filename}\" is the file {name}"));
        }
        let files = if mesh::extension(&file) == "dae" {
            match self.collada(&file)? {
                Ok(files) => files,
                Err(why) => {
                    self.leave_out(filename, link, what, &why);
                    return Ok(Vec::new());
                }
            }
        } else {
            vec![(self.draft.take_changed(&file, mesh::in_one_group)?, None)]
        };
        let scale = scale.map_or_else(String::new, |s| format!("{} {} {}", s[0], s[1], s[2]));
        Ok(files
            .into_iter()
            .map(|(name, rgba)| {
                let count = self.meshes.len();
                let key = (name, scale.clone());
                let id = self.meshes.entry(key).or_insert_with(|| format!("mesh_{count}"));
                (format!("type=\"mesh\" mesh=\"{id}\""), rgba)
            })
            .collect())
    }

    /// Reports once that a mesh is missing in the result.
    fn leave_out(&mut self, filename: &str, link: &str, what: &str, why: &str) {
        if self.said.insert(format!("{filename} {what}")) {
            let line = format!("{what} mesh \"{filename}\" of link \"{link}\": {why}");
            // What is only drawn changes no motion.
            if what == "collision" {
                self.draft.warnings.push(format!("{line}; the link passes through others there"));
            } else {
                self.draft.dropped.push(line);
            }
        }
    }

    /// Files and colours of the parts of a COLLADA mesh; the inner error is why it has none.
    fn collada(&mut self, file: &Path) -> Result<Result<Painted, String>, Error> {
        if let Some(known) = self.painted.get(file) {
            return Ok(Ok(known.clone()));
        }
        let parts = match dae::read(file) {
            Ok(parts) => parts,
            Err(why) => return Ok(Err(why)),
        };
        let mut files = Painted::new();
        for part in &parts {
            for piece in part.to_stl() {
                files.push((self.draft.add(file, "stl", piece)?, part.rgba));
            }
        }
        self.painted.insert(file.to_owned(), files.clone());
        Ok(Ok(files))
    }

    fn refuse_mesh(&self, filename: &str, message: &str) -> Error {
        let node = self
            .doc
            .descendants()
            .find(|n| n.has_tag_name("mesh") && n.attribute("filename") == Some(filename))
            .unwrap_or_else(|| self.doc.root_element());
        preparse::refuse(node, self.path(), message)
    }

    /// The file of a mesh reference, inside the roots that the user gave; the inner error says that
    /// there is none.
    fn locate(&self, filename: &str) -> Result<Result<PathBuf, String>, Error> {
        let refuse = |m: String| self.refuse_mesh(filename, &m);
        let find = |dir: &Path, written: &str, root: &Path| {
            let other = |why| {
                let alike = preparse::in_other_case(dir, written, root);
                alike.map_or(Err(why), |alike| preparse::resolve(dir, &alike, root))
            };
            match preparse::resolve(dir, written, root) {
                Err(why @ Unresolved::Missing(_)) => other(why),
                found => found,
            }
        };
        // A path of the machine on which the file was written is no attempt to look around on this one.
        let elsewhere = Path::new(filename).is_absolute();
        let found = |file| match file {
            Ok(file) => Ok(Ok(file)),
            Err(Unresolved::Missing(why)) => Ok(Err(why)),
            Err(Unresolved::Refused(why)) if elsewhere => Ok(Err(why)),
            Err(Unresolved::Refused(why)) => Err(refuse(why)),
        };
        let dir = preparse::folder(self.path());
        if let Some(("", below)) = packages::split(filename) {
            let root = &self.project.root;
            return found(
                find(dir, below, root).or_else(|m| find(root, below, root).map_err(|_second| m)),
            );
        }
        if let Some((package, below)) = packages::split(filename) {
            let given = self.config.packages.get(package);
            let Some(root) = given.or_else(|| self.found.get(package)) else {
                if package.contains('=') {
                    return Err(refuse(format!(
                        "\"{filename}\" lies in package \"{package}\", and no package has '=' in its name; correct the address"
                    )));
                }
                let lies = format!("\"{filename}\" lies in package \"{package}\"");
                if self.config.without_meshes {
                    return Ok(Err(format!(
                        "{lies}, which was not found (--package {package}=DIR)"
                    )));
                }
                let said = match packages::guess(self.path(), package, below) {
                    Some(near) if !near.has_file => format!(
                        "{lies}, and {} has no \"{below}\"; name the folder that has it: --package {package}=DIR",
                        near.folder.display()
                    ),
                    near => {
                        let near = near.map_or_else(|| "DIR".into(), |n| n.folder);
                        let near = near.display();
                        format!("{lies}; say where that is: --package {package}={near}")
                    }
                };
                return Err(refuse(format!(
                    "{said}, or leave out what is missing: --without-meshes"
                )));
            };
            let real = root.canonicalize().map_err(|e| {
                refuse(format!("package \"{package}\" is not at {}: {e}", root.display()))
            })?;
            return found(find(&real, below, &real));
        }
        if filename.contains("://") && !filename.starts_with("file://") {
            return Err(refuse(format!(
                "\"{filename}\" is a network address; files are not fetched"
            )));
        }
        let plain = filename.strip_prefix("file://").unwrap_or(filename);
        found(find(dir, plain, &self.project.root))
    }

    fn finish(mut self) -> Result<Draft, Error> {
        if self.motors.is_empty() {
            let message = "the robot has no joint that a motor could drive".to_owned();
            return Err(Error::Unfit { message, path: self.path().to_owned() });
        }
        let mut meshes = String::new();
        let mut list: Vec<_> = self.meshes.iter().map(|((f, s), n)| (n, f, s)).collect();
        list.sort_by_key(|(n, _, _)| n.trim_start_matches("mesh_").parse::<usize>().unwrap_or(0));
        for (name, file, scale) in list {
            let scale =
                if scale.is_empty() { String::new() } else { format!(" scale=\"{scale}\"") };
            writeln!(meshes, "    <mesh name=\"{name}\" file=\"{file}\"{scale}/>").ok();
        }
        let section = |tag: &str, inner: &str| {
            if inner.is_empty() { String::new() } else { format!("  <{tag}>\n{inner}  </{tag}>\n") }
        };
        self.draft.xml = format!(
            "<mujoco model=\"{}\">\n  <compiler angle=\"radian\" meshdir=\"{ASSET_DIR}\"/>\n  {}\n{}  <worldbody>\n{}  </worldbody>\n{}{}</mujoco>\n",
            escape(&self.draft.title),
            physics(),
            section("asset", &meshes),
            self.body,
            section("equality", &self.equalities),
            section("actuator", &self.motors),
        );
        self.draft.assumed.push("the root link is fixed to the world".into());
        self.draft.assumed.push(format!("armature {ARMATURE} at every joint without another, less where the effort limit is below {:.1}", ARMATURE / ARMATURE_OF_LIMIT));
        Ok(self.draft)
    }
}

/// The same message with the other solution: the joint is fixed.
fn or_weld(how: &str, joint: &str) -> String {
    format!("{how}, or hold it still: --weld {joint}")
}

/// Whether a shape can be taken over: all but those without size and meshes in formats that are
/// not read.
fn is_read(geometry: &Geometry) -> bool {
    let Geometry::Mesh { filename, .. } = geometry else { return !geometry.is_empty() };
    matches!(mesh::extension(Path::new(filename)).as_str(), "stl" | "obj" | "msh" | "dae")
}

fn rotation(p: &Pose) -> Matrix3<f64> {
    let [roll, pitch, yaw] = p.rpy;
    *Rotation3::from_euler_angles(roll, pitch, yaw).matrix()
}

/// `pos` and `quat` of a URDF origin (fixed-axis roll, pitch, yaw).
fn frame(p: &Pose) -> String {
    let [x, y, z] = p.xyz;
    let [roll, pitch, yaw] = p.rpy;
    let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    format!("pos=\"{x} {y} {z}\" quat=\"{} {} {} {}\"", q.w, q.i, q.j, q.k)
}
