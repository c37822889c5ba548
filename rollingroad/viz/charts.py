"""What a picture shows, said once: panels of marks. `figures` draws it with matplotlib, `interactive` with plotly."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Okabe and Ito's palette: told apart with every common kind of colour blindness.
BLACK, ORANGE, SKY_BLUE, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE, GREY = "#F0E442", "#0072B2", "#D55E00", "#CC79A7", "#6B6B6B"

BASELINE, ADVISED, ADVICE, LIMIT, TRUTH, FOUND, FILTER = BLUE, VERMILION, GREEN, GREY, BLACK, ORANGE, SKY_BLUE
"""One meaning, one colour, in every picture."""


@dataclass(frozen=True)
class Line:
    """y over x, both (n,). `dash`: "", "dash", "dot"; `step` holds the value until the next x; `dots` draws no line,
    but points `size` pixels wide."""

    x: Array
    y: Array
    name: str
    colour: str
    dash: str = ""
    width: float = 1.6
    step: bool = False
    dots: bool = False
    size: float = 3.0


@dataclass(frozen=True)
class Band:
    """The area between low and high over x, (n,) each."""

    x: Array
    low: Array
    high: Array
    name: str
    colour: str


@dataclass(frozen=True)
class Span:
    """A stretch of the x axis, with a word for it."""

    start: float
    end: float
    name: str
    colour: str = GREY


@dataclass(frozen=True)
class Heat:
    """z (n, m) over the centres x (n,) and y (m,); cells that are not `sure` (n, m) are drawn faint."""

    x: Array
    y: Array
    z: Array
    name: str
    scale: str
    low: float
    high: float
    sure: NDArray[np.bool_] | None = None
    units: tuple[str, str] = ("rpm", "N m")
    """Of x and y."""


@dataclass(frozen=True)
class Bars:
    """One horizontal bar per category, stacked on those of the marks before it in the panel; losses and gains apart."""

    categories: tuple[str, ...]
    values: Array
    name: str
    colour: str


@dataclass(frozen=True)
class Whiskers:
    """One point per category with its interval, horizontal; NaN draws nothing, an interval of NaN draws none."""

    categories: tuple[str, ...]
    values: Array
    low: Array
    high: Array
    name: str
    colour: str


Mark = Line | Band | Span | Heat | Bars | Whiskers


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    y_label: str
    marks: tuple[Mark, ...]
    title: str = ""
    x_label: str = ""
    y_range: tuple[float, float] | None = None
    x_range: tuple[float, float] | None = None
    weight: float = 1.0
    """Height relative to the other panels of a column."""
    log_x: bool = False
    equal: bool = False
    """One unit of x as long as one of y (plans)."""


@dataclass(frozen=True)
class Chart:
    """Panels under one another, or side by side; `key` names it in files and links."""

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    beside: bool = False
    """Panels side by side (they share no axis); otherwise one under the other on one x axis."""
    height: int = 360
    """Pixels at a width of 640."""
    notes: dict[str, str] = field(default_factory=dict)
