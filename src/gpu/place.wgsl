// Mask vector and positions, added to embedded tokens; backward, hidden tokens that the mask
// vector replaced pass no gradient on.

struct Params {
    quads: u32,      // of all rows
    width4: u32,     // quads in a row
    replaces: u32,   // whether the mask vector replaces the embedding
}

override BACK: bool = false;

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> mask: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> position: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> info: array<vec4<u32>>;   // x: masked
@group(0) @binding(4) var<storage, read_write> x: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) t: u32,
) {
    let i = (group.y * groups.x + group.x) * 256u + t;
    if (i >= p.quads) {
        return;
    }
    let row = i / p.width4;
    let quad = i % p.width4;
    let masked = info[row].x == 1u;
    if (BACK) {
        if (masked) {
            x[i] = vec4<f32>();
        }
        return;
    }
    var v = x[i];
    if (masked) {
        v = mask[quad] + select(v, vec4<f32>(), p.replaces == 1u);
    }
    x[i] = v + position[(row % 51u) * p.width4 + quad];
}
