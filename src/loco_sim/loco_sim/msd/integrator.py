# SPDX-License-Identifier: Apache-2.0
"""Integration kernels for mass-spring-damper networks: a single one, or blocks of a population.

A block is `WIDTH` networks side by side, one per SIMD lane. For a single network the lanes are
neighbouring nodes, and links that join neighbours to neighbours (`runs`). Both compute the
same sums in the same order, so their results are bit-identical. The data of a block stay in the
first-level cache for a whole run.

Step, from state x, v, a at t to t + h (velocity Verlet, thesis section 4.1.1):

    x += h v + h²/2 a,  ground,  a' = F(x, u, t + h) / m,  v += h/2 (a + a')

with u = v + h a for the velocity-dependent forces, which keeps the scheme second order
with dampers; the author's code takes u = v.
"""

from __future__ import annotations

import numpy as np

from ..jit import njit
from .lanes import bell, fma, get, inverse_length, next_word, put, put_span, span, where_negative

# Arrays are lists of rows of lanes. `state` has 6 parts of (dimension * nodes) rows: position,
# velocity, acceleration, force, reaction (force on the far ends of links) and the velocity
# used by the dampers.
X, V, A, F, R, U = range(6)
# `links`: 6 parts of one row per link, individual for each network.
STIFFNESS, SWING, PHASE, SINE, COSINE, FACTOR = range(6)
# `shape`: 3 parts of one row (or number) per link, the same for all networks; `masses`: mass
# and its inverse per node.
REST, DAMPING, HARDENING = range(3)
# `network`: one row (or number) per parameter.
OMEGA, NOISE, TURN_SINE, TURN_COSINE = range(4)
# `scales` and `choices`: numbers for all networks.
STEP, GRAVITY, DRAG, JOLT_RATE, JOLT_SIZE = range(5)
NODES, THREE, ALONG, AUTHOR, GROUND, PRESCRIBED, NOISE_ON, JOLT_HOLD = range(8)
NO_GROUND, STICK, AUTHOR_GROUND = range(3)

EXACT_EVERY = 512  # steps between exact sines; in between a rotation recurrence, accurate to 1e-13
TINY = 1e-24  # [m²] keeps the direction of a link of zero length finite

# Without reference counting, which would cost more than the arithmetic. Nothing is allocated.
inner = njit(_nrt=False, forceinline=True)
outer = njit(_nrt=False, nogil=True)


@inner
def drift(masses, scales, choices, state):
    """Position update with ground contact; also computes v + h a / 2, u, drag and weight."""
    nodes, rows = masses.shape[0] // 2, state.shape[0] // 6
    up = rows - nodes
    h, half_step, drag = scales[STEP], 0.5 * scales[STEP], -scales[DRAG]
    reach = 0.0 if choices[AUTHOR] else h
    ground, author = choices[GROUND], choices[GROUND] == AUTHOR_GROUND
    for i in range(nodes):
        height = get(state, up + i)
        rise = fma(half_step, get(state, A * rows + up + i), get(state, V * rows + up + i))
        landed = fma(h, rise, height)
        none = height * 0.0
        for row in range(i, rows, nodes):
            at, speed = get(state, row), get(state, V * rows + row)
            pull = get(state, A * rows + row)
            to = fma(h, fma(half_step, pull, speed), at)
            if ground:
                stop = to if row < up else none
                if not author:  # a node in ground contact does not slide either
                    if row < up:
                        stop = where_negative(height * -1.0, to, at)
                    pull = where_negative(landed, none, pull)
                to = where_negative(landed, stop, to)
                speed = where_negative(landed, none, speed)
            flow = fma(reach, pull, speed)
            put(state, row, to)
            put(state, V * rows + row, fma(half_step, pull, speed))
            put(state, U * rows + row, flow)
            put(state, R * rows + row, none)
            if row < up:
                put(state, F * rows + row, flow * drag)
            else:
                weight = get(masses, i) * -scales[GRAVITY] + none
                put(state, F * rows + row, fma(drag, flow, weight))


@inner
def exact_sines(t, links, network):
    """Exact sine and cosine of omega t + phase."""
    width, size = network.size // 4, links.size // 6
    omega, link = network.reshape(-1), links.reshape(-1)
    for k in range(size):
        angle = omega[OMEGA * width + k % width] * t + link[PHASE * size + k]
        link[SINE * size + k], link[COSINE * size + k] = np.sin(angle), np.cos(angle)


@inner
def driven(e, count, rest_length, turning, choices, links, network, rng):
    """Driven length of a link [m], eq. 4.7, with amplitude noise."""
    if choices[PRESCRIBED]:
        return get(links, FACTOR * count + e) * rest_length
    sine = get(links, SINE * count + e)
    if turning:  # advance the phase to this step by the addition theorem
        cosine = get(links, COSINE * count + e)
        by_sine, by_cosine = get(network, TURN_SINE), get(network, TURN_COSINE)
        put(links, COSINE * count + e, fma(cosine, by_cosine, sine * by_sine * -1.0))
        sine = fma(sine, by_cosine, cosine * by_sine)
        put(links, SINE * count + e, sine)
    swing = get(links, SWING * count + e)
    if choices[NOISE_ON]:
        bits = next_word(get(rng, e))
        put(rng, e, bits)
        swing = fma(get(network, NOISE) * rest_length, bell(bits), swing)
    return fma(swing, sine, rest_length)


@inner
def tension(e, square, closing, turning, shape, choices, links, network, rng):
    """Tension of a link per length [N/m]: spring of eq. 4.3 and damper of eq. 4.4."""
    count = links.shape[0] // 6
    inverse = inverse_length(square)
    rest_length = get(shape, REST * count + e)
    target_length = driven(e, count, rest_length, turning, choices, links, network, rng)
    stretch = square * inverse - target_length
    hardening = fma(stretch * get(shape, HARDENING * count + e), stretch, 1.0)
    pull = get(links, STIFFNESS * count + e) * stretch * hardening * inverse
    if choices[ALONG]:
        damping = get(shape, DAMPING * count + e)
        pull = fma(closing * damping, inverse * inverse, pull)
    return pull


@inner
def block_forces(first, other, turning, shape, choices, state, links, network, rng):
    """Forces of all links on the nodes of a block of networks.

    Nodes from last to first and links by their far ends, in the same order as `single_forces`.
    """
    nodes, rows, count = first.size - 1, state.shape[0] // 6, links.shape[0] // 6
    side, up, f, r, u = nodes, rows - nodes, F * rows, R * rows, U * rows
    three, along = choices[THREE], choices[ALONG]
    for i in range(nodes - 1, -1, -1):
        x0, z0, y0 = get(state, i), get(state, up + i), get(state, side + i)
        u0, w0, v0 = get(state, u + i), get(state, u + up + i), get(state, u + side + i)
        fx, fz, fy = get(state, f + i), get(state, f + up + i), get(state, f + side + i)
        dy = dv = x0 * 0.0
        for e in range(get(first, i), get(first, i + 1)):
            j = get(other, e)
            dx, dz = get(state, j) - x0, get(state, up + j) - z0
            du, dw = get(state, u + j) - u0, get(state, u + up + j) - w0
            square = fma(dz, dz, fma(dx, dx, TINY))
            closing = fma(dw, dz, du * dx)
            if three:
                dy, dv = get(state, side + j) - y0, get(state, u + side + j) - v0
                square, closing = fma(dy, dy, square), fma(dv, dy, closing)
            pull = tension(e, square, closing, turning, shape, choices, links, network, rng)
            gx, gz, gy = pull * dx, pull * dz, pull * dy
            if not along:
                damping = get(shape, DAMPING * count + e)
                gx, gz, gy = fma(damping, du, gx), fma(damping, dw, gz), fma(damping, dv, gy)
            fx, fz = fx + gx, fz + gz
            put(state, r + j, get(state, r + j) + gx)
            put(state, r + up + j, get(state, r + up + j) + gz)
            if three:
                fy = fy + gy
                put(state, r + side + j, get(state, r + side + j) + gy)
        put(state, f + i, fx)
        put(state, f + up + i, fz)
        if three:
            put(state, f + side + i, fy)


@inner
def single_forces(tail, head, turning, shape, choices, state, links, network, rng):
    """Forces of all links on the nodes of one network, run by run.

    Run e joins nodes near[e], near[e] + 1, … to far[e], far[e] + 1, …; links missing to
    `WIDTH` have no stiffness and no damping.
    """
    count, values = links.shape[0] // 6, state.reshape(-1)
    size = values.size // 6
    side = size // (3 if choices[THREE] else 2)
    up, f, r, u = size - side, F * size, R * size, U * size
    three, along = choices[THREE], choices[ALONG]
    for e in range(count):
        i, j = get(tail, e), get(head, e)
        dx, dz = span(values, j) - span(values, i), span(values, up + j) - span(values, up + i)
        du = span(values, u + j) - span(values, u + i)
        dw = span(values, u + up + j) - span(values, u + up + i)
        square = fma(dz, dz, fma(dx, dx, TINY))
        closing = fma(dw, dz, du * dx)
        dy = dv = dx * 0.0
        if three:
            dy = span(values, side + j) - span(values, side + i)
            dv = span(values, u + side + j) - span(values, u + side + i)
            square, closing = fma(dy, dy, square), fma(dv, dy, closing)
        pull = tension(e, square, closing, turning, shape, choices, links, network, rng)
        gx, gz, gy = pull * dx, pull * dz, pull * dy
        if not along:
            damping = get(shape, DAMPING * count + e)
            gx, gz, gy = fma(damping, du, gx), fma(damping, dw, gz), fma(damping, dv, gy)
        put_span(values, f + i, span(values, f + i) + gx)
        put_span(values, f + up + i, span(values, f + up + i) + gz)
        put_span(values, r + j, span(values, r + j) + gx)
        put_span(values, r + up + j, span(values, r + up + j) + gz)
        if three:
            put_span(values, f + side + i, span(values, f + side + i) + gy)
            put_span(values, r + side + j, span(values, r + side + j) + gy)


@inner
def jolt(masses, scales, choices, state, rng, running, push):
    """Impulse noise: random pushes on single nodes, drawn for each network.

    A push begins in a step with probability `JOLT_RATE` and lasts `JOLT_HOLD` steps; its
    components are uniform within ± `JOLT_SIZE` times the mean absolute acceleration then.
    """
    width, dimension = rng.size, 3 if choices[THREE] else 2
    nodes, size = choices[NODES], state.size // 6
    values, mass = state.reshape(-1), masses.reshape(-1)
    stride = size // dimension  # rows of one axis, including padding
    for w in range(width):
        bits = next_word(rng[w])
        if (bits >> np.uint64(11)) * 2.0**-53 < scales[JOLT_RATE]:
            mean = 0.0
            for d in range(dimension):
                for i in range(nodes):
                    mean += abs(values[A * size + d * stride + i * width + w])
            mean /= nodes * dimension
            bits = next_word(bits)
            running[width + w] = np.int64((bits >> np.uint64(33)) % np.uint64(nodes))
            running[w] = choices[JOLT_HOLD]
            for d in range(dimension):
                bits = next_word(bits)
                share = (bits >> np.uint64(11)) * 2.0**-52 - 1.0
                push[d * width + w] = share * scales[JOLT_SIZE] * mean
        rng[w] = bits
        if running[w] > 0:
            running[w] -= 1
            i = running[width + w]
            for d in range(dimension):
                values[F * size + d * stride + i * width + w] += mass[i] * push[d * width + w]


@inner
def kick(masses, scales, state):
    """Acceleration from force, and the second half of the velocity update."""
    nodes, rows, half_step = masses.shape[0] // 2, state.shape[0] // 6, 0.5 * scales[STEP]
    for i in range(nodes):
        light = get(masses, nodes + i)
        for row in range(i, rows, nodes):
            pull = (get(state, F * rows + row) - get(state, R * rows + row)) * light
            put(state, A * rows + row, pull)
            put(state, V * rows + row, fma(half_step, pull, get(state, V * rows + row)))


@inner
def forces(tail, head, turning, shape, choices, state, links, network, rng):
    """Forces of all links of a single network, whose `shape` has lanes, or of a block."""
    if shape.ndim == 2:
        single_forces(tail, head, turning, shape, choices, state, links, network, rng)
    else:
        block_forces(tail, head, turning, shape, choices, state, links, network, rng)


@outer
def advance(
    tick, steps, every, tail, head, shape, masses, scales, choices,
    state, links, network, rng, jolt_words, running, push, samples,
):  # fmt: skip
    """Run `steps` steps from step number `tick`; `samples` receives x, v, a each `every` steps."""
    rows = 3 * (state.shape[0] // 6)
    for k in range(tick + 1, tick + steps + 1):
        drift(masses, scales, choices, state)
        turning = k % EXACT_EVERY != 0
        if not turning and not choices[PRESCRIBED]:
            exact_sines(k * scales[STEP], links, network)
        forces(tail, head, turning, shape, choices, state, links, network, rng)
        if scales[JOLT_RATE] > 0.0:
            jolt(masses, scales, choices, state, jolt_words, running, push)
        kick(masses, scales, state)
        if every and (k - tick) % every == 0:
            frame = ((k - tick) // every - 1) * rows
            for row in range(rows):
                put(samples, frame + row, get(state, row))


@outer
def advance_blocks(
    first, end, tick, steps, every, tail, head, shape, masses, scales, choices,
    state, links, network, rng, jolt_words, running, push, samples,
):  # fmt: skip
    """`advance` for the blocks begin … end - 1 of a population, in sequence."""
    for b in range(first, end):
        advance(
            tick, steps, every, tail, head, shape, masses, scales, choices, state[b],
            links[b], network[b], rng[b], jolt_words[b], running[b], push[b], samples[b],
        )  # fmt: skip


@outer
def settle(tail, head, shape, masses, scales, choices, state, links, network, rng):
    """Initial acceleration; positions and velocities are not changed."""
    nodes, rows = masses.shape[0] // 2, state.shape[0] // 6
    for row in range(rows):
        speed = get(state, V * rows + row)
        none = speed * 0.0
        weight = none
        if row >= rows - nodes:
            weight = get(masses, row % nodes) * -scales[GRAVITY] + none
        put(state, U * rows + row, speed)
        put(state, R * rows + row, none)
        put(state, F * rows + row, fma(-scales[DRAG], speed, weight))
    forces(tail, head, False, shape, choices, state, links, network, rng)
    for row in range(rows):
        pull = get(state, F * rows + row) - get(state, R * rows + row)
        put(state, A * rows + row, pull * get(masses, nodes + row % nodes))
