#!/usr/bin/env python3
"""Writes answers.txt: what the cases of `gs2e stress` are held against, with 120 digits (mpmath 1.3) from the doubles that
the program takes. Each line: name, arguments as doubles, `=`, answers to 25 digits.

    python3 answers.py > answers.txt
"""

import struct

from mpmath import mp, mpf, cos, coth, erfc, exp, log, sin, sqrt

mp.dps = 120


def line(name, arguments, answers):
    told = " ".join(repr(float(a)) for a in arguments)
    print(name, told, "=", " ".join(mp.nstr(mpf(a), 25, strip_zeros=True) for a in answers))


print("# Written by answers.py; do not edit.")

# Probability that a Brownian motion of drift m and variance 2 leaves upwards, its barriers at up and -down:
# the scale function exp(-m x) of the diffusion, m = 2 mu / sigma^2.
for e in ["0", "1e-20", "1e-16", "1e-12", "1e-8", "1e-4", "1e-2", "0.5", "1", "10", "30", "100", "1e3"]:
    for sign in (1, -1):
        m = sign * float(e)
        if m == 0 and sign < 0:
            continue
        for x in (0.0, 0.5, 0.999):
            up, down = mpf(1.0 - x), mpf(1.0 + x)
            if m == 0:
                p = down / (up + down)
            else:
                p = (exp(mpf(m) * down) - 1) / (exp(mpf(m) * down) - exp(-mpf(m) * up))
            line("polarity", [m, 1.0 - x, 1.0 + x], [p])

# The two roots of the inverse Gaussian of mean 1/phi and shape 1 as published (Michael, Schucany, Haas 1976), each as
# the share x/(1+x) of a bridge's time; and the probability of the smaller one.
for phi in [1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6, 1e8]:
    for z in [0.0, 1e-6, 1e-4, 1e-2, 0.7, 2.0, 6.0]:
        mu, y = 1 / mpf(phi), mpf(z) ** 2
        small = mu + mu * mu * y / 2 - mu / 2 * sqrt(4 * mu * y + mu * mu * y * y)
        large = mu * mu / small
        line("root", [phi, z], [small / (1 + small), large / (1 + large), mu / (mu + small)])


def phi_cdf(x):
    return erfc(-x / sqrt(mpf(2))) / 2


def left_upwards(t, drift, variance, up, down):
    """P(left through up by t), by mirror images (Darling, Siegert 1953)."""
    t, m, v, a, w = mpf(t), mpf(drift), mpf(variance), mpf(up), mpf(up) + mpf(down)
    total = mpf(0)
    for k in range(-30, 31):
        d = a + 2 * k * w
        s = 1 if d > 0 else -1
        n, root = abs(m), sqrt(v * t)
        term = exp(-n * abs(d) / v) * phi_cdf((n * t - abs(d)) / root)
        term += exp(n * abs(d) / v) * phi_cdf((-n * t - abs(d)) / root)
        total += s * exp(m * a / v) * term
    return total


# P(the first event within a time of 1 is OFF) from x, drift, variance.
for x, drift, variance in [(-0.99, 3.0, 0.05), (0.98, -1.98, 0.05)]:
    line("first-off", [x, drift, variance], [left_upwards(1, -drift, variance, 1 + mpf(x), 1 - mpf(x))])

# The same for a bridge from x to y of variance v, both inside: mirror images of the end, even and odd.
for x, y, v in [(0.99, -0.99, 0.1), (0.95, -0.95, 0.3), (0.99, -0.999, 0.02)]:
    a, b, v0 = 1 + mpf(x), 1 + mpf(y), mpf(v)
    total, w = mpf(0), mpf(2)
    for k in range(0, 20):
        total += exp(-2 * (a + k * w) * (b + k * w) / v0) - exp(-2 * (k + 1) * w * ((k + 1) * w - a + b) / v0)
    line("bridge-off", [x, y, v], [total])

# Between events: probability of ON, and the mean interval by Wald's identity; drift, variance, up, down.
for given in [(3e-7, 1e-9, 1e-3, 1e-3), (0.3, 1e3, 1e3, 1e3), (2e-4, 1e-3, 1.2, 0.7)]:
    drift, variance, up, down = (mpf(v) for v in given)
    m = 2 * drift / variance
    p = (exp(m * down) - 1) / (exp(m * down) - exp(-m * up))
    line("renewal", given, [p, (p * up - (1 - p) * down) / drift])

def f32(v):
    return struct.unpack("f", struct.pack("f", v))[0]


# Drift of a step of brightness in thresholds, k1 ln((L1 + k2) / (L0 + k2)); L as the 32 bits of a frame.
for k1, k2 in [(5.265, 20.0), (0.5, 1e-3 * 255.0)]:
    for l0, l1 in [(0, 255), (255, 0), (0, 1e6), (0, 1e-12), (1e-12, 255), (255, 1e6), (0, 1)]:
        a, b = mpf(f32(l0)), mpf(f32(l1))
        line("step", [k1, k2, f32(l0), f32(l1)], [mpf(k1) * log((b + mpf(k2)) / (a + mpf(k2)))])

# The printed K of GS2E, a reading (us in the unit of time, white), in official units; and the rate of all events of a
# pixel at rest, Hz, at three greys: drift coth(drift / variance).
K = [mpf(k) for k in (0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5)]
for r, white in [(1, 255), (1, 1), (1e-3, 255), (1e-3, 1), (1e-6, 255), (1e-6, 1)]:
    # the unit as the fraction that it is, not as a double
    r0, g = mpf(1) / mpf(round(1 / r)), mpf(255) / mpf(white)
    k = [K[0], K[1] * g, K[2] * sqrt(g * r0), K[3] * r0, K[4] * r0 / g, K[5] * sqrt(r0)]
    line("units", [r, white], k)
    for grey in (1, 16, 128):
        drift = k[3] + k[4] * grey
        sigma = k[2] * sqrt(mpf(grey)) / (grey + k[1]) + k[5]
        line("noise", [r, white, grey], [mpf(10) ** 6 * drift * coth(drift / sigma**2)])

# The quaternion x y z w of a rotation vector.
for t in [0.0, 1e-10, 1e-6, 1e-3, 0.3, 1.0, 3.0, 3.141592653589793 - 1e-9, 3.141592653589793]:
    for axis in [(1.0, 0.0, 0.0), (0.0, -0.6, 0.8), (0.36, 0.48, -0.8)]:
        r = [a * t for a in axis]
        n = sqrt(sum(mpf(v) ** 2 for v in r))
        half = sin(n / 2) / n if n else mpf(1) / 2
        line("turn", r, [mpf(v) * half for v in r] + [cos(n / 2)])

# Distance of the published speed law 0.25 sin t + 1.1 from 0 to t.
for k in range(0, 17):
    t = mpf(k) / 16
    line("law", [k / 16], [mpf(11) / 10 * t + (1 - cos(t)) / 4])

# Distance of the levels 1, 0.5, 2 over thirds, blended over 0.1 of a third on either side: a step is a sum of three
# uniform draws' distribution function, its integral a sum of truncated fourth powers.
for k in list(range(0, 33)) + [10.5, 10.7, 10.9, 21.1, 21.5]:
    t, tau = mpf(k) / 32, mpf(0.1) / 3
    total = t
    for at, jump in [(mpf(1) / 3, mpf(-1) / 2), (mpf(2) / 3, mpf(3) / 2)]:
        w = (t - at + tau) * 3 / (2 * tau)
        powers = [(1, 0), (-3, 1), (3, 2), (-1, 3)]
        total += jump * 2 * tau / 3 * sum(c * max(w - n, mpf(0)) ** 4 / 24 for c, n in powers)
    line("blend", [float(k) / 32], [total])
