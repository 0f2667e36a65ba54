"""Impedance control against a spring wall, section V, Fig. 3.

The desired frame of a UR5 lies behind a wall, and is turned.  The compliant frame of (52), (59)
gives way to the wall; the motion loop (48), (49), (51) follows it, on an arm with friction that the
law does not know.  At rest two springs in series, K_p and the wall, share the depth; meanwhile the
tool turns to the desired orientation, and the energy V_3 of (68) falls all the way, as (69) says.

    python3 examples/impedance_against_a_spring.py [FIGURE.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from eulerparams_control.laws.compliant_frame import ComplianceLaw, CompliantFrame
from eulerparams_control.laws.dynamic_control import resolved_acceleration
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.inverse_dynamics import joint_acceleration, joint_efforts
from eulerparams_control.laws.orientation import representation
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

DT = 0.001  # [s] step
DURATION = 2.0  # [s]

# The impedance: (52) along the axes of the base, (59) about those of the desired frame.
M_P = 10.0 * np.eye(3)  # [kg]
D_P = 250.0 * np.eye(3)  # [Ns/m]
K_P = np.diag((1000.0, 2000.0, 4000.0))  # [N/m]
M_O = 1.0 * np.eye(3)  # [kg m^2]
D_O = 15.0 * np.eye(3)  # [Nms/rad]
K_O = np.diag((50.0, 30.0, 20.0))  # [Nm/rad]
GAINS = (3600.0, 120.0, 7200.0, 120.0)  # k_Pp [1/s^2], k_Vp [1/s], k_Po, k_Vo of (49), (51)

# The world: a wall without friction, oblique to the axes of K_p, and the friction of each joint.
WALL_STIFFNESS = 5000.0  # [N/m]
WALL_NORMAL = np.array((-0.8, 0.0, 0.6))  # towards its free side, base frame
WALL_DISTANCE = 0.01  # [m] from the tip at the start
VISCOUS, COULOMB = 1.0, 0.5  # [Nms/rad], [Nm]

# The desired frame, at rest.
DEPTH = 0.04  # [m] behind the wall
TURN = (0.0, 0.0, 60.0)  # [deg] rotation vector from the orientation at the start, base frame

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "0.4"
SIZE = (7.0, 6.0)  # [in] of the figure
plt.rcParams["font.size"] = 9.0  # [pt]


def press(robot: Robot, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return force f [N], displacement p_e - p_d [m], V_3 [J] and dV_3 [W], a row a step.

    The arm starts at rest at q (n,).
    """
    orientation = representation("euler_parameters")
    translation, rotation = Impedance(M_P, D_P, K_P), Impedance(M_O, D_O, K_O)
    compliant = CompliantFrame(ComplianceLaw(orientation, translation, rotation))
    friction = JointFriction(np.full(robot.n, VISCOUS), np.full(robot.n, COULOMB))
    inverse, n, x_ce = DampedInverse(), WALL_NORMAL, None
    dq = ddq_0 = np.zeros(robot.n)  # six joints have no null space

    start = robot.state(q, dq)
    p_wall = start.p_e - WALL_DISTANCE * n
    desired = DesiredFrame(p_wall - DEPTH * n, exp(np.radians(TURN)) @ start.R_e)
    compliant.begin(desired, DesiredFrame(start.p_e, start.R_e))
    rows = []
    for _ in range(round(DURATION / DT)):
        state = robot.dynamic_state(q, dq)  # the terms of (32)
        arm = state.arm
        f = WALL_STIFFNESS * max(0.0, n @ (p_wall - arm.p_e))  # the wall only pushes
        w = np.concatenate((f * n, np.zeros(3)))  # on the tool, at the tip: h is -w

        frame = compliant.step(DT, desired, w)  # (52), (59)
        a, x_ce = resolved_acceleration(arm, frame, orientation, x_ce, GAINS)  # (49), (51)
        ddq = joint_acceleration(state, a, inverse, ddq_0)  # (33)
        tau = joint_efforts(state, ddq, h=-w)  # (48)

        R_cd, omega_cd_d = desired.R_d.T @ frame.R_d, desired.R_d.T @ frame.omega_d
        energy = orientation.lyapunov_3(R_cd, omega_cd_d, rotation, mu_d=np.zeros(3))  # (68), (69)
        rows.append((f, arm.p_e - desired.p_d, *energy))

        d = friction.effort(dq)
        net = tau + arm.J.T @ w - state.C_dq - d - state.g
        dq = dq + DT * np.linalg.solve(state.B, net)  # (32)
        q = q + DT * dq
    return tuple(map(np.array, zip(*rows, strict=True)))


def balance() -> tuple[float, np.ndarray]:
    """Return the force [N] and the displacement p_cd (3,) [m] at rest: K_p p_cd = f n, (52)."""
    compliance = np.linalg.solve(K_P, WALL_NORMAL)  # p_cd for 1 N
    f = DEPTH / (1.0 / WALL_STIFFNESS + WALL_NORMAL @ compliance)
    return f, f * compliance


def draw(f: np.ndarray, p_ed: np.ndarray, V_3: np.ndarray, dV_3: np.ndarray, path: str) -> None:
    """Draw force, displacement and energy over time; dashed is what the paper predicts."""
    t, predicted = DT * np.arange(len(f)), {"color": GREY, "linestyle": "--", "linewidth": 1.2}
    f_rest, p_rest = balance()
    figure, (force, way, energy) = plt.subplots(3, sharex=True, figsize=SIZE, layout="constrained")
    figure.suptitle("The arm yields to the wall as (52) says", weight="bold")
    force.axhline(f_rest, **predicted)
    force.plot(t, f, color=BLUE, linewidth=1.8)
    force.text(DURATION, f_rest - 3.0, "at rest, (52)", ha="right", va="top", color=GREY)
    force.set(ylabel="force [N]", ylim=(0.0, None))
    for i, colour in ((0, BLUE), (2, ORANGE)):
        way.axhline(1e3 * p_rest[i], **predicted)
        way.plot(t, 1e3 * p_ed[:, i], color=colour, linewidth=1.8)
        label = f"{'xyz'[i]}, {K_P[i, i]:g} N/m"
        way.text(DURATION, 1e3 * p_rest[i] + 2.0, label, ha="right", color=colour)
    way.set(ylabel="$p_e - p_d$ [mm]")
    energy.plot(t, V_3, color=BLUE, linewidth=5.0, alpha=0.4)
    energy.plot(t, V_3[0] + DT * np.cumsum(dV_3), **predicted)
    note = "energy of the rotation, (68);\ndashed: (69), integrated"
    energy.text(0.4 * DURATION, 0.5 * V_3[0], note, color=GREY)
    energy.set(ylabel="$V_3$ [J]", xlabel="time [s]", ylim=(0.0, None))
    for axes in (force, way, energy):
        axes.set_xlim(0.0, DURATION)
        axes.spines[["top", "right"]].set_visible(False)
    figure.align_ylabels()
    figure.savefig(path, dpi=200)


def main(path: str = "impedance_against_a_spring.png") -> None:
    """Press on the wall, print how that compares with (52) and (69), and draw it."""
    ur5 = load_robot("ur5")
    robot = Robot(ur5.urdf, ur5.base_frame, ur5.tip_frame, ur5.joints)
    f, p_ed, V_3, dV_3 = press(robot, np.array(ur5.home))
    f_rest, p_rest = balance()
    off = 1e3 * np.linalg.norm(p_ed[-1] - p_rest)
    rises = np.count_nonzero(np.diff(V_3) > 0.0)
    print(f"force {f[-1]:.2f} N, by (52) {f_rest:.2f} N; tip {off:.2f} mm from where (52) says")
    print(f"V_3 {V_3[0]:.2f} J, at last {V_3[-1]:.3f} J; it rises in {rises} of {len(V_3)} steps")
    draw(f, p_ed, V_3, dV_3, path)
    print(path)


if __name__ == "__main__":
    main(*sys.argv[1:])
