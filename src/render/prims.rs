//! Unit shapes that are scaled per instance: sphere (also capsule and ellipsoid), box,
//! cylinder, cone, square.
//!
//! A capsule is a sphere with two rings of vertices at the equator, one with `w = -1` and one with
//! `w = +1`. The shader moves each half by the half length, so one mesh and one draw call serve
//! every sphere, ellipsoid and capsule of a robot.

use std::f32::consts::{PI, TAU};

/// A vertex as the shader reads it: 32 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Vertex {
    /// Position; `w` is the cap sign of a capsule, else 0.
    pub p: [f32; 4],
    /// Normal.
    pub n: [f32; 4],
}

/// An indexed triangle list, counter-clockwise from outside.
#[derive(Clone, Debug, Default)]
pub(super) struct Triangles {
    pub vertices: Vec<Vertex>,
    pub indices: Vec<u32>,
}

/// The unit shapes, in draw order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Prim {
    /// Few triangles, for shapes of a few pixels.
    BallCoarse,
    Ball,
    BallFine,
    Box,
    CylinderCoarse,
    Cylinder,
    Cone,
    Square,
}

impl Prim {
    pub(super) const ALL: [Prim; 8] = [
        Prim::BallCoarse,
        Prim::Ball,
        Prim::BallFine,
        Prim::Box,
        Prim::CylinderCoarse,
        Prim::Cylinder,
        Prim::Cone,
        Prim::Square,
    ];

    pub(super) fn triangles(self) -> Triangles {
        match self {
            Prim::BallCoarse => ball(16, 8),
            Prim::Ball => ball(24, 12),
            Prim::BallFine => ball(48, 24),
            Prim::Box => cube(),
            Prim::CylinderCoarse => cylinder(24),
            Prim::Cylinder => cylinder(64),
            Prim::Cone => cone(32),
            Prim::Square => square(),
        }
    }

    /// The sphere for a radius on screen, with facets below about a third of a pixel.
    pub(super) fn ball_for(radius_px: f32) -> Prim {
        if radius_px < 14.0 {
            Prim::BallCoarse
        } else if radius_px < 44.0 {
            Prim::Ball
        } else {
            Prim::BallFine
        }
    }

    /// The same form with fewer triangles.
    pub(super) fn coarser(self) -> Prim {
        match self {
            Prim::BallFine => Prim::Ball,
            Prim::Ball => Prim::BallCoarse,
            Prim::Cylinder => Prim::CylinderCoarse,
            other => other,
        }
    }

    /// The cylinder for a radius on screen.
    pub(super) fn cylinder_for(radius_px: f32) -> Prim {
        if radius_px < 30.0 { Prim::CylinderCoarse } else { Prim::Cylinder }
    }
}

impl Triangles {
    fn push(&mut self, p: [f32; 3], w: f32, n: [f32; 3]) -> u32 {
        let at = self.vertices.len() as u32;
        self.vertices.push(Vertex { p: [p[0], p[1], p[2], w], n: [n[0], n[1], n[2], 0.0] });
        at
    }
}

/// Latitude rings from the south pole; the equator twice. `rings` must be even.
fn ball(segments: u32, rings: u32) -> Triangles {
    let mut t = Triangles::default();
    let half = rings / 2;
    let mut row_at = Vec::new();
    for row in 0..=rings + 1 {
        // Row `half` closes the lower cap, row `half + 1` opens the upper one.
        let (ring, cap) = if row <= half { (row, -1.0) } else { (row - 1, 1.0) };
        let lat = PI * ring as f32 / rings as f32 - 0.5 * PI;
        row_at.push(t.vertices.len() as u32);
        for s in 0..=segments {
            let lon = TAU * s as f32 / segments as f32;
            let p = [lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin()];
            t.push(p, cap, p);
        }
    }
    for pair in row_at.windows(2) {
        let &[low, high] = pair else { continue };
        for s in 0..segments {
            let (a, b, c, d) = (low + s, low + s + 1, high + s, high + s + 1);
            // At the poles one of the two triangles has no area.
            if low != 0 {
                t.indices.extend([a, b, d]);
            }
            if high != *row_at.last().unwrap_or(&0) {
                t.indices.extend([a, d, c]);
            }
        }
    }
    t
}

fn cube() -> Triangles {
    let mut t = Triangles::default();
    for axis in 0..3 {
        for sign in [-1.0_f32, 1.0] {
            let mut n = [0.0; 3];
            n[axis] = sign;
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut ids = [0; 4];
            for (k, (du, dv)) in
                [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].iter().enumerate()
            {
                let mut p = n;
                p[u] = *du * sign;
                p[v] = *dv;
                ids[k] = t.push(p, 0.0, n);
            }
            t.indices.extend([ids[0], ids[1], ids[2], ids[0], ids[2], ids[3]]);
        }
    }
    t
}

fn disc(t: &mut Triangles, segments: u32, z: f32) {
    let n = [0.0, 0.0, z.signum()];
    let centre = t.push([0.0, 0.0, z], 0.0, n);
    for s in 0..=segments {
        let a = TAU * s as f32 / segments as f32 * z.signum();
        t.push([a.cos(), a.sin(), z], 0.0, n);
    }
    for s in 0..segments {
        t.indices.extend([centre, centre + 1 + s, centre + 2 + s]);
    }
}

fn cylinder(segments: u32) -> Triangles {
    let mut t = Triangles::default();
    for s in 0..=segments {
        let a = TAU * s as f32 / segments as f32;
        let n = [a.cos(), a.sin(), 0.0];
        t.push([n[0], n[1], -1.0], 0.0, n);
        t.push([n[0], n[1], 1.0], 0.0, n);
    }
    for s in 0..segments {
        let a = 2 * s;
        t.indices.extend([a, a + 2, a + 3, a, a + 3, a + 1]);
    }
    disc(&mut t, segments, -1.0);
    disc(&mut t, segments, 1.0);
    t
}

/// Base at z = -1, tip at z = +1.
fn cone(segments: u32) -> Triangles {
    let mut t = Triangles::default();
    // Slope of the side: a unit radius falls to nothing over a height of 2.
    let (flat, up) = (2.0 / 5.0_f32.sqrt(), 1.0 / 5.0_f32.sqrt());
    for s in 0..=segments {
        let a = TAU * s as f32 / segments as f32;
        let n = [a.cos() * flat, a.sin() * flat, up];
        t.push([a.cos(), a.sin(), -1.0], 0.0, n);
        t.push([0.0, 0.0, 1.0], 0.0, n);
    }
    for s in 0..segments {
        let a = 2 * s;
        t.indices.extend([a, a + 2, a + 1]);
    }
    disc(&mut t, segments, -1.0);
    t
}

/// Both faces of the unit square in z = 0.
fn square() -> Triangles {
    let mut t = Triangles::default();
    for z in [1.0_f32, -1.0] {
        let n = [0.0, 0.0, z];
        let first = t.push([-1.0, -z, 0.0], 0.0, n);
        t.push([1.0, -z, 0.0], 0.0, n);
        t.push([1.0, z, 0.0], 0.0, n);
        t.push([-1.0, z, 0.0], 0.0, n);
        t.indices.extend([first, first + 1, first + 2, first, first + 2, first + 3]);
    }
    t
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(t: &Triangles, i: u32) -> glam::Vec3 {
        let p = t.vertices[i as usize].p;
        glam::Vec3::new(p[0], p[1], p[2])
    }

    #[test]
    fn every_triangle_faces_out_and_has_area() {
        for prim in Prim::ALL {
            let t = prim.triangles();
            for f in t.indices.chunks_exact(3) {
                let (a, b, c) = (at(&t, f[0]), at(&t, f[1]), at(&t, f[2]));
                let cross = (b - a).cross(c - a);
                let n = t.vertices[f[0] as usize].n;
                let n = glam::Vec3::new(n[0], n[1], n[2]);
                let doubled_equator = cross.length() < 1e-9
                    && t.vertices[f[0] as usize].p[3] != t.vertices[f[2] as usize].p[3];
                assert!(cross.dot(n) > 0.0 || doubled_equator, "{prim:?} {a} {b} {c}");
            }
        }
    }

    #[test]
    fn a_closed_ball_has_the_volume_of_a_ball() {
        let t = Prim::BallFine.triangles();
        let six: f32 = t
            .indices
            .chunks_exact(3)
            .map(|f| at(&t, f[0]).dot(at(&t, f[1]).cross(at(&t, f[2]))))
            .sum();
        assert!((six / 6.0 - 4.0 / 3.0 * PI).abs() < 0.05, "{}", six / 6.0);
    }
}
