// c = a b in matrices of 16-bit factors and 32-bit sums, on the matrix units of a card. A workgroup
// has eight subgroups, four down and two across; each sums 2 x 4 matrices of SIDE x SIDE numbers.
// Names in dollar signs are filled in by product.rs.

const SIDE: u32 = $SIDE$;
const LANES: u32 = $LANES$;
// Matrices of a subgroup down and across, and subgroups of a workgroup down and across.
const DOWN: u32 = $DOWN$;
const ACROSS: u32 = $ACROSS$;
const GROUPS_DOWN: u32 = $GROUPS_DOWN$;
const GROUPS_ACROSS: u32 = $GROUPS_ACROSS$;
const THREADS: u32 = GROUPS_DOWN * GROUPS_ACROSS * LANES;
const ROWS: u32 = GROUPS_DOWN * DOWN * SIDE;
const COLUMNS: u32 = GROUPS_ACROSS * ACROSS * SIDE;
const DEPTH: u32 = 2u * SIDE;   // terms at once
// Quads of a row of 16-bit numbers, whose padding spreads the banks.
const SHORT: u32 = DEPTH / 4u + 2u;
const LONG_A: u32 = ROWS / 4u + 2u;
const LONG_B: u32 = COLUMNS / 4u + 2u;

// A row of a or of b' has DEPTH numbers here, a row of a' ROWS, and a row of b COLUMNS.
var<workgroup> left: array<vec4<f16>, ROWS * SHORT>;
var<workgroup> right: array<vec4<f16>, COLUMNS * SHORT>;
// Two matrices of each subgroup side by side.
var<workgroup> stage: array<vec4<f32>, GROUPS_DOWN * GROUPS_ACROSS * SIDE * SIDE / 2u>;

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

// Where quad e of a piece goes.
fn place_of_a(e: u32) -> u32 {
    if (A_T) {
        return e / (ROWS / 4u) * LONG_A + e % (ROWS / 4u);
    }
    return e / (DEPTH / 4u) * SHORT + e % (DEPTH / 4u);
}

fn place_of_b(e: u32) -> u32 {
    if (B_T) {
        return e / (DEPTH / 4u) * SHORT + e % (DEPTH / 4u);
    }
    return e / (COLUMNS / 4u) * LONG_B + e % (COLUMNS / 4u);
}

// The place of a matrix whose first row or column, and first term, are these.

fn matrix_a(row: u32, term: u32) -> u32 {
    if (A_T) {
        return term * LONG_A + row / 4u;
    }
    return row * SHORT + term / 4u;
}

fn matrix_b(column: u32, term: u32) -> u32 {
    if (B_T) {
        return column * SHORT + term / 4u;
    }
    return term * LONG_B + column / 4u;
}

// Two staged matrices of a subgroup, with what follows the sum.
fn deliver(row: u32, quad: u32, slice: u32, first: u32, lane: u32) {
    for (var e = lane; e < SIDE * SIDE / 2u; e += LANES) {
        finish(row + e / (SIDE / 2u), quad + e % (SIDE / 2u), slice, stage[first + e]);
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
$FIRST$
    for (var k0 = begin; k0 < end; k0 += DEPTH) {
$PLACE$
        workgroupBarrier();
        let next = k0 + DEPTH;
$NEXT$
        for (var term = 0u; term < DEPTH; term += SIDE) {
$MULTIPLY$
        }
        workgroupBarrier();
    }
    let first = group * (SIDE * SIDE / 2u);
    let beside = first + SIDE / 4u;
    let at = row0 + row;
    let quad = quad0 + column / 4u;
$DELIVER$
}
