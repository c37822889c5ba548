"""`advice.parquet`: the plan over distance, one row per place of the road, and the policy at those that have one."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from controller.advice import Advice
from vehicle_model.car.errors import BadInput

_PLAN = ("s", "speed", "torque", "gear", "costate", "time", "fuel", "coasting", "brake_force")
"""Fields (n,): one column each."""
_POLICY = ("policy_acceleration", "policy_gear", "policy_costate")
"""Fields (p, m): one column of lists each, null at places without a policy; speeds are in the metadata."""


def write_advice(advice: Advice, path: Path) -> None:
    """Write `advice` as Parquet, aside and renamed; the same advice gives the same bytes.

    The places of the policy are places of the plan. Raises ValueError where they are not.
    """
    rows = np.searchsorted(advice.s, advice.policy_s)
    if not np.array_equal(advice.s[np.minimum(rows, len(advice.s) - 1)], advice.policy_s):
        raise ValueError("the policy's places must be places of the plan")
    columns: dict[str, pa.Array] = {}
    for name in _PLAN:
        values = getattr(advice, name)
        if len(values):  # what is optional in the plan may be empty
            columns[name] = pa.array(np.ascontiguousarray(values))
    for name in _POLICY:
        columns[name] = _at_rows(getattr(advice, name), rows, len(advice.s))
    metadata = {
        "policy_speed": json.dumps([float(speed) for speed in advice.policy_speed]),
        "time_value": json.dumps(float(advice.time_value)),
        "certificate": json.dumps(advice.certificate, sort_keys=True),
    }
    aside = path.with_name(path.name + ".part")
    pq.write_table(pa.table(columns).replace_schema_metadata(metadata), aside, compression="zstd")
    aside.replace(path)


def _at_rows(values: NDArray, rows: NDArray[np.int64], length: int) -> pa.Array:
    """A column of `length` lists: row rows[i] holds values[i], the others null."""
    lengths = np.zeros(length, np.int32)
    lengths[rows] = values.shape[1]
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    return pa.ListArray.from_arrays(
        pa.array(offsets), pa.array(np.ascontiguousarray(values).ravel()), mask=pa.array(lengths == 0)
    )


def read_advice(path: Path) -> Advice:
    """Read what `write_advice` wrote. Raises `BadInput` where the file is missing or is no advice."""
    try:
        table = pq.read_table(path)
        metadata = table.schema.metadata
        policy_speed = np.array(json.loads(metadata[b"policy_speed"]))
        told = table.filter(table[_POLICY[0]].is_valid())
        policy = {
            name: told[name].combine_chunks().flatten().to_numpy().reshape(-1, len(policy_speed)) for name in _POLICY
        }
        return Advice(
            **{name: table[name].to_numpy() for name in _PLAN if name in table.column_names},
            **policy,
            policy_s=told["s"].to_numpy(),
            policy_speed=policy_speed,
            time_value=json.loads(metadata[b"time_value"]),
            certificate=json.loads(metadata[b"certificate"]),
        )
    except FileNotFoundError as error:
        raise BadInput(path, "", "advice (advice.parquet), but there is no such file") from error
    except (pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise BadInput(path, "", f"advice as `rollingroad plan` writes it ({error})") from error
