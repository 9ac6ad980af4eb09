// c = a b in matrices of 16-bit factors and 32-bit sums, on the matrix units of a card. A workgroup
// has eight subgroups, four down and two across; each sums 2 x 4 matrices of SIDE x SIDE numbers.
// Names in dollar signs are filled in by product.rs.

const SIDE: u32 = $SIDE$;
const LANES: u32 = $LANES$;
const THREADS: u32 = 8u * LANES;
const TILE: u32 = 8u * SIDE;    // rows and columns of c
const DEPTH: u32 = 2u * SIDE;   // terms at once
// Quads of a row of 16-bit numbers, whose padding spreads the banks.
const LONG: u32 = TILE / 4u + 2u;
const SHORT: u32 = DEPTH / 4u + 2u;

// A row of a or of b' has DEPTH numbers; a row of a' or of b has TILE.
var<workgroup> left: array<vec4<f16>, TILE * SHORT>;
var<workgroup> right: array<vec4<f16>, TILE * SHORT>;
// Two matrices of each subgroup side by side.
var<workgroup> stage: array<vec4<f32>, 4u * SIDE * SIDE>;

fn part_of_a(e: u32, row0: u32, k0: u32, end: u32) -> vec4<f32> {
    if (A_T) {
        let k = k0 + e / (TILE / 4u);
        let quad = row0 / 4u + e % (TILE / 4u);
        if (k < end && 4u * quad < p.m) {
            return a[k * p.a4 + quad];
        }
    } else {
        let row = row0 + e / (DEPTH / 4u);
        let k = k0 + 4u * (e % (DEPTH / 4u));
        if (row < p.m && k < end) {
            return a[row * p.a4 + k / 4u];
        }
    }
    return vec4<f32>();
}

fn part_of_b(e: u32, quad0: u32, k0: u32, end: u32) -> vec4<f32> {
    if (B_T) {
        let column = 4u * quad0 + e / (DEPTH / 4u);
        let k = k0 + 4u * (e % (DEPTH / 4u));
        if (column < 4u * p.n4 && k < end) {
            return b[column * p.b4 + k / 4u];
        }
    } else {
        let k = k0 + e / (TILE / 4u);
        let quad = quad0 + e % (TILE / 4u);
        if (k < end && quad < p.n4) {
            return b[k * p.b4 + quad];
        }
    }
    return vec4<f32>();
}

// The place of quad e of a piece whose rows have TILE or DEPTH numbers.
fn place(e: u32, long: bool) -> u32 {
    if (long) {
        return e / (TILE / 4u) * LONG + e % (TILE / 4u);
    }
    return e / (DEPTH / 4u) * SHORT + e % (DEPTH / 4u);
}

// The place of a matrix whose first row or column, and first term, are these.

fn matrix_a(row: u32, term: u32) -> u32 {
    if (A_T) {
        return term * LONG + row / 4u;
    }
    return row * SHORT + term / 4u;
}

fn matrix_b(column: u32, term: u32) -> u32 {
    if (B_T) {
        return column * SHORT + term / 4u;
    }
    return term * LONG + column / 4u;
}

// Two staged matrices of a subgroup, with what follows the sum.
fn deliver(row: u32, quad: u32, slice: u32, first: u32, lane: u32) {
    for (var e = lane; e < SIDE * SIDE / 2u; e += LANES) {
        finish(row + e / (SIDE / 2u), quad + e % (SIDE / 2u), slice, p.rest * stage[first + e]);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_index) t: u32,
    @builtin(subgroup_id) group: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let row0 = tile.y * TILE;
    let quad0 = tile.x * (TILE / 4u);
    let begin = tile.z * p.slice;
    let end = min(p.k, begin + p.slice);
    let row = group / 2u * 2u * SIDE;
    let column = group % 2u * 4u * SIDE;
    var c00 = $MATRIX$<f32, C>();
    var c01 = $MATRIX$<f32, C>();
    var c02 = $MATRIX$<f32, C>();
    var c03 = $MATRIX$<f32, C>();
    var c10 = $MATRIX$<f32, C>();
    var c11 = $MATRIX$<f32, C>();
    var c12 = $MATRIX$<f32, C>();
    var c13 = $MATRIX$<f32, C>();
    // The next terms are on their way while the matrices are multiplied.
    var a0 = part_of_a(t, row0, begin, end);
    var a1 = part_of_a(t + THREADS, row0, begin, end);
    var a2 = part_of_a(t + 2u * THREADS, row0, begin, end);
    var a3 = part_of_a(t + 3u * THREADS, row0, begin, end);
    var b0 = part_of_b(t, quad0, begin, end);
    var b1 = part_of_b(t + THREADS, quad0, begin, end);
    var b2 = part_of_b(t + 2u * THREADS, quad0, begin, end);
    var b3 = part_of_b(t + 3u * THREADS, quad0, begin, end);
    for (var k0 = begin; k0 < end; k0 += DEPTH) {
        left[place(t, A_T)] = vec4<f16>(p.scale_a * a0);
        left[place(t + THREADS, A_T)] = vec4<f16>(p.scale_a * a1);
        left[place(t + 2u * THREADS, A_T)] = vec4<f16>(p.scale_a * a2);
        left[place(t + 3u * THREADS, A_T)] = vec4<f16>(p.scale_a * a3);
        right[place(t, !B_T)] = vec4<f16>(p.scale_b * b0);
        right[place(t + THREADS, !B_T)] = vec4<f16>(p.scale_b * b1);
        right[place(t + 2u * THREADS, !B_T)] = vec4<f16>(p.scale_b * b2);
        right[place(t + 3u * THREADS, !B_T)] = vec4<f16>(p.scale_b * b3);
        workgroupBarrier();
        let next = k0 + DEPTH;
        a0 = part_of_a(t, row0, next, end);
        a1 = part_of_a(t + THREADS, row0, next, end);
        a2 = part_of_a(t + 2u * THREADS, row0, next, end);
        a3 = part_of_a(t + 3u * THREADS, row0, next, end);
        b0 = part_of_b(t, quad0, next, end);
        b1 = part_of_b(t + THREADS, quad0, next, end);
        b2 = part_of_b(t + 2u * THREADS, quad0, next, end);
        b3 = part_of_b(t + 3u * THREADS, quad0, next, end);
        for (var term = 0u; term < DEPTH; term += SIDE) {
            let x0 = $LOAD_A$<$MATRIX$<f16, A>>(&left[matrix_a(row, term)], $STEP_A$);
            let x1 = $LOAD_A$<$MATRIX$<f16, A>>(&left[matrix_a(row + SIDE, term)], $STEP_A$);
            let y0 = $LOAD_B$<$MATRIX$<f16, B>>(&right[matrix_b(column, term)], $STEP_B$);
            c00 = coopMultiplyAdd(x0, y0, c00);
            c10 = coopMultiplyAdd(x1, y0, c10);
            let y1 = $LOAD_B$<$MATRIX$<f16, B>>(&right[matrix_b(column + SIDE, term)], $STEP_B$);
            c01 = coopMultiplyAdd(x0, y1, c01);
            c11 = coopMultiplyAdd(x1, y1, c11);
            let y2 = $LOAD_B$<$MATRIX$<f16, B>>(&right[matrix_b(column + 2u * SIDE, term)], $STEP_B$);
            c02 = coopMultiplyAdd(x0, y2, c02);
            c12 = coopMultiplyAdd(x1, y2, c12);
            let y3 = $LOAD_B$<$MATRIX$<f16, B>>(&right[matrix_b(column + 3u * SIDE, term)], $STEP_B$);
            c03 = coopMultiplyAdd(x0, y3, c03);
            c13 = coopMultiplyAdd(x1, y3, c13);
        }
        workgroupBarrier();
    }
    let first = group * (SIDE * SIDE / 2u);
    let beside = first + SIDE / 4u;
    let at = row0 + row;
    let quad = quad0 + column / 4u;
    coopStoreT(c00, &stage[first], SIDE / 2u);
    coopStoreT(c01, &stage[beside], SIDE / 2u);
    workgroupBarrier();
    deliver(at, quad, tile.z, first, lane);
    workgroupBarrier();
    coopStoreT(c02, &stage[first], SIDE / 2u);
    coopStoreT(c03, &stage[beside], SIDE / 2u);
    workgroupBarrier();
    deliver(at, quad + SIDE / 2u, tile.z, first, lane);
    workgroupBarrier();
    coopStoreT(c10, &stage[first], SIDE / 2u);
    coopStoreT(c11, &stage[beside], SIDE / 2u);
    workgroupBarrier();
    deliver(at + SIDE, quad, tile.z, first, lane);
    workgroupBarrier();
    coopStoreT(c12, &stage[first], SIDE / 2u);
    coopStoreT(c13, &stage[beside], SIDE / 2u);
    workgroupBarrier();
    deliver(at + SIDE, quad + SIDE / 2u, tile.z, first, lane);
}
