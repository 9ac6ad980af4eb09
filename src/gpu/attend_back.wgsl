// Attention backward, one head of one window a workgroup: gradients of queries, keys and values
// from those of the mixed values. The layout of threads and memory is that of attend.wgsl.

struct Params {
    width: u32,    // of a token, d
    size: u32,     // of a head
    scale: f32,    // 1 / sqrt(size)
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> qkv: array<f32>;             // (R, 3 d)
@group(0) @binding(2) var<storage, read> probs: array<f32>;           // (windows, heads, 51, 51)
@group(0) @binding(3) var<storage, read> d_mixed: array<f32>;         // (R, d)
@group(0) @binding(4) var<storage, read_write> d_qkv: array<f32>;     // (R, 3 d)

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
        return d_mixed[token * p.width + at];
    }
    return qkv[token * 3u * p.width + which * p.width + at];
}

// Gradient of `to`: the 51 x 51 weights, transposed or not, times `which`.
fn multiply(transposed: bool, which: u32, to: u32, group: vec2<u32>, t: u32) {
    let tx = t % 16u;
    let ty = t / 16u;
    for (var c0 = 0u; c0 < p.size; c0 += 64u) {
        var acc = array<f32, 16>();
        let wide = min(4u, (p.size - c0 + 15u) / 16u);
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
                for (var i = 0u; i < 4u; i++) {
                    let row = min(ty + 16u * i, 50u);
                    let w = weights[select(row * 53u + j0 + j, (j0 + j) * 53u + row, transposed)];
                    for (var c = 0u; c < wide; c++) {
                        acc[4u * i + c] = fma(w, stage[j * 64u + tx + 16u * c], acc[4u * i + c]);
                    }
                }
            }
            workgroupBarrier();
        }
        for (var i = 0u; i < 4u; i++) {
            for (var c = 0u; c < wide; c++) {
                let row = ty + 16u * i;
                let column = c0 + tx + 16u * c;
                if (row < 51u && column < p.size) {
                    let token = group.y * 51u + row;
                    let at = to * p.width + group.x * p.size + column;
                    d_qkv[token * 3u * p.width + at] = acc[4u * i + c];
                }
            }
        }
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

    // Gradient of the weights, in registers: rows ty + 16 i, columns tx + 16 j.
    var acc: array<f32, 16>;
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
            for (var i = 0u; i < 4u; i++) {
                let x = stage[min(ty + 16u * i, 50u) * 9u + c];
                for (var j = 0u; j < 4u; j++) {
                    let y = stage[459u + min(tx + 16u * j, 50u) * 9u + c];
                    acc[4u * i + j] = fma(x, y, acc[4u * i + j]);
                }
            }
        }
        workgroupBarrier();
    }

    // Softmax: the weights become the gradient of the scores, scale w (dw - sum of w dw in the row).
    for (var i = 0u; i < 4u; i++) {
        let row = ty + 16u * i;
        var part = 0.0;
        for (var j = 0u; j < 4u; j++) {
            let column = tx + 16u * j;
            if (row < 51u && column < 51u) {
                part = fma(weights[row * 53u + column], acc[4u * i + j], part);
            }
        }
        stage[row * 16u + tx] = part;
    }
    workgroupBarrier();
    for (var i = 0u; i < 4u; i++) {
        let row = ty + 16u * i;
        var sum = 0.0;
        for (var j = 0u; j < 16u; j++) {
            sum += stage[row * 16u + j];
        }
        for (var j = 0u; j < 4u; j++) {
            let column = tx + 16u * j;
            if (row < 51u && column < 51u) {
                let w = weights[row * 53u + column];
                weights[row * 53u + column] = w * p.scale * (acc[4u * i + j] - sum);
            }
        }
    }
    workgroupBarrier();
    multiply(false, KEY, QUERY, group, t);
    multiply(true, QUERY, KEY, group, t);
}
