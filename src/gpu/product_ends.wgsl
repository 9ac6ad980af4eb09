// What both kernels of products are given, and what follows the sum. Names in dollar signs are
// filled in by product.rs and kernel.rs.

struct Params {
    m: u32,      // rows of c
    n4: u32,     // quads in a row of c
    k: u32,      // terms of each sum
    a4: u32,     // quads in a row of a as stored
    b4: u32,     // quads in a row of b as stored
    slice: u32,  // terms of one slice, a multiple of 16
    add: u32,    // whether c is added to
}

override A_T: bool = false;  // a is stored as (k, m)
override B_T: bool = false;  // b is stored as (n, k)
override END: u32 = 0u;      // what follows the sum, see finish()

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> a: array<$FACTOR$>;
@group(0) @binding(2) var<storage, read> b: array<$FACTOR$>;
@group(0) @binding(3) var<storage, read> bias: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> other: array<$OTHER$>;
@group(0) @binding(5) var<storage, read_write> c: array<$C$>;
@group(0) @binding(6) var<storage, read_write> second: array<$FACTOR$>;

fn finish(row: u32, quad: u32, slice: u32, sum: vec4<f32>) {
    if (row >= p.m || quad >= p.n4) {
        return;
    }
    let at = row * p.n4 + quad;
    switch END {
        case 1u: { c[at] = $C$(sum + bias[quad]); }
        case 2u: { c[at] = $C$(sum + bias[quad] + vec4<f32>(other[at])); }
        case 3u: {
            let u = sum + bias[quad];
            let x = gelu(u.x);
            let y = gelu(u.y);
            let z = gelu(u.z);
            let w = gelu(u.w);
            c[at] = $C$(vec4(x.x, y.x, z.x, w.x));
            second[at] = $FACTOR$(vec4(x.y, y.y, z.y, w.y));
        }
        case 4u: { c[at] = $C$(sum * vec4<f32>(other[at])); }
        default: {
            let to = slice * p.m * p.n4 + at;
            if (p.add == 1u) {
                c[to] = $C$(vec4<f32>(c[to]) + sum);
            } else {
                c[to] = $C$(sum);
            }
        }
    }
}
