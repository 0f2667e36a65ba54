"""What controllers command when references leap, stall, stop, come with noise: against the limits.

As tables of markdown: `make bench-motion`, or `bench_motion.py events streams goals cost`.
"""

import math
import sys
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from motion_arm import WAYS, Bench, Events, stream, to, turn_joint

from eulerparams_control.laws.rotations import angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.references import Goal, SetPoint
from eulerparams_control.motion.shaper import Shaper

LIMITS = MotionLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0)
OVER = 1.05  # of the accelerations
V = 0.1  # of streams [m/s]


def jump(bench: Bench) -> None:
    bench.stamps += 0.3


# What happens, for how long [s], where it is to end [m] (None: where it was told to stop), [Hz].
EVENTS: dict[str, tuple[Events, float, float | None, float]] = {
    "A, then B stamped 4 s ahead from where the arm was": (
        [(0.1, to(0.25, 3.0)), (0.2, to(0.05, 3.0, back=0.0, after=4.0))], 9.0, None, 0),
    "0.05 m/s, 100 Hz, stamped 15 ms ahead": (
        stream(100, 0.05, twists=True, ahead=0.015), 4.0, 0.05 * 1.99, 0),
    "0.05 m/s, poses, 100 Hz, stamped 15 ms ahead": (
        stream(100, 0.05, ahead=0.015), 4.0, 0.05 * 1.99, 0),
    "one set-point 49 mm away": ([(0.1, lambda b: b.send(SetPoint(b.at(0.049), 0.1)))],
        3.0, 0.049, 0),
    "one set-point 0.19 rad away": ([(0.1, lambda b: b.send(SetPoint(b.at(0, 0.19), 0.1)))],
        3.0, 0.0, 0),
    "20 m/s: 12 set-points in 24 ms": (stream(500, 20.0, seconds=0.024), 4.0, None, 0),
    "a way-point 0.25 m away in 1 ms": ([(0.1, to(0.25, 0.001))], 4.0, 0.25, 0),
    "a pose 0.25 m and 1 rad away": ([(0.1, lambda b: b.send(b.at(0.25, 1.0)))], 5.0, 0.25, 0),
    "poses, 10 Hz, 0.1 m/s": (stream(10, V), 4.0, V * 1.9, 0),
    "twists, 20 Hz, 1 mm, 20 % jitter, 0.1 m/s": (
        stream(20, V, twists=True, noise=(0.001, 0.0), jitter=0.2), 4.0, V * 1.95, 0),
    "0.2 m/s, 50 Hz, twists, stops": (
        stream(50, 0.2, twists=True, seconds=1.0), 4.0, 0.2 * 0.98, 0),
    "0.2 m/s, 50 Hz, poses, stops": (stream(50, 0.2, seconds=1.0), 4.0, 0.2 * 0.98, 0),
    "jog 0.2 m/s, 20 Hz, stops": ([(0.1 + k / 20,
        lambda b: b.send(0.2 * np.append(b.way, np.zeros(3)))) for k in range(20)],
        4.0, None, 0),
    "halt at 0.2 m/s": ([(0.1, to(0.25, 2.4)), (1.3, lambda b: b.controller.halt())],
        3.0, None, 0),
    "joint_states at 40 Hz": ([(1.0, to(0.05, 1.5))], 4.0, 0.05, 40),
    "velocity_scale 0.02 at 0.6 s, 1 at 2.6 s": ([(0.1, to(0.25, 3.0)),
        (0.7, lambda b: b.change(velocity_scale=0.02)),
        (2.7, lambda b: b.change(velocity_scale=1.0))], 9.0, 0.25, 0),
    "speed_override 0 at 0.6 s, 1 at 2 s": ([(0.1, to(0.25, 3.0)),
        (0.7, lambda b: b.change(speed_override=0.0)),
        (2.1, lambda b: b.change(speed_override=1.0))], 7.0, 0.25, 0),
    "stamps jump by 0.3 s at rest, wrapped joints": (
        [(0.1, turn_joint(0.4)), (2.0, jump), (2.6, turn_joint(-0.3))], 5.0, None, 0),
    "stamps jump by 0.3 s at 0.2 m/s": ([(0.1, to(0.25, 2.4)), (1.3, jump)], 3.0, None, 0),
}  # fmt: skip


def events(runs: list[tuple[str, str, float]]) -> Iterator[str]:
    """Yield the rows of the table of events: scheme, arm, rate; bars that are missed are bold."""
    yield ("| event | scheme | arm | Hz | tip m/s | tip m/s^2 | joints rad/s^2 | step rad | "
           "distance mm | fault, refused, silent |")  # fmt: skip
    yield "|" + " --- |" * 10
    for name, (what, duration, goal, only) in EVENTS.items():
        for scheme, arm, rate in runs:
            if only and (rate, scheme) != (500, "clik"):
                continue
            rate = only or rate
            bench = Bench(scheme, arm, rate).run(what, duration)
            got = bench.measure()
            peaks = got.speed.max(), got.acceleration.max(), got.joints.max()
            bars = LIMITS.linear_speed * (1 + 1e-3), OVER * LIMITS.linear_acceleration, OVER * 10
            cells = [f"{peak:.3f}" if peak <= bar else f"**{peak:.3f}**"
                     for peak, bar in zip(peaks, bars, strict=True)]  # fmt: skip
            off = ""
            if goal is not None:
                off = f"{1e3 * np.linalg.norm(got.p[-1] - bench.at(goal).p_d):.2f}"
            told = f"{bench.fault[:60]} {bench.refused} {bench.silent}"
            yield f"| {name} | {scheme} | {arm} | {rate:g} | {' | '.join(cells)} | " + (
                f"{got.step:.4f} | {off} | {told} |"
            )


def streams(rates: tuple[float, ...] = (5, 10, 20, 50, 200)) -> Iterator[str]:
    """Yield the rows of the table of streams; cells: lag [ms] / speed of V / acceleration."""
    noises = {"0": (0.0, 0.0), "1 mm": (0.001, 0.0), "2 mm 1 deg": (0.002, math.radians(1))}
    columns = [(j, n) for j in (0.0, 0.2, 0.5) for n in noises]
    heads = [f"jitter {100 * j:g} %, noise {n}" for j, n in columns]
    yield "| Hz | what | latency ms | " + " | ".join(heads) + " |"
    yield "|" + " --- |" * (3 + len(heads))
    for rate in rates:
        for twists in (False, True):
            for latency in (0.0, 0.1):
                cells = []
                for jitter, noise in columns:
                    what = stream(rate, V, seconds=2.5, twists=twists, jitter=jitter,
                                  noise=noises[noise], latency=latency)  # fmt: skip
                    bench = Bench("clik", "ur5", 500).run(what, 4.0)
                    got = bench.measure()
                    steady = slice(550, 1200)
                    t = np.arange(1, len(got.p) + 1) / 500 - 0.1
                    late = (t - (got.p - bench.start.p_d) @ bench.way / V)[steady]
                    v, a = got.speed[steady] / V, got.acceleration.max()
                    over = f"{a:.2f}" if a <= OVER else f"**{a:.2f}**"
                    fault = "" if not bench.fault else f" FAULT {bench.fault[:30]}"
                    speeds = f"{v.min():.2f}-{v.max():.2f}"
                    cells.append(f"{1e3 * np.median(late):.0f} / {speeds} / {over}{fault}")
                kind = "twists" if twists else "poses"
                yield f"| {rate:g} | {kind} | {1e3 * latency:g} | " + " | ".join(cells) + " |"


def _least(d: float, v: float, a: float, j: float) -> float:
    """Return the least time [s] from rest to rest over d [m, rad]."""
    a = min(a, math.sqrt(v * j))
    if d >= v * (v / a + a / j):
        return d / v + v / a + a / j
    if d >= 2 * a**3 / j**2:
        return a / j + math.sqrt((a / j) ** 2 + 4 * d / a)
    return float((32 * d / j) ** (1 / 3))


def goals(count: int = 1000, places: int = 500) -> Iterator[str]:
    """Yield what goals take, of the shortest time that the limits allow."""
    rng, ratios, over = np.random.default_rng(1), [], 0
    rows = np.array([LIMITS.speeds, LIMITS.accelerations, LIMITS.jerks]).T
    for _ in range(count):
        start, end = (DesiredFrame(rng.uniform(-0.3, 0.3, 3), exp(u))
                      for u in rng.normal(size=(2, 3)))  # fmt: skip
        ways = np.linalg.norm(end.p_d - start.p_d), angle_between(end.R_d, start.R_d)
        least = max(_least(way, *row) for way, row in zip(ways, rows.tolist(), strict=True))
        shaper = Shaper(start, LIMITS)
        shaper.follow(Goal(end), None)
        dt = 1.25 * least / places
        frames = [shaper.sample(round(k * dt * 1e9)) for k in range(places + 1)]
        moving = [bool(f.dp_d.any() or f.omega_d.any()) for f in frames]
        ratios.append((places + 1 - moving[::-1].index(True)) * dt / least)
        v, w, a, dw = (np.array([f[n] for f in frames]) for n in (2, 3, 4, 5))
        used = [np.linalg.norm(part, axis=1).max() / most for part, most in zip(
            (v, w, a, dw, np.diff(a, axis=0) / dt, np.diff(dw, axis=0) / dt),
            rows.T.ravel(), strict=True)]  # fmt: skip
        over += max(used) > 1.001
        assert np.linalg.norm(frames[-1].p_d - end.p_d) < 1e-9
    yield "| goals | median of the shortest time | worst | beyond a limit |"
    yield "|" + " --- |" * 4
    yield f"| {count} | {np.median(ratios):.4f} | {max(ratios):.4f} | {over} |"


def cost(rounds: int = 60, ticks: int = 100) -> Iterator[str]:
    """Yield what a tick costs with the shaper, on a trajectory within the limits, to without."""
    bench = Bench("clik", "ur5", 1000).run([(0.1, to(0.2, 5.0))], rounds * ticks / 1000)
    yield "| scheme | us, shaped | us, limits=None | ratio |"
    yield "|" + " --- |" * 4
    for name in ("clik", "dynamic_control", "impedance_control"):
        pair = [Bench(name, "ur5", 1000) for _ in range(2)]
        options = pair[1].controller.options
        pair[1].controller.changed(replace(options, motion=None))
        pair[1].controller.guidance.begin(pair[1].q, acts=False)
        times: list[list[float]] = [[], []]
        for k in range(rounds):
            for one, spent in zip(pair[:: 1 - 2 * (k % 2)], times[:: 1 - 2 * (k % 2)], strict=True):
                begin = time.process_time()
                for n in range(k * ticks, (k + 1) * ticks):
                    q, dq = bench.rows[n]
                    if n == 100:
                        to(0.2, 5.0)(one)
                    one.time = (n + 1) / 1000
                    one.controller.step(one.stamp, q, dq, one.time)
                spent.append((time.process_time() - begin) / ticks)
        assert not any(one.controller.fault for one in pair), pair[0].controller.fault
        shaped, plain = (1e6 * float(np.median(spent[5:])) for spent in times)
        yield f"| {name} | {shaped:.0f} | {plain:.0f} | {shaped / plain:.3f} |"


def main() -> None:
    """Print the tables named, or all."""
    clik = [("clik", arm, rate) for arm in WAYS for rate in (100, 500, 1000)]
    efforts = [(name, "ur5", 500) for name in ("dynamic_control", "impedance_control")]
    tables = {"events": lambda: events([*clik, *efforts]), "streams": streams, "goals": goals,
              "cost": cost}  # fmt: skip
    for name in sys.argv[1:] or tables:
        print(f"\n### {name}\n", flush=True)
        for row in tables[name]():
            print(row, flush=True)


if __name__ == "__main__":
    main()
