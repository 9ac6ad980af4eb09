//! Each kernel against the function of the processor, 1e-5 relative, at odd sizes.

use super::super::adam::{Adam, State, Update};
use super::super::attend::Attend;
use super::super::columns::Columns;
use super::super::head::{Head, Wanted};
use super::super::norm::Norm;
use super::super::place::Place;
use super::super::product::{End, Product};
use super::super::squares::Squares;
use super::{close, device, put, random, run};
use robert_linalg::simd::{self, AdamStep};
use robert_linalg::{Init, Mat, MatMut, gemm};
use robert_net::{AdamConfig, Batch, Mixing, NetConfig, SkipKind, WINDOW};

const EXACT: f64 = 1e-5;

fn times(a: Mat<'_, f32>, b: Mat<'_, f32>, m: usize, n: usize) -> Vec<f32> {
    let mut c = vec![0.0; m * n];
    gemm(MatMut::new(&mut c, m, n), Init::Zero, a, b);
    c
}

#[test]
fn products_with_their_ends() {
    let Some(gpu) = device() else { return };
    let product = Product::new(&gpu);
    for [m, k, n] in [[1, 4, 4], [77, 20, 68], [130, 84, 132], [51, 16, 48]] {
        let (x, w) = (random(m * k, 1), random(k * n, 2));
        let (bias, other) = (random(n, 3), random(m * n, 4));
        let [gx, gw, gbias, gother] = [&x, &w, &bias, &other].map(|v| put(&gpu, v));
        let (c, second) = (put(&gpu, &random(m * n, 5)), put(&gpu, &vec![0.0_f32; m * n]));
        let plain = times(Mat::new(&x, m, k), Mat::new(&w, k, n), m, n);
        let biased: Vec<f32> = plain.iter().enumerate().map(|(i, v)| v + bias[i % n]).collect();

        let step = product.forward(&gpu, [m, k, n], &gx, &gw, End::Bias(&gbias), &c);
        close(&run(&gpu, [step], &c, m * n), &biased, EXACT, "bias");

        let end = End::Residual(&gbias, &gother);
        let step = product.forward(&gpu, [m, k, n], &gx, &gw, end, &c);
        let want: Vec<f32> = biased.iter().zip(&other).map(|(a, b)| a + b).collect();
        close(&run(&gpu, [step], &c, m * n), &want, EXACT, "residual");

        let step = product.forward(&gpu, [m, k, n], &gx, &gw, End::Gelu(&gbias, &second), &c);
        let mut slope = biased.clone();
        slope.resize(slope.len().next_multiple_of(64), 0.0);
        let mut act = vec![0.0; slope.len()];
        simd::gelu(&mut slope, &mut act);
        close(&run(&gpu, [step], &c, m * n), &act[..m * n], EXACT, "gelu");
        close(&run(&gpu, [], &second, m * n), &slope[..m * n], EXACT, "slope of gelu");

        let dx = put(&gpu, &vec![0.0_f32; m * k]);
        let factors = put(&gpu, &x);
        let back = times(Mat::new(&other, m, n), Mat::new(&w, k, n).t(), m, k);
        let step = product.back(&gpu, [m, k, n], &gother, &gw, End::Store, &dx);
        close(&run(&gpu, [step], &dx, m * k), &back, EXACT, "back");
        let step = product.back(&gpu, [m, k, n], &gother, &gw, End::Times(&factors), &dx);
        let want: Vec<f32> = back.iter().zip(&x).map(|(a, b)| a * b).collect();
        close(&run(&gpu, [step], &dx, m * k), &want, EXACT, "back times slope");
    }
}

#[test]
fn weight_gradients_add_in_slices_and_in_one_piece() {
    let Some(gpu) = device() else { return };
    let product = Product::new(&gpu);
    for [rows, k, n] in [[51, 8, 12], [517, 20, 68], [1000, 132, 64]] {
        let (x, dy, begin) = (random(rows * k, 1), random(rows * n, 2), random(k * n, 3));
        let mut want = times(Mat::new(&x, rows, k).t(), Mat::new(&dy, rows, n), k, n);
        want.iter_mut().zip(&begin).for_each(|(w, b)| *w += b);
        let (gx, gdy) = (put(&gpu, &x), put(&gpu, &dy));
        // Room for all slices, and for none.
        for room in [64 * k * n, 4] {
            let parts = gpu.buffer(4 * room as u64);
            let dw = put(&gpu, &begin);
            let steps = product.weight(&gpu, [rows, k, n], false, [&gx, &gdy], &parts, &dw);
            assert_eq!(steps.len() > 1, room > 4 && Product::slices(&gpu, [rows, k, n]) > 1);
            close(&run(&gpu, steps, &dw, k * n), &want, EXACT, "weight gradient");
        }
    }
}

#[test]
fn layer_norm_both_ways() {
    let Some(gpu) = device() else { return };
    let (norm, columns, product) = (Norm::new(&gpu), Columns::new(&gpu), Product::new(&gpu));
    for [rows, d] in [[3, 16], [133, 48], [700, 128]] {
        let x: Vec<f32> = random(rows * d, 1).iter().map(|x| 2.0 * x + 0.7).collect();
        let (gamma, beta, dy) = (random(d, 2), random(d, 3), random(rows * d, 4));
        let begin = random(rows * d, 5);
        let (mut y, mut stats) = (vec![0.0; rows * d], vec![[0.0; 2]; rows]);
        simd::layer_norm(&x, &gamma, &beta, &mut y, &mut stats);
        let [gx, ggamma, gbeta, gdy] = [&x, &gamma, &beta, &dy].map(|v| put(&gpu, v));
        let (gy, gstats) = (gpu.buffer(4 * (rows * d) as u64), gpu.buffer(8 * rows as u64));
        let step = norm.forward(&gpu, [rows, d], &gx, [&ggamma, &gbeta], &gy, &gstats);
        close(&run(&gpu, [step], &gy, rows * d), &y, EXACT, "norm");
        close(&run(&gpu, [], &gstats, 2 * rows), stats.as_flattened(), EXACT, "statistics");

        let (mut dx, mut dgamma, mut dbeta) = (begin.clone(), random(d, 6), random(d, 7));
        let (to_gamma, to_beta) = (put(&gpu, &dgamma), put(&gpu, &dbeta));
        simd::layer_norm_back(&dy, &x, &stats, &gamma, &mut dx, &mut dgamma, &mut dbeta);
        let to = put(&gpu, &begin);
        let step = norm.back(&gpu, [rows, d], [&gdy, &gx, &gstats, &ggamma], &to, true);
        close(&run(&gpu, [step], &to, rows * d), &dx, EXACT, "norm back, added");
        let step = norm.back(&gpu, [rows, d], [&gdy, &gx, &gstats, &ggamma], &to, false);
        dx.iter_mut().zip(&begin).for_each(|(dx, b)| *dx -= b);
        close(&run(&gpu, [step], &to, rows * d), &dx, EXACT, "norm back");
        let parts = gpu.buffer(4 * Columns::parts(rows, d) as u64);
        let on = [&gdy, &gx, &gstats];
        let steps = columns.norm(&gpu, &product, [rows, d], on, &parts, [&to_gamma, &to_beta]);
        close(&run(&gpu, steps, &to_gamma, d), &dgamma, EXACT, "gradient of the scale");
        close(&run(&gpu, [], &to_beta, d), &dbeta, EXACT, "gradient of the shift");
    }
}

#[test]
fn sums_of_columns() {
    let Some(gpu) = device() else { return };
    let (columns, product) = (Columns::new(&gpu), Product::new(&gpu));
    for [rows, d] in [[2, 4], [333, 76], [9000, 16]] {
        let (x, begin) = (random(rows * d, 1), random(d, 2));
        let info: Vec<[u32; 4]> = (0..rows).map(|r| [u32::from(r % 3 == 1), 9, 9, 9]).collect();
        let (gx, ginfo) = (put(&gpu, &x), put(&gpu, &info));
        let parts = gpu.buffer(4 * Columns::parts(rows, d) as u64);
        for masked in [false, true] {
            let mut want: Vec<f64> = begin.iter().map(|&x| f64::from(x)).collect();
            for (row, x) in x.chunks(d).enumerate().filter(|(r, _)| !masked || r % 3 == 1) {
                assert!(row < rows);
                want.iter_mut().zip(x).for_each(|(w, &x)| *w += f64::from(x));
            }
            let want: Vec<f32> = want.iter().map(|&x| x as f32).collect();
            let to = put(&gpu, &begin);
            let steps = if masked {
                columns.masked(&gpu, &product, [rows, d], [&gx, &ginfo], &parts, &to)
            } else {
                columns.plain(&gpu, &product, [rows, d], &gx, &parts, &to)
            };
            close(&run(&gpu, steps, &to, d), &want, EXACT, "sums of columns");
        }
    }
}

#[test]
fn mask_vector_and_positions() {
    let Some(gpu) = device() else { return };
    let place = Place::new(&gpu);
    let (rows, d) = (2 * WINDOW, 20);
    let (x, mask, position) = (random(rows * d, 1), random(d, 2), random(WINDOW * d, 3));
    let info: Vec<[u32; 4]> = (0..rows).map(|r| [u32::from(r % 5 == 0), 0, 0, 0]).collect();
    let [gmask, gposition] = [&mask, &position].map(|v| put(&gpu, v));
    let ginfo = put(&gpu, &info);
    for replaces in [false, true] {
        let want: Vec<f32> = (0..rows * d)
            .map(|i| {
                let (row, c) = (i / d, i % d);
                let masked = row % 5 == 0;
                let own = if masked && replaces { 0.0 } else { x[i] };
                own + if masked { mask[c] } else { 0.0 } + position[row % WINDOW * d + c]
            })
            .collect();
        let to = put(&gpu, &x);
        let on = [&gmask, &gposition, &ginfo];
        let step = place.forward(&gpu, [rows, d], replaces, on, &to);
        close(&run(&gpu, [step], &to, rows * d), &want, EXACT, "place");
    }
    let to = put(&gpu, &x);
    let got = run(&gpu, [place.back(&gpu, [rows, d], &ginfo, &to)], &to, rows * d);
    let want: Vec<f32> =
        x.iter().enumerate().map(|(i, &x)| if i / d % 5 == 0 { 0.0 } else { x }).collect();
    assert_eq!(got, want);
}

/// Attention of one head in double precision: mixed values, and gradients of q, k, v for `dy`.
fn attention(q: &[f64], k: &[f64], v: &[f64], dy: &[f64], h: usize) -> [Vec<f64>; 4] {
    let n = WINDOW;
    let dot = |a: &[f64], i: usize, b: &[f64], j: usize| -> f64 {
        (0..h).map(|c| a[i * h + c] * b[j * h + c]).sum()
    };
    let scale = 1.0 / (h as f64).sqrt();
    let mut out = [(); 4].map(|()| vec![0.0; n * h]);
    for i in 0..n {
        let e: Vec<f64> = (0..n).map(|j| (scale * dot(q, i, k, j)).exp()).collect();
        let sum: f64 = e.iter().sum();
        let p: Vec<f64> = e.iter().map(|e| e / sum).collect();
        let dp: Vec<f64> = (0..n).map(|j| dot(dy, i, v, j)).collect();
        let mean: f64 = p.iter().zip(&dp).map(|(p, d)| p * d).sum();
        for j in 0..n {
            let ds = scale * p[j] * (dp[j] - mean);
            for c in 0..h {
                out[0][i * h + c] += p[j] * v[j * h + c];
                out[1][i * h + c] += ds * k[j * h + c];
                out[2][j * h + c] += ds * q[i * h + c];
                out[3][j * h + c] += p[j] * dy[i * h + c];
            }
        }
    }
    out
}

#[test]
fn attention_both_ways() {
    let Some(gpu) = device() else { return };
    let attend = Attend::new(&gpu);
    // Heads of 1, 8, 20, 32 and 80 numbers.
    for [windows, heads, d] in [[1, 16, 16], [2, 4, 32], [1, 4, 80], [2, 1, 32], [1, 2, 160]] {
        let (h, rows) = (d / heads, windows * WINDOW);
        let (qkv, dy) = (random(rows * 3 * d, 1), random(rows * d, 2));
        let mut mixed = vec![0.0; rows * d];
        let mut d_qkv = vec![0.0; rows * 3 * d];
        for (b, i) in (0..windows).flat_map(|b| (0..heads).map(move |i| (b, i))) {
            let cut = |x: &[f32], stride: usize, at: usize| -> Vec<f64> {
                let rows = (0..WINDOW).flat_map(|t| {
                    x[(b * WINDOW + t) * stride + at..][..h].iter().map(|&x| f64::from(x))
                });
                rows.collect()
            };
            let [q, k, v] = [0, 1, 2].map(|part| cut(&qkv, 3 * d, part * d + i * h));
            let [y, dq, dk, dv] = attention(&q, &k, &v, &cut(&dy, d, i * h), h);
            for t in 0..WINDOW {
                let row = b * WINDOW + t;
                for c in 0..h {
                    mixed[row * d + i * h + c] = y[t * h + c] as f32;
                    for (part, from) in [&dq, &dk, &dv].into_iter().enumerate() {
                        d_qkv[row * 3 * d + part * d + i * h + c] = from[t * h + c] as f32;
                    }
                }
            }
        }
        let (gqkv, gdy) = (put(&gpu, &qkv), put(&gpu, &dy));
        let probs = gpu.buffer(4 * (windows * heads * WINDOW * WINDOW) as u64);
        let (to, d_to) = (gpu.buffer(4 * (rows * d) as u64), gpu.buffer(12 * (rows * d) as u64));
        let step = attend.forward(&gpu, [windows, heads, d], &gqkv, &probs, &to);
        close(&run(&gpu, [step], &to, rows * d), &mixed, EXACT, "attention");
        let step = attend.back(&gpu, [windows, heads, d], [&gqkv, &probs, &gdy], &d_to);
        close(&run(&gpu, [step], &d_to, 3 * rows * d), &d_qkv, EXACT, "attention back");
    }
}

#[test]
fn losses_of_every_head() {
    let Some(gpu) = device() else { return };
    let head = Head::new(&gpu);
    for (bins, skip) in [
        (1, SkipKind::Off),
        (1, SkipKind::Additive),
        (1, SkipKind::Gated),
        (2, SkipKind::Off),
        (10, SkipKind::Off),
    ] {
        let cfg = NetConfig {
            layers: 1,
            width: 16,
            heads: 1,
            inputs: 4,
            actions: 5,
            bins,
            offset_weight: 7.0,
            mask_replaces: true,
            skip,
            mixing: Mixing::Attention,
            dead_zone: 0.0,
        };
        let (rows, k, a) = (2 * WINDOW, cfg.outputs(), cfg.actions);
        let stride = k.next_multiple_of(4);
        let centres = random(bins * a, 1);
        let mut batch = Batch::<f32>::zeros(&cfg, 2);
        batch.actions = random(rows * a, 2);
        if !batch.linear.is_empty() {
            batch.linear = random(rows * a, 3);
        }
        let given: Vec<f32> = random(rows * k, 4).iter().map(|x| 3.0 * x).collect();
        let mut want = given.clone();
        let scale = 1.0 / rows as f64;
        let sums = robert_net::head::loss(&cfg, &centres, &batch, &mut want, scale, false);

        let mut padded = vec![0.0; rows * stride];
        for (to, from) in padded.chunks_mut(stride).zip(given.chunks(k)) {
            to[..k].copy_from_slice(from);
        }
        let info: Vec<[u32; 4]> = batch
            .actions
            .chunks(a)
            .map(|x| {
                let bin = robert_net::head::nearest(&centres, x) as u32;
                [0, bin, (scale as f32).to_bits(), 0]
            })
            .collect();
        let [actions, linear, gcentres, out] =
            [&batch.actions, &batch.linear, &centres, &padded].map(|v| put(&gpu, v));
        let (info, errors) = (put(&gpu, &info), gpu.buffer(8 * rows as u64));
        let wanted = Wanted { actions: &actions, linear: &linear, centres: &gcentres, info: &info };
        let params = gpu.uniform(&Head::words(&cfg, [rows, stride], 1.0));
        let step = head.loss(&gpu, &params, rows, wanted, [&out, &errors]);
        let got = run(&gpu, [step], &out, rows * stride);
        let got: Vec<f32> = got.chunks(stride).flat_map(|row| row[..k].to_vec()).collect();
        close(&got, &want, EXACT, &format!("gradient of the head, {bins} bins, {skip:?}"));
        let errors = run(&gpu, [], &errors, 2 * rows);
        let weight = if bins > 1 { 7.0 } else { 1.0 };
        let loss: f64 =
            errors.chunks(2).map(|e| scale * (weight * f64::from(e[0]) + f64::from(e[1]))).sum();
        assert!((loss / sums.loss - 1.0).abs() < EXACT, "{loss} {}", sums.loss);
    }
}

#[test]
fn updates_and_norms() {
    let Some(gpu) = device() else { return };
    let n = 128 * 66;
    let [mut w, g, mut m, mut average] = [1, 2, 3, 5].map(|i| random(n, i));
    let mut v: Vec<f32> = random(n, 4).iter().map(|x| x * x).collect();
    let config = AdamConfig { weight_decay: 3.0, ..AdamConfig::default() };
    let decays: Vec<u32> = (0..n / 128).map(|i| u32::from(i % 2 == 0)).collect();
    let [gw, gg, gm, gv, ga] = [&w, &g, &m, &v, &average].map(|x| put(&gpu, x));
    let gdecays = put(&gpu, &decays);
    let (lr, norm, count, share) = (0.01, 4.0, 7, 0.3);
    let update = Update { adam: config, lr, norm, scale: 1.0, count, share };
    let params = gpu.uniform(&update.words(n));
    let state =
        State { decays: &gdecays, grads: &gg, weights: &gw, first: &gm, second: &gv, average: &ga };
    let got = run(&gpu, [Adam::new(&gpu, true).step(&gpu, n, &params, state)], &gw, n);
    for (block, &decays) in decays.iter().enumerate() {
        let at = block * 128..(block + 1) * 128;
        let step = AdamStep {
            lr,
            beta1: config.beta1,
            beta2: config.beta2,
            eps: config.eps,
            decay: f64::from(decays) * config.weight_decay,
            clip: config.clip / (norm + 1e-6),
            count,
        };
        let (m, v) = (&mut m[at.clone()], &mut v[at.clone()]);
        simd::adam(&step, &mut w[at.clone()], &g[at], m, v);
    }
    average.iter_mut().zip(&w).for_each(|(a, w)| *a += share * (w - *a));
    close(&got, &w, EXACT, "weights");
    for (got, want, what) in [(&gm, &m, "first"), (&gv, &v, "second"), (&ga, &average, "average")] {
        close(&run(&gpu, [], got, n), want, EXACT, what);
    }
    let squares = Squares::new(&gpu);
    let pieces = gpu.buffer(4 * 5);
    let got = run(&gpu, [squares.step(&gpu, n, &gg, &pieces, 2)], &pieces, 5);
    assert_eq!(got[..2], [0.0; 2]);
    let sum: f64 = got.iter().map(|&x| f64::from(x)).sum();
    assert!((sum / simd::sum_of_squares(&g) - 1.0).abs() < EXACT);
}
