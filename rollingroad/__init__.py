"""The application: the chain, the evaluation, the gap diagnosis, the views and the command.

Importing it registers the Gymnasium environments `rollingroad/EcoDrive-v0` and `rollingroad/HighwayEco-v0`: at once
where gymnasium is loaded (`gymnasium.make("rollingroad:rollingroad/EcoDrive-v0")`), else as soon as it is: loading
it takes longer than all else here, and few commands need it.
"""

import importlib.util
import sys
from importlib.machinery import ModuleSpec
from types import ModuleType


class _OnceGymnasiumLoads:
    """A finder that finds gymnasium as everybody else does, and registers the environments once it has run."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        sys.meta_path.remove(self)  # type: ignore[arg-type]
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            run = spec.loader.exec_module

            def run_and_register(module: ModuleType) -> None:
                run(module)
                _register()

            spec.loader.exec_module = run_and_register  # type: ignore[method-assign]
        return spec


def _register() -> None:
    from sim.envs import register

    register()


if "gymnasium" in sys.modules:
    _register()
else:
    sys.meta_path.insert(0, _OnceGymnasiumLoads())  # type: ignore[arg-type]
