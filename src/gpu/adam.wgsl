// AdamW and the running average of the weights; four weights a thread.

struct Params {
    clip: f32,
    beta1: f32,
    rest1: f32,    // 1 - beta1
    beta2: f32,
    rest2: f32,    // 1 - beta2
    rate: f32,     // lr / (1 - beta1^t)
    root: f32,     // 1 / sqrt(1 - beta2^t)
    eps: f32,
    keep: f32,     // 1 - lr decay, for weights that decay
    share: f32,    // of the new weights in the average
    quads: u32,
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> decays: array<u32>;   // (quads / 32)
@group(0) @binding(2) var<storage, read> g: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> w: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> m: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> v: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> average: array<vec4<f32>>;

override AVERAGES: bool = false;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) t: u32,
) {
    let i = (group.y * groups.x + group.x) * 256u + t;
    if (i >= p.quads) {
        return;
    }
    let grad = g[i] * p.clip;
    let first = m[i] * p.beta1 + grad * p.rest1;
    let second = v[i] * p.beta2 + grad * grad * p.rest2;
    m[i] = first;
    v[i] = second;
    let keep = select(1.0, p.keep, decays[i / 32u] == 1u);
    let next = w[i] * keep - p.rate * (first / (sqrt(second) * p.root + p.eps));
    w[i] = next;
    if (AVERAGES) {
        average[i] += p.share * (next - average[i]);
    }
}
