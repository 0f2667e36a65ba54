"""Any faults: whatever goes wrong between a robot and its controller, in one process.

A seed makes all: law, arm, rate, parameters, who leads the arm, and the faults.  Judged are the
commands, as a robot sees them, and the arm, by Pinocchio and the numbers that were asked for.

    python test/test_any_faults.py 17     # the sequence of a seed, and what is wrong with it
"""

import itertools
import math
import sys

import numpy as np
import pytest
from faulty_arm import AT_REST, REAL, TIMEOUT, Fault, FaultyArm, along
from simulated import IDEAL
from yardstick import LAWS, REPRESENTATIONS, SEED, arm_named, turn

SEEDS, FEW, AT_ONCE = 300, 20, 20
STOPS_AT = {"ur5": 120.0, "panda": 30.0, "kuka_iiwa": 140.0}  # max_contact_force [N]
ARMS = tuple(STOPS_AT)
KINDS = {
    "states": ("drop", "delay", "repeat", "freeze", "stuck", "nan", "noise", "fast", "jump"),
    "people": ("halt", "kill", "change", "push", "leap", *2 * ("lean", "shove", "load"), "shove"),
    "commands": ("drop", "delay", "repeat", "nan"),
}
SIZES = {"drop": (0.3, 3.0), "delay": (0.005, 0.3), "noise": (1e-4, 0.01), "fast": (1.0, 4.0),
         "jump": (0.01, 10.0), "shove": (0.1, 1.0)}  # fmt: skip
FORCES, LONGER_BY = ("push", "lean", "shove", "load"), 1.5  # [s] what people do lasts longer
HARMLESS = ("halt", "leap", "repeat")  # what shakes neither the arm nor its states, nor its law
LEADERS = ("way points", "way points", "set-points", "poses", "goals", "twists")
RATES, EFFORT_RATES = (20, 50, 125, 250, 500, 1000), (125, 250, 250, 500, 1000)  # [Hz]
BEGIN, FIRST, LAST = 0.3, 0.4, 1.6  # [s] of the motion, and of the beginnings of faults
PAUSE, MOTION, REST, LONGER = 0.7, 1.2, 0.6, 3.0  # [s] about the last motion; more if it is slow
LEG, NEAR, TURN = 0.8, 0.05, 0.25  # [s], [m], [rad] of the way points
PUSH = np.array([15.0] * 3 + [1.5] * 3)  # [N, Nm]
LEAN, SHOVE, LOAD = 100.0, 150.0, 98.0  # [N] at most
SETTLING, STOPPING, RELEASED = 1.0, 1.0, 0.3  # [s] after a fault, of a stop, until efforts end
TIP = np.array([[0.25, 1.0], [1.0, 4.0], [20.0, 80.0]])  # speed, acceleration, jerk of the tip
# By how much [m] a stop gives way, and one in a contact, measured or not, that is felt from which
# force [N] in motion: what is estimated is taken for friction; [s] for which a leader has to pause.
GIVES_WAY, IN_CONTACT, PAUSES = 0.010, {True: (0.010, 10.0), False: (0.020, math.inf)}, 0.5
LATEST = {True: 0.05, False: 0.03}  # max_latency [s] of positions, and of efforts
ROUNDING, HERE, MOVES, PUSHED = 1e-9, 1e-6, 0.1, 2.0  # [s], [rad], [rad/s]


class Sequence:
    def __init__(self, seed):
        random = self.random = np.random.default_rng((SEED, seed))
        law, arm = LAWS[seed % len(LAWS)], str(random.choice(ARMS))
        rate = int(random.choice(RATES if law == "clik" else EFFORT_RATES))
        is_real = bool(random.integers(2))
        if arm == "kuka_iiwa" and law != "clik":  # its wrist is too light for less
            rate = max(rate, 500) if is_real else 1000
        self.period = random.uniform(0.01, 0.2)  # [s] of what leads the arm
        values = {
            "orientation": str(random.choice(REPRESENTATIONS)),
            "euler_sequence": "ZYX",
            "velocity_scale": float(random.choice([1.0, 0.2])),
            "max_joint_acceleration": [10.0],
            "max_linear_speed": float(random.choice([0.25, 0.15])),
        }
        if law == "clik":  # a loop over the measured positions is stable with less gain
            feedback, gain = random.choice(["internal", "measured"]), min(20.0, 0.3 * rate)
            values |= {"feedback": str(feedback), "k_Pp": gain, "k_Po": gain}
            values["max_joint_acceleration"] = [float(random.choice([10.0, 6.0]))]
        if law == "impedance_control":
            values["max_contact_force"] = STOPS_AT[arm]
        if law == "dynamic_control" and not is_real:
            values["max_error_position"] = float(random.choice([0.1, 0.02]))
        self.other = {"orientation": str(random.choice(REPRESENTATIONS)), "speed_override": 0.4}
        self.leader, axis = str(random.choice(LEADERS)), np.append(random.normal(size=3), [0] * 3)
        axis /= np.linalg.norm(axis)
        self.wrenches = {
            "push": PUSH * random.uniform(-1.0, 1.0, 6),
            "lean": LEAN * axis,
            "shove": SHOVE * axis,
            "load": LOAD * np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]),
        }
        home, x = arm_named(arm).pose(arm_named(arm).home), random.normal(size=(5, 2, 3))
        x *= np.array([[NEAR], [TURN]]) / np.linalg.norm(x, axis=2, keepdims=True)
        self.poses = [home, *((home[0] + step, turn(axis) @ home[1]) for step, axis in x)]
        self.faults = [self.fault(1 / rate) for _ in range(random.integers(1, 5))]
        ends = {f: f.end + f.size * (f.kind == "delay") for f in self.faults}
        shaken = [(f.at, end + SETTLING) for f, end in ends.items() if f.kind not in HARMLESS]
        self.quiet, self.shaken = max(ends.values()), [(0.0, 0.0), *shaken]
        small = {f: end for f, end in ends.items() if f.kind != "jump" or abs(f.size) < TIMEOUT}
        self.tips = [(f.at, end + SETTLING) for f, end in small.items() if f.kind not in HARMLESS]
        blind = {f: end for f, end in ends.items() if f.topic != "people" or f.kind == "kill"}
        self.blind = [(f.at, end + RELEASED) for f, end in blind.items() if f.kind != "repeat"]
        self.noise = PUSH * any(f.kind == "noise" for f in self.faults)
        self.fastest = values["velocity_scale"] * arm_named(arm).model.velocityLimit
        joints = REAL if is_real else IDEAL
        self.it = FaultyArm(law, arm, values, rate, self.faults, random, self.fastest, joints)
        self.active, self.due, self.sent = {}, BEGIN, math.inf

    def fault(self, period):
        random, topics = self.random, ("states", "states", "people", "people", "commands")
        topic, at = str(random.choice(topics)), random.uniform(FIRST, LAST)
        kind = str(random.choice(KINDS[topic]))
        lasts = math.exp(random.uniform(math.log(0.03), math.log(0.5)))
        lasts += LONGER_BY * (kind in ("halt", *FORCES[1:])) + RELEASED * (kind == "freeze")
        lasts = period if kind == "fast" else lasts  # a speed is wrong once
        size = math.exp(random.uniform(*np.log(SIZES.get(kind, (0.1, 1.0)))))
        is_back = kind == "jump" and random.uniform() < 0.5
        return Fault(topic, kind, at, at + lasts, -size if is_back else size)

    def run(self):
        it, end = self.it, self.quiet + PAUSE + MOTION + REST
        while it.t <= end + LONGER * (not it.is_at(self.poses[-1], 0.001, 0.005)):
            frame = along(self.poses, it.t - BEGIN, LEG)
            self.people(*frame[:2])
            self.lead(*frame)
            it.tick()
        it.drive.close()
        return self

    def people(self, p, R):
        """Halt, kill, push the arm, change its parameters, and send it far away."""
        it, before, t = self.it, self.active, self.it.t
        people = [f for f in self.faults if f.topic == "people" and f.at <= t < f.end]
        self.active = {f.kind: f for f in people}
        it.may_start = not {"kill", *FORCES} & set(self.active)
        for kind in sorted(set(self.active) ^ set(before)):
            is_on = kind in self.active
            if kind == "kill":
                it.product = None
            elif kind == "change":
                it.order("change", self.other if is_on else {"speed_override": 1.0})
            elif kind == "leap":
                it.order("stream", p + 0.5, R)
            elif kind in ("halt", "lean"):
                it.order("halt" if is_on else "resume")
        for kind in FORCES:
            if kind in self.active:
                it.press(self.active[kind], self.wrenches[kind])
            elif kind in it.touching:
                it.touch(kind)

    def lead(self, p, R, dp, omega):
        """Send what leads the arm; when all is over, resume and send it to the last pose."""
        t = self.it.t
        if self.due <= t < self.quiet:
            self.due = t + self.period if self.leader != "way points" else math.inf
            pieces = {
                "way points": ("follow", [LEG * k for k in range(1, 6)], self.poses[1:]),
                "set-points": ("stream", p, R, dp, omega),
                "poses": ("stream", p, R),
                "goals": ("aim", p, R),
                "twists": ("jog", np.append(dp, omega)),
            }
            self.it.order(*pieces[self.leader])
        is_over = self.quiet + PAUSE <= t < self.sent and self.it.order("resume")
        if is_over and self.it.order("follow", [MOTION], [self.poses[-1]]):
            self.sent = t


# --- what must hold: each yields when [s] and what is wrong ----------------------------------
def wrong_commands(run):
    """Finite, within the limits, without a jump; the first one holds the arm where it is."""
    it, n, model = run.it, run.it.arm.n, run.it.arm.model
    E, low, high = model.effortLimit, model.lowerPositionLimit, model.upperPositionLimit
    rate = run.fastest if it.is_position else np.maximum(E / 0.02, 2000.0)
    # a law that corrects what it missed overshoots; a robot grants more
    yield from it.too_hard(1.05 * it.values["max_joint_acceleration"][0])
    for before, row in itertools.pairwise([None, *it.answers]):
        command, least, most = row.command[:n], -E, E
        if it.is_position:  # an arm beyond its limits may come back
            least = np.append(np.minimum(low, row.q), -run.fastest)
            most = np.append(np.maximum(high, row.q), run.fastest)
        if not ((least <= row.command) & (row.command <= most)).all():
            yield row.t, f"{row.command} is not within {least}, {most}"
        if it.follows(before, row):
            step, time = np.abs(command - before.command[:n]), row.t - before.t
            if not it.is_position:
                yield from it.cut_apart(row, step / rate, np.abs(command) / E)
            if (step > rate * time + ROUNDING).any():
                yield row.t, f"a step of {step} in {time:.4g} s; allowed is {rate * time}"
        elif it.is_position:
            if np.abs(row.command - np.append(row.q, 0 * row.q)).max() > HERE:
                yield row.t, f"the first command is {row.command}, the arm at {row.q}"
        else:
            away, allowed = it.beside_weight(row, 2 * (run.noise + it.hardest))
            if (away > allowed).any():
                yield row.t, f"the first efforts are {away} from the weight; allowed {allowed}"


def wrong_answers(run):
    """No command to a state that is late, stuck or frozen, or to an arm that runs away."""
    it, n = run.it, run.it.arm.n
    has_jumped = any(fault.kind == "jump" for fault in run.faults)
    least, seen, frozen, fast, last = {}, {}, 0.0, math.inf, None
    resumes = it.times_of("resume")
    for row in it.rows:
        least[row.life] = min(row.age, least.get(row.life, row.age))
        stays = row.t - seen.setdefault((row.life, row.stamp), row.t)
        is_next = last is not None and last.life == row.life
        is_frozen = is_next and (last.q == row.q).all() and (np.abs(row.dq) > MOVES).any()
        frozen = frozen + row.t - last.t if is_frozen else 0.0
        if not is_next or any(last.t < t <= row.t for t in resumes):
            fast = math.inf
        elif last.command is not None and not row.is_refused and not it.is_position:
            slow = PUSHED if row.is_stopped else MOVES  # what pushes knows no limit of a motion
            is_fast = (np.abs(row.dq) > np.maximum(1.5 * run.fastest, slow) + ROUNDING).any()
            fast = min(fast, row.t) if is_fast else fast
        last = row
        if row.command is None:
            continue
        if row.age - least[row.life] > LATEST[it.is_position] + 0.002 and not has_jumped:
            yield row.t, f"a command to a state of {row.age:.3f} s ago"
        rests = it.is_position and np.abs(row.command[n:]).max() < AT_REST  # that does no harm
        if stays > TIMEOUT + ROUNDING and not rests:
            yield row.t, f"a command under a stamp that stays for {stays:.3f} s"
        if frozen > RELEASED and not has_jumped:
            yield row.t, f"a command to positions that stay for {frozen:.3f} s at {row.dq}"
        if row.t > fast + RELEASED:
            yield row.t, "efforts after the arm ran away"


def wrong_restarts(run):
    """Nothing leads a stopped arm on by itself: a stream pauses, a halt is resumed."""
    yield from run.it.led_on(PAUSES - ROUNDING)


def wrong_stops(run):
    """A stop under efforts hardly gives way to what touches the arm."""
    if not run.it.is_position:
        is_measured = run.it.law == "impedance_control"
        yield from run.it.gives_way(GIVES_WAY, *IN_CONTACT[is_measured], run.blind)


def wrong_motions(run):
    """Never fast; at rest after a halt or a silence; and in the end where it is sent."""
    it, (t, dq) = run.it, (np.array([row[k] for row in run.it.truth]) for k in (0, 2))
    shaken = np.any([(a < t) & (t < b) for a, b in run.shaken], axis=0)
    most = 1.05 if any(it.friction) else 1.02  # rotors that no model knows overshoot
    speed, factors = np.abs(dq).max(axis=1), np.where(shaken, 2.0, most)
    limits = np.where(shaken[:, None], it.arm.model.velocityLimit, run.fastest)
    if (beyond := (np.abs(dq) / limits).max(axis=1) / factors).max() > 1:
        yield t[beyond.argmax()], f"the joints move at {dq[beyond.argmax()]}"
    if run.sent == math.inf or not it.is_at(run.poses[-1], 0.005, math.radians(1.0)):
        yield it.t, f"it does not get there: {it.product and it.product.controller.why}"
    resumes = [*it.times_of("resume"), math.inf]
    resumes += [b.t for a, b in itertools.pairwise(it.rows) if a.life != b.life]  # it knows nothing
    spans = [(t, min(b for b in resumes if b > t)) for t in it.times_of("halt")]
    if run.leader == "way points":  # nobody sends them again
        times = [row.t for row in it.rows if not row.is_refused]
        gaps = itertools.pairwise(times)
        spans += [(b, math.inf) for a, b in gaps if b - a > TIMEOUT + ROUNDING]
    for start, end in spans:
        calm = (start + STOPPING < t) & (t < min(end, run.sent)) & ~shaken
        if calm.any() and speed[calm].max() > 0.02:
            where = t[calm][speed[calm].argmax()]
            yield where, f"it moves at {speed[calm].max():.3g} rad/s since {start:.3f} s"


def wrong_tips(run):
    """The tip within its limits while nothing shakes the arm: as commanded, or under efforts."""
    it, n = run.it, run.it.arm.n
    factors, orders = ([1.01, 1.05, 1.5], 3) if it.is_position else ([1.1, 1.5, 1.0], 2)
    if it.values.get("feedback") == "measured" or it.values["velocity_scale"] < 1:
        orders = 1  # for a joint at its speed limit the tip waits, at that joint's acceleration
    if any(it.friction) and not it.is_position:
        orders = 1  # friction that turns round accelerates a wrist by up to 10 rad/s^2
    limits = TIP * np.array(factors)[:, None]
    limits[0, 0] *= it.values["max_linear_speed"] / TIP[0, 0]
    # steps of 10 % of an acceleration, and of 0.2 % of a speed, are no jerks that a robot feels
    limits[2] += np.maximum(0.1 * limits[1] * it.rate, 0.002 * limits[0] * it.rate**2)
    path = [(row.t, row.command[:n]) for row in it.answers]
    path = path if it.is_position else [now[:2] for now in it.truth if now.t > BEGIN]
    for t, rates in it.tip_rates(path, run.tips, orders):
        for norms, limit in zip(rates, limits, strict=False):
            if (norms > limit).any():
                yield t, f"{len(rates)}: {norms} of the tip; allowed {limit}"


ORACLES = wrong_commands, wrong_answers, wrong_restarts, wrong_stops, wrong_motions, wrong_tips


def judged(seed):
    """Return what is wrong in the sequence of a seed, in words."""
    run = Sequence(seed).run()
    it, oracles = run.it, ORACLES
    found = [f"{t:.3f} s: {text}" for each in oracles for t, text in itertools.islice(each(run), 3)]
    about = f"seed {seed}: {it.law} {it.arm.name} {it.rate} Hz, {run.leader}, {it.values}"
    return "\n  ".join([about, *map(str, run.faults), *found]) if found else ""


MANY = [range(first, first + AT_ONCE) for first in range(0, SEEDS, AT_ONCE)]
GROUPS = [
    *([seed] for seed in range(FEW)),
    *(pytest.param(m, marks=pytest.mark.slow) for m in MANY),
]


@pytest.mark.parametrize("seeds", GROUPS, ids=str)
def test_whatever_goes_wrong_commands_are_safe_and_the_arm_recovers(seeds):
    assert "\n".join(filter(None, map(judged, seeds))) == ""


if __name__ == "__main__":
    print(*(judged(int(seed)) or f"seed {seed}: all holds" for seed in sys.argv[1:]), sep="\n")
