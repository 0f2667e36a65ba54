"""A bag as a table for learning: what is seen and what is done next, at 20 Hz, as parquet.

    python examples/bag_to_table.py BAG [TABLE.parquet]

Each row has the joints, the tip with its orientation as a rotation vector, and, as what is done,
where the tip was 1/20 s later, seen from where it is: the same numbers wherever the arm stands.
It needs the extra [analysis]; `analyze BAG --export parquet` writes all quantities of a bag.
"""

import argparse

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from eulerparams_control import analysis
from eulerparams_control.analysis.stacks import rotation_vectors

RATE = 20.0  # [Hz]


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bag")
    parser.add_argument("table", nargs="?", default="table.parquet")
    given = parser.parse_args()
    arm, joints = (run := analysis.load(given.bag)).measured, run.robot.joints
    t = np.arange(arm.t[0], arm.t[-1], 1 / RATE)
    rows = np.searchsorted(arm.t, t, side="right") - 1  # the last state of each instant
    p, R = arm.p_e[rows], arm.R_e[rows]
    columns = {"t [s]": t}
    columns |= {f"q.{joint} [rad]": q for joint, q in zip(joints, arm.q[rows].T, strict=True)}
    vectors = {"p": ("m", p), "r": ("rad", rotation_vectors(R))}
    back = R.transpose(0, 2, 1)[:-1]  # the last row has no next
    vectors["dp"] = "m", (back @ np.diff(p, axis=0)[..., None])[..., 0]
    vectors["dr"] = "rad", rotation_vectors(back @ R[1:])
    for what, (unit, values) in vectors.items():
        columns |= {f"{what}.{x} [{unit}]": v for x, v in zip("xyz", values.T, strict=True)}
    table = pa.table({key: column[: len(t) - 1] for key, column in columns.items()})
    pq.write_table(table, given.table)
    print(f"{table.num_rows} rows of {table.num_columns} columns in {given.table}")


if __name__ == "__main__":
    main()
