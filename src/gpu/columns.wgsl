// Sums of columns over slices of rows; fold.wgsl adds the slices. A workgroup takes 16 quads of
// columns, its 16 rows of threads every sixteenth row.

struct Params {
    rows: u32,
    width4: u32,   // quads in a row
    slice: u32,    // rows of a slice
    slices: u32,
}

// 0 sums x; 1 sums x hat and x, the gradients of a norm; 2 sums the rows of masked tokens.
override MODE: u32 = 0u;

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> x: array<$X$>;
@group(0) @binding(2) var<storage, read> normed: array<vec4<f32>>;   // what the norm was given
@group(0) @binding(3) var<storage, read> stats: array<vec2<f32>>;    // its mean and 1 / deviation
@group(0) @binding(4) var<storage, read> info: array<vec4<u32>>;     // x: masked
@group(0) @binding(5) var<storage, read_write> out: array<vec4<f32>>;

var<workgroup> sums: array<vec4<f32>, 256>;
var<workgroup> dots: array<vec4<f32>, 256>;

@compute @workgroup_size(16, 16)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let ty = t / 16u;
    let quad = group.x * 16u + t % 16u;
    let end = min(p.rows, (group.y + 1u) * p.slice);
    var sum = vec4<f32>();
    var dot = vec4<f32>();
    if (quad < p.width4) {
        for (var row = group.y * p.slice + ty; row < end; row += 16u) {
            let v = vec4<f32>(x[row * p.width4 + quad]);
            switch MODE {
                case 1u: {
                    let s = stats[row];
                    dot += v * ((normed[row * p.width4 + quad] - s.x) * s.y);
                    sum += v;
                }
                case 2u: {
                    if (info[row].x == 1u) {
                        sum += v;
                    }
                }
                default: { sum += v; }
            }
        }
    }
    sums[t] = sum;
    dots[t] = dot;
    workgroupBarrier();
    for (var half = 8u; half > 0u; half /= 2u) {
        if (ty < half) {
            sums[t] += sums[t + 16u * half];
            dots[t] += dots[t + 16u * half];
        }
        workgroupBarrier();
    }
    if (ty == 0u && quad < p.width4) {
        let at = group.y * p.width4 + quad;
        if (MODE == 1u) {
            out[at] = dots[t];
            out[p.slices * p.width4 + at] = sums[t];
        } else {
            out[at] = sums[t];
        }
    }
}
