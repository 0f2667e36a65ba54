"""Contact and compliance: wrench at the tip, compliant frame, V_3 and their numbers.

The rod of the synthetic runs is at q = 0 or at q = 90 deg, where the tip points down: its x is
-z of the base, its z is x of the base.  The desired frame is at q = 0: p_d = (1, 0, 0), R_d = I.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from samples import moving, positive_definite
from synthetic_runs import recorded
from tolerances import ALGEBRAIC, assert_close

from eulerparams_control.analysis.compliant import (
    CompliantMotion,
    rotational_residual,
    translational_residual,
)
from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.quantities import BY_NAME, measure
from eulerparams_control.analysis.series import Frames
from eulerparams_control.errors import BagError, ConfigurationError, UnknownNameError
from eulerparams_control.laws.compliant_frame import ComplianceLaw, CompliantFrame
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.orientation import representation
from eulerparams_control.laws.rotations import R_angle_axis, exp
from eulerparams_control.messages.to_ros import springs_to_ros
from eulerparams_control.motion.frames import DesiredFrame

EXACT = 1e-9  # relative: a few operations on doubles
DOWN = math.pi / 2
NODE = "/impedance_control"
P_D = np.array([1.0, 0.0, 0.0])

IMPEDANCE = {
    "orientation": "euler_parameters",
    "translational_frame": "base",
    "M_p": [2.0, 2.0, 2.0],
    "D_p": [20.0, 20.0, 20.0],
    "K_p": [1000.0, 500.0, 200.0],
    "K_p_axes": [],
    "M_o": [1.0, 2.0, 3.0],
    "D_o": [],
    "damping_ratio_o": 0.5,
    "K_o": [10.0, 20.0, 40.0],
    "K_o_axes": [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0],  # 10 about y, 20 about z, 40 about x
}


def complying(folder, compliant, wrenches=None, q=None, **told):
    """Return a run of impedance control; the rod rests at q = 0 unless q (N,) is given."""
    q = [0.0] * len(compliant) if q is None else q
    run = {"measured": q, "compliant": compliant, "wrenches": wrenches}
    return recorded(folder / "run", **run, parameters=IMPEDANCE | told, node=NODE)


# --- the wrench at the tip -----------------------------------------------------------
# 2 kg, 0.1 m along the rod beyond the tip, and a sensor that is off by 1 N and 0.5 Nm.
EARTH = {"gravity": [0.0, 0.0, -10.0]}
TOOL = EARTH | {"tool_mass": 2.0, "tool_com": [0.1, 0.0, 0.0]}
OFF = TOOL | {"wrench_bias": [1.0, 0.0, 0.0, 0.0, 0.5, 0.0]}
SENSED = EARTH | {"tool_mass": 2.0, "sensed_mass": 0.5, "sensed_com": [0.1, 0, 0.0]}
NOTHING = [0] * 6


@pytest.mark.parametrize(
    ("q", "w", "told", "expected"),
    [
        (0.0, [1, 2, 3, 4, 5, 6], {}, [1, 2, 3, 4, 5, 6]),
        (DOWN, [1, 2, 3, 4, 5, 6], {}, [3, 2, -1, 6, 5, -4]),
        # sensor y is tip z, sensor z is minus tip y; the force acts 0.2 m before the tip:
        # (-0.2, 0, 0) x (1, -3, 2) = (0, 0.4, 0.6)
        (0.0, [1, 2, 3, 0, 0, 0], {"sensor": "sensor"}, [1, -3, 2, 0, 0.4, 0.6]),
        (DOWN, [1, 2, 3, 0, 0, 0], {"sensor": "sensor"}, [2, -3, -1, 0.6, 0.4, 0]),
        # weight of the tool and bias are no contact
        (0.0, [0, 0, -20, 0, 2, 0], {"parameters": TOOL}, NOTHING),  # (0.1, 0, 0) x (0, 0, -20)
        (DOWN, [21, 0, 0, 0, 0.5, 0], {"parameters": OFF}, NOTHING),  # it hangs
        (0.0, NOTHING, {"parameters": SENSED}, [0, 0, 5, 0, -0.5, 0]),  # beyond the sensor
        (0.0, NOTHING, {"parameters": TOOL | {"compensate_tool_weight": False}}, NOTHING),
        # the sign is that of the parameters of the impedance
        (0.0, [1, 2, 3, 4, 5, 6], {"parameters": {"wrench_sign": -1}}, [-1, -2, -3, -4, -5, -6]),
        (0.0, [1, 2, 3, 4, 5, 6], {"parameters": {"wrench_sign": -1}, "node": "/clik"},
         [1, 2, 3, 4, 5, 6]),
    ],
)  # fmt: skip
def test_a_wrench_is_that_of_the_contact_at_the_tip_in_base_axes(tmp_path, q, w, told, expected):
    run = recorded(tmp_path / "run", [q], wrenches=[w], **{"node": f"/left{NODE}"} | told)
    assert_close(np.concatenate((run.wrench.f[0], run.wrench.mu[0])), expected)


def test_a_wrench_that_cannot_be_used_leaves_the_rest(tmp_path):
    run = recorded(tmp_path / "run", [0.1, 0.2], wrenches=[[1] * 6] * 2, sensor="base")
    assert run.wrench is None
    assert "the frame 'base' is not fixed to the tip 'tip': hinge, roll" in run.why_no_wrench
    with pytest.raises(BagError, match="is not fixed to the tip"):
        measure("peak_force", run)
    assert measure("peak_orientation_error", run) == pytest.approx(math.degrees(0.2))
    write_page(tmp_path / "page.html", [Digest.of(run)], "", "")
    assert "run: the wrench cannot be moved to the tip" in (tmp_path / "page.html").read_text()
    assert recorded(tmp_path / "bare", [0.1]).why_no_wrench == "no wrench was recorded"
    run = complying(tmp_path / "w", FRAMES[:1], [[1] * 6], wrench_sign=2)
    assert "parameter 'wrench_sign' is 2; expected between -1 and 1" in run.why_no_wrench


# --- forces and moments --------------------------------------------------------------
FORCES = [[0, 0, 0], [3, 0, -4], [0, 0, 5], [0, 2, 4], [0, -2, 4.5]]
WRENCHES = [[*f, 0, 0, m] for f, m in zip(FORCES, (0.0, -9.0, 4.0, 5.0, 7.0), strict=True)]


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("final_force", {"window": 0.01}, 4.25),  # of the mean, not the mean of the lengths
        ("final_force", {"axis": [0, -3, 0]}, 2.0),
        ("peak_force", {"axis": [0, 0, -1]}, 5.0),  # without its sign
        ("peak_force", {"after": 0.03, "before": 0.03}, math.hypot(2, 4)),
        ("least_force", {"axis": [0, 0, 1]}, -4.0),
        ("least_force", {"after": 0.02}, math.hypot(2, 4)),
        ("final_moment", {"window": 0.02}, 16 / 3),
        ("peak_moment", {"after": 0.015, "axis": [0, 0, 2]}, 7.0),
        ("force_ripple", {"window": 0.01, "axis": [0, 0, 1]}, 0.5),
    ],
)
def test_a_number_of_the_contact_is_what_it_is_by_hand(tmp_path, name, options, expected):
    run = recorded(tmp_path / "run", [0.0] * 5, wrenches=WRENCHES)
    assert measure(name, run, **options) == pytest.approx(expected, rel=EXACT, abs=ALGEBRAIC)


def test_an_axis_can_be_that_of_the_desired_frame(tmp_path):
    run = recorded(tmp_path / "run", [0.0] * 5, wrenches=WRENCHES)
    turned = DesiredFrame(P_D, R_angle_axis(math.pi / 2, np.array([1.0, 0.0, 0.0])))  # y is z
    run = replace(run, measured=replace(run.measured, desired=Frames.of([turned] * 5)))
    assert measure("final_force", run, axis=[0, 1, 0], frame="desired") == pytest.approx(4.5)
    assert measure("final_force", run, axis=[0, 0, 1], frame="desired") == pytest.approx(2.0)
    assert measure("final_moment", run, axis=[0, 1, 0], frame="desired") == pytest.approx(7.0)
    assert measure("peak_force", run, frame="desired") == pytest.approx(5.0)
    nothing = replace(run, measured=replace(run.measured, desired=Frames.of([None] * 5)))
    with pytest.raises(BagError, match="no desired frame"):
        measure("final_force", nothing, frame="desired")


@pytest.mark.parametrize("axis", [[0, 0, 0], [1, 2], [math.nan, 0, 1], [1, 2, 3, 4]])
def test_an_axis_that_is_none_is_refused(tmp_path, axis):
    run = recorded(tmp_path / "run", [0.0] * 5, wrenches=WRENCHES)
    with pytest.raises(ConfigurationError, match=r"axis is .*; expected three numbers, not all 0"):
        measure("final_force", run, axis=axis)
    with pytest.raises(UnknownNameError, match="unknown frame 'tool'; known: base, desired"):
        measure("final_force", run, frame="tool")


# --- the compliant frame -------------------------------------------------------------
def turned(*rotation_vector, p=(1.0, 0.0, 0.0)):
    return DesiredFrame(np.array(p), exp(np.array(rotation_vector)))


FRAMES = [
    turned(0.0, 0.0, 0.0),
    turned(0.0, -0.4, 0.0, p=(1.01, 0.0, 0.0)),
    turned(0.1, 0.2, 0.0, p=(1.0, 0.003, -0.004)),
]


@pytest.fixture
def compliant(tmp_path):
    """A run of the rod at 0, -0.3 and 0.2 rad with compliant frames and a moment about y."""
    moments = [[0, 0, 0, 0, 0, 0], [10, 0, 0, 0, 4, 0], [0, 6, -8, 0, -3, 0]]
    options = {"measured": [0.0, -0.3, 0.2], "efforts": [0.0] * 3, "compliant": FRAMES}
    return recorded(tmp_path / "run", **options, wrenches=moments, parameters=IMPEDANCE, node=NODE)


def test_without_a_desired_frame_there_is_no_displacement():
    motion = CompliantMotion(np.zeros(1), Frames.of(FRAMES[:1]), Frames.of([None]))
    for values in (motion.p_cd_d, motion.R_cd, motion.rho_cd_d, motion.Q_cd, motion.x, motion.dx):
        assert np.isnan(values[0]).all()


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("final_turn", {}, math.degrees(math.hypot(0.1, 0.2))),
        ("final_turn", {"axis": [0, 1, 0], "window": 0.01}, math.degrees(-0.1)),
        ("final_displacement", {"axis": [0, 0, -2]}, 4.0),
        ("peak_displacement", {"after": 0.02}, 5.0),
        ("moment_axis_angle", {}, 180 - math.degrees(math.atan2(0.1, 0.2))),
        ("apparent_stiffness", {}, 9 / -0.6),
        # the sensor turns with the rod, by -0.3 and 0.2 rad about y
        ("apparent_translational_stiffness", {}, 100 / (0.018 + 0.032 * math.cos(0.2))),
        ("guided_distance", {"axis": [0, 0, 1]}, -4.0),
        ("final_compliant_speed", {}, 0.0),
        # the rod at -0.3 rad, the compliant frame at -0.4 rad
        ("peak_orientation_error", {"against": "compliant", "before": 0.01}, math.degrees(0.1)),
        ("final_position_error", {"against": "compliant", "before": 0.0}, 0.0),
        (
            "peak_position_error",
            {"against": "compliant", "before": 0.01},
            1e3 * math.hypot(1.01 - math.cos(0.3), math.sin(0.3)),
        ),
    ],
)
def test_a_number_of_the_compliance_is_what_it_is_by_hand(compliant, name, options, expected):
    assert measure(name, compliant, **options) == pytest.approx(expected, rel=EXACT, abs=1e-9)


# --- V_3 -----------------------------------------------------------------------------
def test_v_3_and_its_derivative_are_those_of_the_paper(tmp_path):
    q, rate = np.array([0.5, 0.3, 0.2]), np.array([-1.0, -0.5, 0.25])
    frames = [
        turned(0.0, angle, 0.0)._replace(omega_d=np.array([0.0, speed, 0.0]))
        for angle, speed in zip(q, rate, strict=True)
    ]
    moments = [[0, 0, 0, 0, mu, 0] for mu in (0.0, 2.0, -3.0)]
    run = complying(tmp_path, frames, moments, q)
    # about y: M_o 2, K_o 10, so that D_o is 2 * 0.5 * sqrt(2 * 10)
    V, power = run.lyapunov, rate * [0.0, 2.0, -3.0]
    np.testing.assert_allclose(V.t, [0.0, 0.01, 0.02])
    np.testing.assert_allclose(V.V, rate**2 + 20 * np.sin(q / 2) ** 2, rtol=EXACT)  # eq. (68)
    np.testing.assert_allclose(V.dV, -math.sqrt(20) * rate**2 + power, rtol=EXACT)  # eq. (69)
    assert measure("lyapunov_increase", run) == pytest.approx(0.0, abs=ALGEBRAIC)
    assert measure("lyapunov_start", run) == pytest.approx(V.V[0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"orientation": "euler_angles"}, "no Lyapunov function for euler_angles"),
        ({"K_o": [1.0, 2.0]}, "are not valid: impedance_o: K_o has 2 values"),
        ({"M_o": [0.0, 1.0, 1.0], "D_o": [1.0] * 3}, "not valid: impedance_o: M is not positive"),
        ({"damping_ratio_o": "high"}, "not valid: parameter 'damping_ratio_o' is 'high'"),
    ],
)
def test_without_v_3_the_recording_says_why(compliant, changes, words):
    run = replace(compliant, parameters={NODE: IMPEDANCE | changes})
    assert run.lyapunov is None
    assert words in run.why_no_lyapunov


# --- what the impedance equations leave ----------------------------------------------
@pytest.mark.parametrize("frame", ["base", "desired"])
def test_the_equations_leave_nothing_of_a_law_while_the_desired_frame_turns(frame):  # (52), (59)
    Z, w, t = Impedance(*positive_definite(3)), np.arange(1.0, 7.0), 0.01 * np.arange(100)
    law = ComplianceLaw(representation("euler_parameters"), Z, Z, frame)
    compliant, moving_frame = CompliantFrame(law), moving(key=3)
    desired = [DesiredFrame(*moving_frame(at)) for at in t]
    frames = [compliant.step(0.01, d, w) for d in desired]
    motion = CompliantMotion(t, Frames.of(frames), Frames.of(desired))
    f, mu = np.tile(w[:3], (100, 1)), np.tile(w[3:], (100, 1))
    assert_close(translational_residual(motion, f, Z, frame), 0, EXACT)
    assert_close(rotational_residual(motion, mu, Z), 0, EXACT)
    other = translational_residual(motion, f, Z, "desired" if frame == "base" else "base")
    assert np.linalg.norm(other[50]) > 1.0


def test_the_residual_of_a_run_is_what_its_force_and_moment_lack(tmp_path):
    p, angle = np.array([0.01, 0.0, -0.02]), 0.4  # at rest: K_p 1000, 200 N/m; 10 Nm/rad about y
    balance = [10.0, 0.0, -4.0, 0.0, 10.0 * math.sin(angle), 0.0]  # eqs. (54), (65)
    frame = turned(0.0, angle, 0.0, p=(P_D + p).tolist())
    off = [*balance[:3], 0.0, balance[4], 0.25]
    run = complying(tmp_path, [frame, frame], [balance, off])
    assert measure("force_residual", run) == pytest.approx(0.0, abs=EXACT)
    assert measure("moment_residual", run, before=0.0) == pytest.approx(0.0, abs=EXACT)
    assert measure("moment_residual", run) == pytest.approx(0.25)
    soft = replace(run, parameters={NODE: IMPEDANCE | {"K_p": [900.0, 500.0, 200.0]}})
    assert measure("force_residual", soft) == pytest.approx(1.0)
    angles = replace(run, parameters={NODE: IMPEDANCE | {"orientation": "euler_angles"}})
    with pytest.raises(BagError, match=r"\(59\) is of euler_parameters, not euler_angles"):
        measure("moment_residual", angles)
    with pytest.raises(BagError, match="no parameters of impedance_control"):
        measure("force_residual", replace(run, parameters={}))


def test_force_and_moment_count_at_the_centre_of_compliance_in_desired_axes(tmp_path):
    # the centre is 0.5 m along the rod and 0.1 m along z beyond the tip; the rod rests at q = 0
    offset, angle = np.array([0.5, 0.0, 0.1]), 0.3
    R_d = R_angle_axis(math.pi / 2, np.array([0.0, 0.0, 1.0]))  # its x is y of the base
    R_c, p = R_d @ exp(np.array([0.0, angle, 0.0])), R_d @ [0.02, 0.01, 0.0]
    frame = DesiredFrame(P_D + R_d @ offset + p - R_c @ offset, R_c)
    f, mu = R_d @ [20.0, 5.0, 0.0], R_d @ [0.0, 10.0 * math.sin(angle), 0.0]  # 1000, 500 N/m
    balance = [*f, *(mu + np.cross(offset, f))]
    told = {"compliance_offset": offset.tolist(), "translational_frame": "desired"}
    run = complying(tmp_path, [frame] * 2, [balance] * 2, **told)
    desired = Frames.of([DesiredFrame(P_D, R_d)] * 2)
    run = replace(run, compliant=replace(run.compliant, desired=desired))
    assert measure("force_residual", run) == pytest.approx(0.0, abs=EXACT)
    assert measure("moment_residual", run) == pytest.approx(0.0, abs=EXACT)
    assert measure("apparent_stiffness", run) == pytest.approx(10 * math.sin(angle) / angle)
    assert measure("moment_axis_angle", run) == pytest.approx(0.0, abs=1e-6)
    assert measure("apparent_translational_stiffness", run) == pytest.approx(425 / 0.45)
    assert_close(run.impedance.mu[0], mu, EXACT)
    # what was asked at the tip stays at the tip
    assert measure("final_moment", run) == pytest.approx(float(np.linalg.norm(balance[3:])))
    tip = np.linalg.norm(frame.p_d - P_D)
    assert measure("final_displacement", run) == pytest.approx(1e3 * float(tip))
    base = replace(run, parameters={NODE: run.parameters[NODE] | {"translational_frame": "base"}})
    assert measure("force_residual", base) == pytest.approx(math.hypot(5.0, 10.0))


# --- springs of compliance control ---------------------------------------------------
TOLD = {"K_p": [100.0] * 3, "K_o": [8.0] * 3}


def sprung(folder, q, changes=(), **told):
    """Return a run of compliance control; changes (sample, factor of K, clips) of its springs."""
    impedances = {
        k: partial(springs_to_ros, factor * 100.0 * np.eye(3), factor * 8.0 * np.eye(3), clips)
        for k, factor, clips in changes
    }
    run = {"parameters": TOLD | told, "node": "/compliance_control", "impedances": impedances}
    return recorded(folder, q, **run)


def elastic_energy(q, clips, factor=1.0):
    """Return that [J] of TOLD and the rod, which is 1 m long; 2 eps' K_o eps, (68)."""
    roots = [math.sqrt(factor * K) for K in (100.0, 8.0)]
    s = [2.0 * math.sin(q / 2) * root for root in roots]
    most = [clip * root for clip, root in zip(clips, roots, strict=True)]
    return sum(a * a / 2 if a < c else c * a - c * c / 2 for a, c in zip(s, most, strict=True))


@pytest.mark.parametrize("clip", [0.1, 10.0])
def test_springs_take_their_energy_on_the_way_out_and_give_it_back(tmp_path, clip):
    told = {"error_clip_position": clip, "error_clip_rotation": clip}
    there, back = np.linspace(0.0, 0.4, 400), np.linspace(0.4, 0.0, 300)
    out = sprung(tmp_path / "out", there, **told)
    left, most = (elastic_energy(q, (clip, clip)) for q in (back[149], 0.4))
    assert measure("spring_work", out) == pytest.approx(-1.0, abs=EXACT)
    assert BY_NAME["elastic_energy"].samples(out)[1][-1] == pytest.approx(most, rel=EXACT)
    half = sprung(tmp_path / "half", [*there, *back[:150]], **told)
    assert measure("spring_work", half) == pytest.approx(-left / (2 * most - left), abs=1e-4)
    closed = sprung(tmp_path / "closed", [*there, *back], **told)
    assert abs(measure("spring_work", closed)) < 1e-5
    with pytest.raises(BagError, match="no parameters of compliance_control were recorded"):
        measure("spring_work", replace(out, parameters={}))


def energies(run):
    """Return the elastic energy [J] by instant [s]."""
    t, energy = BY_NAME["elastic_energy"].samples(run)
    return dict(zip(t.tolist(), energy.tolist(), strict=True))


def test_springs_are_those_that_acted_clips_included_also_those_from_before_what_is_looked_at(
    tmp_path,
):
    """0.4 rad; not those before them, nor the stated ones; the next count from their instant on."""
    wide, clips = (10.0, 10.0), (0.1, 0.05)
    changes = [(2, 0.5, wide), (3, 4.0, clips), (6, 8.0, wide)]
    told = {"error_clip_position": 10.0, "error_clip_rotation": 10.0}
    whole = energies(sprung(tmp_path / "run", [0.4] * 8, changes, **told))
    stated, *changed = (
        elastic_energy(0.4, c, factor) for _, factor, c in [(0, 1.0, wide), *changes]
    )
    expected = [stated] * 2 + changed[:1] + changed[1:2] * 3 + changed[2:] * 2
    np.testing.assert_allclose([*whole.values()], expected, rtol=EXACT)
    found = energies(load(tmp_path / "run", start=0.04, end=0.07))
    assert found == {t: energy for t, energy in whole.items() if 0.04 <= t <= 0.07}
    assert len(found) == 4
