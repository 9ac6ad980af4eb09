// Softmax attention of one head of one window a workgroup: scores, weights, mixed values.
// The 51 x 51 weights stay in workgroup memory, factors pass through it in pieces. A thread has
// rows ty + 16 i and columns tx + 16 j of a result; vector i holds the four columns of row i.

struct Params {
    width: u32,    // of a token, d
    size: u32,     // of a head
    scale: f32,    // 1 / sqrt(size)
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> qkv: array<$H$>;            // (R, 3 d)
@group(0) @binding(2) var<storage, read_write> probs: array<f32>;    // (windows, heads, 51, 51)
@group(0) @binding(3) var<storage, read_write> mixed: array<$H$>;    // (R, d)

// Rows of 51 numbers, 53 apart, which spreads the banks.
var<workgroup> weights: array<f32, 2703>;
var<workgroup> stage: array<f32, 1024>;

// Four numbers of a staged column, 16 rows apart; those behind the last row repeat it.
fn column_of(begin: u32, row: u32, c: u32) -> vec4<f32> {
    return vec4(
        stage[begin + row * 9u + c],
        stage[begin + (row + 16u) * 9u + c],
        stage[begin + (row + 32u) * 9u + c],
        stage[begin + min(row + 48u, 50u) * 9u + c],
    );
}

fn keep_scores(row: u32, column: u32, v: vec4<f32>) {
    if (row < 51u) {
        weights[row * 53u + column] = v.x;
        weights[row * 53u + column + 16u] = v.y;
        weights[row * 53u + column + 32u] = v.z;
        if (column + 48u < 51u) {
            weights[row * 53u + column + 48u] = v.w;
        }
    }
}

fn keep_mixed(group: vec2<u32>, row: u32, column: u32, v: vec4<f32>) {
    if (row < 51u) {
        let at = (group.y * 51u + row) * p.width + group.x * p.size + column;
        if (column < p.size) {
            mixed[at] = $H$(v.x);
        }
        if (column + 16u < p.size) {
            mixed[at + 16u] = $H$(v.y);
        }
        if (column + 32u < p.size) {
            mixed[at + 32u] = $H$(v.z);
        }
        if (column + 48u < p.size) {
            mixed[at + 48u] = $H$(v.w);
        }
    }
}

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
    var r0 = vec4<f32>();
    var r1 = vec4<f32>();
    var r2 = vec4<f32>();
    var r3 = vec4<f32>();

    // Scores q k', eight columns at a time.
    for (var c0 = 0u; c0 < p.size; c0 += 8u) {
        for (var e = t; e < 408u; e += 256u) {
            let c = c0 + e % 8u;
            let at = base + (e / 8u) * 3u * d + c;
            var q = 0.0;
            var k = 0.0;
            if (c < p.size) {
                q = f32(qkv[at]);
                k = f32(qkv[at + d]);
            }
            stage[(e / 8u) * 9u + e % 8u] = q;
            stage[459u + (e / 8u) * 9u + e % 8u] = k;
        }
        workgroupBarrier();
        for (var c = 0u; c < 8u; c++) {
            let q = column_of(0u, ty, c);
            let k = column_of(459u, tx, c);
            r0 = fma(vec4(q.x), k, r0);
            r1 = fma(vec4(q.y), k, r1);
            r2 = fma(vec4(q.z), k, r2);
            r3 = fma(vec4(q.w), k, r3);
        }
        workgroupBarrier();
    }
    keep_scores(ty, tx, r0);
    keep_scores(ty + 16u, tx, r1);
    keep_scores(ty + 32u, tx, r2);
    keep_scores(ty + 48u, tx, r3);
    workgroupBarrier();

    // Softmax: four threads a row, whose parts pass through the stage.
    let row = t / 4u;
    let part = t % 4u;
    var top = -3.4e38;
    if (row < 51u) {
        for (var j = part; j < 51u; j += 4u) {
            top = max(top, weights[row * 53u + j]);
        }
    }
    stage[t] = top;
    workgroupBarrier();
    let first = t - part;
    top = max(max(stage[first], stage[first + 1u]), max(stage[first + 2u], stage[first + 3u]));
    var sum = 0.0;
    if (row < 51u) {
        for (var j = part; j < 51u; j += 4u) {
            let e = exponential((weights[row * 53u + j] - top) * p.scale);
            weights[row * 53u + j] = e;
            sum += e;
        }
    }
    stage[256u + t] = sum;
    workgroupBarrier();
    let parts = 256u + first;
    let share =
        1.0 / ((stage[parts] + stage[parts + 1u]) + (stage[parts + 2u] + stage[parts + 3u]));
    if (row < 51u) {
        for (var j = part; j < 51u; j += 4u) {
            weights[row * 53u + j] *= share;
        }
    }
    workgroupBarrier();
    let out = (group.y * groups.x + group.x) * 2601u;
    for (var e = t; e < 2601u; e += 256u) {
        probs[out + e] = weights[(e / 51u) * 53u + e % 51u];
    }

    // Mixed values, 64 columns at a time, 16 rows of the values at a time.
    let last = min(ty + 48u, 50u) * 53u;
    for (var c0 = 0u; c0 < p.size; c0 += 64u) {
        r0 = vec4<f32>();
        r1 = vec4<f32>();
        r2 = vec4<f32>();
        r3 = vec4<f32>();
        for (var j0 = 0u; j0 < 51u; j0 += 16u) {
            for (var e = t; e < 1024u; e += 256u) {
                let c = c0 + e % 64u;
                var v = 0.0;
                if (c < p.size && j0 + e / 64u < 51u) {
                    v = f32(qkv[base + 2u * d + (j0 + e / 64u) * 3u * d + c]);
                }
                stage[e] = v;
            }
            workgroupBarrier();
            for (var j = 0u; j < min(16u, 51u - j0); j++) {
                let at = j * 64u + tx;
                let v = vec4(stage[at], stage[at + 16u], stage[at + 32u], stage[at + 48u]);
                let w = ty * 53u + j0 + j;
                r0 = fma(vec4(weights[w]), v, r0);
                r1 = fma(vec4(weights[w + 848u]), v, r1);
                r2 = fma(vec4(weights[w + 1696u]), v, r2);
                r3 = fma(vec4(weights[last + j0 + j]), v, r3);
            }
            workgroupBarrier();
        }
        keep_mixed(group.xy, ty, c0 + tx, r0);
        keep_mixed(group.xy, ty + 16u, c0 + tx, r1);
        keep_mixed(group.xy, ty + 32u, c0 + tx, r2);
        keep_mixed(group.xy, ty + 48u, c0 + tx, r3);
    }
}
