//! The outline of the selected link: its surface again, a little larger, with only the inner side
//! visible.

use std::collections::BTreeMap;

use super::space;
use super::space::V3;
use crate::protocol::MeshFacts;
use robert_take::viser::{Buffer, MeshProps, Rgb};

/// Orange, the colour of the selection.
const COLOR: Rgb = [255, 138, 30];

/// The shell of a body's meshes with this thickness, m; `None` if the body is invisible.
pub(super) fn of<'a>(meshes: impl Iterator<Item = &'a MeshFacts>, thick: f64) -> Option<MeshProps> {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for mesh in meshes {
        let first = (vertices.len() / 3) as u32;
        vertices.extend(swollen(mesh, thick));
        faces.extend(mesh.faces.iter().map(|i| i + first));
    }
    (!faces.is_empty()).then(|| MeshProps {
        vertices: Buffer::f32(&vertices),
        faces: Buffer::u32(&faces),
        color: COLOR,
        side: "back",
        cast_shadow: false,
        receive_shadow: false,
        ..MeshProps::default()
    })
}

/// Corners pushed out along their normals. Corners at one place (a mesh with hard edges has
/// several) are pushed the same way, so that the shell has no cracks.
fn swollen(mesh: &MeshFacts, thick: f64) -> Vec<f32> {
    let (corners, _) = mesh.vertices.as_chunks::<3>();
    let key = |c: &[f32; 3]| c.map(|v| (f64::from(v) * 1e6).round() as i64);
    let at = |i: u32| corners.get(i as usize);
    let wide = |c: &[f32; 3]| c.map(f64::from);
    let mut normals: BTreeMap<[i64; 3], V3> = BTreeMap::new();
    for [a, b, c] in mesh.faces.as_chunks::<3>().0 {
        let (Some(a), Some(b), Some(c)) = (at(*a), at(*b), at(*c)) else { continue };
        // A normal whose length is twice the area, so that large faces count more.
        let normal = space::cross(space::sub(wide(b), wide(a)), space::sub(wide(c), wide(a)));
        for corner in [a, b, c] {
            let sum = normals.entry(key(corner)).or_insert([0.0; 3]);
            *sum = space::add(*sum, normal);
        }
    }
    corners
        .iter()
        .flat_map(|corner| {
            let normal = normals[&key(corner)];
            let length = space::norm(normal);
            let out = if length > 1e-18 { space::scale(normal, thick / length) } else { [0.0; 3] };
            space::add(wide(corner), out).map(|v| v as f32)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_stands_off_everywhere_and_has_no_cracks() {
        // A tetrahedron whose corners are not shared between its faces.
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0_f32]];
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let vertices: Vec<f32> = faces.iter().flatten().flat_map(|i: &usize| p[*i]).collect();
        let mesh = MeshFacts {
            body: 1,
            rgba: [1.0; 4],
            vertices: vertices.clone(),
            faces: (0..12).collect(),
        };
        let out = swollen(&mesh, 0.1);
        let mut places: BTreeMap<Vec<i64>, Vec<f32>> = BTreeMap::new();
        for (before, after) in vertices.chunks(3).zip(out.chunks(3)) {
            let far: f32 =
                before.iter().zip(after).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
            assert!((far - 0.1).abs() < 1e-5, "{far}");
            let key = before.iter().map(|v| (v * 1e3) as i64).collect();
            let known = places.entry(key).or_insert_with(|| after.to_vec());
            assert_eq!(known, after, "one place stays one place");
        }
        // The corner at the origin goes away from the others.
        assert!(out.iter().take(3).all(|v| *v < 0.0));
        assert!(of(std::iter::empty(), 0.1).is_none());
    }
}
