// Attention backward, one head of one window a workgroup: gradients of queries, keys and values
// from those of the mixed values. The layout of threads and memory is that of attend.wgsl.

struct Params {
    width: u32,    // of a token, d
    size: u32,     // of a head
    scale: f32,    // 1 / sqrt(size)
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> qkv: array<$H$>;             // (R, 3 d)
@group(0) @binding(2) var<storage, read> probs: array<f32>;           // (windows, heads, 51, 51)
@group(0) @binding(3) var<storage, read> d_mixed: array<$H$>;         // (R, d)
@group(0) @binding(4) var<storage, read_write> d_qkv: array<$H$>;     // (R, 3 d)

var<workgroup> weights: array<f32, 2703>;
var<workgroup> stage: array<f32, 1024>;

const QUERY = 0u;
const KEY = 1u;
const VALUE = 2u;
const MIXED = 3u;

// A number of queries, keys, values, or of the gradient of the mixed values.
fn factor(which: u32, group: vec2<u32>, row: u32, column: u32) -> f32 {
    let token = group.y * 51u + row;
    let at = group.x * p.size + column;
    if (which == MIXED) {
        return f32(d_mixed[token * p.width + at]);
    }
    return f32(qkv[token * 3u * p.width + which * p.width + at]);
}

// Four numbers of a staged column, 16 rows apart; those behind the last row repeat it.
fn column_of(begin: u32, row: u32, c: u32) -> vec4<f32> {
    return vec4(
        stage[begin + row * 9u + c],
        stage[begin + (row + 16u) * 9u + c],
        stage[begin + (row + 32u) * 9u + c],
        stage[begin + min(row + 48u, 50u) * 9u + c],
    );
}

fn keep(to: u32, group: vec2<u32>, row: u32, column: u32, v: vec4<f32>) {
    if (row < 51u) {
        let token = group.y * 51u + row;
        let at = token * 3u * p.width + to * p.width + group.x * p.size + column;
        if (column < p.size) {
            d_qkv[at] = $H$(v.x);
        }
        if (column + 16u < p.size) {
            d_qkv[at + 16u] = $H$(v.y);
        }
        if (column + 32u < p.size) {
            d_qkv[at + 32u] = $H$(v.z);
        }
        if (column + 48u < p.size) {
            d_qkv[at + 48u] = $H$(v.w);
        }
    }
}

// Gradient of `to`: the 51 x 51 weights, transposed or not, times `which`.
fn multiply(transposed: bool, which: u32, to: u32, group: vec2<u32>, t: u32) {
    let tx = t % 16u;
    let ty = t / 16u;
    // Where the weights of a row begin, and the step along it.
    let along = select(1u, 53u, transposed);
    let down = select(53u, 1u, transposed);
    let last = min(ty + 48u, 50u) * down;
    for (var c0 = 0u; c0 < p.size; c0 += 64u) {
        var r0 = vec4<f32>();
        var r1 = vec4<f32>();
        var r2 = vec4<f32>();
        var r3 = vec4<f32>();
        for (var j0 = 0u; j0 < 51u; j0 += 16u) {
            for (var e = t; e < 1024u; e += 256u) {
                var v = 0.0;
                if (c0 + e % 64u < p.size && j0 + e / 64u < 51u) {
                    v = factor(which, group, j0 + e / 64u, c0 + e % 64u);
                }
                stage[e] = v;
            }
            workgroupBarrier();
            for (var j = 0u; j < min(16u, 51u - j0); j++) {
                let at = j * 64u + tx;
                let v = vec4(stage[at], stage[at + 16u], stage[at + 32u], stage[at + 48u]);
                let w = ty * down + (j0 + j) * along;
                r0 = fma(vec4(weights[w]), v, r0);
                r1 = fma(vec4(weights[w + 16u * down]), v, r1);
                r2 = fma(vec4(weights[w + 32u * down]), v, r2);
                r3 = fma(vec4(weights[last + (j0 + j) * along]), v, r3);
            }
            workgroupBarrier();
        }
        keep(to, group, ty, c0 + tx, r0);
        keep(to, group, ty + 16u, c0 + tx, r1);
        keep(to, group, ty + 32u, c0 + tx, r2);
        keep(to, group, ty + 48u, c0 + tx, r3);
    }
}

// The weights of a row's four columns; 0 outside.
fn weights_of(row: u32, column: u32) -> vec4<f32> {
    if (row >= 51u) {
        return vec4<f32>();
    }
    let at = row * 53u + column;
    var last = 0.0;
    if (column + 48u < 51u) {
        last = weights[at + 48u];
    }
    return vec4(weights[at], weights[at + 16u], weights[at + 32u], last);
}

// The gradient of a row's scores from the gradient of its weights: scale w (dw - sum of w dw).
fn score(row: u32, column: u32, dw: vec4<f32>) {
    if (row >= 51u) {
        return;
    }
    var sum = 0.0;
    for (var j = 0u; j < 16u; j++) {
        sum += stage[row * 16u + j];
    }
    let ds = weights_of(row, column) * p.scale * (dw - sum);
    let at = row * 53u + column;
    weights[at] = ds.x;
    weights[at + 16u] = ds.y;
    weights[at + 32u] = ds.z;
    if (column + 48u < 51u) {
        weights[at + 48u] = ds.w;
    }
}

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) t: u32,
) {
    let tx = t % 16u;
    let ty = t / 16u;
    let group = id.xy;
    let start = (group.y * groups.x + group.x) * 2601u;
    for (var e = t; e < 2601u; e += 256u) {
        weights[(e / 51u) * 53u + e % 51u] = probs[start + e];
    }
    workgroupBarrier();
    multiply(true, MIXED, VALUE, group, t);

    // Gradient of the weights, in registers.
    var r0 = vec4<f32>();
    var r1 = vec4<f32>();
    var r2 = vec4<f32>();
    var r3 = vec4<f32>();
    for (var c0 = 0u; c0 < p.size; c0 += 8u) {
        for (var e = t; e < 408u; e += 256u) {
            var x = 0.0;
            var y = 0.0;
            if (c0 + e % 8u < p.size) {
                x = factor(MIXED, group, e / 8u, c0 + e % 8u);
                y = factor(VALUE, group, e / 8u, c0 + e % 8u);
            }
            stage[(e / 8u) * 9u + e % 8u] = x;
            stage[459u + (e / 8u) * 9u + e % 8u] = y;
        }
        workgroupBarrier();
        for (var c = 0u; c < 8u; c++) {
            let x = column_of(0u, ty, c);
            let y = column_of(459u, tx, c);
            r0 = fma(vec4(x.x), y, r0);
            r1 = fma(vec4(x.y), y, r1);
            r2 = fma(vec4(x.z), y, r2);
            r3 = fma(vec4(x.w), y, r3);
        }
        workgroupBarrier();
    }

    // Softmax; the sums of a row's parts pass through the stage.
    stage[ty * 16u + tx] = dot(weights_of(ty, tx), r0);
    stage[(ty + 16u) * 16u + tx] = dot(weights_of(ty + 16u, tx), r1);
    stage[(ty + 32u) * 16u + tx] = dot(weights_of(ty + 32u, tx), r2);
    stage[(ty + 48u) * 16u + tx] = dot(weights_of(ty + 48u, tx), r3);
    workgroupBarrier();
    score(ty, tx, r0);
    score(ty + 16u, tx, r1);
    score(ty + 32u, tx, r2);
    score(ty + 48u, tx, r3);
    workgroupBarrier();
    multiply(false, KEY, QUERY, group, t);
    multiply(true, QUERY, KEY, group, t);
}
