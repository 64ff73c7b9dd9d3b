// Pass 3: (tile, splat) pairs in the frame's order, and after their sort by tile, the begin and end
// of each tile's list.

@group(1) @binding(0) var<storage, read> splats: array<vec4u>;
@group(1) @binding(1) var<storage, read> order: array<vec2u>;
// Number of tiles that each splat of the order touches.
@group(1) @binding(2) var<storage, read_write> touched: array<u32>;
@group(1) @binding(3) var<storage, read_write> sums: array<u32>;
@group(1) @binding(4) var<storage, read> totals: array<u32>;
@group(1) @binding(5) var<storage, read_write> pairs: array<vec2u>;
// Begin and end of each tile's list.
@group(1) @binding(6) var<storage, read_write> lists: array<vec2u>;

// The tile index of an empty pair.
const NO_TILE: u32 = 0xffffffffu;

fn outline_of(at: u32) -> Outline {
    let row = at * SPLAT_ROWS;
    let first = bitcast<vec4f>(splats[row]);
    let second = bitcast<vec4f>(splats[row + 1u]);
    let box = splats[row + 3u];
    return Outline(first.xy, vec3f(first.zw, second.x), second.z, unpack(box.x), unpack(box.y));
}

// The tiles of one row of tiles that the splat may touch: first and end.
fn tiles_in(splat: Outline, row: u32, whole: bool) -> vec2u {
    if whole {
        return tiles_of(splat.columns, frame.first.x, frame.end.x);
    }
    let columns = columns_in(splat, max(splat.rows.x, row * TILE), min(splat.rows.y, (row + 1u) * TILE));
    return tiles_of(columns, frame.first.x, frame.end.x);
}

fn is_one_row_or_column(splat: Outline) -> bool {
    let rows = (splat.rows + vec2u(0u, TILE - 1u)) / TILE;
    let columns = (splat.columns + vec2u(0u, TILE - 1u)) / TILE;
    return rows.y - rows.x <= 1u || columns.y - columns.x <= 1u;
}

@compute @workgroup_size(GROUP)
fn tally(thread: Thread) {
    let i = thread.group.x * GROUP + place_of(thread);
    var count = 0u;
    if i < within(totals[SPLATS], frame.splat_room) {
        let splat = outline_of(order[i].y);
        let whole = is_one_row_or_column(splat);
        let rows = tiles_of(splat.rows, frame.first.y, frame.end.y);
        for (var row = rows.x; row < rows.y; row++) {
            let tiles = tiles_in(splat, row, whole);
            count += max(tiles.x, tiles.y) - tiles.x;
        }
        touched[i] = count;
    }
    // Saturates, because large splats can make more pairs than 32 bits count.
    let sum = sum_of_many(count, thread);
    if thread.local == 0u {
        sums[thread.group.x] = sum;
    }
}

@compute @workgroup_size(GROUP)
fn emit(thread: Thread) {
    let i = thread.group.x * GROUP + place_of(thread);
    let exists = i < within(totals[SPLATS], frame.splat_room);
    var count = 0u;
    if exists {
        count = touched[i];
    }
    let before = sums_of(count, thread).before;
    if exists {
        list(order[i].y, sums[thread.group.x] + before, count);
    }
}

// Writes exactly `count` pairs from `at` on. The count was computed by another shader, and the same
// formula may round differently here. Extra pairs are dropped and missing ones filled with empty
// pairs, because the places of later splats are fixed.
fn list(splat_at: u32, at: u32, count: u32) {
    let splat = outline_of(splat_at);
    let whole = is_one_row_or_column(splat);
    let rows = tiles_of(splat.rows, frame.first.y, frame.end.y);
    let columns = frame.end.x - frame.first.x;
    var n = 0u;
    for (var row = rows.x; row < rows.y; row++) {
        let tiles = tiles_in(splat, row, whole);
        for (var tile = tiles.x; tile < tiles.y && n < count; tile++) {
            pairs[at + n] = vec2u((row - frame.first.y) * columns + tile - frame.first.x, splat_at);
            n++;
        }
    }
    for (; n < count; n++) {
        pairs[at + n] = vec2u(NO_TILE, 0u);
    }
}

@compute @workgroup_size(GROUP)
fn bound(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let count = within(totals[PAIRS], frame.pair_room);
    let end = min((group.x + 1u) * BLOCK, count);
    for (var i = group.x * BLOCK + local; i < end; i += GROUP) {
        let tile = pairs[i].x;
        // Empty pairs belong to no tile. Their sort key puts them behind all others.
        if tile == NO_TILE {
            continue;
        }
        if i == 0u || pairs[i - 1u].x != tile {
            lists[tile].x = i;
        }
        if i + 1u == count || pairs[i + 1u].x != tile {
            lists[tile].y = i + 1u;
        }
    }
}
