"""How rerun's viewer lays a run out."""

import rerun as rr
import rerun.blueprint as rrb


def blueprint(timeline: str = "time") -> rrb.Blueprint:
    """Three tabs, every signal in three clicks: the drive, the observer, the engine with the advice.

    Every view runs over `timeline`, "time" (s) or "distance" (m), until another is chosen at the bottom left.
    """
    whole = rrb.TimeAxis(
        view_range=rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    )

    def curves(name: str, *paths: str) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(name=name, contents=[f"/{path}/**" for path in paths], axis_x=whole)

    def estimate(name: str, unit: str) -> rrb.TimeSeriesView:
        return curves(f"{name.replace('_', ' ')} ({unit})", f"observer/{name}")

    paper = (255, 255, 255)
    plan = rrb.Spatial2DView(origin="/plan", name="plan (m)", background=paper)
    engine = rrb.Spatial2DView(origin="/engine_map", name="engine on the efficiency map found", background=paper)
    earth = rrb.MapView(origin="/map", name="map (needs the net for its tiles)")
    events = rrb.StateTimelineView(
        name="faults and outages, clutch", contents=["/faults/**", "/state/**"], time_view=whole
    )
    drive = rrb.Horizontal(
        rrb.Vertical(rrb.Tabs(plan, earth), engine),
        rrb.Vertical(
            curves("speed (km/h)", "speed"),
            rrb.Tabs(curves("altitude (m)", "road/altitude", "gps/altitude"), curves("grade (%)", "road/grade")),
            estimate("thrust", "kN, less brakes"),
            curves("gear", "gear"),
            curves("fuel burnt (MJ)", "fuel/burnt"),
            events,
            row_shares=[3, 1.4, 2, 1.2, 1.8, 2],
        ),
        column_shares=[2, 3],
        name="Drive",
    )
    observer = rrb.Grid(
        estimate("thrust", "kN, less brakes"),
        estimate("pitch", "% grade"),
        estimate("fuel_power", "kW"),
        estimate("engine_speed", "rpm"),
        estimate("speed", "km/h"),
        curves("biases (m/s2)", "observer/bias"),
        curves("innovations (standard deviations)", "innovation"),
        curves("rejected (standard deviations)", "rejected"),
        grid_columns=2,
        name="Observer",
    )
    engine_tab = rrb.Grid(
        curves("engine speed (rpm)", "engine/speed"),
        curves("engine torque (N m)", "engine/torque"),
        curves("fuel power (kW)", "fuel/power"),
        curves("worth of speed (kJ per m/s)", "advice"),
        curves("brakes (kN)", "force/brake"),
        curves("road load (kN)", "force/road_load"),
        grid_columns=2,
        name="Engine and advice",
    )
    return rrb.Blueprint(
        rrb.Tabs(drive, observer, engine_tab, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )
