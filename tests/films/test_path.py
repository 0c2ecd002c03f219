"""The likeliest path: against every path there is, and two that cross. Points alone, no pictures."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from jumpvision.films.vision.ball.path import Claim, Nodes, Score, best_path, joint_paths

S = Score(1e4)


def nodes_of(places: list[list[tuple[float, float]]], rng: np.random.Generator, d: float = 10.0) -> Nodes:
    """Candidates of each frame at (x, y)."""
    frame = np.array([i for i, at in enumerate(places) for _ in at])
    x, y = np.array([p for at in places for p in at]).T
    size, light = d * np.exp(rng.normal(0, 0.05, x.size)), 100.0 * np.exp(rng.normal(0, 0.1, x.size))
    return Nodes(frame, x, y, size, light, np.zeros(x.size), np.zeros(x.size), 0.1 * size)


def by_hand(n: Nodes, own: np.ndarray, frames: int, chosen: tuple[int, ...]) -> float:
    """What the page of the docs says of a path, link by link: each either a step or a going and a coming."""

    def step(a: int, b: int, o: int | None) -> float:
        gap = n.frame[b] - n.frame[a]
        if gap > S.gap or abs(math.log(n.d[b] / n.d[a])) >= 0.7:
            return -math.inf
        way = np.array([n.x[b] - n.x[a], n.y[b] - n.y[a]])
        rest = S.rest * n.d[a]
        chance = 1.0 / S.area + 0.5 * math.exp(-0.5 * (way @ way) / rest**2) / (2 * math.pi * rest**2)
        total = own[b] - math.log(chance) + (S.hidden * (1.0 + 0.2 * (gap - 2)) if gap > 1 else 0.0)
        for ratio, scale in ((n.d[b] / n.d[a], S.size), (n.contrast[b] / n.contrast[a], S.contrast)):
            total -= 1.5 * math.log1p(0.5 * (math.log(ratio) / scale) ** 2)
        if o is None:
            off, var = way, (S.start * n.d[a] * gap) ** 2 + n.s[a] ** 2 + n.s[b] ** 2
        else:
            before = n.frame[a] - n.frame[o]
            v = np.array([n.x[a] - n.x[o], n.y[a] - n.y[o]]) / before
            r, lift = gap / before, 0.5 * gap * (gap + before)
            off = way - gap * v
            var = n.s[b] ** 2 + (1 + r) ** 2 * n.s[a] ** 2 + r**2 * n.s[o] ** 2
            var += ((S.shake * n.d[a] + S.bend * math.hypot(*v)) * lift) ** 2
        return total - 2.0 * math.log1p(0.5 * (off @ off) / var) - math.log(2 * math.pi * var)

    k = [c for c in chosen if c >= 0]
    if not k:
        return 0.0
    best = {None: S.enter + own[k[0]]}  # by the candidate before the last
    for a, b in itertools.pairwise(k):
        anew = max(best.values()) + S.leave + S.enter + own[b]
        best = {a: max(v + step(a, b, o) for o, v in best.items()), None: anew}
    return max(best.values()) + (0.0 if n.frame[k[-1]] == frames - 1 else S.leave)


@pytest.mark.parametrize("seed", range(4))
def test_the_best_of_all_paths_is_found_and_the_best_through_each_candidate(seed):
    """Five frames of two candidates each: 243 paths. The flag of a row is by its best rival."""
    rng, frames = np.random.default_rng(seed), 5
    way = [(20.0 + 6.0 * i, 30.0 + 0.5 * i * i) for i in range(frames)]
    n = nodes_of([[(x + rng.normal(0, 1), y), tuple(rng.uniform(0, 60, 2))] for x, y in way], rng)
    own = rng.normal(0, 2, n.x.size)
    all_paths = list(itertools.product(*[(-1, 2 * i, 2 * i + 1) for i in range(frames)]))
    value = np.array([by_hand(n, own, frames, p) for p in all_paths])
    found = best_path(n, frames, Claim(own, S))
    assert found.gain == pytest.approx(value.max(), abs=1e-9)
    assert tuple(found.node) == all_paths[int(value.argmax())]
    through = [value[[k in p for p in all_paths]].max() for k in range(n.x.size)]
    np.testing.assert_allclose(found.through, through, atol=1e-9)
    for i, (k, p) in enumerate(zip(found.node, found.probability)):
        if k >= 0:
            rival = value[[q[i] != k for q in all_paths]].max()
            assert p == pytest.approx(1.0 / (1.0 + math.exp(min(50.0, rival - value.max()))), abs=1e-9)


def test_paths_that_cross_behind_something_keep_their_motion():
    """Two balls, 4 frames hidden where they cross, and 2 random glints a frame: 60 drawn pairs with a velocity that
    differs by 4 px a frame, 10 times what 0.1 diameters of scatter leave of it. Never exchanged without doubt."""
    rng, frames, exchanged, sure = np.random.default_rng(0), 24, 0, 0
    for _ in range(60):
        i, side = np.arange(frames) - 11.5, rng.uniform(2.0, 4.0)
        one, other = ([(100.0 + 5.0 * t, 100.0 + sign * side * t) for t in i] for sign in (1.0, -1.0))
        places = []
        for k in range(frames):
            seen = [] if abs(i[k]) < 2.0 else [tuple(np.array(p[k]) + rng.normal(0, 0.5, 2)) for p in (one, other)]
            places.append([*seen, *map(tuple, rng.uniform(0, 200, (2, 2)))])
        n = nodes_of(places, rng)
        own = np.where(n.frame == 0, np.where(np.arange(n.x.size) == 0, 0.0, -1e6), 0.0)
        path = joint_paths(n, frames, [Claim(own, S, at_first=True)], Claim(np.zeros(n.x.size), S))[0]
        good = (path.node >= 0) & (1.0 / (1.0 / path.probability + path.exchanged) > 0.95)
        late = good & (i > 2.0)
        sure += late.sum() > 0
        exchanged += bool(np.any(np.abs(n.y[path.node[late]] - np.array(one)[late, 1]) > 5.0))
    assert exchanged <= 3 and sure >= 50  # 5 % of doubt is allowed to each
