"""Gymnasium environments: eco-driving in SUMO's traffic and on highway-env's road."""


def register() -> None:
    """Register `rollingroad/EcoDrive-v0` and `rollingroad/HighwayEco-v0`; harmless when repeated."""
    import gymnasium  # here: importing it may itself lead here (see rollingroad/__init__.py)

    for name, entry in (
        ("rollingroad/EcoDrive-v0", "sim.envs.eco_drive:EcoDrive"),
        ("rollingroad/HighwayEco-v0", "sim.envs.highway_eco:HighwayEco"),
    ):
        if name not in gymnasium.registry:
            gymnasium.register(id=name, entry_point=entry)
