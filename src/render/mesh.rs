//! Triangle meshes that are checked and have normals that keep edges sharp.
//!
//! The simulator's vertex normals average over all faces around a vertex, which makes a machined
//! part look inflated. Here a corner averages only faces that meet at less than a crease angle, so
//! a mesh is split at its edges.

use glam::Vec3;

use super::Error;
use super::prims::{Triangles, Vertex};
use robert_base::limits;

/// Faces that meet at less than this are one smooth surface (cosine of 40 degrees).
const CREASE_COS: f32 = 0.766;

/// A mesh in its own frame, ready to draw.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Name in the model.
    pub name: String,
    pub(super) triangles: Triangles,
    /// Corners of the bounding box.
    pub(super) low: Vec3,
    pub(super) high: Vec3,
}

impl Mesh {
    /// From positions (metres, mesh frame) and faces (indices into them, counter-clockwise from
    /// outside).
    ///
    /// # Errors
    /// [`Error::Mesh`] when a face points outside, a vertex is not finite, or there are more
    /// than [`limits::MESH_FACES`] faces.
    pub fn new(name: &str, vertices: &[[f32; 3]], faces: &[[u32; 3]]) -> Result<Mesh, Error> {
        let fail = |reason: String| Error::Mesh { mesh: name.to_owned(), reason };
        if faces.len() > limits::MESH_FACES {
            return Err(fail(format!(
                "{} faces; at most {} can be drawn; decimate it first",
                faces.len(),
                limits::MESH_FACES
            )));
        }
        if faces.is_empty() {
            return Err(fail("no faces".to_owned()));
        }
        if let Some(bad) = vertices.iter().position(|v| !v.iter().all(|x| x.is_finite())) {
            return Err(fail(format!("vertex {bad} is not finite")));
        }
        let count = vertices.len();
        if let Some(bad) = faces.iter().position(|f| f.iter().any(|&i| i as usize >= count)) {
            return Err(fail(format!("face {bad} refers to a vertex beyond the {count} vertices")));
        }
        let (low, high) = bounds(vertices);
        Ok(Mesh { name: name.to_owned(), triangles: smooth(vertices, faces), low, high })
    }

    /// Positions (metres, mesh frame) and faces for exporters; split where the mesh has an
    /// edge, so that smooth shading in a viewer looks as it does here.
    pub fn corners(&self) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let at = |v: &Vertex| [v.p[0], v.p[1], v.p[2]];
        let faces = self.triangles.indices.chunks_exact(3).map(|f| [f[0], f[1], f[2]]);
        (self.triangles.vertices.iter().map(at).collect(), faces.collect())
    }
}

fn bounds(vertices: &[[f32; 3]]) -> (Vec3, Vec3) {
    let mut low = Vec3::INFINITY;
    let mut high = Vec3::NEG_INFINITY;
    for v in vertices {
        low = low.min(Vec3::from_array(*v));
        high = high.max(Vec3::from_array(*v));
    }
    (low, high)
}

fn smooth(vertices: &[[f32; 3]], faces: &[[u32; 3]]) -> Triangles {
    let point = |i: u32| vertices.get(i as usize).map_or(Vec3::ZERO, |v| Vec3::from_array(*v));
    // Area-weighted: the cross product is twice the area long.
    let cross: Vec<Vec3> = faces
        .iter()
        .map(|f| (point(f[1]) - point(f[0])).cross(point(f[2]) - point(f[0])))
        .collect();
    let unit: Vec<Vec3> = cross.iter().map(|c| c.normalize_or_zero()).collect();
    let weld = welded(vertices);
    // Corners (face, corner) grouped by welded vertex, by counting sort.
    let groups = weld.iter().max().map_or(0, |m| *m as usize + 1);
    let mut start = vec![0_u32; groups + 1];
    let group_of = |i: u32| weld.get(i as usize).map_or(0, |g| *g as usize);
    for f in faces {
        for &i in f {
            start[group_of(i) + 1] += 1;
        }
    }
    for k in 0..groups {
        start[k + 1] += start[k];
    }
    let mut fill = start.clone();
    let mut corners = vec![0_u32; faces.len() * 3];
    for (n, f) in faces.iter().enumerate() {
        for (c, &i) in f.iter().enumerate() {
            let slot = &mut fill[group_of(i)];
            corners[*slot as usize] = (3 * n + c) as u32;
            *slot += 1;
        }
    }
    let mut out = Triangles { vertices: Vec::new(), indices: vec![0; faces.len() * 3] };
    let mut made: Vec<(Vec3, u32)> = Vec::new();
    for g in 0..groups {
        let around = &corners[start[g] as usize..start[g + 1] as usize];
        made.clear();
        for &corner in around {
            let face = corner as usize / 3;
            let mut sum = Vec3::ZERO;
            // A fan of thousands (the tip of a dense cone) would need quadratic time; beyond 64 the
            // nearest neighbours in file order represent all.
            for &other in around.iter().take(64) {
                let o = other as usize / 3;
                if unit[o].dot(unit[face]) > CREASE_COS {
                    sum += cross[o];
                }
            }
            let n = (sum + cross[face] * 1e-3).normalize_or(Vec3::Z);
            let same = made.iter().find(|(m, _)| m.dot(n) > 0.9999);
            let index = if let Some((_, index)) = same {
                *index
            } else {
                let p = point(faces[face][corner as usize % 3]);
                let index = out.vertices.len() as u32;
                out.vertices.push(Vertex { p: [p.x, p.y, p.z, 0.0], n: [n.x, n.y, n.z, 0.0] });
                made.push((n, index));
                index
            };
            out.indices[corner as usize] = index;
        }
    }
    in_order_of_use(out)
}

/// Vertices in the order of their use by faces, so that a driver that caches the last few does not
/// compute them again.
fn in_order_of_use(t: Triangles) -> Triangles {
    let mut place = vec![u32::MAX; t.vertices.len()];
    let mut vertices = Vec::with_capacity(t.vertices.len());
    let mut indices = t.indices;
    for i in &mut indices {
        let old = *i as usize;
        if place[old] == u32::MAX {
            place[old] = vertices.len() as u32;
            vertices.push(t.vertices[old]);
        }
        *i = place[old];
    }
    Triangles { vertices, indices }
}

/// For each vertex the number of its position: files often repeat a vertex per face.
fn welded(vertices: &[[f32; 3]]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    // -0.0 and 0.0 are one place.
    let key = |i: u32| vertices[i as usize].map(|x| (x + 0.0).to_bits());
    order.sort_unstable_by_key(|&i| key(i));
    let mut group = vec![0; vertices.len()];
    let mut next = 0_u32;
    for (k, &i) in order.iter().enumerate() {
        if k > 0 && key(order[k - 1]) != key(i) {
            next += 1;
        }
        group[i as usize] = next;
    }
    group
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let v =
            (0..8).map(|i| [0, 1, 2].map(|b| if i >> b & 1 == 1 { 1.0 } else { -1.0 })).collect();
        let f = vec![
            [0, 2, 3],
            [0, 3, 1],
            [4, 5, 7],
            [4, 7, 6],
            [0, 1, 5],
            [0, 5, 4],
            [2, 6, 7],
            [2, 7, 3],
            [0, 4, 6],
            [0, 6, 2],
            [1, 3, 7],
            [1, 7, 5],
        ];
        (v, f)
    }

    #[test]
    fn a_cube_keeps_its_edges() {
        let (v, f) = cube();
        let mesh = Mesh::new("cube", &v, &f).unwrap();
        assert_eq!(mesh.triangles.vertices.len(), 24, "three normals a corner");
        for v in &mesh.triangles.vertices {
            let n = Vec3::new(v.n[0], v.n[1], v.n[2]);
            assert!(n.abs().max_element() > 0.999, "{n}");
            assert!(n.dot(Vec3::new(v.p[0], v.p[1], v.p[2])) > 0.9, "inside out");
        }
    }

    #[test]
    fn damaged_meshes_are_named() {
        let (v, mut f) = cube();
        f[3] = [0, 1, 8];
        let text = Mesh::new("knuckle", &v, &f).unwrap_err().to_string();
        assert!(text.contains("knuckle") && text.contains("face 3"), "{text}");
        let mut nan = v.clone();
        nan[2][1] = f32::NAN;
        assert!(Mesh::new("a", &nan, &f).is_err());
        assert!(Mesh::new("a", &v, &[]).is_err());
        let many = vec![[0, 1, 2]; limits::MESH_FACES + 1];
        assert!(Mesh::new("a", &v, &many).unwrap_err().to_string().contains("decimate"));
    }
}
