//! Converts COLLADA meshes into triangles by colour. Most visual meshes of ROS packages are `.dae`,
//! which the simulator does not read.
//!
//! Supported: triangles, polylists and polygons (as fans) of the visual scene, node transforms, the
//! unit, diffuse colours. Left out: the up axis, textures, skins, animation. Rejected: an external
//! converter (assimp), another C library to trust with hostile files.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};
use roxmltree::Node;

use robert_base::limits;
use robert_base::xml;

/// Faces in one STL file that the simulator takes.
const STL_FACES: usize = 200_000;

/// The triangles of one colour, m.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    /// Diffuse colour; `None` if the file has none.
    pub(super) rgba: Option<[f64; 4]>,
    /// Corner positions, nine numbers per triangle.
    pub(super) corners: Vec<f32>,
}

impl Part {
    /// Sum of the volumes between the triangles and their centre, m^3; 0 for a flat part.
    fn volume(&self) -> f64 {
        let point = |c: &[f32]| match c {
            [x, y, z] => Vector3::new(f64::from(*x), f64::from(*y), f64::from(*z)),
            _ => Vector3::zeros(),
        };
        let points: Vec<Vector3<f64>> = self.corners.chunks_exact(3).map(point).collect();
        let centre = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let tetrahedron = |t: &[Vector3<f64>]| match t {
            [a, b, c] => (a - centre).dot(&(b - centre).cross(&(c - centre))).abs() / 6.0,
            _ => 0.0,
        };
        points.chunks_exact(3).map(tetrahedron).sum()
    }

    /// The triangles as binary STL, in files of no more faces than the simulator takes.
    pub(super) fn to_stl(&self) -> Vec<Vec<u8>> {
        self.corners.chunks(9 * STL_FACES).map(stl).collect()
    }
}

fn stl(corners: &[f32]) -> Vec<u8> {
    let faces = corners.len() / 9;
    let mut out = vec![0_u8; 80];
    out.extend((faces as u32).to_le_bytes());
    for face in corners.chunks_exact(9) {
        out.extend([0_u8; 12]);
        for v in face {
            out.extend(v.to_le_bytes());
        }
        out.extend([0_u8; 2]);
    }
    out
}

/// Reads the visual scene of a COLLADA file.
///
/// # Errors
/// What is wrong with it, as a sentence.
pub(super) fn read(path: &Path) -> Result<Vec<Part>, String> {
    let bytes =
        robert_base::fsio::read_capped(path, limits::DAE_BYTES).map_err(|e| e.to_string())?;
    parse(&String::from_utf8_lossy(&bytes))
}

fn parse(text: &str) -> Result<Vec<Part>, String> {
    let text = text.trim_start_matches('\u{feff}');
    let doc = xml::parse(text, limits::DAE_ELEMENTS).map_err(|e| e.to_string())?;
    let root = doc.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err("it is not a COLLADA file".into());
    }
    let mut reader = Reader {
        ids: doc.descendants().filter_map(|n| Some((n.attribute("id")?, n))).collect(),
        parts: BTreeMap::new(),
        faces: 0,
        nodes: 0,
    };
    let asset = child(root, "asset");
    let unit = asset.and_then(|a| child(a, "unit")).and_then(|u| u.attribute("meter"));
    let metre = unit.unwrap_or("1").trim().parse().ok().filter(|m: &f64| m.is_finite() && *m > 0.0);
    let metre = metre.ok_or("the meter of its unit is not a positive number")?;
    // The axis that points up is ignored, as in RViz: robots were drawn to look right there.
    let world = Matrix4::new_scaling(metre);
    for scene in root.descendants().filter(|n| named(*n, "visual_scene")) {
        for node in children(scene, "node") {
            reader.node(node, &world, 0)?;
        }
    }
    let parts: Vec<Part> = reader.parts.into_values().collect();
    solid(parts).ok_or_else(|| "it contains no solid of triangles".into())
}

/// The parts, with flat ones merged into the largest. The simulator refuses a mesh without volume,
/// and it is better to lose the colour of a logo than the shape of the robot. `None` if all are
/// flat.
fn solid(parts: Vec<Part>) -> Option<Vec<Part>> {
    let (mut thick, flat): (Vec<Part>, Vec<Part>) =
        parts.into_iter().partition(|p| p.volume() > 1e-12);
    let largest = thick.iter_mut().max_by_key(|p| p.corners.len())?;
    for p in flat {
        largest.corners.extend(p.corners);
    }
    Some(thick)
}

fn named(node: Node<'_, '_>, tag: &str) -> bool {
    node.is_element() && node.tag_name().name() == tag
}

fn children<'a>(node: Node<'a, 'a>, tag: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |n| named(*n, tag))
}

fn child<'a>(node: Node<'a, 'a>, tag: &'static str) -> Option<Node<'a, 'a>> {
    node.children().find(|n| named(*n, tag))
}

fn numbers<T: std::str::FromStr>(node: Node<'_, '_>) -> Result<Vec<T>, String> {
    let tag = node.tag_name().name();
    xml::numbers(node.text().unwrap_or_default())
        .ok_or_else(|| format!("<{tag}> contains something that is not a number"))
}

struct Reader<'a> {
    ids: BTreeMap<&'a str, Node<'a, 'a>>,
    /// Triangles by colour; the colour is stored as bits so that it can be a key.
    parts: BTreeMap<Option<[u64; 4]>, Part>,
    faces: usize,
    nodes: usize,
}

impl<'a> Reader<'a> {
    fn target(&self, node: Node<'a, 'a>, attribute: &str) -> Option<Node<'a, 'a>> {
        self.ids.get(node.attribute(attribute)?.trim_start_matches('#')).copied()
    }

    fn node(
        &mut self,
        node: Node<'a, 'a>,
        above: &Matrix4<f64>,
        deep: usize,
    ) -> Result<(), String> {
        self.nodes += 1;
        if deep > limits::DAE_DEPTH || self.nodes > limits::DAE_NODES {
            return Err("its scene is nested too deeply, or refers to itself".into());
        }
        let mut frame = *above;
        const MOVES: [&str; 4] = ["matrix", "translate", "scale", "rotate"];
        for part in node.children().filter(|n| MOVES.iter().any(|tag| named(*n, tag))) {
            let v: Vec<f64> = numbers(part)?;
            let own = match (part.tag_name().name(), v.as_slice()) {
                ("matrix", m) if m.len() == 16 => Matrix4::from_row_slice(m),
                ("translate", [x, y, z]) => Matrix4::new_translation(&Vector3::new(*x, *y, *z)),
                ("scale", [x, y, z]) => Matrix4::new_nonuniform_scaling(&Vector3::new(*x, *y, *z)),
                ("rotate", [x, y, z, degrees]) => {
                    let Some(axis) = Unit::try_new(Vector3::new(*x, *y, *z), 1e-12) else {
                        continue;
                    };
                    Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous()
                }
                _ => continue,
            };
            frame *= own;
        }
        for instance in children(node, "instance_geometry") {
            self.geometry(instance, &frame)?;
        }
        for instance in children(node, "instance_node") {
            if let Some(other) = self.target(instance, "url") {
                self.node(other, &frame, deep + 1)?;
            }
        }
        for below in children(node, "node") {
            self.node(below, &frame, deep + 1)?;
        }
        Ok(())
    }

    /// Diffuse colours of an instance by material symbol.
    fn colors(&self, instance: Node<'a, 'a>) -> BTreeMap<&'a str, [f64; 4]> {
        let bound = instance.descendants().filter(|n| named(*n, "instance_material"));
        bound
            .filter_map(|m| {
                let material = self.target(m, "target")?;
                let effect = self.target(child(material, "instance_effect")?, "url")?;
                let diffuse = effect.descendants().find(|n| named(*n, "diffuse"))?;
                // A colour that cannot be read leaves the part without one.
                let rgba: [f64; 4] = numbers(child(diffuse, "color")?).ok()?.try_into().ok()?;
                Some((m.attribute("symbol")?, rgba.map(|c| c.clamp(0.0, 1.0))))
            })
            .collect()
    }

    fn geometry(&mut self, instance: Node<'a, 'a>, frame: &Matrix4<f64>) -> Result<(), String> {
        let colors = self.colors(instance);
        let Some(mesh) = self.target(instance, "url").and_then(|g| child(g, "mesh")) else {
            return Ok(());
        };
        for tag in ["triangles", "polylist", "polygons"] {
            for primitive in children(mesh, tag) {
                let rgba = primitive.attribute("material").and_then(|m| colors.get(m)).copied();
                self.primitive(primitive, rgba, frame)?;
            }
        }
        Ok(())
    }

    fn primitive(
        &mut self,
        primitive: Node<'a, 'a>,
        rgba: Option<[f64; 4]>,
        frame: &Matrix4<f64>,
    ) -> Result<(), String> {
        let inputs: Vec<Node<'_, '_>> = children(primitive, "input").collect();
        let offset = |n: &Node<'_, '_>| {
            let written = n.attribute("offset").unwrap_or("0");
            written.parse::<usize>().map_err(|e| format!("offset \"{written}\": {e}"))
        };
        let offsets: Vec<usize> = inputs.iter().map(offset).collect::<Result<_, _>>()?;
        let stride = offsets.iter().max().unwrap_or(&0).saturating_add(1);
        let Some(vertex) = inputs.iter().find(|n| n.attribute("semantic") == Some("VERTEX")) else {
            return Ok(());
        };
        let positions = self
            .target(*vertex, "source")
            .and_then(|v| {
                children(v, "input").find(|n| n.attribute("semantic") == Some("POSITION"))
            })
            .and_then(|p| self.target(p, "source"))
            .and_then(|s| child(s, "float_array"))
            .map(numbers::<f64>)
            .ok_or("a mesh has no positions")??;
        let at = offset(vertex)?;
        let corner = |index: usize| -> Result<[f32; 3], String> {
            let from = index.saturating_mul(3);
            let Some(&[x, y, z]) = positions.get(from..from.saturating_add(3)) else {
                return Err("an index is beyond the positions".into());
            };
            let q = frame.transform_point(&Point3::new(x, y, z));
            let q = [q.x as f32, q.y as f32, q.z as f32];
            if q.iter().all(|v| v.is_finite()) {
                Ok(q)
            } else {
                Err("a position is not finite".into())
            }
        };
        let part = self
            .parts
            .entry(rgba.map(|c| c.map(f64::to_bits)))
            .or_insert_with(|| Part { rgba, corners: Vec::new() });
        let counts = child(primitive, "vcount").map(numbers::<usize>).transpose()?;
        for p in children(primitive, "p") {
            let list: Vec<usize> = numbers(p)?;
            let mut rest = list.as_slice();
            // Triangles have three corners each, a polygon is one <p>, a polylist counts.
            let sizes: Vec<usize> = match (&counts, primitive.tag_name().name()) {
                (Some(c), "polylist") => c.clone(),
                (_, "polygons") => vec![list.len() / stride],
                _ => vec![3; list.len() / stride / 3],
            };
            for n in sizes {
                let Some((face, tail)) =
                    n.checked_mul(stride).and_then(|k| rest.split_at_checked(k))
                else {
                    return Err("a polygon lacks indices".into());
                };
                rest = tail;
                let ring: Vec<usize> =
                    face.chunks_exact(stride).filter_map(|c| c.get(at).copied()).collect();
                let Some(&first) = ring.first() else { continue };
                for pair in ring.get(1..).unwrap_or_default().windows(2) {
                    self.faces += 1;
                    if self.faces > limits::MESH_FACES {
                        return Err(format!("more than {} faces", limits::MESH_FACES));
                    }
                    let &[second, third] = pair else { continue };
                    for index in [first, second, third] {
                        part.corners.extend(corner(index)?);
                    }
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pyramid of two colours, in centimetres, y up.
    fn sample(extra: &str) -> String {
        format!(
            r##"<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="cm" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="c"><phong><diffuse><color>.1 .2 .3 1</color></diffuse></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="15">0 0 0 100 0 0 100 0 100 0 0 100 50 90 50</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1" material="blue"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/><p>0 9 1 9 2 9</p></triangles>
<polylist count="2"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4 3</vcount><p>0 1 2 3 0 1 4</p></polylist>
<triangles count="1" material="blue"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 4</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n1"><translate>0 200 0</translate>{extra}
<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="blue" target="#m"/></technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
</COLLADA>"##
        )
    }

    #[test]
    fn colours_and_units_are_heeded_and_the_up_axis_is_not() {
        let parts = parse(&sample("")).unwrap();
        assert_eq!(parts.len(), 2);
        let plain = parts.iter().find(|p| p.rgba.is_none()).unwrap();
        assert_eq!(plain.corners.len(), 27, "a quadrilateral is two triangles");
        let blue = parts.iter().find(|p| p.rgba == Some([0.1, 0.2, 0.3, 1.0])).unwrap();
        let want = [0.0, 2.0, 0.0, 1.0, 2.0, 0.0, 1.0, 2.0, 1.0];
        for (a, b) in blue.corners.iter().zip(want) {
            assert!((a - b).abs() < 1e-6, "{:?}", blue.corners);
        }
        assert_eq!(blue.to_stl()[0].len(), 84 + 2 * 50);
    }

    #[test]
    fn broken_files_are_refused() {
        assert!(parse("<COLLADA/>").unwrap_err().contains("no solid"));
        assert!(parse("<mesh/>").is_err());
        assert!(
            parse(&sample("").replace("<p>0 9 1 9 2 9</p>", "<p>0 9 1 9 77 9</p>"))
                .unwrap_err()
                .contains("beyond")
        );
        assert!(
            parse(&sample("").replace("<vcount>4 3</vcount>", "<vcount>9</vcount>"))
                .unwrap_err()
                .contains("lacks")
        );
        assert!(
            parse(&sample("").replace("<vcount>4 3</vcount>", "<vcount>99999999999999</vcount>"))
                .is_err()
        );
        assert!(parse(&sample("<instance_node url=\"#n1\"/>")).unwrap_err().contains("itself"));
        let unit = sample("").replace("meter=\"0.01\"", "meter=\"O.01\"");
        assert!(parse(&unit).unwrap_err().contains("unit"));
        // A word that is no number must not move all numbers behind it to the front.
        for (whole, broken) in
            [("50 90 50", "50 9O 50"), ("0 1 2 3 0", "0 1 - 3 0"), ("4 3", "4 x")]
        {
            assert!(sample("").contains(whole));
            let error = parse(&sample("").replace(whole, broken)).unwrap_err();
            assert!(error.contains("not a number"), "{error}");
        }
    }

    #[test]
    fn scenes_have_a_limit_of_depth_and_of_nodes() {
        // XML cannot be nested as deeply, but nodes may refer to others.
        let nested = |n: usize| {
            let node = |i| format!("<node id=\"d{i}\"><instance_node url=\"#d{}\"/></node>", i + 1);
            let library: String = (1..=n).map(node).collect();
            let text = sample("<instance_node url=\"#d1\"/>");
            parse(&text.replace("</COLLADA>", &format!("{library}</COLLADA>")))
        };
        assert!(nested(limits::DAE_DEPTH).is_ok());
        assert!(nested(limits::DAE_DEPTH + 1).unwrap_err().contains("nested too deeply"));
        let beside = |n: usize| parse(&sample(&"<node/>".repeat(n - 1)));
        assert!(beside(limits::DAE_NODES).is_ok());
        assert!(beside(limits::DAE_NODES + 1).unwrap_err().contains("nested too deeply"));
    }
}
