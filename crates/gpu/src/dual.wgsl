// Values with their rate, `vec2f(value, rate)`: dual numbers, as in `render/dual.rs`. Where no rate
// is requested, nothing reads the second component, and compilers drop it.

fn still(value: f32) -> vec2f {
    return vec2f(value, 0.0);
}

fn times(a: vec2f, b: vec2f) -> vec2f {
    return vec2f(a.x * b.x, a.y * b.x + a.x * b.y);
}

fn over(a: vec2f, b: vec2f) -> vec2f {
    let value = a.x / b.x;
    return vec2f(value, (a.y - value * b.y) / b.x);
}

fn root(a: vec2f) -> vec2f {
    let value = sqrt(a.x);
    return vec2f(value, a.y / (value + value));
}

fn dot3(a: array<vec2f, 3>, b: array<vec2f, 3>) -> vec2f {
    return times(a[0], b[0]) + times(a[1], b[1]) + times(a[2], b[2]);
}

fn cross3(a: array<vec2f, 3>, b: array<vec2f, 3>) -> array<vec2f, 3> {
    return array(
        times(a[1], b[2]) - times(a[2], b[1]),
        times(a[2], b[0]) - times(a[0], b[2]),
        times(a[0], b[1]) - times(a[1], b[0]),
    );
}
