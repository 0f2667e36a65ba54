"""Closed-loop inverse kinematics through the pole of the Euler angles, section III.

The tool of a UR5 turns past the orientation where its z axis is along x of the base: there T(phi)
of (3) is singular for the angles XYZ, though the arm itself is far from any singularity.  The tool
starts off the desired orientation, and both laws undo this error at the same rate.  At the pole
(23), with Euler angles, asks for joint speeds that no arm has, and turns the tool away again;
(28), with Euler parameters, notices nothing.

    python3 examples/clik_through_the_pole.py [FIGURE.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from eulerparams_control.laws.clik import clik
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.orientation import EulerSequence, representation
from eulerparams_control.laws.rotations import angle_between, exp
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.motion.way_points import parse_way_points
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

DT = 0.001  # [s] step
DURATION = 2.0  # [s] from rest to rest
POLE_DISTANCE = 0.1  # [deg] between tool z and x of the base where they are closest
START_ERROR = (0.0, -30.0, 0.0)  # [deg] rotation vector from the desired orientation, base frame
K_PP = 1.0  # [1/s] gain of the position error
K_PO = {  # [1/s] gain of the orientation error; eps is about theta / 2, so it needs twice as much
    "euler_angles": 1.0,
    "euler_parameters": 2.0,
}

LABELS = {"euler_angles": "Euler angles (23)", "euler_parameters": "Euler parameters (28)"}
COLOURS = {"euler_angles": "#d55e00", "euler_parameters": "#0072b2"}
GREY = "0.4"
SIZE = (7.0, 5.0)  # [in] of the figure
plt.rcParams["font.size"] = 9.0  # [pt]


def desired_motion() -> Trajectory:
    """Return a motion that tilts tool z, 50 to 131 deg from z of the base, and lifts the tool.

    In ZYZ angles, which are regular there; they are (0, 90, 90) deg at the pole of XYZ.
    """
    return parse_way_points(
        times=(0.0, DURATION),
        positions=(0.485, 0.02, 0.375, 0.485, 0.12, 0.475),  # [m]
        orientations=np.radians((POLE_DISTANCE, 50.0, 90.0, POLE_DISTANCE, 131.0, 90.0)),
        orientation_format="ZYZ",
    )


def follow(motion: Trajectory, robot: Robot, q: np.ndarray, name: str) -> np.ndarray:
    """Return the fastest joint's speed [rad/s] and the orientation error [rad], a row a step."""
    orientation, k_Po, inverse = representation(name), K_PO[name], DampedInverse()
    dq = dq_0 = np.zeros(robot.n)  # six joints have no null space
    x_de = None
    rows = []
    for t in np.arange(0.0, DURATION, DT):
        desired = motion.sample(t)
        arm = robot.state(q, dq)  # (18)-(20)
        dq, x_de = clik(arm, desired, orientation, x_de, K_PP, k_Po, inverse, dq_0)  # (23), (28)
        rows.append((np.abs(dq).max(), angle_between(desired.R_d, arm.R_e)))
        q = q + DT * dq
    return np.array(rows)


def draw(runs: dict[str, np.ndarray], pole: float, limit: float, path: str) -> None:
    """Draw joint speeds and orientation errors over time; ``pole`` [s] is when it is passed."""
    figure, (speed, error) = plt.subplots(2, 1, sharex=True, figsize=SIZE, layout="constrained")
    figure.suptitle("Euler angles fail at their pole", weight="bold")
    for name, rows in runs.items():
        t, width = DT * np.arange(len(rows)), 3.0 if name == "euler_angles" else 1.8
        speed.plot(t, rows[:, 0], color=COLOURS[name], linewidth=width)
        error.plot(t, np.degrees(rows[:, 1]), color=COLOURS[name], linewidth=width)
    speed.axhline(limit, color=GREY, linestyle="--", linewidth=1.0)
    speed.text(DURATION, 1.1 * limit, "limit of the UR5", ha="right", va="bottom", color=GREY)
    speed.text(pole + 0.03, 900.0, f"pole of XYZ,\nat {POLE_DISTANCE:g} deg", va="top", color=GREY)
    speed.set(ylabel="fastest joint [rad/s]", yscale="log", ylim=(0.1, 1000.0))
    speed.yaxis.set_major_formatter("{x:g}")
    for name, place in (("euler_angles", 18.0), ("euler_parameters", 1.5)):
        error.text(DURATION, place, LABELS[name], ha="right", color=COLOURS[name])
    error.set(ylabel="orientation error [deg]", xlabel="time [s]", ylim=(0.0, None))
    for axes in (speed, error):
        axes.axvline(pole, color=GREY, linewidth=1.0, zorder=0.0)
        axes.set_xlim(0.0, DURATION)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=200)


def main(path: str = "clik_through_the_pole.png") -> None:
    """Follow the motion with both laws, print what they did, and draw it."""
    ur5 = load_robot("ur5")
    robot = Robot(ur5.urdf, ur5.base_frame, ur5.tip_frame, ur5.joints)
    motion = desired_motion()
    start = motion.sample(0.0)
    start = start._replace(R_d=exp(np.radians(START_ERROR)) @ start.R_d)
    q = inverse_kinematics(robot, start, np.array(ur5.home))
    runs = {name: follow(motion, robot, q, name) for name in K_PO}
    sequence, times = EulerSequence("XYZ"), np.arange(0.0, DURATION, DT)
    at_pole = int(np.argmin([sequence.pole_distance(motion.sample(t).R_d) for t in times]))
    for name, rows in runs.items():
        speed, error = rows[:, 0].max(), np.degrees(rows[at_pole:, 1].max())
        print(
            f"{LABELS[name]}: up to {speed:.1f} rad/s; from the pole on up to {error:.1f} deg off"
        )
    draw(runs, times[at_pole], robot.limits.velocity.min(), path)
    print(path)


if __name__ == "__main__":
    main(*sys.argv[1:])
