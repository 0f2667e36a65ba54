"""Compliance control: an impedance by efforts, without a force/torque sensor.

Siciliano and Villani, Robot Force Control, ch. 3: springs and dampers draw the tip to the desired
frame, and the arm keeps its own inertia:

    tau = J' w + B ddq_d + C dq + d + g,    w = (f, mu) - D (v - v_d)

with (f, mu) the elastic wrench, minus the gradient of an energy, D the damping, and ddq_d the
accelerations that follow the desired ones, and tend to the posture without moving the tip.  Against
a contact f at rest K (p_d - p_e) = -f: what is felt is the stiffness.  The accelerations are those
that springs and contact make of the inertia; limits of speed, position and effort hold.

An arm that is held may be let go within a moment.  The springs pull no more than can be taken back,
at the rates of the efforts, before the tip has its speeds: their clips are lowered until that
holds, which takes energy from them, and return when nothing is stretched that far, which gives
none.  A force that is fed forward is bounded likewise, by less than the springs hold.  A tip beyond
its speeds is braked, whatever drives it.

Notation: ``Lambda`` (6, 6) inertia of the tip (J B^-1 J')^-1, ``K`` (6, 6) its stiffness, ``omega``
[1/s] natural rates of its modes, ``f, mu`` [N, Nm] wrench of the springs on the tip, ``v, v_d``
(6,) velocity of the tip and of the desired frame; base frame.
"""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eulerparams_control.errors import LoadError
from eulerparams_control.laws.elasticity import Elasticity, SpringWrench
from eulerparams_control.laws.inverse import matrix_product, solved, symmetric_modes
from eulerparams_control.laws.inverse_dynamics import EffortControl, joint_acceleration
from eulerparams_control.laws.jit import f8, jit, matrix, new_matrix, new_vector, types, vector
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import Lyapunov
from eulerparams_control.laws.rotations import Array, dot, norm, solve, turn
from eulerparams_control.laws.scheme import LoopGain, Tick
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import DynamicState

if TYPE_CHECKING:
    from eulerparams_control.parameters.compliance_control import ComplianceParameters

# Modes that are slower [1/s] are damped as if they had this rate: near a singularity one has none.
_LEAST_OMEGA = 1.0

# A damped mode has 1 / (e omega) of the speed that its first acceleration makes in 1 s.
_DAMPED_SPEED = math.e / 2.0

# A tip beyond its speeds is braked with this rate [1/s], and no more than this part of the rate of
# the ticks.
_BRAKE_RATE, _TICKS_SHARE = 100.0, 0.25

# Inertia [kg m^2] of a rotor and its gear, at their joint, that no URDF states: the least of geared
# arms.  Without it a light wrist could be pulled by less than the friction of its joint.
_LEAST_ROTOR = 0.012

# Of the force that an arm may lose at once, without a lunge, what is fed forward takes this part:
# less than the springs that hold it.
_FEEDFORWARD_SHARE = 0.8

# Ticks until what was seen of the tip has changed an effort.
_DELAY_TICKS = 2.0

# [N/s] at which a force that is fed forward changes.
_FORCE_RATE = 200.0

_TINY = 1e-12

_NO_FORCE = np.zeros(3)
_NO_FORCE.setflags(write=False)


class TipWrench(NamedTuple):
    """What drives the tip where nothing bounds it, and how the tip answers."""

    springs: SpringWrench
    w: Array  # (6,) [N, Nm] of the springs
    damping: Array  # (6,) [N, Nm] of the dampers, D = F E
    E: Array  # (6, 6) of the damping D = F E, see :func:`modal_damping`
    mode: tuple[float, float]  # rate [1/s] of the fastest one, rotational part of its energy
    M: Array  # (n, 6) B^-1 J', by which a wrench accelerates the joints
    mobility: Array  # (6, 6) Lambda^-1, by which it accelerates the tip
    v: Array
    v_d: Array


def compliance(
    state: DynamicState,
    desired: DesiredFrame,
    elasticity: Elasticity,
    clip_share: float,
    ratio_p: float,
    ratio_o: float,
) -> TipWrench:
    """Return the wrench (f, mu) - D (v - v_d) of springs and dampers.

    D = F Y diag(2 zeta / omega) Y' F' with F F' = K and F' Lambda^-1 F = Y diag(omega^2) Y', which
    is positive definite, damps each mode by its ratio zeta, that of its part of p and o.  Lambda
    itself, which singularities lack, is not needed.

    Args:
        state, desired: of the arm, and the desired frame.
        elasticity, clip_share: the springs, clipped at this part of where that is stated.
        ratio_p, ratio_o: damping ratios of translational and rotational modes.
    """
    arm = state.arm
    v, v_d = np.concatenate((arm.dp_e, arm.omega_e)), np.concatenate(desired[2:4])
    springs = elasticity.wrench(arm.p_e, arm.R_e, desired, clip_share)  # (56), (60), (66)
    w, F = np.concatenate(springs[:2]), springs.F  # F F' = K
    M = solved(state.B, arm.J.T)  # B^-1 J'
    mobility = arm.J @ M  # Lambda^-1
    E, rate, turning = modal_damping(F, mobility, ratio_p, ratio_o)  # D = F E
    damping = dampers(F, E, w, v, v_d, clip_share * elasticity.clips)  # -D (v - v_d)
    return TipWrench(springs, w, damping, E, (rate, turning), M, mobility, v, v_d)


# --- its primitives; of (6,) come the part of the position and that of the orientation -------


@jit(types.Tuple((new_matrix, f8, f8))(matrix, matrix, f8, f8))
def modal_damping(
    F: Array, mobility: Array, ratio_p: float, ratio_o: float
) -> tuple[Array, float, float]:
    """Return E (6, 6) = Y diag(2 zeta / omega) Y' F', and :class:`TipWrench` ``mode``."""
    modes = matrix_product(F.T, matrix_product(mobility, F))
    Y, E = np.empty((6, 6)), np.zeros((6, 6))
    symmetric_modes(modes, Y)
    forces, rate, turning = matrix_product(F, Y), 0.0, 0.0
    for i in range(6):
        rotational = dot(Y[3:, i], Y[3:, i])
        zeta = ratio_p + rotational * (ratio_o - ratio_p)
        omega = math.sqrt(max(modes[i, i], _LEAST_OMEGA * _LEAST_OMEGA))
        for j in range(6):
            E[j] += (2.0 * zeta / omega * Y[j, i]) * forces[:, i]
        fastest = omega * max(zeta, 1.0 / zeta)  # light damping bears less delay, too
        if fastest > rate:
            rate, turning = fastest, rotational
    return E, rate, turning


@jit(new_vector(matrix, matrix, vector, vector, vector, vector))
def dampers(F: Array, E: Array, w: Array, v: Array, v_d: Array, most: Array) -> Array:
    """Return -D (v - k v_d), D = F E, k in [0, 1] with |F^-1 w - E v + k E v_d| <= most (2,).

    So the feed-forward pushes the tip by no more than the springs w may.  Where these and the drag
    are more already k is the largest that does not add to them; 1 at a singularity.
    """
    drag, lead, share = (E * v).sum(axis=1), (E * v_d).sum(axis=1), 1.0
    for part in range(2):
        own = slice(3 * part, 3 * part + 3)
        rest = solve(F[own, own], w[own]) - drag[own]
        square, along, size = dot(lead[own], lead[own]), dot(rest, lead[own]), dot(rest, rest)
        over = size - max(most[part] * most[part], size)
        if square + 2.0 * along + over > 0.0:
            k = (math.sqrt(max(along * along - square * over, 0.0)) - along) / square
            share = min(share, max(0.0, k))
    return (F * (share * lead - drag)).sum(axis=1)


@jit(f8(f8, f8, f8, f8, f8, f8))
def release_margin(
    speed: float, most: float, a: float, braked: float, time: float, tick: float
) -> float:
    """Return the largest part s <= 1 of a pull that keeps a tip that is let go within its speed.

    A pull s a acts for a tick before it is seen.  It is taken back after t = 2 tick + s time / 2,
    and dampers leave 1 / (1 / t + c) of that, with c = e / 2 times ``braked``:

        speed + s a tick <= most
        speed + s a t / (1 + c t) = most

    The whole pull accelerates the tip by a; its efforts are taken back in a time.
    """
    if math.isinf(most):
        return 1.0
    left, c, late = most - speed, _DAMPED_SPEED * braked, _DELAY_TICKS * tick
    if left <= 0.0:
        return 0.0
    square = a * time / 2.0
    linear = a * late - left * c * time / 2.0
    whole = left * (1.0 + c * late)
    root = linear + math.sqrt(linear * linear + 4.0 * square * whole)
    part = 2.0 * whole / root if root > 2.0 * whole else 1.0
    return min(part, left / max(a * tick, left))


@jit(types.Tuple((f8, f8))(vector, vector, vector, vector, vector, vector, f8))
def release_margins(
    v: Array, a: Array, b: Array, most: Array, effort: Array, rate: Array, tick: float
) -> tuple[float, float]:
    """Return the least :func:`release_margin` of both parts of a tip at rest, and of one at v (6,).

    The whole pull accelerates it by a (6,), and at the velocity a dampers brake it by b (6,).  Its
    efforts (n,) [Nm] are taken back at their rates (n,) [Nm/s].
    """
    time, resting, moving = (np.abs(effort) / rate).max(), 1.0, 1.0
    for part in range(2):
        own = slice(3 * part, 3 * part + 3)
        speed, size = norm(v[own]), norm(a[own])
        braked = max(dot(a[own], b[own]) / max(size * size, _TINY), 0.0)
        resting = min(resting, release_margin(0.0, most[part], size, braked, time, tick))
        moving = min(moving, release_margin(speed, most[part], size, braked, time, tick))
    return resting, moving


@jit(new_vector(vector, vector, f8, matrix))
def brake(v: Array, most: Array, rate: float, mobility: Array) -> Array:
    """Return what slows down both parts of v (6,) beyond ``most`` (2,): -r m (|v| - most) n.

    n = v / |v|, r is the rate [1/s], and m = 1 / (n' Lambda^-1 n) the mass along n.
    """
    w = np.zeros(6)
    for part in range(2):
        own = slice(3 * part, 3 * part + 3)
        speed = norm(v[own])
        if speed > most[part]:
            n = v[own] / speed
            slowing = -rate * (speed - most[part])
            w[own] = slowing / max(dot(n, turn(mobility[own, own], n)), _TINY) * n
    return w


def _lower_clips(before: float, margin: float, stretch: float) -> float:
    """Return by which part the clips are lowered next, where a pull has a margin at rest."""
    if margin < 1.0:
        return 1.0 - (1.0 - before) * margin * min(1.0, stretch)
    return 0.0 if stretch <= 1.0 else before


# --- what surrounds it ---------------------------------------------------------------------


class SpringDamperState(NamedTuple):
    """State of springs and dampers in a tick: its ``effects``."""

    f: Array  # of the springs, as mu and energy: see SpringWrench
    mu: Array
    energy: float
    dissipated: float  # [W] by the dampers, the brake, and by what is drawn less
    excess: float
    lowered: float  # the part by which the clips are lower than stated, from the next tick on


class ComplianceControl(EffortControl):
    """Compliance control of one arm, as :func:`compliance`, within its bounds.

    Attributes:
        elasticity: the springs as they are stated.
        springs: those that act, and the part of where their clips are stated; the same object
            while they stay the same; None where none do.
        fed: (3,) [N] that is added now, on the environment, axes of the tip.
    """

    blend_time = 0.005
    """Time constant [s] with which a stretched arm goes over to other springs: what is left of
    those of before is no spring, and would push an arm that is let go.  The efforts have their
    rates besides."""

    behind = "the springs pull no harder: something holds the tip, or friction its joints"
    parameters: "ComplianceParameters"
    _mode: tuple[float, float] | None = None

    def _take(self, parameters: Any) -> None:
        elasticity = parameters.elasticity()
        super()._take(parameters)
        self.elasticity = elasticity
        self._speeds = np.array(self._motion.speeds if self._motion else 2 * (math.inf,))

    def _effort_limits(self) -> JointLimits | None:
        # without those of the accelerations, which the contact makes
        return None if self.limits is None else self.limits.without_accelerations

    def _excess(self, dq: Array, ddq: Array, effects: SpringDamperState) -> float:
        return effects.excess

    def press(self, force: Array) -> None:
        """Add a force (3,) [N] on the environment, axes of the tip, until a restart or a hold."""
        self._wanted = force if force.any() else _NO_FORCE

    def exerted_force(self, force: Array, R_d: Array) -> Array:
        """Return a force (3,) [N], axes of the tip; ConfigurationError if no spring holds it."""
        self.elasticity.refuse_force(R_d @ force, R_d)
        return force

    def end_force(self) -> bool:
        """Take the force back at its rate; return whether the arm has to be held: it need not."""
        self._wanted = _NO_FORCE
        return False

    @property
    def is_pressing(self) -> bool:
        """Whether a force is added, or is to be."""
        return not (self._wanted is self.fed is _NO_FORCE)

    def _forget_x(self) -> None:
        super()._forget_x()
        self._lowered = 0.0

    def _leave_the_law(self, q: Array) -> None:
        super()._leave_the_law(q)
        self._wanted = self.fed = _NO_FORCE
        self.springs: tuple[Elasticity, float] | None = None

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Return the efforts for this instant; a contact stretches the springs."""
        if self.is_pressing:
            more = self._wanted - self.fed
            force = self.fed + min(1.0, _FORCE_RATE * dt / max(norm(more), _TINY)) * more
            self.fed = force if force.any() else _NO_FORCE
        springs = self.elasticity, 1.0 - self._lowered
        if springs != self.springs:
            self.springs = springs
        return super().tick(dt, q, dq, desired)

    def _accelerate(
        self, dt: float, state: DynamicState, desired: DesiredFrame
    ) -> tuple[Array, Any, SpringDamperState]:
        arm, p = state.arm, self.parameters
        x_de = self.orientation.displacement(desired.R_d, arm.R_e, self._x_de)
        ratios = p.damping_ratio_p, p.damping_ratio_o
        tip = compliance(state, desired, self.elasticity, 1.0 - self._lowered, *ratios)
        self._mode = tip.mode
        self.loop_rate = tip.mode[0]
        f, mu, energy, stretch, _ = tip.springs
        w, fed, excess = tip.w, None, 1.0
        lost = -float(tip.damping @ (tip.v - tip.v_d))
        if self.fed is not _NO_FORCE:
            fed = np.concatenate((turn(arm.R_e, self.fed), _NO_FORCE))
        if self.limits is None:
            w = w if fed is None else w + fed
        else:
            self._refuse_load(tip)
            rotors = _LEAST_ROTOR * np.eye(len(arm.q))
            mobility = arm.J @ solved(state.B + rotors, arm.J.T)
            if float(w @ tip.v_d) > 0.0:  # time waits only while the motion stretches the springs
                excess = max(1.0, stretch)
            resting, moving = self._margins(dt, arm.J, tip, mobility, w)
            self._lowered = _lower_clips(self._lowered, resting, stretch)
            if fed is not None:
                w = w + self._margins(dt, arm.J, tip, mobility, fed / _FEEDFORWARD_SHARE)[0] * fed
            if float(w @ tip.v) > 0.0:  # no more
                lost += (1.0 - moving) * float(w @ (tip.v - tip.v_d))
                w = moving * w
            rate = min(_BRAKE_RATE, _TICKS_SHARE / dt) if dt > 0.0 else 0.0
            braking = brake(tip.v, self._speeds, rate, tip.mobility)
            lost -= float(braking @ tip.v)
            w = w + braking
        a_d = np.concatenate(desired[4:])
        ddq_0 = self.null_acceleration(arm.q, arm.dq)
        ddq_d = joint_acceleration(state, a_d, self.inverse, ddq_0)  # (33)
        ddq = ddq_d + tip.M @ (w + tip.damping)
        return ddq, x_de, SpringDamperState(f, mu, energy, lost, excess, self._lowered)

    def _refuse_load(self, tip: TipWrench) -> None:
        """Raise LoadError while the tip moves against springs that are far beyond their clip."""
        # as they are stated, wherever the clip is lowered to
        stretch, most = (1.0 - self._lowered) * tip.springs.stretch, self.parameters.max_stretch
        if stretch > most and float(tip.w @ tip.v) < 0.0:
            raise LoadError(
                f"the springs are stretched {stretch:.2f} times as far as they pull harder, and "
                f"give way; at most max_stretch {most:g}: an arm that nobody pushes bears a load "
                "that was not declared"
            )

    def _margins(
        self, dt: float, J: Array, tip: TipWrench, mobility: Array, w: Array
    ) -> tuple[float, float]:
        """Return the parts of a wrench w (6,) that may drive a tip at rest, and this one.

        ``mobility`` (6, 6) is that of an arm with rotors.
        """
        a = mobility @ w
        b = mobility @ (tip.springs.F @ (tip.E @ a))
        return release_margins(tip.v, a, b, self._speeds, J.T @ w, self._rate, dt)

    @property
    def fastest_gain(self) -> LoopGain | None:
        """The stiffness of the fastest mode in the last tick; None before the first one."""
        if self._mode is None:
            return None
        rate, turning = self._mode
        name, K = ("K_o", self.elasticity.K_o) if turning > 0.5 else ("K_p", self.elasticity.K_p)
        return LoopGain(name, float(np.linalg.eigvalsh(K)[-1]), rate, order=2)

    def stiffness(self, tick: Tick) -> tuple[Array, Array]:
        """Return K_p at the tip."""
        return self.elasticity.stiffness(tick.desired.R_d), tick.state.p_e

    def lyapunov(self, tick: Tick) -> Lyapunov:
        """Return V = u' Lambda u / 2 + U [J] with u = v - v_d, and what the dampers take [W]."""
        arm, desired, effects = tick.state, tick.desired, tick.effects
        u = np.concatenate((arm.dp_e - desired.dp_d, arm.omega_e - desired.omega_d))
        B = self.robot.dynamic_state(arm.q, arm.dq).B
        kinetic = u @ np.linalg.pinv(arm.J @ np.linalg.solve(B, arm.J.T)) @ u / 2
        return Lyapunov(float(kinetic) + effects.energy, -effects.dissipated)
