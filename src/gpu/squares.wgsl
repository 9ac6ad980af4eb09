// Sums of squares over pieces of 4096 numbers.

struct Params {
    quads: u32,
    first: u32,   // the place of the first piece's sum
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> x: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;

var<workgroup> parts: array<f32, 256>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) t: u32,
) {
    let piece = group.y * groups.x + group.x;
    var sum = 0.0;
    for (var i = 0u; i < 4u; i++) {
        let at = piece * 1024u + i * 256u + t;
        if (at < p.quads) {
            sum += dot(x[at], x[at]);
        }
    }
    parts[t] = sum;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if (t < half) {
            parts[t] += parts[t + half];
        }
        workgroupBarrier();
    }
    if (t == 0u && piece * 1024u < p.quads) {
        out[p.first + piece] = parts[0];
    }
}
