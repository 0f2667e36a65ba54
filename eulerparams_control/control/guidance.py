"""The motion of an arm: which references it may follow, and what they become.

A reference that leaps, or leads out of reach, is refused.  Of the others the desired frame goes at
the rate of time that the arm can follow.
"""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from eulerparams_control.control.pace import CREEP, Pace
from eulerparams_control.errors import InvalidMessageError, SingularityError
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Scheme, Tick
from eulerparams_control.motion.frames import DesiredFrame, distance
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.references import Goal, Jog, SetPoint
from eulerparams_control.motion.shaper import Reference, Shaper
from eulerparams_control.motion.time_scale import TimeScale
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Robot

# In a step that is longer than this [s] a jerk is not small.
_LONG = 0.005

# Limits that are lowered slow the tip by this part of its acceleration, since a motion may have its
# own across that, and the joints by the other.
_OF_THE_TIP, _OF_THE_JOINTS = 0.3, 0.9

# A rate of time below this is none.
_CREEPING = 0.1

# How far ahead [s] a reference may start: further, the two clocks are not the same.
_MAX_AHEAD = 3600.0

# A stretched arm is measured, and sent, this much [m] beyond its reach.
_ROOM = 0.01

_TINY = 1e-300


@dataclass(frozen=True)
class ControllerOptions:
    """Options of a controller on time and references."""

    state_timeout: float = 0.1  # [s] gap in the stamps, or silence, after which it starts again
    reference_timeout: float = 0.1  # [s] for which a single streamed frame holds its twist
    max_jump_position: float = 0.05  # [m] by which a reference may be away from the desired frame
    max_jump_rotation: float = 0.2  # [rad]
    require_reference: bool = False  # whether to be silent until the first reference
    check_states: bool = False  # whether states that the robot cannot have reached are refused
    slow_below: float = 0.05  # singular value of J below which the motion slows down; 0 never
    max_latency: float = 0.05  # [s] by which a state may come later than the best one did
    target_timeout: float = 0.1  # [s] for which a twist goes on without a successor
    speed_override: float = 1.0  # rate of time of what is followed; 0 halts on the path
    motion: MotionLimits | None = None  # limits of the tip; None shapes nothing
    max_link_speed: float = math.inf  # [m/s] of the origin of each link

    @property
    def max_jump(self) -> tuple[float, float]:
        """By how much a reference may be away [m], [rad]."""
        return self.max_jump_position, self.max_jump_rotation

    def chase(self, robot: Robot) -> float:
        """Return the speed [rad/s] of one joint that moves no point of an arm too fast."""
        return math.inf if self.motion is None else self.motion.linear_speed / robot.reach.radius

    @classmethod
    def of(cls, parameters: Any) -> "ControllerOptions":
        """Return the options that the parameters of a node say; with limits states are checked."""
        made = {"check_states", "motion", "max_link_speed"}
        names = {field.name for field in fields(cls)} - made
        motion, most = parameters.motion_limits(), math.inf
        if motion is not None:
            most = parameters.max_link_speed or motion.linear_speed
        return cls(
            **{name: getattr(parameters, name) for name in names},
            check_states=parameters.enforce_limits,
            motion=motion,
            max_link_speed=most,
        )


class Guidance:
    """Refuses references that must not be followed, and makes the desired frame of each state.

    Attributes:
        motion: what is followed, or the frame that is held.
        scale: the rate of time of the motion.
        pace: how fast the arm can follow it.
        is_braking: whether it brakes along its path, to hold what it comes to.
        tick_now: the last tick of the scheme; None before the first.
        ticked: stamp of that [ns].
        saturated: how many ticks a limit has changed.
        waited: for how long [s] the time of a motion has stood or crept, for the arm is behind.
    """

    def __init__(
        self, scheme: Scheme, joints: JointLimits | None, options: ControllerOptions
    ) -> None:
        self._scheme, self._options = scheme, options
        robot, most = scheme.robot, options.max_link_speed
        threshold, motion = options.slow_below, options.motion
        self.pace = Pace(joints, threshold, robot.length, motion, most, robot.link_speed)
        self.scale = TimeScale(options.motion)
        self.tick_now: Tick | None = None
        self.ticked: int | None = None
        self.saturated, self.waited, self._dt = 0, 0.0, 0.0
        # of the motion and the law of now: the last tick, and the one before
        self._ticks: tuple[Tick | None, Tick | None] = None, None

    def begin(self, q: Array, *, acts: bool) -> None:
        """Hold the pose at the measured q (n,), with zero error.

        ``acts``: whether the command before still acts, so that none may jump.
        """
        (self._scheme.resume if acts else self._scheme.reset)(q)
        self.pace.forget()
        options = self._options
        self.motion = Shaper(self._scheme.start_frame(), options.motion, options.max_jump)
        self._rest()
        self._ticks = None, None

    def change(self, joints: JointLimits | None, options: ControllerOptions) -> None:
        """Take over other limits, between two ticks, and perhaps another law."""
        self.pace.limits, self.pace.motion, self._options = joints, options.motion, options
        self.pace.max_link_speed = options.max_link_speed
        self.scale.limits = options.motion
        self.motion.change(options.motion, options.max_jump)
        self._ticks = None, None

    def _rest(self) -> None:
        self.is_braking, self._jump = False, 0  # [ns] that the stamps are ahead of the motion
        self.scale.forget(self._options.speed_override)

    def halt(self) -> None:
        """Hold the frame of now: the law is not asked any more."""
        self.motion.hold(self._scheme.start_frame())
        self._rest()
        self._ticks = None, None

    def brake(self, jump: int = 0) -> None:
        """Come to rest along the path, from the next tick on; then hold.

        ``jump``: [ns] of the stamps, which the motion does not follow.
        """
        if jump:
            self._jump += jump
            self._scheme.skip()
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
        self._scheme.skip()
        self._ticks = None, None

    # --- references that must not be followed -----------------------------------------------

    def is_far(self, here: DesiredFrame, there: DesiredFrame) -> bool:
        """Return whether a frame is farther from another than a reference may jump."""
        (way, angle), (most_way, most_angle) = distance(here, there), self._options.max_jump
        return not (way <= most_way and angle <= most_angle)

    def refuse(self, motion: Reference, late: float, here: DesiredFrame) -> None:
        """Raise InvalidMessageError for a reference that leaps, leads out of reach, is not finite.

        It has been going on for ``late`` [s].  What is no farther out than the present desired
        frame ``here`` leads back.
        """
        if isinstance(motion, Jog):
            _refuse_not_finite(motion.twist)
            return
        if isinstance(motion, Goal):
            _refuse_not_finite(np.append(motion.frames[0].p_d, motion.frames[0].R_d))
        if late < -_MAX_AHEAD:
            raise InvalidMessageError(
                f"the reference starts {-late:.0f} s after joint_states; are their clocks the same?"
            )
        reach = self._scheme.robot.reach
        most = max(reach.radius, reach.distance(here.p_d)) + _ROOM
        for frame in motion.to_come(late) if isinstance(motion, Trajectory) else motion.frames:
            if not (way := reach.distance(frame.p_d)) <= most:
                raise InvalidMessageError(
                    f"the position {frame.p_d.round(3).tolist()} is out of reach: it is {way:.3f} "
                    "m from the first joint of the arm, whose links are "
                    f"{reach.radius:.3f} m long; expected metres, in the base frame"
                )
        if not isinstance(motion, Goal):
            self._refuse_leap(motion, max(0.0, late), here)

    def _refuse_leap(self, motion: Trajectory | SetPoint, late: float, here: DesiredFrame) -> None:
        """Refuse a motion that begins too far away, and a set-point whose twist leads there."""
        max_jump = self._options.max_jump
        try:
            if isinstance(motion, Trajectory):
                there = motion.beginning(here, late)
            else:
                there = motion.sample(math.inf)  # where its twist ends
        except SingularityError as error:
            raise InvalidMessageError(f"the reference is no motion: {error}") from error
        if isinstance(motion, SetPoint):
            frame, T = motion.frames[0], motion.lasting
            leads = [
                float(np.linalg.norm(v)) * T + float(np.linalg.norm(a)) * T**2 / 2
                for v, a in ((frame.dp_d, frame.ddp_d), (frame.omega_d, frame.domega_d))
            ]
            if not (leads[0] <= max_jump[0] and leads[1] <= max_jump[1]):
                raise InvalidMessageError(
                    f"the twist of the set-point leads {leads[0]:.3g} m and {leads[1]:.3g} rad "
                    f"away within {T:g} s; at most {max_jump[0]:g} m and {max_jump[1]:g} rad "
                    "(max_jump_position, max_jump_rotation) are followed without the next one"
                )
        if self.is_far(here, there):
            way, angle = distance(here, there)
            raise InvalidMessageError(
                f"the reference begins {way:.3f} m and {math.degrees(angle):.1f} deg away from the "
                f"present desired frame; at most {max_jump[0]} m and "
                f"{math.degrees(max_jump[1]):.1f} deg are followed at once: give its first point a "
                "time_from_start > 0, or raise max_jump_position and max_jump_rotation"
            )

    # --- the desired frame of each state ------------------------------------------------------

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

    @property
    def stop_time(self) -> float:
        """The time [s] in which the motion can come to rest from its present speed."""
        limits, now = self._options.motion, self.motion.last
        return 0.0 if limits is None else limits.stop_time(now.dp_d, now.omega_d)

    def desired(self, t: int, dt: float) -> DesiredFrame:
        """Return the desired frame for the state stamped t [ns], dt [s] after the last."""
        motion, scale, scheme = self.motion, self.scale, self._scheme
        is_shaped, is_frozen = self._options.motion is not None, scheme.is_frozen
        scale.advance(dt)
        if is_frozen and is_shaped:  # it comes to rest as the compliant frame does
            scale.forget(scale.now * math.exp(-dt / scheme.stop_time))
        u = 0.0 if is_frozen and not is_shaped else scale.mean
        if u < 1:
            motion.wait(round((1 - u) * dt * 1e9))
        desired = motion.sample(t - self._jump)
        if is_frozen and not is_shaped:
            return desired
        if motion.restarts and is_shaped and not (is_frozen or self.is_braking):
            scale.forget(self._options.speed_override)
        if self.is_braking:
            wanted = 0.0
        elif is_frozen:  # what is frozen has to start again from rest
            wanted = scale.now
        else:
            wanted = min(self.pace.wanted, self._options.speed_override, motion.bearable)
        desired = scale.paced(dt, wanted, desired, motion.after)
        if dt > _LONG and not motion.is_holding:
            return self._with_mean_acceleration(desired, dt / 2)
        return desired

    def _with_mean_acceleration(self, desired: DesiredFrame, dt: float) -> DesiredFrame:
        """Return the frame with the mean of its acceleration over the next dt [s]."""
        u, du = self.scale.now, self.scale.rate
        later = self.motion.after((u + du * dt / 2) * dt).at_pace(u + du * dt, du)
        return desired._replace(
            ddp_d=(later.dp_d - desired.dp_d) / dt,
            domega_d=(later.omega_d - desired.omega_d) / dt,
        )

    def update(self, tick: Tick, t: int, dt: float) -> None:
        """Fit the rate of time to what the law made of the desired frame for the stamp t [ns]."""
        motion, scale = self.motion, self.scale
        self.pace.update(dt, scale.now, tick.state.q, tick.state.dq, tick.state.J)
        self._ticks, self._dt = (tick, self._ticks[0]), dt
        if self.is_braking:
            if scale.now == 0 or motion.is_at_rest:
                motion.hold(motion.last)
                self._rest()
        elif tick.excess > 1 and self._options.motion is not None and not self._scheme.is_frozen:
            # the arm is behind already: time waits for it at once
            scale.forget(max(scale.now / tick.excess, min(CREEP, scale.now)))
        may_go = min(self.pace.wanted, self._options.speed_override) > _CREEPING
        is_moved = not (self.motion.is_holding or self.is_braking or self._scheme.is_frozen)
        creeps = is_moved and may_go and scale.now < _CREEPING
        self.waited = self.waited + dt if creeps else 0.0
        self.tick_now, self.ticked = tick, t
        self.saturated += tick.saturated

    def lyapunov(self) -> tuple[float, float, float] | None:
        """Return V, its derivative by the paper, and as measured over the last tick.

        None if the representation has no Lyapunov function, or there are no two ticks yet.
        """
        now, before = self._ticks
        if now is None or before is None:
            return None
        V_now, V_before = self._scheme.lyapunov(now), self._scheme.lyapunov(before)
        if V_now is None or V_before is None:
            return None
        return V_now.V, V_now.dV, (V_now.V - V_before.V) / self._dt


def _refuse_not_finite(target: Array) -> None:
    if not np.isfinite(target).all():
        raise InvalidMessageError(f"the target is {target.tolist()}; expected finite values")
