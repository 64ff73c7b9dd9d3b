// Numbers as unevaluated sums of two f32, 48 bits in total (Dekker 1971; Knuth, TAOCP 2, 4.2.2).
// They keep the precision of the difference between a camera's centre and a far position.
//
// Factors are split by their bits, so partial products are exact, and fusing a product with a sum
// changes nothing. `opaque` stops compilers from simplifying `(a + b) - a`.

fn opaque(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ frame.zero);
}

// a + b, for |a| >= |b|.
fn ordered_sum(a: f32, b: f32) -> vec2f {
    let sum = opaque(a + b);
    return vec2f(sum, b - opaque(sum - a));
}

fn exact_sum(a: f32, b: f32) -> vec2f {
    let sum = opaque(a + b);
    let v = opaque(sum - a);
    return vec2f(sum, (a - opaque(sum - v)) + (b - v));
}

fn exact_product(a: f32, b: f32) -> vec2f {
    let product = opaque(a * b);
    // Twelve bits each, so that the product of two halves fits the 24 bits of an f32.
    let high = vec2f(bitcast<f32>(bitcast<u32>(a) & 0xfffff000u), bitcast<f32>(bitcast<u32>(b) & 0xfffff000u));
    let low = vec2f(a, b) - high;
    let rest = opaque(opaque(high.x * high.y - product) + high.x * low.y) + low.x * high.y;
    return vec2f(product, opaque(rest) + low.x * low.y);
}

fn sum2(a: vec2f, b: vec2f) -> vec2f {
    let high = exact_sum(a.x, b.x);
    return ordered_sum(high.x, high.y + (a.y + b.y));
}

fn product2(a: vec2f, b: vec2f) -> vec2f {
    let high = exact_product(a.x, b.x);
    return ordered_sum(high.x, high.y + (a.x * b.y + a.y * b.x));
}

fn quotient2(a: vec2f, b: vec2f) -> vec2f {
    let first = a.x / b.x;
    // One step of long division: the quotient of the rest corrects the first.
    let rest = sum2(a, -product2(vec2f(first, 0.0), b));
    return ordered_sum(first, rest.x / b.x);
}
