"""An operator's ``~/halt`` and ``~/resume``, over DDS."""

import numpy as np
import pytest
from ros_processes import FRAMES, HOME, Controlled, pose, reference, values
from std_srvs.srv import Trigger

from eulerparams_control.control.judge import AT_REST
from eulerparams_control.motion.frames import DesiredFrame


@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_an_arm_that_is_halted_stays_so_whatever_is_sent_until_it_is_resumed(world, executable):
    node = Controlled(world, executable, FRAMES)
    p, R = pose(HOME)
    goal = DesiredFrame(p + [0.0, 0.0, 0.1], R)
    node.follow(reference(goal, times=(1.0,)))
    node.arm.ticks(300)

    def ask(service: str) -> tuple[bool, str]:
        response = node.peer.call(Trigger, f"/{executable}/{service}", Trigger.Request())
        return response.success, response.message

    assert ask("halt")[0]
    done, why = ask("resume")
    assert not done
    assert "ask when it is at rest" in why
    status = node.status(lambda s: values(s)["mode"] == "stopped")
    assert (values(status)["cause"], values(status)["remedy"]) == ("halt", "call ~/resume")
    for _ in range(10):
        node.arm.ticks(100)
        node.references.publish(reference(DesiredFrame(*pose(node.arm.q)), times=(1.0,)))
    assert np.abs(node.arm.dq).max() < AT_REST
    status = node.status(lambda s: values(s).get("reference rejected") == "10")
    assert values(status)["mode"] == "stopped"
    assert "call ~/resume" in values(status)["last rejected"]
    assert ask("resume")[0]
    assert values(node.status())["mode"] == "holding"
    node.follow(reference(DesiredFrame(*pose(node.arm.q)), goal, times=(0.0, 1.0)))
    node.arm.ticks(1500)
    np.testing.assert_allclose(pose(node.arm.q)[0], goal.p_d, atol=1e-3)


def test_a_controller_that_is_not_active_has_nothing_to_halt_or_resume(world):
    world.start("clik", {**FRAMES, "autostart": False})
    for service in ("halt", "resume"):
        response = world.peer.call(Trigger, f"/clik/{service}", Trigger.Request())
        assert not response.success
        assert "not active" in response.message
