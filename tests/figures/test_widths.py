"""Every figure fits on the axes of a user, whether they are as wide as a column or as a page."""

import warnings

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot

import vibrosweep as vs
from tests.cases import each_of
from tests.figures.test_axes import INDICES
from tests.figures.test_drawn_orbits import (
    random_basins,
    random_lines,
    random_orbits,
    random_shares,
    scene,
)
from vibrosweep import figures
from vibrosweep.analysis import separations_against_chance

MOST_ENTRIES = 16  # of a legend


def many_lines(dim):
    """Lines of twelve kinds of orbits, with every kind of bifurcation."""
    random = np.random.default_rng(1)
    same = {"data_vars": "minimal", "coords": "minimal", "compat": "override", "join": "override"}
    lines = xr.concat([random_lines(random, dim) for _ in range(4)], dim, **same)
    count = lines.sizes[dim]
    lines["cycle_periods"] = dim, np.arange(count) + 1
    codes = np.arange(count) % 8
    if dim == "curve":
        return lines.assign(bifurcation=(dim, codes))
    return lines.assign(
        bifurcation=((dim, "event"), codes[:, np.newaxis]),
        bifurcation_amplitude=lines["amplitude"].isel(point=[1]).rename(point="event"),
        bifurcation_phase=lines["impact_phase"].isel(point=[1]).rename(point="event"),
    ).assign_coords(restitution=0.8)


def diagram():
    random, at = np.random.default_rng(2), np.linspace(0.5, 3.0, 20)
    shape = (2, at.size, 3)
    exponent = random.normal(size=shape)
    exponent[0] = -np.inf
    numbers = {
        "lyapunov_largest": (("direction", "amplitude", "particle"), exponent),
        "rebound_velocity": (
            ("direction", "amplitude", "particle", "sample"),
            random.uniform(1.0, 5.0, (*shape, 4)),
            {"long_name": "velocity at lift-off", "units": "m s-1"},
        ),
        "regime": (("direction", "amplitude", "particle"), np.full(shape, 4, np.int8)),
        "launched_rebound_velocity": (
            ("amplitude", "launch", "sample"),
            random.uniform(1.0, 5.0, (at.size, 2, 4)),
        ),
        "launched_lyapunov_largest": (("amplitude", "launch"), random.normal(size=(at.size, 2))),
        "attractors": ("amplitude", np.arange(at.size) % 3),
        "chaos_high": ((), 1.1),
    }
    coords = {"amplitude": at, "direction": ["up", "down"], **scene(restitution=0.8)}
    attrs = {"observable": "rebound_velocity", "forcing": "amplitude"}
    return xr.Dataset(numbers, coords=coords, attrs=attrs)


def windows():
    e, scan = np.linspace(0.5, 0.95, 10), np.linspace(0.1, 4.0, 20)
    conditions = ["locked(1)", "locked(2)", "locked(3)", "locked(4)", "base_never_shared"]
    shape = (len(conditions), 2, e.size, 1)
    low = np.broadcast_to(np.linspace(0.2, 1.0, e.size)[:, np.newaxis], shape).copy()
    low[-1, 1] += 0.5
    dims = ("condition", "direction", "restitution", "window")
    numbers = {"A_min": low, "A_max": low + 1.0, "window_ends": np.zeros(shape, np.int8)}
    coords = {"condition": conditions, "direction": ["up", "down"], "restitution": e, "scan": scan}
    data = {name: (dims, one) for name, one in numbers.items()}
    return xr.Dataset(data, {**coords, **scene()}, {"forcing": "amplitude"})


@pytest.fixture(scope="module")
def drawings(sweep, twenty, make_record):
    """Functions that draw on given axes, each with the number of axes that it takes."""
    random = np.random.default_rng(0)
    few = make_record([0.0, 0.2, 0.4, 0.6, 0.8])
    distribution = vs.separations(sweep)
    chance = separations_against_chance(sweep)
    at = np.linspace(0.1, 0.9, 6)

    def of(name, *given, count=1, **options):
        return (lambda ax: getattr(figures, name)(*given, ax=ax, **options), count)

    lines = many_lines("curve")
    return {
        "plane": of("parameter_plane", sweep),
        "plane of heights": of("parameter_plane", sweep, "rebound_height_max"),
        "heights": of("height_against_restitution", sweep),
        "one particle": of("height_time", few, [0]),
        "five particles": of("height_time", few),
        "twenty particles": of("height_time", twenty),
        "return map": of("return_map", twenty),
        "separations": of("separation_distributions", [distribution] * 2, ["one", "two"], 1e-4),
        "chance": of("separations_over_chance", [chance], ["twenty particles"]),
        "sobol": of("sobol_bars", INDICES, count=2),
        "branches": of("orbit_branches", many_lines("branch")),
        "boundaries": of("orbit_boundaries", lines),
        "boundaries over a plane": of("orbit_boundaries", lines.isel(curve=[0, 1]), sweep=sweep),
        "orbits": of("periodic_orbits", random_orbits(random)),
        "orbits along an axis": of("periodic_orbits", random_orbits(random, amplitude=at)),
        "basins": of("basins_of_attraction", random_basins(random)),
        "shares": of("basin_shares", random_shares(random, 6)),
        "bifurcation": of("bifurcation_diagram", diagram(), count=2),
        "windows": of("stability_windows", windows(), count=2),
    }


@each_of(("width", "layout"), [(3.4, None), (7.0, "constrained")])  # inches: of a column, a page
def test_nothing_is_cut_and_the_axes_keep_their_share(width, layout, drawings):
    for name, (draw, count) in drawings.items():
        keeps_its_share(name, draw, count, width, layout)


def keeps_its_share(name, draw, count, width, layout):
    if name == "sobol":
        figure, axes = pyplot.subplots(1, count, figsize=(width, 2.6), layout=layout)
    else:
        figure, axes = pyplot.subplots(count, 1, figsize=(width, 2.6 * count), layout=layout)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw(axes)
        figure.draw_without_rendering()
    for one in figure.axes:
        around = one.get_tightbbox()
        assert around.x0 >= -1.0
        assert around.y0 >= -1.0
        assert around.x1 <= figure.bbox.x1 + 1.0
        assert around.y1 <= figure.bbox.y1 + 1.0
    for one in np.ravel(axes):
        size, whole = one.get_window_extent(), figure.bbox
        assert size.width * np.size(axes) ** (name == "sobol") >= 0.45 * whole.width or (
            name == "return map"  # square
        )
        assert size.height * count ** (name != "sobol") >= 0.25 * whole.height
        legend = one.get_legend()
        assert legend is None or len(legend.get_texts()) <= MOST_ENTRIES
    pyplot.close(figure)
