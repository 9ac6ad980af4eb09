// Layer norm forward: 16 rows a workgroup, 16 threads a row.

struct Params {
    rows: u32,
    width4: u32,   // quads in a row
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> x: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> gamma: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> beta: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> y: array<$H4$>;
@group(0) @binding(5) var<storage, read_write> stats: array<vec2<f32>>;

var<workgroup> parts: array<f32, 256>;

// The sum over the 16 threads of a row.
fn row_sum(t: u32, v: f32) -> f32 {
    parts[t] = v;
    workgroupBarrier();
    for (var half = 8u; half > 0u; half /= 2u) {
        if (t % 16u < half) {
            parts[t] += parts[t + half];
        }
        workgroupBarrier();
    }
    let sum = parts[t - t % 16u];
    workgroupBarrier();
    return sum;
}

@compute @workgroup_size(16, 16)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let tx = t % 16u;
    let row = group.x * 16u + t / 16u;
    let share = 1.0 / f32(4u * p.width4);
    // Threads behind the last row go along with nothing, for the barriers.
    let end = select(0u, p.width4, row < p.rows);
    var sum = 0.0;
    for (var q = tx; q < end; q += 16u) {
        sum += dot(x[row * p.width4 + q], vec4(1.0));
    }
    let mean = row_sum(t, sum) * share;
    var squares = 0.0;
    for (var q = tx; q < end; q += 16u) {
        let c = x[row * p.width4 + q] - mean;
        squares += dot(c, c);
    }
    let scale = 1.0 / sqrt(row_sum(t, squares) * share + 1e-5);
    for (var q = tx; q < end; q += 16u) {
        let at = row * p.width4 + q;
        y[at] = $H4$((x[at] - mean) * scale * gamma[q] + beta[q]);
    }
    if (tx == 0u && row < p.rows) {
        stats[row] = vec2(mean, scale);
    }
}
