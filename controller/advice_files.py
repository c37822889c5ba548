"""`advice.parquet`: the plan and the policy over distance, one row per place of the road."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from controller.advice import Advice
from vehicle_model.car.errors import BadInput

_PLAN = ("s", "speed", "torque", "gear", "costate", "time", "fuel")
"""Fields (n,): one column each."""
_POLICY = ("policy_acceleration", "policy_gear", "policy_costate")
"""Fields (n, m): one column of fixed-size lists each; the speeds they stand for are in the metadata."""


def write_advice(advice: Advice, path: Path) -> None:
    """Write `advice` as Parquet, aside and renamed; the same advice gives the same bytes."""
    columns: dict[str, pa.Array] = {name: pa.array(np.ascontiguousarray(getattr(advice, name))) for name in _PLAN}
    width = len(advice.policy_speed)
    for name in _POLICY:
        flat = pa.array(np.ascontiguousarray(getattr(advice, name)).ravel())
        columns[name] = pa.FixedSizeListArray.from_arrays(flat, width)
    metadata = {
        "policy_speed": json.dumps([float(speed) for speed in advice.policy_speed]),
        "time_value": json.dumps(float(advice.time_value)),
    }
    aside = path.with_name(path.name + ".part")
    pq.write_table(pa.table(columns).replace_schema_metadata(metadata), aside, compression="zstd")
    aside.replace(path)


def read_advice(path: Path) -> Advice:
    """Read what `write_advice` wrote. Raises `BadInput` where the file is missing or is no advice."""
    try:
        table = pq.read_table(path)
        metadata = table.schema.metadata
        policy_speed = np.array(json.loads(metadata[b"policy_speed"]))
        policy = {
            name: table[name].combine_chunks().flatten().to_numpy().reshape(-1, len(policy_speed)) for name in _POLICY
        }
        return Advice(
            **{name: table[name].to_numpy() for name in _PLAN},
            **policy,
            policy_speed=policy_speed,
            time_value=json.loads(metadata[b"time_value"]),
        )
    except FileNotFoundError as error:
        raise BadInput(path, "", "advice (advice.parquet), but there is no such file") from error
    except (pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise BadInput(path, "", f"advice as `rollingroad plan` writes it ({error})") from error
