"""One tick of each law, state to command, against the Pinocchio calls that it needs."""

import numpy as np
import pinocchio as pin
from timing import side_by_side

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Circle
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import SchemeInfo, schemes
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot


def scheme_of(info: SchemeInfo, robot: Robot, orientation: str, sensor_frame: str):
    """Return a scheme with its defaults and limits, that compensates friction or feels a wrench."""
    wanted = {"orientation": orientation, "compensate_friction": True}
    known = fields_of(info.parameters)
    parameters = info.parameters(**{k: v for k, v in wanted.items() if k in known})
    scheme = parameters.make_scheme(robot, robot.limits)
    if "wrench" in info.inputs:
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
    bare = {
        "position": ("Pinocchio calls and one 6x6 solve", bare_call),
        "torque": ("Pinocchio calls for (33) and one 6x6 solve", bare_dynamics_call),
    }
    calls = {text: call(ur5.urdf, ur5.tip_frame, q) for text, call in bare.values()}
    pairs = []
    for info in schemes().values():
        for orientation in ORIENTATIONS:
            scheme = scheme_of(info, robot, orientation, ur5.sensor_frame)
            name = f"{info.name} tick, {orientation}"
            calls[name] = tick_call(robot, q, scheme)
            pairs.append((name, bare[info.control][0]))
    clik = scheme_of(schemes()["clik"], robot, "euler_parameters", ur5.sensor_frame)
    calls["clik tick on a trajectory"] = tick_call(robot, q, clik, moving=True)
    pairs.append(("clik tick on a trajectory", bare["position"][0]))
    if pink := pink_call(ur5.urdf, ur5.tip_frame, q):
        calls["pink solve_ik"] = pink
        pairs.append(("clik tick, euler_parameters", "pink solve_ik"))
    times = side_by_side(calls)
    return [
        (
            f"{what} ({times[what] * 1e6:.1f} us)",
            f"{against} ({times[against] * 1e6:.1f} us)",
            f"{times[what] / times[against]:.2f}",
        )
        for what, against in pairs
    ]


if __name__ == "__main__":
    for row in run():
        print(*row, sep=" | ")
