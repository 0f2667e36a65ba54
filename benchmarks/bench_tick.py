"""One tick of each law, state to command, against the Pinocchio calls that it needs."""

import numpy as np
import pinocchio as pin
from timing import side_by_side

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.laws.clik import Clik, ClikLaw
from eulerparams_control.laws.compliant_frame import ComplianceLaw
from eulerparams_control.laws.dynamic_control import (
    DynamicControl,
    EffortLimits,
    InverseDynamics,
    ResolvedAcceleration,
)
from eulerparams_control.laws.impedance_control import ImpedanceControl, ImpedanceLaw
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.orientation import ORIENTATIONS, representation
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.desired_motion import SetPoint
from eulerparams_control.motion.trajectories import Circle
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot


def clik(robot: Robot, orientation: str) -> Clik:
    """Return CLIK with limits."""
    return Clik(robot, ClikLaw(representation(orientation)), limits=robot.limits)


def dynamic_control(robot: Robot, orientation: str) -> DynamicControl:
    """Return dynamic control with limits and friction."""
    law = ResolvedAcceleration(representation(orientation))
    dynamics = InverseDynamics(friction=robot.friction)
    return DynamicControl(robot, law, dynamics, EffortLimits(robot.limits, 2000.0, 0.1, 0.5))


def impedance_control(robot: Robot, orientation: str, sensor_frame: str) -> ImpedanceControl:
    """Return impedance control that feels a wrench."""
    translation = Impedance(10 * np.eye(3), 300 * np.eye(3), 1000 * np.eye(3))
    rotation = Impedance(np.eye(3), 20 * np.eye(3), 50 * np.eye(3))
    compliance = ComplianceLaw(representation(orientation), translation, rotation)
    scheme = ImpedanceControl(dynamic_control(robot, orientation), ImpedanceLaw(compliance))
    scheme.sense(SensedWrench(np.ones(6), robot.placement(sensor_frame)))
    return scheme


def tick_call(robot: Robot, q: np.ndarray, scheme, moving: bool = False):
    """Return a call that makes one tick of a scheme, at 1 kHz of stamps."""
    controller = Controller(scheme, ControllerOptions(), q)
    frame = controller.scheme.start_frame()
    circle = Circle(0.02, np.array([1.0, 0.0, 0.0]), 4.0, 50.0)
    if moving:
        controller.follow(circle.trajectory(frame.p_d, frame.R_d, 60), None)
    else:
        controller.follow(SetPoint(frame, 0.0), None)
    stamp, dq = 0, np.zeros(robot.n)

    def tick():
        nonlocal stamp
        stamp += 1_000_000
        return controller.step(stamp, q, dq)

    return tick


def bare_call(urdf: str, tip_frame: str, q: np.ndarray):
    """Return the bare calls: Jacobian with forward kinematics, and one solve."""
    model = pin.buildModelFromXML(urdf)
    data, tip = model.createData(), model.getFrameId(tip_frame)
    v = np.ones(6)

    def bare():
        J = pin.computeFrameJacobian(model, data, q, tip, pin.LOCAL_WORLD_ALIGNED)
        return np.linalg.solve(J, v), data.oMf[tip].rotation, data.oMf[tip].translation

    return bare


def bare_dynamics_call(urdf: str, tip_frame: str, q: np.ndarray):
    """Return the bare calls of inverse dynamics: J, dJ dq, B, C dq, g, and one solve."""
    model = pin.buildModelFromXML(urdf)
    data, tip = model.createData(), model.getFrameId(tip_frame)
    v, dq, axes = np.ones(6), np.zeros(model.nv), pin.LOCAL_WORLD_ALIGNED

    def bare():
        J = pin.computeFrameJacobian(model, data, q, tip, axes)
        B = pin.crba(model, data, q)
        g = pin.computeGeneralizedGravity(model, data, q)
        C_dq_g = pin.nonLinearEffects(model, data, q, dq)
        pin.forwardKinematics(model, data, q, dq, dq)
        dJ_dq = pin.getFrameClassicalAcceleration(model, data, tip, axes).vector
        return np.linalg.solve(J, v), B, g, C_dq_g, dJ_dq

    return bare


def pink_call(urdf: str, tip_frame: str, q: np.ndarray):
    """Return one solve_ik of pink for the same robot and target; None if it is not there."""
    try:
        import pink
        from pink.tasks import FrameTask
    except ImportError:
        return None
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    configuration = pink.Configuration(model, data, q)
    task = FrameTask(tip_frame, position_cost=1.0, orientation_cost=1.0)
    task.set_target_from_configuration(configuration)

    def solve():
        configuration.update(q)
        return pink.solve_ik(configuration, [task], 1e-3, solver="quadprog")

    return solve


def run() -> list[tuple[str, str, str]]:
    """Return rows: what, against what, ratio."""
    ur5 = load_robot("ur5")
    robot, q = Robot(ur5.urdf, ur5.base_frame, ur5.tip_frame), np.array(ur5.home)
    calls = {name: tick_call(robot, q, clik(robot, name)) for name in ORIENTATIONS}
    calls["moving"] = tick_call(robot, q, clik(robot, "euler_parameters"), moving=True)
    calls["bare"] = bare_call(ur5.urdf, ur5.tip_frame, q)
    for name in ORIENTATIONS:
        calls[f"dynamic {name}"] = tick_call(robot, q, dynamic_control(robot, name))
        scheme = impedance_control(robot, name, ur5.sensor_frame)
        calls[f"impedance {name}"] = tick_call(robot, q, scheme)
    calls["bare dynamics"] = bare_dynamics_call(ur5.urdf, ur5.tip_frame, q)
    pink = pink_call(ur5.urdf, ur5.tip_frame, q)
    if pink:
        calls["pink"] = pink
    times = side_by_side(calls)
    bare = "Pinocchio calls and one 6x6 solve"
    pairs = [(f"CLIK tick, {name}", name, bare, "bare") for name in ORIENTATIONS]
    pairs.append(("CLIK tick on a trajectory", "moving", bare, "bare"))
    terms = "Pinocchio calls for (33) and one 6x6 solve"
    pairs += [
        (f"dynamic tick, {name}", f"dynamic {name}", terms, "bare dynamics")
        for name in ORIENTATIONS
    ]
    pairs += [
        (f"impedance tick, {name}", f"impedance {name}", terms, "bare dynamics")
        for name in ORIENTATIONS
    ]
    if pink:
        pairs.append(("CLIK tick", "euler_parameters", "pink solve_ik", "pink"))
    return [
        (
            f"{what} ({times[a] * 1e6:.1f} us)",
            f"{against} ({times[b] * 1e6:.1f} us)",
            f"{times[a] / times[b]:.2f}",
        )
        for what, a, against, b in pairs
    ]


if __name__ == "__main__":
    for row in run():
        print(*row, sep=" | ")
