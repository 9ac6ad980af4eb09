// Softmax attention of one head of one window a workgroup: scores, weights, mixed values.
// The 51 x 51 weights stay in workgroup memory, factors pass through it in pieces.

struct Params {
    width: u32,    // of a token, d
    size: u32,     // of a head
    scale: f32,    // 1 / sqrt(size)
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> qkv: array<f32>;            // (R, 3 d)
@group(0) @binding(2) var<storage, read_write> probs: array<f32>;    // (windows, heads, 51, 51)
@group(0) @binding(3) var<storage, read_write> mixed: array<f32>;    // (R, d)

// Rows of 51 numbers, 53 apart, which spreads the banks.
var<workgroup> weights: array<f32, 2703>;
var<workgroup> stage: array<f32, 1024>;

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) t: u32,
) {
    let tx = t % 16u;
    let ty = t / 16u;
    let d = p.width;
    let base = group.y * 51u * 3u * d + group.x * p.size;
    var acc: array<f32, 16>;

    // Scores q k', eight columns at a time; thread (ty, tx) has rows ty + 16 i, columns tx + 16 j.
    for (var c0 = 0u; c0 < p.size; c0 += 8u) {
        for (var e = t; e < 408u; e += 256u) {
            let c = c0 + e % 8u;
            let at = base + (e / 8u) * 3u * d + c;
            var q = 0.0;
            var k = 0.0;
            if (c < p.size) {
                q = qkv[at];
                k = qkv[at + d];
            }
            stage[(e / 8u) * 9u + e % 8u] = q;
            stage[459u + (e / 8u) * 9u + e % 8u] = k;
        }
        workgroupBarrier();
        for (var c = 0u; c < 8u; c++) {
            for (var i = 0u; i < 4u; i++) {
                let q = stage[min(ty + 16u * i, 50u) * 9u + c];
                for (var j = 0u; j < 4u; j++) {
                    let k = stage[459u + min(tx + 16u * j, 50u) * 9u + c];
                    acc[4u * i + j] = fma(q, k, acc[4u * i + j]);
                }
            }
        }
        workgroupBarrier();
    }
    for (var i = 0u; i < 4u; i++) {
        for (var j = 0u; j < 4u; j++) {
            if (ty + 16u * i < 51u && tx + 16u * j < 51u) {
                weights[(ty + 16u * i) * 53u + tx + 16u * j] = acc[4u * i + j];
            }
        }
    }
    workgroupBarrier();

    if (t < 51u) {
        let row = t * 53u;
        var top = weights[row];
        for (var j = 1u; j < 51u; j++) {
            top = max(top, weights[row + j]);
        }
        var sum = 0.0;
        for (var j = 0u; j < 51u; j++) {
            let e = exponential((weights[row + j] - top) * p.scale);
            weights[row + j] = e;
            sum += e;
        }
        let share = 1.0 / sum;
        for (var j = 0u; j < 51u; j++) {
            weights[row + j] *= share;
        }
    }
    workgroupBarrier();
    let out = (group.y * groups.x + group.x) * 2601u;
    for (var e = t; e < 2601u; e += 256u) {
        probs[out + e] = weights[(e / 51u) * 53u + e % 51u];
    }

    // Mixed values, 64 columns at a time, 16 rows of the values at a time.
    for (var c0 = 0u; c0 < p.size; c0 += 64u) {
        acc = array<f32, 16>();
        let wide = min(4u, (p.size - c0 + 15u) / 16u);
        for (var j0 = 0u; j0 < 51u; j0 += 16u) {
            for (var e = t; e < 1024u; e += 256u) {
                let c = c0 + e % 64u;
                var v = 0.0;
                if (c < p.size && j0 + e / 64u < 51u) {
                    v = qkv[base + 2u * d + (j0 + e / 64u) * 3u * d + c];
                }
                stage[e] = v;
            }
            workgroupBarrier();
            for (var j = 0u; j < min(16u, 51u - j0); j++) {
                for (var i = 0u; i < 4u; i++) {
                    let w = weights[min(ty + 16u * i, 50u) * 53u + j0 + j];
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
                    mixed[(group.y * 51u + row) * d + group.x * p.size + column] = acc[4u * i + c];
                }
            }
        }
    }
}
