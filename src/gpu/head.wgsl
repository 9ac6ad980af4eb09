// The action head's loss and its gradient, which takes the place of its output; a token a thread.
// The formulas are those of robert_net::head.

struct Params {
    rows: u32,
    actions: u32,
    bins: u32,
    stride: u32,     // numbers in a row of out
    weight: f32,     // of the offset loss
    skips: u32,
    gated: u32,
    scale: f32,      // of the gradient
}

@group(0) @binding(0) var<uniform> p: Params;
@group(0) @binding(1) var<storage, read> actions: array<f32>;        // (R, A)
@group(0) @binding(2) var<storage, read> line: array<f32>;           // (R, A), with a skip
@group(0) @binding(3) var<storage, read> centres: array<f32>;        // (K, A)
@group(0) @binding(4) var<storage, read> info: array<vec4<u32>>;     // y: bin, z: factor (bits)
@group(0) @binding(5) var<storage, read_write> out: array<f32>;      // (R, stride)
@group(0) @binding(6) var<storage, read_write> errors: array<vec2<f32>>;   // (R): square, focal

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = id.x;
    if (row >= p.rows) {
        return;
    }
    let a = p.actions;
    let bin = info[row].y;
    let factor = bitcast<f32>(info[row].z) * p.scale;
    let logits = row * p.stride;
    let offsets = logits + p.bins;
    let gates = offsets + p.bins * a;
    var square = 0.0;
    for (var j = 0u; j < a; j++) {
        var gate = 0.0;
        var linear = 0.0;
        if (p.gated == 1u) {
            gate = out[gates + j];
        }
        if (p.skips == 1u) {
            linear = line[row * a + j];
        }
        let found = centres[bin * a + j] + (1.0 + gate) * linear + out[offsets + bin * a + j];
        let error = found - actions[row * a + j];
        square += error * error;
        let slope = 2.0 * p.weight * error / f32(a) * factor;
        for (var k = 0u; k < p.bins; k++) {
            out[offsets + k * a + j] = select(0.0, slope, k == bin);
        }
        if (p.gated == 1u) {
            out[gates + j] = slope * linear;
        }
    }
    square /= f32(a);

    // Focal loss -(1 - p)^2 ln p of the true bin.
    var focal = 0.0;
    if (p.bins == 1u) {
        out[logits] = 0.0;
    } else {
        var top = out[logits];
        for (var k = 1u; k < p.bins; k++) {
            top = max(top, out[logits + k]);
        }
        var total = 0.0;
        var rest = 0.0;
        for (var k = 0u; k < p.bins; k++) {
            let e = exponential(out[logits + k] - top);
            total += e;
            rest += select(e, 0.0, k == bin);
        }
        let log_p = out[logits + bin] - top - logarithm(total);
        let q = exponential(log_p);
        let miss = rest / total;
        let pull = 2.0 * miss * q * log_p - miss * miss;
        for (var k = 0u; k < p.bins; k++) {
            let other = exponential(out[logits + k] - top) / total;
            out[logits + k] = factor * pull * select(-other, miss, k == bin);
        }
        focal = -miss * miss * log_p;
    }
    errors[row] = vec2(square, focal);
}
