// c = a b. A workgroup computes a tile of 64 x 64, each of its 16 x 16 threads 4 x 4 numbers in
// registers. Rows are read as quads of four numbers; the number of columns is a multiple of four.

// 16 terms of 64 rows of a and of 64 columns of b; a quad of padding spreads the banks.
var<workgroup> left: array<vec4<f32>, 272>;
var<workgroup> right: array<vec4<f32>, 272>;

@compute @workgroup_size(16, 16)
fn main(@builtin(workgroup_id) tile: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let tx = t % 16u;
    let ty = t / 16u;
    let row0 = tile.y * 64u;
    let quad0 = tile.x * 16u;
    let begin = tile.z * p.slice;
    let end = min(p.k, begin + p.slice);
    // Where a transposing thread reads and writes: row t / 4 of the tile, quad t % 4 of 16 terms.
    let line = t / 4u;
    let part = t % 4u;
    var c0 = vec4<f32>();
    var c1 = vec4<f32>();
    var c2 = vec4<f32>();
    var c3 = vec4<f32>();
    for (var k0 = begin; k0 < end; k0 += 16u) {
        var v = vec4<f32>();
        if (A_T) {
            let quad = row0 / 4u + tx;
            if (k0 + ty < end && 4u * quad < p.m) {
                v = a[(k0 + ty) * p.a4 + quad];
            }
            left[ty * 17u + tx] = v;
        } else {
            if (row0 + line < p.m && k0 + 4u * part < end) {
                v = a[(row0 + line) * p.a4 + k0 / 4u + part];
            }
            let at = 4u * part * 17u + line / 4u;
            let lane = line % 4u;
            left[at][lane] = v.x;
            left[at + 17u][lane] = v.y;
            left[at + 34u][lane] = v.z;
            left[at + 51u][lane] = v.w;
        }
        v = vec4<f32>();
        if (B_T) {
            if (4u * quad0 + line < 4u * p.n4 && k0 + 4u * part < end) {
                v = b[(4u * quad0 + line) * p.b4 + k0 / 4u + part];
            }
            let at = 4u * part * 17u + line / 4u;
            let lane = line % 4u;
            right[at][lane] = v.x;
            right[at + 17u][lane] = v.y;
            right[at + 34u][lane] = v.z;
            right[at + 51u][lane] = v.w;
        } else {
            if (k0 + ty < end && quad0 + tx < p.n4) {
                v = b[(k0 + ty) * p.b4 + quad0 + tx];
            }
            right[ty * 17u + tx] = v;
        }
        workgroupBarrier();
        for (var k = 0u; k < 16u; k++) {
            let l = left[k * 17u + ty];
            let r = right[k * 17u + tx];
            c0 = fma(vec4(l.x), r, c0);
            c1 = fma(vec4(l.y), r, c1);
            c2 = fma(vec4(l.z), r, c2);
            c3 = fma(vec4(l.w), r, c3);
        }
        workgroupBarrier();
    }
    let row = row0 + 4u * ty;
    finish(row, quad0 + tx, tile.z, c0);
    finish(row + 1u, quad0 + tx, tile.z, c1);
    finish(row + 2u, quad0 + tx, tile.z, c2);
    finish(row + 3u, quad0 + tx, tile.z, c3);
}
