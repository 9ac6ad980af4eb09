// c = a b in matrices of 16-bit factors and 32-bit sums, on the matrix units of a card. Each
// subgroup of a workgroup sums several matrices of SIDE x SIDE numbers, for which both factors pass
// through workgroup memory. Names in dollar signs are filled in by product.rs.

const SIDE: u32 = $SIDE$;
const LANES: u32 = $LANES$;
// Matrices of a subgroup, and subgroups of a workgroup.
const DOWN: u32 = $MATRICES_DOWN$;
const ACROSS: u32 = $MATRICES_ACROSS$;
const GROUPS_DOWN: u32 = $SUBGROUPS_DOWN$;
const GROUPS_ACROSS: u32 = $SUBGROUPS_ACROSS$;
const THREADS: u32 = GROUPS_DOWN * GROUPS_ACROSS * LANES;
const ROWS: u32 = GROUPS_DOWN * DOWN * SIDE;
const COLUMNS: u32 = GROUPS_ACROSS * ACROSS * SIDE;
const DEPTH: u32 = $DEPTH$ * SIDE;   // terms at once
// Pairs of a row, whose padding spreads the banks.
const SHORT: u32 = DEPTH / 8u + 1u;
const LONG_A: u32 = ROWS / 8u + 1u;
const LONG_B: u32 = COLUMNS / 8u + 1u;

// Eight factors, in steps of 16 bytes: drivers read a matrix faster in such pieces.
alias Pair = array<vec4<f16>, 2>;

// A row of a or of b' has DEPTH factors here, a row of a' ROWS, and a row of b COLUMNS.
var<workgroup> left: array<Pair, max(ROWS * SHORT, DEPTH * LONG_A)>;
var<workgroup> right: array<Pair, max(COLUMNS * SHORT, DEPTH * LONG_B)>;
// A matrix of each subgroup.
const QUADS: u32 = SIDE * SIDE / 4u;
var<workgroup> stage: array<vec4<f32>, GROUPS_DOWN * GROUPS_ACROSS * QUADS>;

fn part_of_a(e: u32, row0: u32, k0: u32, end: u32) -> vec4<f16> {
    if (A_T) {
        let k = k0 + e / (ROWS / 4u);
        let quad = row0 / 4u + e % (ROWS / 4u);
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
    return vec4<f16>();
}

fn part_of_b(e: u32, quad0: u32, k0: u32, end: u32) -> vec4<f16> {
    if (B_T) {
        let column = 4u * quad0 + e / (DEPTH / 4u);
        let k = k0 + 4u * (e % (DEPTH / 4u));
        if (column < 4u * p.n4 && k < end) {
            return b[column * p.b4 + k / 4u];
        }
    } else {
        let k = k0 + e / (COLUMNS / 4u);
        let quad = quad0 + e % (COLUMNS / 4u);
        if (k < end && quad < p.n4) {
            return b[k * p.b4 + quad];
        }
    }
    return vec4<f16>();
}

fn keep_a(e: u32, v: vec4<f16>) {
    var at = e / (DEPTH / 4u) * 2u * SHORT + e % (DEPTH / 4u);
    if (A_T) {
        at = e / (ROWS / 4u) * 2u * LONG_A + e % (ROWS / 4u);
    }
    left[at / 2u][at % 2u] = v;
}

fn keep_b(e: u32, v: vec4<f16>) {
    var at = e / (COLUMNS / 4u) * 2u * LONG_B + e % (COLUMNS / 4u);
    if (B_T) {
        at = e / (DEPTH / 4u) * 2u * SHORT + e % (DEPTH / 4u);
    }
    right[at / 2u][at % 2u] = v;
}

// The pair at which a matrix begins whose first row or column, and first term, are these.
fn matrix_a(row: u32, term: u32) -> u32 {
    if (A_T) {
        return term * LONG_A + row / 8u;
    }
    return row * SHORT + term / 8u;
}

fn matrix_b(column: u32, term: u32) -> u32 {
    if (B_T) {
        return column * SHORT + term / 8u;
    }
    return term * LONG_B + column / 8u;
}

// A staged matrix of a subgroup, with what follows the sum.
fn deliver(row: u32, quad: u32, slice: u32, first: u32, lane: u32) {
    for (var e = lane; e < QUADS; e += LANES) {
        finish(row + e / (SIDE / 4u), quad + e % (SIDE / 4u), slice, stage[first + e]);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_index) t: u32,
    @builtin(subgroup_id) group: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let row0 = tile.y * ROWS;
    let quad0 = tile.x * (COLUMNS / 4u);
    let begin = tile.z * p.slice;
    let end = min(p.k, begin + p.slice);
    let row = group / GROUPS_ACROSS * DOWN * SIDE;
    let column = group % GROUPS_ACROSS * ACROSS * SIDE;
$SUMS$
    // The next terms are on their way while matrices are multiplied.
$BEGIN$
    for (var k0 = begin; k0 < end; k0 += DEPTH) {
$KEEP$
        workgroupBarrier();
        let next = k0 + DEPTH;
$NEXT$
        for (var term = 0u; term < DEPTH; term += SIDE) {
$MULTIPLY$
        }
        workgroupBarrier();
    }
    let first = group * QUADS;
    let at = row0 + row;
    let quad = quad0 + column / 4u;
$DELIVER$
}
