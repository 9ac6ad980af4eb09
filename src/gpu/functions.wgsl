// Functions of single numbers, as in robert_linalg: drivers may answer exp() less accurately.

fn exponential(x: f32) -> f32 {
    let a = clamp(x, -87.0, 88.0);
    let n = round(a * 1.44269504);
    let r = fma(n, 2.1219444e-4, fma(n, -0.693359375, a));
    var p = 0.00139411189;
    p = fma(p, r, 0.008375134775);
    p = fma(p, r, 0.04166635277);
    p = fma(p, r, 0.1666641541);
    p = fma(p, r, 0.5000000047);
    p = fma(p, r, 1.000000038);
    p = fma(p, r, 1.0);
    return bitcast<f32>(bitcast<i32>(p) + (i32(n) << 23u));
}

// ln x of a normal number: its exponent, and 2 atanh((m - 1) / (m + 1)) of its mantissa m.
fn logarithm(x: f32) -> f32 {
    let bits = bitcast<i32>(x);
    let e = (bits - bitcast<i32>(0.70710678)) >> 23u;
    let m = bitcast<f32>(bits - (e << 23u));
    let z = (m - 1.0) / (m + 1.0);
    let s = z * z;
    var p = 0.2222222;
    p = fma(p, s, 0.2857143);
    p = fma(p, s, 0.4);
    p = fma(p, s, 0.6666667);
    p = fma(p, s, 2.0);
    return fma(f32(e), 0.69314718, z * p);
}

// GELU x Phi(x) and its derivative Phi(x) + x phi(x).
fn gelu(x: f32) -> vec2<f32> {
    let t = 1.0 / fma(abs(x) * 0.70710678, 0.35, 1.0);
    let e = exponential(-0.5 * x * x);
    var q = 0.05633586416;
    q = fma(q, t, -0.3424174058);
    q = fma(q, t, 0.6974926566);
    q = fma(q, t, -0.541137249);
    q = fma(q, t, 0.4984826478);
    q = fma(q, t, 0.02331087294);
    q = fma(q, t, 0.2167923809);
    q = fma(q, t, 0.1934545758);
    q = fma(q, t, 0.1976856416);
    let tail = 0.5 * e * t * q;
    let phi = select(1.0 - tail, tail, x < 0.0);
    return vec2(x * phi, fma(x, e * 0.3989423, phi));
}
