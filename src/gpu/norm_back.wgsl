// Layer norm backward, the gradient of its input: 16 rows a workgroup, 16 threads a row.

struct Params {
    rows: u32,
    width4: u32,   // quads in a row
    add: u32,      // whether dx is added to
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> dy: array<$H4$>;
@group(0) @binding(2) var<storage, read> x: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> stats: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> gamma: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> dx: array<vec4<f32>>;

var<workgroup> parts: array<vec2<f32>, 256>;

@compute @workgroup_size(16, 16)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let tx = t % 16u;
    let row = group.x * 16u + t / 16u;
    let share = 1.0 / f32(4u * p.width4);
    let end = select(0u, p.width4, row < p.rows);
    let s = stats[min(row, p.rows - 1u)];
    var sums = vec2<f32>();
    for (var q = tx; q < end; q += 16u) {
        let at = row * p.width4 + q;
        let d = vec4<f32>(dy[at]) * gamma[q];
        sums += vec2(dot(d, vec4(1.0)), dot(d, (x[at] - s.x) * s.y));
    }
    parts[t] = sums;
    workgroupBarrier();
    for (var half = 8u; half > 0u; half /= 2u) {
        if (tx < half) {
            parts[t] += parts[t + half];
        }
        workgroupBarrier();
    }
    let mean = parts[t - tx] * share;
    for (var q = tx; q < end; q += 16u) {
        let at = row * p.width4 + q;
        let hat = (x[at] - s.x) * s.y;
        let d = (vec4<f32>(dy[at]) * gamma[q] - mean.x - hat * mean.y) * s.y;
        if (p.add == 1u) {
            dx[at] += d;
        } else {
            dx[at] = d;
        }
    }
}
