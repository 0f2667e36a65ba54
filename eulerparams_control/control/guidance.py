"""The law on its motion: what a reference becomes, at the rate of time that the arm can follow."""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from eulerparams_control.control.mode import Mode, ModeState
from eulerparams_control.control.pace import CREEP, LOOK, Pace
from eulerparams_control.errors import FollowingError, SingularityError
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme, Tick
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.shaper import Shaper
from eulerparams_control.motion.time_scale import TimeScale

# In a step that is longer than this [s] a jerk is not small.
_LONG = 0.005

# Limits that are lowered slow the tip by this part of its acceleration, since a motion may have its
# own across that, and the joints by the other.
_OF_THE_TIP, _OF_THE_JOINTS = 0.3, 0.9

_TINY = 1e-300


@dataclass(frozen=True)
class ControllerOptions:
    """Options of a controller on time and references.

    Attributes:
        state_timeout: [s] gap in the stamps of the state after which it starts again.
        reference_timeout: [s] for which a single streamed frame holds its twist.
        max_jump_position: [m] by which a reference may be away from the desired frame.
        max_jump_rotation: [rad] the same for the rotation.
        require_reference: whether to be silent until the first reference.
        check_states: whether states that the robot cannot have reached are refused.
        slow_below: smallest singular value of J below which the motion slows down; 0 never.
        max_latency: [s] by which a state may come later than the best one did.
        target_timeout: [s] for which a twist goes on without a successor.
        speed_override: rate of time of what is followed; 0 halts on the path.
        motion: limits of the tip; None shapes nothing.
    """

    state_timeout: float = 0.1
    reference_timeout: float = 0.1
    max_jump_position: float = 0.05
    max_jump_rotation: float = 0.2
    require_reference: bool = False
    check_states: bool = False
    slow_below: float = 0.05
    max_latency: float = 0.05
    target_timeout: float = 0.1
    speed_override: float = 1.0
    motion: MotionLimits | None = None

    @property
    def max_jump(self) -> tuple[float, float]:
        """By how much a reference may be away [m], [rad]."""
        return self.max_jump_position, self.max_jump_rotation

    @classmethod
    def of(cls, parameters: Any) -> "ControllerOptions":
        """Return the options that the parameters of a node say; with limits states are checked."""
        names = {field.name for field in fields(cls)} - {"check_states", "motion"}
        values = {name: getattr(parameters, name) for name in names}
        return cls(
            **values, check_states=parameters.enforce_limits, motion=parameters.motion_limits()
        )


class LawError(Exception):
    """The law has no answer, or the arm does not follow it.

    Attributes:
        error: what the law raised.
    """

    def __init__(self, error: SingularityError | FollowingError) -> None:
        super().__init__(str(error))
        self.error = error


class Guidance:
    """The law on its motion.

    Attributes:
        scheme: the control scheme.
        motion: what it follows, or the frame that it holds.
        scale: the rate of time of the motion.
        pace: how fast the arm can follow it.
        is_braking: whether it brakes along its path, to hold what it comes to.
        tick_now: the last tick of the scheme; None before the first.
        of_law: the same; None until the law in force has made one.
        ticked: stamp of the last tick [ns].
        saturated: how many ticks a limit has changed.
        dt: [s] of the last tick.
    """

    def __init__(
        self, scheme: Scheme, joints: JointLimits | None, options: ControllerOptions
    ) -> None:
        self.scheme = scheme
        self.pace = Pace(joints, options.slow_below, scheme.robot.length, options.motion)
        self.scale = TimeScale(options.motion)
        self.tick_now: Tick | None = None
        self.of_law: Tick | None = None
        self.ticked: int | None = None
        self.saturated, self.dt = 0, 0.0
        self.is_braking, self._jump = False, 0  # [ns] that the stamps are ahead of the motion
        self._options = options
        self._ticks: tuple[Tick | None, Tick | None] = None, None  # the last one, the one before

    def begin(self, q: Array, *, acts: bool) -> None:
        """Hold the pose at the measured q (n,), with zero error.

        Args:
            q: (n,) measured.
            acts: whether the command before still acts, so that none may jump.
        """
        (self.scheme.resume if acts else self.scheme.reset)(q)
        self.pace.forget()
        self.motion = Shaper(
            self.scheme.start_frame(), self._options.motion, self._options.max_jump
        )
        self._rest()
        self.forget()

    def change(self, joints: JointLimits | None, options: ControllerOptions) -> None:
        """Take over other limits, between two ticks."""
        self.pace.limits, self.pace.motion, self._options = joints, options.motion, options
        self.scale.limits = options.motion
        self.motion.change(options.motion, options.max_jump)
        self.of_law = None
        self.forget()

    def forget(self) -> None:
        """Forget the ticks: they are of another law, or of another motion."""
        self._ticks = None, None

    def _rest(self) -> None:
        self.is_braking, self._jump = False, 0
        self.scale.forget(self._options.speed_override)

    def halt(self) -> None:
        """Hold the frame of now: the law is not asked any more."""
        self.motion.hold(self.scheme.start_frame())
        self._rest()
        self._ticks = None, self._ticks[1]

    def brake(self, jump: int = 0) -> None:
        """Come to rest along the path, from the next tick on; then hold.

        Args:
            jump: [ns] of the stamps, which the motion does not follow.
        """
        if jump:
            self._jump += jump
            self.scheme.skip()
        self.motion.forget_waiting()
        self.is_braking = not self.motion.is_at_rest
        if not self.is_braking:
            self.halt()

    def release(self, t: int) -> None:
        """Let another motion follow, t [ns], before the arm has come to rest on its path."""
        self.motion.stop(t)
        self.is_braking, self._jump = False, 0

    def wait(self, seconds: float) -> None:
        """Let the motion be later by a time [s] in which the arm has not gone on, or earlier."""
        self.motion.wait(round(seconds * 1e9))
        self.scheme.skip()
        self.forget()

    def most_fall(self, dt: float, joints: JointLimits) -> Array:
        """Return by how much (n,) limits of the speeds may be lowered within dt [s].

        Where the motion is at them it is slowed by as much, and so are tip and joints.
        """
        rate, motion = math.inf, self._options.motion
        if self.tick_now is not None and motion is not None:
            arm = self.tick_now.state
            for v, a in zip((arm.dp_e, arm.omega_e), motion.accelerations, strict=True):
                rate = min(rate, a / max(math.sqrt(v @ v), _TINY))
        fall: Array = np.minimum(
            _OF_THE_TIP * rate * joints.velocity, _OF_THE_JOINTS * joints.acceleration
        )
        return dt * fall if dt > 0 else np.zeros_like(fall)

    def command(
        self, state: ModeState, t: int, dt: float, q: Array, dq: Array
    ) -> JointCommand | None:
        """Return what a mode commands; None: nothing.

        The law on its motion; in a stop it brakes along its path, if it may, and then the joints
        are held.  See :meth:`tick`.
        """
        if state.is_led:
            return self.tick(t, dt, q, dq)
        if state.mode is not Mode.STOPPED or state.is_released:
            return None
        if self.is_braking:
            return self.tick(t, dt, q, dq)
        return self.scheme.hold(dt, q, dq)

    def tick(self, t: int, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return the command for the state q, dq (n,) stamped t [ns], dt [s] after the last.

        Raises:
            LawError: if the law has no finite answer, or the arm does not follow.
        """
        scheme, motion, scale, pace = self.scheme, self.motion, self.scale, self.pace
        is_shaped, is_frozen = self._options.motion is not None, scheme.is_frozen
        if scale.rate:
            scale.advance(dt)
        else:
            scale.mean = scale.now
        if is_frozen and is_shaped:  # it comes to rest as the compliant frame does
            scale.forget(scale.now * math.exp(-dt / scheme.stop_time))
        u = 0.0 if is_frozen and not is_shaped else scale.mean
        if u < 1:
            motion.wait(round((1 - u) * dt * 1e9))
        desired = motion.sample(t - self._jump)
        if motion.restarts and is_shaped and not (is_frozen or self.is_braking):
            scale.forget(self._options.speed_override)
        if not is_frozen or is_shaped:
            # what is frozen has to start again from rest
            wanted = min(pace.wanted, self._options.speed_override, motion.bearable)
            wanted = 0.0 if self.is_braking else scale.now if is_frozen else wanted
            if wanted == scale.now == 1.0 and not scale.rate:
                scale.before = desired  # as it was planned
            else:
                desired = scale.paced(dt, wanted, desired, motion.after)
            if dt > _LONG and not motion.is_holding:
                desired = self._led(desired, dt / 2)
        return self._command(t, dt, q, dq, desired)

    @property
    def stop_time(self) -> float:
        """The time [s] in which the motion can come to rest from its present speed."""
        limits, now = self._options.motion, self.motion.last
        return 0.0 if limits is None else limits.stop_time(now.dp_d, now.omega_d)

    def _command(
        self, t: int, dt: float, q: Array, dq: Array, desired: DesiredFrame
    ) -> JointCommand:
        """Return the command of the law for a desired frame."""
        scheme, motion, scale, pace = self.scheme, self.motion, self.scale, self.pace
        is_frozen = scheme.is_frozen
        try:
            tick = scheme.tick(dt, q, dq, desired)
        except (SingularityError, FollowingError) as error:
            raise LawError(error) from error
        pace.since += dt
        if pace.since >= LOOK:
            pace.update(scale.now, tick.state.q, tick.state.dq, tick.state.J)
        if self.is_braking:
            if scale.now == 0 or motion.is_at_rest:
                motion.hold(motion.last)
                self._rest()
        elif tick.excess > 1 and self._options.motion is not None and not is_frozen:
            # the arm is behind already: time waits for it at once
            scale.forget(max(scale.now / tick.excess, min(CREEP, scale.now)))
        self._ticks, self.dt = (tick, self._ticks[0]), dt
        self.tick_now = self.of_law = tick
        self.ticked = t
        self.saturated += tick.saturated
        return tick.command

    def _led(self, desired: DesiredFrame, dt: float) -> DesiredFrame:
        """Return the frame with its mean acceleration over the next dt [s]."""
        u, du = self.scale.now, self.scale.rate
        later = self.motion.after((u + du * dt / 2) * dt).at_pace(u + du * dt, du)
        return desired._replace(
            ddp_d=(later.dp_d - desired.dp_d) / dt,
            domega_d=(later.omega_d - desired.omega_d) / dt,
        )

    def lyapunov(self) -> tuple[float, float, float] | None:
        """Return V, its derivative by the paper, and as measured over the last tick.

        None if the representation has no Lyapunov function, or there are no two ticks yet.
        """
        now, before = self.tick_now, self._ticks[1]
        if now is None or before is None or self.dt == 0:
            return None
        if type(now.x_de) is not type(before.x_de):  # the representation was replaced
            return None
        V_now, V_before = self.scheme.lyapunov(now), self.scheme.lyapunov(before)
        if V_now is None or V_before is None:
            return None
        return V_now.V, V_now.dV, (V_now.V - V_before.V) / self.dt
