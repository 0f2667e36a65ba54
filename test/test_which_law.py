"""The laws for comparison, the experiments without nodes, and an implementation by others."""

import math
import subprocess
import sys

import numpy as np
import pytest
from representations import make
from samples import generator, positive_definite, rodrigues, uniform, unit_vectors
from synthetic_runs import write_run
from tolerances import ALGEBRAIC, assert_close

from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.paper import COMPARISON
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.orientation import representation
from eulerparams_control.laws.rotations import EulerParameters, exp, mutual, quaternion
from eulerparams_control.parameters.schemes import schemes

K = np.diag([50.0, 20.0, 5.0])
IN_THE_LIBRARY = [name for name in COMPARISON if not load_experiment(name).variants]


def moment(name, R, K_o=K):
    """Return the elastic moment (3,) of a law at R = R_d' R_c, desired axes."""
    return -representation(name).spring(np.eye(3), R, K_o).moment


# --- laws as shipped ---------------------------------------------------------------------------
@pytest.mark.parametrize("theta", [1e-3, 0.5, 2.0, 3.1])
def test_a_law_as_shipped_is_the_stiffness_times_the_displacement(theta):
    f = {"eps": 2 * math.sin(theta / 2), "theta": theta, "sin": math.sin(theta)}
    for r, K_o in zip(unit_vectors(10), positive_definite(10, 3, 5, 50), strict=True):
        for name, length in f.items():
            found = moment(f"as_shipped_{name}", rodrigues(theta, r), K_o)
            assert_close(found, K_o @ (length * r), 100 * ALGEBRAIC)


def test_no_node_of_a_robot_offers_a_law_as_shipped():
    code = (
        "from eulerparams_control.parameters.fields import from_mapping\n"
        "from eulerparams_control.parameters.schemes import schemes\n"
        "for s in schemes().values():\n"
        "    try: from_mapping(s.parameters, {'orientation': 'as_shipped_eps'})\n"
        "    except Exception as error: print(type(error).__name__)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["UnknownNameError"] * len(schemes())


def test_a_page_shows_the_error_of_a_law_as_shipped_for_the_run_that_used_it_alone(tmp_path):
    code = (
        "import sys, eulerparams_control.lab.experiments\n"  # first: it registers the laws
        "from eulerparams_control.analysis import Digest, load\n"
        "for bag in sys.argv[1:]:\n"
        "    curves = Digest.of(load(bag)).curves\n"
        "    print(*[c for c in curves if c.startswith(('error_as_shipped', 'error_angle'))])\n"
    )
    bags = [
        write_run(tmp_path / name, [0.1, 0.2], parameters={"orientation": name})
        for name in ("euler_parameters", "as_shipped_eps")
    ]
    command = [sys.executable, "-c", code, *bags]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    own, shipped = map(str.split, run.stdout.splitlines())
    assert own == ["error_angle_axis"]
    assert sorted(shipped) == ["error_angle_axis", "error_as_shipped_eps"]


# --- experiments without nodes -----------------------------------------------------------------
@pytest.mark.parametrize("name", IN_THE_LIBRARY)
def test_each_claim_of_the_comparison_without_nodes_is_a_number_with_a_prediction(name):
    criteria = load_experiment(name).criteria  # that they are met: test_paper
    assert criteria
    assert all(criterion.number and criterion.predicted for criterion in criteria)


# --- an implementation by others ---------------------------------------------------------------
def product_of(Q_1, Q_2):
    """Return the Euler parameters of R_1 R_2."""
    return mutual(EulerParameters(Q_1.eta, -Q_1.eps), Q_2)


def test_eqs_59_and_60_agree_with_sdu_controllers():
    """Their admittance holds {eta_cd, eps_cd}, omega_cd and integrates by explicit steps."""
    sdu = pytest.importorskip("sdu_controllers", reason="pip install sdu_controllers")
    dt, own = 1e-3, make("euler_parameters")
    matrices = positive_definite(3, 1), positive_definite(3, 2), positive_definite(3, 3, 5, 50)
    for key, (M, D, K_o) in enumerate(zip(*matrices, strict=True)):
        theirs = sdu.controllers.AdmittanceControllerPosition(1 / dt)
        theirs.set_mass_matrix_orientation(np.asfortranarray(M))
        theirs.set_damping_matrix_orientation(np.asfortranarray(D))
        theirs.set_stiffness_matrix_orientation(np.asfortranarray(K_o))
        Z, Q, x = Impedance(M, D, K_o), EulerParameters(1.0, np.zeros(3)), np.zeros(3)
        desired = quaternion(uniform(1, key=key)[0])
        rate, phase = 5 * generator(77, key).normal(size=(2, 3))
        largest = 0.0
        for step in range(1000):
            mu = 20 * np.sin(rate * step * dt + phase)
            x = x + dt * own.state_rate(np.array([Q.eta, *Q.eps, *x]), mu, Z.values)[4:]
            Q = product_of(quaternion(exp(dt * x)), Q)
            theirs.step(np.zeros(3), mu, np.zeros(3), np.array([desired.eta, *desired.eps]))
            c, found = product_of(desired, Q), theirs.get_output()[3:]
            sign = math.copysign(1.0, found @ [c.eta, *c.eps])
            assert_close(sign * found, [c.eta, *c.eps])
            largest = max(largest, 2 * math.acos(min(1.0, abs(Q.eta))))
        assert largest > 0.3
